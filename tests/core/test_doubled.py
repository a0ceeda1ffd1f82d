"""A history at 200 %: four texels a pixel, each at its own place, resampled with half the blur."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cltaa.core.backend import Buffer
from cltaa.core.bands import BandedResolver
from cltaa.core.buffers import Buffers
from cltaa.core.build import Storage
from cltaa.core.parameters import HistoryOf, Settings
from cltaa.core.plan import plan_frame
from cltaa.core.planes import Layout
from cltaa.core.presets import Preset, load_preset, override
from cltaa.core.record import axis_masses
from cltaa.core.resolver import Resolver
from cltaa.errors import ResourceError, UsageError
from cltaa.frame import Effect, Frame
from cltaa.pipeline.checkpoint import Checkpoints
from cltaa.pipeline.memory import PlanesHeld, device_bytes
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.test_resolve import differing, hard_frames
from tests.sequence_factory import bits, make_camera, make_frame

DOUBLED: dict[str, object] = {"history_of": "doubled"}


def doubled(**changes: object) -> Preset:
    return override(load_preset(), DOUBLED | changes)


def moving(count: int, **options: object) -> list[Frame]:
    camera = [make_camera((0.05 * index, 0.0, 5.0)) for index in range(count)]
    return [make_frame(index, camera=camera[index], effects=None, **options) for index in range(count)]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "changes",
    [
        {"rectify": "none", "reject": "none", "accumulate": "exponential"},
        {"history_filter": "lanczos-3", "off_screen": "edge", "alpha_from": "current"},
        {"tonemap": "peak", "rectify": "ellipsoid", "box": "variance", "history_filter": "catmull-rom-5"},
    ],
)
@pytest.mark.parametrize("lanes", [1, 8])
def test_strict_kernel_is_its_twin(changes: dict[str, object], lanes: int) -> None:
    assert differing(DOUBLED | changes, list(hard_frames(count=4)), lanes, 7) == 0


def test_a_constant_image_keeps_its_bits_whatever_moves() -> None:
    resolver, value = Resolver(doubled(history_filter="lanczos-3")), np.float32(0.1)
    for frame in moving(8):
        resolved = resolver.resolve(replace(frame, colour=np.full_like(frame.colour, value)))
        assert (bits(resolved) == bits(np.full_like(resolved, value))).all()


def test_a_first_frame_is_what_was_drawn() -> None:
    (frame,) = moving(1)
    assert (bits(Resolver(doubled()).resolve(frame)) == bits(frame.colour)).all()


def test_a_sample_counts_for_more_the_nearer_its_texel() -> None:
    settings = Settings(texel_falloff=8.0)
    places = np.linspace(-0.5, 0.5, 11)
    left, right = np.array([axis_masses(place, settings) for place in places]).T
    assert left == pytest.approx(np.exp(-8.0 * (places + 0.25) ** 2))
    assert right == pytest.approx(left[::-1])
    assert all(a <= b for a, b in pairwise(right[places <= 0.25]))


def test_samples_in_one_corner_change_their_texel_alone() -> None:
    # Every sample is drawn in the upper left texel; from the second frame on they say 1 instead of 0.
    resolver = Resolver(doubled(rectify="none", reject="none", weighting="none", texel_falloff=16.0), NumpyLauncher())
    still = [make_frame(index, effects=None, camera=make_camera(), jitter_px=(-0.25, -0.25)) for index in range(9)]
    for frame in still:
        resolved = resolver.resolve(replace(frame, colour=np.full_like(frame.colour, float(frame.index > 0))))
    # It was drawn with mass 1, the texels beside with e^-4 and e^-8: the same for old and new, so all hold 8 of 9.
    assert resolved == pytest.approx(np.float32(8 / 9), abs=1e-6)
    elsewhere = replace(make_frame(9, effects=None, camera=make_camera(), jitter_px=(0.25, 0.25)))
    resolved = resolver.resolve(replace(elsewhere, colour=np.zeros_like(elsewhere.colour)))
    # The lower right texel has held 9 e^-8 of mass and gets 1; each of the four goes to (8/9) n / (n + m).
    held, mass = 9 * np.exp([0.0, -4.0, -4.0, -8.0]), np.exp([-8.0, -4.0, -4.0, 0.0])
    assert resolved == pytest.approx(np.float32(np.mean(8 / 9 * held / (held + mass))), abs=1e-6)


def test_detail_that_moves_is_blurred_less_than_at_100_percent() -> None:
    # Stripes two pixels wide that move by 0.3 pixels a frame, sampled at their pixels' centres, so that nothing but
    # resampling tells the two apart.
    def stripes(index: int) -> Frame:
        frame = make_frame(index, width=64, height=24, effects=None, camera=make_camera(), motion=True)
        wave = np.sin(np.pi / 2 * (np.arange(64) + 0.5 - 0.3 * index)).astype(np.float32)
        colour = np.broadcast_to(0.5 + 0.4 * wave[None, :, None], frame.colour.shape)
        motion = np.broadcast_to(np.array([-0.3, 0.0], np.float32), (*colour.shape[:2], 2))
        return replace(frame, colour=colour.copy(), motion=motion.copy(), jitter_px=(0.0, 0.0))

    frames, errors = [stripes(index) for index in range(12)], {}
    for size in ("result", "doubled"):
        changes = {"history_of": size, "rectify": "none", "reject": "none", "weighting": "none", "resample_cost": 0.0}
        resolver = Resolver(override(load_preset(), {**changes, "filter_use": "always", "current_filter": "none"}))
        resolved = [resolver.resolve(frame) for frame in frames][-1]
        errors[size] = float(np.abs(resolved - frames[-1].colour)[8:16, 16:48].mean())
    assert errors["doubled"] < 0.5 * errors["result"]


@pytest.mark.parametrize("storage", [Storage.FLOAT, Storage.HALF])
@pytest.mark.parametrize("alpha", [False, True], ids=["opaque", "alpha"])
def test_a_run_goes_on_after_its_checkpoint_with_the_same_bits(tmp_path: Path, storage: Storage, alpha: bool) -> None:
    frames, whole, first = (
        moving(6, alpha=alpha),
        Resolver(doubled(), storage=storage),
        Resolver(doubled(), storage=storage),
    )
    expected = [whole.resolve(frame) for frame in frames][3:]
    for frame in frames[:3]:
        first.resolve(frame)
    Checkpoints(tmp_path, "key").save(first)
    other = Resolver(doubled(), storage=storage)
    assert Checkpoints(tmp_path, "key").restore(other, before=6) == 2
    for frame, image in zip(frames[3:], expected, strict=True):
        assert (bits(other.resolve(frame)) == bits(image)).all()


def test_a_history_at_200_percent_begins_anew_after_frames_that_left_none() -> None:
    frames, still = moving(6), frozenset({Effect.SKY})
    resolver = Resolver(doubled())
    for frame in frames[:3]:
        resolver.resolve(replace(frame, effects=still))
    assert resolver.plan is not None
    assert resolver.plan.choices.history_of is HistoryOf.RESULT
    anew = Resolver(doubled())
    resolver.resolve(frames[3])
    assert resolver.last is not None
    assert resolver.last.arguments["frame"]["reset"] == 1
    anew.resolve(replace(frames[3], cut=True))
    for frame in frames[4:]:
        assert (bits(resolver.resolve(frame)) == bits(anew.resolve(frame))).all()


def test_light_that_changes_and_what_stands_still_are_resolved_at_100_percent() -> None:
    frame, camera, preset = make_frame(1), make_camera(), load_preset("t3-200")
    for effects, expected in (
        (None, HistoryOf.DOUBLED),
        ({Effect.CAMERA, Effect.UNCOVER}, HistoryOf.DOUBLED),
        ({Effect.CAMERA, Effect.SHADING}, HistoryOf.RESULT),
        ({Effect.SKY}, HistoryOf.RESULT),
    ):
        planned = plan_frame(preset, replace(frame, effects=None if effects is None else frozenset(effects)), camera)
        assert planned.choices.history_of is expected
        assert [r.on for r in planned.reasons if r.step == "history at 200 %"] == [expected is HistoryOf.DOUBLED]


@pytest.mark.parametrize("alpha", [False, True], ids=["opaque", "alpha"])
def test_its_memory_is_what_the_formula_says(alpha: bool) -> None:
    class Counting(NumpyLauncher):
        bytes = 0

        def allocate(self, shape: tuple[int, ...], dtype: Any = np.float32) -> Buffer:
            self.bytes += int(np.prod(shape)) * np.dtype(dtype).itemsize
            return super().allocate(shape, dtype)

    launcher = Counting()
    resolver = Resolver(doubled(), launcher)
    frame = moving(1, alpha=alpha)[0]
    resolver.resolve(frame)
    assert resolver.plan is not None
    assert launcher.bytes == device_bytes(frame.width, frame.height, PlanesHeld(resolver.plan.steps, doubled=True))


def test_an_image_that_kernels_cannot_step_over_is_refused_in_one_line() -> None:
    class Nowhere(NumpyLauncher):
        def allocate(self, shape: tuple[int, ...], dtype: Any = np.float32) -> Buffer:
            return super().allocate((0,))

    buffers = Buffers(Nowhere(), Layout(32768, 16384), alpha=False, dtype=np.float32)
    with pytest.raises(ResourceError, match=r"too large for a history at 200 % .*found 32768 x 16384") as raised:
        buffers.texels()
    assert "\n" not in str(raised.value)


def test_bands_are_refused_in_one_line() -> None:
    with pytest.raises(UsageError, match="keeps its history at 200 %, so it resolves whole images only") as raised:
        BandedResolver(doubled(), band_rows=64)
    assert "\n" not in str(raised.value)
