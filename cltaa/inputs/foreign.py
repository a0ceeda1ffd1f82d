"""A sequence of another tool as the sequence of frames that a resolve takes."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Mapping
from collections.abc import Sequence as Many
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np

from cltaa.cameras import of_region
from cltaa.exr.attributes import MATRICES
from cltaa.exr.channels import COLOUR, GROUPS, Pixels
from cltaa.exr.read import FrameFile, ImageHeader
from cltaa.files.manifest import file_sha256, recorded_hashes
from cltaa.files.names import name_of
from cltaa.frame_checks import check_camera
from cltaa.frames import Camera, Effect, Frame, Image, format_effects
from cltaa.inputs.convert import check_depth, linear_colour, motion_px, planar_depth, still_camera
from cltaa.inputs.intake import Intake, intake_lines
from cltaa.inputs.parts import read_any_header, read_planes
from cltaa.inputs.roles import channel_missing, whole_numbers
from cltaa.memory.haloed import haloed
from cltaa.sequences.frame_numbers import OnBreak
from cltaa.sequences.images import ImageSequence
from cltaa.sequences.sources import CHANNEL_OF, NO_PIXELS, Sequence

EFFECT_OF = {"motion": Effect.MOTION, "alpha": Effect.ALPHA, "reactive": Effect.REACTIVE}  # what a channel is there for


class ForeignSequence(Sequence):
    """A ``Sequence`` whose frames are converted while they are read; ``strict`` False lets wrong matrices pass."""

    def __init__(
        self,
        folder: Path,
        intake: Intake,
        numbers: Many[int],
        *,
        strict: bool = True,
        verify: bool = True,
        effects: frozenset[Effect] | None = None,
    ) -> None:
        """Take what ``open_intake`` decided; ``effects`` are declared for it, and channels of no other are read."""
        self.intake, self._strict, self._declared = intake, strict, effects
        left_out = set() if effects is None else {role for role, effect in EFFECT_OF.items() if effect not in effects}
        self._roles = {role: places for role, places in intake.roles.items() if role not in left_out}
        resolved = (*self._roles["colour"], *self._roles.get("alpha", ()))
        self.replaced = frozenset(place.channel for place in resolved if place.files == resolved[0].files)
        self._hashes: dict[Path, dict[str, str]] = {}
        main = intake.sets[intake.roles["colour"][0].files]
        self.folder, self.name = folder, name_of(main[numbers[0]])
        self.verify, self.gaps, self.on_resize, self.step = verify, intake.gaps, intake.on_resize, intake.step
        self._paths = {number: main[number] for number in numbers}
        self.layouts = {number: intake.layouts[number] for number in numbers}

    @property
    def effects(self) -> frozenset[Effect] | None:
        """What was declared for it; its files declare nothing, so that every step is on."""
        return self._declared

    @property
    def reading(self) -> dict[str, Any]:
        """The profile, and where nothing tells a camera or a jitter that so it is."""
        without = {"undeclared": sorted(self.undeclared)}
        declared = {} if self._declared is None else {"effects": sorted(self._declared)}
        return super().reading | {"profile": msgspec.to_builtins(self.intake.profile)} | without | declared

    @property
    def files(self) -> tuple[Path, ...]:
        """Every file that frames are read from."""
        return tuple(path for number in self.numbers for path in sorted(self.files_of(number)))

    @property
    def told(self) -> list[float]:
        """Matrices, jitter, exposure and cuts of every frame, as files or a side file declare them."""
        return [value for number in self.numbers for value in self._told(number)]

    @property
    def attributes(self) -> Mapping[str, object]:
        """Attributes of the first frame's header, as its files hold them."""
        return self.intake.attributes[self.first]

    @property
    def undeclared(self) -> frozenset[str]:
        """Matrices and jitter where nothing tells them."""
        names: frozenset[str] = frozenset() if self.intake.has_camera else MATRICES
        return names if self.intake.has_jitter else names | {"cltaa:jitterPx"}

    @property
    def notes(self) -> list[str]:
        """What was decided about its files, line by line."""
        declared = [] if self._declared is None else [f"effects {format_effects(self._declared) or 'none'}, as asked"]
        return [*intake_lines(self.intake), *declared]

    @property
    def converted(self) -> bool:
        """Whether what is decoded is converted before it is a frame: colours, depth and vectors are."""
        return True

    @property
    def holds(self) -> frozenset[str]:
        """Which of motion, alpha and reactive its frames have: all or none, as the profile finds their channels."""
        return frozenset(CHANNEL_OF.keys() & self._roles.keys())

    @property
    def channels(self) -> frozenset[str]:
        """What they are converted to; depth too where no channel holds it."""
        shown = {CHANNEL_OF[part] for part in self.holds}
        return frozenset({*COLOUR, "Z"}.union(*(group for group in GROUPS if group[0] in shown)))

    def select(self, first: int, last: int) -> Self:
        """Return the frames ``first`` to ``last``, both included."""
        self.path(first), self.path(last)
        numbers = [number for number in self.numbers if first <= number <= last]
        selected = type(self)(
            self.folder, self.intake, numbers, strict=self._strict, verify=self.verify, effects=self._declared
        )  # fmt: skip
        selected.truth = self.truth
        return selected

    def _open_alike(self, folder: Path) -> ImageSequence:
        from cltaa.inputs.pictures import open_pictures  # here: those are made of such sequences

        profile, assignments = self.intake.asked
        return open_pictures(folder, verify=self.verify, gaps=OnBreak.RESET, profile=profile, assignments=assignments)

    def colour(self, number: int) -> Image:
        """Read and convert the colour of one frame, [H, W, 3] linear float32."""
        return linear_colour(self._planes(number, ["colour"])[0]["colour"], self.intake.profile.colour.encoding)

    def frame_and_file(self, number: int, kept: Collection[str] = ()) -> tuple[Frame, FrameFile]:
        """Read and convert one frame; the file is that of its colour, and its ``kept`` channels are read with it."""
        planes, there = self._planes(number, self._roles, kept)
        profile, outline = self.intake.profile, self.outline(number)
        colour = linear_colour(planes["colour"], profile.colour.encoding)
        depth = np.full(colour.shape[:2], np.inf, np.float32)
        if "depth" in planes:
            depth = planar_depth(planes["depth"][..., 0], profile.depth, outline.camera, outline.jitter_px)
        motion = None
        if "motion" in planes:
            motion = motion_px(
                planes["motion"],
                profile.motion,
                outline.jitter_px,
                self._jitter(number - self.step, number),
                self.layouts[number].display_size,
            )
        alpha, reactive = _only(planes.get("alpha")), _only(planes.get("reactive"))
        frame = replace(outline, colour=colour, depth=depth, motion=motion, alpha=alpha, reactive=reactive)
        header = ImageHeader(self.layouts[number], self.intake.attributes[number])
        return frame, FrameFile(header, there)

    def outline(self, number: int) -> Frame:
        """A frame of which only the header was read: the channels that it has are there, and empty."""
        layout = self.layouts[number]
        declared = self.intake.declared[number]
        camera = declared.camera or of_region(still_camera(*layout.display_size), layout)
        if self._strict:
            check_camera(camera, path=self.path(number), frame=number)
            if "depth" in self._roles:
                check_depth(self.intake.profile.depth, camera, self.path(number), number)
        empty: dict[str, Any] = dict.fromkeys(self.holds, NO_PIXELS)
        return Frame(
            index=number, colour=NO_PIXELS, depth=NO_PIXELS, camera=camera, jitter_px=self._jitter(number, number),
            cut=declared.cut, exposure=1.0 if declared.exposure is None else declared.exposure,
            path=self.path(number), step=self.step, effects=self._declared, **empty,
        )  # fmt: skip

    def _jitter(self, number: int, otherwise: int) -> tuple[float, float]:
        """What frame ``number`` declares, or where there is no such frame ``otherwise``; nothing counts as none."""
        declared = self.intake.declared
        return declared.get(number, declared[otherwise]).jitter_px or (0.0, 0.0)

    def sha256(self, number: int) -> str | None:
        """Return the SHA-256 that the file of a frame's colour must have, or None."""
        return self._hash_of(self.path(number))

    def beside_sha256(self, number: int) -> str | None:
        """Return the SHA-256 of a frame's other files and of what is declared, the last frame's jitter included."""
        beside = sorted(self.files_of(number) - {self.path(number)})
        told = self._told(number)
        if not beside and not told:
            return None
        return hashlib.sha256(msgspec.json.encode([*map(file_sha256, beside), told])).hexdigest()

    def files_of(self, number: int) -> set[Path]:
        """The files that a frame is read from."""
        sets = {place.files for places in self._roles.values() for place in places}
        return {self.intake.sets[files][number] for files in sets}

    def _told(self, number: int) -> list[float]:
        """What is declared of a frame: matrices, its jitter and that before, exposure and cut."""
        declared = self.intake.declared[number]
        told = _numbers(declared.camera)
        if self.intake.has_jitter:
            told += [*self._jitter(number, number), *self._jitter(number - self.step, number)]
        if declared.exposure is not None or declared.cut:
            told += [declared.exposure or 1.0, declared.cut]
        return told

    def _hash_of(self, path: Path) -> str | None:
        """The SHA-256 that is recorded for a file, if one is and it is to be verified."""
        if not self.verify:
            return None
        if path.parent not in self._hashes:
            self._hashes[path.parent] = recorded_hashes(path.parent)
        return self._hashes[path.parent].get(path.name)

    def _planes(
        self, number: int, roles: Iterable[str], kept: Collection[str] = ()
    ) -> tuple[dict[str, Image], dict[str, Pixels]]:
        """The channels of each of these roles, float32 [H, W, C]; and what was read of the colour's file."""
        places = {role: self.intake.roles[role] for role in roles}
        main = self.intake.roles["colour"][0].files
        wanted: dict[str, set[str]] = {main: set(kept)}
        for place in (place for its in places.values() for place in its):
            wanted.setdefault(place.files, set()).add(place.channel)
        files = {label: self._read(label, number, names) for label, names in wanted.items()}
        stacked: dict[str, Image] = {}
        for role, its in places.items():
            for place in its:
                path, plane = self.intake.sets[place.files][number], files[place.files].get(place.channel)
                if plane is not None and plane.dtype == np.uint32:
                    raise whole_numbers(place, path)
                if plane is None:
                    raise channel_missing(place, role, len(its), path, read_any_header(path).layout.channels)
            stacked[role] = np.moveaxis(haloed([files[place.files][place.channel] for place in its]), 0, -1)
        return stacked, files[main]

    def _read(self, label: str, number: int, names: Collection[str]) -> dict[str, Pixels]:
        """Channels of a file of that set, of which that of the colour says what the picture is."""
        path = self.intake.sets[label][number]
        planes = read_planes(path, names, sha256=self._hash_of(path))
        if path == self.path(number):
            return planes
        part = read_any_header(path).layout.part_of(self.layouts[number].data_window)
        return {name: plane[part] for name, plane in planes.items()}


def _numbers(camera: Camera | None) -> list[float]:
    return [] if camera is None else [*camera.world_to_view.ravel().tolist(), *camera.view_to_clip.ravel().tolist()]


def _only(plane: Image | None) -> Image | None:
    return None if plane is None else plane[..., 0]
