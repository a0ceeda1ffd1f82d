"""The output folder of a resolve: owned by one run at a time, and never a mixture of two kinds of result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from cltaa.errors import CltaaError, DataError, UsageError
from cltaa.exr.read import read_header
from cltaa.files.atomic import remove_stale_temporaries
from cltaa.files.manifest import NAME, RESTART_CURE, Entry, Manifest, file_sha256
from cltaa.progress import track
from cltaa.resolve.views import View
from cltaa.sequences.sources import RESOLVED, Sequence

DEBUG = "debug"  # folder of the pictures of debug views
CODE = "code_sha256"  # the key of the settings that says which code


def sequence_settings(sequence: Sequence) -> dict[str, Any]:
    """What of a sequence decides the bits of all its frames; their files are held against their hashes one by one."""
    size = [sequence.width, sequence.height]
    return {"sequence": sequence.name, "first_frame": sequence.first, "size": size, **sequence.reading}


class Source(NamedTuple):
    """What a frame was made from: the SHA-256 of its file, the frame that it continues (None: the first), and the
    SHA-256 of what else it was made from (None: nothing).
    """

    sha256: str
    after: int | None
    beside_sha256: str | None = None


class OutputFolder:
    """Which frames are finished, by what settings they were made, and their hashes. Use it inside ``atomic.owned``."""

    def __init__(self, folder: Path, settings: Mapping[str, Any], *, preset: str = "", restart: bool = False) -> None:
        """Begin the folder, or go on with it; ``restart`` deletes what its manifest lists first.

        ``preset`` is what the preset is called, which decides nothing and is named where another is refused.

        A folder that was begun and in which nothing was finished is begun anew: a run that was refused at its first
        frame does not stand in the way of one with mended options.
        Raises UsageError where the folder was begun with other settings or holds EXR files that no manifest lists,
        DataError for a damaged manifest, OutputError and StorageError.
        """
        self.folder = folder
        asked = json.loads(json.dumps(settings))
        remove_stale_temporaries(folder, owned=True)
        if restart:
            _clear(folder)
        self.manifest = Manifest(folder)
        begun, images = self.manifest.settings, any(folder.glob("*.exr"))
        if begun is None and images and not restart:
            cure = "choose an empty folder, or use --restart to replace files of the same names"
            raise UsageError("holds EXR files of another origin", path=folder, expected=NAME, cure=cure)
        if begun is None or (begun != asked and not images and not self.manifest.entries):
            self.manifest.begin(asked)
        else:
            self._refuse_difference(begun, asked, preset)
        self.key = hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()

    def _refuse_difference(self, begun: Mapping[str, Any], asked: Mapping[str, Any], preset: str) -> None:
        before, now, path = dict(_flat(begun)), dict(_flat(asked)), self.manifest.path
        # What was asked for before the code, and the build last, which follows from both.
        for key in sorted(before.keys() | now.keys(), key=lambda key: (key.startswith("build."), key == CODE, key)):
            if before.get(key) == now.get(key):
                continue
            if key == CODE:  # 64 digits tell nobody anything
                raise UsageError("was begun with another version of cltaa's code", path=path, cure=RESTART_CURE)
            earlier = self._preset_begun_with() if key.startswith("preset.") else preset
            what = f"preset {earlier}, not {preset}:" if earlier not in ("", preset) else "another"
            raise UsageError(
                f"was begun with {what} {key}", path=path,
                expected=before.get(key, "none"), found=now.get(key, "none"), cure=RESTART_CURE,
            )  # fmt: skip

    def _preset_begun_with(self) -> str:
        """What the first finished image says of its preset, empty where none can tell: the manifest has no names."""
        try:
            return str(read_header(self.folder / min(self.manifest.entries)).attributes.get(RESOLVED, ""))
        except (CltaaError, ValueError):  # nothing is finished, or it is not there or damaged now
            return ""

    def missing(self, sequence: Sequence) -> list[int]:
        """Return the frames that are not finished, after a look at every file of those that are.

        Raises DataError where the input of a finished frame is another than it was made from.
        """
        if not self.manifest.entries:
            return list(sequence.numbers)
        numbers = sequence.numbers
        pairs = zip((None, *numbers), numbers, strict=False)
        looked_at = track(pairs, len(numbers), "checking")
        return [number for before, number in looked_at if not self._finished(sequence, number, before)]

    def _finished(self, sequence: Sequence, number: int, before: int | None) -> bool:
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
                raise DataError(
                    what, path=source, frame=number, expected=expected, found=found, cure=RESTART_CURE
                )  # fmt: skip
        return self.manifest.vouches_for(self.folder / source.name)

    def finish(self, path: Path, source: Source) -> None:
        """Vouch for a frame that has its final name; raises StorageError."""
        self.manifest.append(path.name, Entry(file_sha256(path), *source))


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
    for key, value in settings.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value
