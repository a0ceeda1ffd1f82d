"""ISA-L's own functions pack what its Python module packs, into no more memory than they are given."""

from __future__ import annotations

import ctypes
import threading
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from cltaa.exr import isal_core
from cltaa.exr.isal_core import Bytes, deflate, deflate_by_module, fast_deflate

isal_zlib = pytest.importorskip("isal.isal_zlib")

UNTOUCHED = 0xA5


@pytest.fixture(autouse=True)
def asked_anew() -> Iterator[None]:
    isal_core.core.cache_clear()
    yield
    isal_core.core.cache_clear()


def steps(size: int, width: int, seed: int = 0) -> Bytes:
    """Bytes near 128, the nearer the better they pack, as those of a chunk are."""
    return np.random.default_rng(seed).integers(128 - width, 129 + width, size).astype(np.uint8)


def test_the_library_is_there() -> None:
    assert fast_deflate() is deflate


@pytest.mark.parametrize("size", [1, 14, 184_320, 368_640])
@pytest.mark.parametrize("width", [0, 3, 60])
def test_a_stream_is_whole_and_no_longer_than_the_modules(size: int, width: int) -> None:
    source, room = steps(size, width), np.full(2 * size + 100, UNTOUCHED, np.uint8)
    packed = deflate(source, room[: size + 50])
    assert zlib.decompress(room[:packed].tobytes()) == source.tobytes()
    assert (room[size + 50 :] == UNTOUCHED).all()
    assert 0 < packed <= 1.01 * deflate_by_module(source, room)


@pytest.mark.parametrize("packer", [deflate, deflate_by_module])
def test_what_does_not_fit_is_nothing_and_touches_nothing_else(packer: isal_core.Deflate) -> None:
    source, room = steps(50_000, 20), np.full(60_000, UNTOUCHED, np.uint8)
    whole = packer(source, room)
    assert 0 < whole < 50_000
    for size in (0, 1, 2, 7, 100, whole - 1, whole):
        room[:] = UNTOUCHED
        assert packer(source, room[:size]) == 0
        assert (room[size:] == UNTOUCHED).all()
    assert packer(source, room[: whole + 1]) == whole


def test_threads_do_not_share_a_stream() -> None:
    sources = [steps(100_000, 5 + seed, seed) for seed in range(4)]
    expected = [packed(source) for source in sources]
    found: dict[int, list[bytes]] = {}

    def work(number: int) -> None:
        found[number] = [packed(sources[number]) for _ in range(20)]

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == {number: [expected[number]] * 20 for number in range(4)}


def packed(source: Bytes) -> bytes:
    room = np.empty(len(source), np.uint8)
    return room[: deflate(source, room)].tobytes()


def test_a_module_without_the_functions_packs_by_itself(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    hidden = SimpleNamespace(__file__=str(tmp_path / "none.so"), compress=isal_zlib.compress)
    monkeypatch.setattr(isal_core, "isal_zlib", hidden)
    assert fast_deflate() is deflate_by_module


def exchanged(fields: list[Any]) -> list[Any]:
    fields[-5], fields[-2] = fields[-2], fields[-5]
    return fields


def moved(fields: list[Any]) -> list[Any]:
    return [*fields[:7], ("more", ctypes.c_uint8 * 64), *fields[7:]]


@pytest.mark.parametrize("other", [exchanged, moved])
def test_a_library_with_another_structure_is_not_used(
    monkeypatch: pytest.MonkeyPatch, other: Callable[[list[Any]], list[Any]]
) -> None:
    """The one is told by the stream that is packed with it, the other before anything is."""

    class Other(ctypes.Structure):
        _fields_ = other(list(isal_core._Stream._fields_))

    monkeypatch.setattr(isal_core, "_Stream", Other)
    monkeypatch.setattr(isal_core, "_OF_THREAD", isal_core._OfThread())
    called = Mock(wraps=isal_core._deflate)
    monkeypatch.setattr(isal_core, "_deflate", called)
    assert fast_deflate() is deflate_by_module
    assert called.called == (other is exchanged)


def test_a_library_whose_streams_are_torn_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(isal_core, "_deflate", lambda *_: 5)  # fewer bytes than a stream's beginning and end
    assert fast_deflate() is deflate_by_module
