"""Numbers that carry their error: the second oracle is the twins themselves, run on these instead of on float32.

A ``Bounded`` holds float64 values and, beside each, a bound of the distance to what any float32 program may get that
does the same operations in the same order: every operation adds its own rounding to the errors of its operands (the
running error analysis of Higham 2002, section 3.3, second-order terms included). Contraction only leaves roundings out,
so it stays inside. A comparison that the errors leave open gives a ``Decision`` that may fall either way: a choice
between nearly equal numbers (a maximum) is as wide as both together; a choice between different ones is reachable on
both sides, and its error is infinite. Such pixels are counted, not compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, ClassVar

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

from tests.numerics import digits
from tests.numerics.decision import Decision, Mask, Whole, decision

Values = NDArray[np.float64]

SINGLE = 2.0**-24 * (1 + 2.0**-20)  # unit roundoff of float32, and room for the float64 of this analysis itself
DIVIDE = 5 * SINGLE  # 2.5 ulp: what OpenCL asks of a division in single precision
ROOT = 6 * SINGLE  # 3 ulp: of a square root
LARGEST = float(np.finfo(np.float32).max)  # what may exceed it may become infinite
LEAST = 2.0**-126  # the smallest normal number: a device may flush what is below
# Two sides of an open choice that differ by no more than this many times their errors are one continuous function.
CONTINUOUS = 4.0


class Bounded(NDArrayOperatorsMixin):
    """Values with the error that float32 may have made in each; ``dtype.type`` makes coefficients."""

    class Coefficients:
        """What the twins take for the type of their numbers."""

        dtype = np.dtype(np.float64)

        @staticmethod
        def type(value: float) -> Bounded:
            """A coefficient: kernels hold it rounded to float32."""
            exact = np.asarray(value, np.float64)
            return Bounded(exact, np.abs(np.float32(value) - exact))

    dtype: ClassVar[Any] = Coefficients()

    def __init__(self, value: Values, error: Values) -> None:
        self.value, self.error = value, error

    @classmethod
    def exact(cls, value: Any) -> Bounded:
        """What the device was given."""
        with np.errstate(invalid="ignore"):  # signalling NaN
            values = np.asarray(value).astype(np.float64)
        return cls(values, np.zeros_like(values))

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the values."""
        return self.value.shape

    def __len__(self) -> int:
        """Planes."""
        return len(self.value)

    def __iter__(self) -> Iterator[Bounded]:
        """Plane by plane, as views."""
        return (self[index] for index in range(len(self)))

    def __getitem__(self, index: Any) -> Bounded:
        """A view of a part; texels at places that rounding may have turned can be any."""
        if not isinstance(index, tuple) or not any(isinstance(part, Whole) for part in index):
            return Bounded(self.value[index], self.error[index])
        at = tuple(part.value if isinstance(part, Whole) else part for part in index)
        turned = np.logical_or.reduce([part.open for part in index if isinstance(part, Whole)])
        return Bounded(self.value[at], np.where(turned, np.inf, self.error[at]))

    def __setitem__(self, index: Any, given: Any) -> None:
        """Write values and errors."""
        source = bounded(given)
        self.value[index], self.error[index] = source.value, source.error

    def copy(self) -> Bounded:
        """Values and errors of its own."""
        return Bounded(self.value.copy(), self.error.copy())

    def broadcast(self, shape: tuple[int, ...]) -> Bounded:
        """The same number everywhere."""
        return Bounded(np.broadcast_to(self.value, shape), np.broadcast_to(self.error, shape))

    def reshape(self, *shape: int) -> Bounded:
        """The same numbers in another shape."""
        return Bounded(self.value.reshape(shape), self.error.reshape(shape))

    def astype(self, dtype: Any) -> Any:
        """Whole numbers by themselves; the twins' own real changes nothing."""
        return Whole(self.value.astype(dtype), self.error != 0) if dtype is np.int64 else self

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        """Arithmetic and comparisons, with their roundings."""
        if method != "__call__" or options or ufunc not in _OPERATIONS:
            return NotImplemented
        with np.errstate(all="ignore"):  # an infinite error and a NaN both mean: not compared
            return _OPERATIONS[ufunc](*(bounded(part) for part in inputs))

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        """A choice, or an array of the same shape."""
        return _FUNCTIONS[function](*args, **options)


def bounded(given: Any) -> Bounded:
    """A number of the analysis: a float is a coefficient, anything else is exact."""
    if type(given) is float:
        return Bounded.Coefficients.type(given)
    return given if isinstance(given, Bounded) else Bounded.exact(given)


def _rounded(value: Values, carried: Values, unit: float, kept: Any = False) -> Bounded:
    """A result whose operands' errors come to ``carried``, with the rounding of the operation unless it is ``kept``."""
    size = np.abs(value)
    flushed = (size - carried < LEAST) & ((value != 0) | (carried > 0))
    error = carried + np.where(kept, 0.0, unit * (size + carried)) + np.where(flushed, LEAST, 0.0)
    return Bounded(value, np.where(size + error <= LARGEST, error, np.inf))


def _zero(a: Bounded) -> Mask:
    nothing: Mask = (a.value == 0) & (a.error == 0)
    return nothing


def _power_of_two(a: Bounded) -> Mask:
    power: Mask = (np.abs(np.frexp(a.value)[0]) == 0.5) & (a.error == 0)
    return power


def _representable(value: Values, a: Bounded, b: Bounded) -> Mask:
    single: Mask = (value.astype(np.float32) == value) & (a.error == 0) & (b.error == 0)
    return single


def _add(a: Bounded, b: Bounded) -> Bounded:
    value = a.value + b.value
    return _rounded(value, a.error + b.error, SINGLE, _zero(a) | _zero(b) | _representable(value, a, b))


def _subtract(a: Bounded, b: Bounded) -> Bounded:
    return _add(a, Bounded(-b.value, b.error))


def _multiply(a: Bounded, b: Bounded) -> Bounded:
    value = a.value * b.value
    carried = np.abs(a.value) * b.error + np.abs(b.value) * a.error + a.error * b.error
    kept = _power_of_two(a) | _power_of_two(b) | _zero(a) | _zero(b) | _representable(value, a, b)
    return _rounded(value, carried, SINGLE, kept)


def _divide(a: Bounded, b: Bounded) -> Bounded:
    value, least = a.value / b.value, np.abs(b.value) - b.error
    carried = np.where(least > 0, (a.error + np.abs(value) * b.error) / np.abs(least), np.inf)
    return _rounded(value, carried, DIVIDE, _zero(a))


def _root(a: Bounded) -> Bounded:
    value = np.sqrt(a.value)
    lower, upper = np.sqrt(np.maximum(a.value - a.error, 0)), np.sqrt(a.value + a.error)
    return _rounded(value, np.maximum(value - lower, upper - value), ROOT, _zero(a))


def _mantissa(a: Bounded) -> tuple[Bounded, NDArray[np.intc]]:
    value, error, exponent = digits.mantissa(a.value, a.error)
    return Bounded(value, error), exponent


def _compare(ufunc: np.ufunc) -> Callable[[Bounded, Bounded], Decision | Mask]:
    def compare(a: Bounded, b: Bounded) -> Decision | Mask:
        slack, value = a.error + b.error, ufunc(a.value, b.value)
        if not np.any(slack):
            return np.asarray(value)
        undecided = ~(np.abs(a.value - b.value) > slack) & (slack != 0) & ~np.isnan(a.value) & ~np.isnan(b.value)
        return Decision(value, value & ~undecided, value | undecided)

    return compare


def _where(condition: Any, first: Any, second: Any) -> Any:
    choice, x, y = decision(condition), bounded(first), bounded(second)
    with np.errstate(all="ignore"):
        value, error = np.where(choice.value, x.value, y.value), np.where(choice.value, x.error, y.error)
        apart = np.abs(x.value - y.value)
        both = np.maximum(error, apart + np.where(choice.value, y.error, x.error))
        jumps = ~(apart <= CONTINUOUS * (x.error + y.error))
        return Bounded(value, np.where(choice.open, np.where(jumps, np.inf, both), error))


_OPERATIONS: dict[np.ufunc, Callable[..., Any]] = {
    np.add: _add,
    np.subtract: _subtract,
    np.multiply: _multiply,
    np.true_divide: _divide,
    np.sqrt: _root,
    np.floor: lambda a: Bounded(*digits.floor(a.value, a.error)),
    np.trunc: lambda a: Bounded(*digits.truncated(a.value, a.error)),
    np.frexp: _mantissa,
    np.ldexp: lambda a, exponent: Bounded(*digits.scaled(a.value, a.error, exponent.value)),
    np.copysign: lambda a, b: Bounded(*digits.signed(a.value, a.error, b.value, b.error)),
    np.negative: lambda a: Bounded(-a.value, a.error),
    np.absolute: lambda a: Bounded(np.abs(a.value), a.error),
    **{
        ufunc: _compare(ufunc)
        for ufunc in (np.greater, np.greater_equal, np.less, np.less_equal, np.equal, np.not_equal)
    },
}
_FUNCTIONS: dict[Any, Callable[..., Any]] = {
    np.where: _where,
    np.zeros_like: lambda like: Bounded.exact(np.zeros(like.shape)),
    np.full_like: lambda like, given: bounded(given).broadcast(like.shape),
    np.ones_like: lambda like: Bounded.exact(np.ones(like.shape)),
    np.broadcast_to: lambda given, shape: given.broadcast(shape),
    np.stack: lambda parts: Bounded(np.stack([part.value for part in parts]), np.stack([part.error for part in parts])),
}
