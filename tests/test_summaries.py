"""What README.md and docs/quality.md claim holds in the generated tables of docs/generated."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

TOP = Path(__file__).parents[1]
QUALITY, MEANS, SCENES = "docs/quality.md", "docs/generated/quality.md", "docs/generated/quality-scenes.md"
ENGINES = ("karis", "playdead", "godot", "filament", "bevy", "intel", "fsr3-like")
ARTICLES = (
    "vireo-article", "vireo-source", "simvx", "babylon-accumulate", "babylon-disable-on-camera-move",
    "babylon-reproject", "babylon-reproject-clamp",
)  # fmt: skip
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
    return {row["preset"]: row for row in table(page(MEANS).partition("### Means over sequences")[2], "psnr")}


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


def sequences() -> list[tuple[str, int]]:
    """Scene and seed of each: a few scenes were judged with seed 0 alone."""
    return [(scene, seed) for scene in scenes() for seed in range(scenes()[scene]["default"]["psnr"].count(" / ") + 1)]


def ahead(preset: str, others: tuple[str, ...], *, flip_alone: bool = False) -> int:
    """On how many sequences a preset has less FLIP and, unless that is all, a higher PSNR than each of the others."""

    def better(scene: str, other: str, seed: int) -> bool:
        flip = score(scene, other, "flip", seed) - score(scene, preset, "flip", seed)
        psnr = score(scene, preset, "psnr", seed) - score(scene, other, "psnr", seed)
        return flip > 0 and (flip_alone or psnr > 0)

    return sum(all(better(scene, other, seed) for other in others) for scene, seed in sequences())


def test_the_means_of_the_page_are_those_of_the_generated_table() -> None:
    rows = table(page(QUALITY), "samples at disocclusions")
    columns = {"samples": "samples", "PSNR, dB": "psnr", "FLIP": "flip", "samples at disocclusions": "disoccluded"}
    assert len(rows) >= 8
    for row in rows:
        preset = re.split(r",| \(", row["preset"])[0]
        for shown, column in columns.items():
            assert agree(row[shown], means()[preset][column]), (preset, column)


@pytest.mark.parametrize(
    ("goal", "preset", "others"),
    [
        ("every engine's preset", "default", ENGINES),
        ("every article's", "default", ARTICLES),
        ("of all of these", "gather-48", ENGINES + ARTICLES),
        ("of all of these", "gather-24+24", ENGINES + ARTICLES),
    ],
)
def test_the_goals_count_what_the_tables_show(goal: str, preset: str, others: tuple[str, ...]) -> None:
    row = next(row for row in table(page(QUALITY), "goal") if goal in row["goal"])
    count, every = ahead(preset, others), len(sequences())
    assert row["measured"].startswith(f"{count} of {every}")
    assert row[""].startswith("met" if count == every else "missed")


def test_the_default_is_ahead_of_published_presets_as_often_as_the_readme_says() -> None:
    count, others = len(sequences()), ENGINES + ARTICLES
    both, by_flip = ahead("default", others), ahead("default", others, flip_alone=True)
    said = f"ahead of all fourteen transcriptions on {both} of {count}, by FLIP alone on {by_flip} of {count}"
    assert said in " ".join(page("README.md").split())
