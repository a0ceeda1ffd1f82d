"""Failure modes of platforms and sizes, and metamorphic checks: docs/numerics.md, G."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cltaa.core.build import Build, prelude
from cltaa.core.parameters import HistoryFilter
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Frame, Image
from cltaa.opencl.device import POCL, devices
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.hard_planes import Planes
from tests.kernels.stage_chain import ALL_STEPS, WRITES, chain_work, differing, run_stage
from tests.kernels.test_twins import CutUp
from tests.numerics.kernel_text import calls_of, kernel_files, without_comments
from tests.numerics.still_frames import UNIT_ROUNDOFF, accumulator, grey, last_of
from tests.numerics.test_b_history_filter import fireflies, sampled, weights
from tests.sequence_factory import bits, make_camera, make_frame

# A few examples, the same in every run; with --hypothesis-profile=big many, new in every run.
big = settings.get_current_profile_name() == "big"
few = settings() if big else settings(max_examples=8, deadline=None, derandomize=True)


def test_g1_a_strict_build_contracts_nothing(launcher: DeviceLauncher) -> None:
    text = without_comments(kernel_files()["platform/real.h"])
    assert "#if STRICT\n#pragma OPENCL FP_CONTRACT OFF" in text
    assert "#define STRICT 1" in prelude(Build(strict=True))
    assert "-cl-fp32-correctly-rounded-divide-sqrt" in Build(strict=True).flags()
    work = chain_work()
    build = Build(steps=ALL_STEPS, strict=True, lanes=8, rows=4)
    ours, theirs = (run_stage("resolve", build, work, where) for where in (launcher, NumpyLauncher()))
    assert differing(work, ours, theirs) == 0


GROUPS = [None, (1, 1), (2, 2), (7, 3), (16, 1), (1, 16), (64, 2), (128, 1), (256, 1)]


def check_groups(
    kernel: str, build: Build, expected: Planes | None = None, groups: Sequence[tuple[int, int] | None] = GROUPS
) -> None:
    cut, work = CutUp(), chain_work()
    for group in groups:
        cut.group = group
        found = run_stage(kernel, build, work, cut)
        expected = expected or found
        assert differing(work, found, expected) == 0, group


def test_g2_results_do_not_depend_on_the_work_group() -> None:
    build = Build(steps=ALL_STEPS, strict=True, lanes=1, rows=4)
    # Of more than 64 work-items PoCL cannot hold the private memory of an unoptimised build on its stack.
    check_groups("resolve", build, run_stage("resolve", build, chain_work(), NumpyLauncher()), [(1, 16), (32, 2)])


@pytest.mark.big
@pytest.mark.parametrize("strict", [True, False])  # contracted as the device likes: the same in every group
@pytest.mark.parametrize("kernel", WRITES)
def test_g2_no_kernel_depends_on_the_work_group(kernel: str, strict: bool) -> None:
    check_groups(kernel, Build(steps=ALL_STEPS, strict=strict, lanes=1, rows=4))


@pytest.mark.big
@pytest.mark.parametrize("method", ["auto", "loops", "loopvec", "cbs"])
def test_g2_results_do_not_depend_on_how_pocl_runs_a_group(method: str, tmp_path: Path) -> None:
    # Its compiler turns a group into a loop in one of several ways, chosen when it starts.
    code = (
        "from tests.kernels.test_twins import WRITES, compared, strict\n"
        "print({(kernel, lanes): compared(kernel, strict(lanes)) for kernel in WRITES for lanes in (1, 8)})"
    )
    told = {"POCL_WORK_GROUP_METHOD": method, "POCL_CACHE_DIR": str(tmp_path), "CLTAA_DEVICE": POCL}
    if not any(device.platform.name == POCL for device in devices()):
        pytest.skip("PoCL is not installed")
    child = subprocess.run([sys.executable, "-c", code], env={**os.environ, **told}, capture_output=True, text=True)
    assert child.returncode == 0, child.stderr
    assert child.stdout.strip() == str(dict.fromkeys(((kernel, n) for kernel in WRITES for n in (1, 8)), 0))


def test_g2_no_work_item_waits_for_another() -> None:
    for name, text in kernel_files().items():
        assert calls_of(text, r"atomic_\w+", r"atom_\w+", "barrier", "mem_fence", r"work_group_\w+") == [], name
        assert "__local" not in without_comments(text), name


def test_g3_fractions_are_not_quantised(launcher: DeviceLauncher) -> None:
    # Texture units weigh with 8 bits of fraction: an error of 2^-9 of a step. These kernels filter by themselves.
    history, random = fireflies(), np.random.default_rng(51)
    history[:] = random.random(history.shape)
    f, g = (float(np.float32(v)) for v in (0.3 + 2.0**-10, 0.7 - 2.0**-10))
    read = sampled(launcher, history, f, g, HistoryFilter.CATMULL_ROM)
    exact = np.zeros(history.shape)
    for tap_y, by_y in weights(HistoryFilter.CATMULL_ROM, g).items():
        for tap_x, by_x in weights(HistoryFilter.CATMULL_ROM, f).items():
            exact += by_y * by_x * np.roll(history.astype(np.float64), (-tap_y, -tap_x), (0, 1))
    inside = np.s_[2:-3, 2:-3]
    assert np.abs(read - exact)[inside].max() <= 32 * UNIT_ROUNDOFF


INEXACT = (
    r"half_(?!storable)\w+",
    r"native_\w+",
    r"fast_\w+",
    "mix",
    "dot",
    "length",
    "normalize",
    "distance",
    r"pow\w*",
    r"exp\w*",
    r"log\w*",
    "rsqrt",
    "cbrt",
    "sin",
    "cos",
    "tan",
    "fma",
    "mad",
    "hypot",
    "fmod",
    "remainder",
)


def test_g4_no_library_function_but_the_root() -> None:
    # Whatever is not + - x / and the square root may differ from device to device.
    assert {name: calls for name, text in kernel_files().items() if (calls := calls_of(text, *INEXACT))} == {}
    assert calls_of("x = half_sqrt(y) + mad(a, b, c);", *INEXACT) == ["half_sqrt(", "mad("]


def test_g4_no_function_of_unknown_precision_hides_behind_a_name() -> None:
    # OpenCL leaves the error of native_ functions to the device: a bound that is printed can stand on none of them, be
    # it called or only named in a macro. NVIDIA's two instructions say their error (decisions/14).
    unknown = re.compile(r"\b(?:native|fast)_\w+|\bhalf_(?!storable)\w+|\b(?!sqrt\.|rcp\.)\w+\.approx")
    found = {name: unknown.findall(without_comments(text)) for name, text in kernel_files().items()}
    assert {name: words for name, words in found.items() if words} == {}
    assert unknown.findall('#define ROOT native_sqrt\n"ex2.approx.f32" "rcp.approx.ftz.f32"') == [
        "native_sqrt",
        "ex2.approx",
    ]


# ---- G6: what has to hold without any reference ----

HEIGHT, WIDTH = 24, 28
seeds = st.integers(0, 2**32 - 1)


def frames_of(seed: int, count: int = 3, moving: bool = True) -> list[Frame]:
    """Random frames under a still camera with own motion, all of the plan's steps on."""
    random = np.random.default_rng(seed)
    made = []
    for index in range(count):
        frame = make_frame(index, width=WIDTH, height=HEIGHT, seed=seed, camera=make_camera(), effects=None)
        motion = random.uniform(-2, 2, (HEIGHT, WIDTH, 2)).astype(np.float32) * np.float32(moving)
        made.append(replace(frame, depth=frame.depth.clip(0, 20), motion=motion if moving else None))
    return made


def result(frames: Iterable[Frame], **changes: object) -> Image:
    resolver = Resolver(override(load_preset(), changes), "numpy")
    for frame in frames:
        resolved = resolver.resolve(frame)
    return resolved


@few
@given(seed=seeds, by=st.tuples(st.integers(-5, 5), st.integers(-5, 5)))
def test_g6_a_shifted_sequence_gives_a_shifted_picture(seed: int, by: tuple[int, int]) -> None:
    def shifted(array: Any) -> Any:
        return np.roll(array, by, (0, 1))

    frames = frames_of(seed, 2)
    moved = [replace(f, colour=shifted(f.colour), depth=shifted(f.depth), motion=shifted(f.motion)) for f in frames]
    # Away from borders and from what was rolled round, before and after: 2 of motion, 2 taps, 1 of the 3x3.
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    kept = (np.minimum(y, HEIGHT - 1 - y) >= 5) & (np.minimum(x, WIDTH - 1 - x) >= 5)
    kept &= shifted(kept)
    ours, theirs = shifted(result(frames)), result(moved)
    assert np.array_equal(bits(ours[kept]), bits(theirs[kept]))


@few
@given(seed=seeds, how=st.sampled_from(["left-right", "up-down", "transposed"]))
def test_g6_a_mirrored_sequence_gives_a_mirrored_picture(seed: int, how: str) -> None:
    def turned(array: Any) -> Any:
        if how == "transposed":
            return np.ascontiguousarray(np.swapaxes(array, 0, 1))
        return np.flip(array, 1 if how == "left-right" else 0)

    frames = frames_of(seed, moving=False)
    mirrored = [replace(f, colour=turned(f.colour), depth=turned(f.depth)) for f in frames]
    # Without the depth test: it asks the four texels from the history position on, right and down of it. Without the
    # current filter: the jitter is not mirrored. Without the test of light: its moments are not summed alike from both
    # sides.
    plain = {"reject": "none", "current_filter": "none", "illumination": "static"}
    for changes in (plain, {**plain, "box": "variance", "rectify": "clip"}):
        ours, theirs = turned(result(frames, **changes)), result(mirrored, **changes)
        # Exact but for moments, which are not summed alike from both sides: the edges of the box move by 60 u, and the
        # clip by the same over the floor of its extents (test_d2_clip_moves_within_its_bound).
        assert np.abs(ours - theirs).max() <= (60 * UNIT_ROUNDOFF * 2.0**10 * 4.0 if "box" in changes else 0.0)


@few
@given(seed=seeds)
def test_g6_red_and_blue_may_change_places(seed: int) -> None:
    frames = frames_of(seed)
    swapped = [replace(f, colour=f.colour[..., ::-1]) for f in frames]
    assert np.array_equal(bits(result(swapped)), bits(result(frames)[..., ::-1]))


@few
@given(seed=seeds)
def test_g6_the_order_of_still_samples_does_not_matter(seed: int) -> None:
    random = np.random.default_rng(seed)
    images = [grey(random.random((6, 8))) for _ in range(24)]
    ours = last_of(accumulator(NumpyLauncher()), images)
    theirs = last_of(accumulator(NumpyLauncher()), [images[i] for i in random.permutation(24)])
    assert np.abs(ours - theirs).max() <= 2 * 3 * 24 * UNIT_ROUNDOFF  # each of 24 steps rounds three times


@few
@given(seed=seeds, y=st.integers(0, HEIGHT - 1), x=st.integers(0, WIDTH - 1), word=st.integers(0, 2**32 - 1))
def test_g6_no_texel_reaches_far_pixels(seed: int, y: int, x: int, word: int) -> None:
    frames = frames_of(seed, 2)
    colour = frames[0].colour.copy()
    colour[y, x, seed % 3] = np.uint32(word).view(np.float32)
    ours, theirs = result([replace(frames[0], colour=colour), frames[1]]), result(frames)
    rows, columns = np.nonzero((bits(ours) != bits(theirs)).any(axis=-1))
    assert np.isfinite(ours).all()
    # Motion of up to 2 pixels borrowed from a neighbour 1 away, 2 taps, and the 3x3.
    assert max(np.abs(rows - y).max(initial=0), np.abs(columns - x).max(initial=0)) <= 6


def test_g6_a_run_gives_the_same_bits_again(launcher: DeviceLauncher) -> None:
    frames: list[Frame] = frames_of(7)
    runs: list[NDArray[Any]] = []
    for _ in range(2):
        resolver = Resolver(device=launcher, strict=True)
        runs.append(np.array([resolver.resolve(frame) for frame in frames]))
    assert np.array_equal(bits(runs[0]), bits(runs[1]))


def test_g2_only_the_platform_asks_for_hardware_or_compiler() -> None:
    asks = re.compile(
        r"^\s*#\s*(?:el)?if.*\b(?:LANES|NATIVE|NVIDIA|GATHERS|CONVERTS_HALVES|STORES_LINES|__\w+|cl_\w+)\b",
        re.MULTILINE,
    )
    found = {name: asks.findall(text) for name, text in kernel_files().items() if not name.startswith("platform/")}
    assert {name: lines for name, lines in found.items() if lines} == {}
    assert len(asks.findall("#if LANES > 1\n#elif defined(__x86_64__)\n#if STORAGE_HALF\n  #ifdef cl_khr_fp64")) == 3
