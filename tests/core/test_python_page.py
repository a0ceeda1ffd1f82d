"""The page about Python runs as it stands."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cltaa
from cltaa.core.frame_checks import check_frame
from cltaa.frame import Frame
from tests.sequence_factory import make_frame, write_sequence

BLOCK = r"^```python\n(.*?)^```$"
PAGE = Path(__file__).parents[2] / "docs" / "python.md"


def test_what_the_page_says_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_sequence(tmp_path / "corridor", 3, reference=True)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    blocks = re.findall(BLOCK, PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)
    assert len(blocks) == 7
    assert names["image"].shape == (23, 37, 3)
    assert set(names["scores"]) == {"mse", "psnr", "ssim", "flip"}
    assert names["scores"]["psnr"] > 0
    assert "no such folder: the folder is missing" in capsys.readouterr().out
    check_from_engine(names["from_engine"])


def test_the_page_names_public_names_alone_and_types_are_right(tmp_path: Path) -> None:
    code = "\n".join(re.findall(BLOCK, PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL))
    assert set(re.findall(r"\bcltaa\.(\w+)", code)) <= {*cltaa.__all__}
    assert "from cltaa" not in code
    page = tmp_path / "page.py"
    page.write_text(code, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--strict", str(page)]
    done = subprocess.run(command, cwd=PAGE.parents[1], stdout=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 0, done.stdout


def check_from_engine(from_engine: Callable[..., Frame]) -> None:
    """What a Direct3D engine with a reversed depth of no end holds of a frame becomes that frame again."""
    frame, near, away = make_frame(motion=True), 0.1, np.diag([1.0, 1.0, -1.0, 1.0])
    view, clip = frame.camera.world_to_view, frame.camera.view_to_clip.copy()
    clip[2] = 0, 0, 0, near  # z in clip space; w is the distance
    assert frame.motion is not None
    found = from_engine(
        frame.index,
        frame.colour,
        near / frame.depth,
        -frame.motion / (frame.width, frame.height),
        (away @ view @ away).T,
        (clip @ away).T,
        frame.jitter_px,
    )
    check_frame(found)
    assert found.motion is not None
    assert (found.camera.world_to_view == view).all()
    assert (found.camera.view_to_clip == clip).all()
    for ours, theirs in ((frame.depth, found.depth), (frame.motion, found.motion)):
        np.testing.assert_allclose(theirs, ours, rtol=2**-23)  # float32 was rounded twice
