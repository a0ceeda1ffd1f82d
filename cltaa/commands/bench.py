"""``cltaa bench``: the group of the measuring commands."""

from __future__ import annotations

import click

from cltaa.commands.lazy import Entry, LazyGroup

MEASUREMENTS = {
    "accuracy": Entry("cltaa.commands.bench_accuracy", "accuracy", "Measure what each step of accuracy costs in time."),
    "api": Entry("cltaa.commands.bench_api", "api", "Time a call from a program against its kernels and the bus."),
    "effects": Entry("cltaa.commands.bench_effects", "effects", "Measure what the plan saves."),
    "files": Entry("cltaa.commands.bench_files", "files", "Time files, and how well the stages of a resolve overlap."),
    "kernels": Entry("cltaa.commands.bench_kernels", "kernels", "Time the kernels against the alternatives."),
    "overview": Entry("cltaa.commands.bench_accuracy", "overview", "Put reports of bench accuracy together."),
    "quality": Entry("cltaa.commands.bench_quality", "quality", "Judge presets on scenes against the truth."),
}


@click.group(cls=LazyGroup, entries=MEASUREMENTS)
def bench() -> None:
    """Measure time, and what accuracy costs in it."""
