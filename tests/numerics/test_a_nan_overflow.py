"""Failure modes of NaN, infinity and overflow: docs/numerics.md, A."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from cltaa.core.build import Build, Steps, settings_record, source_hash
from cltaa.core.constants import value
from cltaa.core.parameters import (
    Box,
    Choices,
    HistoryKind,
    Illumination,
    Neighbourhood,
    Settings,
)
from cltaa.core.planes import Layout
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.errors import InternalError
from cltaa.frame import Effect, Frame, Image
from cltaa.opencl.device import Kernel
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.reference.disocclusion import on_screen
from cltaa.reference.launcher import NumpyLauncher
from cltaa.reference.neighbourhood import Statistics
from cltaa.reference.real import Run
from cltaa.reference.rectify import neighbourhood_box
from cltaa.reference.reprojection import Motion
from cltaa.reference.sampling import footprint_of
from tests.kernels.hard_planes import padded
from tests.kernels.stage_chain import chain_work, differing, hard_work, run_stage
from tests.kernels.test_resolve import turned
from tests.numerics.kernel_text import calls_of, kernel_files
from tests.sequence_factory import EVERY_CHANNEL, any_bits, bits, make_frame

WIDTH, HEIGHT = 48, 40
ROW, COLUMN = 20, 24
BAD = [np.nan, -np.inf, 1e30]
NO_LIGHT = frozenset({Effect.DISOCCLUSION, Effect.HDR})  # light that changes is not tested for


def moving(index: int, effects: frozenset[Effect] | None = None) -> Frame:
    """Random colour on a surface that moves by a fraction of a pixel, so that every filter tap counts."""
    frame = make_frame(index, width=WIDTH, height=HEIGHT, effects=effects, camera=turned(0, WIDTH, HEIGHT))
    return replace(
        frame,
        depth=np.full_like(frame.depth, 4.0),
        motion=np.broadcast_to(np.array([0.3, 0.2], np.float32), (HEIGHT, WIDTH, 2)),
    )


def with_texel(frame: Frame, colour: Any) -> Frame:
    changed = frame.colour.copy()
    changed[ROW, COLUMN] = colour
    return replace(frame, colour=changed)


def mean_of_neighbours(image: Image) -> Image:
    """What a bad texel becomes: the mean of the other eight, summed row by row."""
    total = np.zeros(3, np.float32)
    for y in (ROW - 1, ROW, ROW + 1):
        for x in (COLUMN - 1, COLUMN, COLUMN + 1):
            if (y, x) != (ROW, COLUMN):
                total = total + image[y, x]
    return total / np.float32(8.0)


@pytest.mark.parametrize("effects", [None, NO_LIGHT], ids=["undeclared", "no light"])
@pytest.mark.parametrize("when", [0, 3])
@pytest.mark.parametrize("bad", BAD)
def test_a1_nan_dies_in_its_own_frame(
    launcher: DeviceLauncher, bad: float, when: int, effects: frozenset[Effect] | None
) -> None:
    # From the first frame on with every step, later as planned.
    ill, mended, sound = (Resolver(device=launcher, strict=True, every_step=when == 0) for _ in range(3))
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    distance = np.maximum(np.abs(y - ROW), np.abs(x - COLUMN))
    for index in range(when + 8):
        frame = moving(index, effects)
        own = index == when
        resolved = ill.resolve(with_texel(frame, (1.0, bad, 0.5)) if own else frame)
        assert np.isfinite(resolved).all()
        # Around it everything is as if the texel had been what its neighbours are; its own sample is missing, and what
        # it has instead of that goes where a filter carries it.
        others = distance > 3 * max(index - when, 0)
        healed = mended.resolve(with_texel(frame, mean_of_neighbours(frame.colour)) if own else frame)
        assert np.array_equal(bits(resolved)[others], bits(healed)[others])
        # The 3x3 around it in its own frame; later its place, as far as a filter of 3 texels a frame can carry it.
        touched = (bits(resolved) != bits(sound.resolve(frame))).any(axis=-1)
        assert distance[touched].max(initial=0) <= 1 + 3 * max(index - when, 0)
        assert touched.any() == (index >= when)
    assert ill.plan is not None
    assert (ill.plan.choices.illumination is Illumination.TEST) == (effects is None)


@pytest.mark.filterwarnings("ignore::cltaa.core.frame_checks.MeaninglessNumbers")
@pytest.mark.parametrize("history", list(HistoryKind))
@pytest.mark.parametrize("lanes", [pytest.param(0, marks=pytest.mark.optimised), 1])
def test_a1_any_bits_of_input_give_finite_output(launcher: DeviceLauncher, lanes: int, history: HistoryKind) -> None:
    preset = override(load_preset(), {"history": history})
    for seed in range(4):
        random = np.random.default_rng(seed)
        resolver = Resolver(preset, launcher, build=Build(lanes=lanes))  # the fast build: a CPU's and a GPU's

        for index in range(4):
            camera = turned(index, WIDTH, HEIGHT)
            frame = make_frame(index, width=WIDTH, height=HEIGHT, camera=camera, effects=None, **EVERY_CHANNEL)
            names = ("colour", "depth", *EVERY_CHANNEL)
            channels: dict[str, Any] = {name: any_bits(random, getattr(frame, name)) for name in names}
            assert np.isfinite(resolver.resolve(replace(frame, **channels))).all(), seed
            assert resolver.plan is not None, seed
            assert resolver.plan.choices.history is history, seed


NOT_FOR_REALS = ("f?max", "f?min", "clamp", "mix", "fdim", "step", "smoothstep", "isnan", "isinf", "isfinite")


def test_a2_no_float_builtin_is_used_against_nan() -> None:
    # max, min and clamp are undefined for NaN in OpenCL C, and isnan may be folded to 0. fmax and fmin are not, and are
    # what greater and lesser of a GPU's fast build come to.
    found = {name: calls_of(text, *NOT_FOR_REALS) for name, text in kernel_files().items()}
    assert {name: calls for name, calls in found.items() if calls} == {"platform/real.h": ["fmax(", "fmin("]}


def test_a2_the_search_finds_what_it_looks_for() -> None:
    assert calls_of("v = max (0.0f, v); // min(a, b)\nw = clamp(v, lo, hi); s.max(1)", *NOT_FOR_REALS) == [
        "max (",
        "clamp(",
    ]


@pytest.mark.parametrize("box", list(Box))
def test_a2_no_box_is_inside_out(box: Box) -> None:
    for neighbourhood in Neighbourhood:
        build = Build(choices=Choices(box=box, neighbourhood=neighbourhood), steps=Steps(alpha=True, reactive=True))
        work = hard_work(160, 120)
        written = run_stage("neighbourhood_statistics", build, work, NumpyLauncher())["statistics_out"]
        s = work.layout.inside(written)
        near = Statistics(s[0:3], s[3:6], s[6:9], s[9:12])
        for gamma in (0.0, 1e-6, 1.0):
            run = Run(build, work.layout, settings=settings_record(Settings(box_floor=0.0)))
            made = neighbourhood_box(near, np.full_like(s[0], gamma), run)
            assert all((extent >= 0).all() for extent in made.extent), neighbourhood


class Flagged(Build, frozen=True, kw_only=True):
    """A build with more compiler options."""

    more: tuple[str, ...] = ()

    def flags(self) -> tuple[str, ...]:
        return (*Build.flags(self), *self.more)


class FlaggedLauncher(DeviceLauncher):
    """A device whose compiler gets more options."""

    def __init__(self, *more: str) -> None:
        super().__init__()
        self.more = more

    def kernel(self, name: str, build: Build) -> Kernel:
        fields = {field: getattr(build, field) for field in Build.__struct_fields__}
        return super().kernel(name, Flagged(**fields, more=self.more))


def test_a3_fast_math_is_refused() -> None:
    with pytest.raises(InternalError, match="does not build"):
        Resolver(device=FlaggedLauncher("-cl-fast-relaxed-math")).resolve(moving(0))


@pytest.mark.optimised
def test_a3_finite_math_is_refused_or_outlived() -> None:
    # A compiler that tells of the flag stops; one that does not has to keep the guards.
    careless, twin = Resolver(device=FlaggedLauncher("-cl-finite-math-only"), strict=True), Resolver(device="numpy")
    for index in range(3):
        frame = moving(index)
        frame.colour[::7, ::5] = np.resize(np.array(BAD, np.float32), frame.colour[::7, ::5].shape)
        try:
            resolved = careless.resolve(frame)
        except InternalError as refused:
            assert "finite-math flags remove the guards" in str(refused)  # noqa: PT017
            return
        assert np.array_equal(bits(resolved), bits(twin.resolve(frame)))


@pytest.mark.optimised
def test_a3_the_relaxed_build_is_asked_for_by_name() -> None:
    # It is timed by cltaa bench accuracy; its picture differs by rounding, on frames that hold what numbers are.
    # With every step there is one program of each for all frames.
    relaxed, plain = (Resolver("basic", build=Build(relaxed=how, lanes=8), every_step=True) for how in (True, False))
    for index in range(3):
        frame = moving(index)
        a, b = relaxed.resolve(frame), plain.resolve(frame)
    assert relaxed.last is not None
    assert "-cl-fast-relaxed-math" in relaxed.last.build.flags()
    apart = np.abs(a - b) / np.abs(b).max()
    assert (apart <= 2.0**-16).mean() > 0.999


def test_a3_the_options_are_part_of_what_is_built() -> None:
    build = Build(lanes=1, rows=1)
    assert source_hash("resolve", build) != source_hash("resolve", msgspec.structs.replace(build, strict=True))
    assert not [flag for flag in (*build.flags(), *Build(strict=True).flags()) if "fast" in flag or "finite" in flag]


@pytest.mark.parametrize("rectify", ["clamp", "clip", "ellipsoid"])
def test_a5_the_largest_numbers_give_finite_output(rectify: str) -> None:
    # Nine squares of the largest usable number stay below the largest float32; what is larger is repaired.
    limit = value("DOMAIN_LIMIT")
    large = np.array([0.99 * limit, -0.99 * limit, limit, 1.01 * limit, 1e20, 3e38, -3e38, 0.0, 1.0], np.float32)
    for box in Box:
        resolver = Resolver(override(load_preset(), {"box": box, "rectify": rectify}), "numpy")
        for index in range(4):
            random = np.random.default_rng(index)
            frame = moving(index)
            with np.errstate(all="raise", under="ignore"):
                resolved = resolver.resolve(replace(frame, colour=random.choice(large, frame.colour.shape)))
            assert np.isfinite(resolved).all(), box
            # YCoCg and back, clamped a channel: at most half as much again.
            assert np.abs(resolved).max() <= 1.6 * limit, box


def motions(layout: Layout, seed: int) -> Iterator[Image]:
    """Displacements of any bits, and of any size around the edges of the image."""
    random = np.random.default_rng(seed)
    shape = (2, layout.height, layout.width)
    yield random.integers(0, 2**32, shape, np.uint32).view(np.float32)
    yield random.uniform(-2, 2, shape).astype(np.float32) * np.float32(max(layout))
    special = [np.nan, np.inf, -np.inf, 1e7, 2.0**31, 2.0**63, -(2.0**31), 0.5, -0.5, np.nextafter(0.5, 1)]
    yield random.choice(special, shape).astype(np.float32)
    y, x = np.mgrid[: layout.height, : layout.width]
    ends = random.choice([-0.5, layout.width - 0.5], shape[1:]) - x, random.choice([-0.5, layout.height - 0.5]) - y
    yield np.nextafter(np.array(ends, np.float32), random.choice([-9, 9], shape).astype(np.float32))


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (17, 13), (300, 4)])
def test_a6_no_displacement_reads_outside_the_planes(size: tuple[int, int]) -> None:
    layout = Layout(*size)
    for seed in range(20):
        for u, v in motions(layout, seed):
            m = Motion(u, v, u, v, np.ones(u.shape, bool))
            with np.errstate(all="ignore"):
                f = footprint_of(m, on_screen(m, layout), layout)
            # The widest filter reads 2 texels before and 3 behind, and lanes that lie close together one more.
            assert f.row.min() >= 2
            assert f.row.max() + 4 < layout.rows
            assert f.column.min() >= 2
            assert f.column.max() + 4 < layout.stride
            assert ((f.fx >= 0) & (f.fx <= 1) & (f.fy >= 0) & (f.fy <= 1)).all()


@pytest.mark.parametrize("lanes", [1, 8])
def test_a6_any_displacement_reads_what_its_twin_reads(launcher: DeviceLauncher, lanes: int) -> None:
    base = chain_work()
    build = Build(steps=Steps(alpha=True, reactive=True), strict=True, lanes=lanes, rows=1)
    for motion in motions(base.layout, 1):
        moved = base.planes["motion_out"].copy()
        moved[:2] = padded(motion, base.layout)
        work = replace(base, planes={**base.planes, "motion_out": moved})
        ours, theirs = (run_stage("sample_history", build, work, where) for where in (launcher, NumpyLauncher()))
        assert differing(work, ours, theirs) == 0


@pytest.mark.parametrize("lanes", [1, 8])
def test_a1_filtered_history_that_is_not_finite_is_dropped(launcher: DeviceLauncher, lanes: int) -> None:
    # Nothing stores such history; were it there, no tap of it might pass. Between texels all taps are read.
    base, random = chain_work(), np.random.default_rng(9)
    history, moved = base.planes["history"].copy(), base.planes["motion_out"].copy()
    bad = random.random(history[0].shape) < 0.01
    history[:, bad] = random.choice([np.nan, np.inf, -np.inf, 1e30], int(bad.sum()))
    moved[:2] = np.array([0.3, -0.4], np.float32)[:, None, None]
    work = replace(base, planes={**base.planes, "history": history, "motion_out": moved})
    build = Build(steps=Steps(alpha=True, reactive=True), strict=True, lanes=lanes, rows=1)
    ours, theirs = (
        work.layout.inside(run_stage("sample_history", build, work, where)["history_at"])
        for where in (launcher, NumpyLauncher())
    )
    usable = theirs[7] > 0.5
    assert usable.any()
    assert np.array_equal(ours[7], theirs[7])
    assert np.array_equal(bits(ours[:, usable]), bits(theirs[:, usable]))
    # The rest is not looked at; where a segment lies outside the image not all of its taps are read.
    assert (np.abs(ours[:3, usable]) <= value("DOMAIN_LIMIT") * work.frame["exposure_ratio"]).all()
    assert (~usable & ~(np.abs(theirs[0]) <= value("DOMAIN_LIMIT"))).sum() > 50


def test_a7_no_image_no_sampler() -> None:
    # What a sampler gives for NaN, and how precisely it filters, is not defined.
    words = ("image2d_t", "sampler_t", "read_image", "write_image")
    assert [(name, word) for name, text in kernel_files().items() for word in words if word in text] == []
