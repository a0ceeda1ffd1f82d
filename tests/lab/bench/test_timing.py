"""The statistics of timing, on made-up times whose answer is known; what is kept beside the numbers."""

from __future__ import annotations

import time
from types import SimpleNamespace

import numpy as np
import pytest

from cltaa import __version__
from cltaa.core.build import Build, code_sha256
from cltaa.lab import timing as module
from cltaa.lab.bench.accuracy.measurement import CONTROL, ranking
from cltaa.lab.timing import (
    FEWEST_RUNS,
    MOST_RUNS,
    WIDEST,
    Clock,
    Interval,
    Job,
    Sample,
    Samples,
    environment,
    interval,
    measure,
    sign_test,
    too_noisy,
    too_noisy_among,
)


def paired(load: np.ndarray, slower: float, noise: float = 0.0) -> Samples:
    """Two jobs under one load that comes and goes; b takes ``slower`` times as long as a."""
    random = np.random.default_rng(1)
    samples = Samples()
    for now in load:
        a, b = 1 + noise * random.standard_normal(2)
        samples.add("a", Sample(now * a, device=now * a / 2))
        samples.add("b", Sample(now * slower * b, device=now * slower * b / 2))
    return samples


def test_load_that_both_share_leaves_the_ratio_alone() -> None:
    load = np.random.default_rng(0).choice([1.0, 2.1, 3.7], 31)
    ratio = paired(load, 1.5).ratio("b", "a", Clock.WALL)
    assert (ratio.low, ratio.median, ratio.high) == pytest.approx((1.5, 1.5, 1.5))
    assert paired(load, 1.5).interval("a", Clock.WALL).half_width > 0.1  # what unpaired times would have said


def test_interval_holds_the_truth_about_as_often_as_it_says() -> None:
    # 95 % of 400 is 380; the percentile bootstrap of a median of 31 is known to be a little conservative or liberal.
    held = 0
    for seed in range(400):
        found = interval(np.random.default_rng(seed).normal(5.0, 1.0, 31))
        held += found.low <= 5.0 <= found.high
    assert 365 <= held <= 398  # seen: 374


@pytest.mark.parametrize(
    ("control", "noisy"),
    [
        (Interval(median=1.0, low=0.99, high=1.01), False),
        (Interval(median=1.01, low=1.001, high=1.02), True),  # a copy that differs from itself
        (Interval(median=1.0, low=1 - 1.2 * WIDEST, high=1 + 1.2 * WIDEST), True),  # too wide
    ],
)
def test_a_copy_tells_when_nothing_can_be_ranked(control: Interval, noisy: bool) -> None:
    assert too_noisy(control) is noisy


def test_one_of_many_copies_may_differ_by_chance() -> None:
    # Of 330 controls without any fault one in twenty would exclude 1; of the ten times 33, at most one in twenty may.
    controls = [np.random.default_rng(seed).normal(1.0, 0.005, 21) for seed in range(330)]
    assert sum(too_noisy(interval(ratios)) for ratios in controls) == 25
    assert not any(too_noisy_among(ratios, 33) for ratios in controls)
    off = np.random.default_rng(0).normal(1.01, 0.005, 21)  # what takes longer than itself is found among as many
    assert too_noisy_among(off, 33)
    assert too_noisy_among(np.random.default_rng(0).normal(1.0, 0.1, 21), 33)  # and what is all over the place
    assert too_noisy_among(np.array([1.04, 1.041, 1.042]), 33)  # and what too few rounds are no proof of, but is large


def test_the_sign_test_gives_its_binomial_chances() -> None:
    assert sign_test(np.array([1.1] * 5)) == pytest.approx(2 / 2**5)
    assert sign_test(np.array([0.9, 1.1, 1.1, 1.0])) == pytest.approx(2 * (1 + 3) / 2**3)  # a tie is on neither side
    assert sign_test(np.array([0.9, 1.1])) == 1.0


def test_every_round_runs_every_job_once_in_an_order_of_its_own() -> None:
    ran: list[str] = []
    jobs = {name: lambda name=name: ran.append(name) for name in "abc"}
    samples = measure(jobs, 8, warm_up=3)
    assert ran[:9] == ["a"] * 3 + ["b"] * 3 + ["c"] * 3
    rounds = [tuple(ran[at : at + 3]) for at in range(9, len(ran), 3)]
    assert [sorted(names) for names in rounds] == [["a", "b", "c"]] * 8
    assert len(set(rounds)) > 1
    assert len(samples.by_job["a"]) == 8


def test_a_turn_is_as_many_runs_as_fill_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[str] = []
    now = [0.0]  # a clock that nothing else on the machine moves
    moving, still = dict.fromkeys(("perf_counter", "monotonic"), lambda: now[0]), ("process_time", "thread_time")
    clock = SimpleNamespace(**moving, **dict.fromkeys(still, lambda: 0.0))
    monkeypatch.setattr("cltaa.lab.timing.time", clock)

    def lasting(name: str, seconds: float) -> Job:
        def run() -> None:
            ran.append(name)
            now[0] += seconds

        return run

    lengths = {"short": 0.001, "medium": 0.06, "long": 0.25}
    measure({name: lasting(name, seconds) for name, seconds in lengths.items()}, 3, warm_up=3, turn=0.05)
    assert ran.count("short") == 3 + 3 * MOST_RUNS
    assert ran.count("medium") == 3 + 3 * FEWEST_RUNS
    assert ran.count("long") == 1 + 3


def test_sleeping_takes_time_and_is_no_work() -> None:
    samples = measure({"sleep": lambda: time.sleep(0.06)}, 3)
    assert samples.seconds("sleep", Clock.WALL).min() >= 0.06
    assert samples.seconds("sleep", Clock.PROCESSOR).min() < 0.03  # seen: 0.0003


def test_a_turn_keeps_its_least(monkeypatch: pytest.MonkeyPatch) -> None:
    worked = [0.0]
    still = dict.fromkeys(("perf_counter", "monotonic", "thread_time"), lambda: 0.0)
    monkeypatch.setattr("cltaa.lab.timing.time", SimpleNamespace(process_time=lambda: worked[0], **still))
    spent = iter([0.003, 0.003, 0.001, 0.002, 0.003, 0.002])

    def run() -> float:
        seconds = next(spent)
        worked[0] += 2 * seconds
        return seconds

    (sample,) = measure({"a": run}, 1, warm_up=1, turn=1.0).by_job["a"]
    assert sample.device == 0.001
    assert sample.processor == pytest.approx(0.002)


@pytest.mark.parametrize(("by_device", "seconds"), [(True, 0.5), (False, 2.5)])
def test_processor_time_beside_a_device_is_its_threads_alone(
    monkeypatch: pytest.MonkeyPatch, by_device: bool, seconds: float
) -> None:
    worked = {"host": 0.0, "kernels": 0.0}
    clock = SimpleNamespace(
        perf_counter=lambda: 0.0,
        monotonic=lambda: 0.0,
        process_time=lambda: sum(worked.values()),
        thread_time=lambda: worked["host"],
    )
    monkeypatch.setattr("cltaa.lab.timing.time", clock)

    def run() -> float | None:
        worked["host"] += 2.0
        worked["kernels"] += 0.5
        return 0.7 if by_device else None

    (sample,) = measure({"a": run}, 1, warm_up=1).by_job["a"]
    assert sample.processor == seconds


def test_more_rounds_follow_until_there_are_enough() -> None:
    jobs: dict[str, Job] = {"a": lambda: None}
    enough = measure(jobs, 3, enough=lambda found: len(found.by_job["a"]) >= 7, patience=60.0)
    assert len(enough.by_job["a"]) == 7
    never = measure(jobs, 3, enough=lambda _: False, patience=0.0)
    assert len(never.by_job["a"]) == 3


@pytest.mark.parametrize(
    ("device", "processor", "is_cpu", "units", "expected"),
    [
        (0.005, 0.2, True, 2, (Clock.DEVICE, False)),
        (0.2, 0.005, True, 2, (Clock.PROCESSOR, False)),
        (0.2, 0.005, False, 1, (Clock.DEVICE, True)),  # a GPU does not work by the processor's time
        (0.2, 0.3, True, 2, (Clock.DEVICE, True)),
        # of one thread, whose long kernels another process holds up and its short ones does not
        (0.005, 0.005, True, 1, (Clock.PROCESSOR, False)),
        (0.005, 0.2, True, 1, (Clock.DEVICE, False)),
    ],
)
def test_processor_time_ranks_where_the_device_cannot(
    device: float, processor: float, is_cpu: bool, units: int, expected: tuple[Clock, bool]
) -> None:
    random, samples = np.random.default_rng(0), Samples()
    for _ in range(21):
        for name in ("default", f"default {CONTROL}"):
            one, other = 1 + random.standard_normal(2) * [device, processor]
            samples.add(name, Sample(1.0, device=abs(one), processor=abs(other)))
    found = ranking(samples, "default", 33, is_cpu=is_cpu, units=units)
    assert (found.clock, found.noisy) == expected


def test_device_times_are_used_where_there_are_any() -> None:
    samples = paired(np.ones(4), 3.0)
    assert samples.interval("b", Clock.WALL).median == 3.0
    assert samples.interval("b", Clock.DEVICE).median == 1.5
    assert samples.has("b", Clock.DEVICE)
    samples.add("shader", Sample(1.0))
    assert not samples.has("shader", Clock.DEVICE)


def test_it_says_what_the_numbers_depend_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cltaa.lab.timing.cpu_flags", lambda: {"sve", "avx2", "hypervisor"})
    found = environment("a device", 1.25)
    assert found.cpu_flags == ["avx2", "sve"]
    assert (found.device, found.load_before, found.options) == ("a device", 1.25, [*Build().flags()])
    assert found.cores >= 1
    assert found.cpu
    assert found.kernels_sha256 == code_sha256()


def test_a_checkout_that_is_not_installed_knows_its_version(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def version(name: str) -> str:
        asked.append(name)
        return "1"

    monkeypatch.setattr(module, "version", version)
    found = environment("d", 0.0).libraries
    assert found == {"cltaa": __version__} | dict.fromkeys(module.LIBRARIES, "1")
    assert "cltaa" not in asked
