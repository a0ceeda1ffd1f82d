"""``cltaa demo``: what it leaves, and that it does not draw twice what it has."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from pathlib import Path

import pytest

from cltaa.commands.demo import SETTLED, _capture

FRAMES = SETTLED + 1
LEFT = {"before.png", "after.png", "crop.png", "side-by-side.mp4", "sequence", "resolved"}


def run_demo(folder: Path) -> subprocess.CompletedProcess[str]:
    code = (
        "import sys; from cltaa.cli import main; code = main(sys.argv[1:]);"
        "print('LOADED', *({'OpenGL', 'pyrender', 'pyopencl'} & set(sys.modules)), file=sys.stderr); sys.exit(code)"
    )
    arguments = ["demo", "-o", str(folder), "--scene", "conveyor", "--frames", str(FRAMES), "--size", "64x36", "--json"]
    return subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False)


def stamps(folder: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("*.exr")}


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    folder = tmp_path_factory.mktemp("demo") / "out"
    return folder, run_demo(folder)


def test_the_resolve_is_better_than_one_sample(demo: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    folder, done = demo
    assert done.returncode == 0, done.stderr
    gain = json.loads(done.stdout)
    assert gain["psnr_resolved"] > gain["psnr_one_sample"]
    assert gain["flip_resolved"] < gain["flip_one_sample"]
    assert gain["equal_quality_samples"] > 1
    assert math.isfinite(gain["resolve_ms"])
    assert {path.name for path in folder.iterdir()} == LEFT


def test_what_draws_and_what_resolves_are_two_processes(demo: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    loaded = re.search(r"^LOADED(.*)$", demo[1].stderr, re.MULTILINE)
    assert loaded is not None
    assert loaded[1].split() == ["pyopencl"]


def test_a_second_run_keeps_the_frames(demo: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    folder, _ = demo
    drawn = stamps(folder / "sequence")
    assert len(drawn) == FRAMES
    assert run_demo(folder).returncode == 0
    assert stamps(folder / "sequence") == drawn


def test_frames_of_another_code_are_drawn_again(
    demo: tuple[Path, subprocess.CompletedProcess[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = demo
    drawn = stamps(folder / "sequence")
    (manifest,) = [
        path for path in (folder / "sequence").iterdir() if path.suffix == ".json" and "code" in path.read_text()
    ]
    text = manifest.read_text()
    digest = re.search(r"[0-9a-f]{64}", text[text.index("code") :])
    assert digest is not None
    manifest.write_text(text.replace(digest[0], "0" * 64))
    _capture("conveyor", folder / "sequence", FRAMES, (64, 36), as_json=False)
    assert "captured anew" in capsys.readouterr().err
    assert all(stamps(folder / "sequence")[name] > drawn[name] for name in drawn)


def test_what_the_capture_refuses_is_json_too(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "cltaa", "demo", "-o", str(tmp_path), "--scene", "nope", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == json.loads(done.stdout)["exit_code"] == 64
    assert "no such scene: nope" in json.loads(done.stdout)["error"]
