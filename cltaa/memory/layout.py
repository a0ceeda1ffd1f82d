"""How images lie in memory: planes of floats with a halo that repeats the edge, one stride for all of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cltaa.constants import PAD_X, PAD_Y, ROW_ALIGNMENT

Plane = NDArray[Any]


class Layout(NamedTuple):
    """Size of an image and of the planes that hold it, in texels."""

    width: int
    height: int

    @property
    def stride(self) -> int:
        """Texels from one row to the next."""
        return -(-self.width // ROW_ALIGNMENT) * ROW_ALIGNMENT + 2 * PAD_X

    @property
    def rows(self) -> int:
        """Rows of a plane, halo included."""
        return self.height + 2 * PAD_Y

    @property
    def plane(self) -> int:
        """Texels of a plane."""
        return self.stride * self.rows

    @property
    def held(self) -> slice:
        """Rows of a plane that hold rows of the image."""
        return slice(PAD_Y, PAD_Y + self.height)

    def inside(self, planes: Plane) -> Plane:
        """View of the image inside ``planes`` [..., rows, stride] -> [..., height, width]."""
        return planes[..., self.held, PAD_X : PAD_X + self.width]

    def extend_edges(self, planes: Plane) -> None:
        """Repeat the edge of ``planes`` [..., rows, stride] into the halo, in place."""
        first_row, last_row, last_column = self.held.start, self.held.stop - 1, PAD_X + self.width - 1
        image = planes[..., self.held, :]
        image[..., :PAD_X] = image[..., PAD_X : PAD_X + 1]
        image[..., last_column + 1 :] = image[..., last_column : last_column + 1]
        planes[..., :first_row, :] = planes[..., first_row : first_row + 1, :]
        planes[..., last_row + 1 :, :] = planes[..., last_row : last_row + 1, :]

    def zeros(self, planes: int, dtype: Any = np.float32) -> Plane:
        """``planes`` planes of zeros, [planes, rows, stride]."""
        return np.zeros((planes, self.rows, self.stride), dtype)
