"""The report as a file: what is in it, what lies beside it, and that it asks nothing of the network."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from cltaa.lab.bench.accuracy.measurement import Accuracy, tasks_of
from cltaa.lab.bench.accuracy.report import debug_views, page
from cltaa.lab.bench.cells import Judging
from tests.sequence_factory import make_frame

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


def test_vectors_that_nobody_gave_are_black_and_the_longest_white() -> None:
    frame = make_frame(motion=True)
    motion = np.full((frame.height, frame.width, 2), np.nan, np.float32)
    motion[0, 0] = 0.0, -2.0
    view = debug_views(replace(frame, motion=motion))["own motion (white: 2 px)"]
    assert (view[0, 0] == 255).all()
    assert view.sum() == 3 * 255
