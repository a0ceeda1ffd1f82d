"""The report as a file: what is in it, what lies beside it, and that it asks nothing of the network."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec

from cltaa.lab.bench.accuracy.measurement import Accuracy, tasks_of
from cltaa.lab.bench.accuracy.report import page
from cltaa.lab.bench.cells import Judging

JUDGING = Judging(metrics=("mse", "flip"), rounding_frames=2, pictures=True)


def test_only_as_many_sequences_as_asked_for_have_frames_in_it(report: Path) -> None:
    result = msgspec.json.decode((report / "accuracy.json").read_bytes(), type=Accuracy)
    (measured,) = result.sequences
    tasks = tasks_of([Path(measured.folder)], result.variants, None, JUDGING)
    whole, without = page(result, tasks, report), page(result, tasks, report, 0)
    assert whole == (report / "index.html").read_text()
    assert ("data:image" in whole, "data:image" in without) == (True, False)


def test_the_report_consists_of_these_files(report: Path) -> None:
    names = {path.name for path in report.iterdir()}
    assert {"index.html", "accuracy.json", "accuracy.csv", "overview.md", "cells", "times"} == names


def test_it_asks_nothing_of_the_network(report: Path) -> None:
    text = (report / "index.html").read_text()
    addresses = set(re.findall(r"[a-z]+://[^\s\"'`)]+", text))
    assert addresses == {"http://www.w3.org/2000/svg"}  # a name, not a place
    assert "default-src 'none'" in text


def test_no_name_can_end_the_script(report: Path) -> None:
    result = msgspec.json.decode((report / "accuracy.json").read_bytes(), type=Accuracy)
    nasty = "<!--<script></script><script>window.broken = 1</script>"
    measured = msgspec.structs.replace(result.sequences[0], effects=nasty)
    tasks = tasks_of([report.parent / "seq"], result.variants, None, JUDGING)
    text = page(msgspec.structs.replace(result, sequences=[measured]), tasks, report)
    assert text.count("</script") == 2
    assert r"\u003c!--\u003cscript>\u003c/script>" in text
