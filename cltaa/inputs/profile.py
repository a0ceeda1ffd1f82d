"""Reader profiles: the meaning of another tool's channels and attributes (``cltaa/inputs/profiles/*.toml``)."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from enum import StrEnum
from importlib import resources
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
import tomli_w

from cltaa.errors import DataError, UsageError, known
from cltaa.io.content import read_text
from cltaa.printable import counted, names_in, shell_word, written

LARGEST = 1 << 16  # bytes; every key with a comment takes a few thousand
_FOLDER = resources.files("cltaa") / "inputs" / "profiles"

MOST = np.finfo(np.float64).max.item()
Number = Annotated[float, msgspec.Meta(ge=-MOST, le=MOST)]  # finite
Plane = Annotated[float, msgspec.Meta(ge=0.0, le=MOST)]
Positive = Annotated[float, msgspec.Meta(gt=0.0, le=MOST)]
Delay = Annotated[int, msgspec.Meta(ge=-16, le=16)]  # from a pipeline, which holds only a few frames
Pair = tuple[Number, Number]
Names = tuple[str, ...]
Source = Literal["declared", "none"]
JitterSource = Literal["declared", "projection", "none"]
MatrixLayout = Literal["row", "column"]

# How errors name the expected value, by the key's type.
KINDS: dict[Any, str] = {
    Number: "a number",
    float | None: "a number",
    Plane: "a number from 0 on",
    Positive: "a number above 0",
    Delay: "a whole number from -16 to 16",
    bool: "true or false",
    Pair: "two numbers",
    str: "a name",
}
NOT_0 = "depth.scale", "motion.scale", "jitter.scale"


class DepthKind(StrEnum):
    """What a depth channel holds."""

    PLANAR = "planar"  # distance along the view axis
    RAY = "ray"  # distance along the ray
    INVERSE = "inverse"  # 1 / planar
    DEVICE = "device"  # 0 at the near plane, 1 at the far plane, linear in 1 / planar
    DEVICE_REVERSED = "device-reversed"  # 1 near, 0 far


class Units(StrEnum):
    """Unit of motion vectors."""

    PIXELS = "pixels"
    UV = "uv"  # fractions of the display window, y down
    NDC = "ndc"  # halves of the picture, y up


class Encoding(StrEnum):
    """How colour is stored."""

    LINEAR = "linear"
    SRGB = "srgb"


class Colour(msgspec.Struct, frozen=True, kw_only=True):
    """Colour, alpha and reactive mask; each entry of ``channels`` is three names, tried in order.

    ``view`` chooses one of several views, also for depth and vectors. ``fireflies`` is the default of --fireflies.
    """

    channels: tuple[Names, ...] = (("R", "G", "B"),)
    alpha: tuple[str, ...] = ("A", "a", "alpha")
    reactive: tuple[str, ...] = ("reactive",)
    encoding: Encoding = Encoding.LINEAR
    view: str = ""
    fireflies: Literal["keep", "clamp"] = "keep"


class Depth(msgspec.Struct, frozen=True, kw_only=True):
    """Depth: planar = ``scale`` x the channel converted by ``kind``; stored values from ``sky`` on are the sky, of
    kinds that fall with distance those that equal it.

    ``near`` and ``far`` are the planes of device depth; 0 takes a plane from the projection.
    """

    channels: tuple[str, ...] = ("Z",)
    kind: DepthKind = DepthKind.PLANAR
    scale: Number = 1.0
    sky: float | None = None
    near: Plane = 0.0
    far: Plane = 0.0


class Motion(msgspec.Struct, frozen=True, kw_only=True):
    """Motion to the previous frame, in pixels, y down = ``scale`` x unit x (swapped channels - ``offset``).

    ``jittered`` 1: the vectors contain this frame's jitter minus the previous one's; -1: the opposite. ``zero`` camera:
    a zero vector means that only the camera moves the pixel, as in engines that draw vectors of moving objects only.
    """

    channels: tuple[Names, ...] = (("backward.u", "backward.v"),)
    units: Units = Units.PIXELS
    scale: Pair = (1.0, 1.0)
    offset: Pair = (0.0, 0.0)
    swap: bool = False
    jittered: Literal[-1, 0, 1] = 0
    zero: Literal["still", "camera"] = "still"


class Jitter(msgspec.Struct, frozen=True, kw_only=True):
    """Jitter in pixels = ``scale`` x swapped numbers + ``offset``, from ``attribute`` or the side file, else none.

    A frame's jitter is the one declared for the frame ``delay`` later. ``source`` projection: the jitter is the
    distance of the projection's centre from its mean over the shot, in pixels, and is removed from the projection.
    """

    source: JitterSource = "declared"
    attribute: str = "cltaa:jitterPx"
    scale: Pair = (1.0, 1.0)
    offset: Pair = (0.0, 0.0)
    swap: bool = False
    delay: Delay = 0


class Cameras(msgspec.Struct, frozen=True, kw_only=True):
    """Matrices from attributes or the side file; the other keys say how they differ from docs/conventions.md."""

    source: Source = "declared"
    view: str = "cltaa:worldToView"
    projection: str = "cltaa:viewToClip"
    standard: bool = False  # the attributes are the EXR standard's worldToCamera and worldToNDC
    layout: MatrixLayout = "row"  # column: transposed against the file format's rule
    view_layout: MatrixLayout = "row"
    projection_layout: MatrixLayout = "row"
    sense: Literal["world-to-camera", "camera-to-world"] = "world-to-camera"
    flip_y: bool = False  # of clip space
    flip_z: bool = False  # of view space
    flip_projection_z: bool = False
    mirrored: bool = False  # the world is left-handed
    jittered: bool = False  # the projection contains the jitter
    delay: Delay = 0
    near: Positive = 0.1  # near plane of the projection made from standard attributes


class Profile(msgspec.Struct, frozen=True, kw_only=True):
    """One tool's conventions. ``recognise`` maps a header attribute to a word in its text.

    Without such an attribute, one of ``telling`` must match a channel, if there are any.
    """

    name: str = ""
    description: str = ""
    recognise: dict[str, str] = {}
    telling: Names = ()
    colour: Colour = Colour()
    depth: Depth = Depth()
    motion: Motion = Motion()
    jitter: Jitter = Jitter()
    camera: Cameras = Cameras()


def _words_of(kind: Any) -> list[str]:
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return [*kind]
    return [*map(str, get_args(kind))] if get_origin(kind) is Literal else []


def profile_names() -> list[str]:
    """Return the names of the profiles that come with cltaa, sorted."""
    return sorted(Path(entry.name).stem for entry in _FOLDER.iterdir() if entry.name.endswith(".toml"))


def load_profile(name: str | Path | Profile) -> Profile:
    """Load the profile of that name or TOML file, or return a given one; raises UsageError, InputMissing or
    DataError."""
    if isinstance(name, Profile):
        return name
    return _load(str(name), ())


def _load(name: str, above: Names) -> Profile:
    """Load a profile that those ``above`` extend."""
    if name in profile_names():
        return _parse(name, (_FOLDER / f"{name}.toml").read_text(encoding="utf-8"), name, above)
    if not name.endswith(".toml"):
        # What auto takes depends on the files; it is no profile of its own to print or to extend.
        names = [*(["auto"] if name != "auto" and not above else []), *profile_names(), "FILE.toml"]
        cure = "the name of a profile's file ends with .toml" if "." in name else known(name, names, "profiles")
        raise UsageError(f"unknown profile {name}", path=above[-1] if above else None, cure=cure)
    if name in above:
        raise DataError("the profile extends itself", path=name, cure="name another profile in its first line")
    return _parse(Path(name).stem, read_text(Path(name), "a profile", LARGEST), name, above)


def _parse(name: str, text: str, origin: str, above: Names) -> Profile:
    try:
        values = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise DataError(f"not TOML: {error}", path=origin) from None
    base = _load(str(values.pop("profile")), (*above, origin)) if "profile" in values else Profile()
    merged = msgspec.to_builtins(base) | {"name": name}
    for section, keys in values.items():
        if section not in merged:
            raise DataError(f"unknown key {section}", path=origin, cure=known(section, merged, "keys"))
        for key in keys if isinstance(keys, dict) and section != "recognise" else ():
            if key not in merged[section]:
                cure = known(key, merged[section], f"keys of {section}")
                raise DataError(f"unknown key {section}.{key}", path=origin, cure=cure)
        merged[section] = merged[section] | keys if isinstance(keys, dict) else keys
    return convert_profile(merged, origin)


def convert_profile(values: dict[str, Any], origin: str) -> Profile:
    """Convert builtins to a profile; raises DataError that names the key."""
    try:
        profile = msgspec.convert(_with_names(values), Profile)
    except msgspec.ValidationError as error:
        raise _no_such_value(str(error).rpartition("$.")[2].strip("`"), values, origin) from None
    for path in NOT_0:
        if not np.all(attrgetter(path)(profile)):
            raise _no_such_value(path, values, origin, "no 0")
    for key, count in COUNTS.items():
        found: tuple[str | Names, ...] = attrgetter(key)(profile)
        for names in ((one,) if isinstance(one, str) else one for one in found):
            if len(names) != count or not all(names):
                every = [name for one in found for name in one]
                if len(found) == len(every) == count:
                    cure = f"spaces separate the names of one: {written(every)}"
                elif key == "motion.channels":
                    cure = "name those to the right and down"
                else:
                    cure = f"one channel may be named more than once: {written([next(iter(names), '') or 'Y'] * count)}"
                raise DataError(
                    f"profile: {key} is not {counted(count, 'name')}",
                    path=origin,
                    found=written(names),
                    cure=None if count == 1 else cure if len(names) < 2 else "a name with spaces stands in quotes",
                )
    return profile


# Number of channels in each entry of a key.
COUNTS = {"colour.channels": 3, "motion.channels": 2, "colour.alpha": 1, "colour.reactive": 1, "depth.channels": 1}


def _with_names(values: dict[str, Any]) -> dict[str, Any]:
    """Return ``values`` with each channel key as lists of names, from text or arrays."""
    made = dict(values)
    for key, count in COUNTS.items():
        section, _, name = key.partition(".")
        its = made.get(section)
        if isinstance(its, dict) and isinstance(its.get(name), str | list | tuple):
            lists = _lists_of(its[name], count)
            made[section] = its | {name: [names[0] for names in lists] if count == 1 else lists}
    return made


def _lists_of(value: Any, count: int) -> list[list[Any]]:
    """Return lists of ``count`` names from text, or from an array of texts, names or such lists."""
    if isinstance(value, str):
        return names_in(value, count)
    if count == 1:
        return [[one] for one in value]
    lists = [names for one in value for names in (names_in(one, count) if isinstance(one, str) else [one])]
    if len(value) != count or not all(isinstance(one, str) for one in value):
        return lists
    # ["a b", "c d"] is two lists of two names, or one list of two names with spaces: the channels present decide.
    return [*(names for names in lists if len(names) == count), [*value]]


def _no_such_value(path: str, values: dict[str, Any], origin: str, expected: str = "") -> DataError:
    """Return the error for an invalid value of the key at ``path``, such as depth.scale."""
    section, _, key = re.sub(r"\[.*", "", path).partition(".")
    if not key:
        return DataError(f"profile: {section} has no such value", path=origin)
    kind = get_type_hints(type(getattr(Profile(), section)), include_extras=True).get(key)
    expected = expected or KINDS.get(kind) or ", ".join(_words_of(kind)) or "names"
    found = values[section][key]
    found = ",".join(map(str, found)) if isinstance(found, list | tuple) else found
    return DataError(f"profile: {section}.{key} has no such value", path=origin, expected=expected, found=found)


def override(profile: Profile, assignments: Sequence[str]) -> Profile:
    """Apply ``SECTION.KEY=VALUE`` assignments to ``profile``; raises UsageError."""
    values = msgspec.to_builtins(profile)
    sections = {name: keys for name, keys in values.items() if isinstance(keys, dict) and name != "recognise"}
    for assignment in assignments:
        key, equals, text = assignment.partition("=")
        section, dot, name = key.strip().partition(".")
        if not (equals and dot):
            what = f"--input {assignment}: no {'section' if equals else 'value'}"
            raise UsageError(what, expected="SECTION.KEY=VALUE", found=assignment)
        if name not in sections.get(section, {}):
            keys = [f"{s}.{k}" for s, its in sections.items() for k in its]
            raise UsageError(f"--input {assignment}: no such key", cure=known(key.strip(), keys, "keys"))
        text, before = text.strip(), values[section][name]
        values[section][name] = _array(text) if f"{section}.{name}" in COUNTS else _value(text, before)
    return convert_profile(values, "--input")


def keys_of(assignments: Iterable[str]) -> set[str]:
    """Return the keys that ``SECTION.KEY=VALUE`` assignments name."""
    return {assignment.partition("=")[0].strip() for assignment in assignments}


def differences(profile: Profile, base: Profile) -> dict[str, dict[str, Any]]:
    """Return the keys of ``profile`` that differ from ``base``, by section."""
    new, old = msgspec.to_builtins(profile), msgspec.to_builtins(base)
    sections = {
        section: {key: value for key, value in keys.items() if value != old[section].get(key)}
        for section, keys in new.items()
        if isinstance(keys, dict) and section != "recognise"
    }
    return {section: keys for section, keys in sections.items() if keys}


def assignments_of(values: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return ``values`` as assignments for ``override``: ``SECTION.KEY=VALUE``."""
    return [f"{section}.{key}={_text(value)}" for section, keys in values.items() for key, value in keys.items()]


def channels_option(key: str, names: Sequence[str]) -> str:
    """Return the command-line option, quoted for a shell, that sets the channels of ``key`` to ``names``."""
    section, _, name = key.partition(".")
    return option_text({section: {name: [names]}})


def option_text(values: Mapping[str, Mapping[str, Any]]) -> str:
    """Return ``values`` as command-line options, quoted for a shell."""
    pairs = (assignment.partition("=") for assignment in assignments_of(values))
    return " ".join(f"--input {key}={shell_word(text)}" for key, _, text in pairs)


def toml_text(profile: Profile) -> str:
    """Return ``profile`` as TOML, with every key that has a value."""
    values = msgspec.to_builtins(profile)
    sections = {
        name: {key: value for key, value in keys.items() if value is not None}
        for name, keys in values.items()
        if isinstance(keys, dict) and keys
    }
    telling = {"telling": profile.telling} if profile.telling else {}
    return tomli_w.dumps({"description": profile.description, **telling, **sections})


def _array(text: str) -> object:
    """Return plain names unchanged, or parse a TOML array of names."""
    if not text.startswith("["):
        return text
    try:
        return tomllib.loads(f"names = {text}")["names"]
    except (tomllib.TOMLDecodeError, RecursionError):
        return text.strip("[]")


def _value(text: str, before: object) -> object:
    """Parse the value of an assignment like TOML, but with lists and words unquoted."""
    if isinstance(before, list | tuple):
        return [_number(entry.strip()) for entry in text.strip("[]").split(",")]
    if isinstance(before, str):
        return text
    return text == "true" if text in ("true", "false") else _number(text)


def _number(text: str) -> float | int | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _text(value: object) -> str:
    if isinstance(value, list | tuple):
        names = [[entry] if isinstance(entry, str) else entry for entry in value]
        texts = (written(entry) if isinstance(entry, list | tuple) else _text(entry) for entry in names)
        return ",".join(texts)
    if isinstance(value, bool):
        return str(value).lower()
    return repr(float(value)).removesuffix(".0") if isinstance(value, float) else str(value)  # every digit
