"""What has to be built before anything is measured: every program that the tasks need, each once.

A compiler takes a second for a program, and processes that want the same one at once would each build it. Which
programs a frame calls for is decided by its header and channels, so that one pixel of each frame tells them all.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from cltaa.bench.accuracy.variant_errors import Task
from cltaa.bench.accuracy.variant_times import enlargement
from cltaa.devices.device_launcher import DeviceLauncher
from cltaa.devices.numpy_launcher import NumpyLauncher
from cltaa.devices.program import source
from cltaa.frames import Frame
from cltaa.memory.layout import Layout
from cltaa.parameters.build import Build
from cltaa.resolve.timed_resolve import resolve_job, timed_numbers
from cltaa.sequences.sources import Sequence as Captured


class Program(msgspec.Struct, frozen=True, kw_only=True):
    """A kernel and all that it is built from."""

    kernel: str
    build: Build


class Rehearsal(NumpyLauncher):
    """Notes which programs another launcher would need for planes of a layout, and runs none."""

    def __init__(self, launcher: DeviceLauncher, layout: Layout) -> None:
        self._launcher, self._layout = launcher, layout
        self.programs: set[Program] = set()

    def build(self, plan_build: Build) -> Build:
        """The build as the other launcher shapes it."""
        return self._launcher.build(plan_build)

    def run(self, kernel: str, build: Build, layout: Layout, arguments: Mapping[str, Any]) -> None:
        """Only note the program."""
        self.programs.add(Program(kernel=kernel, build=self._launcher.fitted(kernel, build, self._layout, arguments)))


def programs_of(tasks: Sequence[Task], launcher: DeviceLauncher, pixels: int | None = None) -> set[Program]:
    """What errors and times of ``tasks``, all over one sequence, need.

    ``pixels`` are those of a frame that is timed, at least; None: what fills the device.
    """
    captured = tasks[0].open()
    frames = {number: _pixel_of(captured, number) for number in captured.numbers}
    pair = [frames[number] for number in timed_numbers(captured)]
    factor = enlargement(captured, launcher, pixels)
    found: set[Program] = set()
    for task in tasks:
        whole = Rehearsal(launcher, Layout(captured.width, captured.height))
        resolver = task.variant.resolver(whole)
        for frame in frames.values():
            resolver.resolve(frame)
        timed = Rehearsal(launcher, Layout(captured.width * factor, captured.height * factor))
        resolve_job(task.variant.name, task.variant.resolver(timed), pair)
        found |= whole.programs | timed.programs
    return found


def programs_needed(
    tasks: Sequence[Task], launcher: DeviceLauncher, pixels: int | None, found: set[Program]
) -> Iterator[str]:
    """Add to ``found`` what the tasks need, and yield each sequence when that is done."""
    for folder in dict.fromkeys(task.sequence for task in tasks):
        found |= programs_of([task for task in tasks if task.sequence == folder], launcher, pixels)
        yield folder


def dearest_first(programs: Iterable[Program]) -> list[Program]:
    """In an order in which many processes end together: a compiler's time follows the length of the text."""
    return sorted(programs, key=lambda program: (-len(source(program.kernel, program.build)), repr(program)))


def _pixel_of(captured: Captured, number: int) -> Frame:
    """A frame of one pixel with the header and the channels of a captured one."""
    outline = captured.outline(number)
    plane, pair = np.zeros((1, 1), np.float32), np.zeros((1, 1, 2), np.float32)
    return replace(
        outline,
        colour=np.zeros((1, 1, 3), np.float32),
        depth=plane + 1,
        motion=None if outline.motion is None else pair,
        alpha=None if outline.alpha is None else plane,
        reactive=None if outline.reactive is None else plane,
    )
