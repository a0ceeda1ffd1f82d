"""Which channels are the colour and go with it, and what is said where nobody can tell."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from cltaa.errors import DataError
from cltaa.inputs.intake import intake_lines, open_intake
from cltaa.inputs.open import open_input
from cltaa.inputs.roles import Place, equal_matches
from cltaa.io.exr_frame import frame_attributes, frame_planes
from cltaa.io.exr_write import write_image
from tests.inputs.foreign import frames, read, write_colour, write_parts
from tests.sequence_factory import make_frame


def test_a_colour_is_of_one_layer(tmp_path: Path) -> None:
    names = ["flow.R", "flow.G", "distance.R", "final.R", "final.G", "final.B"]
    write_image(tmp_path / "a.0001.exr", {name: np.ones((4, 4), np.float32) for name in names})
    intake = open_intake(tmp_path)
    assert [place.channel for place in intake.roles["colour"]] == ["final.R", "final.G", "final.B"]
    assert intake.profile.name == "parts"  # and not mitsuba, whose depth lies along the ray


@pytest.mark.parametrize("layer", ["", "ViewLayer."])
def test_a_layer_that_a_profile_names_comes_before_any_layer(layer: str, tmp_path: Path) -> None:
    names = [f"{layer}{name}.{last}" for name in ("Combined", "Diffuse") for last in "RGB"]
    write_image(tmp_path / "a.0001.exr", {name: np.ones((4, 4), np.float32) for name in names})
    intake = open_intake(tmp_path)
    assert [place.channel for place in intake.roles["colour"]] == names[:3]
    assert intake.profile.name == "blender"


@pytest.mark.parametrize(
    ("there", "said"),
    [
        (["b", "g", "r"], "no colour channels.*name them: --input colour.channels='r g b'"),
        (
            ["a.r", "a.b", "blue.r", "diffuse.Blue", "diffuse.Green", "diffuse.Red"],
            "no colour channels.*name them: .*'diffuse.Red diffuse.Green diffuse.Blue'",
        ),
        (["u", "v", "w"], "no colour channels.*name them: .*'RED GREEN BLUE'"),
        (["X", "Y", "Z"], "no colour channels.*name them: .*'RED GREEN BLUE'"),  # whose Y is no grey
        (["Y"], r"no colour channels.*found Y\); name them: .*'Y Y Y'"),
        (["Y", "Z"], r"no colour channels.*found Y Z\); name them: .*'Y Y Y'"),
        *(
            ([name], "no colour channels.*none of them is a picture: write R G B beside")
            for name in ("Z", "depth.V", "A", "id", "alpha", "flow.X")
        ),
        (["motion.b", "motion.g", "motion.r"], "no colour channels.*none of them is a picture: write R G B beside"),
        (["Y", "RY", "BY"], r"luminance and chroma \(expected R G B, found BY RY Y\); convert it to R G B"),
    ],
)
def test_no_colour_asks_for_names_that_are_there(tmp_path: Path, there: list[str], said: str) -> None:
    write_image(tmp_path / "a.0001.exr", {name: np.ones((4, 4), np.float32) for name in there})
    with pytest.raises(DataError, match=said):
        open_intake(tmp_path)


def test_whole_numbers_are_no_light(tmp_path: Path) -> None:
    write_image(tmp_path / "shot.0001.exr", {c: np.full((2, 3), 200, np.uint32) for c in "RGB"})
    with pytest.raises(DataError, match=r"channel R: wrong channel type \(expected half or float, found uint\)"):
        read(tmp_path)


@pytest.mark.parametrize("names", [("aov1.0001.exr", "aov2.0001.exr"), ("pass1/x.0001.exr", "pass2/x.0001.exr")])
def test_one_frame_in_numbered_files_is_read(tmp_path: Path, names: tuple[str, str]) -> None:
    for name, channels in zip(names, ("RGB", "Z"), strict=True):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        write_image(tmp_path / name, {channel: np.ones((4, 4), np.float32) for channel in channels})
    assert {"colour", "depth"} <= {*open_intake(tmp_path).roles}


def test_of_several_pictures_none_is_taken_for_the_colour(tmp_path: Path) -> None:
    """A beauty beside an albedo is told by its name; of two takes nobody can say which is meant."""
    made = frames(2)
    for name in ("albedo", "beauty"):
        write_colour(tmp_path / "layers" / name, made)
    write_colour(tmp_path / "layers" / "truth", made, "beauty")  # a folder of that name holds no input
    intake = open_intake(tmp_path / "layers")
    assert {place.files for place in intake.roles["colour"]} == {"beauty/picture"}
    write_colour(tmp_path / "shot", made, "shot")
    write_colour(tmp_path / "shot" / "backup", made)
    assert {place.files for place in open_intake(tmp_path / "shot").roles["colour"]} == {"shot"}
    for number in (0, 1):  # whatever the layers of a folder there are called
        picture = {f"rgba.{name}": np.ones((23, 37), np.float32) for name in "RGB"}
        write_parts(tmp_path / "shot" / "truth" / f"x.{number:04d}.exr", {"": picture}, {})
    write_colour(tmp_path / "passes", made, "albedo")
    write_colour(tmp_path / "passes" / "beauty", made)
    for name, files in (("shot", "shot"), ("passes", "beauty/picture")):
        intake = open_intake(tmp_path / name, profile="parts")
        assert {place.files for place in intake.roles["colour"]} == {files}
    for name in ("take1", "take2"):
        write_colour(tmp_path / "takes" / name, made)
    with pytest.raises(
        DataError, match=r"several sets of files.*found take1/picture, take2/picture.*take1\.R take1\.G"
    ):
        open_intake(tmp_path / "takes")
    read(tmp_path / "takes", "colour.channels=take2.R take2.G take2.B")
    for name in ("day 1", "day 2"):
        write_colour(tmp_path / "one folder", made, name)
    with pytest.raises(DataError, match="several sets of files") as caught:
        open_intake(tmp_path / "one folder")
    (pattern,) = re.findall("such as (.*), or the channels", str(caught.value))
    assert open_intake(*shlex.split(pattern)).sets.keys() == {"day 1"}


def test_no_depth_of_a_picture_in_a_folder_below_is_taken_for_that_beside_the_colour(tmp_path: Path) -> None:
    """Nor vectors, whatever they are called there; where there are no others, those are read."""
    planes = dict.fromkeys("RGB", np.ones((4, 4), np.float32))
    write_parts(tmp_path / "final" / "x.0001.exr", {"": planes | {"Z": planes["R"]}}, {})
    write_parts(tmp_path / "x.0001.exr", {"": planes}, {})
    assert [place.files for place in open_intake(tmp_path).roles["depth"]] == ["final/x"]
    write_parts(tmp_path / "x.0001.exr", {"": planes | {"depth.Z": planes["R"]}}, {})
    for profile in ("auto", "parts"):
        assert open_intake(tmp_path, profile=profile).roles["depth"] == (Place("x", "depth.Z"),)


@pytest.mark.parametrize("other", ["depth", "MotionVectors", "crypto_object", "albedo"])
def test_the_option_for_one_of_several_sets_takes_no_depth_vectors_or_masks(other: str, tmp_path: Path) -> None:
    for name in (other, "render"):
        write_colour(tmp_path, frames(1), name)
    with pytest.raises(DataError, match=r"several sets of files.*--input colour.channels='render.R render.G render.B'"):
        open_intake(tmp_path)


def write_layers(folder: Path, layers: dict[str, float], **attributes: str) -> None:
    """One file of 4 x 4 pixels: each channel by its name, with its value."""
    planes = {name: np.full((4, 4), value, np.float32) for name, value in layers.items()}
    folder.mkdir(parents=True, exist_ok=True)
    write_image(folder / f"{folder.name}.0001.exr", planes, attributes)


BLENDER = {"Software": "Blender 4.2"}


def test_alpha_is_that_of_the_layer_of_the_colour(tmp_path: Path) -> None:
    """A film that is transparent has its alpha there; that of another layer would cut out something else."""
    mask, film = {f"Mask.{c}": 0.5 for c in "RGBA"}, {f"View.Combined.{c}": 0.25 for c in "RGBA"}
    write_layers(tmp_path / "blender", mask | film, **BLENDER)
    np.testing.assert_array_equal(read(tmp_path / "blender")[0].alpha, np.full((4, 4), 0.25, np.float32))
    write_layers(tmp_path / "karma", mask | {f"C.{c}": 0.25 for c in "RGB"} | {"C.A": 0.75, "depth.Z": 1.0})
    np.testing.assert_array_equal(read(tmp_path / "karma")[0].alpha, np.full((4, 4), 0.75, np.float32))


@pytest.mark.parametrize(("red", "alpha"), [("C.r C.g C.b", "C.a"), ("rgba.red rgba.green rgba.blue", "rgba.alpha")])
def test_alpha_is_named_as_the_colour_is(red: str, alpha: str, tmp_path: Path) -> None:
    write_layers(tmp_path, dict.fromkeys((*red.split(), alpha), 0.5))
    intake = open_intake(tmp_path, assignments=[f"colour.channels={red}"])
    assert [place.channel for place in intake.roles["alpha"]] == [alpha]


def test_alpha_of_other_files_is_none_of_the_colours(tmp_path: Path) -> None:
    write_layers(tmp_path / "albedo", dict.fromkeys("RGBA", 0.5))
    write_layers(tmp_path / "final", dict.fromkeys("RGB", 0.5))
    colour = "colour.channels=final.R final.G final.B"
    assert read(tmp_path, colour)[0].alpha is None
    np.testing.assert_array_equal(
        read(tmp_path, colour, "colour.alpha=albedo.A")[0].alpha, np.full((4, 4), 0.5, np.float32)
    )


@pytest.mark.parametrize(
    ("layer", "channels", "depths"),
    [
        ("Trees.Combined", ("Trees.Depth.Z", "Trees.Vector.X", "Trees.Vector.Y"), ("Rocks", "Trees")),
        ("right", ("right.Z", "right.backward.u", "right.backward.v"), ("", "right")),
    ],
    ids=["view layer", "view"],
)
def test_depth_and_vectors_are_those_of_the_layer_of_the_colour(
    layer: str, channels: tuple[str, ...], depths: tuple[str, ...], tmp_path: Path
) -> None:
    there = {}
    for number, other in enumerate(depths):
        for name in ("Combined.R", "Combined.G", "Combined.B", "Depth.Z", "Vector.X", "Vector.Y"):
            there[f"{other}.{name}" if other else f"{name}"] = float(number)
        for name in ("R", "G", "B", "Z", "backward.u", "backward.v"):
            there[f"{other}.{name}" if other else f"{name}"] = float(number)
    attributes = BLENDER if "Combined" in layer else {}
    write_layers(tmp_path, there, **attributes)
    colour = " ".join(f"{layer}.{c}" for c in "RGB")
    intake = open_intake(tmp_path, assignments=[f"colour.channels={colour}"])
    found = [place.channel for role in ("depth", "motion") for place in intake.roles[role]]
    assert found == list(channels)


def test_depth_and_vectors_of_another_picture_are_none_of_the_colours(tmp_path: Path) -> None:
    """A user turns the passes of each view layer on by themselves."""
    colours = [f"{layer}.Combined.{c}" for layer in ("Rocks", "Trees") for c in "RGBA"]
    passes = ("Rocks.Depth.Z", "Rocks.Vector.X", "Rocks.Vector.Y")
    write_layers(tmp_path, dict.fromkeys((*colours, *passes), 0.5), **BLENDER)
    asked = "colour.channels=Trees.Combined.R Trees.Combined.G Trees.Combined.B"
    assert open_intake(tmp_path, assignments=[asked]).roles.keys() == {"colour", "alpha"}
    assert open_intake(tmp_path).roles.keys() == {"colour", "alpha", "depth", "motion"}
    own = open_intake(tmp_path, assignments=[asked, "depth.channels=Rocks.Depth.Z"]).roles
    assert [place.channel for place in own["depth"]] == ["Rocks.Depth.Z"]
    composite = dict.fromkeys([name.replace("Trees", "Composite") for name in colours] + [*passes], 0.5)
    write_layers(tmp_path, composite, **BLENDER)
    of_all = open_intake(tmp_path, assignments=[asked.replace("Trees", "Composite")]).roles
    assert of_all.keys() == {"colour", "alpha", "depth", "motion"}


def test_view_layers_that_are_not_resolved_are_named(tmp_path: Path) -> None:
    layers = ("Rocks", "Trees", "Water")
    there = {
        f"{layer}.{name}": 0.5 for layer in layers for name in ("Combined.R", "Combined.G", "Combined.B", "Glow.R")
    }
    write_layers(tmp_path, there, **BLENDER)
    (line,) = [line for line in intake_lines(open_intake(tmp_path)) if "layer" in line]
    told = "--input colour.channels='Trees.Combined.R Trees.Combined.G Trees.Combined.B'"
    assert line == f"another layer: Trees.Combined, Water.Combined not resolved; to take Trees.Combined: {told}"
    intake = open_intake(tmp_path, assignments=[shlex.split(told)[1]])
    assert intake.roles["colour"][0].channel == "Trees.Combined.R"


def test_the_shortest_names_of_several_sets_are_meant() -> None:
    there = {
        "left": ("left.R", "left.G", "left.B"),
        "plain": ("R", "G", "B"),
        "right": ("right.R", "right.G", "right.B"),
    }
    assert equal_matches([("*R", "*G", "*B")], there) == [tuple(Place("plain", name) for name in "RGB")]


def test_the_option_for_another_layer_is_printed(tmp_path: Path) -> None:
    layers = ("diffuse", "specular", "crypto_object")
    planes = {f"{layer}.{c}": np.full((4, 4), place, np.float32) for place, layer in enumerate(layers) for c in "RGB"}
    write_image(tmp_path / "a.0001.exr", planes | {"N.X": np.ones((4, 4), np.float32)})
    (line,) = [line for line in open_intake(tmp_path).notes if "layer" in line]
    assert line.startswith("another layer: specular not resolved; to take specular: ")
    pasted = shlex.split(line)[-1]
    again = open_intake(tmp_path, assignments=[pasted])
    assert [place.channel for place in again.roles["colour"]] == ["specular.R", "specular.G", "specular.B"]
    assert not [line for line in again.notes if "layer" in line]


@pytest.mark.parametrize(
    ("sets", "roles"),
    [
        (  # Unity and other engines' dumps: every file has R G B
            {"Color": "RGBA", "Depth": "R", "MotionVectors": "RGBA", "Normals": "RGB"},
            {"colour": "Color", "alpha": "Color", "depth": "Depth"},
        ),
        (  # its longer names, as the tool writes them; FinalImage is in each
            {
                "s.FinalImage": "RGBA",
                "s.FinalImageMovieRenderQueue_WorldDepth": "RGBA",
                "s.FinalImageMovieRenderQueue_MotionVectors": "RGBA",
            },
            {
                "colour": "s.FinalImage",
                "alpha": "s.FinalImage",
                "depth": "s.FinalImageMovieRenderQueue_WorldDepth",
                "motion": "s.FinalImageMovieRenderQueue_MotionVectors",
            },
        ),
        (  # Unreal's Movie Render Queue, a file a pass
            {"Seq.FinalImage": "RGBA", "Seq.WorldDepth": "RGB", "Seq.MotionVectors": "RGB"},
            {
                "colour": "Seq.FinalImage",
                "alpha": "Seq.FinalImage",
                "depth": "Seq.WorldDepth",
                "motion": "Seq.MotionVectors",
            },
        ),
    ],
)
def test_files_of_passes_are_distinguished_by_their_names(
    sets: dict[str, str], roles: dict[str, str], tmp_path: Path
) -> None:
    for name, channels in sets.items():
        write_image(tmp_path / f"{name}.0001.exr", dict.fromkeys(channels, np.ones((4, 4), np.float32)))
    found = open_intake(tmp_path).roles
    assert {role: places[0].files for role, places in found.items()} == roles


@pytest.mark.parametrize("form", ["{1}.{0}", "{0}_{1}", "{0}/{1}"])
def test_the_depth_of_several_pictures_is_the_one_of_the_colours_name(form: str, tmp_path: Path) -> None:
    for value, eye in enumerate(("left", "right"), start=1):
        for name, channels in (("beauty", "RGB"), ("depth", "Z")):
            path = tmp_path / f"{form.format(eye, name)}.0001.exr"
            path.parent.mkdir(exist_ok=True)
            write_image(path, dict.fromkeys(channels, np.full((4, 4), value, np.float32)))
    for value, eye in enumerate(("left", "right"), start=1):
        colour = form.format(eye, "beauty").replace("/", ".")
        (frame,) = read(tmp_path, f"colour.channels={colour}.R {colour}.G {colour}.B")
        assert (frame.colour[0, 0, 0], frame.depth[0, 0]) == (value, value)


@pytest.mark.parametrize("name", ["in_depth", "x.WorldDepth", "shot.alpha"])
def test_a_picture_is_neither_its_own_depth_nor_its_alpha(name: str, tmp_path: Path) -> None:
    write_image(tmp_path / f"{name}.0001.exr", dict.fromkeys("RGB", np.ones((4, 4), np.float32)))
    assert open_intake(tmp_path).roles.keys() == {"colour"}


OPTION = re.compile(r"--input (?:'[^']*'|[^\s;,'])+")


@pytest.mark.parametrize(
    "sets",
    [
        {"x": ["rgba.R", "rgba.G", "rgba.B"], "y": ["rgba.R"]},  # no layer, for it lacks two channels
        {"x": ["R", "G", "B", "motion.B"], "depth": ["flow.x", "flow.y"]},  # vectors are of one layer
        {"x": ["A.Combined.R", "A.Combined.G", "A.Combined.B"], "b": [f"B.Combined.{c}" for c in "RGBA"]},
        {"x": ["right.R", "right.G", "right.B", "left.Z"]},  # the left view has no picture
        {"x": ["left.R", "left.G", "left.B", "right.R", "right.G", "right.B"], "d": ["left.depth_of_field"]},
        {"x": ["C.r", "C.g", "C.b"], "y": ["c.G"]},
        {"x": ["R", "G", "B", "z.Z", "opacity.R"]},
    ],
)
def test_every_option_that_is_printed_is_taken(sets: dict[str, list[str]], tmp_path: Path) -> None:
    for name, channels in sets.items():
        write_image(tmp_path / f"{name}.0001.exr", dict.fromkeys(channels, np.ones((4, 4), np.float32)))
    try:
        lines = list(intake_lines(open_intake(tmp_path)))
    except DataError as error:
        lines = [str(error)]
    for option in OPTION.findall("\n".join(lines)):
        assert "colour" in open_intake(tmp_path, assignments=shlex.split(option)[1:]).roles


@pytest.mark.parametrize(
    ("beside", "hint"),
    [
        (["subimage01.Z"], "to take that in subimage01.Z: --input depth.channels=subimage01.Z"),
        (["z.Z"], "--input depth.channels=z.Z"),
        (["z.z"], "--input depth.channels=z.z"),
        (["N.X", "N.Y", "N.Z"], None),
        (
            ["cutout.Opacity"],
            "no alpha: the picture is taken as opaque; to take that in cutout.Opacity: --input colour.al",
        ),
        (["matte_alpha.R"], "--input colour.alpha=matte_alpha.R"),
        (["mask.R"], None),
    ],
)
def test_what_may_be_depth_or_alpha_is_offered(beside: list[str], hint: str | None, tmp_path: Path) -> None:
    write_image(tmp_path / "x.0001.exr", dict.fromkeys([*"RGB", *beside], np.ones((4, 4), np.float32)))
    notes = "\n".join(open_intake(tmp_path).notes)
    assert hint in notes if hint else "to take" not in notes


def test_a_view_without_a_picture_is_reported_as_such(tmp_path: Path) -> None:
    names = ("right.R", "right.G", "right.B", "left.Z")
    write_image(tmp_path / "x.0001.exr", dict.fromkeys(names, np.ones((4, 4), np.float32)))
    with pytest.raises(DataError, match="no colour channels of view left"):
        open_intake(tmp_path, assignments=["colour.view=left"])


def test_vectors_alone_are_not_taken_for_unreals(tmp_path: Path) -> None:
    """Other renderers call theirs MotionVectors too, and mean pixels."""
    write_layers(tmp_path, dict.fromkeys((*"RGBA", "MotionVectors.R", "MotionVectors.G", "MotionVectors.B"), 0.5))
    intake = open_intake(tmp_path)
    assert intake.profile.name == "cltaa"
    assert "motion" not in intake.roles


def test_frames_of_ours_that_another_tool_has_changed_are_read(tmp_path: Path) -> None:
    """Its attributes stay where it makes parts of the layers, or leaves the depth out."""
    frame = make_frame(1)
    planes, header = frame_planes(frame, tmp_path), frame_attributes(frame)
    beauty = {f"rgba.{name}": planes[name] for name in "RGB"}
    write_parts(tmp_path / "parts" / "a.0001.exr", {"rgba": beauty, "depth": {"Z": planes["Z"]}}, header)
    found = open_input(tmp_path / "parts").frame(1)
    assert (found.has_depth, found.has_camera, found.jitter_px) == (True, True, frame.jitter_px)
    (tmp_path / "less").mkdir()
    write_image(tmp_path / "less" / "a.0001.exr", {name: planes[name] for name in "RGB"}, header)
    with pytest.raises(DataError, match=r"channel Z: channel is missing .* --profile parts"):
        open_input(tmp_path / "less").frame(1)
    assert open_input(tmp_path / "less", profile="parts").frame(1).has_camera
