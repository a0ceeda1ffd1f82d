"""Every error that cltaa raises on purpose, and the exit code each one means.

CltaaError                 base; the command line catches this class, once
├── UsageError        64   an option, a name or a combination that means nothing (click's own usage errors exit with 2)
├── DataError         65   a file was read but its content is wrong (truncated, mistyped, NaN matrices ...)
├── InputMissing      66   a file, frame or folder that should be there is not
├── DeviceMissing     69   no OpenCL device (or no off-screen OpenGL) can be used here
├── InternalError     70   a promise of cltaa's own was broken (a kernel that does not build)
├── OutputError       73   an output folder or file cannot be created
├── StorageError      74   reading or writing failed half-way (disk full, I/O error)
└── ResourceError     75   there is not enough memory; running the same command again resumes
    └── DeviceLost    75   the device stopped answering

The codes are those of sysexits.h. A message says where, what, expected against found, and what to do about it.
"""

from __future__ import annotations

import errno
import importlib
import os
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from numbers import Integral, Real
from pathlib import Path
from types import ModuleType, SimpleNamespace, UnionType
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from cltaa.printable import printable

LONGEST_VALUE = 200  # characters of an expected or found value; an attribute can hold a megabyte


class CltaaError(Exception):
    """Base of every deliberate error; ``str(error)`` is the one line a user reads.

    ``path``, ``frame`` and ``channel`` say where, ``what`` says what is wrong, ``expected`` and ``found`` follow in
    brackets, and ``cure`` says what to do. All but ``what`` are optional.
    """

    exit_code = 70
    told = False  # True where standard error has the line already

    def __init__(
        self,
        what: str,
        *,
        path: str | Path | None = None,
        frame: int | None = None,
        channel: str | None = None,
        expected: object = None,
        found: object = None,
        cure: str | None = None,
    ) -> None:
        self.what, self.path, self.frame, self.channel = what, path, frame, channel
        self.expected, self.found, self.cure = expected, found, cure
        super().__init__(self._line())

    def _line(self) -> str:
        place = [] if self.path is None else [printable(self.path)]
        if self.frame is not None:
            place.append(f"frame {self.frame}")
        if self.channel is not None:
            place.append(f"channel {self.channel}")
        line = f"{' '.join(place)}: {self.what}" if place else self.what
        against = [
            f"{name} {printable(str(value), longest=LONGEST_VALUE)}"
            for name, value in (("expected", self.expected), ("found", self.found))
            if value is not None
        ]
        if against:
            line += f" ({', '.join(against)})"
        if self.cure is not None:
            line += f"; {self.cure}"
        # One line without control characters, whatever a driver's message holds.
        return printable(" ".join(line.split()))


# Least similarity (difflib's ratio) of a misspelt name. With less, lpips, another score, would match flip.
ALIKE = 0.7
ARGUMENT_OF = {"camera": "side_file", "input": "assignments"}  # of options whose names differ


def closest(name: str, names: Iterable[str]) -> str | None:
    """Return the one of ``names`` that a misspelt name probably meant, None where none is close."""
    import difflib  # imported here: most commands never need it

    lower = {other.lower(): other for other in names}
    return next((lower[found] for found in difflib.get_close_matches(name.lower(), lower, 1, ALIKE)), None)


def known(name: str, names: Iterable[str], kind: str) -> str:
    """Return the cure for an unknown name: the closest of ``names``, else those that contain it, else all.

    A list of all can be long: there are sixty parameters, three with ``scale``.
    """
    names = list(names)
    if close := closest(ARGUMENT_OF.get(name, name), names):
        return f"did you mean {close}?"
    having = [other for other in names if len(name) > 2 and name.lower() in other.lower()]
    listed = f"known {kind}: {', '.join(names)}"
    return f"did you mean {'one of ' * (len(having) > 1)}{', '.join(having)}?" if having else listed


def several(given: object, argument: str, kind: type = str) -> list[Any]:
    """Return a text or a ``kind`` in a list, or several as a list; raises UsageError, which names ``argument``, for
    anything else."""
    holds = isinstance(given, Iterable) and not isinstance(given, str) and getattr(given, "shape", None) != ()
    each = [*cast(Iterable[Any], given)] if holds else [given]
    for one in each:
        if not isinstance(one, str | kind):
            found = type(one).__name__ if hasattr(one, "shape") else repr(one)  # arrays are long
            raise UsageError(f"{argument} takes names", expected="a text, or several", found=found)
    return each


def once(option: str, keys: Iterable[str]) -> None:
    """Raise UsageError for a key that an ``option`` sets twice: either value may be meant."""
    seen: set[str] = set()
    for key in map(str.strip, keys):
        if key in seen:
            raise UsageError(f"{option} {key} is given twice", cure="leave one of them out")
        seen.add(key)


Call = TypeVar("Call", bound=Callable[..., Any])


# What Python and NumPy raise for an argument of a wrong type.
WRONG_TYPES = (TypeError, ValueError, AttributeError)


def public(name: str, cure: str | None = None) -> Callable[[Call], Call]:
    """Decorate what programs call as ``name``: where it fails because of arguments that it does not take, or of wrong
    types, it raises UsageError, with ``cure`` where some are missing, and where the system refuses a file StorageError.
    """

    def decorated(call: Call) -> Call:
        @wraps(call)
        def told(*given: Any, **named: Any) -> Any:
            try:
                return call(*given, **named)
            except WRONG_TYPES:
                check_arguments(name, call, given, named, cure)
                raise
            except OSError as error:
                if error.filename is None:  # of no file, as a closed pipe
                    raise
                raise refused(error) from error

        return cast(Call, told)

    return decorated


def check_arguments(
    name: str, call: Callable[..., Any], given: tuple[Any, ...], named: Mapping[str, Any], cure: str | None = None
) -> None:
    """Raise UsageError where ``call`` does not take these arguments, or one has another type than it declares: an error
    came from the call itself."""
    from inspect import signature  # imported here: it is slow, and most calls are right

    try:
        bound = (its := signature(call)).bind(*given, **named)
    except TypeError as error:
        names = [each for each in its.parameters if each != "self"]
        for each in named.keys() - its.parameters.keys():
            raise UsageError(f"{name} takes no {each}", cure=known(each, names, "arguments")) from None
        raise UsageError(f"{name}: {error}", cure=cure) from None
    for each, value in bound.arguments.items():
        declared = call.__annotations__.get(each)
        if declared is not None and not _fits(value, _evaluated(declared, call)):
            found = repr(value) if isinstance(value, str | int | float | tuple) else type(value).__name__
            raise UsageError(f"{name}: {each} is wrong", expected=declared, found=found) from None
        if isinstance(value, str | Path) and not _names_a_file(value):
            raise UsageError(f"{name}: {each} can name no file", found=repr(str(value))) from None


def _names_a_file(name: str | Path) -> bool:
    try:
        return b"\0" not in os.fsencode(name)
    except UnicodeEncodeError:
        return False


def _evaluated(declared: Any, call: Any) -> Any:
    """Return the type that ``call`` declares as text; Any where its module imports that for the checker alone."""
    try:
        return get_type_hints(SimpleNamespace(__annotations__={"it": declared}), call.__globals__)["it"]
    except NameError:
        return Any


def _fits(value: object, hint: Any) -> bool:
    """Return False where ``value`` surely has another type than ``hint``."""
    kind, parts = get_origin(hint) or hint, get_args(hint)
    if kind in (Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if kind is Literal:
        return isinstance(value, str) and value in parts
    if kind is tuple and ... not in parts:
        return isinstance(value, tuple) and len(value) == len(parts) and all(map(_fits, value, parts))
    try:
        return isinstance(value, {int: Integral, float: Real}.get(kind, kind))
    except TypeError:  # Any, and protocols
        return True


def check_flags(**flags: object) -> None:
    """Raise UsageError for a flag that is neither a truth value nor a number: the text "no" would mean yes."""
    for name, value in flags.items():
        if not isinstance(value, int | None) and type(value).__name__ not in ("bool", "bool_"):  # NumPy's
            raise UsageError(f"{name} is a flag", expected="True or False", found=repr(value))


DISK_CURES = {
    errno.EFBIG: "the shell limits the size of a file, and of a copy in memory: ulimit -f unlimited",
    errno.EMFILE: "the shell limits how many files are open: ulimit -n 4096",
    errno.ELOOP: "mend its links, which lead in a circle",
    errno.ENAMETOOLONG: "give it a shorter name",
    errno.ENOSPC: "free some space and run again",
    errno.EDQUOT: "free some space and run again",
}


def disk_cure(error: OSError) -> str:
    """Return the cure for a file that could not be read or written, by errno: not every disk is full."""
    return DISK_CURES.get(error.errno or 0, "check the folder and the disk, and run again")


def refused(error: OSError) -> StorageError:
    """Return the error for one of the system that nothing else has named."""
    cure = DISK_CURES.get(error.errno or 0, "check the disk and the permissions")
    return StorageError(f"the system refused: {error.strerror or error}", path=error.filename, cure=cure)


class UsageError(CltaaError):
    """An option, a name or a combination that means nothing."""

    exit_code = 64


class DataError(CltaaError):
    """A file was read but its content is wrong."""

    exit_code = 65


class InputMissing(CltaaError):
    """A file, frame or folder that should be there is not."""

    exit_code = 66


class DeviceMissing(CltaaError):
    """No OpenCL device, or no off-screen OpenGL, can be used here."""

    exit_code = 69


class InternalError(CltaaError):
    """A promise of cltaa's own was broken."""

    exit_code = 70


class OutputError(CltaaError):
    """An output folder or file cannot be created."""

    exit_code = 73


class StorageError(CltaaError):
    """Reading or writing failed half-way."""

    exit_code = 74


class ResourceError(CltaaError):
    """There is not enough memory; running the same command again resumes."""

    exit_code = 75


class DeviceLost(ResourceError):
    """The device stopped answering; running the same command again resumes."""


def import_extra(module: str, *, package: str, extra: str, purpose: str) -> ModuleType:
    """Import ``module`` of ``package``; raises UsageError with the command that installs its extra."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise UsageError(
            f"{purpose} needs {package}, which cannot be imported: {error}",
            cure=f"install it with: pip install 'cltaa[{extra}]'",
        ) from error
