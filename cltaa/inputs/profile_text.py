"""Profiles as text: assignments of the command line in, options and TOML out."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import tomli_w

from cltaa.errors import UsageError, known
from cltaa.inputs.profile import Profile, convert_profile


def override(profile: Profile, assignments: Sequence[str]) -> Profile:
    """``profile`` with ``SECTION.KEY=VALUE`` assignments over it; raises UsageError."""
    values = msgspec.to_builtins(profile)
    for assignment in assignments:
        key, equals, text = assignment.partition("=")
        section, dot, name = key.strip().partition(".")
        if not (equals and dot):
            raise UsageError(f"--input {assignment}: no value", expected="SECTION.KEY=VALUE", found=assignment)
        if name not in values.get(section, {}):
            keys = [f"{s}.{k}" for s, keys in values.items() if isinstance(keys, dict) for k in keys]
            raise UsageError(f"--input {assignment}: no such key", cure=known(key.strip(), keys, "keys"))
        values[section][name] = _value(text.strip(), values[section][name])
    return convert_profile(values, "--input")


def differences(profile: Profile, base: Profile) -> dict[str, dict[str, Any]]:
    """Keys of ``profile`` that differ from ``base``, by section."""
    new, old = msgspec.to_builtins(profile), msgspec.to_builtins(base)
    sections = {
        section: {key: value for key, value in keys.items() if value != old[section].get(key)}
        for section, keys in new.items()
        if isinstance(keys, dict) and section != "recognise"
    }
    return {section: keys for section, keys in sections.items() if keys}


def assignments_of(values: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """``values`` as ``override`` takes them: ``SECTION.KEY=VALUE``."""
    return [f"{section}.{key}={_text(value)}" for section, keys in values.items() for key, value in keys.items()]


def option_text(values: Mapping[str, Mapping[str, Any]]) -> str:
    """``values`` as options of the command line, for a shell."""
    pairs = (assignment.partition("=") for assignment in assignments_of(values))
    return " ".join(f"--input {key}={shlex.quote(text)}" for key, _, text in pairs)


def toml_text(profile: Profile) -> str:
    """``profile`` as TOML, every key that has a value."""
    values = msgspec.to_builtins(profile)
    sections = {
        name: {key: value for key, value in keys.items() if value is not None}
        for name, keys in values.items()
        if isinstance(keys, dict) and keys
    }
    return tomli_w.dumps({"description": profile.description, **sections})


def _value(text: str, before: object) -> object:
    """Read the text of an assignment the way TOML would, with lists and words written plainly."""
    if isinstance(before, list | tuple):
        entries = [entry.strip() for entry in text.strip("[]").split(",")]
        return entries if before and isinstance(before[0], str) else [_number(entry) for entry in entries]
    if text in ("true", "false"):
        return text == "true"
    return text if isinstance(before, str) else _number(text)


def _number(text: str) -> float | int | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _text(value: object) -> str:
    if isinstance(value, list | tuple):
        return ",".join(_text(entry) for entry in value)
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)
