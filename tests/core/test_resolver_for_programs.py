"""The resolver as a program uses it: what is checked and told, names, threads and types."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Thread, get_ident
from typing import Any, assert_type

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.core.bands import BandedResolver
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import INSIDE, Resolver
from cltaa.errors import DataError, UsageError
from cltaa.frame import Camera
from cltaa.io.sequence import open_sequence
from cltaa.reference.launcher import NumpyLauncher
from tests.core.standing import still_frame
from tests.sequence_factory import bits, make_camera, make_frame, write_sequence


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
    in_the_midst()  # after the other it may
    assert len(told) == 1
    vars(resolver)[INSIDE] = get_ident()  # as an interrupt may leave it
    assert resolver.resolve(still_frame(2)).shape == first.shape
    in_the_midst()
    assert len(told) == 1


@pytest.mark.parametrize("kind", [Resolver, BandedResolver])
def test_every_method_refuses_a_second_thread(kind: type[Resolver]) -> None:
    """But those that say what it is made of, which do not change."""
    resolver = Resolver(device="numpy")
    methods = {name for name, _ in inspect.getmembers(kind, inspect.isfunction) if not name.startswith("_")}
    assert {"resolve", "reset", "restore", "release", "reserve", "reopen"} <= methods
    for name in methods - {"settings"}:
        vars(resolver)[INSIDE] = get_ident() + 1
        with pytest.raises(UsageError, match="two threads use one resolver at once"):
            getattr(kind, name)(resolver)


def test_a_device_may_be_named_by_its_number_and_a_launcher_shared() -> None:
    first = Resolver(device=0)
    assert Resolver(device="0").launcher.description == first.launcher.description
    assert Resolver(device=first.launcher).launcher is first.launcher


def test_frames_and_sequences_are_told_in_a_line(tmp_path: Path) -> None:
    assert repr(make_frame(3, motion=True, cut=True)) == "Frame(3: 37 x 23, colour depth motion, cut)"
    sequence = open_sequence(write_sequence(tmp_path / "a", 2))
    assert repr(sequence) == f"FrameSequence({str(tmp_path / 'a')!r}: 2 frames, 0-1, 37 x 23)"


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
    assert override(load_preset(), {"box_scale_static": np.float32(2)}).settings.box_scale_static == 2.0
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
