"""``cltaa bench quality`` at a small size: cells, resuming, and what reaches the pages."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from PIL import Image as Pillow

from cltaa.cli import main
from cltaa.core.build import Storage
from cltaa.core.presets import Preset, Published, load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.errors import DataError, InputMissing
from cltaa.frame import Frame
from cltaa.inputs.open import Reading
from cltaa.io.display import to_picture
from cltaa.io.exr_write import write_frame, write_image
from cltaa.io.sequence import FrameSequence, open_sequence
from cltaa.lab.bench.accuracy.measurement import drawing_seconds
from cltaa.lab.bench.cases import HELD_OUT, REDRAWN, TRAIN, Case, Shape, capture, planned
from cltaa.lab.bench.cells import ONE_SAMPLE, QUALITY, Judged, Judging, in_step, judge_sequence, task_of
from cltaa.lab.bench.quality.table import BEGIN, END, about_of, summarise
from cltaa.lab.bench.variants import Variant
from cltaa.lab.judge.metrics import flip_map
from cltaa.lab.judge.video_scores import Sums, VideoScores
from cltaa.reference.launcher import NumpyLauncher
from tests.sequence_factory import make_frame, read_frame, write_images, write_sequence

NUMPY = NumpyLauncher()
SOON = msgspec.structs.replace(QUALITY, settled=1)
SMALL = "--scene occluder --size 64x36 --frames 4 --samples 4 --settled 1 --held-out , --preset default --jitter r2:5"


def test_presets_that_look_ahead_are_judged_on_the_frame_that_they_resolved() -> None:
    ahead = override(load_preset("gather-8+8"), {"history_frames": 2, "look_ahead": 2})
    frames = [make_frame(number) for number in range(5)]
    resolvers = [Resolver(preset, NUMPY) for preset in (load_preset(), ahead)]
    items, images = zip(*in_step(resolvers, frames, lambda frame: frame), strict=True)
    assert list(items) == frames
    for resolver, own in zip(resolvers, zip(*images, strict=True), strict=True):
        resolver.reset()
        for image, expected in zip(own, resolver.images(frames), strict=True):
            assert np.array_equal(image, expected)


def test_a_run_captures_judges_and_goes_on(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n", encoding="utf-8")
    arguments = ["bench", "quality", *SMALL.split(), "--device", "numpy", "--work", str(tmp_path / "work")]
    arguments += ["--page", str(page)]
    assert main([*arguments, "--pictures", str(tmp_path / "pictures"), "--json"]) == 0
    out, told = capsys.readouterr()
    (row,) = json.loads(out)["rows"]
    assert f"judging {row['key']}: 4 of 4 frames, " in told
    assert "showing failures: 1 of 1 presets, " in told
    assert (row["scene"], row["split"]) == ("occluder", TRAIN)
    folder = tmp_path / "work" / "sequences" / row["key"]
    assert open_sequence(folder).sequence_json["settings"]["jitter"] == "r2:5"
    sequence = Reading(effects="find").open(folder)
    expected = judged(sequence, load_preset())
    for name in (ONE_SAMPLE, "default"):
        assert row["presets"][name]["scores"] == expected[name].scores
    assert row["presets"]["default"]["scores"]["psnr"] > row["presets"][ONE_SAMPLE]["scores"]["psnr"]
    text, beside = (path.read_text(encoding="utf-8") for path in (page, tmp_path / "page-scenes.md"))
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    for each in (text, beside):
        assert "jitter r2:5" in each
        assert f"| default | **{row['presets']['default']['scores']['psnr']:.2f}** |" in each
    assert "![default](pictures/default.png)" in beside
    with Pillow.open(tmp_path / "pictures" / "default.png") as picture:
        assert len(np.unique(np.asarray(picture))) > 10

    def again(*_arguments: Any, **_named: Any) -> Any:
        raise AssertionError("a finished cell was measured again")

    monkeypatch.setattr("cltaa.lab.bench.cells.judge_sequence", again)
    monkeypatch.setattr("cltaa.commands.bench_quality.capture", again)
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "means over sequences, train" in printed
    assert f"{row['presets']['default']['scores']['flip']:.4f}" in printed


def judged(sequence: FrameSequence, *presets: Preset) -> dict[str, Judged]:
    found = judge_sequence(sequence, [Variant.of(preset) for preset in presets], NUMPY, SOON)
    return {name: cell.judged for name, cell in found.items()}


def test_a_cell_counts_until_what_decides_it_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sequence = open_sequence(write_sequence(tmp_path / "capture", 3, reference=True))
    other = open_sequence(write_sequence(tmp_path / "other", 3, reference=True, seed=1))
    preset = load_preset()
    theirs = msgspec.structs.replace(preset, published=Published.ENGINE)  # the plan leaves nothing out of it

    def path(
        sequence: FrameSequence = sequence, preset: Preset = preset, judging: Judging = SOON, **build: Any
    ) -> Path:
        variant = msgspec.structs.replace(Variant.of(preset), **build)
        return task_of(sequence, [variant], None, judging).path(tmp_path, variant)

    assert path() == path(name="another", group="of another")
    changed: list[dict[str, Any]] = [{"settled": 2}, {"flip_every": 2}, {"metrics": ("flip",)}]
    paths = [path(judging=msgspec.structs.replace(SOON, **each)) for each in changed]
    paths += [path(), path(other), path(preset=override(preset, {"sample_limit": 3.0})), path(preset=theirs)]
    paths += [path(strict=True), path(storage=Storage.HALF)]
    write_images(sequence.folder / REDRAWN, [make_frame(number).colour for number in range(3)], name="synthetic")
    paths.append(path())
    monkeypatch.setattr("cltaa.lab.bench.cells.code_sha256", lambda: "another version")
    paths.append(path())
    monkeypatch.setattr("cltaa.lab.bench.cells._versions", lambda _: {"scikit-image": "another"})
    assert len({*paths, path()}) == 12


def test_what_is_not_finite_counts_and_is_judged_as_black(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sequence = open_sequence(write_sequence(tmp_path / "capture", 3, reference=True))
    monkeypatch.setattr(
        "cltaa.core.resolver.Resolver.resolve",
        lambda _self, frame, **_: np.where(frame.colour > 2, np.nan, frame.colour),
    )
    found = judged(sequence, load_preset())
    bad = sum(int((frame.colour > 2).sum()) for frame in sequence)
    assert (found["default"].not_finite, found[ONE_SAMPLE].not_finite) == (bad, 0)
    assert math.isfinite(found["default"].scores["psnr"] or math.nan)


def test_a_truth_that_is_no_light_is_refused_where_scores_look_at_it(tmp_path: Path) -> None:
    """In time also before the first frame that is judged; of other frames nothing is read that decides a score."""
    folder = write_sequence(tmp_path / "capture", 3, reference=True)
    write_images(folder / "reference", [np.full((23, 37, 3), np.nan, np.float32)], name="synthetic")
    with pytest.raises(DataError, match=r"reference/synthetic\.0000\.exr frame 0: NaN or infinity in 2553 values"):
        judged(open_sequence(folder), load_preset())
    errors = msgspec.structs.replace(SOON, in_time=False)
    (cell,) = judge_sequence(open_sequence(folder), [Variant.of(load_preset())], NUMPY, errors).values()
    assert all(map(math.isfinite, cell.errors["mse"]))


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
        def add(self, frame: Frame, *given: Any, **named: Any) -> list[Sums]:
            sums = super().add(frame, *given, **named)
            self.fresh = np.ones(frame.depth.shape, np.bool_)
            return sums

    monkeypatch.setattr("cltaa.lab.bench.cells.VideoScores", AllAppears)
    monkeypatch.setattr("cltaa.lab.bench.cells.LEAST_FRESH", least)
    monkeypatch.setattr("cltaa.core.resolver.Resolver.resolve", lambda _self, frame, **_: elsewhere[frame.index])
    found = judged(open_sequence(folder), load_preset())["default"].scores["disoccluded"]
    assert found == (pytest.approx(1.0) if again and least == 1 else None)


def test_flip_judges_every_so_many_frames(tmp_path: Path) -> None:
    sequence = open_sequence(write_sequence(tmp_path / "capture", 5, reference=True))
    assert sequence.reference is not None
    single = [flip_map(frame.colour, truth).mean() for frame, truth in zip(sequence, sequence.reference, strict=True)]
    for every, seen in ((1, [1, 2, 3, 4]), (2, [2, 4]), (4, [4])):
        judging = msgspec.structs.replace(SOON, flip_every=every)
        found = judge_sequence(sequence, [], NUMPY, judging)[ONE_SAMPLE].judged.scores["flip"]
        assert found == pytest.approx(np.mean([single[number] for number in seen]), rel=1e-6)


def test_the_pictures_of_a_cell_are_those_of_the_last_frame(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sequence, preset = open_sequence(write_sequence(tmp_path / "capture", 3, reference=True)), load_preset("basic")
    judging = msgspec.structs.replace(SOON, pictures=True)
    pictures = judge_sequence(sequence, [Variant.of(preset)], NUMPY, judging)["basic"].pictures
    *_, last = Resolver(preset, NUMPY).images(sequence)
    with Pillow.open(BytesIO(pictures["picture"])) as picture:
        assert np.array_equal(np.asarray(picture), to_picture(last))
    assert capsys.readouterr().err == ""  # no progress, for which nobody asked


def test_scenes_in_which_nothing_changes_get_the_better_truth(tmp_path: Path) -> None:
    scenes = {
        "moving": frozenset({"camera", "sky"}),
        "still": frozenset({"sky"}),
        "file:a/b.glb": frozenset({"motion"}),
    }
    cases = planned(scenes, {0: TRAIN, 5: HELD_OUT}, Shape(32, 18, 8, 256, "r2:64"), tmp_path)
    assert [(c.key, c.split) for c in cases] == [
        ("moving-seed0-32x18x8-r264-256", TRAIN),
        ("moving-seed5-32x18x8-r264-256", HELD_OUT),
        ("still-seed0-32x18x8-r264-1024", TRAIN),
        ("still-seed5-32x18x8-r264-1024", HELD_OUT),
        ("b.glb-seed0-32x18x8-r264-256", TRAIN),
        ("b.glb-seed5-32x18x8-r264-256", HELD_OUT),
    ]


def test_whether_frames_are_of_a_model_is_left_to_its_capture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file may have changed under its name; a scene of that name is another, as is a model of another suffix."""
    drawn: list[Path] = []

    def draw(case: Case, _: Shape) -> FrameSequence:
        drawn.append(write_sequence(case.folder, 3, reference=True))
        return open_sequence(case.folder)

    monkeypatch.setattr("cltaa.commands.bench_quality.open_case", lambda _: pytest.fail("nobody looked at the model"))
    monkeypatch.setattr("cltaa.commands.bench_quality.capture", draw)
    arguments = ["bench", "quality", "--frames", "3", "--settled", "1", "--held-out", ",", "--preset", "accumulate"]
    arguments += ["--device", "numpy", "--work", str(tmp_path)]
    assert main([*arguments, "--scene", "file:a/pan.obj", "--scene", "file:pan.glb"]) == 0
    assert [folder.name.partition("-")[0] for folder in drawn] == ["pan.obj", "pan.glb"]


@pytest.mark.parametrize(("jitter", "again"), [("halton:64", "r2:64"), ("r2:64", "halton:64")])
def test_a_case_is_drawn_again_at_other_places(jitter: str, again: str, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[list[str]] = []
    monkeypatch.setattr("cltaa.lab.bench.cases.run_cltaa", drawn.append)
    with pytest.raises(InputMissing, match="nowhere: the capture left no finished sequence"):
        capture(Case("spinner", TRAIN, Path("nowhere"), samples=16), Shape(32, 18, 8, 16, jitter))
    assert [line[line.index("--jitter") + 1] for line in drawn] == [jitter, again]
    assert [line[line.index("--reference") + 1] for line in drawn] == ["16", "0"]


def test_a_capture_that_fails_is_told_once(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    arguments = ["bench", "quality", "--scene", "still", "--jitter", "nope", "--work", str(tmp_path), "--json"]
    assert main(arguments) == 64
    said = capfd.readouterr()
    assert said.err.count("error: ") == 1
    assert "no such jitter: nope" in said.err
    assert "--jitter nope" in json.loads(said.out)["error"]


def test_a_given_sequence_is_described_from_its_files(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Whatever the options say of what would have been drawn; and nobody knows whether presets were tuned on it."""
    folder = write_sequence(tmp_path / "mine", 3, reference=True)
    (tmp_path / "page.md").write_text(f"{BEGIN}\n{END}", encoding="utf-8")
    arguments = ["bench", "quality", "--sequence", str(folder), "--preset", "basic", "--settled", "1"]
    arguments += ["--work", str(tmp_path / "work"), "--page", str(tmp_path / "page.md"), "--device", "numpy"]
    assert main(arguments) == 0
    assert "means over sequences, given" in capsys.readouterr().out
    text = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert "1 given sequence, 37 × 23, 3 frames, read by profile cltaa, jitter unknown, " in text
    assert "truth of unknown samples a pixel" in text
    assert main([*arguments, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["about"] in text
    assert found["versions"].keys() == {"cltaa", "numpy", "scikit-image", "flip-evaluator"}
    assert found["definitions"].keys() == found["rows"][0]["presets"]["basic"]["scores"].keys()


@pytest.mark.parametrize(
    "record", ['{"settings": [1], "seconds_a_frame": [2]}', '{"settings": {}, "seconds_a_frame": {"1": "x", "4": NaN}}']
)
def test_a_record_that_another_tool_left_there_states_nothing(tmp_path: Path, record: str) -> None:
    folder = write_sequence(tmp_path / "mine", 2, reference=True)
    (folder / "sequence.json").write_text(record)
    sequence = open_sequence(folder)
    assert "jitter unknown, " in about_of(summarise([]), [sequence], 0, [])
    assert drawing_seconds(sequence) == {}


def test_what_the_pictures_show_is_printed_and_of_which_there_is_none(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    folder, pictures = write_sequence(tmp_path / "shot", 3, reference=True), tmp_path / "pictures"
    asked = ["--preset", "default", "--preset", "accumulate", "--config", str(tmp_path / "same.toml")]
    (tmp_path / "same.toml").write_text("")
    arguments = ["bench", "quality", "--sequence", str(folder), "--settled", "1", "--work", str(tmp_path / "work")]
    assert main([*arguments, *asked, "--device", "numpy", "--pictures", str(pictures)]) == 0
    *_, title, default, quick, same = capsys.readouterr().out.splitlines()
    assert title == f"the worst place of each preset is shown in {pictures}"
    assert default.startswith("  default: shot (given), frame ")
    assert quick.startswith("  accumulate: shot (given), frame ")
    assert same == "  same.toml: no picture: The same as default on every sequence."
    assert sorted(path.name for path in pictures.iterdir()) == ["accumulate.png", "default.png"]


def test_a_file_is_judged_as_a_preset_is(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """In place of cltaa's or beside them, under its own name; a cell of it counts until the file says otherwise."""
    folder, mine = write_sequence(tmp_path / "shot", 3, reference=True), tmp_path / "my own.toml"
    mine.write_text('preset = "karis"\nblend_weight = 0.3\n', encoding="utf-8")
    arguments = ["bench", "quality", "--sequence", str(folder), "--settled", "1", "--work", str(tmp_path / "work")]
    arguments += ["--device", "numpy", "--config", str(mine), "--pictures", str(tmp_path / "pictures")]

    def asked(*more: str) -> Any:
        assert main([*arguments, *more, "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    alone = asked()
    assert [*alone["rows"][0]["presets"]] == [ONE_SAMPLE, mine.name]
    assert alone["about"].endswith("; my own.toml over karis.")
    wanted = override(load_preset("karis"), {"blend_weight": 0.3})
    expected = judged(open_sequence(folder), wanted)["karis"]
    assert alone["rows"][0]["presets"][mine.name]["scores"] == expected.scores
    page = tmp_path / "page.md"
    page.write_text(f"{BEGIN}\n{END}\n", encoding="utf-8")
    beside = asked("--preset", "karis", "--page", str(page))
    assert beside["rows"][0]["presets"].keys() == {ONE_SAMPLE, "karis", mine.name}
    assert [(duel["preset"], duel["against"]) for duel in beside["duels"]] == [(mine.name, "karis")]
    assert f"| flip ↓ {mine.name} |" in page.read_text(encoding="utf-8")
    assert "![my own.toml](pictures/my%20own.toml.png)" in (tmp_path / "page-scenes.md").read_text(encoding="utf-8")
    mine.write_text('preset = "karis"\n', encoding="utf-8")
    scores = asked("--preset", "karis")["rows"][0]["presets"]
    assert scores[mine.name] == scores["karis"]
    (tmp_path / "other").mkdir()
    other = Path(shutil.copy(mine, tmp_path / "other"))
    assert main([*arguments, "--config", str(other)]) == 64
    assert f"{other}: two presets of one name" in capsys.readouterr().err


def test_alpha_is_judged_where_both_sides_have_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Frames of alpha 0.25 and 0.75 in turn, of a truth of 0.5: one sample errs by 0.25."""
    (tmp_path / "in" / "reference").mkdir(parents=True)
    for number in range(4):
        frame, name = make_frame(number), f"synthetic.{number:04d}.exr"
        alpha = np.full(frame.depth.shape, 0.25 + 0.5 * (number % 2), np.float32)
        write_frame(tmp_path / "in" / name, replace(frame, alpha=alpha))
        truth = dict(zip("RGB", np.moveaxis(frame.colour, 2, 0), strict=True)) | {"A": np.full_like(alpha, 0.5)}
        write_image(tmp_path / "in" / "reference" / name, truth)
    asked = ["--sequence", str(tmp_path / "in"), "--preset", "accumulate", "--settled", "1", "--device", "numpy"]
    assert main(["bench", "quality", *asked, "--work", str(tmp_path / "work"), "--json"]) == 0
    (means,) = json.loads(capsys.readouterr().out)["means"].values()
    assert means[ONE_SAMPLE]["alpha"] == pytest.approx(0.25)
    assert means["accumulate"]["alpha"] < 0.25
