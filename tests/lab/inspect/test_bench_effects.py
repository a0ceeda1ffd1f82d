"""``cltaa bench effects`` on sequences made here: bits, replaced estimates, and a table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame
from cltaa.io.exr_write import write_frame
from cltaa.io.sequence import FrameSequence, open_sequence
from cltaa.lab.inspect import plan as module
from cltaa.lab.inspect.plan import EffectRow, effect_cells, judge_effects
from cltaa.reference.launcher import NumpyLauncher
from tests.sequence_factory import make_camera, make_frame


def captured(folder: Path, declared: set[Effect], *, moving: bool = False) -> FrameSequence:
    for index in range(3):
        camera = make_camera((0.1 * index * moving, 0.0, 5.0))
        frame = make_frame(index, camera=camera, effects=frozenset(declared))
        write_frame(folder / f"synthetic.{index:04d}.exr", frame)
    return open_sequence(folder)


def judged(sequence: FrameSequence, preset: str = "default") -> EffectRow:
    return judge_effects(sequence, preset, NumpyLauncher(), rounds=3)


def test_a_still_scene_needs_no_step(tmp_path: Path) -> None:
    row = judged(captured(tmp_path, set()))
    assert row.same_bits
    assert row.steps == []
    assert row.replaced > 0.0  # random frames: their plain mean is not their rectified one
    assert min(row.planned_ms, row.every_ms, row.all_ms) > 0.0


def test_a_scene_that_calls_for_what_it_gets(tmp_path: Path) -> None:
    declared = {Effect.CAMERA, Effect.HDR, Effect.ILLUMINATION, Effect.DISOCCLUSION}
    row = judged(captured(tmp_path, declared, moving=True), "fast")
    assert row.same_bits
    assert row.replaced == 0.0
    assert row.steps == ["reprojection", "rectification", "luminance weights"]
    found = effect_cells(row)
    assert (found["scene"], found["effects"]) == ("synthetic", "camera disocclusion hdr illumination")
    assert found["steps that run"] == "reprojection, rectification, luminance weights"
    assert (found["same bits"], found["replaced"]) == ("yes", "nothing")


def test_a_step_that_changes_a_bit_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Tainted(Resolver):
        def resolve(self, frame: Frame, **options: Any) -> Any:
            image = super().resolve(frame, **options)
            return image + np.float32(2.0**-20 if self.every_step else 0.0)

    monkeypatch.setattr(module, "Resolver", Tainted)
    row = judged(captured(tmp_path, {Effect.CAMERA, Effect.HDR}))
    assert not row.same_bits
    assert effect_cells(row)["same bits"] == "**no**"
