"""Sequences of which the colour alone is looked at: truths, yardsticks, and what a resolve wrote."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Self

from cltaa.exr.layout import Window
from cltaa.exr.read import read_colour
from cltaa.frames import Image
from cltaa.sequences.numbered import NumberedFiles, check_same_size


class ImageSequence(NumberedFiles):
    """Colour only: a reference, or resolved frames. Iteration yields ``[H, W, 3]`` linear float32 in frame order."""

    @property
    def notes(self) -> list[str]:
        """What was decided about the files of another tool, line by line; own ones: nothing."""
        return []

    def image(self, number: int) -> Image:
        """Read the colour of one frame number, [H, W, 3] linear float32."""
        return read_colour(self.path(number), sha256=self.sha256(number))

    def __iter__(self) -> Iterator[Image]:
        """Read the frames one after another."""
        return (self.image(number) for number in self.numbers)


class RegionOfImages(ImageSequence):
    """What ``images`` show of a region, which begins at the first pixel of their display window; they cover it."""

    def __init__(self, images: ImageSequence, region: Window) -> None:
        """Take the files of ``images``."""
        vars(self).update(vars(images))
        self._images, self._region = images, region
        self.layouts = {number: layout.cropped(region) for number, layout in images.layouts.items()}

    @property
    def notes(self) -> list[str]:
        """Those of the images."""
        return self._images.notes

    def image(self, number: int) -> Image:
        """Read the colour of one frame number, [H, W, 3] linear float32."""
        return self._images.image(number)[self._images.shows(self._region)].copy()  # the rest is let go

    def select(self, first: int, last: int) -> Self:
        """Return the frames ``first`` to ``last``, both included."""
        return type(self)(self._images.select(first, last), self._region)


def as_shown(images: ImageSequence, by: NumberedFiles) -> ImageSequence:
    """``images``, or where they are of more than the region that ``by`` shows, that region of them.

    Raises DataError where they do not show it all.
    """
    mine, theirs = by.layouts[by.first], images.layouts[images.first]
    if theirs.display_size == mine.display_size and theirs.region != mine.region and theirs.covers(mine.region):
        return RegionOfImages(images, mine.region)
    check_same_size(by, images)
    return images
