"""What a build knows beforehand, terms that the settings make nothing of and the width of planes, changes no bit."""

from __future__ import annotations

from functools import cache

import pytest
from msgspec.structs import replace

from cltaa.build import Build, Terms
from cltaa.device import Device, Shape
from cltaa.launch import DeviceLauncher, NumpyLauncher
from cltaa.params import Settings
from cltaa.presets import load_preset
from cltaa.resolve import Resolver
from tests.kernels.hard_planes import Planes
from tests.kernels.stage_chain import ALL_STEPS, Work, differing, hard_work, run_stage
from tests.sequence_factory import make_frame

WIDTH, HEIGHT = 45, 23
ROWS = 7
# Term -> settings that make nothing of it.
NOTHING = {
    "resample_cost": Settings(resample_cost=0.0),
    "pull_cost": Settings(pull_cost=0.0),
    "gamma_by_motion": Settings(gamma_still=1.25, gamma_moving=1.25),
    "fresh_blur": Settings(fresh_blur=0.0),
}


@cache
def device() -> DeviceLauncher:
    return DeviceLauncher()


def work_with(settings: Settings) -> Work:
    return hard_work(WIDTH, HEIGHT, seed=5, settings=settings)


def resolved(work: Work, build: Build, launcher: DeviceLauncher | NumpyLauncher) -> Planes:
    return run_stage("resolve", build, work, launcher)


def strict(lanes: int) -> Build:
    return Build(steps=ALL_STEPS, strict=True, lanes=lanes, rows=ROWS)


@pytest.mark.parametrize("lanes", [1, 8])
@pytest.mark.parametrize("term", NOTHING)
def test_a_term_that_comes_to_nothing_is_left_out_without_a_trace(term: str, lanes: int) -> None:
    work, build = work_with(NOTHING[term]), strict(lanes)
    less = replace(build, terms=Terms(**{term: False}))
    with_it, without = (resolved(work, how, device()) for how in (build, less))
    assert differing(work, with_it, without) == 0
    assert differing(work, without, resolved(work, less, NumpyLauncher())) == 0


@pytest.mark.parametrize("lanes", [1, 8])
def test_a_width_known_when_kernels_are_built_changes_no_bit(lanes: int) -> None:
    work, build = work_with(Settings()), strict(lanes)
    known = replace(build, stride=work.layout.stride)
    assert differing(work, resolved(work, known, device()), resolved(work, build, device())) == 0


def test_presets_call_for_the_terms_that_they_use() -> None:
    assert Terms.of(Settings()) == Terms(gamma_by_motion=False)
    assert Terms.of(load_preset("default").settings) == Terms(fresh_blur=False)
    none = Terms(resample_cost=False, pull_cost=False, gamma_by_motion=False, fresh_blur=False)
    assert Terms.of(load_preset("t2").settings) == none
    resolver = Resolver("t2", "numpy")
    resolver.resolve(make_frame(0, width=WIDTH, height=HEIGHT))
    assert resolver.last is not None
    assert resolver.last.build.terms == Terms.of(resolver.preset.settings)


def test_only_the_resolve_is_built_for_one_width(monkeypatch: pytest.MonkeyPatch) -> None:
    shape = Shape(lanes=1, rows=ROWS, group=(32, 1), one_width=True)
    monkeypatch.setattr(Device, "shape", property(lambda _: shape))
    launcher = DeviceLauncher()
    resolver = Resolver("t0", launcher)
    resolver.resolve(make_frame(0, width=WIDTH, height=HEIGHT))
    assert resolver.last is not None
    strides = {name: build.stride for name, build in launcher._kernels}
    assert strides == {"resolve": resolver.last.layout.stride, "extend_edges": 0}
