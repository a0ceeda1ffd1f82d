"""The resolve as something to be timed: its kernels on two frames of a sequence, again and again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from cltaa.devices.device_launcher import DeviceLauncher
from cltaa.frames import Frame, Image
from cltaa.parameters.choices import HistoryOf
from cltaa.resolve.resolver import Resolver
from cltaa.sequences.sources import Sequence
from cltaa.timing import Job


def timed_numbers(sequence: Sequence) -> list[int]:
    """The numbers of the last two frames of which the later goes on from the earlier: what is timed of a sequence."""
    numbers = list(sequence.numbers)
    last = next((n for n in reversed(numbers[1:]) if not sequence.outline(n).cut), numbers[-1])
    return [number for number in numbers if last - sequence.step <= number <= last]


def timed_frames(sequence: Sequence) -> list[Frame]:
    """The frames of ``timed_numbers``."""
    return [sequence.frame(number) for number in timed_numbers(sequence)]


def resolve_job(name: str, resolver: Resolver, frames: list[Frame], rounds: int | None = None) -> tuple[Job, Image]:
    """A job that runs the kernels of the last of two or more ``frames`` again, and the image [H, W, 3 or 4] they give.

    Its clock is the device's, in seconds, and there is none on NumPy. Raises what ``Resolver.resolve`` raises.
    """
    if resolver.preset.choices.history_of is HistoryOf.SAMPLES:
        _keep_before(resolver, frames[0])
    image = [resolver.resolve(frame) for frame in frames][-1]
    launcher = resolver.launcher

    def run() -> float | None:
        events: list[tuple[str, Any]] | None = [] if isinstance(launcher, DeviceLauncher) else None
        if isinstance(launcher, DeviceLauncher):
            launcher.events = events
        resolver.run_again(frames[-1], frames[-2])
        return None if events is None else device_seconds(events)

    return Job(name, run, rounds), image


def _keep_before(resolver: Resolver, frame: Frame) -> None:
    """Keep ``frame`` as often as the preset keeps frames, as if each had been resolved, if its plan gathers at all."""
    before = replace(frame, index=frame.index - frame.step)
    resolver.resolve(before)
    resolver.keep_again(before, resolver.preset.settings.frames_kept)


def device_seconds(events: list[tuple[str, Any]]) -> float:
    """Seconds that the device worked on these finished kernels of one queue; the gaps between them left out.

    A gap is the host's: it is in the wall time, and vanishes where the host runs ahead of the device.
    """
    return float(sum(event.profile.end - event.profile.start for _, event in events)) * 1e-9
