"""Types of arguments whose names a shell completes; what they stand for is looked up where they are used."""

from __future__ import annotations

from collections.abc import Callable

import click
from click.shell_completion import CompletionItem

ALL_SCENES = "all"  # every scene of cltaa scenes


class _Name(click.ParamType[str]):
    """One name."""

    name = "name"

    def __init__(self, listed: Callable[[], list[str]], *, or_file: bool = False) -> None:
        self._listed, self._or_file = listed, or_file

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        found = [CompletionItem(name) for name in self._listed() if name.startswith(incomplete)]
        return found or [CompletionItem(incomplete, type="file")] * self._or_file


class _NameList(_Name):
    """A comma-separated list of names, or ``instead`` of one a word; what stands in it is not offered again."""

    def __init__(self, listed: Callable[[], list[str]], *, instead: tuple[str, ...] = ()) -> None:
        super().__init__(listed)
        self._instead = instead

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        before, comma, last = incomplete.rpartition(",")
        found = super().shell_complete(ctx, param, last)
        names = [one.value for one in found if one.value not in before.split(",")]
        names += [word for word in self._instead if not comma and word.startswith(last)]
        return [CompletionItem(before + comma + name) for name in names]


class _Assignment(_Name):
    """``KEY=VALUE``: one of the keys, then one of its words where it has some."""

    def __init__(self, listed: Callable[[], list[str]], words: Callable[[str], list[str]]) -> None:
        super().__init__(listed)
        self._words = words

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        key, equals, _ = incomplete.partition("=")
        begun = [f"{key}={word}" for word in self._words(key)] if equals else [f"{name}=" for name in self._listed()]
        return [CompletionItem(text) for text in begun if text.startswith(incomplete)]


# What lists the names is imported when a shell asks: no command needs it before it runs.
def _presets() -> list[str]:
    from cltaa.parameters.presets import preset_names

    return preset_names()


def _profiles() -> list[str]:
    from cltaa.inputs.profile import profile_names

    return ["auto", *profile_names()]


def _kernels() -> list[str]:
    from cltaa.devices.kernel_files import kernel_names

    return kernel_names()


def _scenes() -> list[str]:
    from cltaa.bench.quality.cases import known_scenes

    return [*known_scenes()]


def _effects() -> list[str]:
    from cltaa.frames import Effect

    return [*Effect]


def _metrics() -> list[str]:
    from cltaa.judging.metrics import METRICS

    return [*METRICS]


def _views() -> list[str]:
    from cltaa.resolve.views import View

    return [*View]


def _parameters() -> list[str]:
    from cltaa.parameters.presets import FIELDS

    return sorted(FIELDS)


def _words_of(parameter: str) -> list[str]:
    from cltaa.parameters.presets import FIELDS, words_of

    return words_of(parameter) if parameter in FIELDS else []


def _keys() -> dict[str, list[str]]:
    from cltaa.inputs.profile import profile_keys

    return profile_keys()


PRESET, PROFILE = _Name(_presets), _Name(_profiles, or_file=True)
KERNEL, SCENE = _Name(_kernels), _Name(_scenes)
SCENES = _Name(lambda: [ALL_SCENES, *_scenes()])  # or all of them
METRIC_LIST, VIEW_LIST = _NameList(_metrics, instead=("all",)), _NameList(_views)
EFFECT_LIST = _NameList(_effects, instead=("auto", "all"))
ASSIGNMENT = _Assignment(_parameters, _words_of)
INPUT = _Assignment(lambda: [*_keys()], lambda key: _keys().get(key, []))
