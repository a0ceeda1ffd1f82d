"""The SHA-256 of every finished file: ``manifest.jsonl`` of a resolve, ``sequence.json`` of a capture.

A manifest is one JSON object per line, each with its own checksum: first the settings that decide every pixel of the
folder, then one line for each finished file, appended after the file has its final name. A line that a kill or a full
disk tore is ignored, and its file is made again.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import threading
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from cltaa.errors import DataError, StorageError, UsageError, disk_cure
from cltaa.io.atomic import atomic_path
from cltaa.io.content import read_bytes, read_text

NAME = "manifest.jsonl"
CAPTURE = "sequence.json"
REFERENCE = re.compile(r"reference(-\d+)?")  # folders inside a capture
LARGEST_RECORD = 1 << 28  # bytes; a million frames with their truth take about 200 MB
FORMAT = 1
_SHA256 = re.compile(r"[0-9a-f]{64}")
RESTART_CURE = "name another folder, or use --restart to begin anew"


def begun_otherwise(path: Path, option: str, begun: object, asked: object) -> UsageError:
    """Return the error for a folder whose run was begun with another value of a command's ``option``."""

    def told(value: object) -> str:
        if value is None or value is False or value == []:
            return f"without {option}"
        text = ",".join(map(str, value)) if isinstance(value, list) else value
        return f"with {option}" if value is True else f"with {option} {text}"

    return UsageError(f"was begun {told(begun)}, not {told(asked)}", path=path, cure=RESTART_CURE)


class Entry(NamedTuple):
    """The entry of a finished file in the manifest: its hash, those of its inputs, and the frame that it continues."""

    sha256: str
    input_sha256: str
    after: int | None  # None: the first frame
    beside_sha256: str | None = None  # of other files of the input, and of what a side file declares
    made_from: str | None = None  # hash of all inputs that decide its bits; None: of an earlier version
    ahead: int = 0  # how many frames after it are among those


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal; raises StorageError where it cannot be read."""
    try:
        with path.open("rb", buffering=0) as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise StorageError(f"cannot be read: {error.strerror}", path=path) from error


def recorded_hashes(folder: Path) -> dict[str, str]:
    """Return SHA-256 by file name (relative to ``folder``) of all that its manifest or its capture's record holds;
    raises DataError for an unreadable record."""
    hashes = {name: entry.sha256 for name, entry in Manifest(folder).entries.items()}
    # Files drawn by hand or by other tools may have a sequence.json without hashes.
    files = read_capture_record(folder).get("files", {})
    if not isinstance(files, dict) or not all(_SHA256.fullmatch(str(digest)) for digest in files.values()):
        expected, cure = "a SHA-256 in hexadecimal for each of the files", "capture the sequence again"
        raise DataError("wrong content", path=folder / CAPTURE, expected=expected, cure=cure)
    hashes |= files
    folder = folder.resolve()
    if not hashes and REFERENCE.fullmatch(folder.name):
        capture, inside = recorded_hashes(folder.parent), f"{folder.name}/"
        hashes = {name.removeprefix(inside): digest for name, digest in capture.items() if name.startswith(inside)}
    return hashes


def read_capture_record(folder: Path) -> dict[str, Any]:
    """Return the content of ``sequence.json``, empty where there is none; raises DataError for a damaged one."""
    path = folder / CAPTURE
    if not path.exists():
        return {}
    text = read_text(path, "a record", LARGEST_RECORD)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DataError(f"not readable as JSON: {error}", path=path, cure="capture the sequence again") from error
    if not isinstance(content, dict):
        raise DataError("wrong content", path=path, expected="a JSON object", found=type(content).__name__)
    return content


class Manifest:
    """The manifest of one folder, as far as it is intact; ``settings`` is None where it was not begun."""

    def __init__(self, folder: Path) -> None:
        """Read what is there; raises DataError for a damaged first line, StorageError where it cannot be read."""
        self.path = folder / NAME
        self._appending = threading.Lock()  # frames are finished in several threads
        self.settings: dict[str, Any] | None = None
        self.entries: dict[str, Entry] = {}
        if not self.path.exists():
            return
        lines = read_bytes(self.path, "a manifest", LARGEST_RECORD).splitlines()
        begun = _parsed(lines[0]) if lines else None
        if begun is None or begun.get("format") != FORMAT or not isinstance(begun.get("settings"), dict):
            raise DataError("the first line is damaged", path=self.path, cure=RESTART_CURE)
        self.settings = begun["settings"]
        for line in lines[1:]:
            record = _parsed(line) or {}
            name = str(record.get("file", ""))
            # Only names inside the folder, and only lines of this program.
            fields = {"file", *Entry._fields}  # lines of earlier versions lack those with a default
            if name and Path(name).name == name and fields - Entry._field_defaults.keys() <= record.keys() <= fields:
                del record["file"]
                self.entries[name] = Entry(**record)

    def begin(self, settings: Mapping[str, Any]) -> None:
        """Write the first line; raises OutputError and StorageError."""
        with atomic_path(self.path) as temporary:
            temporary.write_bytes(_line({"format": FORMAT, "settings": dict(settings)}))
        self.settings, self.entries = dict(settings), {}

    def append(self, name: str, entry: Entry) -> None:
        """Record, durably, a file that has its final name; raises StorageError."""
        line = _line({"file": name, **entry._asdict()})
        try:
            with self._appending, self.path.open("r+b") as stream:
                # This line would merge with a torn last one: end that first.
                if stream.seek(0, os.SEEK_END) and stream.seek(-1, os.SEEK_END) and stream.read(1) != b"\n":
                    line = b"\n" + line
                stream.write(line)
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            what = f"writing failed: {error.strerror}"
            raise StorageError(what, path=self.path, cure=disk_cure(error)) from error
        self.entries[name] = entry

    def has_finished(self, path: Path) -> bool:
        """True where a file is finished: it is listed, and its content has the listed SHA-256."""
        entry = self.entries.get(path.name)
        return entry is not None and path.is_file() and file_sha256(path) == entry.sha256


def _line(record: Mapping[str, Any]) -> bytes:
    body = json.dumps(record, sort_keys=True)
    return f'{body[:-1]}, "crc32": "{zlib.crc32(body.encode()):08x}"}}\n'.encode()


def _parsed(line: bytes) -> dict[str, Any] | None:
    """Return the record of a line, or None for one that is torn or damaged."""
    try:
        record = json.loads(line)
        claimed = record.pop("crc32")
    except (ValueError, AttributeError, KeyError):
        return None
    computed = f"{zlib.crc32(json.dumps(record, sort_keys=True).encode()):08x}"
    return record if computed == claimed else None
