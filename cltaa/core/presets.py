"""Presets: named sets of choices and settings, from TOML files of the package and of users, and from ``--set``."""

from __future__ import annotations

import tomllib
import warnings
from collections.abc import Collection, Iterable, Mapping
from enum import StrEnum
from importlib import resources
from pathlib import Path
from typing import Any, get_type_hints

import msgspec

from cltaa.core.parameter_needs import unmet
from cltaa.core.parameters import Choices, Settings
from cltaa.errors import DataError, UsageError, known, public
from cltaa.printable import printable
from cltaa.renamed import KEYS, PRESETS, WORDS, current

LADDER = ("accumulate", "basic", "fast", "default", "gather-8", "gather-48")  # our own, from the fastest to the best
BASE = "plain"  # the base of the others: files may name it, but it is not listed
# Keys of a reader profile.
OF_PROFILES = frozenset({"profile", "recognise", "telling", "colour", "depth", "motion", "camera"})
_FOLDER = resources.files("cltaa") / "presets"


class Published(StrEnum):
    """Where a resolve was published that a preset reproduces."""

    NO = ""
    ARTICLE = "article"
    ENGINE = "engine"


class Preset(msgspec.Struct, frozen=True, kw_only=True, cache_hash=True):
    """A named set of choices and settings."""

    name: str
    description: str
    jitter: str = ""  # the published sample positions, as ``cltaa capture --jitter`` takes them
    published: Published = Published.NO  # the plan omits nothing of somebody else's resolve
    choices: Choices = Choices()
    settings: Settings = Settings()

    def __post_init__(self) -> None:
        """Raise UsageError for a field of a wrong type."""
        for part, kind in PARTS.items():
            if not isinstance(value := getattr(self, part), kind):
                raise UsageError(f"preset: {part} is wrong", expected=kind.__name__, found=repr(value))

    @public("Preset.replace")
    def replace(self, **values: str | float) -> Preset:
        """Return the preset with new values for keys that ``cltaa presets --parameters`` lists; raises UsageError for
        an unknown key or a value out of range, and warns of a key that changes nothing there."""
        preset = override(self, values, f"preset {self.name}")
        tell_unused(preset, values, "Preset.replace", stacklevel=4)  # of the program's own call
        return preset

    def deciding(self) -> dict[str, Any]:
        """Return the parts that decide the bits of a result: not name and description."""
        parts: dict[str, Any] = msgspec.to_builtins(self)
        return {part: parts[part] for part in ("choices", "settings", "published")}


PARTS: dict[str, type] = get_type_hints(Preset)
FIELDS: dict[str, type[Settings] | type[Choices]] = {
    **dict.fromkeys(Settings.__struct_fields__, Settings),
    **dict.fromkeys(Choices.__struct_fields__, Choices),
}


def words_of(key: str) -> list[str]:
    """Return the values of a choice; none for a number."""
    return [*get_type_hints(Choices)[key]] if FIELDS[key] is Choices else []


def allowed(key: str) -> str:
    """Return the allowed values of a key: the names of a choice, or the range of a number."""
    if FIELDS[key] is Choices:
        return ", ".join(words_of(key))
    hint: Any = get_type_hints(Settings, include_extras=True)[key]
    (meta,) = hint.__metadata__
    return f"{meta.ge:.10g} to {meta.le:.10g}" + (" (whole)" if hint.__origin__ is int else "")


def renamed(values: Mapping[str, object]) -> dict[str, object]:
    """Return ``values`` with the keys and words of earlier versions replaced by the current ones."""
    now: dict[str, object] = {}
    for old, value in values.items():
        key = current(old, KEYS, FIELDS, "key")
        words = frozenset(words_of(key)) if key in FIELDS and isinstance(value, str) else frozenset[str]()
        now[key] = current(value, WORDS.get(key, {}), words, f"{key} =") if isinstance(value, str) else value
    return now


def override(preset: Preset, values: Mapping[str, object], origin: str = "--set") -> Preset:
    """Return ``preset`` with some keys replaced; text is converted to the key's type. Raises UsageError, which names
    ``origin``, for an unknown key or a value out of range, also of ``preset`` itself."""
    values = renamed(values)
    for key in values:
        if key not in FIELDS:
            cure = known(key, sorted(FIELDS), "keys")
            if key in OF_PROFILES:
                cure = "of a reader profile, which --profile takes"
            elif isinstance(values[key], dict):
                cure = "keys stand at the top, in no table"
            raise UsageError(f"{origin}: unknown key {key}", cure=cure)
    parts: dict[str, Any] = {}
    for part, kind in (("choices", Choices), ("settings", Settings)):
        merged = msgspec.structs.asdict(getattr(preset, part))
        for key, value in values.items():
            if FIELDS[key] is kind:
                merged[key] = _as_number(value)
        try:
            parts[part] = msgspec.convert(merged, kind, strict=False)
        except msgspec.ValidationError as error:
            key = str(error).rpartition("`$.")[2].rstrip("`")
            what, found = f"{origin}: {key} has no such value", str(values.get(key, merged.get(key)))
            raise UsageError(what, expected=allowed(key), found=found) from None
    return msgspec.structs.replace(preset, **parts)


def tell_unused(
    preset: Preset, keys: Iterable[str], origin: str, *, known_to: Collection[str] = (), stacklevel: int = 2
) -> None:
    """Warn of each of ``keys``, set by ``origin``, that has no effect in ``preset``, unless a parameter that decides
    that is one of ``known_to``."""
    for key in (KEYS.get(key, key) for key in keys):
        lacking = list(unmet(key, preset.choices, preset.settings))
        off = getattr(preset.choices, key, "") in ("none", "keep")  # which says that it shall have none
        if lacking and not off and not any({*need.fields} & {*known_to} for need in lacking):
            expected = "; ".join(need.words for need in lacking)
            found = "; ".join(need.found(preset.choices, preset.settings) for need in lacking)
            what = f"{origin}: {key} changes nothing in preset {printable(preset.name)}"
            cure = "set that too, or leave it out"
            warnings.warn(f"{what} (expected {expected}, found {found}); {cure}", stacklevel=stacklevel)


def _as_number(value: Any) -> object:
    """Return the number in a text as Python reads it, such as .5 and +2, or of NumPy; anything else unchanged."""
    if getattr(value, "shape", None) == ():
        return value.item()
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return printable(str(value))  # bytes that are no text cannot be converted


def preset_names() -> list[str]:
    """Return the names of the presets that come with cltaa, sorted."""
    names = {Path(entry.name).stem for entry in _FOLDER.iterdir() if entry.name.endswith(".toml")}
    return sorted(names - {BASE})


def load_preset(name: str = "default") -> Preset:
    """Return the preset of that current or earlier name; raises UsageError where there is none."""
    if not isinstance(name, str):
        raise UsageError("the name of a preset must be text", expected="as 'default'", found=repr(name))
    name = current(name, PRESETS, frozenset(preset_names()), "preset")
    if name not in (BASE, *preset_names()):
        cure = known(name, preset_names(), "presets")
        if name.endswith(".toml"):
            takers = "cltaa resolve, tune, bench accuracy and bench quality take a file by --config"
            cure = f"{takers}, and cltaa.load_preset in Python"
        raise UsageError(f"unknown preset {name}", cure=cure)
    text = (_FOLDER / f"{name}.toml").read_text(encoding="utf-8")
    parsed = parse_preset(text, f"preset {name}", Preset(name=name, description=""))
    return msgspec.structs.replace(parsed, name=name)  # also where the file begins with another preset


def parse_preset(text: str, origin: str, base: Preset, *, tells: bool = False) -> Preset:
    """Return ``base`` with the keys of a TOML text over it; its optional key ``preset`` names another base.

    Raises DataError for a text that is not TOML, UsageError for an unknown key or value; ``origin`` names the text.
    With ``tells`` it warns of keys without effect where the text does not say itself why, as a whole preset does.
    """
    try:
        values = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise DataError(f"not TOML: {error}", path=origin) from None
    if isinstance(values.get("preset"), dict):
        what, cure = f"{origin}: preset is the name of a preset, and no table", "write the keys at the top, in no table"
        raise UsageError(what, expected='a text, such as "default"', cure=cure)
    if "preset" in values:
        try:
            base = load_preset(str(values.pop("preset")))
        except UsageError as error:
            raise UsageError(f"{origin}: {error}") from None
    words = ("description", "jitter", "published")
    said = {key: values.pop(key) for key in words if key in values and not isinstance(values[key], dict)}
    preset = override(base, values, origin)  # first: its keys give a file of another kind away
    if tells:
        tell_unused(preset, values, origin, known_to=values, stacklevel=6)  # of a program's load_preset
    for key, value in said.items():
        if value not in [*Published] if key == "published" else not isinstance(value, str):
            expected = ", ".join(word or "nothing" for word in Published) if key == "published" else "a text in quotes"
            raise UsageError(f"{origin}: {key} has no such value", expected=expected, found=value)
    return msgspec.convert(msgspec.to_builtins(preset) | said, Preset)
