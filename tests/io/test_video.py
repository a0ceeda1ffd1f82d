"""Films: every frame is there, at its size and in its colours, and a failure leaves nothing behind."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from cltaa.cli import main
from cltaa.errors import DataError, OutputError
from cltaa.frame import Image
from cltaa.io.display import GAP, to_picture
from cltaa.io.exr_write import write_frame, write_image
from cltaa.io.video import rate_of, write_pairs, write_video
from tests.sequence_factory import make_frame, write_frames, write_sequence

# 8-bit limited-range YCbCr has 219 steps of luma and 224 of chroma for 255 of RGB, so a flat colour is off by about
# one step of each (255/219 * 0.5 + 1.57 * 255/224 * 0.5 = 1.5); the encoder adds as much again (3 was observed).
COLOUR_TOLERANCE = 4


def flat(colour: tuple[float, float, float], width: int = 64, height: int = 48) -> Image:
    return np.broadcast_to(np.array(colour, np.float32), (height, width, 3)).copy()


def frames_of(path: Path) -> tuple[list[Any], Any]:
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        facts = (stream.width, stream.height, stream.average_rate, stream.codec_context.pix_fmt)
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)], facts


def test_every_frame_in_order_and_in_its_colour(tmp_path: Path) -> None:
    colours = [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.8, 0.1, 0.05), (0.05, 0.6, 0.1), (0.1, 0.1, 0.9), (0.2, 0.2, 0.2)]
    write_video(tmp_path / "a.mp4", (flat(colour) for colour in colours), rate=Fraction(30000, 1001))
    frames, facts = frames_of(tmp_path / "a.mp4")
    assert facts == (64, 48, Fraction(30000, 1001), "yuv420p")
    assert len(frames) == 6
    for frame, colour in zip(frames, colours, strict=True):
        difference = np.abs(frame.astype(int) - to_picture(flat(colour)))
        assert difference.max() <= COLOUR_TOLERANCE


@pytest.mark.parametrize("size", [(65, 48), (64, 47), (33, 17), (2, 2), (1, 1)])
def test_odd_sides_are_made_even(tmp_path: Path, size: tuple[int, int]) -> None:
    write_video(tmp_path / "a.mp4", [flat((0.2, 0.2, 0.2), *size)] * 2)
    frames, facts = frames_of(tmp_path / "a.mp4")
    assert facts[:2] == tuple(side + side % 2 for side in size)
    grey = to_picture(flat((0.2, 0.2, 0.2), 1, 1))
    assert np.abs(frames[1].astype(int) - grey).max() <= COLOUR_TOLERANCE  # the added row and column too


def test_index_lies_before_the_frames(tmp_path: Path) -> None:
    write_video(tmp_path / "a.mp4", [flat((0.5, 0.5, 0.5))] * 3)
    content = (tmp_path / "a.mp4").read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")


def test_a_wipe_goes_over_the_picture_and_back(tmp_path: Path) -> None:
    """At 2 frames a second the line is at the left end, in the middle, at the right end, and in the middle again."""
    write_pairs(tmp_path / "a.mp4", [flat((1, 0, 0))] * 8, [flat((0, 0, 1))] * 8, labels=("", ""), rate=2, swept=True)
    pictures, _ = frames_of(tmp_path / "a.mp4")
    reds = [int((picture[-8, :, 0] > 128).sum()) for picture in pictures]
    assert [abs(red - white) <= 4 for red, white in zip(reds, (0, 9, 32, 55, 64, 55, 32, 9), strict=True)] == [True] * 8


def test_side_by_side_each_image_fills_its_half(tmp_path: Path) -> None:
    before, after = [flat((0.05, 0.05, 0.05))] * 4, [flat((0.6, 0.6, 0.6))] * 4
    write_pairs(tmp_path / "a.mp4", before, after, labels=("one sample", "resolved"))
    frames, facts = frames_of(tmp_path / "a.mp4")
    assert len(frames) == 4
    assert facts[:2] == (2 * 64 + GAP, 48)
    lower = frames[0][40:].astype(int)
    assert np.abs(lower[:, :56] - to_picture(before[0])[0, 0]).max() <= COLOUR_TOLERANCE  # away from the white gap,
    assert np.abs(lower[:, -56:] - to_picture(after[0])[0, 0]).max() <= COLOUR_TOLERANCE  # which blurs a block


def test_failures_leave_nothing_behind(tmp_path: Path) -> None:
    def broken() -> Iterator[Image]:
        yield flat((0.1, 0.1, 0.1))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_video(tmp_path / "a.mp4", broken())
    with pytest.raises(DataError, match="no frames to film"):
        write_video(tmp_path / "a.mp4", [])
    with pytest.raises(DataError, match="frame 1: picture size differs"):
        write_video(tmp_path / "a.mp4", [flat((0, 0, 0)), flat((0, 0, 0), 32)])
    with pytest.raises(ValueError, match="shorter"):
        write_pairs(tmp_path / "a.mp4", [flat((0, 0, 0))] * 2, [flat((0, 0, 0))])
    with pytest.raises(OutputError):
        write_video(tmp_path / "nowhere" / "a.mp4", [flat((0, 0, 0))])
    assert list(tmp_path.iterdir()) == []


def resident_kilobytes() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() // 1024


def test_memory_does_not_grow_with_the_frames(tmp_path: Path) -> None:
    """The encoder looks some 50 frames ahead; 200 more of 0.3 MB each would be 60 MB if they were kept."""
    resident: dict[int, int] = {}

    def frames(count: int) -> Iterator[Image]:
        for number in range(count):
            resident[number] = resident_kilobytes()
            yield flat((0.3, 0.3, number / count), 352, 288)

    write_video(tmp_path / "a.mp4", frames(280))
    assert resident[279] - resident[79] < 15_000


def test_the_rate_is_that_of_the_files_or_the_capture() -> None:
    cases: list[tuple[dict[str, object], dict[str, Any], Fraction | int]] = [
        ({}, {}, 24),
        ({}, {"settings": {"fps": 30.0}}, 30),
        ({"framesPerSecond": Fraction(30000, 1001)}, {"settings": {"fps": 12.0}}, Fraction(30000, 1001)),
        ({}, {"settings": {"fps": 29.97}}, Fraction(2997, 100)),
        ({}, {"settings": {"fps": 1e9}}, 24),
        ({}, {"settings": {"fps": "fast"}}, 24),
        ({}, {"settings": []}, 24),
        ({"framesPerSecond": float("nan")}, {}, 24),
        ({"framesPerSecond": None}, {}, 24),
    ]
    for attributes, record, rate in cases:
        assert rate_of(attributes, record) == rate, (attributes, record)
        assert rate_of(attributes, record, step=7) == Fraction(rate) / 7, (attributes, record)
        assert rate_of(attributes, record, step=1000) == 1, (attributes, record)


def test_the_film_of_a_resolve_is_as_fast_as_its_capture(tmp_path: Path) -> None:
    folder, film = write_sequence(tmp_path / "in", 3), tmp_path / "film.mp4"
    (folder / "sequence.json").write_text('{"settings": {"fps": 30.0}}')
    command = ["resolve", str(folder), "-o", str(tmp_path / "out"), "--device", "numpy", "--preview", str(film)]
    assert main(command) == 0
    assert frames_of(film)[1][2] == 30
    for number in (2, 1):  # 0, 7 and 14: things move as fast
        (folder / f"synthetic.000{number}.exr").unlink()
        write_frame(folder / f"synthetic.{7 * number:04d}.exr", make_frame(7 * number))
    assert main([*command, "--step", "7", "--restart"]) == 0
    assert frames_of(film)[1][2] == Fraction(30, 7)


def test_a_film_of_several_sizes_is_reported_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_frames(tmp_path, (make_frame(number, width=16 + number) for number in range(2)))
    command = ["resolve", str(tmp_path), "-o", str(tmp_path / "out"), "--device", "numpy", "--on-resize", "reset"]
    assert main([*command, "--preview", str(tmp_path / "film.mp4")]) == 64
    assert "film.mp4: a film of frames of several sizes; leave --preview out" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_film_that_is_too_large_is_reported_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_image(tmp_path / "x.0001.exr", dict.fromkeys("RGB", np.zeros((1, 8192), np.float32)))
    command = ["resolve", str(tmp_path / "x.0001.exr"), "-o", str(tmp_path / "out"), "--device", "numpy"]
    film = ["--preview", str(tmp_path / "film.mp4"), "--compare"]
    assert main([*command, *film, "side"]) == 64
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("cltaa: error")]
    assert line.endswith("(expected at most 16384 pixels a side, found 16386 x 1); take --compare wipe")
    assert not (tmp_path / "out").exists()
    assert main([*command, *film, "wipe"]) == 0
