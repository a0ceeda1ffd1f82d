"""The table as Markdown, between two marks of a page that is written by hand, and of one beside it for each scene."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from urllib.parse import quote

from cltaa.bench.quality.judge import COLUMNS, ONE_SAMPLE, Column
from cltaa.bench.quality.summary import DEFAULT, Row, Table, best_engine, contenders, ordered, published, score
from cltaa.errors import DataError
from cltaa.files.atomic import atomic_path, check_creatable

BEGIN, END = "<!-- cltaa bench quality: begin -->", "<!-- cltaa bench quality: end -->"
OVERVIEW = ("flip", "samples")  # the scores of the table that has a line a scene


def scenes_page(page: Path) -> Path:
    """The page beside a page that holds each scene's own table: ``quality-scenes.md`` beside ``quality.md``."""
    return page.with_name(f"{page.stem}-scenes{page.suffix}")


def write_pages(page: Path, table: Table, about: str, pictures: Mapping[str, str] | None = None) -> None:
    """Replace what stands between the marks of a page and of that beside it; begin those that are not there.

    ``pictures`` is what ``write_pictures`` returns. Raises what ``check_pages`` does.
    """
    beside = scenes_page(page)
    for path, text in ((beside, scenes(table, about, pictures)), (page, summary(table, about, beside.name))):
        before, after = _around(path, page)
        with atomic_path(path) as temporary:
            temporary.write_text(f"{before}{BEGIN}\n\n{text.strip()}\n\n{END}{after}", encoding="utf-8")


def check_pages(page: Path) -> None:
    """That both can be written; raises DataError where one has no marks, OutputError where one cannot be."""
    for path in (page, scenes_page(page)):
        check_creatable(path)
        _around(path, page)


def _around(path: Path, page: Path) -> tuple[str, str]:
    """What stands before and behind the marks of ``page``, or of that beside it."""
    try:
        before, begin, rest = path.read_text(encoding="utf-8").partition(BEGIN)
    except FileNotFoundError:
        return "# Presets judged\n\n" if path == page else f"# Each scene of {page.name}\n\n", "\n"
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise DataError("the marks are missing", path=path, expected=f"{BEGIN} and {END}")
    return before, after


def summary(table: Table, about: str, beside: str) -> str:
    """What is to be seen at once: how it was made, means, who beats whom, a line a scene that leads to ``beside``."""
    parts = [about, "### Means over sequences", *_means(table), "### Who beats whom", *_duels(table)]
    return "\n\n".join([*parts, "### Each scene", *_overview(table, beside)])


def scenes(table: Table, about: str, pictures: Mapping[str, str] | None = None) -> str:
    """Each scene's table, and each preset at its worst; all collapsed."""
    parts = [about]
    for scene, rows in _by_scene(table).items():
        parts += [f"## {scene}", _collapsed("all presets and scores", _scene_table(rows))]
    if pictures:
        parts.append("## Each preset's worst")
        for name, text in pictures.items():
            caption, _, picture = text.partition("\n\n")
            line = f"<b>{name}.</b> {caption}"
            parts.append(_collapsed(line, picture) if picture else line)
    return "\n\n".join(parts)


def _collapsed(summary: str, text: str) -> str:
    return f"<details><summary>{summary}</summary>\n\n{text}\n\n</details>"


def _overview(table: Table, beside: str) -> Iterable[str]:
    """A line a scene, with a link to its table: the best published preset, then those that are held against it."""
    names = _names(table)
    shown = {name: [name] for name in contenders(names)}
    if others := [name for name in names if published(name)]:
        yield "*Published*: the best preset of an article or an engine, cell by cell."
        shown = {"best published": others} | shown
    columns = [column for column in COLUMNS if column.name in OVERVIEW]
    heads = [
        f"{column.name} {'↑' if column.higher_is_better else '↓'} {title}" for column in columns for title in shown
    ]
    lines = [f"| scene | {' | '.join(heads)} |", "|---|" + "---:|" * len(heads)]
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
        lines.append(f"| [{scene}]({quote(beside)}#{_anchor(scene)}) | {' | '.join(cells)} |")
    yield "\n".join(lines)
    yield _splits(table.means)


def _anchor(heading: str) -> str:
    """What GitHub calls a heading in links."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def _means(table: Table) -> Iterable[str]:
    yield "PSNR is averaged as mean squared error, samples by the geometric mean, all else by the arithmetic mean."
    yield _grid({name: [table.means[split][name] for split in table.means] for name in ordered(_names(table))})
    yield _splits(table.means)


def _duels(table: Table) -> Iterable[str]:
    """One line for each pair; better means a lower FLIP and a higher PSNR, both."""
    if not table.duels:
        yield "Nothing to compare: no preset of an article or an engine was judged, or none beside it."
        return
    lines = ["| preset | against | better in | mean FLIP | mean PSNR | not better in |", "|---|---|---|---|---|---|"]
    for duel in table.duels:
        flip, psnr = (f"{a:{form}} : {b:{form}}" for (a, b), form in ((duel.mean_flip, ".4f"), (duel.mean_psnr, ".2f")))
        losses = ", ".join(duel.not_better) or "–"
        lines.append(
            f"| {duel.preset} | {duel.against} | {duel.better} of {duel.sequences} | {flip} | {psnr} | {losses} |"
        )
    yield "*Better*: both lower FLIP and higher PSNR."
    yield "\n".join(lines)
    for split, means in table.means.items():
        engine = best_engine(means)
        if engine is not None and DEFAULT in means:
            yield f"Best engine's preset by mean FLIP ({split}): {engine}."


def _scene_table(rows: list[Row]) -> str:
    names = ordered(dict.fromkeys(name for row in rows for name in row.presets))
    grid = _grid({name: [row.presets[name].scores for row in rows] for name in names})
    broken = [
        f"{name}: {row.presets[name].not_finite} values that are not finite in {row.key}"
        for row in rows for name in names if row.presets[name].not_finite
    ]  # fmt: skip
    return "\n\n".join([grid, _splits(row.split for row in rows), *broken])


def _splits(splits: Iterable[str]) -> str:
    splits = list(splits)
    return f"Each cell: {' / '.join(splits)}." if len(splits) > 1 else f"All: {splits[0]}."


def _grid(cells: Mapping[str, list[dict[str, float | None]]]) -> str:
    """A Markdown table of presets by scores; the best resolve of each column stands in bold."""
    heads = [f"{column.name} {'↑' if column.higher_is_better else '↓'}" for column in COLUMNS]
    lines = [f"| preset | {' | '.join(heads)} |", "|---|" + "---:|" * len(heads)]
    resolves = [values for name, values in cells.items() if name != ONE_SAMPLE] or [*cells.values()]
    best = [[_best(column, (values[n] for values in resolves)) for n in range(len(resolves[0]))] for column in COLUMNS]
    for name, values in cells.items():
        texts = []
        for column, leaders in zip(COLUMNS, best, strict=True):
            pairs = zip(values, leaders, strict=True)
            texts.append(" / ".join(_cell(score(column.name, each), column, best) for each, best in pairs))
        lines.append(f"| {name} | {' | '.join(texts)} |")
    return "\n".join(lines)


def _best(column: Column, scores: Iterable[dict[str, float | None]]) -> float | None:
    """The best value of a column; for shares around 0 that is the one nearest to 0."""
    values = [value for each in scores if (value := score(column.name, each)) is not None]
    if not values:
        return None
    return max(values) if column.higher_is_better else min(values, key=abs)


def _cell(value: float | None, column: Column, best: float | None) -> str:
    text = written(value, column)
    return f"**{text}**" if value is not None and value == best else text


def written(value: float | None, column: Column) -> str:
    """A score as the tables have it."""
    return "–" if value is None else "∞" if math.isinf(value) else format(value, column.form)


def _by_scene(table: Table) -> dict[str, list[Row]]:
    titles = dict.fromkeys(row.scene for row in table.rows)
    return {title: [row for row in table.rows if row.scene == title] for title in titles}


def _names(table: Table) -> list[str]:
    return list(dict.fromkeys(name for row in table.rows for name in row.presets))
