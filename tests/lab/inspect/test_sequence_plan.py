"""The plan of a sequence: sections of frames with one plan, from headers alone, and what the steps cost."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import asdict

import cltaa
from cltaa.cli import main
from cltaa.core.parameters import Illumination, ReactiveMask, Reproject
from cltaa.core.plan import CHOICE_OF_STEP, LIGHT, STEP_NAMES, plan_frame, toggled
from cltaa.core.presets import Preset, load_preset
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect
from cltaa.lab.inspect import plan as sequence_plan
from cltaa.lab.inspect.plan import SequencePlan
from cltaa.pipeline import folder
from tests.inputs.foreign import frames as foreign_frames
from tests.inputs.foreign import write_blender
from tests.sequence_factory import make_camera, make_frame, write_frames

WALK = (0, 1, 2, 2, 2, 3, 4)  # steps of the camera: it stands on frames 3 and 4; frame 5 is a cut
STEPS = [
    "reprojection",
    "own motion",
    "exposure",
    "alpha",
    "reactive",
    "illumination change",
    "rectification",
    "rejection",
    "luminance weights",
]


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    shown: dict[str, Any] = {"reactive": True, "effects": frozenset({Effect.CAMERA, Effect.CUT, Effect.REACTIVE})}
    cameras = enumerate(make_camera((0.1 * place, 0.0, 5.0)) for place in WALK)
    made = (make_frame(index, camera=camera, cut=index == 5, **shown) for index, camera in cameras)
    return write_frames(tmp_path_factory.mktemp("walk"), made, "walk")


def running(plan: SequencePlan) -> list[tuple[int, int, bool, set[str]]]:
    return [(s.first, s.last, s.starts, {step.name for step in s.steps if step.on}) for s in plan.sections]


@pytest.mark.parametrize("asked", ["keep", "clamp"])
def test_the_kernel_is_the_one_that_a_resolve_runs(asked: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the fireflies of the profile."""
    built = list[str]()

    class Recorded(Resolver):
        def __init__(self, preset: Preset, *given: Any, **named: Any) -> None:
            built.append(str(preset.choices.fireflies))
            super().__init__(preset, *given, **named)

    write_blender(tmp_path, foreign_frames(2))
    sequence = cltaa.open(tmp_path, assignments=[f"colour.fireflies={asked}"])
    monkeypatch.setattr(sequence_plan, "Resolver", Recorded)
    monkeypatch.setattr(folder, "Resolver", Recorded)
    cltaa.plan(sequence, device="numpy", rounds=0)
    cltaa.resolve(sequence, tmp_path / "out", device="numpy")
    assert built == [asked, asked]


def test_a_camera_that_stops_and_a_cut_make_spans(walk: Path) -> None:
    plan = cltaa.plan(cltaa.open(walk), device="numpy", rounds=0)
    moving = {"reprojection", "reactive", "illumination change"}
    assert running(plan) == [(0, 2, True, moving), (3, 4, False, moving - {"reprojection"}), (5, 6, True, moving)]
    assert plan.kernels == 2
    assert all([step.name for step in section.steps] == STEPS for section in plan.sections)
    assert all(step.why and step.milliseconds is None for section in plan.sections for step in section.steps)


@pytest.mark.parametrize("name", ["default", "gather-48"])
def test_a_step_is_turned_on_as_its_preset_has_it(name: str) -> None:
    preset, frame = load_preset(name), make_frame(effects=frozenset({Effect.CAMERA}))
    plan = plan_frame(preset, frame, None)
    assert plan.choices.illumination is Illumination.STATIC
    on = toggled(plan, preset, LIGHT).choices.illumination
    assert on is preset.choices.illumination is (Illumination.WINDOW if name == "gather-48" else Illumination.TEST)


@pytest.mark.parametrize("name", ["default", "gather-48"])
@pytest.mark.parametrize("effects", [None, frozenset({Effect.CAMERA})])
def test_no_other_step_is_turned_with_one(name: str, effects: frozenset[Effect] | None) -> None:
    preset, frame = load_preset(name), make_frame(effects=effects)
    plan = plan_frame(preset, frame, None)
    for step, on, _ in plan.reasons:
        other = toggled(plan, preset, step)
        turned, chosen = (
            dict(asdict(new).items() - asdict(old).items())
            for old, new in ((plan.steps, other.steps), (plan.choices, other.choices))
        )
        if step in CHOICE_OF_STEP:
            field, off, _ = CHOICE_OF_STEP[step]
            assert (turned, [*chosen], chosen[field] is off) == ({}, [field], on)
        else:
            assert chosen == {}
            assert [(STEP_NAMES[field], value) for field, value in turned.items()] == [(step, not on)]


@pytest.mark.parametrize(
    ("preset", "on", "why"),
    [
        ("basic", True, "the history may be wrong"),
        ("default", False, "the preset says rectify = none"),
        ("accumulate", False, "the preset says rectify = none"),
        ("gather-48", False, "the preset says rectify = none"),
        ("karis", True, "as published"),
        ("babylon-accumulate", False, "the preset says rectify = none"),
    ],
)
def test_rectification_runs_where_the_kernel_has_it(walk: Path, preset: str, on: bool, why: str) -> None:
    found = cltaa.plan(cltaa.open(walk), preset, device="numpy", rounds=0)
    told = [(step.on, step.why) for step in found.sections[0].steps if step.name == "rectification"]
    assert told == [(on, why)]


@pytest.mark.parametrize(
    ("preset", "without"),
    [
        ("accumulate", {"reproject", "rectify", "reject", "weighting", "illumination"}),
        ("fast", {"reject", "illumination"}),
        ("default", {"rectify"}),
        ("vireo-source", {"reject", "weighting", "illumination", "exposure_change", "reactive_mask"}),
    ],
)
def test_a_step_that_the_preset_switches_off_names_the_preset(walk: Path, preset: str, without: set[str]) -> None:
    found = cltaa.plan(cltaa.open(walk), preset, device="numpy", rounds=0, effects="all")
    off = [step.why for step in found.sections[0].steps if not step.on]
    assert {why.split()[3] for why in off if why.startswith("the preset says ")} == without
    assert not any("any may occur" in why for why in off)


def test_all_and_named_effects(walk: Path) -> None:
    sequence = cltaa.open(walk)
    (first, second) = cltaa.plan(sequence, device="numpy", rounds=0, effects="all").sections
    assert all(step.on != (step.name == "rectification") for section in (first, second) for step in section.steps)
    assert (first.first, first.last, second.first, second.last) == (0, 4, 5, 6)
    named = cltaa.plan(sequence, device="numpy", rounds=0, effects=frozenset({Effect.CAMERA}))
    assert running(named)[0] == (0, 2, True, {"reprojection"})


def test_every_step_is_timed_on_and_off(walk: Path) -> None:
    plan = cltaa.plan(cltaa.open(walk), device="numpy", rounds=3)
    for section in plan.sections:
        assert section.milliseconds is not None
        assert section.every_milliseconds is not None
        assert min(section.milliseconds, section.every_milliseconds) > 0.0
        assert all(step.milliseconds is not None for step in section.steps)
    # Frames with one plan share their times: it is measured once.
    first, second, third = (
        [section.milliseconds, *(step.milliseconds for step in section.steps)] for section in plan.sections
    )
    assert first == third
    assert first != second


@pytest.mark.parametrize("preset", ["accumulate", "vireo-source"])
def test_a_step_of_a_channel_that_a_preset_never_reads_is_not_timed(walk: Path, preset: str) -> None:
    section = cltaa.plan(cltaa.open(walk), preset, device="numpy", rounds=1).sections[0]
    reads = load_preset(preset).choices
    without = {"own motion"} if reads.reproject is not Reproject.FULL else set()
    without |= {"reactive"} if reads.reactive_mask is ReactiveMask.IGNORE else set()
    assert {step.name for step in section.steps if step.milliseconds is None} == without != set()


def test_the_command_prints_the_plan_by_sections(walk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(walk), "--plan", "--device", "numpy", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [(section["first"], section["last"]) for section in found["sections"]] == [(0, 2), (3, 4), (5, 6)]
    assert main(["inspect", str(walk), "--plan", "--device", "numpy"]) == 0
    out = capsys.readouterr().out
    assert "frames 3 to 4" in out
    assert "with every step that leaves the bits as they are (" in " ".join(out.split())
    assert "the camera stands" in out
    assert "frames 5 to 6, history begins: as frames 0 to 2" in out
