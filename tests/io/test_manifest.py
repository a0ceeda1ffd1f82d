"""The manifest records whole files and nothing else, however its own last line ended."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from cltaa.errors import DataError, StorageError
from cltaa.io.manifest import (
    NAME,
    Entry,
    Manifest,
    _line,
    file_sha256,
    recorded_hashes,
)

SETTINGS = {"preset": "default", "size": [37, 23]}


def begun(folder: Path, count: int) -> Manifest:
    manifest = Manifest(folder)
    manifest.begin(SETTINGS)
    for number in range(count):
        path = folder / f"a.{number:04d}.exr"
        path.write_bytes(bytes([number]) * 100)
        manifest.append(path.name, Entry(file_sha256(path), "0" * 64, number - 1 if number else None))
    return manifest


def test_what_was_appended_is_read_again(tmp_path: Path) -> None:
    manifest = begun(tmp_path, 3)
    again = Manifest(tmp_path)
    assert (again.settings, again.entries) == (SETTINGS, manifest.entries)
    assert list(again.entries) == ["a.0000.exr", "a.0001.exr", "a.0002.exr"]
    assert all(again.has_finished(tmp_path / name) for name in again.entries)
    assert not again.has_finished(tmp_path / "a.0003.exr")
    assert all(json.loads(line) for line in (tmp_path / NAME).read_text().splitlines())  # for other tools


def test_lines_of_before_that_know_of_one_file_alone_are_read(tmp_path: Path) -> None:
    (tmp_path / NAME).write_bytes(
        _line({"format": 1, "settings": {}})
        + _line({"file": "a.0001.exr", "sha256": "0", "input_sha256": "1", "after": None})
    )
    assert Manifest(tmp_path).entries == {"a.0001.exr": Entry("0", "1", None)}


@pytest.mark.parametrize(
    "changes", [{"file": ""}, {"file": "../a.exr"}, {"file": "/a.exr"}, {"sha256": None}, {"colour": "red"}]
)
def test_lines_that_lead_out_of_the_folder_or_are_of_another_program_are_none(
    tmp_path: Path, changes: dict[str, str | None]
) -> None:
    record = {"file": "a.exr", **Entry("0", "1", None)._asdict()} | changes
    line = _line({name: value for name, value in record.items() if value or name in ("file", "after")})
    (tmp_path / NAME).write_bytes(_line({"format": 1, "settings": {}}) + line)
    assert Manifest(tmp_path).entries == {}


def test_a_line_is_flushed_before_the_file_is_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    manifest, flushed = begun(tmp_path, 1), list[bytes]()

    def fsync(descriptor: int) -> None:
        assert list(manifest.entries) == ["a.0000.exr"]
        flushed.append(Path(f"/proc/self/fd/{descriptor}").read_bytes())

    monkeypatch.setattr(os, "fsync", fsync)
    manifest.append("next", Entry("1" * 64, "2" * 64, None))
    assert flushed == [(tmp_path / NAME).read_bytes()]


def test_every_cut_of_the_file_leaves_whole_lines_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cut after any byte: the lines before the cut count, the torn one does not, and the next one is not swallowed."""
    monkeypatch.setattr(os, "fsync", lambda _: None)  # hundreds of times, for what no machine stops in between
    begun(tmp_path, 2)
    whole = (tmp_path / NAME).read_bytes()
    ends = [position for position, byte in enumerate(whole, start=1) if byte == ord("\n")]
    for cut in range(ends[0], len(whole) + 1):
        (tmp_path / NAME).write_bytes(whole[:cut])
        torn = Manifest(tmp_path)
        assert len(torn.entries) == sum(end - 1 <= cut for end in ends[1:])  # all but the line's end will do
        torn.append("next", Entry("1" * 64, "2" * 64, None))
        assert Manifest(tmp_path).entries == torn.entries


def test_every_damaged_byte_of_an_entry_is_seen(tmp_path: Path) -> None:
    begun(tmp_path, 1)
    whole = (tmp_path / NAME).read_bytes()
    first = whole.index(b"\n") + 1
    undamaged = Manifest(tmp_path).entries
    for position in range(first, len(whole)):
        damaged = bytearray(whole)
        damaged[position] ^= 1
        (tmp_path / NAME).write_bytes(damaged)
        assert Manifest(tmp_path).entries in ({}, undamaged), damaged


def test_damaged_first_line_is_refused(tmp_path: Path) -> None:
    begun(tmp_path, 1)
    content = (tmp_path / NAME).read_text().replace("default", "defauld")
    (tmp_path / NAME).write_text(content)
    with pytest.raises(DataError, match=r"manifest\.jsonl: the first line is damaged; name another folder"):
        Manifest(tmp_path)


def test_changed_files_are_named(tmp_path: Path) -> None:
    begun(tmp_path, 2)
    (tmp_path / "sequence.json").write_text(json.dumps({"files": {"reference/b.exr": "3" * 64}}))
    recorded = recorded_hashes(tmp_path)
    assert set(recorded) == {"a.0000.exr", "a.0001.exr", "reference/b.exr"}
    assert recorded["a.0000.exr"] == file_sha256(tmp_path / "a.0000.exr")
    (tmp_path / "a.0000.exr").write_bytes(b"changed")
    assert not Manifest(tmp_path).has_finished(tmp_path / "a.0000.exr")
    assert recorded_hashes(tmp_path / "none") == {}


def test_a_folder_that_went_away_is_reported(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    manifest = begun(folder, 1)
    for path in folder.iterdir():
        path.unlink()
    folder.rmdir()
    with pytest.raises(StorageError, match="No such file"):
        manifest.append("x", Entry("", "", None))
    with pytest.raises(StorageError, match=r"a\.0000\.exr: cannot be read: No such file"):
        file_sha256(folder / "a.0000.exr")
