"""What ``cltaa bench quality`` makes of its cells: means, who beats whom, the pages and the pictures."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

import pytest

from cltaa.core.presets import load_preset
from cltaa.errors import DataError, OutputError
from cltaa.lab.bench.cases import HELD_OUT, TRAIN
from cltaa.lab.bench.cells import ONE_SAMPLE, Judged
from cltaa.lab.bench.quality.pictures import FAULTS, caption, write_pictures
from cltaa.lab.bench.quality.table import (
    BEGIN,
    END,
    check_pages,
    ordered,
    scenes,
    scenes_page,
    summarise,
    summary,
    write_pages,
)
from cltaa.printable import literal
from cltaa.reference.launcher import NumpyLauncher
from tests.lab.bench.quality_cells import case, scores

NUMPY = NumpyLauncher()


def test_means_and_duels_follow_from_the_scores() -> None:
    table = summarise(
        [
            (case("a"), {"default": scores(psnr=30.0, flip=0.1, samples=2.0), "simvx": scores(psnr=20.0, flip=0.2)}),
            (case("b"), {"default": scores(psnr=20.0, flip=0.1, samples=8.0), "simvx": scores(psnr=30.0, flip=0.2)}),
            (case("a", HELD_OUT), {"default": scores(psnr=25.0, flip=None), "simvx": scores(psnr=20.0, flip=0.2)}),
        ]
    )
    assert list(table.means) == [TRAIN, HELD_OUT]
    means = table.means[TRAIN]["default"]
    assert means["samples"] == pytest.approx(4.0)
    assert means["flip"] == pytest.approx(0.1)
    assert means["psnr"] == pytest.approx(-10 * math.log10((1e-3 + 1e-2) / 2))
    assert table.means[HELD_OUT]["default"]["flip"] is None
    (duel,) = table.duels
    assert (duel.preset, duel.against, duel.better, duel.sequences) == ("default", "simvx", 1, 3)
    assert duel.not_better == ["b (train)", "a (held-out)"]


def test_a_preset_of_the_user_is_compared_with_the_published_ones() -> None:
    better, worse = scores(psnr=30.0, flip=0.1), scores(psnr=20.0, flip=0.2)
    table = summarise(
        [(case("a"), {ONE_SAMPLE: worse, "basic": better, "mine": better, "karis": worse, "fast": better})]
    )
    assert [(duel.preset, duel.against, duel.better) for duel in table.duels] == [
        ("mine", "karis", 1),
        ("fast", "karis", 1),
    ]
    alone = summary(summarise([(case("a"), {"karis": worse})]), "about", "scenes.md")
    assert "no preset of an article or an engine was judged, or none beside it" in alone


def test_a_psnr_without_end_is_the_best_there_is() -> None:
    """A sequence on which a preset is the truth itself must not lower its mean, nor be lost to what errs there."""
    right = {"default": scores(psnr=math.inf, flip=0.0), "simvx": scores(psnr=60.0, flip=0.2)}
    table = summarise([(case("a"), right), (case("b"), {"default": scores(psnr=30.0), "simvx": scores(psnr=30.0)})])
    assert table.means[TRAIN]["default"]["psnr"] == pytest.approx(-10 * math.log10(1e-3 / 2))
    assert table.duels[0].not_better == ["b (train)"]
    alone = scenes(summarise([(case("a"), right)]), "about")
    assert "| default | **∞** |" in alone
    assert "| simvx | 60.00 |" in alone


def test_a_model_goes_by_its_file() -> None:
    table = summarise([(case("file:/some/where/Box.glb"), {"default": scores(psnr=30.0)})])
    assert [row.scene for row in table.rows] == ["file:Box.glb"]


def test_presets_stand_in_their_families() -> None:
    names = ["fast", "zebra", "default", "karis", "simvx", "basic", "babylon-reproject", ONE_SAMPLE, "fsr3-like"]
    assert ordered(names) == [
        ONE_SAMPLE,
        "babylon-reproject",
        "simvx",
        "fsr3-like",
        "karis",
        "basic",
        "fast",
        "default",
        "zebra",
    ]


def test_the_pages_need_their_marks(tmp_path: Path) -> None:
    """Those that are not there are begun, but no other file is written over."""
    page, beside, table = (
        tmp_path / "a page.md",
        tmp_path / "a page-scenes.md",
        summarise([(case("a"), {"basic": scores()})]),
    )
    with pytest.raises(OutputError):
        check_pages(tmp_path / "none" / "page.md")
    check_pages(page)
    assert not list(tmp_path.iterdir())
    write_pages(page, table, "about")
    assert page.read_text(encoding="utf-8").startswith(f"# Presets judged\n\n{BEGIN}\n\nabout")
    page.write_text(f"{BEGIN} and no end", encoding="utf-8")
    with pytest.raises(DataError, match=r"page\.md: the marks are missing"):
        check_pages(page)
    page.write_text(f"{BEGIN}{END}", encoding="utf-8")
    beside.write_text("mine", encoding="utf-8")
    with pytest.raises(DataError, match=r"page-scenes\.md: the marks are missing"):
        check_pages(page)
    beside.unlink()
    write_pages(page, table, "about")
    assert beside.read_text(encoding="utf-8").startswith("# Each scene of a page.md\n\n<!--")
    beside.write_text(beside.read_text(encoding="utf-8").replace("# Each scene", "# Mine"), encoding="utf-8")
    write_pages(page, table, "another")
    assert beside.read_text(encoding="utf-8").startswith(f"# Mine of a page.md\n\n{BEGIN}\n\nanother\n\n## a\n")


def test_the_tables_mark_the_best_resolve_and_say_who_lost() -> None:
    table = summarise(
        [
            (
                case("a"),
                {ONE_SAMPLE: scores(blur=0.0), "default": scores(blur=-0.1, psnr=30.0), "bevy": scores(blur=0.2)},
            ),
        ]
    )
    text = summary(table, "about", "scenes.md")
    assert "| **-0.100** |" in text
    assert "| 0.000 |" in text
    assert "| default | bevy | 0 of 1 | 1.0000 : 1.0000 | 30.00 : 1.00 | a (train) |" in text
    text = scenes(table, "about", {"bevy": "caption\n\n![bevy](bevy.png)", "gather-48": "The same."})
    shown = "<details><summary><b>bevy.</b> caption</summary>\n\n![bevy](bevy.png)\n\n</details>"
    assert text.endswith(f"{shown}\n\n<b>gather-48.</b> The same.")


def test_each_scene_has_a_line_that_leads_to_its_table() -> None:
    """With what is compared with the published presets: not the lower tiers, but whatever is new."""
    cells = {
        "gather-8": scores(flip=0.3),
        "gather-48": scores(flip=0.1, samples=9.0),
        "default": scores(flip=0.2, samples=3.0),
    }
    cells |= {"bevy": scores(flip=0.4, samples=2.0), "simvx": scores(flip=0.5, samples=2.5)}
    cells |= {"my own.toml": scores(flip=0.3, samples=4.0)}
    titles = ("file:/a/Two words.glb", "pan")
    table = summarise([(case(title, split), cells) for title in titles for split in (TRAIN, HELD_OUT)])
    text = summary(table, "about", "a page-scenes.md")
    of = ["best published", "default", "gather-48", "my own.toml"]
    head = [f"{score} {name}" for score in ("flip ↓", "samples ↑") for name in of]
    assert f"| scene | {' | '.join(head)} |\n| --- |{' ---: |' * len(head)}\n" in text
    flip = "0.4000 / 0.4000 | 0.2000 / 0.2000 | **0.1000** / **0.1000** | 0.3000 / 0.3000"
    values = f"{flip} | 2.5 / 2.5 | 3.0 / 3.0 | **9.0** / **9.0** | 4.0 / 4.0"
    assert f"| [pan](a%20page-scenes.md#pan) | {values} |" in text
    assert f"| [file:Two words.glb](a%20page-scenes.md#filetwo-wordsglb) | {values} |" in text
    assert "\n\n## pan\n\n<details><summary>all presets and scores</summary>\n\n| preset |" in scenes(table, "about")
    alone = summary(summarise([(case("pan"), {"mine": scores()})]), "about", "scenes.md")
    assert "### Each scene\n\n| scene | flip ↓ mine | samples ↑ mine |" in alone


def pages_of(name: str, folder: Path) -> str:
    """Return both pages of a scene, a preset and a page of that name, without the anchors of headings."""
    cells = {
        "default": scores(),
        "karis": scores(),
        name: Judged(scores=scores().scores, frames=4, not_finite=9, device=""),
    }
    page = folder / "page.md"
    write_pages(page, summarise([(case(name), cells)]), f"of {name}", {name: f"{name} errs\n\n![](a.png)"})
    texts = [path.read_text(encoding="utf-8") for path in (page, scenes_page(page))]
    return re.sub(r"md#[^)]*\)", "md#)", "".join(texts))


@pytest.mark.parametrize("name", ["a|b", "a<b>c", "a\nb", "a&lt;b", os.fsdecode(b"a\xffb")])
def test_no_name_breaks_a_page(name: str, tmp_path: Path) -> None:
    """Cells end at a bar, a tag may never end, and what is not UTF-8 cannot be written."""
    assert not {*"|<\n"} & {*literal(name)}
    assert pages_of(name, tmp_path) == pages_of("NAME", tmp_path).replace("NAME", literal(name))


def test_a_preset_that_is_the_default_gets_no_picture(tmp_path: Path) -> None:
    """And what earlier runs drew of it, or of a preset that is not asked for, goes; what they did not draw stays."""
    table = summarise([(case("a"), {"default": scores(psnr=30.0), "fast": scores(psnr=30.0)})])
    (tmp_path / "pictures").mkdir()
    for name in ("fast", "karis", "mine"):
        (tmp_path / "pictures" / f"{name}.png").write_bytes(b"of before")
    texts = write_pictures(table, {}, [load_preset("fast")], tmp_path / "pictures", None, NUMPY)
    assert texts == {"fast": "The same as default on every sequence."}
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["mine.png"]


def test_a_preset_that_is_nowhere_worse_gets_no_picture(tmp_path: Path) -> None:
    cells = [{"default": scores(flip=0.2), "gather-48": scores(flip=flip)} for flip in (0.1, 0.2)]
    table = summarise([(case(name), cell) for name, cell in zip("ab", cells, strict=True)])
    texts = write_pictures(table, {}, [load_preset("gather-48")], tmp_path / "pictures", None, NUMPY)
    assert texts == {"gather-48": "By FLIP worse than default on no sequence."}


def test_a_caption_names_the_worst_fault_beside_those_of_the_others() -> None:
    """And no fault of which nothing is known, as over time of few frames."""
    others = {"default": scores(flicker=0.1, blur=0.1), "karis": scores(flicker=0.1, blur=0.1)}
    (row,) = summarise([(case("a"), {**others, "fast": scores(flicker=0.2, blur=0.4)})]).rows
    assert caption(row, "fast", 7) == "a (train), frame 7: blur 0.400."
    unknown = dict.fromkeys(FAULTS)
    (row,) = summarise([(case("a"), {**others, "fast": scores(**unknown)})]).rows
    assert caption(row, "fast", 7) == "a (train), frame 7."
