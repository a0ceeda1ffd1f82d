"""The tables of README.md and the goals of docs/quality.md say what the tables that they summarise say."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

TOP = Path(__file__).parents[1]
QUALITY, SCENES = "docs/quality.md", "docs/quality-scenes.md"
ENGINES = ("karis", "playdead", "godot", "filament", "bevy", "intel", "fsr3-native")
ARTICLES = (
    "vireo-article",
    "vireo-source",
    "simvx",
    "babylon-accumulate",
    "babylon-disable-on-camera-move",
    "babylon-reproject",
    "babylon-reproject-clamp",
)
LOWER = ("t0", "t1", "t2", "t3", "t4", "default")
Row = dict[str, str]


@cache
def page(name: str) -> str:
    return (TOP / name).read_text(encoding="utf-8")


def tables(text: str) -> Iterator[list[Row]]:
    """The tables of a page: each a list of rows, by the names of the columns; bold and arrows are left out."""
    for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        plain = re.sub(r"[*`↑↓]", "", block).splitlines()
        lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in plain]
        yield [dict(zip(lines[0], line, strict=True)) for line in lines[2:]]


def table(text: str, column: str) -> list[Row]:
    """The first table that has a column of that name."""
    return next(rows for rows in tables(text) if rows and column in rows[0])


def agree(shown: str, measured: str) -> bool:
    """Whether two numbers, or pairs of them, are one number rounded twice."""

    def digits(text: str) -> float:
        return 10.0 ** -len(text.partition(".")[2])

    pairs = list(zip(shown.split(" / "), measured.split(" / "), strict=False))
    return all(abs(float(a) - float(b)) <= 0.5001 * (digits(a) + digits(b)) for a, b in pairs)


@cache
def means() -> dict[str, Row]:
    return {row["preset"]: row for row in table(page(QUALITY).partition("### Means over sequences")[2], "psnr")}


@cache
def scenes() -> dict[str, dict[str, Row]]:
    """Scene -> preset -> scores of both seeds."""
    tables_of_scenes = page(SCENES).partition("## Each preset's worst")[0]
    parts = re.split(r"^## (.+)\n", tables_of_scenes, flags=re.MULTILINE)
    return {
        name: {row["preset"]: row for row in table(text, "psnr")}
        for name, text in zip(parts[1::2], parts[2::2], strict=True)
    }


def score(scene: str, preset: str, name: str, seed: int) -> float:
    return float(scenes()[scene][preset][name].split(" / ")[seed])


def ahead(preset: str, others: tuple[str, ...], or_level: bool = False) -> int:
    """On how many sequences a preset has less FLIP and a higher PSNR than each of the others, or as good ones."""

    def better(scene: str, other: str, seed: int) -> bool:
        flip = score(scene, other, "flip", seed) - score(scene, preset, "flip", seed)
        psnr = score(scene, preset, "psnr", seed) - score(scene, other, "psnr", seed)
        return min(flip, psnr) >= 0 if or_level else min(flip, psnr) > 0

    return sum(all(better(scene, other, seed) for other in others) for scene in scenes() for seed in (0, 1))


def preset_of(label: str) -> str:
    """The preset that a summary's row is about: ``default (t3)``, ``best of … (vireo-source)``, ``t5, the best``."""
    inside = re.search(r"\((\S+)\)$", label)
    names = (label.split(",")[0].split(" (")[0], inside[1] if inside else "", "one sample")
    return next(name for name in names if name in means())


def test_the_readme_says_what_the_tables_say() -> None:
    times = {row["variant"]: row["GPU time, 33 scenes"] for row in table(page("docs/accuracy-vs-time.md"), "variant")}
    rows = table(page("README.md"), "PSNR, dB")
    assert len(rows) >= 8
    for row in rows:
        preset = preset_of(row[""])
        for name, column in (("PSNR, dB", "psnr"), ("FLIP", "flip"), ("samples", "samples")):
            assert agree(row[name], means()[preset][column].split(" / ")[0]), (preset, name)
        assert agree(row["time"], times[preset]) if row["time"] else preset == "one sample"


def test_the_means_say_what_the_table_says() -> None:
    rows = table(page(QUALITY), "mean FLIP, train / held-out")
    columns = (("mean FLIP, train / held-out", "flip"), ("PSNR, dB", "psnr"), ("samples", "samples"))
    for row in rows:
        preset = preset_of(row["preset"])
        for name, column in (*columns, ("samples where uncovered", "uncovered")):
            assert agree(row[name], means()[preset][column]), (preset, name)


@pytest.mark.parametrize(
    ("goal", "preset", "others", "or_level"),
    [
        ("every engine's preset", "default", ENGINES, False),
        ("every article's", "default", ARTICLES, False),
        ("of all of these", "t5", ENGINES + ARTICLES, False),
        ("our own lower tiers", "t5", LOWER, True),
    ],
)
def test_the_goals_count_what_the_tables_show(goal: str, preset: str, others: tuple[str, ...], or_level: bool) -> None:
    row = next(row for row in table(page(QUALITY), "goal") if goal in row["goal"])
    count, every = ahead(preset, others, or_level), 2 * len(scenes())
    assert row["measured"].startswith(f"{count} of {every}")
    assert row[""].startswith("met" if count == every else "missed")


def test_what_the_readme_says_of_all_sequences_holds() -> None:
    promise = "`default`, `t4` and `t5` are better than each article's and each engine's resolve on all 35"
    assert promise in page("README.md")
    for preset in ("default", "t4", "t5"):
        assert ahead(preset, ENGINES + ARTICLES) == 2 * len(scenes()) == 70
