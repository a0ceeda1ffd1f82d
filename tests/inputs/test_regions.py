"""Files whose data window is a region of the display window, or more than it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cltaa.camera import displacement
from cltaa.cli import main
from cltaa.core.presets import load_preset
from cltaa.core.resolver import Resolver
from cltaa.errors import DataError
from cltaa.frame import Frame
from cltaa.inputs.convert import ray_length
from cltaa.inputs.open import Reading, open_input
from cltaa.io.exr_frame import frame_attributes, frame_planes
from cltaa.io.exr_layout import Window
from cltaa.io.exr_read import read_header, read_image
from cltaa.io.exr_write import write_image
from cltaa.io.numbered import OnBreak
from cltaa.lab.judge.comparison import open_yardsticks, truth_of
from cltaa.pipeline.run import resolve_sequence
from tests.inputs.foreign import side_text, write_parts
from tests.sequence_factory import make_camera, make_frame, read_frame, write_images

WIDTH, HEIGHT = 48, 36
LEFT, TOP, COLUMNS, ROWS = 9, 5, 30, 24
WHOLE = (0, 0, WIDTH - 1, HEIGHT - 1)
REGION = (LEFT, TOP, LEFT + COLUMNS - 1, TOP + ROWS - 1)
PART = slice(TOP, TOP + ROWS), slice(LEFT, LEFT + COLUMNS)  # of the whole, the region
MARGIN = 5  # pixels from the edge of a region that its outside reaches: half a pixel of travel a frame, and filters


def moving(index: int) -> Frame:
    """A wall that the camera slides along, zooming and rolling a little, so that all of the matrices count."""
    camera = make_camera((0.05 * index, 0.02 * index, 5.0), WIDTH / HEIGHT)
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(0.005 * index), -np.sin(0.005 * index)], [np.sin(0.005 * index), np.cos(0.005 * index)]]
    camera = replace(camera, world_to_view=turn @ camera.world_to_view)
    camera.view_to_clip[:2] *= 1.0 + 0.004 * index
    jitter_px = (0.2, -0.3) if index % 2 else (-0.2, 0.3)
    frame = make_frame(index, width=WIDTH, height=HEIGHT, camera=camera, jitter_px=jitter_px, effects=None)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    colour = np.stack([np.sin(x / 5.0 + index / 8), np.cos(y / 4.0), np.sin((x + y) / 7.0)], -1) * 0.4 + 0.5
    depth = 5.0 + x / 40.0
    return replace(frame, colour=colour.astype(np.float32), depth=depth.astype(np.float32))


def write_region(folder: Path, data: tuple[int, int, int, int], display: tuple[int, int, int, int] = WHOLE) -> Path:
    """Four frames, drawn whole, of which the files hold the pixels of ``data``, in the coordinates of ``WHOLE``."""
    folder.mkdir()
    for index in range(4):
        frame, path = moving(index), folder / f"a.{index:04d}.exr"
        part = slice(data[1], data[3] + 1), slice(data[0], data[2] + 1)
        channels = {name: plane[part] for name, plane in frame_planes(frame, path).items()}
        write_image(path, channels, frame_attributes(frame), windows=(data, display))
    return folder


def resolved(folder: Path, output: Path) -> np.ndarray:
    """The last resolved colour, [H, W, 3]."""
    resolve_sequence(open_input(folder), output, Resolver(load_preset("default"), "numpy"))
    return colour_of(sorted(output.glob("*.exr"))[-1])


def colour_of(path: Path) -> np.ndarray:
    planes, _ = read_image(path)
    return np.stack([planes[name] for name in "RGB"], -1)


def test_region_resolves_to_the_region_of_the_whole(tmp_path: Path) -> None:
    whole = resolved(write_region(tmp_path / "whole", WHOLE), tmp_path / "whole-out")
    part = resolved(write_region(tmp_path / "part", REGION), tmp_path / "part-out")
    assert part.shape == (ROWS, COLUMNS, 3)
    inner = slice(MARGIN, ROWS - MARGIN), slice(MARGIN, COLUMNS - MARGIN)
    there = whole[PART]
    # Positions are rounded to float32 from another centre. Seen: 5.2e-6, and 1.8e-7 from 7 pixels inside on.
    np.testing.assert_allclose(part[inner], there[inner], atol=2e-5)
    frame = moving(3)
    assert np.abs(there - frame.colour[PART]).max() > 0.01  # it did something


def test_camera_of_a_region_moves_as_that_of_the_whole(tmp_path: Path) -> None:
    folder = write_region(tmp_path / "part", REGION)
    camera, before = (read_frame(folder / f"a.{index:04d}.exr").camera for index in (3, 2))
    small = displacement(camera, before, COLUMNS, ROWS).rows
    whole = displacement(moving(3).camera, moving(2).camera, WIDTH, HEIGHT).rows
    for x, y, near in ((10.25, 8.5, 0.2), (30.0, 20.0, 0.0), (38.9, 28.9, 1.0)):

        def moved(rows: np.ndarray, px: float, py: float, inverse_depth: float = near) -> np.ndarray:
            p = np.array([px, py, inverse_depth, 1.0])
            return np.asarray((p[:2] + rows[:2] @ p) / (1 + rows[2] @ p) - p[:2])

        expected = moved(whole, x - WIDTH / 2, y - HEIGHT / 2)
        found = moved(small, x - LEFT - COLUMNS / 2, y - TOP - ROWS / 2)
        np.testing.assert_allclose(found, expected, atol=1e-10)
        assert np.abs(expected).max() > 0.02


@pytest.mark.parametrize("display", [WHOLE, (4, 2, 40, 30), (-5, -5, 60, 50)])
def test_windows_and_matrices_of_the_files_stay(display: tuple[int, int, int, int], tmp_path: Path) -> None:
    folder = write_region(tmp_path / "in", REGION, display)
    resolved(folder, tmp_path / "out")
    for path in sorted(folder.iterdir()):
        before, after = read_header(path), read_header(tmp_path / "out" / path.name)
        assert (after.layout.data_window, after.layout.display_window) == (REGION, display)
        for name in ("worldToNDC", "cltaa:viewToClip", "cltaa:worldToView", "worldToCamera"):
            np.testing.assert_array_equal(after.attributes[name], before.attributes[name])


def test_overscan_resolves_as_a_display_window_of_its_size(tmp_path: Path) -> None:
    """The same pixels, once as all of a display window, and once around a smaller one that the matrices speak of."""
    left, top = 6, 4
    inner, (columns, rows) = (left, top, WIDTH - 7, HEIGHT - 5), (WIDTH - 12, HEIGHT - 8)
    smaller = np.diag([WIDTH / columns, HEIGHT / rows, 1.0, 1.0])
    smaller[:2, 3] = (WIDTH - 2 * left) / columns - 1, 1 - (HEIGHT - 2 * top) / rows
    whole, over = write_region(tmp_path / "whole", WHOLE), tmp_path / "over"
    over.mkdir()
    for index, path in enumerate(sorted(whole.iterdir())):
        frame = moving(index)
        camera = replace(frame.camera, view_to_clip=smaller @ frame.camera.view_to_clip)
        attributes = frame_attributes(replace(frame, camera=camera))
        write_image(over / path.name, frame_planes(frame, path), attributes, windows=(WHOLE, inner))
    # Matrices are multiplied there and back in double precision, positions rounded to float32 after it.
    np.testing.assert_allclose(resolved(over, tmp_path / "b"), resolved(whole, tmp_path / "a"), atol=2e-5)


def test_vectors_as_fractions_are_fractions_of_the_display_window(tmp_path: Path) -> None:
    def parts(frame: Frame) -> dict[str, dict[str, np.ndarray]]:
        assert frame.motion is not None
        colour = {name: frame.colour[PART][..., i] for i, name in enumerate("RGB")}
        u = np.full((ROWS, COLUMNS), 1.5 / WIDTH, np.float32)
        v = np.full((ROWS, COLUMNS), -0.5 / HEIGHT, np.float32)
        return {"rgba": colour, "motion": {"backward.u": u, "backward.v": v}}

    def box(window: tuple[int, int, int, int]) -> tuple[np.ndarray, ...]:
        return np.array(window[:2], np.int32), np.array(window[2:], np.int32)

    frame = make_frame(1, width=WIDTH, height=HEIGHT, motion=True)
    write_parts(tmp_path / "in" / "a.0001.exr", parts(frame), {"dataWindow": box(REGION), "displayWindow": box(WHOLE)})
    sequence = open_input(
        tmp_path / "in",
        profile="parts",
        assignments=["motion.units=uv", "motion.channels=motion.backward.u motion.backward.v"],
    )
    motion = sequence.frame(1).motion
    assert motion is not None
    np.testing.assert_allclose(motion, np.broadcast_to([1.5, -0.5], motion.shape), rtol=1e-6)


def change_last(folder: Path, data: Window, display: Window) -> None:
    path = folder / "a.0003.exr"
    planes, attributes = read_image(path)
    write_image(path, planes, attributes, windows=(data, display))


@pytest.mark.parametrize("on_resize", list(OnBreak))
def test_regions_that_wander_are_parts_of_one_picture(on_resize: OnBreak, tmp_path: Path) -> None:
    """As autocrop makes them: the display window is the picture, and outside of each there is nothing."""
    folder = write_region(tmp_path / "in", REGION)
    change_last(folder, (REGION[0] + 1, REGION[1], REGION[2] + 1, REGION[3]), WHOLE)
    sequence = open_input(folder, on_resize=on_resize)
    assert {layout.data_window for layout in sequence.layouts.values()} == {WHOLE}
    first, last = sequence.frame(0), sequence.frame(3)
    for frame, left in ((first, LEFT), (last, LEFT + 1)):
        shown = np.zeros((HEIGHT, WIDTH), bool)
        shown[TOP : TOP + ROWS, left : left + COLUMNS] = True
        np.testing.assert_array_equal(np.isfinite(frame.depth), shown)
        assert not frame.colour[~shown].any()
    np.testing.assert_array_equal(first.colour[PART], moving(0).colour[PART])
    np.testing.assert_array_equal(last.colour[TOP : TOP + ROWS, LEFT + 1 : LEFT + 1 + COLUMNS], moving(3).colour[PART])
    np.testing.assert_array_equal(last.camera.view_to_clip, moving(3).camera.view_to_clip)
    change_last(folder, REGION, (0, 0, WIDTH, HEIGHT - 1))
    with pytest.raises(DataError, match=r"a.0003.exr frame 3: shows another region.*of 48 x 36.*of 49 x 36"):
        open_input(folder, on_resize=on_resize)


@pytest.mark.parametrize("own", [True, False])
def test_inspect_says_which_region(own: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_region(tmp_path / "in", REGION)
    assert main(["inspect", str(folder), *([] if own else ["--input", "colour.channels=R G B"])]) == 0
    assert "30 x 24 at (9, 5) of 48 x 36" in " ".join(capsys.readouterr().out.split())


def test_truth_of_another_region_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_region(tmp_path / "in", REGION)
    truth = write_images(tmp_path / "truth", [np.zeros((ROWS, COLUMNS, 3), np.float32)] * 4, name="a")
    resolved(folder, tmp_path / "out")
    assert main(["compare", str(tmp_path / "out"), str(truth)]) == 0  # which does not say where it lies
    capsys.readouterr()
    beside = (LEFT + COLUMNS, TOP, WIDTH - 1, TOP + ROWS - 1)
    below = (LEFT, TOP + ROWS, LEFT + COLUMNS - 1, HEIGHT - 1)
    for number, elsewhere in enumerate((beside, below)):
        other = write_region(tmp_path / str(number), elsewhere)
        assert main(["compare", str(tmp_path / "out"), str(other)]) == 65
        assert "shows another region" in capsys.readouterr().err


def test_what_both_show_is_judged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A region against a truth of the whole, and against another region."""
    part = write_region(tmp_path / "part", REGION)
    whole = write_region(tmp_path / "whole", WHOLE)
    other = write_region(tmp_path / "other", (LEFT + 7, TOP - 2, WIDTH - 1, TOP + ROWS - 3))
    brighter = write_images(tmp_path / "brighter", [moving(index).colour + np.float32(0.125) for index in range(4)])
    for one, two, size, expected in (
        (part, whole, "30 x 24 at (9, 5)", 0.0),
        (whole, part, "30 x 24 at (9, 5)", 0.0),
        (other, part, "23 x 22 at (16, 5)", 0.0),
        (part, brighter, "30 x 24 at (9, 5)", 0.125**2),
    ):
        assert main(["compare", str(one), str(two), "--metrics", "mse-linear", "--json"]) == 0
        said = capsys.readouterr()
        assert json.loads(said.out)["mean"]["mse-linear"] == pytest.approx(expected, rel=1e-5)
        assert f"judged where both show something: {size} of the display window" in said.err
    assert main(["compare", str(part), str(part), "--metrics", "mse"]) == 0
    assert "judged where" not in capsys.readouterr().err
    assert main(["compare", str(part), str(other), str(whole), "--metrics", "mse"]) == 64  # means of other pixels
    assert f"{other}: what it shares with B is another region than what {part} does" in capsys.readouterr().err


@pytest.mark.parametrize("inputs", [(), ("colour.channels=R G B",)])
def test_a_truth_of_the_whole_is_one_of_a_region_too(
    inputs: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the sequence's own folder, or where --truth says, and whoever wrote it."""
    part, whole = write_region(tmp_path / "part", REGION), write_region(tmp_path / "whole", WHOLE)
    for place, folder in ((str(whole), None), (None, part / "reference")):
        if folder is not None:
            whole.rename(folder)
        sequence = Reading(assignments=inputs, truth=place).open(part)
        truth = truth_of(sequence)
        assert truth.layouts[0].size == sequence.layouts[0].size
        for images in (truth, truth.select(2, 3)):
            np.testing.assert_array_equal(images.image(2), moving(2).colour[PART])
        assert truth.select(2, 3).numbers == (2, 3)
    (part / "reference").rename(part / "reference-4")
    assert open_yardsticks(open_input(part))[4].layouts[0].region == REGION
    write_images(part / "reference", [moving(index).colour + np.float32(0.125) for index in range(4)], name="a")
    assert main(["compare", str(part), "--metrics", "mse-linear", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["mean"]["mse-linear"] == pytest.approx(0.125**2, rel=1e-5)


def test_camera_of_another_tools_region_is_that_of_our_own(tmp_path: Path) -> None:
    folder = write_region(tmp_path / "in", REGION)
    own, read = open_input(folder), open_input(folder, assignments=["colour.channels=R G B"])
    for number in own.numbers:
        for name in ("world_to_view", "view_to_clip"):
            expected, found = (getattr(sequence.outline(number).camera, name) for sequence in (own, read))
            np.testing.assert_array_equal(found, expected)
    side = tmp_path / "camera.txt"
    side.write_text(side_text([moving(index) for index in range(4)]))
    told = open_input(folder, side_file=side).outline(3).camera
    np.testing.assert_array_equal(told.view_to_clip, own.outline(3).camera.view_to_clip)


def test_rays_of_a_region_are_those_of_the_whole(tmp_path: Path) -> None:
    camera = read_frame(write_region(tmp_path / "in", REGION) / "a.0003.exr").camera
    whole = ray_length((HEIGHT, WIDTH), moving(3).camera, (0.2, -0.3))
    found = ray_length((ROWS, COLUMNS), camera, (0.2, -0.3))
    np.testing.assert_allclose(found, whole[PART], rtol=1e-12)


def test_a_set_of_files_may_hold_more_than_the_picture_or_less(tmp_path: Path) -> None:
    frame, depth = moving(0), tmp_path / "in" / "depth" / "a.0000.exr"
    colour = {name: frame.colour[..., place][PART] for place, name in enumerate("RGB")}
    for path in (depth, tmp_path / "in" / "beauty" / "a.0000.exr"):
        path.parent.mkdir(parents=True)
    write_image(path, colour, windows=(REGION, WHOLE))
    write_image(depth, {"Z": frame.depth}, windows=(WHOLE, WHOLE))
    np.testing.assert_array_equal(open_input(tmp_path / "in").frame(0).depth, frame.depth[PART])
    write_image(depth, {"Z": frame.depth[:, 20:]}, windows=((20, 0, *WHOLE[2:]), WHOLE))
    found = open_input(tmp_path / "in").frame(0).depth
    np.testing.assert_array_equal(found[:, 20 - LEFT :], frame.depth[PART][:, 20 - LEFT :])
    assert np.isinf(found[:, : 20 - LEFT]).all()
    half = (0, 0, WIDTH // 2 - 1, HEIGHT // 2 - 1)
    write_image(depth, {"Z": frame.depth[::2, ::2]}, windows=(half, half))
    with pytest.raises(DataError, match=r"another picture than the colour .*47, 35.*23, 17.*one display window"):
        open_input(tmp_path / "in").frame(0)
    double = (0, 0, 2 * WIDTH - 1, 2 * HEIGHT - 1)
    write_image(depth, {"Z": frame.depth.repeat(2, 0).repeat(2, 1)}, windows=(double, double))
    with pytest.raises(DataError, match=r"another picture than the colour .*95, 71"):
        open_input(tmp_path / "in").frame(0)


def test_a_channel_called_as_the_depth_of_other_files_is_0_outside_of_its_window(tmp_path: Path) -> None:
    for name, channels in (("beauty", "RGB"), ("depth", "R")):
        (tmp_path / name).mkdir()
        planes = dict.fromkeys(channels, np.ones((ROWS, COLUMNS), np.float32))
        for index, across in enumerate((0, 1)):  # data windows that differ are shown in the display window
            window = (LEFT + across, TOP, LEFT + across + COLUMNS - 1, TOP + ROWS - 1)
            write_image(tmp_path / name / f"a.{index:04d}.exr", planes, windows=(window, WHOLE))
    frame = open_input(tmp_path).frame(0)
    assert frame.colour[0, 0].tolist() == [0.0, 0.0, 0.0]
    assert frame.depth[0, 0] == np.inf
