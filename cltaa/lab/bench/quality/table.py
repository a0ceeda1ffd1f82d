"""The table of ``cltaa bench quality``: means over sequences, comparisons of presets, and the Markdown page."""

from __future__ import annotations

import math
import os
import re
import time
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from statistics import geometric_mean
from urllib.parse import quote

import msgspec

from cltaa.core.presets import LADDER, Preset, Published, load_preset, preset_names
from cltaa.errors import DataError
from cltaa.io.atomic import atomic_path, check_creatable
from cltaa.io.sequence import FrameSequence
from cltaa.lab.bench.cases import Case
from cltaa.lab.bench.cells import COLUMNS, ONE_SAMPLE, Judged
from cltaa.lab.judge.comparison import truth_of, truth_samples
from cltaa.lab.judge.metrics import ALPHA, Measure, mean_of
from cltaa.printable import literal, markdown, printable

DEFAULT = "default"


class Row(msgspec.Struct, kw_only=True):
    """All presets on one sequence."""

    scene: str
    split: str
    key: str
    presets: dict[str, Judged]


class Duel(msgspec.Struct, kw_only=True):
    """One preset against another: on which sequences it is better by both FLIP and PSNR, and on which not."""

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
    """Return the table of all cells."""
    rows = [Row(scene=c.title, split=c.split, key=c.key, presets=dict(presets)) for c, presets in judged]
    splits = list(dict.fromkeys(row.split for row in rows))
    names = _names(rows)
    means = {
        split: {name: _mean_scores([row.presets[name] for row in rows if row.split == split]) for name in names}
        for split in splits
    }
    others = [name for name in names if published(name)]
    duels = [_duel(rows, one, other) for one in contenders(names) for other in others]
    return Table(rows=rows, means=means, duels=duels)


@cache
def published(name: str) -> Published:
    """Return whether a preset of cltaa is the resolve of an article or of an engine; NO for any other name."""
    return load_preset(name).published if name in preset_names() else Published.NO


def contenders(names: Collection[str]) -> list[str]:
    """Return the presets to compare with published ones: the default, the last of the ladder, and all others outside
    both groups, such as the user's own."""
    highest = next((name for name in reversed(LADDER) if name in names), None)
    others = {name for name in names if not (published(name) or name in LADDER or name == ONE_SAMPLE)}
    return sorted((name for name in names if name in {DEFAULT, highest} | others), key=lambda name: name != DEFAULT)


def _mean_scores(cells: list[Judged]) -> dict[str, float | None]:
    """Return means over sequences: of PSNR by its error, of samples geometric, else arithmetic."""
    result: dict[str, float | None] = {}
    for name in (column.name for column in (*COLUMNS, ALPHA)):
        values = [value for cell in cells if (value := cell.scores.get(name)) is not None]
        average = geometric_mean if name in ("samples", "last", "disoccluded") else partial(mean_of, name)
        result[name] = average(values) if values else None
    return result


def _duel(rows: list[Row], preset: str, against: str) -> Duel:
    losses = [f"{row.scene} ({row.split})" for row in rows if not _better(row.presets[preset], row.presets[against])]
    pair = [_mean_scores([row.presets[name] for row in rows]) for name in (preset, against)]
    flip, decibels = zip(*map(_deciding, pair), strict=True)
    return Duel(
        preset=preset,
        against=against,
        better=len(rows) - len(losses),
        sequences=len(rows),
        not_better=losses,
        mean_flip=flip,
        mean_psnr=decibels,
    )


def columns_of(scores: Iterable[Mapping[str, float | None]]) -> tuple[Measure, ...]:
    """Return the columns of a table; alpha only if it was judged."""
    return (*COLUMNS, ALPHA) if any(each.get(ALPHA.name) is not None for each in scores) else COLUMNS


def _deciding(scores: Mapping[str, float | None]) -> tuple[float, float]:
    """Return FLIP and PSNR, which decide whether a preset is better; NaN if not judged."""
    flip, psnr = (math.nan if (value := scores.get(name)) is None else value for name in ("flip", "psnr"))
    return flip, psnr


def _better(one: Judged, other: Judged) -> bool:
    """Return whether ``one`` is better by both FLIP and PSNR."""
    (flip, psnr), (their_flip, their_psnr) = map(_deciding, (one.scores, other.scores))
    return flip < their_flip and psnr > their_psnr


def ordered(names: Iterable[str]) -> list[str]:
    """Sort presets for tables: one sample, articles, engines, the ladder, then all others."""

    def rank(name: str) -> tuple[int, int, str]:
        groups = (
            name == ONE_SAMPLE,
            published(name) is Published.ARTICLE,
            published(name) is Published.ENGINE,
            name in LADDER,
        )
        step = LADDER.index(name) if name in LADDER else 0
        return next((place for place, found in enumerate(groups) if found), len(groups)), step, name

    return sorted(names, key=rank)


def about_of(table: Table, sequences: Collection[FrameSequence], settled: int, presets: Sequence[Preset]) -> str:
    """Describe the judged sequences from their own data, because some may differ from the options."""
    devices = sorted({judged.device for row in table.rows for judged in row.presets.values()})
    splits = Counter(row.split for row in table.rows)
    counts = " and ".join(f"{count} {split}" for split, count in splits.items())
    sizes = _either(f"{sequence.width} × {sequence.height}" for sequence in sequences)
    frames = _either_of((len(sequence) for sequence in sequences), "frame")
    settings = [sequence.sequence_json.get("settings") for sequence in sequences]
    jitters = _either(str(each["jitter"]) if isinstance(each, dict) and "jitter" in each else None for each in settings)
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


BEGIN, END = "<!-- cltaa bench quality: begin -->", "<!-- cltaa bench quality: end -->"
OVERVIEW = ("flip", "samples")  # the scores of the table with one line per scene


def scenes_page(page: Path) -> Path:
    """Return the path of the page with each scene's own table: ``quality-scenes.md`` beside ``quality.md``."""
    return page.with_name(f"{page.stem}-scenes{page.suffix}")


def write_pages(page: Path, table: Table, about: str, pictures: Mapping[str, str] | None = None) -> None:
    """Replace the text between the marks of a page and of its scenes page; creates missing pages.

    ``pictures`` is the result of ``write_pictures``. Raises what ``check_pages`` raises.
    """
    beside = scenes_page(page)
    for path, text in ((beside, scenes(table, about, pictures)), (page, summary(table, about, beside.name))):
        before, after = _around(path, page)
        with atomic_path(path) as temporary:
            temporary.write_text(f"{before}{BEGIN}\n\n{text.strip()}\n\n{END}{after}", encoding="utf-8")


def check_pages(page: Path) -> None:
    """Check both pages; raises DataError for missing marks, OutputError for a page that cannot be written."""
    for path in (page, scenes_page(page)):
        check_creatable(path)
        _around(path, page)


def _around(path: Path, page: Path) -> tuple[str, str]:
    """Return the text before and after the marks of ``path``: ``page`` or its scenes page."""
    try:
        before, begin, rest = path.read_text(encoding="utf-8").partition(BEGIN)
    except FileNotFoundError:
        return "# Presets judged\n\n" if path == page else f"# Each scene of {literal(page.name)}\n\n", "\n"
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise DataError("the marks are missing", path=path, expected=f"{BEGIN} and {END}")
    return before, after


def summary(table: Table, about: str, beside: str) -> str:
    """Return the main page: method, means, comparisons, and one line per scene with a link to ``beside``."""
    parts = [literal(about), "### Means over sequences", *_means(table), "### Who beats whom", *_duels(table)]
    return "\n\n".join([*parts, "### Each scene", *_overview(table, beside)])


def scenes(table: Table, about: str, pictures: Mapping[str, str] | None = None) -> str:
    """Return each scene's table, and each preset's worst picture; all collapsed."""
    parts = [literal(about)]
    for scene, rows in _by_scene(table).items():
        parts += [f"## {literal(scene)}", _collapsed("all presets and scores", _scene_table(rows))]
    if pictures:
        parts.append("## Each preset's worst")
        for name, text in pictures.items():
            caption, _, picture = text.partition("\n\n")
            line = f"<b>{literal(name)}.</b> {literal(caption)}"
            parts.append(_collapsed(line, picture) if picture else line)
    return "\n\n".join(parts)


def _collapsed(summary: str, text: str) -> str:
    return f"<details><summary>{summary}</summary>\n\n{text}\n\n</details>"


def _overview(table: Table, beside: str) -> Iterable[str]:
    """Yield the table with one line per scene and a link to its own: the best published preset, then its contenders."""
    names = _names(table.rows)
    shown = {name: [name] for name in contenders(names)}
    if others := [name for name in names if published(name)]:
        yield "*Published*: the best preset of an article or an engine, cell by cell."
        shown = {"best published": others} | shown
    columns = [column for column in COLUMNS if column.name in OVERVIEW]
    heads = [f"{column.head} {title}" for column in columns for title in shown]
    lines = []
    for scene, rows in _by_scene(table).items():
        cells = []
        for column in columns:
            groups = [
                [_best(column, (row.presets[name].scores for name in group if name in row.presets)) for row in rows]
                for group in shown.values()
            ]
            leaders = [_best(column, ({column.name: group[n]} for group in groups)) for n in range(len(rows))]
            for group in groups:
                cells.append(" / ".join(_cell(v, column, best) for v, best in zip(group, leaders, strict=True)))
        lines.append([f"[{scene}]({quote(os.fsencode(beside))}#{_anchor(printable(scene))})", *cells])
    yield markdown(["scene", *heads], lines, figures=True).rstrip()
    yield _splits(table.means)


def _anchor(heading: str) -> str:
    """Return GitHub's anchor of a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def _means(table: Table) -> Iterable[str]:
    yield "PSNR is averaged as mean squared error, samples by the geometric mean, all else by the arithmetic mean."
    yield _grid({name: [table.means[split][name] for split in table.means] for name in ordered(_names(table.rows))})
    yield _splits(table.means)


def _duels(table: Table) -> Iterable[str]:
    """Yield one line for each pair; better means both lower FLIP and higher PSNR."""
    if not table.duels:
        yield "Nothing to compare: no preset of an article or an engine was judged, or none beside it."
        return
    lines = []
    for duel in table.duels:
        flip, psnr = (f"{a:{form}} : {b:{form}}" for (a, b), form in ((duel.mean_flip, ".4f"), (duel.mean_psnr, ".2f")))
        losses = ", ".join(duel.not_better) or "–"
        lines.append([duel.preset, duel.against, f"{duel.better} of {duel.sequences}", flip, psnr, losses])
    yield "*Better*: both lower FLIP and higher PSNR."
    yield markdown(["preset", "against", "better in", "mean FLIP", "mean PSNR", "not better in"], lines).rstrip()


def _scene_table(rows: list[Row]) -> str:
    names = ordered(_names(rows))
    grid = _grid({name: [row.presets[name].scores for row in rows] for name in names})
    broken = [
        literal(f"{name}: {row.presets[name].not_finite} values that are not finite in {row.key}")
        for row in rows
        for name in names
        if row.presets[name].not_finite
    ]
    return "\n\n".join([grid, _splits(row.split for row in rows), *broken])


def _splits(splits: Iterable[str]) -> str:
    splits = list(splits)
    return f"Each cell: {' / '.join(splits)}." if len(splits) > 1 else f"All: {splits[0]}."


def _grid(cells: Mapping[str, list[dict[str, float | None]]]) -> str:
    """Return a Markdown table of presets by scores, with the best resolve of each column in bold."""
    columns = columns_of(values for several in cells.values() for values in several)
    heads = [column.head for column in columns]
    lines = []
    resolves = [values for name, values in cells.items() if name != ONE_SAMPLE] or [*cells.values()]
    best = [[_best(column, (values[n] for values in resolves)) for n in range(len(resolves[0]))] for column in columns]
    for name, values in cells.items():
        texts = []
        for column, leaders in zip(columns, best, strict=True):
            pairs = zip(values, leaders, strict=True)
            texts.append(" / ".join(_cell(each.get(column.name), column, best) for each, best in pairs))
        lines.append([name, *texts])
    return markdown(["preset", *heads], lines, figures=True).rstrip()


def _best(column: Measure, scores: Iterable[dict[str, float | None]]) -> float | None:
    """Return the best value of a column; for shares around 0 the one nearest to 0."""
    values = [value for each in scores if (value := each.get(column.name)) is not None]
    if not values:
        return None
    return max(values) if column.higher_is_better else min(values, key=abs)


def _cell(value: float | None, column: Measure, best: float | None) -> str:
    text = written(value, column)
    return f"**{text}**" if value is not None and value == best else text


def written(value: float | None, column: Measure) -> str:
    """Format a score for tables."""
    return "–" if value is None else "∞" if math.isinf(value) else format(value, column.form)


def _by_scene(table: Table) -> dict[str, list[Row]]:
    titles = dict.fromkeys(row.scene for row in table.rows)
    return {title: [row for row in table.rows if row.scene == title] for title in titles}


def _names(rows: Iterable[Row]) -> list[str]:
    return list(dict.fromkeys(name for row in rows for name in row.presets))
