"""Pictures to look at or to judge, whoever wrote them: the colour of frames, and nothing else of them."""

from __future__ import annotations

from collections.abc import Sequence as Many
from pathlib import Path
from typing import Self

from cltaa.exr_channels import COLOUR
from cltaa.frame_numbers import FrameRange, OnBreak
from cltaa.frames import Image
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.intake import open_intake
from cltaa.inputs.parts import read_any_header
from cltaa.inputs.roles import describe
from cltaa.sources import ImageSequence, open_images


class ForeignImages(ImageSequence):
    """The colour of another tool's frames as an ``ImageSequence``."""

    def __init__(self, sequence: ForeignSequence) -> None:
        """Take the frames of ``sequence``."""
        self.sequence = sequence
        self.folder, self.name, self.verify = sequence.folder, sequence.name, sequence.verify
        self.gaps, self.on_resize, self.step = sequence.gaps, sequence.on_resize, sequence.step
        self._paths = {number: sequence.path(number) for number in sequence.numbers}
        self.layouts = sequence.layouts

    @property
    def notes(self) -> list[str]:
        """Profile and why, and the channels that are the colour."""
        intake = self.sequence.intake
        return [f"profile {intake.profile.name}: {intake.reason}", describe({"colour": intake.roles["colour"]})]

    def image(self, number: int) -> Image:
        """Read the colour of one frame number, [H, W, 3] linear float32."""
        return self.sequence.colour(number)

    def select(self, first: int, last: int) -> Self:
        """Return the frames ``first`` to ``last``, both included."""
        return type(self)(self.sequence.select(first, last))


def open_pictures(
    path: Path,
    *,
    verify: bool = True,
    gaps: OnBreak = OnBreak.ERROR,
    frames: FrameRange | None = None,
    profile: str = "auto",
    assignments: Many[str] = (),
) -> ImageSequence:
    """Open images as ``open_images`` does, with its options, and a folder of another tool's files by a profile.

    Of the latter a missing frame is no error before it is asked for. Raises what ``open_images`` and ``open_intake``
    raise.
    """
    if not _of_another(path):
        return open_images(path, verify=verify, gaps=gaps, frames=frames)
    intake = open_intake(path, profile=profile, assignments=assignments, gaps=OnBreak.RESET, frames=frames)
    return ForeignImages(ForeignSequence(path, intake, sorted(intake.declared), strict=False, verify=verify))


def _of_another(path: Path) -> bool:
    """True for a folder whose first file has its colour under other names, or in a part."""
    files = sorted(path.glob("*.exr")) if path.is_dir() else []
    if not files:
        return False
    return not set(COLOUR) <= read_any_header(files[0]).layout.channels.keys()
