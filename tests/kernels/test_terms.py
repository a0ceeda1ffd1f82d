"""What a build knows beforehand, terms that the settings make nothing of and the size of planes, changes no bit."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from cltaa.core.build import Build, Terms
from cltaa.core.parameters import Settings
from cltaa.core.planes import Layout
from cltaa.core.presets import load_preset
from cltaa.core.resolver import Resolver
from cltaa.opencl.device import Device
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.opencl.shape import LEAST_ROWS, NVIDIA, Cut, Shape
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.hard_planes import Planes
from tests.kernels.stage_chain import ALL_STEPS, Work, differing, hard_work, run_stage
from tests.sequence_factory import make_frame

WIDTH, HEIGHT = 45, 23
ROWS = 4
# No term comes to something.
NOTHING = Settings(
    resampling_penalty=0.0,
    box_scale_static=1.25,
    box_scale_moving=1.25,
    disocclusion_blur=0.0,
    first_samples=1.0,
    luma_scale=1.0,
    box_leak=0.0,
    covered_share=1.0,
)
NONE = Terms(**dict.fromkeys(Terms.__struct_fields__, False))


def work_with(settings: Settings) -> Work:
    return hard_work(WIDTH, HEIGHT, seed=5, settings=settings)


def resolved(work: Work, build: Build, launcher: DeviceLauncher | NumpyLauncher) -> Planes:
    return run_stage("resolve", build, work, launcher)


def strict(lanes: int) -> Build:
    return Build(steps=ALL_STEPS, strict=True, lanes=lanes, rows=ROWS)


def test_a_build_that_no_plan_decided_has_every_term() -> None:
    """So tests of stages, which have such builds, compile them all."""
    assert Build().terms == Terms(**dict.fromkeys(Terms.__struct_fields__, True))


@pytest.mark.parametrize("lanes", [1, 8])
def test_terms_that_come_to_nothing_are_left_out_without_a_trace(lanes: int) -> None:
    work, build = work_with(NOTHING), strict(lanes)
    assert Terms.of(NOTHING) == NONE
    less = replace(build, terms=NONE)
    with_them, without = (resolved(work, how, DeviceLauncher()) for how in (build, less))
    assert differing(work, with_them, without) == 0
    assert differing(work, without, resolved(work, less, NumpyLauncher())) == 0


@pytest.mark.parametrize("term", NONE.__struct_fields__)
def test_no_term_hides_that_another_leaves_a_trace(term: str) -> None:
    work, less = work_with(NOTHING), replace(strict(1), terms=replace(NONE, **{term: True}))
    assert differing(work, *(resolved(work, how, NumpyLauncher()) for how in (less, replace(less, terms=NONE)))) == 0


def test_a_size_known_when_kernels_are_built_changes_no_bit() -> None:
    work, build = work_with(Settings()), strict(1)  # a GPU's
    width = replace(build, stride=work.layout.stride)
    for known in (width, replace(width, plane=work.layout.plane)):
        assert differing(work, resolved(work, known, DeviceLauncher()), resolved(work, build, DeviceLauncher())) == 0


def test_presets_call_for_the_terms_that_they_use() -> None:
    assert Terms.of(Settings()) == replace(NONE, resampling_penalty=True, disocclusion_blur=True, covered_share=True)
    assert Terms.of(load_preset("default").settings) == replace(NONE, resampling_penalty=True, covered_share=True)
    assert Terms.of(load_preset("fast").settings) == NONE
    scaled = replace(NONE, box_scale_by_motion=True, disocclusion_blur=True, luma_scale=True, box_leak=True)
    assert Terms.of(load_preset("fsr3-like").settings) == scaled
    assert Terms.of(load_preset("bevy").settings) == replace(NONE, first_samples=True)
    resolver = Resolver("fast", "numpy")
    resolver.resolve(make_frame(0, width=WIDTH, height=HEIGHT))
    assert resolver.last is not None
    assert resolver.last.build.terms == Terms.of(resolver.preset.settings)


def fitted(kernel: str, build: Build) -> Build:
    """What a kernel is built from for a whole image."""
    return DeviceLauncher().fitted(kernel, build, Layout(WIDTH, HEIGHT), {"frame": {"band_rows": 0}})


def test_only_the_resolve_is_built_for_one_size(monkeypatch: pytest.MonkeyPatch) -> None:
    shape = Shape(lanes=1, rows=ROWS, group=(32, 1), one_size=True)
    monkeypatch.setattr(Device, "shape", property(lambda _: shape))
    layout, asked = Layout(WIDTH, HEIGHT), DeviceLauncher().build(Build())
    assert [fitted(kernel, asked) for kernel in ("unpack", "extend_edges", "pack")] == [asked] * 3
    known = fitted("resolve", asked)
    assert (known.stride, known.plane) == (layout.stride, layout.plane)


@pytest.mark.parametrize(("asked", "taken"), [(0, 8), (ROWS + 1, ROWS + 1)])
def test_rows_that_were_not_asked_for_fill_the_device(monkeypatch: pytest.MonkeyPatch, asked: int, taken: int) -> None:
    shape = Shape(lanes=1, rows=ROWS, group=(32, 1), one_size=True, most_rows=9)
    monkeypatch.setattr(Device, "shape", property(lambda _: shape))
    assert fitted("resolve", DeviceLauncher().build(Build(rows=asked))).rows == taken


@pytest.mark.parametrize(
    ("kernel", "cut"), [("gather", (1, 80)), ("gather_windows", (1, 80)), ("mix_windows", (20, 255))]
)
def test_kernels_may_have_a_cut_of_their_own(
    monkeypatch: pytest.MonkeyPatch, kernel: str, cut: tuple[int, int]
) -> None:
    shape = Shape(lanes=1, rows=ROWS, group=(32, 1), gather=Cut(1, (8, 8), 80), mix=Cut(20, (64, 1), 255))
    monkeypatch.setattr(Device, "shape", property(lambda _: shape))
    built = fitted(kernel, DeviceLauncher().build(Build()))
    assert (built.rows, built.registers) == cut
    assert fitted(kernel, DeviceLauncher().build(Build(rows=ROWS + 1))).rows == ROWS + 1  # as it was asked for


def turns(shape: Shape, width: int, height: int, rows: int, at_once: int) -> float:
    return -(-width // shape.group[0]) * -(-height // rows) / at_once


@pytest.mark.parametrize(
    ("size", "registers", "rows"), [((3840, 2160), 96, 33), ((1920, 1080), 96, 25), ((3840, 2160), 128, 31)]
)
def test_the_rows_of_an_image_leave_no_turn_half_empty(size: tuple[int, int], registers: int, rows: int) -> None:
    # 132 units, on which 5 groups of 128 work-items with 96 registers are under way, and 4 with 128.
    at_once = 132 * (65536 // (registers * 128))
    assert NVIDIA.even_rows(*size, registers, 132) == rows
    filled = turns(NVIDIA, *size, rows, at_once)
    assert 0.99 < filled / -(-filled // 1) <= 1.0


def test_a_small_image_is_cut_into_many_columns() -> None:
    assert NVIDIA.even_rows(160, 90, 96, 132) == LEAST_ROWS
