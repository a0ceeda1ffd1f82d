"""The recurrent state of a resolve on disk, so that an interrupted run resumes with the same bits.

The written images do not hold that state: they may be halves, and lack the counts and the depth of the last frame. Two
slots alternate, each written atomically, so that one of them is whole whenever the process or the machine stops; a slot
that is damaged, or of other settings, is ignored.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from cltaa.core.record import Past
from cltaa.core.resolver import Resolver
from cltaa.io.atomic import atomic_path

CHECKPOINT_EVERY = 32  # frames; what an interruption without warning can cost
SLOTS = (".checkpoint-0.npz", ".checkpoint-1.npz")
# Exceptions from reading a damaged slot, whichever of its bytes is wrong.
_DAMAGED = (OSError, ValueError, KeyError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error, NotImplementedError)


class _Facts(msgspec.Struct, frozen=True):
    """What a slot holds besides planes of pixels: the key of its state, the last frame, and the hash of its inputs."""

    key: str
    past: Past
    made_from: str


class Checkpoints:
    """The two slots of one output folder; ``key`` identifies everything that decides the bits of the state."""

    def __init__(self, folder: Path, key: str) -> None:
        self._paths, self._key = [folder / name for name in SLOTS], key

    def save(self, resolver: Resolver, made_from: str) -> None:
        """Write the state after the last frame, and what it is ``made_from``, over the older slot; raises OutputError
        and StorageError."""
        past, buffers = resolver.recurrent()
        newest = [path for path, _ in self._slots()[:1]]
        path = next(path for path in self._paths if path not in newest)
        facts = msgspec.json.encode(_Facts(self._key, past, made_from), enc_hook=_encoded)
        with ExitStack() as stack, atomic_path(path) as temporary:
            planes: dict[str, Any] = {
                name: stack.enter_context(buffer.mapped(write=False)) for name, buffer in buffers.items()
            }
            with temporary.open("wb") as stream:
                np.savez(stream, **planes, facts=np.frombuffer(facts, np.uint8))

    def restore(self, resolver: Resolver, finished: Mapping[int, str]) -> int | None:
        """Restore the latest state into ``resolver``; returns the number of its frame, None without one.

        Its frame must be ``finished``, and the state made from the inputs that have the hash there. Others are deleted:
        they would keep the place of states that are saved before them.
        """
        for path, facts in self._slots():
            if finished.get(facts.past.index) != facts.made_from:
                path.unlink(missing_ok=True)
            elif _restored(path, facts.past, resolver):
                return facts.past.index
        resolver.reset()
        return None

    def clear(self) -> None:
        """Delete both slots."""
        for path in self._paths:
            path.unlink(missing_ok=True)

    def _slots(self) -> list[tuple[Path, _Facts]]:
        """Return the slots of this key, the latest first, without reading their planes."""
        found = []
        for path in self._paths:
            try:
                with path.open("rb") as stream, np.load(stream, allow_pickle=False) as saved:
                    facts = msgspec.json.decode(saved["facts"].tobytes(), type=_Facts, dec_hook=_decoded)
            except _DAMAGED:
                continue
            if facts.key == self._key:
                found.append((path, facts))
        return sorted(found, key=lambda slot: slot[1].past.index, reverse=True)


def _restored(path: Path, past: Past, resolver: Resolver) -> bool:
    """Restore the state after ``past`` from a slot; returns False for one whose planes are damaged."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as saved:
            for name, buffer in resolver.restore(past).items():
                content = saved[name]
                with buffer.mapped(write=True) as planes:
                    if (content.shape, content.dtype) != (planes.shape, planes.dtype):
                        raise ValueError("planes of another size")
                    planes[...] = content
    except _DAMAGED:
        return False
    return True


def _encoded(value: Any) -> Any:
    """Encode matrices as lists: the shortest decimals that give the same doubles again."""
    return value.tolist()


def _decoded(_: Any, value: Any) -> Any:
    return np.array(value, np.float64)
