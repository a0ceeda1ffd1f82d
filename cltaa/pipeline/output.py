"""The output folder of a resolve: what each file carries over from its input, and what is written."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from cltaa.core.constants import value
from cltaa.core.debug import View
from cltaa.core.resolver import Resolver
from cltaa.errors import CltaaError, DataError, UsageError, several
from cltaa.frame import Frame, Image
from cltaa.inputs.profile import load_profile, option_text, profile_names
from cltaa.io.atomic import remove_stale_temporaries
from cltaa.io.exr_frame import MATRICES, Pixels, frame_attributes
from cltaa.io.exr_layout import LOSSLESS, Layout, Windows
from cltaa.io.exr_read import FrameFile, read_header, read_planes
from cltaa.io.manifest import NAME, RESTART_CURE, Entry, Manifest, begun_otherwise, file_sha256
from cltaa.io.names import has_suffix
from cltaa.io.pixel_statistics import Meaningless, Missing, is_opaque, meaningless, missing_samples
from cltaa.io.sequence import RESOLVED, FrameSequence
from cltaa.io.streams import Writer
from cltaa.pipeline.debug import DebugViews
from cltaa.pipeline.denoise import Denoise
from cltaa.pipeline.lineage import Lineage, input_of
from cltaa.printable import written
from cltaa.progress import track

INFINITE, BELOW_ZERO = 0x7C00, 0x8000  # bits of an infinite half, and of the sign


def image_channels(image: NDArray[Any]) -> dict[str, Pixels]:
    """Return a resolved image [H, W, 3 or 4] as EXR channels R G B [A]."""
    return {name: image[..., channel] for channel, name in enumerate("RGBA"[: image.shape[-1]])}


def limit_halves(image: NDArray[np.float16]) -> int:
    """Replace each infinite half of [H, W, 3 or 4] by the largest, in place; returns the pixels that have such."""
    signed, bits = image.view(np.int16), image.view(np.uint16)
    if signed.max() < INFINITE and bits.max() < INFINITE | BELOW_ZERO:  # compared as integers, for either sign
        return 0
    infinite = np.isinf(image)
    bits -= infinite  # the half below it
    return int(infinite.any(axis=-1).sum())


def saturated_pixels(image: Image) -> int:
    """Count the pixels of floats [H, W, 3 or 4] that halves saturate: with a channel at 65504 or more."""
    largest = value("HALF_LIMIT")
    if -largest < float(image.min()) and float(image.max()) < largest:
        return 0
    return int((np.abs(image) >= largest).any(axis=-1).sum())


# Attributes that describe the structure of the input's file, and not its image.
_OF_THE_FILE = frozenset({"name", "type", "chunkCount", "version", "multiView", "view", "cltaa:samples"})

ALL = ("*",)  # layers


class CarriedOver(NamedTuple):
    """Channels by name, attributes and the windows of an input."""

    channels: dict[str, Pixels]
    attributes: dict[str, object]
    windows: Windows


def carried_channels(layout: Layout, layers: tuple[str, ...], replaced: frozenset[str]) -> frozenset[str]:
    """Return the channels of a file that are carried over: those whose names match one of ``layers``.

    Without the ``replaced`` where all match: a user of the result would mistake the input's colour for it.
    """
    left_out = replaced if layers == ALL else frozenset[str]()
    return frozenset(name for name in layout.channels if any(_is(name, layer) for layer in layers)) - left_out


def _is(name: str, layer: str) -> bool:
    """True for the channel itself and one that the pattern matches: names may hold brackets and stars, too."""
    return name == layer or fnmatchcase(name, layer)


def chosen_layers(names: str | tuple[str, ...] | None, sequence: FrameSequence) -> tuple[str, ...]:
    """Return the layers that ``--layers`` names: names, ``all`` or ``none``; by default all of another tool's files."""
    if names is None:
        names = ("all",) if sequence.notes else ("none",)
    names = tuple(several(names, "layers"))
    return () if names == ("none",) else ALL if names == ("all",) else names


def carried_kinds(sequence: FrameSequence, layers: tuple[str, ...]) -> dict[str, str]:
    """Return the channels that any file of ``sequence`` has carried over -> "uint", "half" or "float"."""
    kept: dict[str, str] = {}
    for layout in sequence.layouts.values():
        names = carried_channels(layout, layers, sequence.replaced)
        kept |= {name: layout.channels[name] for name in names}
    return kept


def carried_over(path: Path, kept: frozenset[str], file: FrameFile) -> CarriedOver:
    """Return what is carried over from ``path``, read as ``file``: every attribute, and the ``kept`` channels; raises
    the errors of reading channels that were not decoded with the frame."""
    layout, planes = file.header.layout, file.planes
    if planes is None:
        planes = read_planes(path, kept, picture=layout) if kept else {}
    channels = {name: plane for name, plane in planes.items() if name in kept}
    attributes = {name: value for name, value in file.header.attributes.items() if name not in _OF_THE_FILE}
    return CarriedOver(channels, attributes, (layout.data_window, layout.display_window))


def merged(carried: CarriedOver, attributes: Mapping[str, object], undeclared: frozenset[str]) -> dict[str, object]:
    """Return the attributes of a result over the carried ones, without those that the input did not declare.

    Matrices of a file refer to its display window, those of a frame to its data window: where these differ, the file's
    stay.
    """
    if carried.windows[0] != carried.windows[1]:
        undeclared = undeclared | MATRICES
    return carried.attributes | {name: value for name, value in attributes.items() if name not in undeclared}


def check_layers(sequence: FrameSequence, layers: tuple[str, ...]) -> None:
    """Raise UsageError for a name among ``layers`` that no channel of the first frame matches."""
    channels = sequence.layouts[sequence.first].channels
    for layer in layers:
        if not any(_is(name, layer) for name in channels):
            raise UsageError("--layers: no such channel", expected=written(sorted(channels)), found=layer)


def carried_compression(sequence: FrameSequence) -> str:
    """Return the compression of the input if it is lossless, else ZIP."""
    compression = sequence.layouts[sequence.first].compression
    return compression if compression in LOSSLESS else "zip"


DEBUG = "debug"  # folder of the pictures of debug views
CODE = "code_sha256"  # the key of the settings with the hash of the code


def sequence_settings(sequence: FrameSequence) -> dict[str, Any]:
    """Return the settings of a sequence that decide the bits of all its frames; files are compared by hash."""
    size = [sequence.width, sequence.height]
    return {"sequence": sequence.name, "first_frame": sequence.first, "size": size, **sequence.reading}


class Source(NamedTuple):
    """The inputs of a frame: its file's SHA-256, the frame that it continues (None: the first), all others' SHA-256.

    Of a result also the hash of all that it is made from (``Lineage``), and how many frames ahead that includes.
    """

    sha256: str
    after: int | None
    beside_sha256: str | None = None
    made_from: str | None = None
    ahead: int = 0


class Written(msgspec.Struct, frozen=True, kw_only=True):
    """A result that has been written: the record of its file, and what to report of its frame."""

    number: int
    name: str  # of its file
    sha256: str
    size: int  # bytes
    source: Source
    missing: Missing | None = None  # samples
    meaningless: list[Meaningless] = []  # depths and vectors
    opaque: bool = False  # its alpha is 1 everywhere
    saturated: int = 0  # number of pixels with a channel at the largest half

    @classmethod
    def now(cls, path: Path, number: int, source: Source, **facts: Any) -> Written:
        """Return that of a file that has just been written; raises StorageError."""
        digest, size = file_sha256(path), path.stat().st_size
        return cls(number=number, name=path.name, sha256=digest, size=size, source=source, **facts)


class Results(Protocol):
    """Where results are written, and what records each."""

    folder: Path

    def finish(self, written: Written) -> None:
        """Record a result that has its name in the folder; raises StorageError."""


OF_A_PART = re.compile(r"(build|preset(\.(choices|settings))?)\.")  # before a key that is called so on the command line
# Settings whose value a user gives by an option; without it they are unset, or the option's default.
NAMED_SO = ("compression", "debug", "denoise", "device", "effects", "half", "layers", "step")
OPTIONS = {
    **{name: f"--{name}" for name in NAMED_SO},
    **{f"build.{name}": f"--{name}" for name in ("storage", "strict")},
    "first_frame": "--frames from",
    "last_frame": "--frames to",
    "profile.name": "--profile",
}
READ_BY = "--profile, --input or --camera"
NAMES = {"undeclared": "set of matrices and jitter that only --camera could give"}


class OutputFolder:
    """The finished frames of a folder, the settings that made them, and their hashes; inside ``atomic.owned``."""

    def __init__(self, folder: Path, settings: Mapping[str, Any], *, restart: bool, preset: str = "") -> None:
        """Begin the folder, or resume it; ``restart`` deletes what its manifest lists first.

        ``preset`` is the name of the preset, which decides nothing and appears where another is refused. A folder in
        which nothing was finished is begun anew: a run that was refused at its first frame does not block one with
        mended options. Raises UsageError where the folder was begun with other settings or holds EXR files that no
        manifest lists, DataError for a damaged manifest, OutputError and StorageError.
        """
        self.folder = folder
        asked = json.loads(json.dumps(settings))
        remove_stale_temporaries(folder)
        if restart:
            _clear(folder)
        self.manifest = Manifest(folder)
        begun, images = self.manifest.settings, any(has_suffix(path, ".exr") for path in folder.glob("*"))
        if begun is None and images and not restart:
            cure = "choose an empty folder, or use --restart to replace files of the same names"
            raise UsageError("holds EXR files of another origin", path=folder, expected=NAME, cure=cure)
        if begun is None or (begun != asked and not images and not self.manifest.entries):
            self.manifest.begin(asked)
        else:
            self._refuse_difference(begun, asked, preset)
        self.inputs: dict[int, str] = {}  # of each frame up to the last finished one, once ``missing`` was called
        self.key = hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()

    def _refuse_difference(self, begun: Mapping[str, Any], asked: Mapping[str, Any], preset: str) -> None:
        before, now, path = dict(_flat(begun)), dict(_flat(asked)), self.manifest.path
        for key in sorted(before.keys() | now.keys(), key=lambda key: (_rank(key), key)):
            begun_with, asked_for = before.get(key), now.get(key)
            if begun_with == asked_for:
                continue
            if key == CODE:  # 64 digits do not help a user
                raise UsageError("was begun with another version of cltaa's code", path=path, cure=RESTART_CURE)
            if key in OPTIONS or key.startswith("profile."):
                if key == "profile.name" and None in (begun_with, asked_for):  # cltaa's own files, by a profile or not
                    raise begun_otherwise(path, READ_BY, begun_with is not None, asked_for is not None)
                raise begun_otherwise(path, OPTIONS.get(key, "--input"), _typed(key, before), _typed(key, now))
            earlier = self._preset_begun_with() if key.startswith("preset.") else preset
            what = f"preset {earlier}, not {preset}:" if earlier not in ("", preset) else "another"
            what, name = f"was begun with {what}", OF_A_PART.sub("", NAMES.get(key, key))
            expected, found = _said(asked_for), _said(begun_with)
            raise UsageError(f"{what} {name}", path=path, expected=expected, found=found, cure=RESTART_CURE)

    def _preset_begun_with(self) -> str:
        """Return the preset that the first finished image names, empty where none does: the manifest has no names."""
        try:
            return str(read_header(self.folder / min(self.manifest.entries)).attributes.get(RESOLVED, ""))
        except (CltaaError, ValueError):  # nothing is finished, or its file is missing or damaged
            return ""

    def missing(self, sequence: FrameSequence, lineage: Lineage, *, shown: bool = False) -> list[int]:
        """Return the frames without a result of the inputs that are there now; ``lineage`` is one without frames.

        An unfinished frame may have been rendered anew: what was made from its earlier content is missing, too. Checks
        every finished file; raises DataError where the input of one has changed.
        """
        numbers = sequence.numbers
        if not self.manifest.entries:
            return list(numbers)
        entries = [self.manifest.entries.get(sequence.path(number).name) for number in numbers]
        reach = max((at + 1 + entry.ahead for at, entry in enumerate(entries) if entry), default=0)
        pairs = zip((None, *numbers), numbers, strict=False)
        looked_at = track(pairs, len(numbers), "checking", shown=shown)
        done = [self._finished(sequence, number, before) for before, number in looked_at]
        inputs = [_input_now(sequence, *each) for each in zip(numbers[:reach], entries, strict=False)]
        self.inputs = dict(zip(numbers, inputs, strict=False))
        for at, entry in enumerate(entries[:reach]):
            lineage.add(inputs[at], sequence.outline(numbers[at]))
            if entry and entry.made_from != lineage.digest(inputs[at + 1 : at + 1 + entry.ahead]):
                done[at] = False
        return [number for number, finished in zip(numbers, done, strict=True) if not finished]

    def _finished(self, sequence: FrameSequence, number: int, before: int | None) -> bool:
        source = sequence.path(number)
        entry = self.manifest.entries.get(source.name)
        if entry is None:
            return False
        beside = entry.beside_sha256, sequence.beside_sha256(number)
        for what, expected, found in (
            ("the input is not the one that this frame was made from", entry.input_sha256, file_sha256(source)),
            ("its other files, matrices, jitter or exposure are not those that it was made from", *beside),
            ("another frame lies before this one than did", entry.after, before),
        ):
            if expected != found:
                raise DataError(what, path=source, frame=number, expected=expected, found=found, cure=RESTART_CURE)
        return self.manifest.has_finished(self.folder / source.name)

    def finish(self, written: Written) -> None:
        """Record a frame whose file has its final name; raises StorageError."""
        self.manifest.append(written.name, Entry(written.sha256, *written.source))


def _input_now(sequence: FrameSequence, number: int, checked: Entry | None) -> str:
    """Return the input of a frame as it is now: that of its entry, which was ``checked``, or else from its files."""
    sha256 = file_sha256(sequence.path(number)) if checked is None else checked.input_sha256
    return input_of(number, sha256, sequence.beside_sha256(number))


def _rank(key: str) -> int:
    """Return the place of a setting among those that differ: other frames, options, and last what follows from them."""
    if key == "sequence":
        return -1
    if key in OPTIONS and key != "last_frame":
        return int(key != "profile.name")  # which decides the layers
    return 4 if key.startswith(("build.", "found", "last_frame")) else 3 if key == CODE else 2


def _typed(key: str, settings: Mapping[str, Any]) -> object:
    """Return the value of an option as a user types it; None where the profile itself says so."""
    setting, name = settings.get(key), settings.get("profile.name")
    if setting == [*ALL]:
        return "all"
    if setting is None or key in OPTIONS:
        return setting
    _, section, last = key.split(".")
    usual = msgspec.to_builtins(load_profile(name))[section][last] if name in profile_names() else None
    text, by_itself = (option_text({section: {last: each}}) for each in (setting, usual))
    return None if text == by_itself else text.removeprefix("--input ")


def _said(setting: object) -> str:
    """A setting for a reader."""
    if isinstance(setting, bool):
        return "yes" if setting else "no"
    if isinstance(setting, list):
        setting = (" x " if isinstance(setting[0], int) else ", ").join(map(str, setting)) if setting else None
    return "none" if setting is None else str(setting)


def _clear(folder: Path) -> None:
    """Delete what a manifest lists, the pictures of debug views, and then the manifest; a damaged one lists nothing."""
    try:
        names = list(Manifest(folder).entries)
    except DataError:
        names = []
    for name in names:
        (folder / name).unlink(missing_ok=True)
    for view in View:
        for path in (folder / DEBUG).glob(f"{view}.*.png"):
            path.unlink()
    (folder / NAME).unlink(missing_ok=True)


def _flat(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, setting in settings.items():
        if isinstance(setting, dict):
            yield from _flat(setting, f"{prefix}{key}.")
        else:
            yield prefix + key, setting


class Read(NamedTuple):
    """A frame, its source, its missing samples, its meaningless depths and vectors, whether its alpha is 1 everywhere,
    and what its output carries over."""

    frame: Frame
    source: Source
    missing: Missing | None
    meaningless: list[Meaningless]
    opaque: bool
    carried: CarriedOver

    @property
    def input(self) -> str:
        """What identifies the input of the frame."""
        return input_of(self.frame.index, self.source.sha256, self.source.beside_sha256)

    def made_from(self, lineage: Lineage, ahead: Iterable[Read]) -> Read:
        """Return the same, with what its result is made from: the ``lineage`` and the frames ``ahead``."""
        inputs = [read.input for read in ahead]
        return self._replace(source=self.source._replace(made_from=lineage.digest(inputs), ahead=len(inputs)))


def reads(
    sequence: FrameSequence, before: int | None, layers: tuple[str, ...], denoise: Denoise | None = None
) -> Iterator[Callable[[], Read]]:
    """Yield a task for each frame of a sequence, for any thread; the first continues frame ``before``."""
    for number in sequence.numbers:
        yield partial(_read, sequence, number, before, layers, denoise)
        before = number


def _read(
    sequence: FrameSequence, number: int, before: int | None, layers: tuple[str, ...], denoise: Denoise | None
) -> Read:
    path, kept = sequence.path(number), carried_channels(sequence.layouts[number], layers, sequence.replaced)
    found = _stamps(sequence, number)
    frame, file = sequence.frame_and_file(number, kept)
    # Files verified while they were read need not be hashed again.
    digest = sequence.sha256(number) or file_sha256(path)
    source = Source(digest, before, sequence.beside_sha256(number))
    carried = carried_over(path, kept, file)
    missing = missing_samples(frame.colour, frame.alpha, number)
    lost = meaningless(frame, first=before is None)
    if denoise is not None:
        frame = denoise(frame, sequence.guide_images(number))
    if _stamps(sequence, number) != found:  # else this result would be recorded with the hash of the changed file
        raise DataError("a file changed while it was read", path=path, frame=number, cure="run again")
    return Read(frame, source, missing, lost, is_opaque(frame.alpha), carried)


def _stamps(sequence: FrameSequence, number: int) -> list[tuple[int, ...]]:
    """Return what distinguishes the files of a frame from others written in their place."""
    found = (path.stat() for path in sorted(sequence.files_of(number)) if path.exists())
    return [(status.st_ino, status.st_size, status.st_mtime_ns) for status in found]


class ResolvedFiles:
    """Writes results into ``folder`` under the names of their inputs, and keeps a record of each."""

    def __init__(self, folder: Results, resolver: Resolver, debug: DebugViews, *, undeclared: frozenset[str]) -> None:
        self.folder = folder
        self._resolver, self._debug, self._undeclared = resolver, debug, undeclared
        self._finished: dict[int, Written] = {}  # by frame; filled by the writing threads
        self.sizes: list[int] = []  # bytes of each finished file

    @property
    def finished(self) -> list[Written]:
        """The record of each written frame, once the writer is closed."""
        return [self._finished[number] for number in sorted(self._finished)]

    def write(self, writer: Writer, read: Read, image: NDArray[Any]) -> None:
        """Queue the result ``image`` [H, W, 3 or 4], floats or halves, of the frame ``read`` and resolved last; raises
        OutputError and StorageError, possibly of an earlier image in the queue."""
        assert read.frame.path is not None
        views = self._debug.write(self.folder.folder / DEBUG, read.frame.index)
        path, saturated = self.folder.folder / read.frame.path.name, list[int]()
        number, source = read.frame.index, read.source
        told: dict[str, Any] = {"missing": read.missing, "meaningless": read.meaningless, "opaque": read.opaque}
        kept, windows = read.carried.channels, read.carried.windows  # not the frame, so that its pixels can be freed

        def channels() -> dict[str, Pixels]:
            saturated.append(self._limited(image))
            return {**kept, **image_channels(image), **views}

        def finish() -> None:
            self.take(Written.now(path, number, source, **told, saturated=sum(saturated)))

        preset, device = self._resolver.preset.name, self._resolver.launcher.description
        own = frame_attributes(read.frame) | {"cltaa:preset": preset, "cltaa:device": device}
        attributes = merged(read.carried, own, self._undeclared)
        writer.write(path, channels, attributes, then=finish, windows=windows)

    def take(self, written: Written) -> None:
        """Record a result that has its final name; raises StorageError."""
        self.folder.finish(written)
        self._finished[written.number] = written
        self.sizes.append(written.size)

    def _limited(self, image: NDArray[Any]) -> int:
        """Limit a result to the range of halves, in the writing thread; returns how many pixels that saturates."""
        if image.dtype == np.float16:
            return limit_halves(image)
        return saturated_pixels(image) if self._resolver.keeps_halves else 0
