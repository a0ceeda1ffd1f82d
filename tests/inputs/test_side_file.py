"""Matrices and jitter from a file beside the frames: exact in each format, and refused where damaged."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cltaa.errors import DataError, UsageError
from cltaa.frame import Camera
from cltaa.inputs.open import open_input
from cltaa.inputs.side_file import read_side_file
from cltaa.io.exr_read import read_header, read_image
from cltaa.io.exr_write import write_image
from cltaa.lab.check.report import check_folder
from tests.inputs.foreign import frames, side_text, write_blender, write_own


def test_side_files_hold_exact_doubles_in_each_format(tmp_path: Path) -> None:
    made = frames()
    text = tmp_path / "camera.txt"
    text.write_text(side_text(made))
    content = {
        str(f.index): {
            "world_to_view": f.camera.world_to_view.tolist(),
            "view_to_clip": f.camera.view_to_clip.tolist(),
            "jitter_px": f.jitter_px,
        }
        for f in made
    }
    (tmp_path / "camera.json").write_text(json.dumps({"frames": content}))
    with (tmp_path / "camera.csv").open("w") as file:
        writer = csv.writer(file)
        names = [
            f"{key}.{n}"
            for key, count in (("world_to_view", 16), ("view_to_clip", 16), ("jitter_px", 2))
            for n in range(count)
        ]
        writer.writerow(["frame", *names])
        for f in made:
            writer.writerow([f.index, *f.camera.world_to_view.ravel(), *f.camera.view_to_clip.ravel(), *f.jitter_px])
    for name in ("camera.txt", "camera.json", "camera.csv"):
        side = read_side_file(tmp_path / name)
        for frame in made:
            found = side[frame.index]
            assert found.world_to_view is not None
            assert found.view_to_clip is not None
            np.testing.assert_array_equal(found.world_to_view, frame.camera.world_to_view)
            np.testing.assert_array_equal(found.view_to_clip, frame.camera.view_to_clip)
            assert found.jitter_px == frame.jitter_px


EYE = str(np.eye(4).ravel().tolist())
# name -> contents that are refused, and what is said of each behind the name of the file
REFUSED: dict[str, list[tuple[str, str]]] = {
    "a.json": [
        ("{", ": not a side file: "),
        *((text, ": not a side file (expected ") for text in ("[]", "3")),
        *((f'{{"frames": {text}}}', ": not a side file (expected ") for text in ("[1]", '{"1.5": {}}', '{"1": "x"}')),
        ('{"frames": {"1": {"jitter_px": [1]}}}', " frame 1: jitter_px is wrong (expected 2 finite numbers, found [1]"),
        ('{"frames": {"1": {"jitter": [1, 2], "fov": 60}}}', " frame 1: unknown key jitter; did you mean jitter_px?"),
        ('{"frames": {"1": {"view": [], "proj": []}}}', "exposure, cut, found view, proj)"),
        (f'{{"frames": {{"1": {{"world_to_view": {EYE}}}}}}}', " world_to_view and view_to_clip belong together"),
        ('{"frames": {"1": {"exposure": 1, "exposure": 2}}}', ": a key is given twice: exposure"),
        ('{"frames": {"1": {"exposure": 1}, "1": {"exposure": 2}}}', ": a key is given twice: 1"),
        ('{"frames": {"1": {"exposure": 1}, "01": {"exposure": 2}}}', " frame 1: the frame is given twice"),
    ],
    "a.csv": [
        ("a,b\n1,2\n", ": line 2: 'frame' is missing"),
        ("frame,jitter_px.0,jitter_px.1,expsoure,a\n1,0,0,2,b\n", " unknown key expsoure; did you mean exposure?"),
        # As of decimal commas between commas, where the second half of each number would go astray.
        ("frame,exposure\n1,1\n2,1,25\n", ": line 3: more cells than headings (expected 2, found 3)"),
        ("frame,jitter_px.0,jitter_px.1\n1,0,25,0,125\n", ": line 2: more cells than headings"),
        ("frame,exposure,exposure\n1,1,2\n", ": a heading stands twice: exposure; leave one"),
        *((f"frame,exposure\n{n},2\n", ": line 2: frame is no whole number") for n in ("7.5", "x", "nan", "", "1e999")),
        # As of two takes, one behind the other: the later counted, without a word.
        ("frame,exposure\n1,1\n1.0,2\n", " frame 1: the frame is given twice"),
    ],
    "a.txt": [
        ("world_to_view 1", ": line 1 is not understood"),
        ("frame 1\njitter_px x y", " frame 1: jitter_px is wrong (expected 2 finite numbers, found ['x', 'y'])"),
        ("frame 1\nnear 1", ": line 2 is not understood"),
        *((text, ": no frame has a camera, a jitter, an exposure or a cut") for text in ("", "frame 1\n")),
        ("frame 1\nexposure 1\nexposure 2\n", ": line 3: exposure is given twice"),
        ("frame 1\nexposure 1\nframe 2\nexposure 1\nframe 1\nexposure 2", " frame 1: the frame is given twice"),
    ],
}


@pytest.mark.parametrize("name", REFUSED)
def test_damaged_side_files_are_refused_in_one_line(name: str, tmp_path: Path) -> None:
    for text, message in REFUSED[name]:
        (tmp_path / name).write_text(text)
        with pytest.raises(DataError) as caught:
            read_side_file(tmp_path / name)
        assert str(caught.value).startswith(f"{tmp_path / name}"), text
        assert message in str(caught.value), text
        assert "\n" not in str(caught.value), text


@pytest.mark.parametrize(
    "text",
    [
        "\ufeffframe,jitter_px.0,jitter_px.1\r\n1,0.25,-0.5\r\n",
        "frame;jitter_px.0;jitter_px.1\r\n1;0,25;-0,5\r\n",
        "frame;jitter_px.0;jitter_px.1\r\n1;0.25;-0.5\r\n",
    ],
    ids=["mark", "decimal commas", "semicolons"],
)
def test_a_table_may_be_as_spreadsheets_write_it(text: str, tmp_path: Path) -> None:
    path = tmp_path / "camera.csv"
    path.write_text(text, encoding="utf-8")
    assert read_side_file(path)[1].jitter_px == (0.25, -0.5)


def test_empty_cells_at_the_end_are_none(tmp_path: Path) -> None:
    (tmp_path / "camera.csv").write_text("frame,exposure,,\n1,2,,,,\n")
    assert read_side_file(tmp_path / "camera.csv")[1].exposure == 2


@pytest.mark.parametrize("between", ["\t", ", ", " ,\t"])
def test_columns_may_be_parted_by_tabs_or_have_spaces_before_them(between: str, tmp_path: Path) -> None:
    path = tmp_path / "camera.csv"
    rows = ("frame", "jitter_px.0", "jitter_px.1"), ("1", "0.25", "-0.5")
    path.write_text("\n".join(between.join(row) for row in rows))
    assert read_side_file(path)[1].jitter_px == (0.25, -0.5)


def test_one_matrix_without_an_inverse_is_a_finding(tmp_path: Path) -> None:
    made = frames()
    made[1] = replace(made[1], camera=Camera(np.diag([1.0, 1.0, 1.0, 0.0]), made[1].camera.view_to_clip))
    (tmp_path / "camera.txt").write_text(side_text(made))
    report, _ = check_folder(write_blender(tmp_path / "shot", made), side_file=tmp_path / "camera.txt")
    assert "camera-wrong" in [finding.name for finding in report.mistakes]


AWAY = np.diag([1.0, 1.0, -1.0, 1.0])  # a camera that looks along +z


@pytest.mark.parametrize(
    ("view", "clip", "jitter_px", "message"),
    [
        (np.zeros((4, 4)), None, (0.0, 0.0), "world_to_view cannot be inverted"),
        (None, AWAY, (0.0, 0.0), "view_to_clip has a wrong last row"),
        (None, None, (0.25, 30.0), r"jitter_px is no jitter .*30\.0"),
    ],
)
def test_what_no_frame_can_have_is_told_by_its_name_in_the_side_file(
    view: Any, clip: Any, jitter_px: tuple[float, float], message: str, tmp_path: Path
) -> None:
    made, side = frames(), tmp_path / "camera.txt"
    ours = made[1].camera
    camera = Camera(
        ours.world_to_view if view is None else view, ours.view_to_clip @ (np.eye(4) if clip is None else clip)
    )
    side.write_text(side_text([made[0], replace(made[1], camera=camera, jitter_px=jitter_px), *made[2:]]))
    sequence = open_input(write_blender(tmp_path / "shot", made), side_file=side)
    with pytest.raises(DataError, match=rf"^{re.escape(str(side))} frame {made[1].index}: {message}"):
        list(sequence)


def test_late_matrices_are_reported_with_the_file_that_holds_them(tmp_path: Path) -> None:
    made = frames()
    wrong = replace(made[1], camera=Camera(np.zeros((4, 4)), made[1].camera.view_to_clip))
    write_own(tmp_path, [made[0], wrong, *made[2:]])
    sequence = open_input(tmp_path, assignments=["camera.delay=1"], effects="all")
    with pytest.raises(DataError, match=r"own\.0001\.exr frame 0: matrix cltaa:worldToView cannot be inverted"):
        list(sequence)


def test_a_jitter_in_the_projection_is_reported_as_such(tmp_path: Path) -> None:
    made, side = frames(), tmp_path / "camera.txt"
    shifted = made[0].camera.view_to_clip.copy()
    shifted[0, 2] += 1.0  # half of the picture
    camera = Camera(made[0].camera.world_to_view, shifted)
    side.write_text(side_text([replace(made[0], camera=camera), *made[1:]]))
    sequence = open_input(
        write_blender(tmp_path / "shot", made), side_file=side, assignments=["jitter.source=projection"]
    )
    with pytest.raises(DataError, match=r"camera\.txt frame 0: the jitter in view_to_clip is no jitter"):
        list(sequence)


@pytest.mark.parametrize(
    ("numbered", "message"),
    [
        ((4, 5, 6), r"none of the frames is in the side file \(expected frames 0-2, found 4-6\)"),
        ((0, 2, 3), r"camera\.txt: no matrices for frame 1; give matrices to every frame there, or to none"),
    ],
)
def test_a_side_file_of_other_frames(numbered: tuple[int, ...], message: str, tmp_path: Path) -> None:
    """Frames that it leaves out would be resolved with another camera than the rest."""
    made = frames()
    side = tmp_path / "camera.txt"
    side.write_text(side_text([replace(frame, index=number) for frame, number in zip(made, numbered, strict=True)]))
    write_blender(tmp_path / "shot", made)
    with pytest.raises(DataError, match=message):
        open_input(tmp_path / "shot", side_file=side)


@pytest.mark.parametrize(
    ("key", "what"), [("jitter_px", "jitter"), ("world_to_view", "matrices"), ("exposure", "exposure")]
)
def test_no_frame_takes_from_the_side_file_what_another_takes_from_its_header(
    key: str, what: str, tmp_path: Path
) -> None:
    made, side = frames(), tmp_path / "camera.json"
    shown = {
        "world_to_view": made[0].camera.world_to_view.tolist(),
        "view_to_clip": made[0].camera.view_to_clip.tolist(),
    }
    value = shown if key == "world_to_view" else {key: {"jitter_px": [0.0, 0.0], "exposure": 2.0}[key]}
    write_own(tmp_path / "shot", made)

    def told(*numbers: int) -> None:
        side.write_text(json.dumps({"frames": dict.fromkeys(numbers, value) | {9: {"cut": 1}}}))

    told(0)
    rest = f"give {what} to every frame there, or to none, and those of the headers count"
    with pytest.raises(DataError, match=rf"camera\.json: no {what} for frames 1-2; {rest}"):
        open_input(tmp_path / "shot", side_file=side)
    told(0, 1, 2)
    assert len(open_input(tmp_path / "shot", side_file=side)) == 3
    side.write_text(json.dumps({"frames": {1: {"cut": 1}}}))  # a cut is of one frame
    assert [frame.cut for frame in open_input(tmp_path / "shot", side_file=side)] == [False, True, False]


def test_the_frame_that_a_side_file_leaves_out_is_named_where_its_matrices_are_late(tmp_path: Path) -> None:
    """With a delay of 1 it is the frame before whose matrices they would have been."""
    made, side = frames(), tmp_path / "camera.txt"
    side.write_text(side_text(made[:2]))
    write_blender(tmp_path / "shot", made)
    late = ["camera.delay=1", "jitter.delay=1"]
    with pytest.raises(DataError, match=r"camera\.txt: no matrices for frame 2;"):
        open_input(tmp_path / "shot", side_file=side, assignments=late)


def test_files_without_jitter_are_reported(tmp_path: Path) -> None:
    """The side file, which has the matrices of all, says nothing of a jitter."""
    made, side = frames(), tmp_path / "camera.txt"
    lines = side_text(made).splitlines(keepends=True)
    side.write_text("".join(line for line in lines if not line.startswith("jitter_px")))
    write_own(tmp_path / "shot", made)
    path = tmp_path / "shot" / "own.0001.exr"
    told = {name: value for name, value in read_header(path).attributes.items() if name != "cltaa:jitterPx"}
    write_image(path, read_image(path)[0], told)
    with pytest.raises(DataError, match=r"shot: no jitter for frame 1; give jitter to every frame with --camera FILE"):
        open_input(tmp_path / "shot", side_file=side)


def test_the_nearest_key_is_suggested_for_a_misspelt_one_of_a_profile(tmp_path: Path) -> None:
    write_blender(tmp_path, frames())
    with pytest.raises(UsageError, match=r"--input motion\.sclae=1: no such key; did you mean motion\.scale\?"):
        open_input(tmp_path, assignments=["motion.sclae=1"])


def test_folder_and_side_file_may_be_text(tmp_path: Path) -> None:
    made = frames()
    (tmp_path / "camera.txt").write_text(side_text(made))
    write_blender(tmp_path / "shot", made)
    sequence = open_input(f"{tmp_path}/shot", side_file=f"{tmp_path}/camera.txt")
    assert sequence.frame(1).jitter_px == made[1].jitter_px


@pytest.mark.parametrize("suffix", ["json", "csv", "txt"])
def test_exposure_and_cut_of_a_side_file_reach_the_frames(suffix: str, tmp_path: Path) -> None:
    """Over those in the files' headers, and part of what a result that is gone on with was made of."""
    made, side = frames(), tmp_path / f"camera.{suffix}"
    told = {0: (1.0, 0), 1: (0.25, 1), 2: (2.0, 0)}
    side.write_text(
        {
            "json": json.dumps({"frames": {n: {"exposure": e, "cut": bool(c)} for n, (e, c) in told.items()}}),
            "csv": "frame,exposure,cut\n" + "".join(f"{n},{e},{c}\n" for n, (e, c) in told.items()),
            "txt": "".join(f"frame {n}\nexposure {e}\ncut {c}\n" for n, (e, c) in told.items()),
        }[suffix]
    )
    write_blender(tmp_path / "shot", made)
    sequence = open_input(tmp_path / "shot", side_file=side)
    assert [(frame.exposure, frame.cut) for frame in sequence] == [(e, c == 1) for e, c in told.values()]
    before = sequence.beside_sha256(1)
    side.write_text(side.read_text().replace("0.25", "0.5"))
    assert open_input(tmp_path / "shot", side_file=side).beside_sha256(1) != before


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {0: {"exposure": 1}, 1: {"exposure": 2}},
            r"camera\.json: no exposure for frame 2; give exposure to every frame there",
        ),
        ({n: {"exposure": -(2**n)} for n in range(3)}, "frame 0: exposure is wrong .*positive factor.*found -1"),
        ({n: {"jitter_px": [1, "a"]} for n in range(3)}, r"jitter_px is wrong .*2 finite numbers, found \[1, 'a'\]"),
        ({n: {"exposure": 1, "cut": 2} for n in range(3)}, "frame 0: cut is wrong .*0 or 1, found 2"),
        ({n: {"expsoure": 1, "cut": 0} for n in range(3)}, "unknown key expsoure; did you mean exposure?"),
    ],
)
def test_exposures_that_cannot_be(given: dict[int, dict[str, float]], message: str, tmp_path: Path) -> None:
    (tmp_path / "camera.json").write_text(json.dumps({"frames": given}))
    write_blender(tmp_path / "shot", frames())
    with pytest.raises(DataError, match=message):
        open_input(tmp_path / "shot", side_file=tmp_path / "camera.json")


@pytest.mark.parametrize(("frame", "number"), [("7", 7), (" 7", 7), ("7.0", 7), ("-7.", -7)])
def test_frames_that_a_table_took_for_floats_are_whole(frame: str, number: int, tmp_path: Path) -> None:
    path = tmp_path / "camera.csv"
    path.write_text(f"frame,exposure\n{frame},2\n")
    assert read_side_file(path)[number].exposure == 2
