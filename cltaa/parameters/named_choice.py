"""A choice: a word of a preset, and what it means."""

from __future__ import annotations

from enum import StrEnum
from typing import Self


class Choice(StrEnum):
    """A value of a parameter that shapes the code; ``meaning`` is empty where the word says it all."""

    meaning: str

    def __new__(cls, word: str, meaning: str = "") -> Self:
        """Make the value that presets call ``word``."""
        value = str.__new__(cls, word)
        value._value_, value.meaning = word, meaning
        return value
