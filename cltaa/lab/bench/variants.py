"""Measured variants of the resolve: unchanged presets, and the ladder, which changes single steps of one of them.

One step changes at a time, so that each bar of the ablation has one cause. New choices (``cltaa.core.parameters``) and
storages (``cltaa.core.build``) join the ladder automatically.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import msgspec

from cltaa.core.backend import Launcher
from cltaa.core.build import Build, Real, Storage
from cltaa.core.parameters import Accumulate, Box, Choices, Settings
from cltaa.core.presets import Preset, Published
from cltaa.core.resolver import Resolver

DEFAULT, PRESETS = "default", "preset"

# Continuous settings on the ladder: limits of the sample count, and the blur of disoccluded pixels.
SETTINGS_RUNGS: dict[str, tuple[float, ...]] = {
    "sample_limit": (8.0, 16.0, 48.0, 96.0),
    "resampling_penalty": (0.0,),
    "disocclusion_blur": (0.0,),
}
# Choices that matter only with a variance box; they are also tried together with that box.
IN_VARIANCE_BOX = ("neighbourhood", "variance")
SLOW_WEIGHT = 0.05  # a second weight of the exponential blend


class Variant(msgspec.Struct, frozen=True, kw_only=True):
    """One variant: a preset and its build. ``group`` is the step that it changes."""

    name: str
    group: str
    choices: Choices
    settings: Settings
    storage: Storage = Storage.FLOAT
    real: Real = Real.FLOAT
    strict: bool = False
    relaxed: bool = False
    published: Published = Published.NO

    @classmethod
    def of(cls, preset: Preset, group: str = "preset") -> Variant:
        """Make the variant of an unchanged preset."""
        parts: dict[str, Any] = {"choices": preset.choices, "settings": preset.settings, "published": preset.published}
        return cls(name=preset.name, group=group, **parts)

    @property
    def preset(self) -> Preset:
        """The variant as a preset of its name, published if its base is."""
        parts: dict[str, Any] = {"choices": self.choices, "settings": self.settings, "published": self.published}
        return Preset(name=self.name, description=self.group, **parts)

    def resolver(self, device: str | Launcher | None) -> Resolver:
        """Make a new resolver of this variant."""
        build = Build(real=self.real, storage=self.storage, strict=self.strict, relaxed=self.relaxed)
        return Resolver(self.preset, device, build=build)


def steps(base: Variant) -> Iterator[Variant]:
    """Yield ``base`` with one step changed, for every step."""
    yield from _other_choices(base, Choices.__struct_fields__)
    if base.choices.box is not Box.VARIANCE:
        yield from _other_choices(base, IN_VARIANCE_BOX, box=Box.VARIANCE)
    exponential = {"accumulate": Accumulate.EXPONENTIAL}
    slow = {"blend_weight": SLOW_WEIGHT}
    yield _changed(base, "accumulate", f"exponential {SLOW_WEIGHT:g}", choices=exponential, settings=slow)
    for field, values in SETTINGS_RUNGS.items():
        for value in values:
            if value != getattr(base.settings, field):
                yield _changed(base, field, f"{value:g}", settings={field: value})
    for storage in Storage:
        if storage is not base.storage:
            yield _changed(base, "storage", str(storage), storage=storage)
    yield _changed(base, "arithmetic", "double", real=Real.DOUBLE)
    for storage in Storage:
        if storage is not base.storage:
            yield _changed(base, "arithmetic", f"double, storage: {storage}", real=Real.DOUBLE, storage=storage)
    yield _changed(base, "build", "strict", strict=True)
    yield _changed(base, "build", "fast-relaxed", relaxed=True)


def _other_choices(base: Variant, fields: Iterable[str], **beside: Any) -> Iterator[Variant]:
    """Yield every other choice of each field, together with the changes ``beside`` it."""
    also = "".join(f", {field}: {choice}" for field, choice in beside.items())
    for field in fields:
        current = getattr(base.choices, field)
        for choice in type(current):
            if choice is not current:
                yield _changed(base, field, f"{choice}{also}", choices={field: choice, **beside})


def ladder(base: Preset, presets: Iterable[Preset] = ()) -> list[Variant]:
    """Return the default, its steps and the other presets.

    Leaves out presets that look ahead, because errors and times are measured frame by frame.
    """
    first = Variant.of(base, DEFAULT)
    causal = (preset for preset in presets if not preset.settings.look_ahead)
    others = [Variant.of(preset, PRESETS) for preset in causal if preset.name != base.name]
    return [first, *steps(first), *others]


def _changed(
    base: Variant,
    group: str,
    value: str,
    *,
    choices: dict[str, Any] | None = None,
    settings: dict[str, float] | None = None,
    **shape: Any,
) -> Variant:
    return msgspec.structs.replace(
        base,
        name=f"{group}: {value}".replace("_", " "),
        group=group,
        choices=msgspec.structs.replace(base.choices, **choices or {}),
        settings=msgspec.structs.replace(base.settings, **settings or {}),
        **shape,
    )
