"""What rounding may have turned: comparisons of numbers with errors, in three values, and whole parts of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


class Decision(NDArrayOperatorsMixin):
    """A mask that rounding may have turned: what the values say, where it is surely so, and where possibly."""

    def __init__(self, value: Mask, surely: Mask, possibly: Mask) -> None:
        self.value, self.surely, self.possibly = value, surely, possibly

    @property
    def open(self) -> Mask:
        """Where either answer can be reached."""
        return self.possibly & ~self.surely

    def any(self) -> bool:
        """True where it is possible anywhere."""
        return bool(self.possibly.any())

    def __getitem__(self, index: Any) -> Decision:
        """A part of the mask."""
        return Decision(self.value[index], self.surely[index], self.possibly[index])

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        """And, or, not: in three values."""
        parts = [decision(part) for part in inputs]
        if ufunc is np.invert:
            only = parts[0]
            return Decision(~only.value, ~only.possibly, ~only.surely)
        if ufunc not in (np.bitwise_and, np.bitwise_or) or method != "__call__":
            return NotImplemented
        a, b = parts
        return Decision(ufunc(a.value, b.value), ufunc(a.surely, b.surely), ufunc(a.possibly, b.possibly))


def decision(given: Any) -> Decision:
    """A mask in three values; a plain one is certain."""
    if isinstance(given, Decision):
        return given
    mask = np.asarray(given, bool)
    return Decision(mask, mask, mask)


class Whole(NDArrayOperatorsMixin):
    """Whole numbers [H, W] with a mask of those that rounding may have made others: where a texel lies."""

    def __init__(self, value: NDArray[np.int64], open_at: Mask) -> None:
        self.value, self.open = value, open_at

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        """Sums, halves and parities, with plain whole numbers too; one that rounding may turn turns the result."""
        if ufunc not in (np.add, np.right_shift, np.bitwise_and) or method != "__call__" or options:
            return NotImplemented
        turned = np.logical_or.reduce([part.open for part in inputs if isinstance(part, Whole)])
        return Whole(ufunc(*(part.value if isinstance(part, Whole) else part for part in inputs)), turned)
