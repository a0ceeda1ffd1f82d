"""Honest timing on a shared machine (docs/performance.md, Method): shuffled rounds, paired ratios, intervals, A/A.

Each round runs every job once in a freshly shuffled order; what two jobs took in one round is compared, so that a load
that comes and goes hits both. The statistic is the median of these ratios; its interval comes from resampling rounds.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

RESAMPLES = 4000
CONFIDENCE = 0.95
WIDEST = 0.02  # half width of the A/A interval beyond which nothing is ranked


class Sample(NamedTuple):
    """Seconds of one run: by the host's clock, and by the device's events where it has them."""

    wall: float
    device: float | None = None


@dataclass(frozen=True, slots=True)
class Job:
    """Something to time. ``run`` does it once and waits for the end; it returns the device's own seconds, or None.

    ``rounds`` is the most rounds it takes part in: a job that takes seconds need not hold up all the others.
    """

    name: str
    run: Callable[[], float | None]
    rounds: int | None = None


class Interval(msgspec.Struct, frozen=True, kw_only=True):
    """A median and the 95 % interval that resampling gives it."""

    median: float
    low: float
    high: float

    @property
    def half_width(self) -> float:
        """Half the interval over its median."""
        return (self.high - self.low) / (2.0 * self.median)

    @property
    def excludes_one(self) -> bool:
        """True where a ratio differs from 1 beyond chance."""
        return not self.low <= 1.0 <= self.high


@dataclass(slots=True)
class Samples:
    """What every job took, by round: {job: {round: sample}}."""

    by_job: dict[str, dict[int, Sample]] = field(default_factory=dict)

    def add(self, job: str, number: int, sample: Sample) -> None:
        """Note what ``job`` took in round ``number``."""
        self.by_job.setdefault(job, {})[number] = sample

    def seconds(self, job: str, *, device: bool = False) -> NDArray[np.float64]:
        """All times of a job; by the device's clock where asked for and known, else by the host's."""
        return np.array([_seconds(sample, device) for sample in self.by_job[job].values()])

    def has_device_times(self, job: str) -> bool:
        """True where the device timed every run of the job."""
        return all(sample.device is not None for sample in self.by_job[job].values())

    def interval(self, job: str, *, device: bool = False) -> Interval:
        """Median seconds of a job with its interval."""
        return interval(self.seconds(job, device=device))

    def ratio(self, job: str, base: str, *, device: bool = False) -> Interval:
        """How many times as long as ``base`` a job takes: the median over the rounds that both ran in."""
        return interval(self.ratios(job, base, device=device))

    def ratios(self, job: str, base: str, *, device: bool = False) -> NDArray[np.float64]:
        """What ``ratio`` is the median of: one a round that both ran in."""
        both = sorted(self.by_job[job].keys() & self.by_job[base].keys())
        pairs = [(self.by_job[job][number], self.by_job[base][number]) for number in both]
        return np.array([_seconds(a, device) / _seconds(b, device) for a, b in pairs])


def _seconds(sample: Sample, device: bool) -> float:
    return sample.device if device and sample.device is not None else sample.wall


def interval(values: NDArray[np.float64], seed: int = 0) -> Interval:
    """Median of ``values`` [n] with its percentile-bootstrap interval over ``RESAMPLES`` resamples."""
    random = np.random.default_rng(seed)
    picks = random.integers(0, len(values), (RESAMPLES, len(values)))
    medians = np.median(values[picks], axis=1)
    low, high = np.quantile(medians, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Interval(median=float(np.median(values)), low=float(low), high=float(high))


def too_noisy(control: Interval) -> bool:
    """Whether the ratio of a job to its own copy (A/A) says that this machine cannot rank anything now."""
    return control.excludes_one or control.half_width > WIDEST


def too_noisy_among(ratios: NDArray[np.float64], controls: int) -> bool:
    """``too_noisy`` of one of several ``controls``, of which one in twenty excludes 1 on the quietest machine too.

    So that chance calls any of them noisy in at most 1 - CONFIDENCE of all runs, a difference below WIDEST counts where
    the exact sign test finds it at that share of it (Bonferroni).
    """
    control = interval(ratios)
    if control.half_width > WIDEST or not control.excludes_one:
        return control.half_width > WIDEST
    return abs(control.median - 1) > WIDEST or sign_test(ratios) < (1 - CONFIDENCE) / controls


def sign_test(ratios: NDArray[np.float64]) -> float:
    """How likely ratios that are above 1 as often as below it are at least as lopsided as these, both ways."""
    above, below = int((ratios > 1).sum()), int((ratios < 1).sum())
    count = above + below
    tail = sum(math.comb(count, least) for least in range(min(above, below) + 1))
    return min(1.0, 2.0 * tail / 2.0**count)


def measure(
    jobs: Sequence[Job],
    rounds: int,
    *,
    warm_up: int = 5,
    seed: int = 0,
    progress: Callable[[Iterable[int], int], Iterable[int]] | None = None,
) -> Samples:
    """Time ``jobs`` in ``rounds`` rounds after ``warm_up`` untimed runs of each (one, where a job takes few rounds)."""
    for job in jobs:
        for _ in range(warm_up if job.rounds is None else 1):
            job.run()
    random = np.random.default_rng(seed)
    samples = Samples()
    numbers: Iterable[int] = range(rounds)
    for number in numbers if progress is None else progress(numbers, rounds):
        present = [job for job in jobs if job.rounds is None or number < job.rounds]
        for place in random.permutation(len(present)):
            job = present[place]
            started = time.perf_counter()
            device = job.run()
            samples.add(job.name, number, Sample(time.perf_counter() - started, device))
    return samples


def medians(samples: Samples, jobs: Iterable[str]) -> Mapping[str, float]:
    """Median wall seconds of each job."""
    return {job: float(np.median(samples.seconds(job))) for job in jobs}
