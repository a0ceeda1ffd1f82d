"""What is wrong with single frames of a sequence, as lines for a reader: the same in many frames is one line."""

from __future__ import annotations

from cltaa.errors import CltaaError
from cltaa.sequences.frame_numbers import named_frames


class Problems:
    """Errors by what is wrong; each is told in the words of the first frame that has it."""

    def __init__(self) -> None:
        """Nothing is wrong yet."""
        self._wrong: dict[object, tuple[str, list[int]]] = {}

    def add(self, number: int, error: CltaaError) -> None:
        """Take an error of frame ``number``; another one of the same frame and kind counts for nothing."""
        kind = error.what, error.channel, str(error.expected), str(error.found)
        numbers = self._wrong.setdefault(kind, (str(error), []))[1]
        if number not in numbers:
            numbers.append(number)

    @property
    def numbers(self) -> list[int]:
        """The frames that something is wrong with, in order."""
        return sorted({number for _, numbers in self._wrong.values() for number in numbers})

    @property
    def lines(self) -> list[str]:
        """A line for each kind of error, in the order in which they were met."""
        return [_with_others(text, numbers[1:]) for text, numbers in self._wrong.values()]


def _with_others(problem: str, others: list[int]) -> str:
    same = f"the same in {named_frames(sorted(others))}"
    return f"{problem}; {same}" if others else problem
