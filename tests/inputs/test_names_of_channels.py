"""Names of layers, views and channels are no words: whatever stands in them, an option that is printed reads them."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cltaa.cli import main
from cltaa.errors import DataError
from cltaa.inputs.intake import intake_lines, open_intake
from cltaa.inputs.open import open_input
from cltaa.inputs.profile import Profile, assignments_of, differences, load_profile, override, toml_text
from cltaa.io.exr_frame import Pixels
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_image
from cltaa.printable import names_in, written

LAYERS = [
    "Main Layer",
    "a.b.c",
    "one, two",
    'say "so"',
    "it's",
    "'quoted'",
    "レイヤー 1",
    "two  spaces",
    "[x]*",
    "back\\slash",
    "-dash --input",
    "$HOME `x` ;",
    "レイヤー\u3000二",
    "no\u00a0break",
    "\U0001f468\u200d\U0001f469",  # joined into one sign
]
BLENDER = {"Software": "Blender 2.83"}


def write_layers(folder: Path, *layers: str) -> Path:
    """A frame with these view layers, of values that tell them apart, as older versions of Blender name passes."""
    folder.mkdir()
    planes: dict[str, Pixels] = {}
    for number, layer in enumerate(layers, start=1):
        planes |= {f"{layer}.Combined.{c}": np.full((12, 16), number / 10, np.float32) for c in "RGBA"}
        planes |= {f"{layer}.Vector.{c}": np.full((12, 16), number, np.float32) for c in "XYZW"}
        planes[f"{layer}.Depth.Z"] = np.full((12, 16), number, np.float32)
    write_image(folder / "x.0001.exr", planes, BLENDER)
    return folder


def told_options(text: str) -> list[str]:
    """The options of the command line in a message, as a shell takes them once they are pasted."""
    (line,) = [line for line in text.splitlines() if "another layer" in line]
    return shlex.split(line[line.index("--input ") :])


def test_a_backslash_that_begins_no_escape_is_one() -> None:
    assert names_in(r'"a\q", b') == [[r"a\q"], ["b"]]


@pytest.mark.parametrize(
    ("colour", "alpha", "depth"),
    [
        ("rgba.{R}", "rgba.A", "depth.Z"),
        ("C.{R}", "C.A", "Pz"),  # Karma
        ("{R}", "A", "Pz.Z"),  # Mantis
        ("Beauty.{R}", "Beauty.A", "Z.Z"),  # Redshift
        ("RGB_color.{R}", "Alpha.Y", "ZDepth.Z"),  # V-Ray
        ("FinalImage.{R}", "FinalImage.A", "WorldDepth.R"),  # Unreal
        ("{r}", "a", "z"),  # as the error advises
        ("{Red}", "Alpha", "Depth"),
        ("BEAUTY.{R}", "ALPHA.R", "DEPTH.Z"),
    ],
)
def test_names_of_tools_that_sign_no_header(colour: str, alpha: str, depth: str, tmp_path: Path) -> None:
    word = colour[colour.index("{") + 1 : -1]
    long = {"Red": ("Red", "Green", "Blue"), "r": ("r", "g", "b")}.get(word, "RGB")
    names = [f"{colour.partition('{')[0]}{letter}" for letter in long]
    values = dict(zip([*names, alpha, depth, "N.X"], np.arange(1, 7, dtype=np.float32) / 8, strict=True))
    write_image(tmp_path / "x.0001.exr", {name: np.full((4, 6), value) for name, value in values.items()})
    (frame,) = open_input(tmp_path, assignments=[] if long == "RGB" else [f"colour.channels={' '.join(names)}"])
    assert frame.alpha is not None
    assert [*frame.colour[0, 0], frame.alpha[0, 0], frame.depth[0, 0]] == [*values.values()][:5]


@pytest.mark.parametrize(
    ("files", "colour", "depth"),
    [
        ({"S.FinalImage": "RGB", "S.SceneColor": "RGB"}, "S.FinalImage.R", None),
        ({"S.FinalImage": "RGB", "S.BaseColor": "RGB", "S.WorldDepth": "R"}, "S.FinalImage.R", "S.WorldDepth.R"),
        ({"Image": "RGB", "DiffColor": "RGB"}, "Image.R", None),
        ({"Color": "RGB", "Normals": "xyz"}, "Color.R", None),
        ({"x": ["R", "G", "B", "BaseColor.R", "BaseColor.G", "BaseColor.B"]}, "R", None),
        ({"x": ["R", "G", "B", "Px", "Py", "Pz", "N.X", "N.Y", "N.Z"]}, "R", None),
        ({"x": ["R", "G", "B", "inverse_depth", "matte_alpha.R", "premultalpha.R"]}, "R", None),
    ],
)
def test_what_only_ends_like_a_picture_or_a_depth_is_none(
    files: dict[str, str | list[str]], colour: str, depth: str | None, tmp_path: Path
) -> None:
    for name, channels in files.items():
        write_image(tmp_path / f"{name}.0001.exr", {channel: np.ones((4, 6), np.float32) for channel in channels})
    sequence = open_input(tmp_path)
    (told,) = [note for note in sequence.notes if note.startswith("channels: ")]
    assert told.startswith(f"channels: colour {colour} ")
    assert told.partition("; depth ")[2] == (depth or "")
    assert "alpha" not in told


@pytest.mark.parametrize("layer", LAYERS)
def test_the_option_that_is_printed_takes_the_other_layer(
    layer: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_layers(tmp_path / "in", "Z", layer)
    assert main(["inspect", str(folder)]) == 0
    pasted = told_options(capsys.readouterr().out)
    assert main(["inspect", str(folder), *pasted]) == 0
    assert "'Z'" not in capsys.readouterr().out
    (frame,) = open_input(folder, assignments=pasted[1:])
    assert frame.alpha is not None
    assert frame.motion is not None
    for found in (frame.colour[0, 0, 0] * 10, frame.alpha[0, 0] * 10, frame.depth[0, 0], frame.motion[0, 0, 0]):
        assert found == pytest.approx(2)
    assert main(["resolve", str(folder), *pasted, "-o", str(tmp_path / "out"), "--device", "numpy"]) == 0
    resolved, _ = read_image(tmp_path / "out" / "x.0001.exr")
    assert f"{layer}.Combined.R" not in resolved
    assert "Z.Combined.R" in resolved
    assert main(["check", str(folder), *pasted]) in (0, 65)
    capsys.readouterr()
    # Errors too are one line, and what they name can be pasted.
    assert main(["inspect", str(folder), "--input", "depth.channels=none of these,Zed"]) == 64
    found = capsys.readouterr().err.partition("(found ")[2].partition("); ")[0]
    assert "Combined.A" in found


def test_the_third_component_of_a_vector_is_a_depth_only_where_it_is_asked_for(tmp_path: Path) -> None:
    folder, profile = tmp_path / "in", tmp_path / "mine.toml"
    folder.mkdir()
    write_image(
        folder / "x.0001.exr", {name: np.ones((4, 4), np.float32) for name in ("R", "G", "B", "Px", "Py", "Pz")}
    )
    intake = open_intake(folder)
    assert "depth" not in intake.roles
    (note,) = [note for note in intake.notes if note.startswith("no depth")]
    pasted = shlex.split(note[note.index("--input") : note.index(", which cltaa check")])[1]
    profile.write_text('[depth]\nchannels = ["Pz"]\n')
    for asked in ({"assignments": [pasted]}, {"profile": profile}):
        assert [place.channel for place in open_intake(folder, **asked).roles["depth"]] == ["Pz"]


@pytest.mark.parametrize("layer", ["Main Layer", "one, two", "[x]*", "all", "*"])
def test_a_channel_is_kept_by_its_name(layer: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_layers(tmp_path / "in", "Z", layer)
    out, kept = tmp_path / "out", written([f"{layer}.Depth.Z"])
    assert main(["resolve", str(folder), "-o", str(out), "--device", "numpy", "--layers", kept]) == 0
    assert f"{layer}.Depth.Z" in read_image(out / "x.0001.exr")[0]
    assert main(["resolve", str(folder), "-o", str(out), "--device", "numpy", "--layers", "no such one"]) == 64
    assert f"(expected {written([min(layer, 'Z') + '.Combined.A'])} " in capsys.readouterr().err


def test_names_with_as_many_spaces_need_no_quotes(tmp_path: Path) -> None:
    folder = write_layers(tmp_path / "in", "BG Layer", "Main Layer")
    names = "Main Layer.Combined.R Main Layer.Combined.G Main Layer.Combined.B"
    roles = open_intake(folder, assignments=[f"colour.channels={names}"]).roles
    assert [place.channel for place in roles["alpha"]] == ["Main Layer.Combined.A"]
    assert [place.channel for place in roles["motion"]] == ["Main Layer.Vector.X", "Main Layer.Vector.Y"]
    depth = open_intake(folder, assignments=["depth.channels=Main Layer.Depth.Z"]).roles["depth"]
    assert depth[0].channel == "Main Layer.Depth.Z"


def test_what_an_option_takes_for_a_colour() -> None:
    for text, expected in [
        ('"a b" c d', [("a b", "c", "d")]),
        ("'a b' c d", [("a b", "c", "d")]),
        ('["a b", "c", "d"]', [("a b", "c", "d")]),
        ('[["a b", "c", "d"], ["R", "G", "B"]]', [("a b", "c", "d"), ("R", "G", "B")]),
        ("R G B, X Y Z", [("R", "G", "B"), ("X", "Y", "Z")]),
        ("[R G B,X Y Z]", [("R", "G", "B"), ("X", "Y", "Z")]),
        ("a x b x c x", [("a x", "b x", "c x")]),
        ('["R G B", "X Y Z"]', [("R", "G", "B"), ("X", "Y", "Z")]),
    ]:
        assert override(Profile(), [f"colour.channels={text}"]).colour.channels == tuple(expected), text


@pytest.mark.parametrize("text", ['"a b', "a b", "a b c d", '"a b" c', '["a", "b"]', "R G B,"])
def test_what_is_no_colour(text: str) -> None:
    with pytest.raises(DataError, match=r"colour\.channels is not 3 names|no such value"):
        override(Profile(), [f"colour.channels={text}"])


NAMES = st.text(st.characters(exclude_categories=["Cc", "Cs", "Zl", "Zp"]), min_size=1, max_size=9)


@given(st.lists(st.lists(NAMES, min_size=3, max_size=3), min_size=1, max_size=3))
def test_names_that_are_written_are_read_again(lists: list[list[str]]) -> None:
    assert names_in(",".join(map(written, lists)), 3) == lists
    assert names_in(" " + written([names[0] for names in lists], ",") + " ") == [[names[0]] for names in lists]
    line = " ".join(written(lists[0]).split())  # as a message has it
    assert names_in(line, 3) == [lists[0]] or re.search(r"[^\S ]", "".join(lists[0]))


@given(colour=st.lists(NAMES, min_size=3, max_size=3), motion=st.lists(NAMES, min_size=2, max_size=2), depth=NAMES)
def test_a_profile_keeps_its_names(colour: list[str], motion: list[str], depth: str) -> None:
    values: dict[str, dict[str, Any]] = {
        "colour": {"channels": [colour]},
        "motion": {"channels": [motion]},
        "depth": {"channels": [depth]},
    }
    made = override(Profile(), assignments_of(values))
    assert (made.colour.channels, made.motion.channels) == ((tuple(colour),), (tuple(motion),))
    assert made.depth.channels == (depth,)
    assert override(Profile(), assignments_of(differences(made, Profile()))) == made


def test_a_file_keeps_its_names(tmp_path: Path) -> None:
    values = {"colour": {"channels": [["Main Layer.R", "a,b", 'c"']]}, "motion": {"channels": [["x y", "z w"]]}}
    made = override(Profile(), assignments_of(values))
    (tmp_path / "made.toml").write_text(toml_text(made), encoding="utf-8")
    again = load_profile(str(tmp_path / "made.toml"))
    assert (again.colour, again.motion) == (made.colour, made.motion)
    text = '[colour]\nchannels = ["A.R", "A.G", "A.B"]\n[motion]\nchannels = ["V L.X", "V L.Y"]\n'
    (tmp_path / "flat.toml").write_text(text, encoding="utf-8")
    flat = load_profile(str(tmp_path / "flat.toml"))
    assert flat.colour.channels == (("A.R", "A.G", "A.B"),)
    assert ("V L.X", "V L.Y") in flat.motion.channels


def test_a_view_may_have_any_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    views = ["left eye", "right.main, 2"]
    planes = {c: np.full((12, 16), 0.1, np.float32) for c in "RGBZ"}
    planes |= {f"{views[1]}.{c}": np.full((12, 16), 0.2, np.float32) for c in "RGBZ"}
    (tmp_path / "in").mkdir()
    write_image(tmp_path / "in" / "x.0001.exr", planes, {"multiView": views})
    (note,) = [line for line in intake_lines(open_intake(tmp_path / "in")) if "several views" in line]
    pasted = shlex.split(note[note.index("--input") :])
    (frame,) = open_input(tmp_path / "in", assignments=pasted[1:])
    assert frame.colour[0, 0, 0] == frame.depth[0, 0] == np.float32(0.2)
    assert main(["inspect", str(tmp_path / "in"), *pasted]) == 0
    capsys.readouterr()
