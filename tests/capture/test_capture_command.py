"""``cltaa capture`` as a user meets it: output, errors in one line, exit codes, back ends."""

from __future__ import annotations

import ctypes.util
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from cltaa.cli import main
from cltaa.commands import doctor
from cltaa.io.sequence import open_sequence
from cltaa_capture import osmesa
from tests.datasets.gltf_writer import Writer
from tests.sequence_factory import digests

PATIENCE = 600.0  # seconds that a capture of two tiny frames may take, on a machine however busy
TINY = ["--frames", "2", "--size", "32x18", "--jitter", "halton:4"]


def run_alone(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run the command line in a process of its own: PyOpenGL binds to one platform for good."""
    command = [sys.executable, "-m", "cltaa.cli", *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=PATIENCE, env=os.environ | variables
    )


def test_the_summary_is_json_when_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["capture", "conveyor", "-o", str(tmp_path), *TINY, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["drawn"] == len(open_sequence(tmp_path)) == 2
    assert summary["backend"] in ("osmesa", "egl")


def test_a_truth_beside_frames_that_are_there_is_no_frame(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = []
    for more in ([], ["--yardstick", "2"]):
        assert main(["capture", "conveyor", "-o", str(tmp_path), *TINY, *more]) == 0
        said.append(capsys.readouterr().err.splitlines()[-1])
    assert [line.removeprefix(f"{tmp_path}: ").partition(" in ")[0] for line in said] == [
        "2 frames drawn",
        "0 frames drawn, 2 kept, 2 supersampled images drawn",
    ]


def test_nothing_but_what_was_asked_for_on_stdout(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["capture", "conveyor", "-o", str(tmp_path), *TINY]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    assert "conveyor: 2 of 2 frames" in err
    assert "frames/s" in err


def test_a_texture_that_is_missing_is_one_line(tmp_path: Path) -> None:
    """In a process of its own, where no test collects what trimesh logs."""
    header = ["ply", "format ascii 1.0", "comment TextureFile none.png", "element vertex 3"]
    header += [f"property float {axis}" for axis in "xyz"]
    header += ["element face 1", "property list uchar int vertex_indices", "end_header"]
    (tmp_path / "a.ply").write_text("\n".join([*header, "0 0 0", "1 0 0", "0 1 0", "3 0 1 2", ""]))
    done = run_alone("capture", f"file:{tmp_path / 'a.ply'}", "-o", str(tmp_path / "out"))
    line = f"cltaa: error: {tmp_path / 'a.ply'}: there is no none.png beside the model; copy it there\n"
    assert (done.returncode, done.stderr) == (66, line)


def test_no_opengl_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delitem(sys.modules, "OpenGL", raising=False)
    monkeypatch.setattr(osmesa, "LIBRARIES", {"OSMesa": ("libOSMesa.so.none",), "EGL": ("libEGL.so.none",)})
    assert main(["capture", "conveyor", "-o", str(tmp_path), *TINY]) == 69
    said = capsys.readouterr().err
    cures = f"{doctor.OSMESA_CURE} {doctor.EGL_CURE}".replace("sudo apt-get install -y", "")
    assert not [package for package in cures.split() if package not in said.replace(",", "").split()]


def drawn_on(backend: str, folder: Path, **variables: str) -> dict[str, str]:
    """Digests of the frames that a process of its own draws on a back end."""
    arguments = ["capture", "conveyor", "-o", str(folder), *TINY, "--backend", backend, "--json"]
    done = run_alone(*arguments, **variables)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["backend"] == backend
    return digests(folder)


@pytest.fixture(scope="module")
def on_egl(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return drawn_on("egl", tmp_path_factory.mktemp("surfaceless"))


@pytest.mark.skipif(
    not (ctypes.util.find_library("OSMesa") and ctypes.util.find_library("EGL")),
    reason="needs both OSMesa and EGL on this machine",
)
def test_both_back_ends_draw_the_same_bits(on_egl: dict[str, str], tmp_path: Path) -> None:
    assert drawn_on("osmesa", tmp_path) == on_egl


@pytest.mark.skipif(not ctypes.util.find_library("EGL"), reason="needs EGL on this machine")
def test_egl_without_a_surfaceless_display_draws_on_a_device(on_egl: dict[str, str], tmp_path: Path) -> None:
    # As NVIDIA's driver has it: displays of devices alone. No platform has the number 0.
    program = (
        "import sys; from cltaa.cli import main; from cltaa_capture import osmesa; "
        "osmesa.EGL_PLATFORM_SURFACELESS_MESA = 0; sys.exit(main(sys.argv[1:]))"
    )
    arguments = ["capture", "conveyor", *TINY, "--backend", "egl", "-o"]
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments, str(tmp_path / "device")],
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE,
    )
    assert done.returncode == 0, done.stderr
    assert digests(tmp_path / "device") == on_egl
    assert drawn_on("egl", tmp_path / "named", EGL_DEVICE_ID="0") == on_egl


@pytest.mark.skipif(not ctypes.util.find_library("EGL"), reason="needs EGL on this machine")
def test_a_card_that_egl_does_not_know_is_refused(tmp_path: Path) -> None:
    program = (
        "import os, sys; from cltaa.cli import main\n"
        "for os.environ['EGL_DEVICE_ID'] in ('99', 'one'): assert main(sys.argv[1:]) == 64"
    )
    arguments = ["capture", "conveyor", *TINY, "--backend", "egl", "-o", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=False, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("EGL_DEVICE_ID names no device of EGL (expected 0 to ") == 2
    assert not list(tmp_path.glob("*.exr"))


@pytest.mark.parametrize("motion", ["turntable", "orbit"])
def test_a_model_from_a_file_is_captured(tmp_path: Path, motion: str) -> None:
    cone: Any = trimesh.creation.cone(1.0, 2.0)
    cone.visual.vertex_colors = np.where(cone.vertices[:, :1] > 0.0, [220, 40, 20, 255], [20, 40, 220, 255])
    cone.scene().export(tmp_path / "cone.glb")
    folder = tmp_path / "out"
    assert main(["capture", f"file:{tmp_path / 'cone.glb'}", "-o", str(folder), *TINY, "--motion", motion]) == 0
    found = open_sequence(folder)
    assert found.name == "cone"
    assert (found.frame(0).motion is not None) == (motion == "turntable")
    assert found.frame(0).colour.std() > 0.05  # there is something to see


def test_a_see_through_model_has_a_reactive_channel(tmp_path: Path) -> None:
    writer = Writer(nodes=[{"mesh": 0}], materials=[{"alphaMode": "BLEND"}])
    writer.json["materials"][0]["pbrMetallicRoughness"] = {"baseColorFactor": [0.2, 0.5, 0.9, 0.5]}
    writer.json["meshes"] = [{"primitives": [writer.square(material=0)]}]
    pane = writer.write(tmp_path / "pane.glb")
    assert main(["capture", f"file:{pane}", "-o", str(tmp_path / "out"), *TINY]) == 0
    frame = open_sequence(tmp_path / "out").frame(1)
    assert frame.reactive is not None
    assert 0.0 < frame.reactive.mean() < 0.5
    assert frame.reactive.max() <= 1.0
