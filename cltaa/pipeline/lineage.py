"""What a result is made from, as one hash: its own input, and those of the frames around it that decide its bits."""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Iterable

from cltaa.core.plan import is_hold, with_effects
from cltaa.core.presets import Preset
from cltaa.frame import Asked, Camera, Frame


def input_of(number: int, sha256: str, beside_sha256: str | None) -> str:
    """Return a text that identifies the input of frame ``number``: its file and what belongs to it."""
    return f"{number} {sha256} {beside_sha256}"


def frames_behind(preset: Preset) -> int:
    """Return how many frames before its own a result from the ring is made from: those of the ring, and the one before,
    whose camera tells which motion vectors of the first are dropped."""
    return preset.settings.history_frames + 1


class Lineage:
    """The inputs of the frames so far that the last result is made from: those of the ring, in a hold all of the hold,
    and unless results depend on the ``ring`` alone all from the first on."""

    def __init__(self, preset: Preset, effects: Asked, *, ring: bool) -> None:
        self._preset, self._effects, self._ring = preset, effects, ring
        self._past = deque[str](maxlen=1 + frames_behind(preset))
        self._chain = ""  # of the results before, where the last one continues them
        self._camera: Camera | None = None

    def add(self, its_input: str, frame: Frame) -> None:
        """Take the input of the next frame; ``frame`` is that, or its outline."""
        before = [self._chain] if self._chain else self._past
        continues = not self._ring or is_hold(self._preset, with_effects(frame, self._effects), self._camera)
        self._chain = _sha256([*before, its_input]) if continues else ""
        self._past.append(its_input)
        self._camera = frame.camera

    def digest(self, ahead: Iterable[str] = ()) -> str:
        """Return the hash of what the last frame's result is made from, with the inputs of frames ``ahead`` of it."""
        return _sha256([*([self._chain] if self._chain else self._past), *ahead])


def _sha256(lines: list[str]) -> str:
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()
