"""Declarations compared with the pixels: an effect left out is told. test_detector.py has the sound ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from cltaa.frame import Effect
from cltaa.io.exr_write import write_frame
from cltaa.lab.inspect.findings import inspect_folder
from tests.lab.check.conftest import Scene


@pytest.mark.parametrize(
    ("name", "effect", "told"),
    [
        *(
            (name, Effect.DISOCCLUSION, "something comes into view at frame")
            for name in ("corridor", "occluder", "orbit")
        ),
        *((name, Effect.ILLUMINATION, "colour changes at frame") for name in ("flash", "glints", "shadow")),
    ],
)
def test_what_is_left_out_is_reported(name: str, effect: Effect, told: str, scene: Scene, tmp_path: Path) -> None:
    for frame in scene(name):
        assert frame.effects is not None
        write_frame(tmp_path / f"a.{frame.index:04d}.exr", replace(frame, effects=frame.effects - {effect}))
    assert [problem[: len(told)] for problem in inspect_folder(tmp_path, pixels=True).problems] == [told]
