"""What numbers of frames say of how far they lie apart."""

from __future__ import annotations

from pathlib import Path

from cltaa.io.numbered import OnBreak, check_steps, even_step, missing_from


def test_an_even_step_is_that_of_most() -> None:
    for numbers, apart in [
        ([0, 7, 14, 21], 7),
        ([3, 5, 7, 11, 13], 2),  # one is missing
        ([0, 2, 4, 8, 12], 1),  # as many lie twice as far apart
        ([3, 10], 1),  # two say nothing
        ([5], 1),
        ([0, 2, 5, 7], 1),
    ]:
        assert even_step(numbers) == apart, numbers


def test_numbers_that_are_missing() -> None:
    assert missing_from([2, 4, 10], 2) == [6, 8]
    assert missing_from([2, 3], 1) == []


def test_frames_outside_of_a_range_may_lie_between_its_steps() -> None:
    check_steps({number: Path(f"a.{number}.exr") for number in (0, 1, 3, 5, 8)}, (1, 5), 2, OnBreak.ERROR)
