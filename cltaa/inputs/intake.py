"""Opening a sequence that anybody wrote: choose the profile, find the channels, say what is missing, read frames."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from collections.abc import Sequence as Many
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np

from cltaa.errors import DataError
from cltaa.exr_attributes import check_camera
from cltaa.exr_channels import Pixels
from cltaa.exr_layout import Layout
from cltaa.frames import Camera, Effect, Frame, Image
from cltaa.inputs.convert import linear_colour, motion_px, planar_depth, still_camera
from cltaa.inputs.declared import Declared, declared_frames
from cltaa.inputs.parts import read_any_header, read_planes
from cltaa.inputs.profile import Profile, load_profile, profile_names
from cltaa.inputs.profile_text import override
from cltaa.inputs.roles import Roles, assign, describe, file_sets
from cltaa.inputs.side_file import read_side_file
from cltaa.manifest import recorded_hashes
from cltaa.numbered import OnBreak, frame_missing
from cltaa.sources import Sequence, open_sequence

MATRICES = ("worldToCamera", "worldToNDC", "cltaa:worldToView", "cltaa:viewToClip")


@dataclass(slots=True)
class Intake:
    """What was decided about a folder before a pixel was read."""

    profile: Profile
    reason: str
    roles: Roles
    sets: dict[str, dict[int, Path]]
    attributes: dict[int, dict[str, object]]
    layouts: dict[int, Layout]
    declared: dict[int, Declared]
    notes: list[str] = field(default_factory=list)  # what is missing, and what is done without it

    @property
    def has_camera(self) -> bool:
        """True when every frame declares its matrices."""
        return all(known.camera is not None for known in self.declared.values())

    @property
    def has_jitter(self) -> bool:
        """True when every frame declares its jitter."""
        return all(known.jitter_px is not None for known in self.declared.values())


class ForeignSequence(Sequence):
    """A ``Sequence`` whose frames are converted while they are read; ``strict`` False lets wrong matrices pass."""

    def __init__(
        self, folder: Path, intake: Intake, numbers: Many[int], *, strict: bool = True, verify: bool = True
    ) -> None:
        """Take what ``open_intake`` decided."""
        self.intake, self._strict = intake, strict
        self._hashes: dict[Path, dict[str, str]] = {}
        main = intake.sets[intake.roles["colour"][0].files]
        self.folder, self.name = folder, main[numbers[0]].name.split(".")[0]
        self.verify, self.gaps, self.on_resize = verify, OnBreak.ERROR, OnBreak.ERROR
        self._paths = {number: main[number] for number in numbers}
        self.layouts = {number: intake.layouts[number] for number in numbers}

    @property
    def effects(self) -> frozenset[Effect] | None:
        """Nothing is declared, so every step is on."""
        return None

    @property
    def reading(self) -> dict[str, Any]:
        """Profile, channels, matrices and jitter: another of these makes another picture."""
        known = {
            number: [*(declared.jitter_px or ()), *_numbers(declared.camera)]
            for number, declared in self.intake.declared.items()
        }
        digest = hashlib.sha256(msgspec.json.encode(known)).hexdigest()
        return {"profile": msgspec.to_builtins(self.intake.profile), "declared_sha256": digest}

    @property
    def undeclared(self) -> frozenset[str]:
        """Matrices and jitter where nothing tells them."""
        names = set() if self.intake.has_camera else {*MATRICES}
        return frozenset(names if self.intake.has_jitter else names | {"cltaa:jitterPx"})

    def select(self, first: int, last: int) -> Self:
        """Return the frames ``first`` to ``last``, both included."""
        self.path(first), self.path(last)
        numbers = [number for number in self.numbers if first <= number <= last]
        return type(self)(self.folder, self.intake, numbers, strict=self._strict, verify=self.verify)

    def frame(self, number: int) -> Frame:
        """Read and convert one frame."""
        intake, profile = self.intake, self.intake.profile
        planes = self._planes(number)
        known = intake.declared[number]
        before = intake.declared.get(number - 1, known)
        jitter, earlier = known.jitter_px or (0.0, 0.0), before.jitter_px or (0.0, 0.0)
        colour = linear_colour(planes["colour"], profile.colour.encoding)
        height, width = colour.shape[:2]
        camera = known.camera or still_camera(width, height)
        if self._strict:
            check_camera(camera, path=self.path(number), frame=number)
        depth = np.full((height, width), np.inf, np.float32)
        if "depth" in planes:
            depth = planar_depth(planes["depth"][..., 0], profile.depth, camera, jitter)
        motion = None
        if "motion" in planes:
            motion = motion_px(planes["motion"], profile.motion, jitter, earlier)
        attributes = intake.attributes[number]
        return Frame(
            index=number, colour=colour, depth=depth, camera=camera, jitter_px=jitter, motion=motion,
            alpha=_only(planes.get("alpha")), reactive=_only(planes.get("reactive")),
            cut=attributes.get("cltaa:cut") == 1, exposure=_number(attributes.get("cltaa:exposure"), 1.0),
            path=self.path(number),
        )  # fmt: skip

    def sha256(self, number: int) -> str | None:
        """Return the SHA-256 that the file of a frame's colour must have, or None."""
        return self._hash_of(self.path(number))

    def _hash_of(self, path: Path) -> str | None:
        """The SHA-256 that is recorded for a file, if one is and it is to be verified."""
        if not self.verify:
            return None
        if path.parent not in self._hashes:
            self._hashes[path.parent] = recorded_hashes(path.parent)
        return self._hashes[path.parent].get(path.name)

    def _planes(self, number: int) -> dict[str, Image]:
        """The channels of each role as float32 [H, W, C]."""
        files: dict[str, dict[str, Pixels]] = {}
        stacked: dict[str, Image] = {}
        for role, places in self.intake.roles.items():
            planes = []
            for place in places:
                path = self.intake.sets[place.files][number]
                if place.files not in files:
                    files[place.files] = read_planes(path, sha256=self._hash_of(path))[0]
                if place.channel not in files[place.files]:
                    found = " ".join(sorted(files[place.files]))
                    raise DataError("channel is missing", path=path, channel=place.channel, found=found)
                planes.append(files[place.files][place.channel].astype(np.float32))
            stacked[role] = np.moveaxis(np.stack(planes), 0, -1)
        return stacked


def open_input(
    folder: Path, *, profile: str = "auto", assignments: Many[str] = (), side_file: Path | None = None, **options: Any
) -> Sequence:
    """Open ``folder`` as its profile says; a sequence of cltaa's own is opened by ``open_sequence`` with ``options``.

    Raises what ``open_sequence`` and ``open_intake`` raise.
    """
    plain = not assignments and side_file is None
    if plain and profile in ("auto", "cltaa") and _is_own(folder):
        return open_sequence(folder, **options)
    intake = open_intake(folder, profile=profile, assignments=assignments, side_file=side_file)
    return ForeignSequence(folder, intake, sorted(intake.declared), verify=options.get("verify", True))


def open_intake(
    folder: Path, *, profile: str = "auto", assignments: Many[str] = (), side_file: Path | None = None
) -> Intake:
    """Decide how ``folder`` is read, from its headers; raises InputMissing, DataError or UsageError."""
    sets = file_sets(folder)
    first = {label: read_any_header(files[min(files)]) for label, files in sets.items()}
    channels = {label: tuple(header.layout.channels) for label, header in first.items()}
    attributes: dict[str, object] = {}
    for header in first.values():
        attributes = header.attributes | attributes
    chosen, reason = (load_profile(profile), "as asked") if profile != "auto" else _guess(attributes, channels)
    chosen = override(chosen, assignments)
    roles = assign(chosen, channels)
    if "colour" not in roles:
        found = " ".join(name for names in channels.values() for name in names)
        cure = "name them: --input colour.channels='R G B'"
        raise DataError(
            "no colour channels", path=folder, expected=" or ".join(chosen.colour.channels), found=found, cure=cure
        )
    main = sets[roles["colour"][0].files]
    for number in range(min(main), max(main) + 1):
        for label in {place.files for places in roles.values() for place in places}:
            if number not in sets[label]:
                raise frame_missing(next(iter(sets[label].values())).parent / f"{label}.{number:04d}.exr", number)
    headers = {number: read_any_header(path) for number, path in sorted(main.items())}
    layouts = {number: header.layout for number, header in headers.items()}
    size = next(iter(layouts.values()))
    given = {number: header.attributes for number, header in headers.items()}
    side = {} if side_file is None else read_side_file(side_file)
    declared = declared_frames(chosen, given, side, (size.width, size.height))
    intake = Intake(chosen, reason, roles, sets, given, layouts, declared)
    intake.notes += _notes(intake)
    return intake


def _guess(attributes: dict[str, object], channels: dict[str, tuple[str, ...]]) -> tuple[Profile, str]:
    """The profile whose header attribute is there, else the one that finds most roles; and why."""
    profiles = [load_profile(name) for name in profile_names()]
    for profile in profiles:
        for name, word in profile.recognise.items():
            if name in attributes and word in str(attributes[name]):
                shown = str(attributes[name])[:40] if word else "there"
                return profile, f"header attribute {name} is {shown}"
    scores = {profile.name: len(assign(profile, channels)) for profile in profiles}
    best = max(profiles, key=lambda profile: (scores[profile.name], profile.name == "cltaa"))
    return best, f"no header names the writer; its channel names fit best ({scores[best.name]} roles)"


def _notes(intake: Intake) -> list[str]:
    notes = []
    if not intake.has_camera:
        kept = (
            "motion vectors alone tell what moves" if "motion" in intake.roles else "the camera is taken to stand still"
        )
        notes.append(f"no matrices: {kept}; give them with --camera FILE")
    if "depth" not in intake.roles:
        notes.append("no depth: nothing is told apart by distance, and moving edges are less exact")
    if "motion" not in intake.roles:
        rest = (
            "the camera's motion comes from depth and matrices" if intake.has_camera and "depth" in intake.roles else ""
        )
        notes.append(f"no motion vectors: {rest or 'whatever moves is rectified only'}")
    if not intake.has_jitter:
        notes.append("no jitter: taken as none; if the pixels are jittered, cltaa check shows by how much")
    return notes


def intake_lines(intake: Intake) -> Iterator[str]:
    """What was decided, for a reader: profile and reason, channels, what is missing."""
    yield f"profile {intake.profile.name}: {intake.reason}"
    yield f"channels: {describe(intake.roles)}"
    yield from intake.notes


def _is_own(folder: Path) -> bool:
    """True unless the first file plainly is somebody else's: errors of cltaa's own files are told by its own reader."""
    files = sorted(folder.glob("*.exr")) if folder.is_dir() else []
    if not files:
        return not folder.is_dir() or not any(folder.glob("*/*.exr"))
    try:
        return "cltaa:worldToView" in read_any_header(files[0]).attributes
    except DataError:
        return True


def _numbers(camera: Camera | None) -> list[float]:
    return [] if camera is None else [*camera.world_to_view.ravel().tolist(), *camera.view_to_clip.ravel().tolist()]


def _only(plane: Image | None) -> Image | None:
    return None if plane is None else np.ascontiguousarray(plane[..., 0])


def _number(value: object, default: float) -> float:
    if isinstance(value, np.ndarray) and value.shape == (1,):
        value = float(value[0])
    return float(value) if isinstance(value, int | float) else default
