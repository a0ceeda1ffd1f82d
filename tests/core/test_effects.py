"""The plan changes time and not the picture: steps that a frame does not call for change no bit when they run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from cltaa.core.backend import Launcher
from cltaa.core.build import source_hash
from cltaa.core.parameters import Illumination, Rectify, Reject, Weighting
from cltaa.core.plan import CHANGING_LIGHT, Reason, plan_frame, with_effects
from cltaa.core.presets import Preset, load_preset, override, preset_names
from cltaa.core.resolver import Resolver
from cltaa.frame import Camera, Effect, Frame
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.reference.launcher import NumpyLauncher
from tests.sequence_factory import WIDTH, make_camera, make_frame

DEFAULT = load_preset("default")
STANDING = make_camera()
# What a frame calls for -> how it is made.
CALLS: dict[str, dict[str, object]] = {
    "nothing": {"camera": STANDING, "effects": frozenset()},
    "a still camera": {"camera": STANDING, "effects": frozenset({Effect.ILLUMINATION, Effect.HDR})},
    "a moving camera": {"effects": frozenset({Effect.CAMERA, Effect.HDR})},
    "own motion": {"camera": STANDING, "motion": True, "effects": frozenset({Effect.MOTION, Effect.HDR})},
    "alpha and reactive": {"alpha": True, "reactive": True, "effects": frozenset({Effect.CAMERA, Effect.ALPHA})},
    "an undeclared camera that stands": {"camera": STANDING, "effects": None},
    "undeclared": {"motion": True, "alpha": True, "reactive": True, "effects": None},
}


# Every case on NumPy, whose bits strict builds have, and one on the device too, where each costs two builds.
CASES = [*(("numpy", name) for name in CALLS), ("device", "alpha and reactive")]


def frames(calls: dict[str, object], count: int = 4) -> Iterator[Frame]:
    for index in range(count):
        yield make_frame(index, **calls)  # type: ignore[arg-type]


@pytest.mark.parametrize(("where", "name"), CASES)
def test_every_step_gives_the_same_bits(where: str, name: str) -> None:
    launcher: Launcher = DeviceLauncher() if where == "device" else NumpyLauncher()
    calls = CALLS[name]
    planned, every = Resolver(device=launcher, strict=True), Resolver(device=launcher, strict=True, every_step=True)
    for frame in frames(calls):
        one, other = planned.resolve(frame), every.resolve(frame)
        assert one.dtype == other.dtype == np.float32
        assert one.tobytes() == other.tobytes()
    assert planned.plan is not None
    assert every.plan is not None
    assert all(getattr(every.plan.steps, n) for n in ("camera_motion", "own_motion", "exposure", "alpha", "reactive"))
    assert planned.plan.choices == every.plan.choices  # what is replaced is decided by the promise, not by the steps


def test_few_kernels_serve_a_sequence_whose_camera_stops_and_cuts() -> None:
    launcher = DeviceLauncher()
    resolver = Resolver(device=launcher)
    walking = [make_camera((0.1 * min(i, 4), 0.0, 5.0)) for i in range(9)]
    for index, camera in enumerate(walking):
        resolver.resolve(make_frame(index, camera=camera, cut=index == 6))
    # One for the steps with the camera's motion, one for those without; on a GPU one more extends edges for both.
    others = [] if launcher.device.is_cpu else ["extend_edges"]
    assert sorted(name for name, _ in launcher._kernels) == [*others, "pack", "resolve", "resolve", "unpack"]


def reasons(frame: Frame, previous: Camera | None) -> dict[str, tuple[bool, str]]:
    return {reason.step: (reason.on, reason.why) for reason in plan_frame(DEFAULT, frame, previous).reasons}


def test_a_camera_that_stops_is_not_reprojected() -> None:
    frame = make_frame(1, camera=STANDING)
    assert reasons(frame, make_camera((1.0, 0.0, 5.0)))["reprojection"] == (True, "the camera moves")
    assert reasons(frame, None)["reprojection"] == (True, "no previous frame: the camera may move")
    assert reasons(frame, STANDING)["reprojection"] == (False, "the camera stands still")


def test_depth_is_asked_where_something_is_disoccluded() -> None:
    for preset, effects, rejects in [
        ("default", {Effect.CAMERA}, False),
        ("default", {Effect.ILLUMINATION}, False),
        ("default", {Effect.CAMERA, Effect.DISOCCLUSION}, True),
        ("default", None, True),
        ("gather-48", {Effect.CAMERA}, True),  # a sample in the ring is chosen by its depth
        ("filament", {Effect.CAMERA}, False),  # published: never does
    ]:
        frame = make_frame(1, effects=None if effects is None else frozenset(effects))
        plan = plan_frame(load_preset(preset), frame, STANDING)
        assert (plan.choices.reject is Reject.DEPTH) is rejects, (preset, effects)
        assert [reason.on for reason in plan.reasons if reason.step == "rejection"] == [rejects], (preset, effects)


@pytest.mark.parametrize("name", [name for name in preset_names() if load_preset(name).published])
def test_nothing_is_left_out_of_what_somebody_published(name: str) -> None:
    preset = load_preset(name)
    # What is told in widths of the picture is worked out for it.
    widths = {"motion_px": WIDTH * preset.settings.motion_widths} if preset.settings.motion_widths else {}
    for effects in [None, frozenset(), frozenset({Effect.CAMERA}), frozenset(Effect)]:
        plan = plan_frame(preset, make_frame(1, effects=effects), make_camera((1.0, 0.0, 5.0)))
        assert plan.choices == preset.choices, effects
        assert plan.settings == msgspec.structs.replace(preset.settings, **widths), effects


def test_what_may_change_anything_is_no_plain_mean() -> None:
    def rectify(*effects: Effect) -> Rectify:
        return plan_frame(DEFAULT, make_frame(1, effects=frozenset(effects)), STANDING).choices.rectify

    assert rectify(Effect.HDR, Effect.CUT) is Rectify.NONE
    light = {Effect.ILLUMINATION, Effect.REACTIVE, Effect.EXPOSURE}
    for effect in {Effect.CAMERA, Effect.MOTION, Effect.DISOCCLUSION} | light:
        assert rectify(effect) is DEFAULT.choices.rectify, effect


def test_among_noise_bright_samples_count_as_much_as_dim_ones() -> None:
    frame = make_frame(1, effects=frozenset({Effect.ILLUMINATION, Effect.HDR, Effect.NOISE}))
    for preset, box in ((DEFAULT, 1.0), (load_preset("fast"), 0.5)):
        plan = plan_frame(preset, frame, STANDING)
        assert plan.choices.weighting is Weighting.NONE
        assert Reason("luminance weights", False, "effect noise is declared") in plan.reasons
        given, planned = preset.settings, plan.settings
        assert planned.falling_t > given.falling_t
        assert planned.box_scale_static == planned.box_scale_moving == box * given.box_scale_static


def test_among_noise_less_evidence_shows_that_light_changes() -> None:
    test = ("illumination_t", "illumination_decay", "illumination_floor")
    for preset in map(load_preset, ("default", "basic", "fast")):
        changing = frozenset({Effect.ILLUMINATION, Effect.CAMERA})
        clean, noisy, still = (
            plan_frame(preset, make_frame(1, effects=frozenset(effects)), make_camera((1.0, 0.0, 5.0))).settings
            for effects in (changing, {*changing, Effect.NOISE}, {Effect.CAMERA, Effect.THIN, Effect.NOISE})
        )
        for name in test:
            assert getattr(noisy, name) < getattr(clean, name), name
            assert getattr(still, name) == getattr(clean, name), name
        assert noisy.blend_weight == clean.blend_weight
    gathers = load_preset("gather-8")  # the ring decides there, and the recursion beside it is tuned with it
    frame = make_frame(1, effects=frozenset({Effect.ILLUMINATION, Effect.NOISE}))
    assert plan_frame(gathers, frame, STANDING).settings.illumination_t == gathers.settings.illumination_t


def test_the_filter_beside_a_ring_fades_later_where_light_changes_and_among_noise() -> None:
    samples = [
        plan_frame(load_preset("gather-8"), make_frame(1, effects=frozenset(effects)), None).settings.filter_samples
        for effects in (CHANGING_LIGHT, {*CHANGING_LIGHT, Effect.NOISE}, {Effect.MOTION}, {Effect.CAMERA, Effect.NOISE})
    ]
    assert samples == [4.0, 8.0, 1.0, 1.0]


@pytest.mark.parametrize("name", ["basic", "fast"])
def test_a_box_takes_the_illumination_test_where_light_changes_among_noise(name: str) -> None:
    def light(preset: Preset, *effects: Effect) -> Illumination:
        return plan_frame(preset, make_frame(1, effects=frozenset(effects)), STANDING).choices.illumination

    boxed = load_preset(name)
    changing = (Effect.ILLUMINATION, Effect.NOISE)
    assert light(boxed, *changing) is Illumination.TEST
    reason = Reason("illumination change", True, "effect noise is declared: a box that it widens keeps wrong history")
    assert reason in plan_frame(boxed, make_frame(1, effects=frozenset(changing)), STANDING).reasons
    for others in ((Effect.ILLUMINATION,), (Effect.NOISE,), (Effect.NOISE, Effect.CAMERA)):
        assert light(boxed, *others) is Illumination.STATIC, others
    no_box = override(boxed, {"rectify": "none"})
    assert light(no_box, *changing) is Illumination.STATIC


def test_own_motion_is_not_read_where_the_preset_follows_the_camera_alone() -> None:
    camera = override(DEFAULT, {"reproject": "camera"})
    assert not plan_frame(camera, make_frame(1, motion=True), make_camera((1.0, 0.0, 5.0))).steps.own_motion
    assert plan_frame(DEFAULT, make_frame(1, motion=True), make_camera((1.0, 0.0, 5.0))).steps.own_motion


def test_named_effects_leave_the_others_out() -> None:
    frame = make_frame(0, motion=True, alpha=True, reactive=True)
    kept = with_effects(frame, frozenset({Effect.MOTION}))
    assert kept.motion is frame.motion
    assert kept.alpha is None
    assert kept.reactive is None
    assert kept.effects == frozenset({Effect.MOTION})
    assert with_effects(frame, "auto") is frame
    assert with_effects(frame, "all").effects is None


def test_plain_weights_stay_within_their_bound_of_luminance_weights() -> None:
    """One blend: with r = (knee + Y_h) / (knee + Y_x), the weight changes by (sqrt r - 1) / (sqrt r + 1) at most.

    That is the largest value of w r / (w r + 1 - w) - w, at w = 1 / (1 + sqrt r). docs/effects.md.
    """
    preset = override(DEFAULT, {"rectify": "none", "disocclusion_blur": 0.0, "current_filter": "none"})
    rng = np.random.default_rng(0)
    colours = rng.random((2, 23, 37, 3), np.float32)
    results = []
    for effects in ({Effect.ILLUMINATION}, {Effect.ILLUMINATION, Effect.HDR}):
        resolver = Resolver(preset, device="numpy")
        for index, colour in enumerate(colours):
            frame = make_frame(index, camera=STANDING, effects=frozenset(effects))
            image = resolver.resolve(replace(frame, colour=colour, depth=np.ones_like(frame.depth)))
        results.append(image)
    history, current = colours
    luminance = colours @ np.array([0.25, 0.5, 0.25])  # colour.h
    root = np.sqrt((4.0 + luminance[0]) / (4.0 + luminance[1]))
    bound = np.abs((root - 1.0) / (root + 1.0))[..., None] * np.abs(current - history)
    difference = np.abs(results[0] - results[1])
    # Two blends of numbers below 1, some ten roundings each.
    assert (difference <= bound + 20.0 * 2.0**-24).all()
    assert (difference > 0.9 * bound).mean() > 0.5


def test_what_does_not_gather_runs_the_program_of_the_default() -> None:
    launcher = DeviceLauncher()

    def run(preset: str) -> tuple[str, bytes]:
        resolver = Resolver(preset, launcher, strict=True)
        image = [resolver.resolve(frame) for frame in frames(CALLS["nothing"], 3)][-1]
        assert resolver.last is not None
        return source_hash("resolve", resolver.last.build), image.tobytes()

    assert run("gather-8") == run("default")
