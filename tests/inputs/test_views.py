"""Pictures of several views: the one that is chosen once is that of colour, alpha, depth and vectors."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.errors import DataError, UsageError
from cltaa.inputs.foreign import open_pictures
from cltaa.inputs.intake import intake_lines, open_intake
from cltaa.inputs.open import open_input
from cltaa.io.exr_frame import Pixels
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_image
from cltaa.io.openexr import OpenEXR
from tests.inputs.foreign import write_parts
from tests.sequence_factory import make_camera

BLENDER = {"Software": "Blender 5.0.1"}
PASSES = (
    "Combined.{}.R",
    "Combined.{}.G",
    "Combined.{}.B",
    "Combined.{}.A",
    "Depth.{}.Z",
    "Vector.{}.X",
    "Vector.{}.Y",
)
EYES = ("left", "right")
HEADER = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}


def flat(value: float) -> Pixels:
    return np.full((4, 5), value, np.float32)


def blender(folder: Path, *, parts: bool = False) -> Path:
    """One file of both eyes; a part for each pass and eye, as Blender 5 writes them, or one for all."""
    folder.mkdir()
    names = {f"ViewLayer.{name.format(eye)}": flat(EYES.index(eye)) for eye in EYES for name in PASSES}
    if not parts:
        write_image(folder / "a.0001.exr", names, BLENDER)
        return folder
    of_part: dict[str, dict[str, Pixels]] = {}
    for name, plane in names.items():
        of_part.setdefault(name.rpartition(".")[0], {})[name] = plane
    write_parts(folder / "a.0001.exr", of_part, BLENDER)
    return folder


def standard(folder: Path, *, without: str = "") -> Path:
    """A file as OpenEXR's multi-view standard has it: the names of the first view's channels go without it."""
    folder.mkdir()
    left = {name: flat(0.0) for name in ("R", "G", "B", "Z", "backward.u", "backward.v", "glow.left.R")}
    right = {f"right.{name}": flat(1.0) for name in ("R", "G", "B", "Z")}
    vectors = {f"backward.right.{name}": flat(1.0) for name in "uv"}
    names = {name: plane for name, plane in (left | right | vectors).items() if name != without}
    write_image(folder / "a.0001.exr", names, {"multiView": list(EYES)})
    return folder


def taken(folder: Path, *asked: str) -> dict[str, str]:
    roles = open_intake(folder, assignments=asked).roles
    return {role: " ".join(place.channel for place in places) for role, places in roles.items()}


def of_blender(eye: str) -> dict[str, str]:
    r, g, b, a, z, x, y = (f"ViewLayer.{name.format(eye)}" for name in PASSES)
    return {"colour": f"{r} {g} {b}", "alpha": a, "depth": z, "motion": f"{x} {y}"}


@pytest.mark.parametrize("parts", [False, True])
@pytest.mark.parametrize("eye", EYES)
def test_all_is_of_the_view_that_is_chosen(eye: str, parts: bool, tmp_path: Path) -> None:
    folder = blender(tmp_path / "in", parts=parts)
    assert taken(folder, f"colour.view={eye}") == of_blender(eye)
    assert taken(folder, f"colour.channels={of_blender(eye)['colour']}") == of_blender(eye)
    with pytest.raises(DataError, match=r"several views \(found left, right\); choose one: --input colour\.view=left"):
        open_intake(folder)


def test_a_missing_view_is_reported_with_the_existing_ones(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"colour\.view=middle: no such view \(expected left, right\)"):
        open_intake(blender(tmp_path / "two"), assignments=["colour.view=middle"])
    (tmp_path / "one").mkdir()
    write_image(tmp_path / "one" / "a.0001.exr", dict.fromkeys("RGB", flat(0.5)))
    with pytest.raises(UsageError, match=r"no such view \(expected none: the picture has one view"):
        open_intake(tmp_path / "one", assignments=["colour.view=left"])


def test_the_first_view_may_go_without_its_name(tmp_path: Path) -> None:
    folder = standard(tmp_path / "in")
    left = {"colour": "R G B", "depth": "Z", "motion": "backward.u backward.v"}
    assert taken(folder) == taken(folder, "colour.view=left") == left
    right = {"colour": "right.R right.G right.B", "depth": "right.Z", "motion": "backward.right.u backward.right.v"}
    assert taken(folder, "colour.view=right") == right
    assert open_pictures(folder, assignments=["colour.view=right"]).image(1)[0, 0, 0] == 1.0


@pytest.mark.parametrize("beside", ["a", "z"])  # before and behind the colour's files in the alphabet
def test_each_file_has_a_first_view_of_its_own(beside: str, tmp_path: Path) -> None:
    """The channels of a second file that name no view are of the view that this file lists first."""
    colour = ("R", "G", "B", "right.R", "right.G", "right.B")
    write_image(tmp_path / "beauty.0001.exr", dict.fromkeys(colour, flat(1.0)), {"multiView": ["left", "right"]})
    channels = {"Z": flat(2.0), "left.Z": flat(1.0)}
    write_image(tmp_path / f"{beside}.0001.exr", channels, {"multiView": ["right", "left"]})
    assert taken(tmp_path) == taken(tmp_path, "colour.view=left")
    assert taken(tmp_path) == {"colour": "R G B", "depth": "left.Z"}
    assert taken(tmp_path, "colour.view=right") == {"colour": "right.R right.G right.B", "depth": "Z"}
    write_image(tmp_path / f"{beside}.0001.exr", {"Z": flat(2.0)}, {"multiView": ["right"]})
    assert taken(tmp_path) == {"colour": "R G B"}
    copied = pickle.loads(pickle.dumps(open_input(tmp_path, assignments=["colour.view=right"])))
    assert copied.frame(1).depth[0, 0] == 2.0


@pytest.mark.parametrize(("eye", "lost"), [("left", "Z"), ("right", "right.Z")])
def test_depth_of_another_view_is_none_of_this_one(eye: str, lost: str, tmp_path: Path) -> None:
    folder = standard(tmp_path / "in", without=lost)
    assert "depth" not in taken(folder, f"colour.view={eye}")
    other = "Z" if eye == "right" else "right.Z"
    if eye == "left":  # but whoever asks for it by its name gets it
        assert taken(folder, f"colour.view={eye}", f"depth.channels={other}")["depth"] == other


def test_the_view_and_the_option_for_another_are_reported(tmp_path: Path) -> None:
    lines = list(intake_lines(open_intake(blender(tmp_path / "in"), assignments=["colour.view=right"])))
    assert "several views: right of left, right is taken; to take left: --input colour.view=left" in lines
    assert not any("another layer" in line for line in lines)


def test_a_result_keeps_the_other_view_as_a_layer(tmp_path: Path) -> None:
    out = tmp_path / "out"
    asked = ["--input", "colour.view=right", "--device", "numpy"]
    assert main(["resolve", str(blender(tmp_path / "in")), "-o", str(out), *asked]) == 0
    planes, _ = read_image(out / "a.0001.exr")
    assert planes["R"][0, 0] == 1.0
    assert "ViewLayer.Combined.left.R" in planes
    assert "ViewLayer.Combined.right.R" not in planes


def test_the_only_view_needs_no_choice(tmp_path: Path) -> None:
    """One eye of a stereo render, whose names still say which."""
    names = [f"ViewLayer.{name.format('left')}" for name in PASSES]
    write_image(tmp_path / "a.0001.exr", {name: flat(0.0) for name in names}, {**BLENDER, "multiView": ["left"]})
    assert taken(tmp_path) == of_blender("left")
    assert not any("view" in line for line in open_intake(tmp_path).notes)


def of_parts(folder: Path, views: dict[str, str | None]) -> Path:
    """A file whose parts say in attribute ``view`` of which view they are; names of parts as compositors write them."""
    folder.mkdir()
    channels = {"rgba": "RGBA", "depth": "Z", "forward": ("forward.u", "forward.v"), "disparityL": ("x", "y")}
    parts = []
    for name, view in views.items():
        planes = {channel: flat(view == "right") for channel in channels[name.split("_")[0]]}
        parts.append(OpenEXR.Part(HEADER | ({"view": view} if view else {}), planes, name))
    OpenEXR.File(parts).write(str(folder / "a.0001.exr"))
    return folder


@pytest.mark.parametrize("eye", EYES)
def test_a_view_that_an_attribute_of_parts_names_is_one(eye: str, tmp_path: Path) -> None:
    """Parts are called as those of the stereo pictures among OpenEXR's own examples, in their order."""
    names = ("rgba_right", "depth_left", "forward_left", "rgba_left", "depth_right", "forward_right")
    views = {name: name.split("_")[1] for name in names}
    folder = of_parts(tmp_path / "in", {**views, "disparityL": None})
    expected = {
        "colour": f"rgba_{eye}.R rgba_{eye}.G rgba_{eye}.B",
        "alpha": f"rgba_{eye}.A",
        "depth": f"depth_{eye}.Z",
    }
    assert taken(folder, f"colour.view={eye}") == expected
    assert taken(folder, f"colour.channels={expected['colour']}") == expected
    assert taken(folder, f"colour.channels=*_{eye}.R *_{eye}.G *_{eye}.B") == expected
    assert taken(folder) == taken(folder, "colour.view=left")
    note = "several views: left of left, right is taken; to take right: --input colour.view=right"
    assert note in open_intake(folder).notes
    assert open_pictures(folder, assignments=[f"colour.view={eye}"]).image(1)[0, 0, 0] == EYES.index(eye)
    with pytest.raises(UsageError, match=r"colour\.view=middle: no such view \(expected left, right\)"):
        open_intake(folder, assignments=["colour.view=middle"])


def test_beside_a_view_that_is_stated_one_without_a_name_is_another(tmp_path: Path) -> None:
    folder = of_parts(tmp_path / "in", {"rgba": None, "rgba_right": "right", "depth_right": "right"})
    nameless = {"colour": "rgba.R rgba.G rgba.B", "alpha": "rgba.A"}
    assert taken(folder) == taken(folder, f"colour.channels={nameless['colour']}") == nameless
    assert taken(folder, "colour.view=right")["depth"] == "depth_right.Z"
    note = "several views: the one without a name is taken; to take right: --input colour.view=right"
    assert note in open_intake(folder).notes


@pytest.mark.parametrize("eye", EYES)
def test_the_camera_is_that_of_the_view(eye: str, tmp_path: Path) -> None:
    """Each part has its own; a part without one, such as a matte of no view, changes nothing."""
    parts = [OpenEXR.Part(HEADER, {"mask": flat(1.0)}, "matte")]
    for view in EYES:
        moved = np.eye(4)
        moved[3, 0] = EYES.index(view)  # Imath's layout
        matrices = {"cltaa:worldToView": moved, "cltaa:viewToClip": np.ascontiguousarray(make_camera().view_to_clip.T)}
        parts.append(OpenEXR.Part(HEADER | matrices | {"view": view}, dict.fromkeys("RGB", flat(0.5)), f"rgba_{view}"))
    OpenEXR.File(parts).write(str(tmp_path / "a.0001.exr"))
    frame = open_input(tmp_path, assignments=[f"colour.view={eye}"]).frame(1)
    assert frame.camera.world_to_view[0, 3] == EYES.index(eye)


def test_the_one_view_of_all_parts_may_be_asked_for(tmp_path: Path) -> None:
    folder = of_parts(tmp_path / "in", {"rgba": "main", "depth": "main"})
    assert taken(folder, "colour.view=main") == taken(folder)
    assert taken(folder)["depth"] == "depth.Z"
    assert not any("views" in line for line in open_intake(folder).notes)


def test_a_picture_of_one_view_may_be_asked_for_by_its_name(tmp_path: Path) -> None:
    write_image(tmp_path / "a.0001.exr", dict.fromkeys("RGBZ", flat(0.5)), {"view": "left"})
    assert taken(tmp_path, "colour.view=left") == taken(tmp_path) == {"colour": "R G B", "depth": "Z"}
    with pytest.raises(UsageError, match=r"no such view \(expected left\)"):
        open_intake(tmp_path, assignments=["colour.view=right"])


@pytest.mark.parametrize("eye", EYES)
def test_folders_of_one_view_each_are_distinguished_as_folders(eye: str, tmp_path: Path) -> None:
    for view in EYES:
        (tmp_path / view).mkdir()
        channels = ("R", "G", "B", *(("depth.Z",) if view == eye else ()))
        write_image(tmp_path / view / "a.0001.exr", dict.fromkeys(channels, flat(0.5)), {"view": view})
    with pytest.raises(DataError, match="several sets of files may be the colour"):
        open_intake(tmp_path)
    asked = [f"colour.channels={eye}.R {eye}.G {eye}.B"]
    roles = open_intake(tmp_path, profile="parts", assignments=asked).roles
    assert {place.files.split("/")[0] for role in ("colour", "depth") for place in roles[role]} == {eye}
