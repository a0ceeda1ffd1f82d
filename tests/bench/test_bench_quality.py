"""``cltaa bench quality`` at a small size: cells, resuming, the page and the pictures."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from PIL import Image as Pillow

from cltaa.bench.quality.cases import HELD_OUT, TRAIN, Case, Shape, planned
from cltaa.bench.quality.cells import Cells
from cltaa.bench.quality.judge import COLUMNS, ONE_SAMPLE, Judged, judge_sequence
from cltaa.bench.quality.markdown_page import BEGIN, END, markdown, write_page
from cltaa.bench.quality.pictures import write_pictures
from cltaa.bench.quality.redrawn import REDRAWN
from cltaa.bench.quality.summary import best_engine, ordered, summarise
from cltaa.cli import main
from cltaa.devices.numpy_launcher import NumpyLauncher
from cltaa.errors import DataError, InputMissing
from cltaa.exr.read import read_frame
from cltaa.frames import Frame
from cltaa.judging.metrics import flip_map
from cltaa.judging.video_scores import Sums, VideoScores
from cltaa.parameters.presets import Published, load_preset, override
from cltaa.sequences.sources import open_sequence
from tests.sequence_factory import write_images, write_sequence

NUMPY = NumpyLauncher()
SMALL = ["--scene", "occluder", "--size", "64x36", "--frames", "5", "--samples", "4", "--settled", "1", "--held-out",
         "", "--preset", "default", "--device", "numpy", "--jitter", "r2:5"]  # fmt: skip


def scores(**values: float | None) -> Judged:
    everything: dict[str, float | None] = {column.name: 1.0 for column in COLUMNS}
    return Judged(scores=everything | values, frames=4, not_finite=0, device="none")


def case(scene: str, split: str = TRAIN) -> Case:
    return Case(scene, split, Path(f"{scene}-{split}"))


def test_a_run_captures_judges_and_goes_on(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n", encoding="utf-8")
    arguments = ["bench", "quality", *SMALL, "--work", str(tmp_path / "work"), "--page", str(page)]
    assert main([*arguments, "--pictures", str(tmp_path / "pictures"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    (row,) = found["rows"]
    assert (row["scene"], row["split"]) == ("occluder", TRAIN)
    sequence = open_sequence(tmp_path / "work" / "sequences" / row["key"])
    assert sequence.sequence_json["settings"]["jitter"] == "r2:5"
    expected = judge_sequence(sequence, [load_preset()], NUMPY, settled=1)
    for name in (ONE_SAMPLE, "default"):
        assert row["presets"][name]["scores"] == expected[name].scores
    assert row["presets"]["default"]["scores"]["psnr"] > row["presets"][ONE_SAMPLE]["scores"]["psnr"]
    text = page.read_text(encoding="utf-8")
    assert "jitter r2:5" in text
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    assert f"| default | **{row['presets']['default']['scores']['psnr']:.2f}** |" in text
    assert "![default](pictures/default.png)" in text
    with Pillow.open(tmp_path / "pictures" / "default.png") as picture:
        assert len(np.unique(np.asarray(picture))) > 10

    def again(*_arguments: Any, **_named: Any) -> Any:
        raise AssertionError("a finished cell was measured again")

    monkeypatch.setattr("cltaa.commands.bench_quality.judge_sequence", again)
    monkeypatch.setattr("cltaa.commands.bench_quality.capture", again)
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "means over sequences, train" in printed
    assert f"{row['presets']['default']['scores']['flip']:.4f}" in printed


def test_a_cell_is_kept_until_what_decides_it_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sequence = open_sequence(write_sequence(tmp_path / "capture", 3, reference=True))
    preset, judged = load_preset(), scores()
    Cells(tmp_path / "cells", sequence, 1, 4).put("default", preset, judged)
    assert Cells(tmp_path / "cells", sequence, 1, 4).get("default", preset) == judged
    assert Cells(tmp_path / "cells", sequence, 2, 4).get("default", preset) is None
    assert Cells(tmp_path / "cells", sequence, 1, 2).get("default", preset) is None
    assert Cells(tmp_path / "cells", sequence, 1, 4).get("default", override(preset, {"sample_limit": 3.0})) is None
    other = open_sequence(write_sequence(tmp_path / "other", 3, reference=True, seed=1))
    assert Cells(tmp_path / "cells", other, 1, 4).get("default", preset) is None
    theirs = msgspec.structs.replace(preset, published=Published.ENGINE)  # the plan leaves nothing out of it
    assert Cells(tmp_path / "cells", sequence, 1, 4).get("default", theirs) is None
    monkeypatch.setattr("cltaa.bench.quality.cells.code_sha256", lambda: "another version")
    assert Cells(tmp_path / "cells", sequence, 1, 4).get("default", preset) is None
    assert Cells(tmp_path / "cells", sequence, 1, 4, any_code=True).get("default", preset) == judged
    (tmp_path / "cells" / "default.json").write_text("{", encoding="utf-8")
    assert Cells(tmp_path / "cells", sequence, 1, 4, any_code=True).get("default", preset) is None


def test_what_is_not_finite_counts_and_is_judged_as_black(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sequence = open_sequence(write_sequence(tmp_path / "capture", 3, reference=True))
    monkeypatch.setattr(
        "cltaa.resolve.resolver.Resolver.resolve", lambda _self, frame: np.where(frame.colour > 2, np.nan, frame.colour)
    )
    judged = judge_sequence(sequence, [load_preset()], NUMPY, settled=1)
    bad = sum(int((frame.colour > 2).sum()) for frame in sequence)
    assert (judged["default"].not_finite, judged[ONE_SAMPLE].not_finite) == (bad, 0)
    assert math.isfinite(judged["default"].scores["psnr"] or math.nan)


@pytest.mark.parametrize(("least", "again"), [(1, True), (1, False), (10_000, True)])
def test_what_appears_is_told_by_single_samples_drawn_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, least: int, *, again: bool
) -> None:
    """The captured samples are right wherever something appears, which is why it is seen there; others are not."""
    folder = tmp_path / "capture"
    frames = [read_frame(path) for path in sorted(write_sequence(folder, 3).glob("*.exr"))]
    truth = [np.clip(frame.colour, 0.0, 1.0) for frame in frames]
    write_images(folder / "reference", truth, name="synthetic")
    elsewhere = [np.clip(image[:, ::-1], 0.0, 1.0) for image in truth]
    if again:
        write_images(folder / REDRAWN, elsewhere, name="synthetic")

    class AllAppears(VideoScores):
        def add_shown(self, frame: Frame, *given: Any, **named: Any) -> list[Sums]:
            sums = super().add_shown(frame, *given, **named)
            self.fresh = np.ones(frame.depth.shape, np.bool_)
            return sums

    monkeypatch.setattr("cltaa.bench.quality.judge.VideoScores", AllAppears)
    monkeypatch.setattr("cltaa.bench.quality.judge.LEAST_FRESH", least)
    monkeypatch.setattr("cltaa.resolve.resolver.Resolver.resolve", lambda _self, frame: elsewhere[frame.index])
    judged = judge_sequence(open_sequence(folder), [load_preset()], NUMPY, settled=1)
    found = judged["default"].scores["uncovered"]
    assert found == (pytest.approx(1.0) if again and least == 1 else None)


def test_flip_judges_every_so_many_frames(tmp_path: Path) -> None:
    sequence = open_sequence(write_sequence(tmp_path / "capture", 5, reference=True))
    assert sequence.reference is not None
    single = [flip_map(frame.colour, truth).mean() for frame, truth in zip(sequence, sequence.reference, strict=True)]
    for every, judged in ((1, [1, 2, 3, 4]), (2, [2, 4]), (4, [4])):
        found = judge_sequence(sequence, [], NUMPY, settled=1, flip_every=every)[ONE_SAMPLE].scores["flip"]
        assert found == pytest.approx(np.mean([single[number] for number in judged]), rel=1e-6)


def test_a_sequence_must_have_a_truth_and_settle(tmp_path: Path) -> None:
    with pytest.raises(InputMissing, match=r"no truth to measure against.*render it there yourself"):
        judge_sequence(open_sequence(write_sequence(tmp_path / "a", 3)), [], NUMPY)
    with pytest.raises(
        DataError, match=r"over before it is judged \(expected more than 3 frames, found 3\); .*--settled 0"
    ):
        judge_sequence(open_sequence(write_sequence(tmp_path / "b", 3, reference=True)), [], NUMPY, settled=3)


def test_scenes_in_which_nothing_changes_get_the_better_truth(tmp_path: Path) -> None:
    scenes = {
        "moving": frozenset({"camera", "sky"}),
        "still": frozenset({"sky"}),
        "file:a/b.glb": frozenset({"motion"}),
    }
    cases = planned(scenes, {0: TRAIN, 5: HELD_OUT}, Shape(32, 18, 8, 256, 1024, "r2:64"), tmp_path)
    assert [(c.key, c.split) for c in cases] == [
        ("moving-seed0-32x18x8-r264-256", TRAIN), ("moving-seed5-32x18x8-r264-256", HELD_OUT),
        ("still-seed0-32x18x8-r264-1024", TRAIN), ("still-seed5-32x18x8-r264-1024", HELD_OUT),
        ("b-seed0-32x18x8-r264-256", TRAIN), ("b-seed5-32x18x8-r264-256", HELD_OUT),
    ]  # fmt: skip


def test_means_and_duels() -> None:
    table = summarise([
        (case("a"), {"default": scores(psnr=30.0, flip=0.1, samples=2.0), "simvx": scores(psnr=20.0, flip=0.2)}),
        (case("b"), {"default": scores(psnr=20.0, flip=0.1, samples=8.0), "simvx": scores(psnr=30.0, flip=0.2)}),
        (case("a", HELD_OUT), {"default": scores(psnr=25.0, flip=None), "simvx": scores(psnr=20.0, flip=0.2)}),
    ])  # fmt: skip
    assert list(table.means) == [TRAIN, HELD_OUT]
    means = table.means[TRAIN]["default"]
    assert means["samples"] == pytest.approx(4.0)
    assert means["flip"] == pytest.approx(0.1)
    assert means["psnr"] == pytest.approx(-10 * math.log10((1e-3 + 1e-2) / 2))
    assert table.means[HELD_OUT]["default"]["flip"] is None
    (duel,) = table.duels
    assert (duel.preset, duel.against, duel.better, duel.sequences) == ("default", "simvx", 1, 3)
    assert duel.not_better == ["b (train)", "a (held-out)"]


def test_a_preset_of_ones_own_is_told_what_it_beats() -> None:
    better, worse = scores(psnr=30.0, flip=0.1), scores(psnr=20.0, flip=0.2)
    table = summarise([(case("a"), {ONE_SAMPLE: worse, "t1": better, "mine": better, "karis": worse, "t2": better})])
    assert [(duel.preset, duel.against, duel.better) for duel in table.duels] == [
        ("mine", "karis", 1),
        ("t2", "karis", 1),
    ]
    alone = markdown(summarise([(case("a"), {"karis": worse})]), "about")
    assert "no preset of an article or an engine was judged, or none beside it" in alone


def test_a_psnr_without_end_is_the_best_there_is() -> None:
    """A sequence on which a preset is the truth itself must not lower its mean, nor be lost to what errs there."""
    right = {"default": scores(psnr=None, flip=0.0), "simvx": scores(psnr=60.0, flip=0.2)}
    table = summarise([(case("a"), right), (case("b"), {"default": scores(psnr=30.0), "simvx": scores(psnr=30.0)})])
    assert table.means[TRAIN]["default"]["psnr"] == pytest.approx(-10 * math.log10(1e-3 / 2))
    assert table.duels[0].not_better == ["b (train)"]
    alone = markdown(summarise([(case("a"), right)]), "about")
    assert "| default | **∞** |" in alone
    assert "| simvx | 60.00 |" in alone


def test_a_given_sequence_is_told_as_it_is(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Whatever the options say of what would have been drawn; and nobody knows whether presets were tuned on it."""
    folder = write_sequence(tmp_path / "mine", 3, reference=True)
    (tmp_path / "page.md").write_text(f"{BEGIN}\n{END}", encoding="utf-8")
    arguments = ["bench", "quality", "--sequence", str(folder), "--preset", "t1", "--settled", "1"]
    arguments += ["--work", str(tmp_path / "work"), "--page", str(tmp_path / "page.md"), "--device", "numpy"]
    assert main(arguments) == 0
    assert "means over sequences, given" in capsys.readouterr().out
    text = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert "1 given sequences, 37 × 23, 3 frames, jitter unknown, " in text
    assert "truth of unknown samples a pixel" in text
    assert main([*arguments, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["about"] in text
    assert found["definitions"].keys() == found["rows"][0]["presets"]["t1"]["scores"].keys()


def test_a_file_is_judged_as_a_preset_is(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """In place of cltaa's or beside them, under its own name; a cell of it counts until the file says otherwise."""
    folder, mine = write_sequence(tmp_path / "shot", 3, reference=True), tmp_path / "my own.toml"
    mine.write_text('preset = "karis"\nblend_weight = 0.3\n', encoding="utf-8")
    arguments = ["bench", "quality", "--sequence", str(folder), "--settled", "1", "--work", str(tmp_path / "work")]
    arguments += ["--device", "numpy", "--config", str(mine), "--pictures", str(tmp_path / "pictures")]

    def judged(*more: str) -> Any:
        assert main([*arguments, *more, "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    alone = judged()
    assert [*alone["rows"][0]["presets"]] == [ONE_SAMPLE, mine.name]
    assert alone["about"].endswith("; my own.toml over karis.")
    wanted = override(load_preset("karis"), {"blend_weight": 0.3})
    expected = judge_sequence(open_sequence(folder), [wanted], NUMPY, settled=1)["karis"]
    assert alone["rows"][0]["presets"][mine.name]["scores"] == expected.scores
    page = tmp_path / "page.md"
    page.write_text(f"{BEGIN}\n{END}\n", encoding="utf-8")
    beside = judged("--preset", "karis", "--page", str(page))
    assert beside["rows"][0]["presets"].keys() == {ONE_SAMPLE, "karis", mine.name}
    assert [(duel["preset"], duel["against"]) for duel in beside["duels"]] == [(mine.name, "karis")]
    text = page.read_text(encoding="utf-8")
    assert "![my own.toml](pictures/my%20own.toml.png)" in text
    mine.write_text('preset = "karis"\n', encoding="utf-8")
    scores = judged("--preset", "karis")["rows"][0]["presets"]
    assert scores[mine.name] == scores["karis"]
    (tmp_path / "other").mkdir()
    other = Path(shutil.copy(mine, tmp_path / "other"))
    assert main([*arguments, "--config", str(other)]) == 64
    assert f"{other}: two presets of one name" in capsys.readouterr().err


def test_presets_stand_in_their_families() -> None:
    names = ["t2", "zebra", "default", "karis", "t1-200", "simvx", "t1", "babylon-reproject", ONE_SAMPLE, "fsr3-native"]
    assert ordered(names) == [
        ONE_SAMPLE, "babylon-reproject", "simvx", "fsr3-native", "karis", "t1", "t1-200", "t2", "default", "zebra",
    ]  # fmt: skip
    assert best_engine({"karis": {"flip": 0.2}, "bevy": {"flip": 0.1}, "default": {"flip": 0.01}}) == "bevy"


def test_the_page_needs_its_marks(tmp_path: Path) -> None:
    with pytest.raises(InputMissing, match="no page to put the table into"):
        write_page(tmp_path / "nowhere.md", "text")
    (tmp_path / "page.md").write_text(f"{BEGIN} and no end", encoding="utf-8")
    with pytest.raises(DataError, match="the marks are missing"):
        write_page(tmp_path / "page.md", "text")


def test_a_preset_that_is_the_default_gets_no_picture(tmp_path: Path) -> None:
    """And what earlier runs drew of it, or of a preset that is not asked for, goes; what they did not draw stays."""
    table = summarise([(case("a"), {"default": scores(psnr=30.0), "t3": scores(psnr=30.0)})])
    (tmp_path / "pictures").mkdir()
    for name in ("t3", "karis", "mine"):
        (tmp_path / "pictures" / f"{name}.png").write_bytes(b"of before")
    texts = write_pictures(table, {}, [load_preset("t3")], tmp_path / "pictures", None, NUMPY)
    assert texts == {"t3": "The same as default on every sequence."}
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["mine.png"]


def test_a_model_goes_by_its_file() -> None:
    table = summarise([(case("file:/some/where/Box.glb"), {"default": scores(psnr=30.0)})])
    assert [row.scene for row in table.rows] == ["file:Box.glb"]


def test_the_table_marks_the_best_resolve_and_says_who_lost() -> None:
    table = summarise([
        (case("a"), {ONE_SAMPLE: scores(blur=0.0), "default": scores(blur=-0.1, psnr=30.0), "bevy": scores(blur=0.2)}),
    ])  # fmt: skip
    text = markdown(table, "about", {"bevy": "caption\n\n![bevy](bevy.png)", "t5": "The same."})
    assert "| **-0.100** |" in text
    assert "| 0.000 |" in text
    assert "| default | bevy | 0 of 1 | 1.0000 : 1.0000 | 30.00 : 1.00 | a (train) |" in text
    assert "Best engine's preset by mean FLIP (train): bevy." in text
    shown = "<details><summary><b>bevy.</b> caption</summary>\n\n![bevy](bevy.png)\n\n</details>"
    assert text.endswith(f"{shown}\n\n<b>t5.</b> The same.")


def test_each_scene_has_a_line_that_leads_to_its_table() -> None:
    cells = {"default": scores(flip=0.2, samples=3.0), "t4": scores(flip=0.3), "t5": scores(flip=0.1, samples=9.0)}
    cells |= {"bevy": scores(flip=0.4, samples=2.0), "simvx": scores(flip=0.5, samples=2.5), "mine": scores(flip=0.01)}
    scenes = ("file:/a/Two words.glb", "pan")
    table = summarise([(case(scene, split), cells) for scene in scenes for split in (TRAIN, HELD_OUT)])
    text = markdown(table, "about")
    head = ["flip ↓ best published", "flip ↓ default", "flip ↓ t5", "samples ↑ best published", "samples ↑ default"]
    assert f"| scene | {' | '.join(head)} | samples ↑ t5 |" in text
    values = "0.4000 / 0.4000 | 0.2000 / 0.2000 | **0.1000** / **0.1000** | 2.5 / 2.5 | 3.0 / 3.0 | **9.0** / **9.0**"
    assert f"| [pan](#pan) | {values} |" in text
    assert f"| [file:Two words.glb](#filetwo-wordsglb) | {values} |" in text
    assert "\n\n#### pan\n\n<details><summary>all presets and scores</summary>\n\n| preset |" in text
    alone = markdown(summarise([(case("pan"), {"mine": scores()})]), "about")
    assert "### Each scene\n\n#### pan\n\n" in alone


def test_a_preset_that_is_nowhere_worse_gets_no_picture(tmp_path: Path) -> None:
    cells = [{"default": scores(flip=0.2), "t5": scores(flip=flip)} for flip in (0.1, 0.2)]
    table = summarise([(case(name), cell) for name, cell in zip("ab", cells, strict=True)])
    texts = write_pictures(table, {}, [load_preset("t5")], tmp_path / "pictures", None, NUMPY)
    assert texts == {"t5": "By FLIP worse than default on no sequence."}
