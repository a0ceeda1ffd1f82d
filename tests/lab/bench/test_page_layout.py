"""How the report lies on a wide and a narrow page, in a real browser, and its colours by day and night."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import pytest

from tests.lab.bench.browser import Browser, choose, missing

pytestmark = pytest.mark.skipif(missing() is not None, reason=missing() or "")


def drawn_at(window: Browser, width: int) -> None:
    """Wait until the front is drawn anew for a page of this width."""
    window.size(width, 900)
    window.until(
        "const f = document.getElementById('front');return f.firstChild.viewBox.baseVal.width === f.clientWidth"
    )


@pytest.mark.parametrize("width", [1280, 400])
def test_nothing_is_wider_than_the_page(window: Browser, width: int) -> None:
    drawn_at(window, width)
    assert window.run("return document.documentElement.scrollWidth") == width
    smallest = window.run(
        "return Math.min(...[...document.querySelectorAll('#front text')].map(t => t.getBoundingClientRect().height))"
    )
    assert smallest >= 11  # pixels: letters are not scaled down with the plot
    window.size(1280, 900)


def test_a_control_that_is_hidden_leaves_no_row_on_a_narrow_page(window: Browser) -> None:
    window.size(400, 900)
    lowest = """const rows = [...document.querySelectorAll("#choices label")].filter(
        (label) => getComputedStyle(label).display !== "none").map((label) => label.getBoundingClientRect().bottom);
        return [Math.max(...rows), rows.length]"""
    with_gain = {}
    for mode in ("slider", "difference"):
        choose(window, "mode", mode)
        with_gain[mode] = window.run(lowest)
    assert with_gain["slider"][0] < with_gain["difference"][0] - 30
    assert [rows for _, rows in with_gain.values()] == [4, 5]
    choose(window, "mode", "slider")
    window.size(1280, 900)


NAMES = """return [...document.querySelectorAll('#front .point text')].map(t => t.getBoundingClientRect())
    .map(b => [b.left, b.right, b.top, b.bottom])"""


def overlaps(boxes: list[list[float]]) -> list[tuple[list[float], list[float]]]:
    """The pairs of names of which one covers the other; 2 pixels of a line's height are the space between lines."""
    return [
        (one, other)
        for one, other in combinations(boxes, 2)
        if not (one[1] <= other[0] or other[1] <= one[0] or one[3] <= other[2] + 2 or other[3] <= one[2] + 2)
    ]


@pytest.mark.parametrize("width", [1280, 400])
def test_no_name_covers_another(window: Browser, width: int) -> None:
    drawn_at(window, width)
    boxes = window.run(NAMES)
    assert boxes
    assert not overlaps(boxes)


def test_no_name_of_wide_letters_covers_another_wherever_the_points_lie(window: Browser) -> None:
    window.run("window.was = JSON.stringify(report.sequences[0].cells)")
    for step in range(24):  # the second name's place goes from upon the first to far behind it
        boxes = window.run(
            f"""const cells = JSON.parse(window.was);
            cells.forEach((c, i) => {{ c.variant = 'W'.repeat(6); c.dominated_by = {{}}; groups[c.variant] = 'preset';
                c.errors[state.metric].mean = cells[0].errors[state.metric].mean;
                c.time.median = c.time.low = c.time.high = 100 / {1 + step / 20} ** i; }});
            report.sequences[0].cells = cells; drawFront(); {NAMES}"""
        )
        assert boxes
        assert not overlaps(boxes)
    window.run("report.sequences[0].cells = JSON.parse(window.was); delete groups.WWWWWW; drawFront()")


@pytest.mark.parametrize("width", [1280, 400])
def test_no_name_covers_the_axis(window: Browser, width: int) -> None:
    drawn_at(window, width)
    window.run("report.sequences[0].cells.forEach((c) => { c.variant += ' x'.repeat(100); }); drawFront()")
    left = window.run(
        "return [...document.querySelectorAll('#front .point text')].map(t => t.getBoundingClientRect().left)"
    )
    axis = window.run("return document.querySelector('#front .grid[y1]').getBoundingClientRect().left")
    window.open(Path(window.run("return decodeURI(location.pathname)")))
    window.until("return document.getElementById('under').width === 37")
    assert all(at >= axis - 1 for at in left)


def test_the_theme_switches_and_switches_back(window: Browser) -> None:
    script = "return getComputedStyle(document.body).backgroundColor"
    first = window.run(script)
    window.run("document.getElementById('theme').click()")
    assert window.run(script) != first
    window.run("document.getElementById('theme').click()")
    assert window.run(script) == first


def test_on_paper_it_is_light_and_no_table_is_cut_off(window: Browser) -> None:
    colour = "return getComputedStyle(document.body).color"
    window.run("document.documentElement.dataset.theme = 'light'")
    light = window.run(colour)
    window.run("document.documentElement.dataset.theme = 'dark'")
    assert window.run(colour) != light
    window.size(700, 900)  # A4 at 96 pixels an inch, less the margins
    # As many columns as all metrics need.
    window.run("report.metrics.push(...Array(5).fill('flip')); drawNumbers()")
    wide = "return document.getElementById('numbers').getBoundingClientRect().right"
    assert window.run(wide) > 700
    window.medium("print")
    assert window.run(colour) == light
    assert window.run(wide) <= 700
    assert window.run("return getComputedStyle(document.getElementById('theme')).display") == "none"
    window.medium("")
    window.run("report.metrics.splice(-5); drawNumbers(); delete document.documentElement.dataset.theme")
    window.size(1280, 900)


@pytest.mark.parametrize("width", [1280, 700, 400])
def test_no_number_stands_on_a_bar(window: Browser, width: int) -> None:
    window.size(width, 900)
    boxes = window.run(
        "return [...document.querySelectorAll('.bar-box')].map(box => [...box.children])"
        ".map(both => both.map(e => e.getBoundingClientRect())).map(([bar, number]) => [bar.right, number.left])"
    )
    assert boxes
    assert all(bar <= number for bar, number in boxes)
    window.size(1280, 900)


def test_no_errors_after_all_that(window: Browser) -> None:
    assert window.log() == []
