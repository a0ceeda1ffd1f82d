"""Pictures to look at or to judge, whoever wrote them: the colour of frames, and nothing else of them."""

from __future__ import annotations

from collections.abc import Sequence as Many
from functools import partial
from pathlib import Path
from typing import Self

from cltaa.exr.channels import COLOUR
from cltaa.files.names import name_of, number_of
from cltaa.frames import Image
from cltaa.inputs.convert import linear_colour
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.intake import open_intake
from cltaa.inputs.parts import read_any_header
from cltaa.inputs.png_images import is_png, open_png
from cltaa.inputs.profile import Encoding, Profile, load_profile
from cltaa.inputs.profile_text import override
from cltaa.inputs.roles import describe
from cltaa.sequences.frame_numbers import FrameRange, OnBreak
from cltaa.sequences.images import ChangedImages, ImageSequence
from cltaa.sequences.sources import open_images


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
        channels = describe({"colour": intake.roles["colour"]}, len(intake.sets) > 1)
        return [f"profile {intake.profile.name}: {intake.reason}", channels]

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
    """Open images as ``open_images`` does, with its options, a folder of another tool's files by a profile, or PNGs.

    Of the latter a missing frame is no error before it is asked for. Of channels R, G and B that are not cltaa's own a
    profile only says how they are encoded. Raises what ``open_images`` and ``open_intake`` raise.
    """
    if is_png(path):
        return open_png(path, gaps=gaps, frames=frames)
    asked = override(Profile() if profile == "auto" else load_profile(profile), assignments)
    if not _of_another(path) and not asked.colour.view:
        images = open_images(path, verify=verify, gaps=gaps, frames=frames)
        encoded = asked.colour.encoding is Encoding.SRGB
        if not encoded or _own(images):
            return images
        return ChangedImages(images, partial(linear_colour, encoding=Encoding.SRGB), ["colour.encoding srgb, as asked"])
    intake = open_intake(path, profile=profile, assignments=assignments, gaps=OnBreak.RESET, frames=frames)
    return ForeignImages(ForeignSequence(path, intake, sorted(intake.declared), strict=False, verify=verify))


def stated(path: Path) -> dict[str, object]:
    """The attributes of an EXR's header; a PNG states none. Raises InputMissing or DataError."""
    return {} if is_png(path) else read_any_header(path).attributes


def _own(images: ImageSequence) -> bool:
    """True for what cltaa wrote, which is linear."""
    return any(name.startswith("cltaa:") for name in read_any_header(images.path(images.first)).attributes)


def _of_another(path: Path) -> bool:
    """True for a folder of files of several names, or whose first has its colour under other names, or in a part."""
    files = sorted(path.glob("*.exr")) if path.is_dir() else []
    if not files:
        return False
    if len({name_of(file) for file in files if number_of(file) is not None}) > 1:
        return True
    return not set(COLOUR) <= read_any_header(files[0]).layout.channels.keys()
