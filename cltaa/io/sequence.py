"""Sequences on disk: folders of ``<name>.<frame:04d>.exr``, opened as a whole and read a frame at a time.

Opening reads every file's layout (not its pixels), so that a gap, another size or a truncated file is reported before
the first frame is processed. Only one frame is in memory at a time, unless the caller keeps more.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from collections.abc import Sequence as Many
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Self

import numpy as np

from cltaa.errors import DataError, UsageError, check_flags, public
from cltaa.frame import Effect, Frame, Image, name_effects
from cltaa.io.denoiser_guides import guides_of
from cltaa.io.exr_frame import CHANNEL_OF, OF_FRAMES, check_float_channels, check_number, frame_outline
from cltaa.io.exr_layout import Layout, covers
from cltaa.io.exr_read import FrameFile, read_colour, read_frame_and_header, read_header, read_planes
from cltaa.io.manifest import read_capture_record, recorded_hashes
from cltaa.io.names import Named, name_of, number_of, selection_of, shows_number
from cltaa.io.numbered import (
    FrameRange,
    NumberedFiles,
    OnBreak,
    asked_alone,
    check_same_size,
    even_step,
    frame_missing,
    named_frames,
    no_such_frame,
    no_truth,
    numbered_files,
)


class ImageSequence(NumberedFiles):
    """Colour only: a reference, or resolved frames. Iteration yields ``[H, W, 3]`` linear float32 in frame order."""

    @public("ImageSequence.image")
    def image(self, number: int, *, alpha: bool = False) -> Image:
        """Read one frame number, [H, W, 3] linear float32; ``alpha`` appends A where the file has it."""
        path, picture = self.path(number), self.layouts[number]
        return read_colour(path, sha256=self.sha256(number), picture=picture, alpha=alpha)

    def __iter__(self) -> Iterator[Image]:
        """Read the frames one after another."""
        return (self.image(number) for number in self.numbers)


class ChangedImages(ImageSequence):
    """The images of ``images``, each changed by ``change`` when it is read."""

    def __init__(
        self,
        images: ImageSequence,
        change: Callable[[Image], Image],
        notes: list[str],
        layouts: Mapping[int, Layout] | None = None,
    ) -> None:
        """Wrap the files of ``images``; ``notes`` say how they are read, ``layouts`` what remains of each."""
        super().__init__(**images.alike() | {"layouts": layouts or images.layouts})
        self._images, self._change, self._notes = images, change, notes

    @property
    def notes(self) -> list[str]:
        """How they are read."""
        return self._notes

    def image(self, number: int, *, alpha: bool = False) -> Image:
        """Read one frame number, [H, W, 3] linear float32; ``alpha`` appends A where the file has it."""
        return self._change(self._images.image(number, alpha=alpha))

    def of_numbers(self, numbers: Many[int]) -> Self:
        """Return the frames of these numbers."""
        return type(self)(self._images.of_numbers(numbers), self._change, self._notes, self.layouts)


def as_shown(images: ImageSequence, by: NumberedFiles) -> ImageSequence:
    """Return ``images``, cropped to the region that ``by`` shows; DataError where they do not cover it."""
    mine, theirs = by.layouts[by.first], images.layouts[images.first]
    if theirs.display_size == mine.display_size and theirs.region != mine.region and covers(theirs.region, mine.region):
        part = images.shows(mine.region)
        layouts = {number: layout.cropped(mine.region) for number, layout in images.layouts.items()}
        return ChangedImages(images, lambda image: image[part].copy(), images.notes, layouts)  # frees the rest
    check_same_size(by, images)
    return images


RESOLVED = "cltaa:preset"  # an attribute of images that a resolve wrote


class FrameSequence(NumberedFiles):
    """A captured sequence. Iteration yields a ``Frame`` at a time, in frame order."""

    converted = False  # whether decoded channels are converted to make a frame
    found: frozenset[Effect] | None = None  # in frames that declare none
    truth: ImageSequence | None = None  # a given one, in place of that in ``reference/``
    replaced: frozenset[str] = frozenset()  # channels not named R, G, B and A that a resolve replaces

    @property
    def reading(self) -> dict[str, Any]:
        """What decides the bits of frames and is not in the files: the step, and found effects."""
        found = {} if self.found is None else {"found": sorted(self.found)}
        return ({} if self.step == 1 else {"step": self.step}) | found

    @property
    def files(self) -> tuple[Path, ...]:
        """Every file from which frames are read."""
        return self.paths

    def files_of(self, number: int) -> set[Path]:
        """Return the files from which a frame is read."""
        return {self.path(number)}

    @property
    def undeclared(self) -> frozenset[str]:
        """Attributes of a frame's header that its files do not declare and the reader filled in; none for own files."""
        return frozenset()

    @property
    def holds(self) -> frozenset[str]:
        """Which of motion, alpha and reactive at least one of its frames has."""
        return frozenset(part for part, name in CHANNEL_OF.items() if name in self.channels)

    @property
    def channels(self) -> frozenset[str]:
        """The channels that at least one of its frames holds, by the names of own files; no other is read."""
        return OF_FRAMES & {name for layout in self.layouts.values() for name in layout.channels}

    @property
    def attributes(self) -> Mapping[str, object]:
        """Attributes of the first frame's header, as its file holds them; reads no pixels."""
        return read_header(self.path(self.first)).attributes

    def refuse_result(self) -> None:
        """Raise UsageError for results of a resolve, which no longer hold the samples that one needs."""
        if (preset := self.attributes.get(RESOLVED)) is not None:
            what, cure = "these are results of cltaa resolve", "name the folder that they were made from"
            raise UsageError(what, path=self.folder, found=f"preset {preset}", cure=cure)

    def warn_of_truth(self) -> None:
        """Warn of frames that state many samples a pixel, as a truth does: a resolve takes frames of one."""
        samples = self.attributes.get("cltaa:samples")
        if isinstance(samples, int) and samples > 1:
            what = f"these are frames of {samples} samples a pixel, as a truth has"
            warnings.warn(f"{self.folder}: {what}; name the folder of their single samples", stacklevel=4)

    @cached_property
    def effects(self) -> frozenset[Effect] | None:
        """Effects that the first frame declares, or None."""
        return self.outline(self.first).effects

    @cached_property
    def reference(self) -> ImageSequence | None:
        """The truth of every frame, or None; raises InputMissing or DataError where it exists but does not fit."""
        reference = self.known_reference()
        if reference is None:
            return None
        for number in self.numbers:
            if number not in reference.layouts:
                raise no_truth(reference.folder / self.path(number).name, number, self.numbers, reference.numbers)
        return reference.select(self.first, self.last)

    def known_reference(self) -> ImageSequence | None:
        """Return the truth of those frames that have one, or None; DataError where it does not cover them."""
        folder = self.folder / "reference"
        if self.truth is not None:
            return as_shown(self.truth, self)
        return self.open_supersampled(folder) if folder.exists() else None

    def open_supersampled(self, folder: Path) -> ImageSequence:
        """Open a folder with the truth of some frames, or with a yardstick, cropped to what these frames show; raises
        DataError where it does not cover that."""
        return as_shown(asked_alone(partial(self._open_alike, folder), (self.first, self.last)), self)

    def _open_alike(self, folder: Path, frames: FrameRange | None) -> ImageSequence:
        """Open images in the way in which these frames are read."""
        return open_images(folder, verify=self.verify, gaps=OnBreak.RESET, frames=frames)

    @cached_property
    def sequence_json(self) -> dict[str, Any]:
        """Content of ``sequence.json``, or an empty dict where there is none."""
        return read_capture_record(self.folder)

    def of_numbers(self, numbers: Many[int]) -> Self:
        """Return the frames of these numbers, with the given truth and the found effects."""
        selected = super().of_numbers(numbers)
        selected.truth, selected.found = self.truth, self.found
        return selected

    def outline(self, number: int) -> Frame:
        """Return a frame of which only the header was read: its channels exist, and are empty."""
        path = self.path(number)
        outline = frame_outline(path, read_header(path).attributes, self.layouts[number])
        return replace(outline, index=number, step=self.step, found=self.found)

    def with_guides(self) -> tuple[Self, Mapping[str, str]]:
        """Return the sequence with a denoiser's guides among its channels, and why other candidates are none."""
        return self, {}

    @property
    def guides(self) -> Mapping[str, tuple[str, ...]]:
        """The channels that guide a denoiser of the first frame, by the names for messages (``guides_of``)."""
        return guides_of(self.layouts[self.first].channels)

    def guide_images(self, number: int) -> dict[str, Image]:
        """Read the guides of a denoiser for one frame number, [H, W, 3] float32 each."""
        layout = self.layouts[number]
        guides = guides_of(layout.channels)
        names = {name for triple in guides.values() for name in triple}
        planes = read_planes(layout.path, names, picture=layout) if names else {}
        stacked = {role: [planes[name] for name in triple] for role, triple in guides.items()}
        return {role: np.stack(its, -1).astype(np.float32) for role, its in stacked.items()}

    @public("FrameSequence.frame")
    def frame(self, number: int) -> Frame:
        """Read one frame by its number; raises UsageError for an unknown one, DataError where header and sequence
        disagree."""
        if not isinstance(number, int | np.integer) or number not in self.layouts:
            raise no_such_frame(self.folder, number, self.numbers)
        return self.frame_and_file(int(number))[0]

    def frame_and_file(self, number: int, kept: Collection[str] = ()) -> tuple[Frame, FrameFile]:
        """As ``frame``, with the header of its file, and the ``kept`` channels that are decoded with the frame."""
        path, picture = self.path(number), self.layouts[number]
        frame, header = read_frame_and_header(path, sha256=self.sha256(number), picture=picture)
        named = shows_number(path, number)  # a picture that is named by itself may have any name
        if "cltaa:frame" not in header.attributes or not named:  # its folder decides whether shot-003 is 3 or -3
            frame = replace(frame, index=number)
        if named:
            check_number(path, header.attributes, number)
        if frame.effects != self.effects:
            raise other_effects(self.path(number), number, self.effects, frame.effects)
        if self.step != 1 or self.found is not None:
            frame = replace(frame, step=self.step, found=self.found)
        return frame, FrameFile(header)

    def __iter__(self) -> Iterator[Frame]:
        """Read the frames one after another."""
        return (self.frame(number) for number in self.numbers)


# Programs that call it with a folder mean ``cltaa.open``.
FrameSequence.__init__ = public("FrameSequence", "cltaa.open(folder) makes one")(  # type: ignore[method-assign]
    NumberedFiles.__init__
)


def other_effects(path: Path, number: int, first: frozenset[Effect] | None, its: frozenset[Effect] | None) -> DataError:
    """Return the error for a frame that does not declare the effects of the first one."""
    expected, found = name_effects(first), name_effects(its)
    return DataError(
        "declares other effects than the first frame", path=path, frame=number, expected=expected, found=found
    )


@public("open")
def open_sequence(
    named: Named,
    *,
    verify: bool = True,
    gaps: OnBreak = OnBreak.ERROR,
    on_resize: OnBreak = OnBreak.ERROR,
    frames: FrameRange | None = None,
    step: int = 1,
) -> FrameSequence:
    """Open a folder of ``<name>.<frame:04d>.exr`` files, reading layouts but no pixels.

    ``named`` may also be one such file, a pattern of them as ``x.####.exr``, or several (``selection_of``). With
    ``verify`` every file that is read later must have the SHA-256 that ``sequence.json`` records for it. Raises
    InputMissing where the folder, its frames, a frame in the middle or one that ``sequence.json`` lists is missing
    (unless ``gaps`` allows it), DataError where files are damaged, differ in size (unless ``on_resize`` allows it) or
    belong to several sequences. ``frames`` are the numbers of the first and the last frame to take, both included; all
    others are ignored, and UsageError is raised unless both exist. ``step`` is the distance between numbers; each frame
    then directly follows the one before.
    """
    check_flags(verify=verify)
    place = selection_of(named)
    sequence = FrameSequence(
        *numbered_files(place), verify=verify, gaps=gaps, on_resize=on_resize, frames=frames, step=step
    )
    if verify and sequence.gaps is OnBreak.ERROR and frames is None and place.files is None:
        # A frame that is missing before the first or after the last is no gap, but the capture's record lists it.
        for name in recorded_hashes(sequence.folder):
            path = sequence.folder / name
            number = number_of(path)
            if number is not None and name_of(path) == sequence.name and number not in sequence.layouts:
                raise frame_missing(path, number)
    _warn_of_lacking(sequence)
    return sequence


def _warn_of_lacking(sequence: FrameSequence) -> None:
    """Warn where some frames lack motion, alpha or the reactive mask, as in a folder of two captures."""
    for part, name in CHANNEL_OF.items():
        lacking = [number for number in sequence.numbers if name not in sequence.layouts[number].channels]
        if 0 < len(lacking) < len(sequence):
            rest = "unlike the others: each frame is resolved with what it has"
            warnings.warn(f"{sequence.folder}: no {part} in {named_frames(lacking)}, {rest}", stacklevel=5)


def open_images(
    named: Named, *, verify: bool = True, gaps: OnBreak = OnBreak.ERROR, frames: FrameRange | None = None
) -> ImageSequence:
    """Open resolved or reference images as ``open_sequence`` does; raises DataError also where R, G or B is missing.

    A single file without a number is frame 0, and numbers may have an even step.
    """
    files = numbered_files(named)
    step = even_step(sorted(files[2]))  # no image depends on the one before it
    images = ImageSequence(*files, verify=verify, gaps=gaps, frames=frames, step=step)
    for layout in images.layouts.values():
        check_float_channels(layout, ("R", "G", "B"))
    return images
