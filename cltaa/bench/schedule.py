"""What to begin with: of many sequences and variants, the first that needs each set of programs.

A compiler that takes seconds for a program should see each once, in as many processes as there are, before a process
that times needs it; two processes that want the same one at once would both wait for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from cltaa.bench.baseline import resolve_job
from cltaa.bench.errors_of import Task
from cltaa.bench.times_of import enlarged, enlargement, pair_of
from cltaa.build import Build
from cltaa.frames import Frame
from cltaa.launch import DeviceLauncher, NumpyLauncher
from cltaa.layout import Layout
from cltaa.sources import open_sequence


class Rehearsal(NumpyLauncher):
    """Notes which programs another launcher would need, and runs none."""

    def __init__(self, launcher: DeviceLauncher) -> None:
        self._launcher = launcher
        self.programs: set[tuple[str, Build]] = set()

    def build(self, plan_build: Build) -> Build:
        """The build as the other launcher shapes it."""
        return self._launcher.build(plan_build)

    def run(self, kernel: str, build: Build, layout: Layout, arguments: Mapping[str, Any]) -> None:
        """Only note the program."""
        self.programs.add((kernel, build))


class Ahead(msgspec.Struct, frozen=True, kw_only=True):
    """A task whose programs are to be built for frames that are enlarged so many times."""

    task: Task
    factor: int


def first_of_each(tasks: Sequence[Task], launcher: DeviceLauncher, pixels: int | None = None) -> list[Ahead]:
    """The tasks that need programs which none before them needs, as their last two frames have it.

    ``pixels`` are those of a frame that is timed, at least; None: what fills the device.
    """
    known: set[tuple[str, Build]] = set()
    frames: dict[str, list[Frame]] = {}
    factor, first = 1, []
    for task in tasks:
        if task.sequence not in frames:
            captured = open_sequence(Path(task.sequence))
            frames, factor = {task.sequence: pair_of(captured)}, enlargement(captured, launcher, pixels)
        rehearsal = Rehearsal(launcher)
        resolve_job(task.variant.name, task.variant.resolver(rehearsal), frames[task.sequence])
        if not rehearsal.programs <= known:
            known |= rehearsal.programs
            first.append(Ahead(task=task, factor=factor))
    return first


def build_ahead(ahead: Ahead) -> None:
    """Have the driver build, and keep, what timing the task's variant over its sequence will need."""
    task, captured = ahead.task, open_sequence(Path(ahead.task.sequence))
    frames = [enlarged(frame, ahead.factor) for frame in pair_of(captured)]
    resolve_job(task.variant.name, task.variant.resolver(task.device), frames)
