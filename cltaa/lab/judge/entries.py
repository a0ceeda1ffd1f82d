"""Entries of a leaderboard: what a resolve made of the standard sequences, one folder a sequence, judged together."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from cltaa.errors import DataError, InputMissing, UsageError
from cltaa.io.names import number_of
from cltaa.io.numbered import FrameRange, OnBreak, missing_from, ranges
from cltaa.lab.judge.comparison import Comparison, pair_up
from cltaa.printable import counted

FACTS = "entry.toml"
SUFFIXES = (".exr", ".png")


class Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an entry says of itself, all of it optional."""

    name: str = ""
    version: str = ""
    settings: str = ""
    device: str = ""
    milliseconds: float | None = None  # of a frame


@dataclass(frozen=True, slots=True)
class Entry:
    """One row of the table: its name, what it says of itself, and its folder of each sequence, by name."""

    name: str
    facts: Facts
    folders: Mapping[str, Path]


@dataclass(frozen=True, slots=True)
class Round:
    """A sequence and what each entry that has it made of it, all of the same frames."""

    sequence: Path
    entries: list[Entry]
    comparisons: list[Comparison]
    numbers: list[int] = field(default_factory=list)

    @property
    def in_time(self) -> bool:
        """Whether all frames follow each other, so that they can be judged as moving pictures."""
        capture = self.comparisons[0].capture
        return capture is not None and len(self.numbers) > 1 and not missing_from(self.numbers, capture.step)


def is_sequence(folder: Path) -> bool:
    """Whether a folder is a captured sequence with its truth."""
    return (folder / "reference").is_dir()


def divided(paths: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """The folders of entries and of sequences; raises UsageError where one kind is missing or a sequence is twice."""
    sequences = [path for path in paths if is_sequence(path)]
    if not sequences:
        raise UsageError(
            "--table: no captured sequence among the folders",
            expected="ENTRY... SEQUENCE..., a SEQUENCE with its truth in reference/",
            cure="make one: cltaa capture corridor -o corridor --size 320x180 --jitter halton:8 --reference 64",
        )
    names = [sequence.resolve().name for sequence in sequences]
    if twice := [name for name in names if names.count(name) > 1]:
        raise UsageError(f"--table: two sequences are called {twice[0]}", cure="name their folders apart")
    return [path for path in paths if path not in sequences], sequences


def read_entry(folder: Path, sequences: Sequence[Path]) -> Entry:
    """The entry in a folder: a folder of frames a sequence, or, of one sequence, the frames themselves.

    Raises InputMissing where it has none of the sequences, DataError for a damaged ``entry.toml``.
    """
    if not folder.is_dir():
        raise InputMissing("no such folder", path=folder)
    names = [sequence.resolve().name for sequence in sequences]
    folders = {name: folder / name for name in names if (folder / name).is_dir()}
    if not folders and len(sequences) == 1 and numbered(folder):
        folders = {names[0]: folder}
    if not folders:
        raise InputMissing("an entry of none of the sequences", path=folder, expected=f"folders {', '.join(names)}")
    facts = read_facts(folder / FACTS)
    return Entry(facts.name or folder.resolve().name, facts, folders)


def read_facts(path: Path) -> Facts:
    """What an entry says of itself; nothing where there is no such file. Raises DataError for one that is wrong."""
    try:
        return msgspec.convert(tomllib.loads(path.read_text(encoding="utf-8")), Facts)
    except FileNotFoundError:
        return Facts()
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, msgspec.ValidationError) as error:
        expected = ", ".join(Facts.__struct_fields__)
        raise DataError(f"no facts of an entry: {error}".replace("`$.", "`"), path=path, expected=expected) from None


def numbered(folder: Path) -> dict[int, Path]:
    """The frames in a folder by number."""
    files = (path for path in sorted(folder.iterdir()) if path.suffix in SUFFIXES)
    return {number: path for path in files if (number := number_of(path)) is not None}


@contextmanager
def resolved_by_us(presets: Sequence[str], sequences: Sequence[Path]) -> Iterator[list[Entry]]:
    """Entries of our own presets, told nothing of the effects, in a folder that is gone when the block ends."""
    from cltaa.pipeline.folder import resolve_folder

    with TemporaryDirectory(prefix="cltaa-table-") as folder:
        entries = []
        for preset in presets:
            folders = {
                sequence.resolve().name: Path(folder) / preset / sequence.resolve().name for sequence in sequences
            }
            for sequence, output in zip(sequences, folders.values(), strict=True):
                resolve_folder(sequence, output, preset, effects="find", layers=())
            entries.append(Entry(preset, Facts(settings="nothing declared"), folders))
        yield entries


def rounds(
    entries: Sequence[Entry], sequences: Sequence[Path], frames: int | FrameRange | None = None, **reading: Any
) -> list[Round]:
    """Each sequence with the entries that have it, paired over the frames that all have: of the range ``frames``, or
    the first so many.

    Raises InputMissing where they have none in common, and what ``pair_up`` does.
    """
    found = []
    for sequence in sequences:
        name = sequence.resolve().name
        there = [entry for entry in entries if name in entry.folders]
        files = [numbered(entry.folders[name]) for entry in there]
        shared = set(numbered(sequence / "reference")).intersection(*files)
        numbers = sorted(shared)
        if isinstance(frames, int):
            numbers = numbers[:frames]
        elif frames is not None:
            numbers = [number for number in numbers if frames[0] <= number <= frames[1]]
        if not numbers:
            have = "; ".join(f"{entry.name} {ranges(sorted(one))}" for entry, one in zip(there, files, strict=True))
            raise InputMissing(f"the entries of {name} have no frame in common", path=sequence, found=have or "none")
        tests = [tuple(one[number] for number in numbers) for one in files]
        # A list of one file would be a picture that is named itself.
        paired = pair_up(
            [test if len(test) > 1 else test[0].parent for test in tests], sequence, gaps=OnBreak.RESET, **reading
        )
        found.append(Round(sequence, there, paired, numbers))
    return found


def lacking(round_: Round) -> str:
    """Which frames of the truth are not judged; empty where all are."""
    left = len(numbered(round_.sequence / "reference")) - len(round_.numbers)
    return f"{round_.sequence.name}: {counted(left, 'frame')} that not all have" if left else ""
