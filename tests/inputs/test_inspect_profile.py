"""``cltaa inspect --profile`` on files of another tool."""

from __future__ import annotations

import json
from pathlib import Path

from click.testing import CliRunner

from cltaa.cli import root

BLENDER = Path(__file__).parents[1] / "thirdparty" / "recorded" / "blender"


def test_it_says_how_blender_would_be_read() -> None:
    done = CliRunner().invoke(root, ["inspect", str(BLENDER), "--json"])
    found = json.loads(done.stdout)
    assert done.exit_code == 0
    assert (found["profile"], found["frames"], found["width"], found["height"]) == ("blender", 6, 64, 36)
    assert found["channels"]["motion"] == ["ViewLayer.Vector.X", "ViewLayer.Vector.Y"]
    assert "ViewLayer.Vector.Z" in found["unused"]
    assert [note.split(":")[0] for note in found["notes"]] == ["no matrices", "no jitter"]


def test_it_prints_a_table_and_takes_a_side_file() -> None:
    arguments = ["inspect", str(BLENDER), "--profile", "blender", "--camera", str(BLENDER / "camera.json")]
    done = CliRunner().invoke(root, arguments)
    assert done.exit_code == 0
    assert "ViewLayer.Depth.Z" in done.stdout
    assert "without" not in done.stdout
