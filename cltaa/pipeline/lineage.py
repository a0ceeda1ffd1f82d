"""What a result is made from, as one hash: its own input, and those of the frames around it that decide its bits."""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Iterable


def input_of(number: int, sha256: str, beside_sha256: str | None) -> str:
    """Return a text that identifies the input of frame ``number``: its file and what belongs to it."""
    return f"{number} {sha256} {beside_sha256}"


class Lineage:
    """The inputs of the frames so far: the last one and ``kept`` before it, or with None all from the first on."""

    def __init__(self, kept: int | None, inputs: Iterable[str] = ()) -> None:
        """Begin with ``inputs`` in the order of their frames."""
        self._all = kept is None
        self._past = deque[str](maxlen=1 if kept is None else 1 + kept)
        for each in inputs:
            self.add(each)

    def add(self, its_input: str) -> None:
        """Take the input of the next frame."""
        self._past.append(_sha256([*self._past, its_input]) if self._all else its_input)

    def digest(self, ahead: Iterable[str] = ()) -> str:
        """Return the hash of what the last frame's result is made from, with the inputs of frames ``ahead`` of it."""
        return _sha256([*self._past, *ahead])


def _sha256(lines: list[str]) -> str:
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()
