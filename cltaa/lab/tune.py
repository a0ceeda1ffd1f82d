"""Search for the settings with the least error within a time, or the least time within an error (extra ``tune``).

Finished trials stay on disk, so that an interrupted search can continue: given the same outcomes the sampler proposes
the same settings again, and a measured trial is looked up by a hash of everything that determines it.
"""

from __future__ import annotations

import hashlib
import math
import shutil
from collections.abc import Collection, Iterator, Sequence
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import tomli_w

from cltaa.core.backend import Launcher
from cltaa.core.build import code_sha256
from cltaa.core.parameter_needs import unmet
from cltaa.core.parameters import Choices
from cltaa.core.presets import LADDER, Preset, load_preset, override, preset_names
from cltaa.core.resolver import Resolver
from cltaa.errors import UsageError, import_extra
from cltaa.frame import Frame, Image
from cltaa.io.atomic import atomic_path, keep, kept, make_folder
from cltaa.io.sequence import FrameSequence
from cltaa.lab.judge.comparison import content_sha256, truth_of
from cltaa.lab.judge.metrics import METRICS, check_finite, named_metrics, versions_of
from cltaa.lab.timing import Clock, measure, resolve_job, timed_frames
from cltaa.printable import counted, printable
from cltaa.process import is_own
from cltaa.progress import track


class Trial(msgspec.Struct, frozen=True, kw_only=True):
    """One set of settings with its error and time over the sequences of the search."""

    values: dict[str, str | float]
    error: float
    milliseconds: float  # per frame, the least of ROUNDS, averaged over the sequences


def key_of(*decided: object, sequences: Collection[FrameSequence]) -> str:
    """Return a hash of everything that determines a trial: arguments, code, files and how they are read."""
    held = [(content_sha256(sequence), sequence.step) for sequence in sequences]
    return hashlib.sha256(msgspec.json.encode([*decided, code_sha256(), *held])).hexdigest()


STEEPNESS = 4  # exponent of the penalty beyond the limit


class Goal(msgspec.Struct, frozen=True, kw_only=True):
    """The goal: the least ``metric`` within ``budget_ms`` a frame, or the least time with ``metric`` <= ``target``."""

    metric: str
    budget_ms: float | None = None
    target: float | None = None

    def score(self, error: float, milliseconds: float) -> float:
        """Return the value to minimise: one of error and time, with a penalty if the other exceeds its limit."""
        if self.budget_ms is not None:
            return error * max(1.0, milliseconds / self.budget_ms) ** STEEPNESS
        assert self.target is not None
        return milliseconds * max(1.0, error / self.target) ** STEEPNESS

    def reached(self, error: float, milliseconds: float) -> bool:
        """Return whether the limit is kept."""
        return milliseconds <= self.budget_ms if self.budget_ms is not None else error <= (self.target or 0.0)


def parse_goal(budget: str | None, target: str | None, metric: str | None = None) -> Goal:
    """Parse the goal of ``--budget 5ms`` or ``--target flip=0.02``; raises UsageError for anything else."""
    if budget is not None and target is not None:
        cure = "leave one out: the other is then minimised, --budget with --metric NAME"
        raise UsageError(f"--budget {budget} and --target {target} are two goals", cure=cure)
    if budget is None and target is None:
        raise UsageError("one of --budget and --target is needed", expected="--budget 5ms, or --target flip=0.02")
    name, _, number = (target or "").partition("=")
    text = number if budget is None else budget.removesuffix("ms").strip()
    name = name.strip() if target is not None else metric or "mse"
    if target is not None and metric not in (None, name):
        raise UsageError(f"--metric {metric} is of a --budget", cure="leave it out: a --target names its own")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (value > 0 and math.isfinite(value)):
        raise UsageError("no goal", expected="--budget 5ms, or --target flip=0.02", found=target or budget)
    if budget is not None and not budget.endswith("ms"):
        raise UsageError(f"--budget {budget} has no unit", cure=f"in milliseconds it is --budget {text}ms")
    if name not in METRICS or METRICS[name].higher_is_better:
        falling = [metric.name for metric in METRICS.values() if not metric.higher_is_better]
        raise UsageError("no metric to minimise", expected=", ".join(falling), found=name)
    named_metrics([name])  # a missing package fails here, before sequences are read and kernels built
    return Goal(metric=name, **({"target": value} if target is not None else {"budget_ms": value}))


# Searched choices. The other choices exist for transcriptions of published resolves, not for quality.
CHOICES = (
    "history_filter",
    "neighbourhood",
    "box",
    "box_space",
    "rectify",
    "dilation",
    "reject",
    "accumulate",
    "weighting",
)
NOT_WORTH = {"rectify": ("clip-unguarded",)}  # known to be discontinuous (docs/numerics.md, D2)
# name: (least, greatest, whether the search is logarithmic)
RANGES: dict[str, tuple[float, float, bool]] = {
    "blend_weight": (0.02, 0.3, True),
    "sample_limit": (4.0, 128.0, True),
    "resampling_penalty": (0.0, 4.0, False),
    "box_scale_static": (0.5, 3.0, False),
    "box_scale_moving": (0.5, 3.0, False),
    "disocclusion_blur": (0.0, 1.0, False),
}
ROUNDS = 7  # timing rounds of a candidate
PRESET = "preset"  # key of a trial that is an unchanged preset
OVERFIT = 0.5  # least share of the gain (in log) that other sequences must show


class Tuned(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome. Gains are the error of the start over that of the best: above 1 is better."""

    goal: Goal
    start: Trial
    best: Trial
    trials: int
    reached: bool
    searched_on: list[str]
    checked_on: list[str]
    gain: float
    gain_elsewhere: float | None
    overfits: bool


class Bench:
    """Sequences in memory, to measure error and time of a preset on them."""

    def __init__(self, sequences: Sequence[FrameSequence], metric: str, launcher: Launcher) -> None:
        self._metric, self._launcher = METRICS[metric], launcher
        self._sequences = sequences
        self._frames = [list(sequence) for sequence in sequences]
        self._truths = [[*truths_of(sequence)] for sequence in sequences]

    @cached_property
    def _pairs(self) -> list[list[Frame]]:
        return [timed_frames(sequence) for sequence in self._sequences]

    def error(self, preset: Preset) -> float:
        """Return the mean of the metric over all sequences, with equal weight for each."""
        means = []
        for frames, truths in zip(self._frames, self._truths, strict=True):
            resolver = Resolver(preset, self._launcher)
            found = [
                self._metric.function(image[..., :3], truth, 0.0)
                for image, truth in zip(resolver.images(frames), truths, strict=True)
            ]
            means.append(float(np.mean(found)))
        return float(np.mean(means))

    def milliseconds(self, preset: Preset) -> float:
        """Return the least kernel time of a frame, averaged over the sequences."""
        spent = []
        for pair in self._pairs:
            job, _ = resolve_job(Resolver(preset, self._launcher), pair)
            samples = measure({"candidate": job}, ROUNDS, warm_up=1)
            spent.append(float(samples.seconds("candidate", Clock.DEVICE).min()) * 1e3)
        return float(np.mean(spent))


def truths_of(sequence: FrameSequence) -> Iterator[Image]:
    """Yield the truth of each frame; raises InputMissing without one, DataError for NaN or infinity."""
    truth = truth_of(sequence)
    for number in sequence.numbers:
        image = truth.image(number)
        check_finite("reference", image, truth.path(number), number)
        yield image


def tune(
    searched: Sequence[FrameSequence],
    checked: Sequence[FrameSequence],
    goal: Goal,
    launcher: Launcher,
    *,
    base: Preset,
    trials: int,
    seed: int,
    output: Path,
) -> Tuned:
    """Search ``trials`` settings, first the unchanged ``base``, and write the best as TOML to ``output``.

    ``checked`` are sequences that the search does not use; the outcome is measured on them at the end. Trials are kept
    beside ``output`` until that is written: the same arguments, also with more trials, continue an interrupted search.
    Raises UsageError without optuna, OutputError and StorageError.
    """
    for sequence in checked:
        for _ in truths_of(sequence):  # a truth that is missing, or none, fails before the search
            pass
    study = _study(seed)
    study.enqueue_trial(_values_of(base))
    bench = Bench(searched, goal.metric, launcher)
    folder = make_folder(output.with_name(f".{output.name}.trials"))
    versions = versions_of(named_metrics([goal.metric]))
    key = key_of(goal.metric, versions, launcher.description, sequences=searched)
    found: list[Trial] = []
    for _ in track(range(trials), trials, "tuning", unit="trials"):
        asked = study.ask()
        values = _suggested(asked)
        trial = _tried(bench, folder, key, override(base, values, "cltaa tune") if found else base, values)
        study.tell(asked, goal.score(trial.error, trial.milliseconds))
        found.append(trial)
    for preset in map(load_preset, LADDER):  # the outcome must be at least as good as each of these
        if preset.deciding() != base.deciding():
            found.append(_tried(bench, folder, key, preset, {PRESET: preset.name}))
    tuned, best = _judged(found, searched, checked, goal, launcher, base)
    with atomic_path(output) as temporary:
        temporary.write_text(preset_text(tuned, best), encoding="utf-8")
    shutil.rmtree(folder)
    return tuned


def _tried(bench: Bench, folder: Path, key: str, preset: Preset, values: dict[str, str | float]) -> Trial:
    """Return the trial of a preset from ``folder``, else measure and store it."""
    path = folder / hashlib.sha256(msgspec.json.encode([key, values, preset.deciding()])).hexdigest()
    trial = kept(path, Trial)
    if trial is None:
        trial = Trial(values=values, error=bench.error(preset), milliseconds=bench.milliseconds(preset))
        keep(path, trial)
    return trial


def _study(seed: int) -> Any:
    """Create an optuna study, which proposes values and receives their scores; raises UsageError without optuna."""
    optuna: Any = import_extra("optuna", package="optuna", extra="tune", purpose="cltaa tune")
    if is_own():
        optuna.logging.set_verbosity(optuna.logging.WARNING)
    return optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed))


def _judged(
    trials: Sequence[Trial],
    searched: Sequence[FrameSequence],
    checked: Sequence[FrameSequence],
    goal: Goal,
    launcher: Launcher,
    base: Preset,
) -> tuple[Tuned, Preset]:
    """Return the outcome with its gain on ``checked``, and the best preset; the first of ``trials`` is ``base``."""
    kept = [trial for trial in trials if goal.reached(trial.error, trial.milliseconds)]
    best = min(kept or trials, key=lambda trial: goal.score(trial.error, trial.milliseconds))
    start = trials[0]
    preset = base
    if best is not start:
        own = best.values.get(PRESET)
        preset = override(base, best.values, "cltaa tune") if own is None else load_preset(str(own))
    gain, elsewhere = start.error / max(best.error, 1e-30), None
    if checked:
        other = Bench(checked, goal.metric, launcher)
        elsewhere = other.error(base) / max(other.error(preset), 1e-30)
    tuned = Tuned(
        goal=goal,
        start=start,
        best=best,
        trials=sum(PRESET not in trial.values for trial in trials),
        reached=goal.reached(best.error, best.milliseconds),
        searched_on=[sequence.folder.name for sequence in searched],
        checked_on=[sequence.folder.name for sequence in checked],
        gain=gain,
        gain_elsewhere=elsewhere,
        overfits=elsewhere is not None and overfits(gain, elsewhere),
    )
    return tuned, preset


def overfits(gain: float, elsewhere: float) -> bool:
    """Return whether less than half of a gain, in log, is left on other sequences."""
    return gain > 1.0 and (elsewhere <= 0.0 or math.log(elsewhere) < OVERFIT * math.log(gain))


def _members(field: str) -> list[str]:
    kind: type[StrEnum] = type(getattr(Choices(), field))
    return [str(member) for member in kind if member not in NOT_WORTH.get(field, ())]


def _values_of(preset: Preset) -> dict[str, Any]:
    """Return the preset as a point of the search space, with its numbers clamped to the searched ranges."""
    values: dict[str, Any] = {
        field: str(getattr(preset.choices, field))
        for field in CHOICES
        if str(getattr(preset.choices, field)) in _members(field)
    }
    for name, (low, high, _) in RANGES.items():
        values[name] = min(max(getattr(preset.settings, name), low), high)
    return values


def _suggested(trial: Any) -> dict[str, str | float]:
    values: dict[str, str | float] = {}
    for field in CHOICES:
        values[field] = str(trial.suggest_categorical(field, _members(field)))
    for name, (low, high, by_ratio) in RANGES.items():
        values[name] = float(trial.suggest_float(name, low, high, log=by_ratio))
    return values


def preset_text(tuned: Tuned, preset: Preset) -> str:
    """Return the preset as TOML: a description, its base preset, the keys that differ from that, and why some of them
    have no effect."""
    limit = f"{tuned.goal.budget_ms:g} ms" if tuned.goal.budget_ms is not None else f"{tuned.goal.target:g}"
    searched, trials = printable(", ".join(tuned.searched_on)), counted(tuned.trials, "trial")
    about = f"Tuned for {tuned.goal.metric} within {limit} on {searched}, {trials}"
    if not tuned.reached:
        about += "; the goal was not reached"
    if tuned.overfits:
        about += f"; over-fits: not borne out on {printable(', '.join(tuned.checked_on))}"
    base = load_preset(preset.name if preset.name in preset_names() else "default")
    values: dict[str, Any] = {"description": about, "preset": base.name}
    ours, theirs = preset.deciding(), base.deciding()
    if ours["published"] != theirs["published"]:  # of a file over a published preset
        values["published"] = ours["published"]
    for part in ("choices", "settings"):
        values |= {name: value for name, value in ours[part].items() if value != theirs[part][name]}
    lacking = [need for name in values for need in unmet(name, preset.choices, preset.settings)]
    whole = ours["choices"] | ours["settings"]
    values |= {field: whole[field] for need in lacking for field in need.fields}
    return tomli_w.dumps(values)
