"""What the table says: means over sequences, and who beats whom where."""

from __future__ import annotations

import math
import re
import time
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cache
from statistics import geometric_mean

import msgspec

from cltaa.bench.quality.cases import Case
from cltaa.bench.quality.judge import COLUMNS, ONE_SAMPLE, Judged
from cltaa.judging.comparison import truth_of, truth_samples
from cltaa.judging.metrics import mean_psnr
from cltaa.parameters.presets import Preset, Published, load_preset, preset_names
from cltaa.sequences.sources import Sequence as Captured

DEFAULT = "default"
LADDER = re.compile(r"t\d(-200)?")  # in the order of their names: t3, t3-200, t4
DECIDING = ("flip", "psnr")  # the two that a preset is called better by
HIGHER = {column.name: column.higher_is_better for column in COLUMNS}


class Row(msgspec.Struct, kw_only=True):
    """All presets on one sequence."""

    scene: str
    split: str
    key: str
    presets: dict[str, Judged]


class Duel(msgspec.Struct, kw_only=True):
    """One preset against another: sequences in which it is better by FLIP and PSNR both, and those in which not."""

    preset: str
    against: str
    better: int
    sequences: int
    not_better: list[str]
    mean_flip: tuple[float, float]
    mean_psnr: tuple[float, float]


class Table(msgspec.Struct, kw_only=True):
    """The whole outcome of ``cltaa bench quality``."""

    rows: list[Row]
    means: dict[str, dict[str, dict[str, float | None]]]  # split -> preset -> score
    duels: list[Duel]


def summarise(judged: Iterable[tuple[Case, Mapping[str, Judged]]]) -> Table:
    """The table of all cells."""
    rows = [Row(scene=c.title, split=c.split, key=c.key, presets=dict(presets)) for c, presets in judged]
    splits = list(dict.fromkeys(row.split for row in rows))
    names = list(dict.fromkeys(name for row in rows for name in row.presets))
    means = {
        split: {name: _mean_scores([row.presets[name] for row in rows if row.split == split]) for name in names}
        for split in splits
    }
    others = [name for name in names if published(name)]
    duels = [_duel(rows, one, other) for one in contenders(names) for other in others]
    return Table(rows=rows, means=means, duels=duels)


@cache
def published(name: str) -> Published:
    """Whether a preset that comes with cltaa is the resolve of an article or of an engine; no other name is."""
    return load_preset(name).published if name in preset_names() else Published.NO


def contenders(names: Collection[str]) -> list[str]:
    """What is held against the published ones: the default, the last of the ladder, and all that is neither.

    Whoever adds a preset wants to know what it beats.
    """
    highest = max(filter(LADDER.fullmatch, names), default=None)

    def contends(name: str) -> bool:
        return name in (DEFAULT, highest) or not (published(name) or LADDER.fullmatch(name) or name == ONE_SAMPLE)

    return sorted(filter(contends, names), key=lambda name: name != DEFAULT)


def best_engine(means: Mapping[str, Mapping[str, float | None]]) -> str | None:
    """The engine's preset of the least mean FLIP, or None where none was judged."""
    found = {
        name: value
        for name, scores in means.items()
        if published(name) is Published.ENGINE and (value := scores["flip"])
    }
    return min(found, key=lambda name: found[name], default=None)


def _mean_scores(cells: list[Judged]) -> dict[str, float | None]:
    """Means over sequences: of a PSNR by way of its error, of samples the geometric one, else the arithmetic one."""
    result: dict[str, float | None] = {}
    for column in COLUMNS:
        values = [value for cell in cells if (value := score(column.name, cell.scores)) is not None]
        if not values:
            result[column.name] = None
        elif column.name == "psnr":
            found = mean_psnr(values)
            result[column.name] = found if math.isfinite(found) else None
        elif column.name in ("samples", "last", "uncovered"):
            result[column.name] = geometric_mean(values)
        else:
            result[column.name] = math.fsum(values) / len(values)
    return result


def _duel(rows: list[Row], preset: str, against: str) -> Duel:
    losses = [f"{row.scene} ({row.split})" for row in rows if not _better(row.presets[preset], row.presets[against])]
    pair = [_mean_scores([row.presets[name] for row in rows]) for name in (preset, against)]
    flip, decibels = ((_number(name, pair[0]), _number(name, pair[1])) for name in DECIDING)
    return Duel(
        preset=preset, against=against, better=len(rows) - len(losses), sequences=len(rows),
        not_better=losses, mean_flip=flip, mean_psnr=decibels,
    )  # fmt: skip


def score(name: str, scores: Mapping[str, float | None]) -> float | None:
    """A score or None where there was nothing to judge; a PSNR is always there, and infinite where it is null."""
    value = scores.get(name)
    return math.inf if value is None and name == "psnr" else value


def _number(name: str, scores: Mapping[str, float | None]) -> float:
    value = score(name, scores)
    return math.nan if value is None else value


def _better(one: Judged, other: Judged) -> bool:
    """Better by both deciding scores."""
    for name in DECIDING:
        a, b = _number(name, one.scores), _number(name, other.scores)
        if not (a > b if HIGHER[name] else a < b):
            return False
    return True


def ordered(names: Iterable[str]) -> list[str]:
    """Presets as the tables list them: one sample, articles, engines, the ladder, then all others."""

    def rank(name: str) -> tuple[int, str]:
        groups = (
            name == ONE_SAMPLE,
            published(name) is Published.ARTICLE,
            published(name) is Published.ENGINE,
            LADDER.fullmatch(name) is not None,
            name == DEFAULT,
        )
        return next((place for place, found in enumerate(groups) if found), len(groups)), name

    return sorted(names, key=rank)


def about_of(table: Table, sequences: Collection[Captured], settled: int, presets: Sequence[Preset]) -> str:
    """What was judged, as the sequences themselves have it: some may not be as the options say."""
    devices = sorted({judged.device for row in table.rows for judged in row.presets.values()})
    splits = Counter(row.split for row in table.rows)
    counts = " and ".join(f"{count} {split}" for split, count in splits.items())
    sizes = _either(f"{sequence.width} × {sequence.height}" for sequence in sequences)
    frames = _either_of((len(sequence) for sequence in sequences), "frame")
    jitters = _either(sequence.sequence_json.get("settings", {}).get("jitter") for sequence in sequences)
    truths = _either_of((truth_samples(truth_of(sequence)) for sequence in sequences), "sample")
    profiles = list(dict.fromkeys(each.reading["profile"]["name"] for each in sequences if "profile" in each.reading))
    read = f", read by profile {' or '.join(profiles)}" if profiles else ""
    files = [preset.description for preset in presets if preset.name not in preset_names()]
    return (
        f"{counts} sequence{'s' * (len(table.rows) != 1)}, {sizes}, {frames}{read}, "
        f"jitter {jitters}, judged from frame {settled} on, "
        f"truth of {truths} a pixel; {time.strftime('%Y-%m-%d', time.gmtime())}, "
        f"{'; '.join([*devices, *files])}."
    )


def _either_of(numbers: Iterable[int | None], thing: str) -> str:
    found = _either(numbers)
    return f"{found} {thing}{'s' * (found != '1')}"


def _either(values: Iterable[object]) -> str:
    return " or ".join("unknown" if value is None else str(value) for value in dict.fromkeys(values))
