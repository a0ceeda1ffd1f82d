"""Names of sequences: the number in a file's name, and the files that a folder, a pattern or a list stands for.

A frame is ``<name>.<number>.exr`` or ``.png``, with ``.``, ``_``, ``-``, a space or nothing between. After such a
separator ``-`` is a minus: ``shot.-003``, ``shot -003``. In ``shot-003`` it is none, unless ``shot0001`` lies beside
it. Words may follow a number of four digits or more where no file ends with one, or where a pattern shows the number's
place: ``shot.0001.denoised``, ``0001_depth``. They belong to the name.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from glob import has_magic
from os.path import commonpath, realpath
from pathlib import Path
from shlex import quote

from cltaa.errors import DataError, InputMissing, UsageError
from cltaa.printable import counted

SUFFIXES = (".exr", ".png")
# Nine digits fit cltaa:frame, an int. At the beginning of a name ``-`` is a minus, too: ``-0001.exr``.
_NUMBER = r"(?P<name>.*?)(?P<between>[._ ]|(?<=.)-|)(?P<number>(?:(?<![^._ -])-)?(?<![0-9])[0-9]{1,9})"
_WORDS = r"(?:[._ -][^0-9._ ()-]+)"
NUMBERED = re.compile(rf"{_NUMBER}(?P<tail>)\.(?i:exr|png)", re.DOTALL)
_TAILED = re.compile(rf"{_NUMBER}(?P<tail>{_WORDS}+)\.(?i:exr|png)", re.DOTALL)
_PADDED = 4  # least digits of a frame number before words


def real_path(path: Path) -> Path:
    """Return ``path`` without links; a loop of them, where ``Path.resolve`` fails until 3.13, fails on opening."""
    return Path(realpath(path))


def has_suffix(path: Path, *suffixes: str) -> bool:
    """True for a name that ends in one of these, in small letters or in capitals."""
    return path.suffix.lower() in suffixes


def number_of(path: Path) -> int | None:
    """Return the frame number in a file's name, or None where there is none."""
    match = NUMBERED.fullmatch(path.name)
    return int(match["number"]) if match else None


def name_of(path: Path) -> str:
    """Return the name of the sequence that ``path`` belongs to; that of the file if it is not numbered."""
    match = NUMBERED.fullmatch(path.name)
    return match["name"] if match else path.stem


def _name_in(match: re.Match[str]) -> str:
    return match["name"] + match["tail"] if match["name"] else match["tail"][1:]


def renumbered(path: Path, number: int) -> Path:
    """Return the file of frame ``number`` in the sequence of ``path``, which is unchanged if it is not numbered."""
    return _with_number(path, lambda digits: f"{number:0{digits}d}")


def pattern_of(path: Path) -> Path:
    """Return the pattern of all frames of the sequence of ``path``, as a user types it."""
    return _with_number(path, lambda digits: "#" * digits)


def _with_number(path: Path, made: Callable[[int], str]) -> Path:
    """Replace the number of ``path``, if it has one, by what is ``made`` for as many digits."""
    match = NUMBERED.fullmatch(path.name) or _TAILED.fullmatch(path.name)
    if match is None:
        return path
    start, end = match.span("number")
    return path.with_name(f"{path.name[:start]}{made(end - start)}{path.name[end:]}")


_INNER = re.compile(
    rf"(?P<name>.*?)(?P<number>[0-9]{{{_PADDED},9}})(?P<tail>[._ -][A-Za-z].*)(?P<suffix>\.(?i:exr|png))"
)


def _number_last(path: Path) -> Path | None:
    """``path`` with the number last that stands before words which end with another, as in ``x.0001.v2``; else None."""
    match, numbered = _INNER.fullmatch(path.name), NUMBERED.fullmatch(path.name)
    if match is None or numbered is None or numbered["between"]:  # shot0010_a.0001.exr is frame 1 of a shot
        return None
    before = match["name"].rstrip("._ -")
    tail = match["tail"] if before else match["tail"][1:]
    return path.with_name(f"{before}{tail}.{match['number']}{match['suffix']}")


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
        if self.alone and self.files is not None and number_of(self.files[0]) is None:
            return {name_of(self.files[0]): {0: self.files[0]}}
        files = [*files]
        there = [(path, match) for path in files if (match := NUMBERED.fullmatch(path.name))]
        tailed = [(path, match) for path in files if (match := _TAILED.fullmatch(path.name))]
        # Else the others are no frames, such as a denoiser's output beside its input.
        padded = {path for path, match in tailed if not there and len(match["number"].lstrip("-")) >= _PADDED}
        there += [(path, match) for path, match in tailed if path in self.numbers or path in padded]
        # Names as in shot0001, beside which shot-001 is -1.
        joined = {_name_in(match) for _, match in there if not match["between"]}
        found: dict[str, dict[int, Path]] = {}
        for path, match in there:
            number, name = int(match["number"]), _name_in(match)
            if match["between"] == "-" and name in joined:
                number = -number
            number = self.numbers.get(path, number)
            numbers = found.setdefault(name, {})
            if number in numbers:
                what, other = "two files have the same frame number", numbers[number].name
                cure = "move one of the two elsewhere, or name the others by a pattern"
                raise DataError(what, path=path, frame=number, found=other, cure=cure)
            numbers[number] = path
        moved = [_number_last(path) for path, _ in there]
        last = [path for path in moved if path is not None]
        if len(found) > 1 and last == moved and len({name_of(path) for path in last}) == 1:
            what, cure = "the frame number is not last in the name", f"rename the files, as {last[0].name}"
            raise DataError(what, path=self.folder, found=there[0][0].name, cure=cure)
        return found


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
        cure = f"name the folder that its frames are in: {quote(str(path.parent))}" if above else "check the name"
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
            if not re.fullmatch(rf"{_WORDS}*\.[A-Za-z]+", text[place:]):
                words, suffix = text[place:].rpartition(".")[::2]
                before = text[: part.start()].rstrip("._ -")
                last = f"{before}{words if before else words.lstrip('._ -')}.{part['number']}.{suffix}"
                what, cure = "only words may follow the number of a frame", f"rename the files, as {last}"
                raise UsageError(what, path=path, expected="<name>.####.exr or <name>.####.<word>.exr", cure=cure)
            made += rf"(?P<number>(?=[-0-9]{{{_width(part['digits'])},}})-?[0-9]{{1,9}})"
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
