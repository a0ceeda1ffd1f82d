"""Names of sequences: the number in a file's name, and the files that a folder, a pattern or a list stands for.

A frame is ``<name>.<number>.exr`` or ``.png``, with ``.``, ``_``, ``-``, a space or nothing between. After such a
separator ``-`` is a minus: ``shot.-003``, ``shot -003``. In ``shot-003`` it is none, unless ``shot0001`` lies beside
it. Words may follow a number of four digits or more where no file ends with one: ``shot.0001.denoised``,
``0001_1920x1080``. Anything may where a pattern shows the number's place, or where it alone varies: ``shot.0001.v2``;
and so do brackets, ``shot (1)``. What follows belongs to the name.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from glob import has_magic
from os.path import commonpath, realpath
from pathlib import Path
from typing import NamedTuple

from cltaa.errors import DataError, InputMissing, UsageError
from cltaa.printable import counted, shell_word

SUFFIXES = (".exr", ".png")
# Nine digits fit cltaa:frame, an int. At the beginning of a name ``-`` is a minus, too: ``-0001.exr``.
_NUMBER = re.compile(
    r"(?P<between>[._ ]|(?<=.)-|)(?P<digits>(?:(?<![^._ -])-)?(?<![0-9])(?<![0-9]{3}x)[0-9]{1,9})(?![0-9])", re.DOTALL
)
_WORDS = r"(?:[._ -](?:[^0-9._ ()-]+|[0-9]{3,}x[0-9]{3,}))"  # a size in pixels is a word, too
_PADDED = 4  # least digits of a frame number before words, its sign included


class Numbered(NamedTuple):
    """A number in the name of a file, with the text around it."""

    before: str
    between: str
    digits: str
    tail: str

    @property
    def name(self) -> str:
        """The name of its sequence."""
        return self.before + self.tail if self.before else self.tail[1:]

    @property
    def value(self) -> int:
        """The number, with its sign."""
        return int(self.digits)

    @property
    def worded(self) -> bool:
        """True if only words follow, or nothing."""
        return re.fullmatch(f"{_WORDS}*", self.tail) is not None

    @property
    def padded(self) -> bool:
        """True for as many digits as a frame number has that words follow."""
        return len(self.digits) >= _PADDED

    @property
    def in_brackets(self) -> bool:
        """True for a number as Windows gives it to several files that are renamed at once: ``frame (1)``."""
        return self.before.endswith(" (") and self.tail == ")"


def _numbers_in(path: Path) -> list[Numbered]:
    """Return every number in the name of an EXR or a PNG, the last one first."""
    text, found = path.stem, _NUMBER.finditer(path.stem) if has_suffix(path, *SUFFIXES) else ()
    return [Numbered(text[: its.start()], its[1], its[2], text[its.end() :]) for its in found][::-1]


def _number_in(path: Path, number: int | None = None) -> Numbered | None:
    """Return the place of ``number`` in a name; by default of the one that ends it, or before words."""
    found = _numbers_in(path)
    if number is None:
        return next((its for its in found if its.worded), None)
    return max((its for its in found if abs(its.value) == abs(number)), key=lambda its: len(its.digits), default=None)


def real_path(path: Path) -> Path:
    """Return ``path`` without links; a loop of them, where ``Path.resolve`` fails until 3.13, fails on opening."""
    return Path(realpath(path))


def leads_nowhere(path: Path) -> bool:
    """True for a link to a missing file."""
    try:
        path.stat()
    except FileNotFoundError:
        return True
    except OSError:  # which opening it reports
        pass
    return False


def has_suffix(path: Path, *suffixes: str) -> bool:
    """True for a name that ends in one of these, in small letters or in capitals."""
    return path.suffix.lower() in suffixes


def _last_in(path: Path) -> Numbered | None:
    return next((its for its in _numbers_in(path) if not its.tail), None)


def number_of(path: Path) -> int | None:
    """Return the frame number in a file's name, or None where there is none."""
    its = _last_in(path)
    return its.value if its else None


def numbers_of(path: Path) -> list[int]:
    """Return the numbers in a file's name that its folder may take for the frame's: the last, else each long one."""
    its = number_of(path)
    return [its] if its is not None else [one.value for one in _numbers_in(path) if one.padded]


def shows_number(path: Path, number: int) -> bool:
    """True if ``number`` stands anywhere in a file's name."""
    return _number_in(path, number) is not None


def name_of(path: Path) -> str:
    """Return the name of the sequence that ``path`` belongs to; that of the file if it is not numbered."""
    its = _last_in(path)
    return its.name if its else path.stem


def renumbered(path: Path, number: int, its: int | None = None) -> Path:
    """Return the file of frame ``number`` in the sequence of ``path``, ``its`` being its own, if known; ``path`` itself
    if it is not numbered."""
    return _with_number(path, its, lambda digits: f"{number:0{digits}d}")


def pattern_of(path: Path, its: int | None = None) -> Path:
    """Return the pattern of all frames of the sequence of ``path``, as a user types it; ``its`` is its own number."""
    return _with_number(path, its, lambda digits: "#" * digits)


def _with_number(path: Path, its: int | None, made: Callable[[int], str]) -> Path:
    """Replace the number of ``path``, if it has one, by what is ``made`` for as many digits."""
    found = _number_in(path, its)
    if found is None:
        return path
    return path.with_name(f"{found.before}{found.between}{made(len(found.digits))}{found.tail}{path.suffix}")


_COPY = re.compile(r"(?:~[0-9]*~?|(?: -)?(?i: copy)(?: \(?[0-9]+\)?)?| \([0-9]+\))$")


def without_copies(files: Sequence[Path]) -> list[Path]:
    """Return ``files`` without those that an editor or a file manager made of another one: ``s.0001~``, ``s.0001 (1)``,
    ``s.0001 - Copy``."""
    names, ends = {path.stem for path in files}, {path: _COPY.search(path.stem) for path in files}
    return [path for path, end in ends.items() if not (end and path.stem[: end.start()] in names)]


def _varying(paths: Collection[Path]) -> dict[Path, Numbered]:
    """Return the one padded number of each name in which others differ from it; empty unless each has such a one."""
    alike: dict[tuple[str, str], dict[Path, Numbered]] = {}
    for path in paths:
        for its in _numbers_in(path):
            if its.padded:
                alike.setdefault((its.before, its.tail), {})[path] = its
    several = [(path, its) for group in alike.values() if len(group) > 1 for path, its in group.items()]
    found = dict(several)
    return found if len(found) == len(several) == len(paths) else {}


@dataclass(frozen=True, slots=True)
class Selection:
    """What a user named as a sequence: a folder, or some of the files in it."""

    folder: Path
    files: tuple[Path, ...] | None = None  # None: all that are in the folder
    words: tuple[str, ...] = ()  # as the user typed them
    numbers: Mapping[Path, int] = field(default_factory=dict)  # from a pattern

    def __str__(self) -> str:
        """Return the name as the user typed it, for a message."""
        return self.words[0] if len(self.words) == 1 else f"{self.folder}: {counted(len(self.words), 'file')}"

    @property
    def alone(self) -> bool:
        """True for a single file that was named itself, which need not be numbered."""
        return self.files is not None and len(self.files) == 1 and self.words == (str(self.files[0]),)

    def by_name(self, files: Iterable[Path]) -> dict[str, dict[int, Path]]:
        """Return those of ``files``, of one folder, that have a number, by the names of their sequences; raises
        DataError for two of one number, and for a number that does not stand last."""
        if self.alone and self.files is not None and not self._places(self.files):
            return {name_of(self.files[0]): {0: self.files[0]}}
        there = self._places(without_copies([*files]))
        # Names as in shot0001, beside which shot-001 is -1.
        joined = {its.name for its in there.values() if not its.between}
        found: dict[str, dict[int, Path]] = {}
        for path, its in there.items():
            number = -its.value if its.between == "-" and its.name in joined else its.value
            number = self.numbers.get(path, number)
            numbers = found.setdefault(its.name, {})
            if number in numbers:
                what, other = "two files have the same frame number", numbers[number].name
                cure = "move one of the two elsewhere, or name the others by a pattern"
                raise DataError(what, path=path, frame=number, found=other, cure=cure)
            numbers[number] = path
        return found

    def _places(self, files: Sequence[Path]) -> dict[Path, Numbered]:
        """Return where the names of those of ``files`` that are frames hold their numbers."""
        there = {path: its for path in files if (its := _last_in(path))}
        if not there:  # else the others are no frames, such as a denoiser's output beside its input
            worded = {path: its for path in files if (its := _number_in(path))}
            in_brackets = {path: its for path in files for its in _numbers_in(path) if its.in_brackets}
            there = {path: its for path, its in worded.items() if its.padded}
            there = there or (in_brackets if len(in_brackets) == len(files) > 1 else {})
        shot = any(its.between and not its.tail for its in there.values())  # shot0010_a.0001.exr is frame 1 of a shot
        if not shot and len({its.name for its in there.values()}) == len(there) != 1:
            there = _varying(there or files) or there
        shown = ((path, self.numbers[path]) for path in files if path in self.numbers)
        return there | {path: its for path, number in shown if (its := _number_in(path, number))}


Named = str | Path | Sequence[str | Path] | Selection  # a folder, a file, a pattern of files, or several of these


def selection_of(named: Named) -> Selection:
    """Find what ``named`` stands for: folder, file, pattern (``####``, ``%04d``, ``$F4``, ``*``) or list of files.

    An existing path of that very name takes precedence over a pattern. A name of nothing is a missing folder. Raises
    InputMissing for a missing file and a pattern that none matches, and UsageError for a list that is empty or holds
    folders.
    """
    if isinstance(named, Selection):
        return named
    if named == "":  # pathlib takes it for the working folder
        raise UsageError("no sequence is named", found="an empty name")
    if isinstance(named, str | Path):
        return _place(Path(named))
    words = [*named] if isinstance(named, Iterable) else [named]
    if not all(isinstance(one, str | Path) for one in words) or "" in words:
        expected = "a folder, a file, a pattern or a list of files"
        raise UsageError("no sequence is named", expected=expected, found=repr(named))
    places = [_place(Path(one)) for one in words]
    if not places:
        raise UsageError("no file is named")
    if len(places) == 1:
        return places[0]
    for place in places:
        if place.files is None:
            what = "a list of files names something else" if place.folder.is_dir() else "the file is missing"
            raise UsageError(what, path=place.folder, expected="EXR files of one sequence, or one folder")
    files = dict.fromkeys(path for place in places for path in place.files or ())
    numbers = {path: number for place in places for path, number in place.numbers.items()}
    return Selection(_above(files), tuple(files), tuple(word for place in places for word in place.words), numbers)


def _place(path: Path) -> Selection:
    words = (str(path),)
    if "\0" in words[0]:
        raise UsageError("no file has a NUL in its name", path=path)
    if path.is_dir():
        return Selection(path, None, words)
    if path.exists() or path.is_symlink():
        return Selection(path.parent, (path,), words)
    if not has_magic(str(path)) and not COUNTED.search(path.name):
        if has_suffix(path, *SUFFIXES):
            raise InputMissing("the file is missing", path=path, cure="check the name")
        return Selection(path, None, words)
    folders = _folders(path.parent)
    pattern, asked = _pattern(path), _asked_for(path.name)
    found: dict[Path, int | None] = {}
    for folder in folders:
        there = sorted(folder.iterdir()) if folder.is_dir() else []
        for file in (file for file in there if has_suffix(file, *SUFFIXES) and file.name[0] != "."):
            if match := pattern.fullmatch(file.name):
                number = int(match["number"]) if pattern.groups else None
                if asked is None or number in asked:
                    found[file] = number
    if not found:
        above = path.parent.is_dir()
        cure = f"name the folder that its frames are in: {shell_word(path.parent)}" if above else "check the name"
        raise InputMissing("no file has such a name", path=path, cure=cure)
    # Pictures to look at may lie beside the frames.
    kept = [file for file in found if has_suffix(file, ".exr")] or [*found]
    numbers = {file: number for file in kept if (number := found[file]) is not None}
    return Selection(_above(kept), tuple(kept), words, numbers)


def _folders(named: Path) -> list[Path]:
    """Return the folders that ``named`` stands for; an existing one of that very name is no pattern."""
    if not has_magic(str(named)) or named.is_dir():
        return [named]
    return [found for above in _folders(named.parent) for found in sorted(_within(above, named.name)) if found.is_dir()]


def _within(folder: Path, name: str) -> Iterable[Path]:
    name = name if name == "**" else re.sub(r"\*+", "*", name)  # pathlib takes ** for any depth
    return folder.glob(name) if has_magic(name) and not (folder / name).is_dir() else [folder / name]


def _above(files: Iterable[Path]) -> Path:
    """Return the folder that all files lie in, or the one above all of their folders."""
    folders = {path.parent for path in files}
    return folders.pop() if len(folders) == 1 else Path(commonpath(folder.absolute() for folder in folders))


# The number of a frame as compositors write it: ``####``, ``%04d``, ``$F4`` or ``<F4>``, and before the suffix
# ``@@@@``; before it the requested frames, as ``1-10#`` or ``1-10x3#``.
COUNTED = re.compile(
    r"(?:(?P<first>-?[0-9]{1,9})-(?P<last>-?[0-9]{1,9})(?:x(?P<step>[1-9][0-9]{0,8}))?)?"
    rf"(?P<digits>#+|%(?:0?[1-9])?d|\$F[1-9]?|\$\{{F[1-9]?\}}|<F[1-9]?>|@+(?={_WORDS}*\.[A-Za-z]+$))"
)
_PARTS = re.compile(rf"(?P<number>{COUNTED.pattern})|(?P<any>\*+)|(?P<one>\?)|(?P<set>\[!?[^]]+\])")


def _pattern(path: Path) -> re.Pattern[str]:
    """Return the expression of a pattern of names, with group ``number`` where it shows the number's place."""
    text, made, place = path.name, "", 0
    if len([*COUNTED.finditer(text)]) > 1:
        raise UsageError("only one place in a name is the number of a frame", path=path, expected="<name>.####.exr")
    for part in _PARTS.finditer(text):
        made += re.escape(text[place : part.start()])
        place = part.end()
        if part["number"]:
            made += rf"(?P<number>(?=[-0-9]{{{_width(part['digits'])},}})-?[0-9]{{1,9}}(?![0-9]))"
        else:
            made += ".*" if part["any"] else "." if part["one"] else part["set"].replace("[!", "[^")
    try:
        return re.compile(made + re.escape(text[place:]), re.DOTALL)
    except re.error as error:
        raise UsageError(f"no such pattern of names: {error}", path=path) from None


def _width(digits: str) -> int:
    """Return the least number of characters of a frame number, its sign included."""
    return len(digits) if digits[0] in "#@" else int(digits.strip("%d$F{}<>") or 1)


def _asked_for(name: str) -> range | None:
    """Return the frames that a pattern requests before the place of their numbers; None for all."""
    part = COUNTED.search(name)
    if part is None or part["first"] is None:
        return None
    return range(int(part["first"]), int(part["last"]) + 1, int(part["step"] or 1))
