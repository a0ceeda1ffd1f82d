"""Folders of numbered frames: what opens, what is refused and in which words."""

from __future__ import annotations

import json
import shutil
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.errors import CltaaError, DataError, InputMissing, UsageError
from cltaa.frame import Effect
from cltaa.inputs.open import open_input
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_frame, write_image
from cltaa.io.numbered import OnBreak, check_steps, even_step, missing_from
from cltaa.io.sequence import open_images, open_sequence
from cltaa.lab.check.report import check_folder
from tests.sequence_factory import HEIGHT, WIDTH, make_frame, write_frames, write_images, write_sequence


def refusal(folder: Path, error: type[CltaaError]) -> str:
    with pytest.raises(error) as caught:
        open_sequence(folder)
    return str(caught.value)


def test_sequence_in_frame_order(tmp_path: Path) -> None:
    sequence = open_sequence(write_sequence(tmp_path, 12, first=9995))  # 9999 -> 10000: of numbers, not of names
    assert (sequence.name, sequence.first, sequence.last, len(sequence)) == ("synthetic", 9995, 10006, 12)
    assert (sequence.width, sequence.height) == (WIDTH, HEIGHT)
    assert [frame.index for frame in sequence] == list(range(9995, 10007))
    np.testing.assert_array_equal(sequence.frame(10000).colour, make_frame(10000).colour)
    assert sequence.effects == frozenset({Effect.CAMERA})
    assert sequence.outline(10001).jitter_px == (0.25, -0.125)
    assert sequence.attributes["cltaa:frame"] == 9995
    assert sequence.paths[0].name == "synthetic.9995.exr"
    assert sequence.reference is None
    assert sequence.sequence_json == {}


@pytest.mark.parametrize(
    ("pattern", "name"),
    [
        ("{:04d}.exr", ""),  # Blender's own
        ("render{:03d}.exr", "render"),
        ("shot_v02_{:04d}.exr", "shot_v02"),
        ("frame-{}.exr", "frame"),  # 9, 10, 11: no zeros before
        ("Shot 010_v03_bty.{:04d}.exr", "Shot 010_v03_bty"),
        ("a.b_.{:04d}.exr", "a.b_"),
        ("two\nlines.{:04d}.exr", "two\nlines"),
    ],
)
def test_names_of_other_tools(tmp_path: Path, pattern: str, name: str) -> None:
    for number in (9, 10, 11):
        write_image(tmp_path / pattern.format(number), {c: np.full((2, 3), number, np.float32) for c in "RGB"})
    images = open_images(tmp_path)
    assert (images.name, images.numbers) == (name, (9, 10, 11))
    assert [image[0, 0, 0] for image in images] == [9, 10, 11]
    (tmp_path / pattern.format(10)).unlink()
    shown = pattern.format(10).replace("\n", "\\n")
    assert f"/{shown} frame 10: the frame is missing" in refusal(tmp_path, InputMissing)


@pytest.mark.parametrize(
    ("name", "cure"),
    [
        ("shot.0123456789.exr", "numbers have nine digits at most"),
        ("shot.exr", "number the frames, as in shot."),
    ],
)
def test_what_is_no_frame_number(tmp_path: Path, name: str, cure: str) -> None:
    (tmp_path / name).touch()
    assert f"found {name}); {cure}" in refusal(tmp_path, InputMissing)


def test_reference_and_sequence_json(tmp_path: Path) -> None:
    sequence = open_sequence(write_sequence(tmp_path, 3, reference=True))
    (tmp_path / "sequence.json").write_text(json.dumps({"reference": 64}))
    assert sequence.reference is not None
    assert [float(image[0, 0, 0]) for image in sequence.reference] == [np.float32(0.25 + n / 100) for n in range(3)]
    assert sequence.sequence_json == {"reference": 64}


def test_select_returns_a_range_and_refuses_others(tmp_path: Path) -> None:
    sequence = open_sequence(write_sequence(tmp_path, 5)).select(1, 3)
    assert [frame.index for frame in sequence] == [1, 2, 3]
    for first, last in ((0, 2), (2, 9), (3, 2)):
        with pytest.raises(UsageError):
            sequence.select(first, last)


def test_missing_empty_and_wrong_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "folder is missing; check the name" in refusal(tmp_path / "nowhere", InputMissing)
    assert f"that its frames are in: {tmp_path}" in refusal(tmp_path / "a.####.exr", InputMissing)
    assert "no frames" in refusal(tmp_path, InputMissing)
    (tmp_path / "picture.exr").touch()
    assert "no frames" in refusal(tmp_path, InputMissing)
    assert "the file is empty" in refusal(tmp_path / "picture.exr", DataError)

    def refuse(_: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refuse)
    assert "cannot be read: Permission denied" in refusal(tmp_path, InputMissing)


def test_a_folder_above_sequences_names_them(tmp_path: Path) -> None:
    """Also where a single one lies there: its channels are none of the folder's above."""
    write_sequence(tmp_path / "shots" / "b", 2, reference=True)
    for command in (["inspect"], ["check"], ["compare"], ["resolve", "-o", str(tmp_path / "out"), "--device", "numpy"]):
        assert main([*command, str(tmp_path / "shots")]) == 66
    write_sequence(tmp_path / "shots" / "a b", 2, reference=True)
    (tmp_path / "shots" / "more" / "c").mkdir(parents=True)
    (tmp_path / "shots" / "more" / "c" / "sequence.json").write_text("{}")
    write_sequence(tmp_path / "shots" / "more" / "c" / "near" / "far", 1)
    write_sequence(tmp_path / "shots" / "more" / "d" / "near", 1)
    said = refusal(tmp_path / "shots", InputMissing)
    assert (
        f"sequences below it (found a b, b, more/c, more/d/near); name one of them, such as '{tmp_path}/shots/a b'"
        in said
    )
    with pytest.raises(InputMissing, match=r"below it \(found a b, b\)"):
        open_input(tmp_path / "shots")
    with pytest.raises(InputMissing, match=r"name the folder that its frames are in: '.*/a b'"):
        open_input(tmp_path / "shots" / "a b" / "none.####.exr")


def test_two_sequences_and_two_files_of_one_number(tmp_path: Path) -> None:
    write_sequence(tmp_path, 2)
    shutil.copy(tmp_path / "synthetic.0001.exr", tmp_path / "synthetic.1.exr")
    assert "two files have the same frame number" in refusal(tmp_path, DataError)
    (tmp_path / "synthetic.1.exr").unlink()
    write_sequence(tmp_path, 2, name="other")
    refused = refusal(tmp_path, DataError)
    assert "several sequences in one folder (found other, synthetic); name the files of one, such as" in refused
    assert "in Python cltaa.open" in refused


def test_hidden_files_are_no_frames(tmp_path: Path) -> None:
    """Temporary ones of a running writer, and what macOS leaves beside a file on a disk of another system."""
    write_sequence(tmp_path, 2)
    for name in (".synthetic.0002.exr.tmp.1", "._synthetic.0001.exr"):
        (tmp_path / name).touch()
    assert len(open_sequence(tmp_path)) == 2


def test_a_renamed_frame_is_refused(tmp_path: Path) -> None:
    write_sequence(tmp_path, 3)
    (tmp_path / "synthetic.0002.exr").rename(tmp_path / "synthetic.0003.exr")
    (tmp_path / "synthetic.0001.exr").rename(tmp_path / "synthetic.0002.exr")
    (tmp_path / "synthetic.0000.exr").rename(tmp_path / "synthetic.0001.exr")
    with pytest.raises(DataError, match=r"the file name and attribute cltaa:frame disagree \(expected 1, found 0\)"):
        next(iter(open_sequence(tmp_path)))
    for read in (check_folder, partial(open_input, assignments=["jitter.delay=1"])):
        with pytest.raises(
            DataError, match=r"cltaa:frame disagree \(expected 1, found 0\); give the file its own number"
        ):
            read(tmp_path)


def test_frames_of_many_samples_are_reported(tmp_path: Path) -> None:
    """A truth in place of its capture: nothing else says that the samples which a resolve needs are gone."""
    truth = write_images(tmp_path / "reference", [make_frame().colour] * 2, samples=64)
    said = rf"{truth}: these are frames of 64 samples a pixel, as a truth has; name the folder of their single samples"
    with pytest.warns(UserWarning, match=said):
        open_input(truth)
    own = write_sequence(tmp_path / "own", 2)
    for path in own.glob("*.exr"):
        pixels, attributes = read_image(path)
        write_image(path, pixels, attributes | {"cltaa:samples": 4})
    with pytest.warns(UserWarning, match="frames of 4 samples a pixel"):
        open_input(own)


def test_frames_that_declare_other_effects(tmp_path: Path) -> None:
    write_sequence(tmp_path, 2)
    write_frame(tmp_path / "synthetic.0001.exr", make_frame(1, effects=None))
    with pytest.raises(DataError, match=r"other effects .*expected camera, found nothing declared"):
        open_sequence(tmp_path).frame(1)


@pytest.mark.parametrize("part", ["alpha", "motion", "reactive"])
def test_a_channel_that_comes_and_goes_is_reported(part: str, tmp_path: Path) -> None:
    """As where two captures share a folder; each frame is resolved with what it has."""
    folder, has_it = write_sequence(tmp_path, 4), dict[str, Any]({part: True})
    write_frames(folder, (make_frame(number, **has_it) for number in (1, 3)))
    with pytest.warns(UserWarning, match=f"{folder}: no {part} in frames 0, 2, unlike the others: each frame is"):
        assert part in open_sequence(folder).holds
    assert part in open_sequence(folder, frames=(3, 3)).holds


def test_a_reference_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    write_sequence(tmp_path, 3, reference=True)
    (tmp_path / "reference" / "synthetic.0002.exr").unlink()
    with pytest.raises(InputMissing, match=r"reference.synthetic\.0002\.exr frame 2"):
        _ = open_sequence(tmp_path).reference
    small = [np.ones((HEIGHT, WIDTH - 1, 3), np.float32)] * 3
    write_images(tmp_path / "reference", small, name="synthetic")
    with pytest.raises(DataError, match="size differs"):
        _ = open_sequence(tmp_path).reference


def test_an_image_without_colour_is_refused(tmp_path: Path) -> None:
    write_image(tmp_path / "depth.0000.exr", {"Z": np.ones((4, 4), np.float32)})
    with pytest.raises(DataError, match="channel R: channel is missing"):
        open_images(tmp_path)


def test_what_to_do_at_a_break_may_be_said_by_name(tmp_path: Path) -> None:
    """A word is no member of the enumeration, and was taken for a reset."""
    folder = write_sequence(tmp_path / "a", 4)
    (folder / "synthetic.0002.exr").unlink()
    assert open_sequence(folder, gaps="reset").numbers == (0, 1, 3)  # type: ignore[arg-type]
    with pytest.raises(InputMissing, match="the frame is missing"):
        open_sequence(folder, gaps="error")  # type: ignore[arg-type]
    for option in ("gaps", "on_resize"):
        with pytest.raises(
            UsageError, match=r"unknown way to continue after a break .*expected error, reset, found skip"
        ):
            open_sequence(folder, **{option: "skip"})  # type: ignore[arg-type]


def test_an_even_step_is_that_of_most() -> None:
    for numbers, apart in [
        ([0, 7, 14, 21], 7),
        ([3, 5, 7, 11, 13], 2),  # one is missing
        ([0, 2, 4, 8, 12], 1),  # as many lie twice as far apart
        ([3, 10], 1),  # two say nothing
        ([5], 1),
        ([0, 2, 5, 7], 1),
    ]:
        assert even_step(numbers) == apart, numbers


def test_numbers_that_are_missing() -> None:
    assert missing_from([2, 4, 10], 2) == [6, 8]
    assert missing_from([2, 3], 1) == []


def test_frames_outside_of_a_range_may_lie_between_its_steps() -> None:
    check_steps({number: Path(f"a.{number}.exr") for number in (0, 1, 3, 5, 8)}, (1, 5), 2, OnBreak.ERROR)
