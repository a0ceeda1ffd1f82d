"""Files copied into memory: the bytes that are there, once, in memory that an earlier file has left."""

from __future__ import annotations

import errno
import gc
import hashlib
import os
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from cltaa.core.planes import BLOCK_POOL
from cltaa.errors import DataError, StorageError
from cltaa.io import content as file_content
from cltaa.io.atomic import atomic_path
from cltaa.io.content import copied, memory_limit, open_regular, read_bytes


def held(path: Path, sha256: str | None = None) -> tuple[int, bytes]:
    """Where the copy lies, and what it holds to the other side of its descriptor."""
    with open_regular(path) as file, copied(path, file) as copy:
        if sha256 is not None:
            copy.check_sha256(path, sha256)
        return copy.fileno(), Path(f"/proc/self/fd/{copy.fileno()}").read_bytes()


@pytest.mark.parametrize("kept", [False, True])
def test_files_of_all_sizes_one_after_another(tmp_path: Path, kept: bool) -> None:
    path, places = tmp_path / "a", set()
    with BLOCK_POOL if kept else nullcontext():
        for size in (5_000_000, 3, 4096, 9_000_001, 9_000_000, 0, 1):
            content = os.urandom(size)
            path.write_bytes(content)
            place, found = held(path, hashlib.sha256(content).hexdigest())
            assert found == content
            places.add(place)
        assert not kept or len(places) == 1


def test_two_files_at_once_lie_apart(tmp_path: Path) -> None:
    for name in "ab":
        (tmp_path / name).write_bytes(name.encode() * 5000)
    with (
        BLOCK_POOL,
        open_regular(tmp_path / "a") as first,
        open_regular(tmp_path / "b") as second,
        copied(tmp_path / "a", first) as one,
        copied(tmp_path / "b", second) as two,
    ):
        assert bytes(one.view()) == b"a" * 5000
        assert bytes(two.view()) == b"b" * 5000


def test_file_that_ends_before_its_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    monkeypatch.setattr("cltaa.io.content.file_size", lambda _: 6)
    with BLOCK_POOL:
        with pytest.raises(DataError, match=r"a: the file changed while it was read; run again"):
            held(path)
        monkeypatch.undo()
        assert held(path)[1] == b"12345"


def test_a_wrong_copy_is_refused_and_given_back(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    gc.collect()  # copies that the errors of earlier tests hold
    before = len(list(Path("/proc/self/fd").iterdir()))

    with open_regular(path) as file:
        assert copied(path, file).read_at(1, 2) == b"23"
    with pytest.raises(DataError, match=r"not what was recorded.*found 5994471abb01"):
        held(path, "0" * 64)
    gc.collect()
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_the_memory_of_a_group_is_the_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a container that may have less than the machine."""
    monkeypatch.setattr(file_content, "_CGROUP_LIMIT", tmp_path / "memory.max")
    machine = memory_limit()
    for text, limit in (("4096\n", 4096), ("max\n", machine), (f"{2 * machine}\n", machine)):
        (tmp_path / "memory.max").write_text(text)
        assert memory_limit() == limit


def test_a_file_takes_few_calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where threads are many each call that lets go of the interpreter is waited for."""
    path, calls, read = tmp_path / "a", list[int](), os.preadv
    path.write_bytes(bytes(3_000_000))

    def counted(*arguments: object) -> int:
        calls.append(1)
        return read(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(os, "preadv", counted)
    held(path)
    assert len(calls) == 1


def test_a_file_may_have_as_many_bytes_as_are_allowed(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert read_bytes(path, "a text", 5) == b"12345"
    with pytest.raises(DataError, match=r"too large for a text \(expected at most 4 bytes"):
        read_bytes(path, "a text", 4)


@pytest.mark.parametrize("opened", [open_regular, atomic_path])
@pytest.mark.parametrize(
    ("number", "cure"),
    [(errno.ENOSPC, "free some space"), (errno.EFBIG, "ulimit -f unlimited"), (errno.ESTALE, "check the folder")],
)
def test_room_is_the_cure_where_room_is_short(tmp_path: Path, opened: Any, number: int, cure: str) -> None:
    """Of what is read for its copy in memory; a folder that went away has room enough."""
    path = tmp_path / "a"
    path.touch()
    with pytest.raises(StorageError, match=f"failed: .*; .*{cure}"), opened(path):
        raise OSError(number, os.strerror(number))


@pytest.mark.parametrize(("kind", "words"), [("folder", "a folder"), ("pipe", "a pipe or a device")])
def test_what_is_no_file_is_named(tmp_path: Path, kind: str, words: str) -> None:
    path = tmp_path / "a"
    path.mkdir() if kind == "folder" else os.mkfifo(path)
    with pytest.raises(DataError, match=rf"a: this is {words} \(expected a text"):
        read_bytes(path, "a text", 5)
