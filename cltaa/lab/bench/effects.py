"""What the plan saves on a sequence, and proof that it changes time and not the picture (docs/effects.md).

Three resolves: as planned; with every step that was left out running too, which must give the same bits; and as if
nothing were declared (``all``), where plain means and plain weights give way to the preset's own.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import msgspec
import numpy as np

from cltaa.core.backend import Launcher
from cltaa.core.plan import Plan, with_effects
from cltaa.core.presets import Preset
from cltaa.core.resolver import Resolver
from cltaa.frame import format_effects
from cltaa.io.sequence import FrameSequence
from cltaa.lab.timing import Clock, Interval, Samples, measure, resolve_job
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.progress import track

WAYS = PLANNED, EVERY, ALL = "as planned", "every step", "all effects"


class EffectRow(msgspec.Struct, kw_only=True):
    """One scene. Times are milliseconds of kernels a frame; ``saving`` is how many times as long ``all`` takes.

    On a processor they are its own time, all threads together, which another program's load does not change.
    """

    scene: str
    effects: str
    steps: list[str]  # that run on the last frame
    frames: int
    same_bits: bool  # as planned and with every step, in strict mode, all frames
    replaced: float  # largest difference between as planned and all effects
    replaced_mean: float
    planned_ms: float
    every_ms: float
    all_ms: float
    saving: Interval


def judge_effects(sequence: FrameSequence, preset: str | Preset, launcher: Launcher, *, rounds: int) -> EffectRow:
    """Resolve ``sequence`` in the three ways, compare all frames in strict mode, and time the last one.

    Scenes that share a ``launcher`` share its kernels.
    """
    same, largest, total = True, 0.0, 0.0
    strict = {
        name: Resolver(preset, launcher, strict=True, every_step=name != PLANNED) for name in (PLANNED, EVERY, ALL)
    }
    for frame in track(sequence, len(sequence), "resolving"):
        planned, every, everything = (strict[way].resolve(with_effects(frame, _named(way))) for way in WAYS)
        same = same and planned.tobytes() == every.tobytes()
        difference = np.abs(planned.astype(np.float64) - everything)
        largest, total = max(largest, float(difference.max())), total + float(difference.mean())
    samples, plan = _time(sequence, preset, launcher, rounds)
    clock = Clock.DEVICE if isinstance(launcher, DeviceLauncher) and not launcher.device.is_cpu else Clock.PROCESSOR
    return EffectRow(
        scene=sequence.frame_header(sequence.first).scene,
        effects=format_effects(sequence.effects or ()) or ("none" if sequence.effects is not None else "not declared"),
        steps=[reason.step for reason in plan.reasons if reason.on],
        frames=len(sequence),
        same_bits=same,
        replaced=largest,
        replaced_mean=total / len(sequence),
        planned_ms=float(np.median(samples.seconds(PLANNED, clock))) * 1e3,
        every_ms=float(np.median(samples.seconds(EVERY, clock))) * 1e3,
        all_ms=float(np.median(samples.seconds(ALL, clock))) * 1e3,
        saving=samples.ratio(ALL, PLANNED, clock),
    )


def _time(sequence: FrameSequence, preset: str | Preset, launcher: Launcher, rounds: int) -> tuple[Samples, Plan]:
    """Time the kernels of the last frame in the three ways, in turn; also what was planned for it."""
    before, frame = (sequence.frame(number) for number in sequence.numbers[-2:])
    pair = replace(before, cut=True), replace(frame, cut=False)
    jobs, plans = [], {}
    for name in WAYS:
        resolver = Resolver(preset, launcher, every_step=name != PLANNED)
        job, _ = resolve_job(name, resolver, [with_effects(one, _named(name)) for one in pair])
        assert resolver.plan is not None
        plans[name] = resolver.plan
        jobs.append(job)
    return measure(jobs, rounds, warm_up=3), plans[PLANNED]


def _named(way: str) -> Literal["auto", "all"]:
    return "all" if way == ALL else "auto"


def cells(row: EffectRow) -> dict[str, str]:
    """A row of the table of docs/generated/effects.md, by its heads."""
    saving = f"{row.saving.median:.2f} ({row.saving.low:.2f} to {row.saving.high:.2f})"
    replaced = "nothing" if row.replaced == 0.0 else f"{row.replaced:.2g}, mean {row.replaced_mean:.1g}"
    return {
        "scene": row.scene,
        "effects": row.effects.replace(",", " "),
        "steps that run": ", ".join(row.steps) or "none",
        "ms planned": f"{row.planned_ms:.2f}",
        "ms every step": f"{row.every_ms:.2f}",
        "ms all": f"{row.all_ms:.2f}",
        "all / planned": saving,
        "same bits": "yes" if row.same_bits else "**no**",
        "replaced": replaced,
    }
