"""The report in a real browser: that it works, by mouse and keyboard, at any width."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import msgspec
import pytest
from PIL import Image as Pillow

from cltaa.lab.bench.accuracy.measurement import Accuracy
from tests.lab.bench.browser import Browser, choose, missing
from tests.lab.bench.tiny_report import PRESET

pytestmark = pytest.mark.skipif(missing() is not None, reason=missing() or "")
ENTER, RIGHT, DOWN = "\ue007", "\ue014", "\ue015"


def stage(window: Browser, folder: Path) -> str:
    """What the viewer shows once its pictures are there and drawn, as a hash."""
    window.run("return Promise.all(loaded.values()).then(() => new Promise((done) => setTimeout(done)))")
    window.run("document.getElementById('stage').scrollIntoView()")
    window.picture(folder / "stage.png", whole=False)
    box = "const r = document.getElementById('stage').getBoundingClientRect();"
    left, top, right, bottom = window.run(f"{box} return [r.x, r.y, r.right, r.bottom]")
    shown = Pillow.open(folder / "stage.png").crop((left, top, right, bottom))
    return hashlib.sha256(shown.tobytes()).hexdigest()


def test_console_stays_clean(window: Browser) -> None:
    assert window.log() == []


def test_numbers_of_a_table_are_plain_and_frames_lie_evenly(window: Browser) -> None:
    assert window.run("return [0, 1, 0.000857, 0.00195, 7.734, 157.2, 1753.1, 12345.6, 4.21e-7].map(number)") == [
        "0",
        "1",
        "0.000857",
        "0.00195",
        "7.73",
        "157",
        "1753",
        "12346",
        "4.21e-7",
    ]
    assert window.run("return [5e-4, 1e4, 2e-5].map(tick)") == ["0.0005", "10000", "2e-5"]
    assert window.run("return [wholeTicks(0, 7), wholeTicks(4, 4), wholeTicks(0, 63)]") == [
        [0, 2, 4, 6],
        [4],
        [0, 20, 40, 60],
    ]


def test_what_all_else_is_compared_with_goes_by_its_name(window: Browser) -> None:
    """Not "default": the ladder may depart from another preset, and the default be a row of its own."""
    assert window.run("return state.a") == PRESET
    assert window.run("return document.querySelector('#numbers th:nth-child(4)').textContent") == f"× {PRESET}"
    assert f"as a multiple of those of {PRESET}" in window.run("return document.body.textContent")
    assert PRESET in window.run("return document.getElementById('frames-legend').textContent")
    window.run("window.kept = current().noisy; current().noisy = true; drawAll()")
    assert f"{PRESET} " in window.run("return document.getElementById('noise').textContent")
    window.run("current().noisy = false; drawAll()")
    assert f"{PRESET} " not in window.run("return document.getElementById('noise').textContent")
    window.run("current().noisy = window.kept; drawAll()")


def test_what_there_is_nothing_of_is_not_shown(window: Browser) -> None:
    """No steps where the default alone was measured, and no switch for a supersampling that has no time."""
    shown = "return ['steps', 'yard'].map((id) => !document.getElementById(id).parentElement.hidden)"
    assert window.run(shown) == [True, False]
    window.run(
        "report.sequences[0].cells.splice(1); report.sequences[0].yardstick[0].added = 1; drawSteps(); drawFront()"
    )
    assert window.run(shown) == [False, True]
    window.open(Path(window.run("return decodeURI(location.pathname)")))
    window.until("return document.getElementById('under').width === 37")


def test_slider_moves_the_picture(window: Browser, tmp_path: Path) -> None:
    choose(window, "a", "truth")
    choose(window, "b", "one sample")
    seen = set()
    for place in ("0", "500", "1000"):
        window.run(
            "const s = document.getElementById('slide'); s.value = arguments[0]; s.dispatchEvent(new Event('input'))",
            place,
        )
        seen.add(stage(window, tmp_path))
    assert len(seen) == 3
    before = stage(window, tmp_path)
    window.run("document.getElementById('slide').value = 500; document.getElementById('slide').focus()")
    window.press(RIGHT)
    assert window.run("return document.getElementById('slide').value") == "501"
    assert stage(window, tmp_path) != before


def test_a_picture_against_itself_has_no_difference(window: Browser) -> None:
    script = (
        "const u = document.getElementById('under'), c = new OffscreenCanvas(u.width, u.height).getContext('2d');"
        "c.drawImage(u, 0, 0); const d = c.getImageData(0, 0, u.width, u.height).data;"
        "return Math.max(...d.filter((v, i) => i % 4 < 3))"
    )
    choose(window, "mode", "difference")
    choose(window, "a", "truth")
    choose(window, "b", "truth")
    window.until(f"return (() => {{ {script} }})() === 0")
    choose(window, "b", "one sample")
    window.until(f"return (() => {{ {script} }})() > 50")
    choose(window, "mode", "slider")


@pytest.mark.parametrize("mode", ["flip", "count"])
def test_maps_are_pictures_of_their_own(window: Browser, tmp_path: Path, mode: str) -> None:
    choose(window, "a", PRESET)
    choose(window, "b", PRESET)
    plain = stage(window, tmp_path)
    choose(window, "mode", mode)
    window.until("return document.getElementById('under').width === 37")
    assert stage(window, tmp_path) != plain
    choose(window, "mode", "slider")


def test_zoom_and_arrow_keys(window: Browser, tmp_path: Path) -> None:
    fit = stage(window, tmp_path)
    choose(window, "zoom", "4")
    near = stage(window, tmp_path)
    assert near != fit
    window.run("document.getElementById('stage').focus()")
    window.press(RIGHT)
    assert stage(window, tmp_path) != near
    choose(window, "zoom", "1")
    window.run("document.activeElement.blur()")


def test_a_point_shows_its_frame_by_keyboard(window: Browser) -> None:
    choose(window, "a", "truth")
    window.run("document.querySelector('[data-variant=\"build: strict\"]').focus()")
    assert "build: strict" in window.run("return document.getElementById('point').textContent")
    window.press(ENTER)
    window.until("return document.getElementById('tag-a').textContent === 'build: strict'")
    assert window.run("return document.getElementById('a').value") == "build: strict"


@pytest.mark.parametrize(("part", "things"), [("front", ".point"), ("steps", "button.step")])
def test_many_things_are_one_stop_of_the_tab_key(window: Browser, part: str, things: str) -> None:
    stops = f"[...document.querySelectorAll('#{part} {things}')]"
    assert window.run(f"return {stops}.length") > 2
    assert window.run(f"return {stops}.filter(s => s.tabIndex === 0).length") == 1
    window.run(f"{stops}.find(s => s.tabIndex === 0).focus()")
    seen = set()
    for _ in range(window.run(f"return {stops}.length") + 1):  # once more than there are: the last one stays
        seen.add(window.run("return document.activeElement.dataset.variant || document.activeElement.ariaLabel"))
        window.press(RIGHT)
    assert len(seen) == window.run(f"return {stops}.length")
    assert window.run(f"return {stops}.filter(s => s.tabIndex === 0).length") == 1


def test_noise_lines_are_drawn_and_named(window: Browser, report: Path) -> None:
    choose(window, "metric", "mse")
    measured = msgspec.json.decode((report / "accuracy.json").read_bytes(), type=Accuracy).sequences[0]
    (one,) = (row.errors["mse"].mean for row in measured.yardstick if row.samples == 1)
    assert measured.mean_noise == pytest.approx(one * 0.1 / 1.9)  # weight 0.1
    drawn = window.run("return document.getElementById('front').textContent")
    named = window.run("return document.getElementById('front-legend').textContent")
    for text in (drawn, named):
        assert "noise of an exponential mean, weight 0.1" in text
    assert "copy speed" in named
    choose(window, "metric", "flip")
    assert "exponential" not in window.run("return document.getElementById('front-legend').textContent")
    choose(window, "metric", "mse")


def test_rounding_is_an_axis_of_its_own(window: Browser) -> None:
    choose(window, "metric", "rounding")
    assert "half an ulp" in window.run("return document.getElementById('front').textContent")
    assert window.run("return document.querySelectorAll('#front .sample').length") == 0
    choose(window, "metric", "mse")


def test_an_axis_on_which_nothing_errs_was_measured(window: Browser) -> None:
    """As after --rounding-frames 1: a first frame is not rounded."""
    choose(window, "metric", "rounding")
    cells, front = "current().cells", "return document.getElementById('front').textContent"
    window.run(f"window.kept = {cells}")
    for rounding, said in (("null", "this axis was not measured"), ("{rms: 0, frames: [0]}", "nothing errs here")):
        window.run(f"{cells} = window.kept.map((c) => ({{ ...c, rounding: {rounding} }})); drawFront()")
        assert window.run(front) == said
    window.run(f"{cells} = window.kept; drawFront()")
    choose(window, "metric", "mse")


def test_bits_are_those_of_the_terminal(window: Browser) -> None:
    column = "drawNumbers(); return document.querySelector('#numbers tbody tr').cells[6].textContent"
    rounding = "current().cells[0].rounding"
    window.run(f"window.kept = {rounding}")
    seen = [window.run(f"{rounding} = {each}; {column}") for each in ("null", "{rms: 0}", "{rms: 2 ** -24.5}")]
    assert seen == ["–", "all", "24.5"]
    window.run(f"{rounding} = window.kept; drawNumbers()")


def test_without_supersampling_the_points_spread_out(window: Browser) -> None:
    marks = "return document.querySelectorAll('#front .sample').length"
    # Made-up frames have no times; give the yardstick one, as a capture does.
    window.run("current().yardstick.forEach((y, i) => { y.added = 1e6 * i }); drawFront()")
    assert window.run(marks) == 1
    spread = (
        "const x = [...document.querySelectorAll('#front .point:not(.sample) circle')].map(c => +c.getAttribute('cx'));"
    )
    spread += "return Math.max(...x) - Math.min(...x)"
    narrow = window.run(spread)
    window.run("document.getElementById('yard').click()")
    assert window.run(marks) == 0
    assert window.run(spread) > narrow
    window.run("document.getElementById('yard').click()")


def test_samples_that_are_the_truth_itself_have_no_place_on_the_plot(window: Browser) -> None:
    # As many samples as the truth has are its own: no error, which no logarithm shows.
    window.run("current().yardstick.forEach((y, i) => { y.added = 1e6 * i })")
    window.run("const y = current().yardstick.at(-1); y.kept = y.errors.mse.mean; y.errors.mse.mean = 0; drawFront()")
    assert window.run("return document.querySelectorAll('#front .sample').length") == 0
    assert "Infinity" not in window.run("return document.getElementById('front').innerHTML")
    window.run("const y = current().yardstick.at(-1); y.errors.mse.mean = y.kept; drawFront()")
    assert window.run("return document.querySelectorAll('#front .sample').length") == 1


def test_several_sequences_stand_in_one_table(window: Browser) -> None:
    assert window.run("return document.getElementById('several').hidden")
    window.run(
        "const s = structuredClone(report.sequences[0]); s.name = 'second'; pictures.second = pictures[current().name];"
        "s.cells[1].errors.mse.mean *= 4; report.sequences.push(s);"
        "document.getElementById('sequence').append(new Option('second', 1)); drawAll()"
    )
    cells = "[...document.querySelectorAll('#overview tbody tr:last-child td')].map(c => c.textContent)"
    mean, first, second = window.run(f"return {cells}")
    assert float(second) == pytest.approx(4 * float(first), rel=0.01)
    assert float(mean) == pytest.approx(2 * float(first), rel=0.01)
    window.run("document.querySelector('#overview tbody tr:last-child td:last-child button').click()")
    assert window.run("return [state.sequence, state.a]") == [1, "arithmetic: double"]
    places = "[...document.querySelectorAll('#overview button')]"
    window.run(f"{places}.find(p => p.tabIndex === 0).focus()")
    window.press(DOWN)  # a row is as long as there are sequences
    assert window.run(f"return {places}.indexOf(document.activeElement)") == 2
    window.size(400, 900)
    assert window.run("return document.documentElement.scrollWidth") == 400
    window.size(1280, 900)
    window.run("report.sequences.pop(); document.getElementById('sequence').lastChild.remove(); state.sequence = 0")
    window.run("document.getElementById('sequence').value = 0; drawAll()")


def test_more_decibels_are_better_and_may_have_no_end(window: Browser) -> None:
    """PSNR, infinite in the last frame (JSON: null): up is better, more is green, and nothing is drawn at infinity."""
    window.run(
        "const s = current(); report.metrics.push('psnr');"
        "report.kept = [...s.frames]; s.frames = s.frames.map(n => 4 * n);"
        "[...s.cells, ...s.yardstick].forEach((row, i) => { row.errors.psnr ="
        "{mean: 20 + 2 * i, p5: 19 + i, p95: null, largest: null, frames: [19 + i, 20 + i, 21 + i, null]} });"
        "restored(report); state.metric = 'psnr'; drawAll()"
    )
    assert window.run("return document.getElementById('better').textContent") == "up"
    assert window.run("return document.querySelector('.step[data-variant] i').className") == "better"
    for place in ("front", "frames"):
        drawn = window.run(f"return document.querySelector('#{place} svg').innerHTML")
        assert "to ∞" in drawn or place == "frames"
        assert not {"Infinity", "NaN", "null"} & set(re.findall(r"Infinity|NaN|null", drawn))
    axis = "[...document.querySelectorAll('#frames text[text-anchor=middle]')].map(t => +t.textContent)"
    assert max(window.run(f"return {axis}")) > 3  # frames 0 to 12, 4 apart
    window.run(
        "current().frames = report.kept; report.metrics.pop(); state.metric = 'mse'; drawAll();"
        "[...current().cells, ...current().yardstick].forEach(row => { delete row.errors.psnr })"
    )
    assert window.run("return document.getElementById('better').textContent") == "down"


def test_a_sequence_on_which_nothing_errs_says_so(window: Browser) -> None:
    window.run(
        "kept = structuredClone(current().cells); current().cells.forEach((c) => {"
        "Object.assign(c.errors.mse, {mean: 0, p5: 0, p95: 0, frames: [0, 0, 0, 0]}) }); drawAll()"
    )
    assert window.run("return document.getElementById('front').textContent") == "nothing errs here"
    steps = window.run("return document.getElementById('steps').innerHTML")
    assert "–" in steps
    assert "NaN" not in steps
    window.run("current().cells.forEach((c, i) => { c.errors = kept[i].errors }); drawAll()")


def test_a_sequence_without_frames_says_so(window: Browser) -> None:
    shown = (
        "['stage', 'slide-row', 'debug', 'no-pictures'].map(id => document.getElementById(id).offsetParent !== null)"
    )
    assert window.run(f"return {shown}") == [True, True, True, False]
    window.run("kept = pictures[current().name]; delete pictures[current().name]; drawAll()")
    assert window.run(f"return {shown}") == [False, False, False, True]
    assert window.run("return [...document.getElementById('a').options].some(o => o.value === 'arithmetic: double')")
    window.run("document.querySelector('.point[data-variant]').dispatchEvent(new Event('click'))")
    assert window.run("return document.querySelectorAll('#frames path').length") >= 2  # errors are there all the same
    window.run("pictures[current().name] = kept; drawAll()")
    assert window.run(f"return {shown}") == [True, True, True, False]


def test_still_no_errors_after_all_that(window: Browser) -> None:
    assert window.log() == []
