"""Every stage kernel against its NumPy twin: a strict build gives the same bits, however the work is cut up."""

from __future__ import annotations

import dataclasses
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import pyopencl as cl
import pytest
from msgspec.structs import replace

from cltaa.core.backend import storage_dtype
from cltaa.core.build import (
    FRAME_DTYPE,
    SETTINGS_DTYPE,
    Build,
    Steps,
    Storage,
    mix_build,
    unmoved_window,
    window_count,
    window_planes,
)
from cltaa.core.constants import PAD_X, PAD_Y
from cltaa.core.constants import value as value_of
from cltaa.core.parameters import (
    HOST_CHOICES,
    HOST_SETTINGS,
    Choices,
    CurrentFilter,
    FilterUse,
    Illumination,
    Rectify,
    Recursion,
    Settings,
)
from cltaa.core.planes import Layout
from cltaa.core.presets import load_preset
from cltaa.opencl.device import POCL
from cltaa.opencl.launcher import SLIDING, DeviceLauncher
from cltaa.reference.colour import sample_is_missing
from cltaa.reference.gather_window import repeats_previous
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.hard_planes import KEPT
from tests.kernels.stage_chain import (
    ALIKE,
    ALL_STEPS,
    FUSED,
    LOOKS_AT,
    STAGES,
    UNWRITTEN,
    WRITES,
    chain_work,
    changed,
    differing,
    every_variant,
    other_values,
    others,
    rows_together,
    run_stage,
    value_in,
    variant_names,
    variants,
)
from tests.numerics.kernel_text import kernel_files, without_comments
from tests.sequence_factory import bits


class CutUp(DeviceLauncher):
    """A device that runs each kernel in groups of a given size, as bands of rows of work-items, last band first.

    There are as many work-items, across and down, as fill the groups, or else ``multiples``.
    """

    def __init__(self) -> None:
        super().__init__()
        self.group: tuple[int, int] | None = (1, 1)
        self.multiples: tuple[int, int] | None = None
        self.bands = 1

    def run(self, kernel: str, build: Build, layout: Layout, arguments: Mapping[str, Any]) -> None:
        rows = build.rows if kernel in SLIDING else 1
        columns, steps = -(-layout.width // build.lanes), -(-layout.height // rows)
        wide, high = self.multiples or self.group or (1, 1)
        band = -(-steps // self.bands)
        size = (-(-columns // wide) * wide, -(-band // high) * high)
        built = self.kernel(kernel, build)
        first = built.enqueue(self.device.queue, size, self.group, arguments)
        for number in reversed(range(1, self.bands)):
            offset = (0, number * band)
            cl.enqueue_nd_range_kernel(self.device.queue, built._kernel, size, self.group, offset, wait_for=[first])


@cache
def device_of(_: str | None) -> CutUp:
    return CutUp()


def device() -> CutUp:
    """A device that builds kernels as the test has them."""
    return device_of(os.environ.get("PYOPENCL_BUILD_OPTIONS"))


def around(layout: Layout) -> tuple[tuple[int, int], tuple[int, int]]:
    """Rows above and below an image, and columns beside it."""
    return (PAD_Y, PAD_Y), (PAD_X, layout.stride - PAD_X - layout.width)


def strict(lanes: int = 8, rows: int = 4) -> Build:
    return Build(steps=ALL_STEPS, strict=True, lanes=lanes, rows=rows)


def compared(kernel: str, build: Build, size: tuple[int, int] = (70, 41)) -> int:
    work = chain_work(*size)
    ours, theirs = (run_stage(kernel, build, work, on) for on in (device(), NumpyLauncher()))
    return differing(work, ours, theirs, halo=kernel in FUSED and build.extends)


@pytest.fixture(autouse=True)
def whole() -> None:
    device().multiples, device().bands = None, 1


def built_for(lanes: int, *of: Any) -> Any:
    """Parameters of a test: optimised but for one lane, which another compiler builds for GPUs."""
    return pytest.param(*of, lanes, marks=[pytest.mark.optimised] if lanes > 1 else [])


@pytest.mark.parametrize(
    ("kernel", "lanes"),
    [built_for(lanes, k) for k in [*STAGES, "gather", "gather_windows"] for lanes in (1, 8)]
    + [built_for(4, "sample_history")],
)
def test_a_stage_gives_the_bits_of_its_twin(kernel: str, lanes: int) -> None:
    assert compared(kernel, strict(lanes)) == 0


@pytest.mark.parametrize(("kernel", "row"), [(k, n) for k in STAGES for n in range(len(rows_together(k, strict())))])
def test_a_stage_gives_the_bits_of_its_twin_for_many_choices(kernel: str, row: int) -> None:
    changes = rows_together(kernel, strict())[row]
    assert compared(kernel, changed(strict(), changes)) == 0, changes


@pytest.mark.parametrize("kernel", STAGES)
def test_every_choice_is_tried_where_it_is_seen(kernel: str) -> None:
    """Where the usual value gives other bits, as it does where nothing else is changed."""
    work, rows = chain_work(), rows_together(kernel, strict())

    def is_seen(row: dict[str, Any], name: str, value: Any) -> bool:
        usual = value_in(strict(), name)
        found = [
            run_stage(kernel, changed(strict(), row | {name: each}), work, NumpyLauncher()) for each in (value, usual)
        ]
        one, other = ([(planes.shape, planes.dtype) for planes in written.values()] for written in found)
        return one != other or differing(work, *found) > 0

    for name, values in others(kernel, strict()).items():
        for value in values:
            if f"{name}={value}" in ALIKE.get(kernel, {}):
                continue
            if is_seen({}, name, value):
                assert any(is_seen(row, name, value) for row in rows if row.get(name) == value), (name, value)
            else:
                assert {name: value} in rows


@pytest.mark.parametrize(
    ("kernel", "name"), [names for k in WRITES for names in variant_names(k, strict()) if "default" not in names.values]
)
def test_a_stage_gives_the_bits_of_its_twin_for_every_choice(kernel: str, name: str) -> None:
    """One at a time: what is wrong with one of many."""
    assert compared(kernel, variants(kernel, strict())[name]) == 0


@pytest.mark.parametrize(
    ("lanes", "storage", "ahead"),
    [(1, Storage.FLOAT, False), (8, Storage.FLOAT, False), (8, Storage.HALF, False), (8, Storage.FLOAT, True)],
)
def test_the_windows_beside_a_recursive_resolve_have_the_bits_of_their_twin(
    lanes: int, storage: Storage, ahead: bool
) -> None:
    # Every pixel stands; of every second there are more samples than lie in the ring, of the others next to none.
    steps = replace(ALL_STEPS, camera_motion=False, own_motion=False, reactive=False, look_ahead=ahead)
    choices = Choices(
        recursion=Recursion.STANDING,
        illumination=Illumination.WINDOW,
        current_filter=CurrentFilter.GAUSSIAN,
        filter_use=FilterUse.FEW,
    )
    build = replace(strict(lanes), steps=steps, choices=choices, storage=storage)
    few = chain_work()
    past = np.tile(few.past, 3)  # more frames than make a history refuted
    past["slot"] = np.arange(len(past))
    past["ahead"] = 0  # all of them earlier
    work = dataclasses.replace(few, past=past, planes={**few.planes, "ring": np.tile(few.planes["ring"], (3, 1, 1))})
    many = np.indices((work.layout.rows, work.layout.stride)).sum(0) % 2 == 0
    work.planes["history_count"] = np.where(many, 40.0, 1.0).astype(np.float32)[None]
    ours, theirs = (run_stage("gather_windows", build, work, on) for on in (device(), NumpyLauncher()))
    assert differing(work, ours, theirs) == 0
    parts = work.layout.inside(theirs["windows"]).reshape(-1, 6, work.layout.height, work.layout.width)
    unmoved = unmoved_window(steps)
    for window in (unmoved - 1, unmoved):
        assert (parts[window, 4] == 40.0).mean() == pytest.approx(0.5, abs=0.01)
    assert (parts[unmoved + 2, 4] == 0.0).all() == ahead  # the recursive result lags behind later frames
    judged = parts[unmoved + 1, 3] < value_of("DOMAIN_LIMIT")
    missing = sample_is_missing(work.planes["current"], work.layout, work.planes["alpha"])
    assert not (judged & (work.layout.inside(many) | missing)).any()
    assert judged.mean() > 0.4


@pytest.mark.parametrize("lanes", [built_for(1), built_for(8)])
@pytest.mark.parametrize(("times", "long"), [(3, False), (6, True)])  # 9 frames: 3, 7 and all differ; 18: 14 does too
def test_windows_of_different_frames_have_the_bits_of_their_twin(times: int, long: bool, lanes: int) -> None:
    few, build = chain_work(33, 9), changed(strict(lanes), {"long_ring": long})
    past = np.tile(few.past, times)
    past["slot"] = np.arange(len(past))
    ring = np.tile(few.planes["ring"], (times, 1, 1))
    work = dataclasses.replace(few, past=past, planes={**few.planes, "ring": ring})
    ours, theirs = (run_stage("gather_windows", build, work, on) for on in (device(), NumpyLauncher()))
    assert differing(work, ours, theirs) == 0
    windows = theirs["windows"].reshape(window_count(build.choices, build.steps), -1)
    assert all((window != UNWRITTEN).any() for window in windows)


@pytest.mark.big
@pytest.mark.optimised
@pytest.mark.parametrize(("kernel", "name"), [(k, name) for k in WRITES for name in variants(k, strict(1))])
def test_one_lane_gives_the_bits_of_the_twin_for_every_choice(kernel: str, name: str) -> None:
    # A GPU's program: other loads, roots, floors and tests of the domain than those of vectors.
    assert compared(kernel, variants(kernel, strict(1))[name]) == 0


@pytest.mark.optimised
@pytest.mark.parametrize("kernel", ["sample_history", "resolve"])
def test_a_reset_uses_no_history_and_gives_the_bits_of_the_twin(kernel: str) -> None:
    work = chain_work()
    frame = work.frame.copy()
    frame["reset"] = 1
    anew = dataclasses.replace(work, frame=frame)
    ours, theirs = (run_stage(kernel, strict(), anew, on) for on in (device(), NumpyLauncher()))
    assert differing(work, ours, theirs) == 0
    valid_or_count = work.layout.inside(ours["history_at"][7] if kernel == "sample_history" else ours["output_count"])
    missing = sample_is_missing(work.planes["current"], work.layout, work.planes["alpha"])
    expected = 0 if kernel == "sample_history" else ~missing
    assert (valid_or_count == expected).all()


@pytest.mark.optimised
@pytest.mark.parametrize("size", [(1, 1), (1, 17), (17, 1), (2, 2), (3, 3), (33, 9), (131, 64)])
def test_stages_give_the_bits_of_their_twins_at_every_size(size: tuple[int, int]) -> None:
    kernels = [*STAGES, "gather", "gather_windows"]
    assert {kernel: compared(kernel, strict(), size) for kernel in kernels} == dict.fromkeys(kernels, 0)


@pytest.mark.optimised
@pytest.mark.parametrize("kernel", WRITES)
def test_results_do_not_depend_on_bands(kernel: str) -> None:
    """Groups are for one lane: test_g2_results_do_not_depend_on_the_work_group, and with -m big each kernel there."""
    work = chain_work()
    expected = run_stage(kernel, strict(), work, NumpyLauncher())
    device().multiples, device().bands = (7, 3), 2
    assert differing(work, run_stage(kernel, strict(), work, device()), expected) == 0


@pytest.mark.optimised
@pytest.mark.parametrize("kernel", FUSED)
def test_what_is_stored_by_lanes_has_its_edges_repeated(kernel: str) -> None:
    # Beyond whole and begun segments, where a work-item has all rows, and some.
    for size in [(33, 9), (64, 3), (24, 5), (1, 1)]:
        work = chain_work(*size)
        for name, planes in run_stage(kernel, strict(), work, device()).items():
            expected = np.pad(work.layout.inside(planes), ((0, 0), *around(work.layout)), mode="edge")
            assert np.array_equal(bits(planes), bits(expected)), (name, size)


@pytest.mark.parametrize("storage", list(Storage))
def test_edges_are_repeated_in_every_storage(storage: Storage) -> None:
    plain = replace(load_preset("accumulate").choices, rectify=Rectify.NONE)
    build = Build(choices=plain, steps=Steps(alpha=True), strict=True, lanes=8, rows=4, storage=storage)
    work = chain_work(70, 41)
    launcher = DeviceLauncher()
    ours, theirs = (run_stage("resolve", build, work, on) for on in (launcher, NumpyLauncher()))
    assert differing(work, ours, theirs, halo=True) == 0
    assert not (ours["output"] == UNWRITTEN).any()


@pytest.mark.optimised
@pytest.mark.parametrize("kernel", WRITES)
def test_a_kernel_writes_its_pixels_and_at_most_the_rest_of_a_segment(kernel: str) -> None:
    work, lanes = chain_work(), 8
    device().multiples = (7, 3)  # more work-items than pixels, down and across
    for name, planes in run_stage(kernel, strict(lanes), work, device()).items():
        if kernel in FUSED and strict(lanes).extends:
            windows = planes.reshape(-1, window_planes(ALL_STEPS), *planes.shape[1:]) if name == "windows" else [planes]
            anew = [k for k in range(len(windows)) if not repeats_previous(k, KEPT, KEPT, strict(lanes))]
            assert all((windows[k] != UNWRITTEN).all() for k in anew), name  # its halo too
            continue
        written = planes != UNWRITTEN
        assert work.layout.inside(written).all(), name
        work.layout.inside(written)[:] = False
        rows, columns = np.nonzero(written.any(0))
        inside = work.layout.inside(np.indices(written.shape[1:]))
        assert set(rows) <= set(inside[0].flat)
        first = inside[1].max() + 1
        assert set(columns) <= set(range(first, first + -work.layout.width % lanes)), name


@pytest.mark.parametrize("storage", list(Storage))
def test_edges_are_extended_as_the_twin_extends_them(storage: Storage) -> None:
    for size in [(33, 9), (64, 3), (1, 1)]:
        work, build = chain_work(*size), replace(strict(1), storage=storage)
        with np.errstate(over="ignore"):
            history = work.planes["history"].astype(storage_dtype(build))
        planes = {"image": history, "floats": work.planes["history_at"]}
        buffers = {name: device().allocate(source.shape, source.dtype) for name, source in planes.items()}
        for name, source in planes.items():
            with buffers[name].mapped(write=True) as target:
                target[:] = UNWRITTEN
                work.layout.inside(target)[:] = work.layout.inside(source)
        counted = {"planes": 3, "more": 2}
        DeviceLauncher.run(device(), "extend_edges", build, work.layout, {**buffers, "frame": work.frame, **counted})
        device().finish()
        for (name, source), count in zip(planes.items(), counted.values(), strict=True):
            expected = source.copy()
            work.layout.extend_edges(expected)
            with buffers[name].mapped(write=False) as written:
                assert np.array_equal(bits(written[:count]), bits(expected[:count])), (name, size)
                assert (written[count:, 0] == UNWRITTEN).all(), (name, size)  # planes that were not asked for


@pytest.mark.parametrize("kernel", ALIKE)
def test_values_that_a_stage_does_not_tell_apart_give_the_same_bits(kernel: str) -> None:
    work, builds = chain_work(), every_variant(kernel, strict())
    for name, other in ALIKE[kernel].items():
        found, expected = (run_stage(kernel, builds[value], work, NumpyLauncher()) for value in (name, other))
        assert differing(work, found, expected) == 0, name


def test_windows_are_mixed_by_a_build_that_has_all_that_it_takes() -> None:
    """What it looks at, one choice after another, and then whatever else there is."""
    work, builds = chain_work(33, 9), every_variant("mix_windows", strict())
    for name, build in builds.items():
        found, expected = (run_stage("mix_windows", each, work, NumpyLauncher()) for each in (mix_build(build), build))
        assert differing(work, found, expected) == 0, name
    rest = {*Choices.__struct_fields__, *Steps.__struct_fields__} - {*LOOKS_AT["mix_windows"]}
    other = changed(strict(), {name: other_values(name, strict())[0] for name in rest})
    found, expected = (run_stage("mix_windows", each, work, device()) for each in (mix_build(other), other))
    assert differing(work, found, expected) == 0


def test_every_choice_and_step_is_looked_at_by_a_stage() -> None:
    assert {name for names in LOOKS_AT.values() for name in names} == {
        *(set(Choices.__struct_fields__) - HOST_CHOICES),
        *Steps.__struct_fields__,
        "storage",
    }


def test_the_structs_hold_what_a_kernel_reads_and_nothing_else() -> None:
    text = "".join(without_comments(text) for text in kernel_files().values())
    for struct, fields in (("settings", SETTINGS_DTYPE.fields), (r"(?:frame|then|past\[\w+\])", FRAME_DTYPE.fields)):
        assert set(re.findall(rf"\b{struct}\.(\w+)", text)) == set(fields or ())
    assert set(Settings.__struct_fields__) > HOST_SETTINGS


def test_sixteen_lanes_give_the_same_bits() -> None:
    # Of what runs so; test_resolve.py has the resolve, optimised, and with it what the stages give.
    # PoCL 3.0 cannot build 16 lanes for every CPU: LLVM may end the whole process, so it is tried in one of its own.
    kernels = ("gather", "gather_windows", "mix_windows")
    code = (
        "from tests.kernels.test_twins import compared, strict\n"
        f"print({{kernel: compared(kernel, strict(16)) for kernel in {kernels}}})"
    )
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    ended = "LLVM ERROR" in child.stderr or child.returncode < 0 or "does not build" in child.stderr
    if child.returncode and ended and device().device.cl_device.platform.name == POCL:
        pytest.skip(f"the driver cannot build 16 lanes here: {child.stderr.strip().splitlines()[-1:]}")
    assert child.stdout.strip() == str(dict.fromkeys(kernels, 0)), child.stderr
