"""What an accuracy measurement holds: the numbers that the report and the tables are drawn from."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from cltaa.lab.bench.accuracy.ladder import Variant
from cltaa.lab.bench.accuracy.tasks import Rounding
from cltaa.lab.judge.metrics import mean
from cltaa.lab.timing import Clock, Environment, Interval


class Spread(msgspec.Struct, frozen=True, kw_only=True):
    """An error over the frames of a sequence; the PSNR of an identical frame is infinite, in JSON null."""

    mean: float
    p5: float
    p95: float
    largest: float
    frames: list[float]


class Cell(msgspec.Struct, frozen=True, kw_only=True):
    """One variant over one sequence. Times are milliseconds a megapixel, of the kernels alone."""

    variant: str
    errors: dict[str, Spread]
    rounding: Rounding | None
    wall: Interval
    device: Interval | None
    least: float  # the least wall time
    ratio: Interval  # of time to the default's, paired, by the clock that the sequence is ranked by
    dominated_by: dict[str, str]  # metric: a variant with no more error that is faster beyond chance
    processor: Interval | None = None  # on a CPU: of all threads that run kernels together

    def time(self, clock: Clock) -> Interval:
        """The time by a clock, by the host's where that has none."""
        found: Interval | None = getattr(self, clock)
        return self.wall if found is None else found


class Yardstick(msgspec.Struct, frozen=True, kw_only=True):
    """Supersampling: ``added`` is what drawing cost beyond one sample a pixel, milliseconds a megapixel."""

    samples: int
    seconds: float | None  # a frame
    added: float | None
    errors: dict[str, Spread]


class MeasuredSequence(msgspec.Struct, frozen=True, kw_only=True):
    """Everything about one sequence."""

    name: str
    folder: str
    frames: list[int]
    width: int
    height: int
    effects: str
    cells: list[Cell]
    yardstick: list[Yardstick]
    noisy: bool
    control: Interval  # the default against its own copy, by the clock
    floor: float  # milliseconds a megapixel: the default's least bytes at the bandwidth of a copy
    truth_noise: float | None  # mean squared error of the truth itself, by its samples: nothing can be seen below it
    mean_noise: float | None  # mean squared error that an exponential mean of independent samples ends with
    stages: dict[str, float]  # milliseconds a megapixel of the default's steps, medians
    clock: Clock = Clock.DEVICE  # that times are ranked by
    rounds: int = 0  # of timing, as many as it took
    timed_pixels: int = 0  # of the enlarged frame
    profile: str = ""  # that another tool's files were read by


class Accuracy(msgspec.Struct, frozen=True, kw_only=True):
    """The whole measurement; what the report is drawn from."""

    environment: Environment
    metrics: list[str]
    rounds: int
    variants: list[Variant]
    sequences: list[MeasuredSequence]


def exponential_noise(one_sample: float, weight: float) -> float:
    """Mean squared error that m <- m + ``weight`` (x - m) ends with, where one sample x has ``one_sample``.

    The variance of a geometric sum of independent samples: weight^2 sum (1 - weight)^2k = weight / (2 - weight). A mean
    whose samples are spread evenly over the pixel, or one that counts, may be better; this one never is.
    """
    return one_sample * weight / (2.0 - weight)


def spread(metric: str, values: Sequence[float]) -> Spread:
    """Mean (as ``cltaa compare`` takes it), 5th and 95th percentile and largest of an error over the frames."""
    # Of the values themselves: between two PSNR one of which is infinite there is none.
    p5, p95 = np.percentile(values, [5, 95], method="nearest")
    middle = mean({metric: value} for value in values)[metric]
    return Spread(mean=middle, p5=float(p5), p95=float(p95), largest=max(values), frames=list(values))
