"""Sequences and pictures of other tools: EXR read by a profile, and 8-bit sRGB PNGs with straight alpha."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Collection, Iterable, Iterator, Mapping
from collections.abc import Sequence as Many
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from cltaa.core.frame_checks import check_camera, check_numbers
from cltaa.core.planes import haloed
from cltaa.errors import CltaaError, DataError
from cltaa.frame import NO_CAMERA, Effect, Frame, Image, format_effects
from cltaa.inputs.convert import check_depth, linear_colour, motion_px, planar_depth
from cltaa.inputs.intake import Intake, first_frames, intake_lines, open_intake
from cltaa.inputs.profile import Encoding, Profile, keys_of, load_profile, override
from cltaa.inputs.roles import (
    Place,
    assign,
    channel_missing,
    describe,
    guide_places,
    shown_name,
    whole_numbers,
)
from cltaa.io.content import open_regular
from cltaa.io.exr_frame import CHANNEL_OF, COLOUR, GROUPS, MATRICES, NO_PIXELS, OF_RESULTS, Pixels
from cltaa.io.exr_layout import Layout, placed
from cltaa.io.exr_read import FrameFile, ImageHeader, read_any_header, read_planes
from cltaa.io.manifest import file_sha256
from cltaa.io.names import Named, Selection, has_suffix, name_of, renumbered, selection_of
from cltaa.io.numbered import FrameRange, OnBreak, even_step, files_in, first_of, frame_missing, numbered_files
from cltaa.io.sequence import ChangedImages, FrameSequence, ImageSequence, open_images

SUFFIX = ".png"
HEADER = struct.Struct(">8s4x4sIIB")  # signature, length, type of the first chunk, columns, rows, bits per channel
SIGNATURE, FIRST = b"\x89PNG\r\n\x1a\n", b"IHDR"
# What a picture is not asked for, because its files need not have it.
COLOUR_ALONE = "depth.channels=none", "motion.channels=none none", "colour.reactive=none"
DEEPEST = 8  # bits per channel: Pillow drops the lower 8 of 16


def is_png(named: Named) -> bool:
    """Return True for PNGs, and for a folder with PNGs and no EXR."""
    place = selection_of(named)
    if place.files is not None:
        return all(has_suffix(path, SUFFIX) for path in place.files)
    there = [*place.folder.glob("*.*")]
    return not any(has_suffix(path, ".exr") for path in there) and any(has_suffix(path, SUFFIX) for path in there)


class PngImages(ImageSequence):
    """PNGs in linear light, premultiplied by alpha."""

    @property
    def notes(self) -> list[str]:
        """How the files are read."""
        return ["PNG, taken for sRGB: what was above white is lost"]

    @staticmethod
    def layout_of(path: Path) -> Layout:
        """Read the size from the header; raises InputMissing, and DataError for a file that is no 8-bit PNG."""
        with open_regular(path) as file:
            start = file.read(HEADER.size)
        if len(start) < HEADER.size or not start.startswith(SIGNATURE) or HEADER.unpack(start)[1] != FIRST:
            raise DataError("is not a PNG", path=path, cure="write it again")
        *_, width, height, bits = HEADER.unpack(start)
        if bits > DEEPEST:
            cure = "write it with 8 bits, or as EXR"
            raise DataError("too many bits a channel", path=path, expected=DEEPEST, found=bits, cure=cure)
        window = (0, 0, width - 1, height - 1)
        return Layout(path, dict.fromkeys("RGB", "uint"), window, window, "zip")

    def image(self, number: int, *, alpha: bool = False) -> Image:
        """Read one frame number, [H, W, 3] linear float32 over black, with ``alpha`` [H, W, 4] where the file has it;
        raises DataError for a damaged file."""
        from PIL import Image as Pillow  # imported late, because most comparisons read no PNG

        path = self.path(number)
        try:
            with Pillow.open(path) as file:
                texels = np.asarray(file.convert("RGBA"), np.float32) / np.float32(255)
                alpha = alpha and ("A" in file.getbands() or "transparency" in file.info)
        except (OSError, ValueError, SyntaxError, Pillow.DecompressionBombError) as error:
            raise DataError(f"the PNG cannot be read ({error})", path=path, cure="write it again") from error
        light = linear_colour(texels[..., :3], Encoding.SRGB) * texels[..., 3:]
        return np.concatenate([light, texels[..., 3:]], -1) if alpha else light


EFFECT_OF = {"motion": Effect.MOTION, "alpha": Effect.ALPHA, "reactive": Effect.REACTIVE}  # the effect of each channel


class ForeignSequence(FrameSequence):
    """A ``Sequence`` that converts frames on reading; ``strict`` False accepts wrong matrices."""

    converted = True

    def __init__(
        self,
        folder: Path,
        intake: Intake,
        numbers: Many[int],
        *,
        strict: bool = True,
        verify: bool = True,
        effects: frozenset[Effect] | None = None,
        guides: Mapping[str, tuple[Place, ...]] = MappingProxyType({}),
    ) -> None:
        """Take the decisions of ``open_intake``; channels of effects beyond the declared ``effects`` are not read."""
        self.intake, self._strict, self._declared, self._guides = intake, strict, effects, dict(guides)
        left_out = set() if effects is None else {role for role, effect in EFFECT_OF.items() if effect not in effects}
        self._roles = {role: places for role, places in intake.roles.items() if role not in left_out}
        resolved = (*self._roles["colour"], *self._roles.get("alpha", ()))
        own = (place.channel for place in resolved if place.files == resolved[0].files)
        # Of a layer: the alpha beside the result's colour would be that of another picture.
        self.replaced = frozenset(own).union(OF_RESULTS if "." in resolved[0].channel else ())
        label = intake.roles["colour"][0].files
        main = intake.sets[label]
        super().__init__(
            folder,
            label.rpartition("/")[2],
            {number: main[number] for number in numbers},
            verify=verify,
            gaps=intake.gaps,
            on_resize=intake.on_resize,
            step=intake.step,
            layouts=intake.layouts,
        )

    @property
    def effects(self) -> frozenset[Effect] | None:
        """The effects declared on opening; the files themselves declare none."""
        return self._declared

    @property
    def reading(self) -> dict[str, Any]:
        """The profile, without what describes it; undeclared matrices and jitter; and the declared effects."""
        profile = msgspec.structs.replace(self.intake.profile, description="", recognise={}, telling=())
        without = {"undeclared": sorted(self.undeclared)}
        declared = {} if self._declared is None else {"effects": sorted(self._declared)}
        return super().reading | {"profile": msgspec.to_builtins(profile)} | without | declared

    @property
    def files(self) -> tuple[Path, ...]:
        """Every file that frames are read from."""
        return tuple(path for number in self.numbers for path in sorted(self.files_of(number)))

    @property
    def attributes(self) -> Mapping[str, object]:
        """Attributes of the first frame's header, unconverted."""
        return self.intake.attributes[self.first]

    @property
    def undeclared(self) -> frozenset[str]:
        """Names of matrices and jitter that no file declares."""
        names: frozenset[str] = frozenset() if self.intake.has_camera else MATRICES
        return names if self.intake.has_jitter else names | {"cltaa:jitterPx"}

    @property
    def notes(self) -> list[str]:
        """How its files are read, line by line."""
        declared = [] if self._declared is None else [f"effects {format_effects(self._declared) or 'none'}, as asked"]
        return [*intake_lines(self.intake), *declared]

    @property
    def holds(self) -> frozenset[str]:
        """Which of motion, alpha and reactive all its frames have, as the profile finds their channels."""
        return frozenset(CHANNEL_OF.keys() & self._roles.keys())

    @property
    def channels(self) -> frozenset[str]:
        """The channels after conversion."""
        shown = {CHANNEL_OF[part] for part in self.holds}
        depth = {"Z"} if "depth" in self._roles else set[str]()
        return frozenset(depth.union(COLOUR, *(group for group in GROUPS if group[0] in shown)))

    def of_numbers(self, numbers: Many[int], guides: Mapping[str, tuple[Place, ...]] | None = None) -> Self:
        """Return the frames of these numbers, perhaps with other ``guides``."""
        told: dict[str, Any] = {"strict": self._strict, "verify": self.verify, "effects": self._declared}
        made = type(self)(self.folder, self.intake, numbers, guides=self._guides if guides is None else guides, **told)
        made.truth, made.found = self.truth, self.found
        return made

    def with_guides(self) -> tuple[Self, Mapping[str, str]]:
        """Return the sequence with denoiser guides among its read and hashed channels, and why others are left out."""
        channels = {label: layout.channels for label, layout in self.intake.first.items()}
        guides, faults = guide_places(channels, self.intake.roles["colour"]), dict[str, str]()
        for role, its in [*guides.items()]:
            fault = next(filter(None, (self._guide_fault(number, its) for number in self.numbers)), None)
            if fault is not None:
                del guides[role]
                faults[role] = f"{fault.path}: {fault.what}"
        return self.of_numbers(self.numbers, guides), faults

    def _guide_fault(self, number: int, places: tuple[Place, ...]) -> CltaaError | None:
        """Return why channels cannot guide a denoiser of one frame, or None if they can."""
        files = self.intake.sets[places[0].files]
        if number not in files:
            its, path = next(iter(files.items()))
            return frame_missing(renumbered(path, number, its), number)
        try:
            kinds = self._beside(files[number], number).channels
        except CltaaError as error:
            return error
        faults = (
            (whole_numbers if place.channel in kinds else _no_channel)(place, "", 3, files[number])
            for place in places
            if kinds.get(place.channel, "uint") == "uint"
        )
        return next(faults, None)

    @property
    def guides(self) -> Mapping[str, tuple[str, ...]]:
        """Display names of the channels that guide a denoiser; empty before ``with_guides``."""
        sets = self.intake.sets
        return {role: tuple(shown_name(place, sets) for place in its) for role, its in self._guides.items()}

    def guide_images(self, number: int) -> dict[str, Image]:
        """Read the denoiser guides of one frame number, [H, W, 3] float32 each; empty before ``with_guides``."""
        return self._planes(number, self._guides)[0]

    def _open_alike(self, folder: Path, frames: FrameRange | None) -> ImageSequence:
        profile, assignments = self.intake.asked
        return open_pictures(
            folder, verify=self.verify, gaps=OnBreak.RESET, frames=frames, profile=profile, assignments=assignments
        )

    def colour(self, number: int, *, alpha: bool = False) -> Image:
        """Read and convert the colour of one frame, [H, W, 3] linear float32, then alpha if asked for and present."""
        roles = ["colour", "alpha"] if alpha and "alpha" in self._roles else ["colour"]
        planes, _ = self._planes(number, roles)
        planes["colour"] = linear_colour(planes["colour"], self.intake.profile.colour.encoding)
        return np.concatenate([planes[role] for role in roles], -1) if len(roles) > 1 else planes["colour"]

    def frame_and_file(self, number: int, kept: Collection[str] = ()) -> tuple[Frame, FrameFile]:
        """Read and convert one frame; also return the file of its colour, with its ``kept`` channels."""
        planes, there = self._planes(number, self._roles, kept)
        colour = linear_colour(planes["colour"], self.intake.profile.colour.encoding)
        masks: dict[str, Any] = {"alpha": _only(planes.get("alpha")), "reactive": _only(planes.get("reactive"))}
        outline = self.outline(number)
        frame = replace(outline, colour=colour, **masks, **self._surfaces(outline, planes))
        header = ImageHeader(self.layouts[number], self.intake.attributes[number])
        return frame, FrameFile(header, there)

    def surfaces(self, number: int) -> Frame:
        """Read depth and motion of one frame, and leave the rest empty."""
        outline = self.outline(number)
        return replace(outline, **self._surfaces(outline, self._planes(number, ["depth", "motion"])[0]))

    def _surfaces(self, outline: Frame, planes: Mapping[str, Image]) -> dict[str, Any]:
        """Convert the depth and the motion among ``planes``."""
        profile, number = self.intake.profile, outline.index
        depth: Any = None
        if "depth" in planes:
            depth = planar_depth(planes["depth"][..., 0], profile.depth, outline.camera, outline.jitter_px)
            if (lost := np.isnan(planes["depth"][..., 0])).any():  # the sky, but to be reported
                depth[lost & self._depth_shown(number)] = np.nan
        motion = planes.get("motion")
        if motion is not None:
            now, before = outline.jitter_px, self._jitter(number - self.step, number)
            # Some renderers, such as Cycles, draw no vectors of the sky: zeros, though it moves with the camera.
            undrawn = depth == np.inf if depth is not None and self._sky_moves(number) else False
            motion = motion_px(motion, profile.motion, now, before, self.layouts[number].display_size, undrawn)
        return {"depth": depth, "motion": motion}

    def _sky_moves(self, number: int) -> bool:
        """Return True if the camera turns or zooms from the frame before to this one."""
        declared = self.intake.declared
        now, before = declared[number].camera, declared.get(number - self.step, declared[number]).camera
        if now is None or before is None:
            return False
        same = np.array_equal(now.view_to_clip, before.view_to_clip)
        return not (same and np.array_equal(now.world_to_view[:3, :3], before.world_to_view[:3, :3]))

    def outline(self, number: int) -> Frame:
        """Return a frame from its header only; the channels that it has are present but empty."""
        declared = self.intake.declared[number]
        camera = declared.camera or NO_CAMERA
        jitter, exposure = self._jitter(number, number), 1.0 if declared.exposure is None else declared.exposure
        if self._strict:
            matrices, source = declared.matrices_from, declared.jitter_from
            check_camera(camera, path=matrices.path, frame=number, names=matrices.names)
            check_numbers(jitter, exposure, path=source.path, frame=number, jitter_name=source.names[0])
            if "depth" in self._roles:
                check_depth(self.intake.profile.depth, camera, self.path(number), number)
        empty: dict[str, Any] = dict.fromkeys(self.holds, NO_PIXELS)
        return Frame(
            index=number,
            colour=NO_PIXELS,
            depth=NO_PIXELS if "depth" in self._roles else None,
            camera=camera,
            jitter_px=jitter,
            cut=declared.cut,
            exposure=exposure,
            path=self.path(number),
            step=self.step,
            effects=self._declared,
            found=self.found,
            **empty,
        )

    def _jitter(self, number: int, otherwise: int) -> tuple[float, float]:
        """Return the jitter of frame ``number``, or of ``otherwise`` if that frame is missing; undeclared is (0, 0)."""
        declared = self.intake.declared
        return declared.get(number, declared[otherwise]).jitter_px or (0.0, 0.0)

    def unreadable(self) -> Iterator[tuple[int, DataError]]:
        """Yield number and error of each frame whose headers lack a channel that the first frame has, or show another
        picture than the colour; raises InputMissing or DataError for a file that cannot be read."""
        for number in self.numbers:
            layouts = {self.path(number): self.layouts[number]}
            for role, its in self._roles.items():
                for place in its:
                    path = self.intake.sets[place.files][number]
                    layout = layouts[path] = layouts.get(path) or read_any_header(path).layout
                    kind = layout.channels.get(place.channel)
                    if kind in (None, "uint"):
                        yield number, (_no_channel if kind is None else whole_numbers)(place, role, len(its), path)
            others = (self._other_picture(path, number, layout) for path, layout in layouts.items())
            yield from ((number, fault) for fault in others if fault is not None)

    def beside_sha256(self, number: int) -> str | None:
        """Return the SHA-256 of a frame's other files and its declared values, with the previous frame's jitter."""
        beside = sorted(self.files_of(number) - {self.path(number)})
        told = self._told(number)
        if not beside and not told:
            return None
        return hashlib.sha256(msgspec.json.encode([*map(file_sha256, beside), told])).hexdigest()

    def files_of(self, number: int) -> set[Path]:
        """Return the files that a frame is read from."""
        sets = {place.files for places in (self._roles | self._guides).values() for place in places}
        return {self.intake.sets[files][number] for files in sets}

    def _told(self, number: int) -> list[float]:
        """Return the declared values of a frame: matrices, its jitter and the previous one, exposure and cut."""
        declared = self.intake.declared[number]
        camera, told = declared.camera, list[float]()
        if camera is not None:
            told += [*camera.world_to_view.ravel().tolist(), *camera.view_to_clip.ravel().tolist()]
        if self.intake.has_jitter:
            told += [*self._jitter(number, number), *self._jitter(number - self.step, number)]
        if declared.exposure is not None or declared.cut:
            told += [declared.exposure or 1.0, declared.cut]
        return told

    def _planes(
        self, number: int, roles: Iterable[str], kept: Collection[str] = ()
    ) -> tuple[dict[str, Image], dict[str, Pixels]]:
        """Read the channels of each role, float32 [H, W, C]; also return the planes of the colour's file."""
        every = {**self.intake.roles, **self._guides}
        places = {role: every[role] for role in roles}
        main = self.intake.roles["colour"][0].files
        wanted: dict[str, set[str]] = {main: set(kept)} if kept else {}
        for place in (place for its in places.values() for place in its):
            wanted.setdefault(place.files, set()).add(place.channel)
        files = {label: self._read(label, number, names) for label, names in wanted.items()}
        stacked: dict[str, Image] = {}
        for role, its in places.items():
            for place in its:
                path, plane = self.intake.sets[place.files][number], files[place.files].get(place.channel)
                if plane is not None and plane.dtype == np.uint32:
                    raise whole_numbers(place, role, len(its), path)
                if plane is None:
                    raise _no_channel(place, role, len(its), path)
            stacked[role] = np.moveaxis(haloed([files[place.files][place.channel] for place in its]), 0, -1)
        return stacked, files.get(main, {})

    def _depth_shown(self, number: int) -> NDArray[np.bool_]:
        """Return a mask [H, W] of the picture, True inside the data window of its depth."""
        place = self._roles["depth"][0]
        layout = read_any_header(self.intake.sets[place.files][number], chunks=False).layout
        left, top, right, bottom = window = layout.windows.get(place.channel, layout.data_window)
        there = np.ones((bottom - top + 1, right - left + 1), np.bool_)
        return placed(there, window, self.layouts[number].data_window)

    def _beside(self, path: Path, number: int) -> Layout:
        """Return the layout of one of a frame's files; raises DataError if its picture differs from the colour's."""
        other = read_any_header(path).layout
        if fault := self._other_picture(path, number, other):
            raise fault
        return other

    def _other_picture(self, path: Path, number: int, other: Layout) -> DataError | None:
        expected, found = self.layouts[number].display_window, other.display_window
        if found == expected:
            return None
        what, cure = "shows another picture than the colour", "write all channels with one display window"
        return DataError(what, path=path, frame=number, expected=expected, found=found, cure=cure)

    def _read(self, label: str, number: int, names: Collection[str]) -> dict[str, Pixels]:
        """Read channels of one file of the set ``label`` into the picture that the colour's file defines."""
        path, picture = self.intake.sets[label][number], self.layouts[number]
        if path != self.path(number):
            self._beside(path, number)
        # Outside the data window of depth and vectors lies the sky, which moves with the camera.
        places = (place for role in ("depth", "motion") for place in self._roles.get(role, ()))
        outside = {place.channel: np.nan for place in places if place.files == label}
        return read_planes(path, names, sha256=self.recorded(path), picture=picture, outside=outside)


def _no_channel(place: Place, role: str, count: int, path: Path) -> DataError:
    """Return the error for a file without one of the ``count`` channels of a role, or for a damaged part."""
    header = read_any_header(path)
    return next(iter(header.faults.values()), channel_missing(place, role, count, path, header.layout.channels))


def _only(plane: Image | None) -> Image | None:
    return None if plane is None else plane[..., 0]


class ForeignImages(ImageSequence):
    """The colour of another tool's frames as an ``ImageSequence``."""

    def __init__(self, sequence: ForeignSequence) -> None:
        """Take the frames of ``sequence``."""
        self.sequence = sequence
        super().__init__(**sequence.alike())

    @property
    def notes(self) -> list[str]:
        """The profile with its reason, and the colour channels."""
        intake = self.sequence.intake
        channels = describe({"colour": intake.roles["colour"]}, intake.sets)
        return [f"profile {intake.profile.name}: {intake.reason}", channels]

    def image(self, number: int, *, alpha: bool = False) -> Image:
        """Read one frame number, [H, W, 3] linear float32, then alpha if asked for and present."""
        return self.sequence.colour(number, alpha=alpha)

    def of_numbers(self, numbers: Many[int]) -> Self:
        """Return the frames of these numbers."""
        return type(self)(self.sequence.of_numbers(numbers))


def open_pictures(
    named: Named,
    *,
    verify: bool = True,
    gaps: OnBreak = OnBreak.ERROR,
    frames: FrameRange | None = None,
    profile: str | Path | Profile = "auto",
    assignments: Many[str] = (),
) -> ImageSequence:
    """Open cltaa's images as ``open_images`` does, another tool's files by a profile, or PNGs.

    A missing frame of another tool is no error until it is read. Plain channels R, G, B and A are read unless the
    profile or an assignment names others that the files have, and cltaa did not write them. Depth, motion and reactive
    mask are not looked for. Raises what ``open_images`` and ``open_intake`` raise.
    """
    place = selection_of(named)
    if is_png(place):
        files = numbered_files(place, SUFFIX)
        return PngImages(*files, verify=False, gaps=gaps, frames=frames, step=even_step(sorted(files[2])))
    asked = override(Profile() if profile == "auto" else load_profile(profile), assignments)
    if _is_plain(place, asked, profile, assignments):
        images = open_images(place, verify=verify, gaps=gaps, frames=frames)
        if asked.colour.encoding is Encoding.LINEAR:
            return images
        own = _by_cltaa(read_any_header(images.path(images.first)))
        return images if own else ChangedImages(images, _linear, ["colour.encoding srgb, as asked"])
    told = (*assignments, *COLOUR_ALONE)
    intake = open_intake(place, profile=profile, assignments=told, gaps=OnBreak.RESET, frames=frames)
    return ForeignImages(ForeignSequence(place.folder, intake, sorted(intake.declared), strict=False, verify=verify))


def _linear(image: Image) -> Image:
    """Decode an image [H, W, 3 or 4] from sRGB to linear light; keeps alpha as it is."""
    return np.concatenate([linear_colour(image[..., :3], Encoding.SRGB), image[..., 3:]], -1)


def first_pictures(
    named: Named, count: int, profile: str | Path | Profile = "auto", assignments: Many[str] = ()
) -> FrameRange:
    """Return the first and the last number of ``count`` pictures, as ``open_pictures`` reads them; looks at no others,
    which may be damaged. Raises what ``open_pictures`` raises."""
    place = selection_of(named)
    asked = override(Profile() if profile == "auto" else load_profile(profile), assignments)
    if is_png(place) or _is_plain(place, asked, profile, assignments):
        return first_of(sorted(numbered_files(place, SUFFIX if is_png(place) else ".exr")[2]), count, place)
    return first_frames(place, count, profile, (*assignments, *COLOUR_ALONE))


def check_named(places: Many[Named], opened: Many[ImageSequence], assignments: Many[str] = (), **reading: Any) -> None:
    """Raise what ``open_intake`` raises where assignments name colour or alpha that none of the ``opened`` has."""
    if _naming(assignments) and not any(isinstance(images, ForeignImages) for images in opened):
        for place, images in zip(places, opened, strict=True):
            first = images.path(images.first)
            if not is_png(first) and not _by_cltaa(read_any_header(first)):
                open_intake(place, assignments=(*assignments, *COLOUR_ALONE), gaps=OnBreak.RESET, **reading)


def _naming(assignments: Many[str]) -> set[str]:
    """Return the keys of ``assignments`` that name channels of a picture."""
    return keys_of(assignments) & {"colour.channels", "colour.alpha"}


def _by_cltaa(header: ImageHeader) -> bool:
    return any(name.startswith("cltaa:") for name in header.attributes)


def _is_plain(place: Selection, asked: Profile, profile: str | Path | Profile, assignments: Many[str]) -> bool:
    """Return True if R, G, B and A are read as they are: of one name, with no others asked for, or written by cltaa."""
    if asked.colour.view:
        return False
    files = files_in(place) if place.files is not None or place.folder.is_dir() else []
    if not files or not files[0].exists():  # opening it reports that
        return True
    if len(place.by_name(files)) > 1:
        return False
    header, naming = read_any_header(files[0]), _naming(assignments)
    there = header.layout.channels
    if not there.keys() >= {*COLOUR}:
        return False
    if _by_cltaa(header) or (profile == "auto" and not naming):
        return True
    roles = assign(asked, {name_of(files[0]): tuple(there)})
    wanted = "colour" in roles and ("alpha" in roles or "colour.alpha" not in naming or "none" in asked.colour.alpha)
    found = [place.channel for role in ("colour", "alpha") for place in roles.get(role, ())]
    return not wanted or found == [*COLOUR, *(["A"] if "A" in there else [])]


def stated(path: Path) -> dict[str, object]:
    """Return the attributes of an EXR's header, none for a PNG. Raises InputMissing or DataError."""
    return {} if is_png(path) else read_any_header(path).attributes
