"""The float64 oracle: what its bound covers, and that fast kernels lie inside it and come near it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from cltaa.core.build import Build, Storage, window_planes
from cltaa.core.parameters import Accumulate
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.reference.gather_window import repeats_previous
from cltaa.reference.real import greater
from tests.kernels.hard_planes import KEPT
from tests.kernels.stage_chain import (
    ALL_STEPS,
    STAGES,
    WRITES,
    chain_work,
    changed,
    rows_together,
    run_stage,
    variant_names,
    variants,
)
from tests.numerics.bounded import Bounded
from tests.numerics.decision import Decision
from tests.numerics.tolerances import (
    Row,
    bounds_of,
    compare_strict,
    difference,
    row_of,
    stored_rows,
    strict_rows,
    tolerance_rows,
)
from tests.numerics.units import OUTPUTS

# A bound that none of many values comes within a hundredth of says nothing. Few may all be right: 2 counts of a span of
# a million sum up fractions (1024 x 1024).
TOO_LOOSE, MANY = 0.01, 100
DEFAULT = Build(steps=ALL_STEPS)
# Most values that may be left out because either side of a choice can be reached. Worst seen: 1.6 % for the clips that
# rounding in one channel can turn (clip-current, clip-unguarded, 1024 x 1024), 2.4 % in the fused kernel with the
# default's choices (256 x 256; 2.01 % at 96 x 96).
MOST_OPEN = 0.03


def rows_of(kernel: str, build: Build, side: int = 96, on: DeviceLauncher | None = None) -> list[Row]:
    launcher = on or DeviceLauncher()
    work, shaped = chain_work(side, side), launcher.build(build)
    written, bounds = run_stage(kernel, shaped, work, launcher), bounds_of(kernel, shaped, work)
    return [row_of(output, work, written, bounds) for output in OUTPUTS if output.kernel == kernel]


def outside(rows: list[Row]) -> list[Row]:
    return [row for row in rows if row.outside or row.open > MOST_OPEN]


def check(rows: list[Row]) -> None:
    assert outside(rows) == []
    assert [row for row in rows if row.rounded > MANY and row.ratio < TOO_LOOSE] == []


def test_bounds_of_integer_parts_and_exponents_include_rounding() -> None:
    numbers: Any = Bounded(np.array([3.5, 3.999, -4.0001, 0.7]), np.array([0.25, 0.01, 0.01, 1.0]))
    whole, part = np.trunc(numbers), np.floor(numbers)
    assert (whole.value.tolist(), whole.error.tolist()) == ([3.0, 3.0, -4.0, 0.0], [0.0, 1.0, 1.0, 1.0])
    assert part.error.tolist() == [0.0, np.inf, np.inf, np.inf]
    mantissa, exponent = np.frexp(numbers)
    assert mantissa.error.tolist() == [0.0625, np.inf, np.inf, np.inf]
    back = np.ldexp(mantissa, exponent)
    assert back.value.tolist() == numbers.value.tolist()
    assert back.error[0] == 0.25
    two: Any = Bounded.exact([2.0] * 4)
    signed = np.copysign(two, numbers)
    assert (signed.value.tolist(), signed.error.tolist()) == ([2.0, 2.0, -2.0, 2.0], [0.0, 0.0, 0.0, np.inf])


# What is left out leaves no sum in another order.
@pytest.mark.parametrize(
    ("kernel", "name"),
    [names for k in WRITES for names in variant_names(k, DEFAULT) if not names.values[1].endswith(("=False", "=none"))],
)
def test_a_fast_kernel_lies_inside_its_bound_and_near_it(kernel: str, name: str) -> None:
    check(rows_of(kernel, variants(kernel, DEFAULT)[name]))


@pytest.mark.parametrize(("kernel", "row"), [(k, n) for k in STAGES for n in range(len(rows_together(k, DEFAULT)))])
def test_many_choices_lie_inside_their_bounds(kernel: str, row: int) -> None:
    changes = rows_together(kernel, DEFAULT)[row]
    assert not outside(rows_of(kernel, changed(DEFAULT, changes))), changes


# One lane, not strict: the minimum and maximum of a GPU, and of NVIDIA's its reciprocal and root. Another compiler
# builds it for a GPU: there is no use in optimising it here.
GPU = replace(DEFAULT, lanes=1)


@pytest.mark.parametrize("kernel", WRITES)
def test_the_kernels_of_a_gpu_lie_inside_their_bounds(kernel: str) -> None:
    check(rows_of(kernel, GPU))


@pytest.mark.parametrize(("accumulate", "lanes"), [(Accumulate.COUNT, 0), (Accumulate.EXPONENTIAL, 1)])
def test_a_weight_in_a_mean_lies_inside_its_bound(accumulate: Accumulate, lanes: int) -> None:
    steps, choices = replace(ALL_STEPS, reactive=False), replace(DEFAULT.choices, accumulate=accumulate)
    check(rows_of("blend", replace(DEFAULT, steps=steps, choices=choices, lanes=lanes)))


@pytest.mark.big
@pytest.mark.parametrize(
    ("kernel", "name"), [(k, name) for k in WRITES for name in variants(k, GPU) if name != "default"]
)
def test_every_choice_of_a_gpu_lies_inside_its_bound(kernel: str, name: str) -> None:
    check(rows_of(kernel, variants(kernel, GPU)[name]))


def test_what_is_stored_in_halves_is_off_by_their_rounding_and_no_more() -> None:
    check(list(stored_rows(96, DeviceLauncher())))


def test_every_channel_of_every_kernel_has_a_row() -> None:
    for kernel, written in WRITES.items():
        for plane, count in written.items():
            channels = [i for o in OUTPUTS if (o.kernel, o.plane) == (kernel, plane) for i in range(count)[o.channels]]
            each = window_planes(ALL_STEPS) if plane == "windows" else count
            stored = [
                k for k in range(count) if plane != "windows" or not repeats_previous(k // each, KEPT, KEPT, DEFAULT)
            ]
            assert channels == stored, (kernel, plane)


@pytest.mark.big
@pytest.mark.parametrize("kernel", WRITES)
def test_a_million_pixels_of_every_stage_lie_inside(kernel: str) -> None:
    check(list(tolerance_rows(1024, DeviceLauncher(), [kernel])))


@pytest.mark.big
def test_a_million_pixels_of_what_is_stored_in_halves_lie_inside() -> None:
    check(list(stored_rows(1024, DeviceLauncher())))


@pytest.mark.big
@pytest.mark.parametrize("kernel", WRITES)
def test_a_million_pixels_of_every_strict_kernel_are_the_twins(kernel: str) -> None:
    assert [row for row in strict_rows(1024, DeviceLauncher(), [kernel]) if row.different] == []


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_a_difference_is_counted_in_the_numbers_between(kind: type[np.floating[Any]]) -> None:
    ours = np.array([1.5, -2.0, 0.0, 7.0, np.nan, np.inf], kind)
    theirs = np.array([np.nextafter(kind(1.5), kind(0)), -2.0, -0.0, 7.0, np.nan, np.inf], kind)
    found = difference("blend", {"output": ours}, {"output": theirs})
    assert (found.values, found.different, found.ulps) == (6, 2, 1)
    assert found.relative == pytest.approx(np.finfo(kind).eps / 1.5)
    two_away = {"output": np.nextafter(theirs[:1], kind(0))}
    assert difference("blend", {"output": ours[:1]}, two_away).ulps == 2


@pytest.mark.parametrize("storage", list(Storage))
def test_a_strict_blend_is_its_twin_in_every_storage(storage: Storage) -> None:
    build = DeviceLauncher().build(Build(steps=ALL_STEPS, strict=True, storage=storage))
    assert compare_strict("blend", build, chain_work(), DeviceLauncher()).different == 0


def singles(seed: int, count: int = 20_000) -> np.ndarray[tuple[int], np.dtype[np.float32]]:
    random = np.random.default_rng(seed)
    return (random.normal(size=count) * 10 ** random.uniform(-6, 6, count)).astype(np.float32)


@pytest.mark.parametrize("operation", [np.add, np.subtract, np.multiply, np.divide])
def test_the_bound_covers_what_float32_does(operation: np.ufunc) -> None:
    a, b, c, d = (singles(seed) for seed in range(4))
    found = operation(operation(a, b), operation(c, d))
    wide = operation(operation(Bounded.exact(a), b), operation(Bounded.exact(c), d))
    error = np.abs(found - wide.value)
    assert (error <= wide.error).all()
    assert (error > 0.1 * wide.error).any()  # worst seen: 0.99 of it for sums, 0.43 for quotients (5 u are allowed)


def test_the_root_of_nearly_nothing_is_uncertain_by_its_own_size() -> None:
    nearly = Bounded(np.array([0.0, 1.0]), np.array([1e-8, 1e-8]))
    assert np.sqrt(nearly).error == pytest.approx([1e-4, 5e-9 + 6 * 2.0**-24], rel=1e-3)


def test_a_floor_that_may_fall_either_way_is_left_open() -> None:
    close = Bounded(np.array([2.0, 2.5]), np.array([1e-7, 1e-7]))
    assert np.floor(close).error.tolist() == [np.inf, 0.0]


def test_a_maximum_of_near_equals_has_a_bound_and_an_open_choice_has_none() -> None:
    a: Any = Bounded(np.array([1.0]), np.array([1e-7]))
    b: Any = Bounded(np.array([1.0 + 1e-8]), np.array([1e-7]))
    larger: Any = greater(a, b)
    assert larger.error[0] < 3e-7
    turned = a > b
    assert isinstance(turned, Decision)
    assert turned.open.all()
    chosen: Any = np.where(turned, a, Bounded.exact([5.0]))  # type: ignore[call-overload]
    assert chosen.error[0] == np.inf


def test_decisions_combine_in_three_values() -> None:
    yes, no = np.array([True]), np.array([False])
    maybe = Decision(yes, no, yes)
    assert [bool(d.open[0]) for d in (maybe & yes, maybe & no, maybe | yes, maybe | no, ~maybe)] == [
        True,
        False,
        False,
        True,
        True,
    ]


def test_a_texel_at_a_place_that_may_be_another_is_left_open() -> None:
    place: Any = np.floor(Bounded(np.array([1.0, 2.5]), np.array([1e-7, 1e-7]))).astype(np.int64) + 1
    read = Bounded.exact([[0.0, 1.0, 2.0, 3.0]])[np.zeros(2, int), place]
    assert read.value.tolist() == [2.0, 3.0]
    assert read.error.tolist() == [np.inf, 0.0]


def test_an_overflow_is_left_open() -> None:
    assert (Bounded.exact([3e38]) * Bounded.exact([10.0])).error[0] == np.inf
