"""Sequences of which the colour alone is looked at: truths, yardsticks, and what a resolve wrote."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Self

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


class ChangedImages(ImageSequence):
    """What ``change`` makes of each of ``images`` when it is read."""

    def __init__(self, images: ImageSequence, change: Callable[[Image], Image], notes: list[str]) -> None:
        """Take the files of ``images``; ``notes`` say how they are read."""
        vars(self).update(vars(images))
        self._images, self._change, self._notes = images, change, notes

    @property
    def notes(self) -> list[str]:
        """How they are read."""
        return self._notes

    def image(self, number: int) -> Image:
        """Read the colour of one frame number, [H, W, 3] linear float32."""
        return self._change(self._images.image(number))

    def select(self, first: int, last: int) -> Self:
        """Return the frames ``first`` to ``last``, both included."""
        selected = type(self)(self._images.select(first, last), self._change, self._notes)
        selected.layouts = {number: self.layouts[number] for number in selected.numbers}
        return selected


def as_shown(images: ImageSequence, by: NumberedFiles) -> ImageSequence:
    """``images``, or where they are of more than the region that ``by`` shows, that region of them.

    Raises DataError where they do not show it all.
    """
    mine, theirs = by.layouts[by.first], images.layouts[images.first]
    if theirs.display_size == mine.display_size and theirs.region != mine.region and theirs.covers(mine.region):
        part = images.shows(mine.region)
        region = ChangedImages(images, lambda image: image[part].copy(), images.notes)  # the rest is let go
        region.layouts = {number: layout.cropped(mine.region) for number, layout in images.layouts.items()}
        return region
    check_same_size(by, images)
    return images
