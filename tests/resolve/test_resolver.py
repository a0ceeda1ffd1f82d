"""The resolver looked at in time: what accumulates, what starts anew, what never changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Thread, get_ident
from typing import Any, assert_type

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.devices.numpy_launcher import NumpyLauncher
from cltaa.errors import DataError, UsageError
from cltaa.frames import Camera, Effect, Frame
from cltaa.parameters.presets import load_preset, override
from cltaa.resolve.one_thread import INSIDE
from cltaa.resolve.resolver import Resolver
from cltaa.sequences.sources import open_sequence
from tests.sequence_factory import bits, make_camera, make_frame, write_sequence

STILL = frozenset({Effect.SKY})
UNIT_ROUNDOFF = 2.0**-24


def still_frame(index: int, **changes: object) -> Frame:
    """A frame whose camera stands; its colours are new in every frame, as if each had another jitter."""
    camera = make_camera()
    return replace(make_frame(index, camera=camera, effects=STILL), **changes)  # type: ignore[arg-type]


def panned(camera: Camera, pixels: int, width: int) -> Camera:
    """The camera shifted off-axis so that everything moves by whole pixels, whatever its depth."""
    clip = camera.view_to_clip.copy()
    clip[0, 2] += 2.0 * pixels / width
    return Camera(camera.world_to_view, clip)


@pytest.mark.parametrize("blur", [0.0, 1.0])  # of what appears amid pixels with a past
def test_first_frame_is_the_current_one(blur: float) -> None:
    frame, preset = still_frame(0), override(load_preset(), {"fresh_blur": blur})
    assert np.array_equal(bits(Resolver(preset).resolve(frame)), bits(frame.colour))


def test_still_sequence_is_the_mean_of_its_samples() -> None:
    plain = override(load_preset(), {"current_filter": "none"})
    resolver, total = Resolver(plain), np.zeros_like(still_frame(0).colour, np.float64)
    for index in range(64):
        frame = still_frame(index)
        total += frame.colour
        resolved = resolver.resolve(frame)
        largest = 4.0  # of the factory's colours
        # Each step h + w (x - h) rounds three times (3 u of the largest value) and later steps shrink what came before.
        assert np.abs(resolved - total / (index + 1)).max() <= 3 * UNIT_ROUNDOFF * largest * (index + 1)


@pytest.mark.parametrize("effects", [STILL, None])
def test_constant_image_keeps_its_bits(effects: frozenset[Effect] | None) -> None:
    colour = np.full_like(still_frame(0).colour, (0.3, 0.7, 0.1))
    resolver = Resolver()
    for index in range(20):
        resolved = resolver.resolve(still_frame(index, colour=colour, effects=effects))
        assert np.array_equal(bits(resolved), bits(colour))


@pytest.mark.parametrize("change", ["cut", "gap", "reset", "size"])
def test_history_starts_anew(change: str) -> None:
    # After a cut the default filters what was drawn; without its filter that is the frame itself, as for the others.
    resolver = Resolver(override(load_preset(), {"current_filter": "none"}) if change == "cut" else "default")
    for index in range(3):
        resolver.resolve(still_frame(index))
    frame = still_frame(3, cut=True) if change == "cut" else still_frame(9 if change == "gap" else 3)
    if change == "size":
        frame = replace(make_frame(3, width=50, height=20, camera=make_camera(), effects=STILL))
    if change == "reset":
        resolver.reset()
    assert np.array_equal(bits(resolver.resolve(frame)), bits(frame.colour))


def test_a_device_that_is_opened_again_has_no_history() -> None:
    resolver, fresh = Resolver(device="numpy"), Resolver(device="numpy")
    resolver.resolve(make_frame(0))
    resolver.reopen()
    np.testing.assert_array_equal(bits(resolver.resolve(make_frame(1))), bits(fresh.resolve(make_frame(1))))


@pytest.mark.parametrize("every_step", [False, True])
def test_what_is_restored_is_gone_on_from(every_step: bool) -> None:
    """Where every step runs, alpha of a frame without one has its memory too."""
    first, second = (Resolver(device="numpy", every_step=every_step) for _ in range(2))
    first.resolve(make_frame(0))
    past, buffers = first.recurrent()
    for name, target in second.restore(past).items():
        with target.mapped(write=True) as to, buffers[name].mapped(write=False) as source:
            to[...] = source
    np.testing.assert_array_equal(bits(second.resolve(make_frame(1))), bits(first.resolve(make_frame(1))))


def test_whole_pixel_motion_is_lossless() -> None:
    preset = override(load_preset(), {"rectify": "none", "reject": "none", "current_filter": "none"})
    resolver, shift = Resolver(preset), 3
    first = make_frame(0)  # declares the camera's motion only, so that no luminance weights enter
    first = replace(first, depth=np.full_like(first.depth, 4.0))
    resolver.resolve(first)
    second = replace(make_frame(1), depth=first.depth, camera=panned(first.camera, shift, first.width))
    resolved = resolver.resolve(second)
    # The off-axis term moved everything to the left, so the history of column x is column x + shift, weighing a half.
    history = first.colour[:, shift:]
    current = second.colour[:, :-shift]
    assert np.array_equal(bits(resolved[:, :-shift]), bits(history + np.float32(0.5) * (current - history)))


def test_what_comes_into_view_is_the_current_sample() -> None:
    resolver, shift = Resolver(override(load_preset(), {"current_filter": "none"})), 5
    first = make_frame(0, effects=None)
    flat = np.full_like(first.depth, 4.0)
    resolver.resolve(replace(first, depth=flat))
    second = replace(make_frame(1, effects=None), depth=flat, camera=panned(first.camera, shift, first.width))
    resolved = resolver.resolve(second)
    fresh = (resolved == second.colour).all(axis=-1)
    assert list(np.flatnonzero(fresh.all(axis=0))) == list(range(first.width - shift, first.width))


def test_strict_device_matches_numpy_bit_for_bit() -> None:
    device, oracle = Resolver(strict=True), Resolver(device="numpy")
    for index in range(4):
        frame = make_frame(index, motion=True, alpha=True, reactive=True, effects=None)
        assert np.array_equal(bits(device.resolve(frame)), bits(oracle.resolve(frame)))


def test_history_is_brought_to_the_exposure_of_now() -> None:
    plain = {
        "rectify": "none",
        "weighting": "none",
        "reject": "none",
        "light_change": "ignore",
        "current_filter": "none",
    }
    one, other = (Resolver(override(load_preset(), plain), "numpy") for _ in range(2))
    for index, exposure in enumerate((1.0, 2.0, 0.5, 4.0)):
        frame = still_frame(index, effects=None)
        steady, colour = one.resolve(frame), np.float32(exposure) * frame.colour
        resolved = other.resolve(replace(frame, colour=colour, exposure=exposure))
        assert np.array_equal(bits(resolved), bits(np.float32(exposure) * steady))


def test_a_mask_that_the_preset_ignores_changes_nothing() -> None:
    bare, masked = (Resolver(override(load_preset(), {"reactive_mask": "ignore"})) for _ in range(2))
    for index in range(3):
        frame = still_frame(index, effects=None)
        mask = np.full(frame.depth.shape, 0.8, np.float32)
        assert np.array_equal(bits(masked.resolve(replace(frame, reactive=mask))), bits(bare.resolve(frame)))


def test_alpha_is_resolved_with_colour() -> None:
    resolver = Resolver()
    for index in range(3):
        resolved = resolver.resolve(make_frame(index, alpha=True, effects=None))
    assert resolved.shape[-1] == 4
    assert resolved[..., 3].min() >= 0.0
    assert resolved[..., 3].max() <= 1.0


def test_wrong_shapes_are_refused() -> None:
    frame = still_frame(0)
    with pytest.raises(DataError, match=r"depth has the wrong shape .*expected \(23, 37\), found \(22, 37\)"):
        Resolver().resolve(replace(frame, depth=frame.depth[1:]))


@pytest.mark.parametrize(
    ("name", "spoilt", "found"),
    [
        ("colour", lambda a: (a * 50).astype(np.uint8), "expected float32, found uint8.*no linear light"),
        ("colour", lambda a: a.tolist(), "found list"),
        ("depth", lambda _: None, "depth is no array of floats .*found NoneType"),
        ("motion", lambda a: a.astype(np.int32), "motion is no array of floats .*found int32"),
        ("colour", lambda a: a[0, 0], "colour has the wrong shape"),
    ],
)
def test_what_is_no_picture_is_told_before_it_is_resolved(name: str, spoilt: Callable[[Any], Any], found: str) -> None:
    frame = make_frame(0, motion=True)
    with pytest.raises(DataError, match=found):
        Resolver(device="numpy").resolve(replace(frame, **{name: spoilt(getattr(frame, name))}))


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        (
            {"camera": Camera(np.eye(4), make_camera().view_to_clip.T)},
            "frame 1: matrix cltaa:viewToClip has a wrong",
        ),
        ({"camera": Camera(np.full((4, 4), np.nan), make_camera().view_to_clip)}, "cltaa:worldToView holds NaN"),
        ({"camera": Camera(np.eye(3), make_camera().view_to_clip)}, r"is no 4 x 4 matrix \(found \[3, 3\]\)"),
        ({"camera": Camera([[1.0]], make_camera().view_to_clip)}, r"is no 4 x 4 matrix \(found list\)"),  # type: ignore[arg-type]
        ({"jitter_px": (40.0, 0.0)}, r"no jitter \(expected two numbers of less than 2 pixels, found \(40.0, 0.0\)\)"),
        ({"camera": Camera(np.eye(4).astype(object), make_camera().view_to_clip)}, "no 4 x 4 matrix .*found object"),
        ({"camera": Camera(np.eye(4) + 0j, make_camera().view_to_clip)}, "no 4 x 4 matrix .*found complex128"),  # type: ignore[arg-type]
        ({"jitter_px": (0.1, 0.2, 0.3)}, "no jitter"),
        ({"jitter_px": ("0.1", "0.2")}, r"no jitter .*found \('0.1', '0.2'\)"),
        ({"jitter_px": (0.1j, 0)}, "no jitter"),
        ({"jitter_px": (0.1, (0.2, 0.3))}, "no jitter"),
        ({"jitter_px": (float("nan"), 0.0)}, "no jitter"),
        ({"colour": np.zeros((23, 37, 4), np.float32)}, r"expected \[H, W, 3\].*the fourth is alpha"),
        ({"colour": np.zeros((3, 23, 37), np.float32)}, "put the axis of the channels last"),
        ({"colour": np.zeros((23, 37), np.float32)}, "colour has the wrong shape"),
        ({"colour": np.zeros((0, 37, 3), np.float32)}, "at least one pixel"),
        ({"exposure": 0.0}, "cltaa:exposure is no exposure"),
        ({"exposure": None}, r"frame 1: exposure is wrong \(expected a number, found NoneType\)"),
        ({"exposure": "1"}, "exposure is wrong .*found '1'"),
        ({"camera": None}, "camera is wrong .*expected a cltaa.Camera"),
        ({"index": "1"}, r"index is wrong \(expected a whole number, found '1'\)"),
        ({"index": 1.5}, "index is wrong"),
        ({"cut": "no"}, r"cut is wrong \(expected True or False, found 'no'\)"),
        ({"effects": ["camera"]}, "effects are no set .*found list"),
        ({"effects": {"moton"}}, "unknown effect moton; did you mean motion?"),
        ({"step": 0}, r"frame 1: step is wrong \(expected a whole number from 1 on, found 0\)"),
    ],
)
def test_what_a_program_says_of_a_frame_is_checked_as_what_a_file_says(changes: dict[str, Any], found: str) -> None:
    resolver = Resolver(device="numpy")
    resolver.resolve(still_frame(0))
    with pytest.raises(DataError, match=found):
        resolver.resolve(replace(still_frame(1), **changes))


def test_what_is_no_frame_is_told_in_a_line() -> None:
    with pytest.raises(DataError, match=r"no frame \(expected a cltaa.Frame, found \[23, 37, 3\]\)"):
        Resolver(device="numpy").resolve(still_frame(0).colour)  # type: ignore[call-overload]


def test_a_second_thread_in_one_resolver_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    resolver, told = Resolver(device="numpy"), list[str]()

    def second() -> None:
        try:
            resolver.resolve(still_frame(1))
        except UsageError as error:
            told.append(str(error))

    def in_the_midst(*_: object) -> bool:
        thread = Thread(target=second)
        thread.start()
        thread.join()
        return False

    with monkeypatch.context() as patch:
        patch.setattr(resolver.launcher, "finish", in_the_midst)
        first = resolver.resolve(still_frame(0))
    assert told == ["two threads use one resolver at once; frames come in order: take one a thread"]
    assert np.array_equal(bits(first), bits(still_frame(0).colour))
    second()  # after the other it may
    assert len(told) == 1
    vars(resolver)[INSIDE] = get_ident()  # as an interrupt may leave it
    assert resolver.resolve(still_frame(2)).shape == first.shape
    second()
    assert len(told) == 1


@pytest.mark.parametrize("preset", ["default", "t3-200", "t4", "t5"])
def test_a_frame_that_was_interrupted_is_resolved_to_the_same_bits(
    preset: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, resolver = Resolver(preset), Resolver(preset)

    def interrupt() -> None:
        raise KeyboardInterrupt

    for index in range(4):
        frame = make_frame(index, effects=None)
        with monkeypatch.context() as patch:
            patch.setattr(resolver.launcher, "finish", interrupt)
            with pytest.raises(KeyboardInterrupt):
                resolver.resolve(frame)
        assert np.array_equal(bits(resolver.resolve(frame)), bits(whole.resolve(frame)))


def test_a_device_may_be_named_by_its_number_and_a_launcher_shared() -> None:
    first = Resolver(device=0)
    assert Resolver(device="0").launcher.description == first.launcher.description
    assert Resolver(device=first.launcher).launcher is first.launcher


def test_frames_and_sequences_are_told_in_a_line(tmp_path: Path) -> None:
    assert repr(make_frame(3, motion=True, cut=True)) == "Frame(3: 37 x 23, colour depth motion, cut)"
    sequence = open_sequence(write_sequence(tmp_path / "a", 2))
    assert repr(sequence) == f"Sequence({str(tmp_path / 'a')!r}: 2 frames, 0-1, 37 x 23)"


def test_an_image_whose_texels_32_bits_do_not_count_is_refused() -> None:
    frame = still_frame(0)
    large = np.broadcast_to(np.float32(1.0), (50_000, 50_000))
    frame = replace(frame, colour=np.broadcast_to(large[..., None], (50_000, 50_000, 3)), depth=large)
    with pytest.raises(DataError, match=r"the image is too large .*found 50000 x 50000"):
        Resolver(device="numpy").resolve(frame)


def test_the_variable_may_ask_for_numpy_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CLTAA_DEVICE", "numpy")
    assert isinstance(Resolver().launcher, NumpyLauncher)


def test_unknown_names_are_refused() -> None:
    with pytest.raises(UsageError, match=r"unknown preset nonsense; known presets: .*default"):
        Resolver("nonsense")
    with pytest.raises(UsageError, match="no OpenCL device matches nonsense"):
        Resolver(device="nonsense")
    assert override(load_preset(), {"gamma_still": np.float32(2)}).settings.gamma_still == 2.0
    with pytest.raises(UsageError, match=r"no such storage halff; did you mean half\?"):
        Resolver(storage="halff")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match=r"no preset .*found 3"):
        Resolver(3)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match=r"no device .*found 1\.5"):
        Resolver(device=1.5)  # type: ignore[arg-type]


@pytest.mark.parametrize("half", [False, True])
def test_a_type_checker_knows_what_a_result_is_made_of(half: bool) -> None:
    """``assert_type`` is for mypy, which looks at these files too (sh scripts/check)."""
    resolver, frame = Resolver(device="numpy"), still_frame(0)
    floats = assert_type(resolver.resolve(frame), NDArray[np.float32])
    halves = assert_type(resolver.resolve(frame, half=True), NDArray[np.float16])
    either = assert_type(resolver.resolve(frame, half=half), NDArray[np.float32] | NDArray[np.float16])
    assert [image.dtype for image in (floats, halves, either)] == [
        np.float32,
        np.float16,
        (np.float32, np.float16)[half],
    ]
