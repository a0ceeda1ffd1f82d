"""One stage kernel at a time, on a device or on its twin, fed with planes that hold every hard case at once.

``hard_work`` makes what a frame reads; ``run_stage`` runs one kernel of the chain on a launcher and returns what it
wrote. What a stage needs is read from the signature of its twin, so that a new argument or choice needs no line here.
"""

from __future__ import annotations

import inspect
import random
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from cltaa.core.backend import Launcher, storage_dtype
from cltaa.core.build import (
    FRAME_DTYPE,
    HALVES,
    Build,
    Record,
    Steps,
    settings_record,
    window_count,
    window_planes,
)
from cltaa.core.constants import value as value_of
from cltaa.core.parameters import Choices, CurrentFilter, FilterUse, Fireflies, Illumination, Settings
from cltaa.core.planes import Layout
from cltaa.core.presets import load_preset
from cltaa.core.record import Past, frame_record
from cltaa.reference import KERNELS
from cltaa.reference.illumination import tests_light
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.hard_planes import KEPT, Planes, hard_planes
from tests.kernels.test_resolve import turned
from tests.sequence_factory import bits, make_frame

# Kernel -> the planes that it writes: the stages in the order of the chain, those that slide down rows, and what mixes
# their windows.
WRITES: dict[str, dict[str, int]] = {
    "repair_colour": {"repaired": 3},
    "neighbourhood_statistics": {"statistics_out": 15},
    "surface_motion": {"motion_out": 10},
    "sample_history": {"history_at": 9},
    "rectify_history": {"change_out": 5},
    "blend": {"output": 4, "output_count": 1},
    "resolve": {"output": 4, "output_count": 1},
    "gather": {"output": 4, "output_count": 1},
    "gather_windows": {"windows": 24},
    "mix_windows": {"output": 4, "output_count": 1},
}
FUSED = ("resolve", "gather", "gather_windows")
# The choices that fused kernels are shipped with, all of them at once.
SHIPPED = {"resolve": "default", "gather": "gather-48", "gather_windows": "gather-48"}
STAGES = [kernel for kernel in WRITES if kernel not in FUSED]
# The choices and steps that each stage's code looks at; of the fused kernels what no stage does.
LOOKS_AT: dict[str, tuple[str, ...]] = {
    "repair_colour": (),
    "neighbourhood_statistics": ("neighbourhood", "variance", "box", "box_space", "current_filter", "tonemap"),
    "surface_motion": ("dilation", "camera_motion", "own_motion", "orthographic"),
    "sample_history": (
        "history_filter",
        "history_range",
        "reject",
        "exposure",
        "alpha",
        "alpha_from",
        "tonemap",
        "off_screen",
        "storage",
        "illumination",
    ),
    "rectify_history": ("box", "box_space", "rectify", "accumulate", "anti_flicker"),
    "blend": (
        "accumulate",
        "alpha",
        "alpha_from",
        "anti_flicker",
        "box_space",
        "filter_use",
        "fireflies",
        "illumination",
        "negatives",
        "reactive",
        "rectify",
        "storage",
        "tonemap",
        "weighting",
    ),
    "resolve": ("storage",),
    "gather": (
        "alpha",
        "alpha_from",
        "camera_motion",
        "exposure",
        "look_ahead",
        "orthographic",
        "own_motion",
        "reactive",
        "reject",
        "storage",
        "tonemap",
        "weighting",
    ),
    "gather_windows": (
        "alpha",
        "alpha_from",
        "camera_motion",
        "centred",
        "exposure",
        "long_ring",
        "look_ahead",
        "own_motion",
        "reactive",
        "recursion",
        "storage",
        "tonemap",
        "weighting",
    ),
    "mix_windows": ("alpha", "centred", "long_ring", "look_ahead", "negatives", "recursion", "storage", "weighting"),
}
# Of the rows of several choices: with it each value is in one that shows it, light is tested for where depth is, and no
# clip that rounding in one channel can turn is in RGB.
SEED = 3
# Stages with rows of their own: without motion the others have little to do; windows are mixed by another program.
APART = ("surface_motion", "mix_windows")
# Values that give the bits of the usual one where nothing else is changed, by ways of their own: each has a row alone.
UNSEEN = {
    "sample_history": ["alpha_from=current", "storage=double"],
    "rectify_history": ["box=rounded"],
    "blend": ["anti_flicker=clamp-distance", "rectify=clip"],
}
# Values that show beside one another alone, where no row of several choices has both.
BESIDE: dict[str, list[dict[str, Any]]] = {"blend": [{"fireflies": Fireflies.CLAMP, "filter_use": FilterUse.FEW}]}
LONG_RING = 48  # frames
# Values that a stage's code does not tell from another one.
ALIKE: dict[str, dict[str, str]] = {
    "neighbourhood_statistics": dict.fromkeys(["box=variance", "box=both", "box=unit", "tonemap=blend"], "default"),
    "sample_history": {
        "storage=half-stochastic": "storage=half",
        "illumination=window": "illumination=test",
        "tonemap=blend": "default",
    },
    "rectify_history": dict.fromkeys(
        ["accumulate=exponential", "accumulate=constant", "anti_flicker=difference"], "default"
    ),
    "blend": {
        "illumination=window": "illumination=test",
        **dict.fromkeys(["rectify=clip-unguarded", "rectify=clip-current", "rectify=ellipsoid"], "rectify=clip"),
    },
}
BACK = 0.2  # the nearest points of the planes lie at 0.1: the previous camera was in front of them
UNWRITTEN = np.float32(-77.0)  # what no stage writes into a plane by itself
ALL_STEPS = Steps(alpha=True, reactive=True)


@dataclass(frozen=True)
class Work:
    """What a frame of one size reads: planes, the two structs, and what is known of the frames in the ring, latest
    first."""

    layout: Layout
    planes: Planes
    frame: Record
    settings: Record
    past: Record = field(default_factory=lambda: np.zeros(0, FRAME_DTYPE))


def hard_work(width: int = 70, height: int = 41, seed: int = 0, settings: Settings | None = None) -> Work:
    """A frame whose planes hold every hard case, with a camera that turns, zooms and backs away."""
    layout = Layout(width, height)
    cameras = [turned(index + seed % 7, width, height) for index in range(1 - KEPT, 2)]
    cameras[-1].world_to_view[2, 3] -= BACK
    *before, now = (
        make_frame(index, width=width, height=height, camera=camera, exposure=1.3 ** (index + 1 - KEPT))
        for index, camera in enumerate(cameras)
    )
    record = frame_record(now, Past.of(before[-1]), layout)
    record["left_weight"], record["right_weight"], record["above_weight"], record["below_weight"] = 0.3, -0.05, 0.1, 0.2
    record["own_vectors"] = 1
    record["box_left"], record["box_right"], record["box_above"], record["box_below"] = 0.2, 0.05, 0.03, 0.4
    past = np.array([frame_record(now, Past.of(frame), layout) for frame in reversed(before)], FRAME_DTYPE)
    # None that puts a texel's sample on the border of a neighbour's window, 0.8 off its centre, but for rounding.
    past["jitter_x"], past["jitter_y"] = np.linspace(-0.37, 0.31, KEPT), np.linspace(0.23, -0.46, KEPT)
    past["slot"] = (np.arange(KEPT) + 1) % KEPT
    past["ahead"] = np.arange(KEPT)  # looked at by builds that look ahead alone
    settings = Settings() if settings is None else settings
    return Work(layout, hard_planes(layout, seed), record, settings_record(settings), past)


def arguments_of(kernel: str, build: Build, work: Work) -> dict[str, Any]:
    """What a kernel is given, by the names in its twin's signature: structs, planes to read, and UNWRITTEN ones.

    What an earlier stage wrote as ``x_out`` is read as ``x_in``; history and output are in the build's storage, and of
    the frames in the ring only the planes that its steps read are there.
    """
    given: dict[str, Any] = {"frame": work.frame, "settings": work.settings, **work.planes}
    given |= {"past": work.past, "frames": len(work.past), "static_frames": len(work.past)}
    given["lag_ratio"], given["drift_share"] = np.float32(0.75), np.float32(1.0)
    if len(work.past):
        given |= {"recursive": work.planes["history"], "recursive_count": work.planes["history_count"]}
        given["ring"] = ring_of(build.steps, work)
    given |= {f"{name[:-4]}_in": planes for name, planes in work.planes.items() if name.endswith("_out")}
    if "windows" in work.planes:
        given["windows"] = windows_of(build, work)
    if kernel == "mix_windows":
        given["frames"] = LONG_RING  # each of its windows is another
    given |= {name: np.full_like(work.layout.zeros(count), UNWRITTEN) for name, count in writes(kernel, build).items()}
    names = [p.name for p in inspect.signature(KERNELS[kernel]).parameters.values() if p.kind is p.KEYWORD_ONLY]
    if tests_light(build):
        for name in {"history_count", "history_at"} & set(names):
            given[name] = with_changes(given[name])
    most = value_of("HALF_LIMIT") if build.storage in HALVES else np.inf
    for name in {"history", "output", "recursive"} & set(names):
        with np.errstate(invalid="ignore"):  # signalling NaN
            given[name] = np.clip(given[name], -most, most).astype(storage_dtype(build))
    return {name: given[name] for name in names}


def writes(kernel: str, build: Build) -> dict[str, int]:
    """The planes that a kernel of that build writes: where light is tested the count has a second one."""
    if kernel == "gather_windows":
        return {"windows": 6 * window_count(build.choices, build.steps)}
    recurs = kernel in ("blend", "resolve") and tests_light(build)
    return WRITES[kernel] | ({"output_count": 2} if recurs else {})


def with_changes(planes: NDArray[np.float32]) -> NDArray[np.float32]:
    """The planes of the count, or of a history at its place, with illumination changes as a test for them leaves
    them."""
    most = value_of("MOST_CHANGE")
    changes = np.random.default_rng(1).uniform(-most, most, planes.shape[1:]).astype(np.float32)
    return np.concatenate([planes[: 8 if len(planes) > 1 else 1], changes[None]])


def windows_of(build: Build, work: Work) -> NDArray[np.float32]:
    """The planes of the windows that a build reads, one window after another."""
    count, planes = window_count(build.choices, build.steps), window_planes(build.steps)
    windows = work.planes["windows"].reshape(-1, 6, work.layout.rows, work.layout.stride)
    return np.ascontiguousarray(windows[:count, :planes]).reshape(-1, *windows.shape[2:])


def ring_of(steps: Steps, work: Work) -> NDArray[np.float32]:
    """The planes of the frames in the ring that a build with ``steps`` reads, one frame after another."""
    read = [True] * 4 + [steps.own_motion] * 2 + [steps.alpha, steps.reactive]
    frames = work.planes["ring"].reshape(len(work.past), len(read), work.layout.rows, work.layout.stride)
    return frames[:, read].reshape(-1, *frames.shape[2:])


def run_stage(kernel: str, build: Build, work: Work, launcher: Launcher) -> Planes:
    """Run one kernel over the planes of ``work``; returns the padded planes that it wrote, UNWRITTEN elsewhere."""
    buffers = arguments_of(kernel, build, work)
    for name, source in buffers.items():
        if np.ndim(source):
            buffers[name] = launcher.allocate(source.shape, source.dtype)
            with buffers[name].mapped(write=True) as target:
                target[:] = source
    launcher.run(kernel, build, work.layout, buffers)
    launcher.finish()
    written: Planes = {}
    for name in writes(kernel, build):
        with buffers[name].mapped(write=False) as planes_of:
            written[name] = planes_of.copy()
    return written


@cache
def chain_work(width: int = 70, height: int = 41, seed: int = 0) -> Work:
    """Hard work whose planes also hold what each stage's twin makes of them: every stage finds its input there.

    The current sample is a filtered one, so that a stage that takes it for the texel, or the texel for it, shows.
    """
    work = hard_work(width, height, seed)
    build = Build(steps=ALL_STEPS, choices=Choices(current_filter=CurrentFilter.GAUSSIAN))
    for kernel in STAGES:
        work.planes.update(run_stage(kernel, build, work, NumpyLauncher()))
    return work


def differing(work: Work, a: Planes, b: Planes, *, halo: bool = False) -> int:
    """Values inside the image, or in its ``halo`` too, that differ in their bits; any NaN is as good as another."""
    count = 0
    for name in a:
        ours, theirs = (planes[name] if halo else work.layout.inside(planes[name]) for planes in (a, b))
        count += int(((bits(ours) != bits(theirs)) & ~(np.isnan(ours) & np.isnan(theirs))).sum())
    return count


def variant_names(kernel: str, build: Build) -> list[Any]:
    """Parameters of a test: kernel and name of each variant, all heavy but the default; the fused kernels' are built as
    users have them."""
    marks = [pytest.mark.big, *([pytest.mark.optimised] if kernel in FUSED else [])]
    names = variants(kernel, build)
    return [pytest.param(kernel, name, marks=pytest.mark.optimised if name == "default" else marks) for name in names]


def variants(kernel: str, build: Build) -> dict[str, Build]:
    """``build``, with each choice or step that a stage looks at changed on its own, and as it is shipped; by name.

    Of values that it does not tell apart one is there.
    """
    named = every_variant(kernel, build)
    return {name: named[name] for name in named if name not in ALIKE.get(kernel, {})}


def every_variant(kernel: str, build: Build) -> dict[str, Build]:
    """``variants``, and those that are alike."""
    changes = [(name, value) for name, values in others(kernel, build).items() for value in values]
    named = {"default": build} | {f"{name}={value}": changed(build, {name: value}) for name, value in changes}
    if kernel in SHIPPED:
        shipped = load_preset(SHIPPED[kernel]).choices
        if kernel == "gather":  # which the plan asks only where no illumination change is declared
            shipped = replace(shipped, illumination=Illumination.STATIC)
        named[f"preset={SHIPPED[kernel]}"] = replace(build, choices=shipped)
    return named


def others(kernel: str, build: Build) -> dict[str, list[Any]]:
    """The values that each choice or step that a stage looks at does not have in ``build``."""
    return {name: other_values(name, build) for name in LOOKS_AT[kernel]}


def other_values(name: str, build: Build) -> list[Any]:
    """The values that a choice or step does not have in ``build``."""
    usual = value_in(build, name)
    return [not usual] if isinstance(usual, bool) else [v for v in type(usual) if v is not usual]


def value_in(build: Build, name: str) -> Any:
    """The value of a choice or step, or of the build's own."""
    return getattr(next((part for part in (build.choices, build.steps) if hasattr(part, name)), build), name)


def changed(build: Build, row: dict[str, Any]) -> Build:
    """``build`` with the values of a row."""
    for name, value in row.items():
        part = next((part for part in ("choices", "steps") if hasattr(getattr(build, part), name)), None)
        changes = {name: value} if part is None else {part: replace(getattr(build, part), **{name: value})}
        build = replace(build, **changes)
    return build


def rows_together(kernel: str, build: Build) -> list[dict[str, Any]]:
    """What ``variants`` of a stage change one at a time, several at once, for a build takes most of a second: of each
    choice one value after another, the usual one among them, shuffled apart from the others'. Stages that are built
    together have the choices of all of them in a row, and so one build."""
    together = [kernel] if kernel in APART else [stage for stage in STAGES if stage not in APART]
    values = {name: value for stage in together for name, value in others(stage, build).items()}
    columns = {name: [*rest, value_in(build, name)] for name, rest in values.items()}
    most = max(map(len, columns.values()), default=0)
    turns = {name: turn(name, column, most) for name, column in columns.items()}
    count = max((len(columns[name]) for name in LOOKS_AT[kernel]), default=0)
    alone = [{name: v} for name in LOOKS_AT[kernel] for v in values[name] if f"{name}={v}" in UNSEEN.get(kernel, [])]
    return [{name: each[at] for name, each in turns.items()} for at in range(count)] + alone + BESIDE.get(kernel, [])


def turn(name: str, column: list[Any], most: int) -> list[Any]:
    """``most`` values of a choice: its column shuffled, again and again."""
    chance, found = random.Random(f"{name} {SEED}"), list[Any]()
    while len(found) < most:
        found += chance.sample(column, len(column))
    return found[:most]
