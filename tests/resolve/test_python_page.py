"""The page about Python runs as it stands."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from tests.sequence_factory import write_sequence

PAGE = Path(__file__).parents[2] / "docs" / "python.md"


def test_what_the_page_says_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_sequence(tmp_path / "corridor", 3, reference=True)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)
    assert len(blocks) == 3
    assert names["image"].shape == (23, 37, 3)
    assert set(names["scores"]) == {"mse", "psnr", "ssim", "flip"}
    assert names["scores"]["psnr"] > 0
    assert "no such folder: the folder is missing" in capsys.readouterr().out
