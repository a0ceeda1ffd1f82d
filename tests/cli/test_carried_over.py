"""What a resolved file keeps of its input: layers, attributes, windows, compression."""

from __future__ import annotations

import shlex
import struct
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from cltaa.cli import main
from cltaa.io.exr_read import read_any_header, read_header, read_image
from cltaa.io.exr_write import write_image
from tests.faults.exr_surgery import dissect
from tests.inputs.foreign import write_blender
from tests.sequence_factory import make_frame, write_sequence

CHROMATICITIES = (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329)


def resolve(folder: Path, *options: str) -> Path:
    out = folder.parent / "out"
    assert main(["resolve", str(folder), "-o", str(out), "--device", "numpy", "--restart", *options]) == 0
    return sorted(out.glob("*.exr"))[-1]


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """Two single-part files with a moved window, other layers, wide primaries and PIZ."""
    (tmp_path / "in").mkdir()
    rng = np.random.default_rng(0)
    corners = (np.array([5, 7], np.int32), np.array([16, 15], np.int32))
    header = {
        "type": OpenEXR.scanlineimage,
        "compression": OpenEXR.PIZ_COMPRESSION,
        "chromaticities": CHROMATICITIES,
        "owner": "somebody",
        "dataWindow": corners,
        "displayWindow": corners,
    }
    for index in range(2):
        channels = {
            name: rng.random((9, 12)).astype(np.float32) for name in ("R", "G", "B", "Z", "diffuse.R", "diffuse.G")
        }
        channels["mask"] = rng.random((9, 12)).astype(np.float16)
        channels["id"] = np.full((9, 12), 2**24 + 1, np.uint32)
        OpenEXR.File(header, channels).write(str(tmp_path / "in" / f"a.{index:04d}.exr"))
    return tmp_path / "in"


def test_other_tools_files_keep_everything(foreign: Path) -> None:
    planes, attributes = read_image(resolve(foreign))
    given, _ = read_image(sorted(foreign.iterdir())[-1])
    assert set(planes) == set(given)
    for name in ("Z", "diffuse.R", "diffuse.G", "mask", "id"):
        assert planes[name].dtype == given[name].dtype
        np.testing.assert_array_equal(planes[name], given[name])
    assert not np.array_equal(planes["R"], given["R"])
    assert attributes["owner"] == "somebody"
    np.testing.assert_allclose(np.array(attributes["chromaticities"]).ravel(), CHROMATICITIES, rtol=1e-7)
    layout = read_header(resolve(foreign)).layout
    assert layout.display_window == layout.data_window == (5, 7, 16, 15)
    assert layout.compression == "piz"


def test_attributes_keep_their_types(foreign: Path) -> None:
    """Other tools look for the standard's attributes by name and type: ``aperture`` as a double is none to them."""
    for path in foreign.iterdir():
        file = dissect(path)
        for name, kind in ((b"aperture", b"float"), (b"dwaCompressionLevel", b"float"), (b"exact", b"double")):
            file.add(name, kind, struct.pack("<f" if kind == b"float" else "<d", 2.8))
        path.write_bytes(file.assembled())
    given, kept = ({entry[0]: entry for entry in dissect(path).attributes} for path in (path, resolve(foreign)))
    for name in (b"aperture", b"dwaCompressionLevel", b"exact", b"pixelAspectRatio", b"owner", b"chromaticities"):
        assert kept[name] == given[name]


@pytest.mark.parametrize("kind", [b"floatvector", b"stringvector"])
def test_a_list_of_nothing_ends_no_run(kind: bytes, foreign: Path) -> None:
    """OpenEXR reads an empty list and cannot write one."""
    for path in foreign.iterdir():
        file = dissect(path)
        file.add(b"nothing", kind, b"")
        path.write_bytes(file.assembled())
    assert read_header(resolve(foreign)).attributes["owner"] == "somebody"


def test_what_nobody_declared_is_not_made_up(foreign: Path) -> None:
    attributes = read_header(resolve(foreign)).attributes
    assert not {"worldToCamera", "cltaa:worldToView", "cltaa:jitterPx"} & set(attributes)
    assert attributes["cltaa:preset"] == "default"


@pytest.mark.parametrize(
    ("layers", "kept"), [("none", set()), ("diffuse.*, id", {"diffuse.R", "diffuse.G", "id"}), ("R", set())]
)
def test_layers_are_chosen(layers: str, kept: set[str], foreign: Path) -> None:
    assert set(read_image(resolve(foreign, "--layers", layers))[0]) == {"R", "G", "B"} | kept


def test_the_alpha_of_another_picture_is_none_of_the_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = [*"RGBA", *(f"Beauty.{c}" for c in "RGB"), "Beauty.glow"]
    (tmp_path / "in").mkdir()
    write_image(tmp_path / "in" / "a.0001.exr", dict.fromkeys(names, np.ones((4, 5), np.float32)))
    asked = ["--input", "colour.channels=Beauty.R Beauty.G Beauty.B", "--input", "colour.alpha=none"]
    assert read_header(resolve(tmp_path / "in", *asked)).layout.channels.keys() == {*"RGB", "Beauty.glow"}
    said = capsys.readouterr().err.replace("\n", " ")
    assert "another picture: R G B left out of results" in said
    option = shlex.split(said.partition("to take it: --input ")[2])[0]
    assert "Beauty.R" in read_header(resolve(tmp_path / "in", "--input", option)).layout.channels
    assert "A" in read_header(resolve(tmp_path / "in", "--input", option, *asked[2:])).layout.channels  # its own


def test_compression_can_be_told(foreign: Path) -> None:
    assert read_header(resolve(foreign, "--compression", "zips")).layout.compression == "zips"


def test_a_compression_that_loses_something_is_not_kept(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.DWAA_COMPRESSION}
    OpenEXR.File(header, {name: np.ones((9, 12), np.float32) for name in "RGB"}).write(str(tmp_path / "in" / "a.0.exr"))
    assert read_header(resolve(tmp_path / "in")).layout.compression == "zip"


def test_parts_become_layers_of_one_part(tmp_path: Path) -> None:
    write_blender(tmp_path / "in", [make_frame(index, motion=True, effects=None) for index in range(2)])
    header = read_any_header(resolve(tmp_path / "in"))
    there = set(header.layout.channels)
    assert {"R", "G", "B", "ViewLayer.Depth.Z", "ViewLayer.Vector.X"} <= there
    assert not any("Combined" in name for name in there)  # who opens the result would take the input for it
    assert header.attributes["Software"] == "Blender 5.0.1"
    assert "name" not in header.attributes
    asked = read_header(resolve(tmp_path / "in", "--layers", "*Combined*")).layout.channels
    assert set(asked) == {"R", "G", "B", *(f"ViewLayer.Combined.{name}" for name in "RGB")}


def test_own_sequences_keep_layers_when_asked(tmp_path: Path) -> None:
    write_sequence(tmp_path / "in", 2)
    assert set(read_image(resolve(tmp_path / "in"))[0]) == {"R", "G", "B"}
    assert set(read_image(resolve(tmp_path / "in", "--layers", "all"))[0]) == {"R", "G", "B", "Z"}


def test_another_way_of_reading_does_not_go_on(foreign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    resolve(foreign)
    again = ["resolve", str(foreign), "-o", str(foreign.parent / "out"), "--device", "numpy"]
    assert main(again) == 0
    assert main([*again, "--input", "colour.encoding=srgb"]) != 0
    assert "profile" in capsys.readouterr().err


def test_another_tools_file_is_decoded_once(foreign: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The layers that a result keeps are those that were decoded with its frame."""

    def again(path: Path, **_: object) -> None:
        raise AssertionError(f"{path} was opened again")

    monkeypatch.setattr("cltaa.pipeline.output.read_planes", again)
    assert {"diffuse.R", "mask", "id"} <= read_image(resolve(foreign))[0].keys()
