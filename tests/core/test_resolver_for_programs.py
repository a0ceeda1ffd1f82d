"""The resolver as a program uses it: what is checked and told, names, threads and types."""

from __future__ import annotations

import copy
import inspect
import pickle
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Thread, get_ident
from typing import Any, assert_type

import numpy as np
import pytest
from numpy.typing import NDArray
from pyopencl import invoker

from cltaa.core.bands import BandedResolver
from cltaa.core.build import Build
from cltaa.core.cuts import Coarse, coarse_colours
from cltaa.core.plan import Reason
from cltaa.core.planes import haloed
from cltaa.core.presets import load_preset, override, preset_names
from cltaa.core.resolver import Resolver
from cltaa.errors import DataError, UsageError
from cltaa.frame import Camera, Frame
from cltaa.io.exr_write import write_frame
from cltaa.io.sequence import open_sequence
from cltaa.lab.judge.metrics import measure
from cltaa.process import INSIDE
from cltaa.reference.launcher import NumpyLauncher
from tests.core.standing import still_frame
from tests.sequence_factory import bits, make_camera, make_frame, write_sequence


@pytest.mark.parametrize(
    ("name", "spoilt", "found"),
    [
        ("colour", lambda a: (a * 50).astype(np.uint8), "expected float32, found uint8.*no linear light"),
        ("colour", lambda a: a.tolist(), r"found list\); give an array: np.asarray\(colour"),
        ("depth", lambda a: a.tolist(), "depth is no array of floats .*found list"),
        ("motion", lambda a: a.astype(np.int32), "motion is no array of floats .*found int32"),
        ("colour", lambda a: a[0, 0], "colour has the wrong shape"),
        ("depth", lambda a: a[1:], r"depth has the wrong shape .*expected \(23, 37\), found \(22, 37\)"),
        (
            "depth",
            lambda a: -a,
            r"no distance anywhere .*found -\S+ to -\S+\); it is positive before the camera",
        ),
        ("depth", lambda a: np.where(np.isinf(a), a, -a), "it is positive before the camera: depth=-depth"),
    ],
)
def test_an_invalid_image_is_refused_before_the_resolve(name: str, spoilt: Callable[[Any], Any], found: str) -> None:
    frame = make_frame(0, motion=True)
    with pytest.raises(DataError, match=found):
        Resolver(device="numpy").resolve(replace(frame, **{name: spoilt(getattr(frame, name))}))


SAID: list[tuple[dict[str, Any], str]] = [
    (
        {"camera": Camera(np.eye(4), make_camera().view_to_clip.T)},
        "frame 1: camera.view_to_clip has a wrong",
    ),
    ({"camera": Camera(np.full((4, 4), np.nan), make_camera().view_to_clip)}, "camera.world_to_view holds NaN"),
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
    ({"jitter_px": (0.1, float("nan"))}, "no jitter"),
    ({"jitter_px": np.array([0.1, np.nan])}, "no jitter"),
    ({"exposure": 10**400}, "no exposure"),
    ({"colour": np.zeros((23, 37, 4), np.float32)}, r"expected \[H, W, 3\].*the fourth is alpha"),
    ({"colour": np.zeros((3, 23, 37), np.float32)}, "put the axis of the channels last"),
    ({"colour": np.zeros((23, 37), np.float32)}, "colour has the wrong shape"),
    ({"colour": np.zeros((0, 37, 3), np.float32)}, "at least one pixel"),
    ({"exposure": 0.0}, "frame 1: exposure is no exposure"),
    ({"exposure": None}, r"frame 1: exposure is wrong \(expected a number, found NoneType\)"),
    ({"exposure": "1"}, "exposure is wrong .*found '1'"),
    ({"camera": 3}, "camera is wrong .*expected a cltaa.Camera"),
    ({"index": "1"}, r"index is wrong \(expected a whole number, found '1'\)"),
    ({"index": 1.5}, "index is wrong"),
    ({"cut": "no"}, r"cut is wrong \(expected True or False, found 'no'\)"),
    ({"cut": 7}, r"cut is wrong \(expected True or False, found 7\)"),
    ({"scene": None}, r"scene is wrong \(expected text, found NoneType\)"),
    ({"effects": ["camera"]}, "effects are no set .*found list"),
    ({"effects": {"moton"}}, r"frame 1: unknown effect moton; did you mean motion\?"),
    ({"step": 0}, r"frame 1: step is wrong \(expected a whole number from 1 on, found 0\)"),
]


def refusal(changes: dict[str, Any]) -> str:
    """What is said of the second of two frames."""
    resolver = Resolver(device="numpy")
    resolver.resolve(still_frame(0))
    with pytest.raises(DataError) as caught:
        resolver.resolve(replace(still_frame(1), **changes))
    return str(caught.value)


def test_what_a_program_says_of_a_frame_is_checked_as_what_a_file_says() -> None:
    for changes, found in SAID:
        assert re.search(found, refusal(changes)), changes


def test_an_array_in_place_of_a_frame_is_refused() -> None:
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
    times = len(told)  # as often as it waits for the device
    assert set(told) == {"two threads use one resolver at once; frames come in order: take one a thread"}
    assert np.array_equal(bits(first), bits(Resolver(device="numpy").resolve(still_frame(0))))
    in_the_midst()  # after the other it may
    assert len(told) == times
    vars(resolver)[INSIDE] = get_ident()  # as an interrupt may leave it
    assert resolver.resolve(still_frame(2)).shape == first.shape
    in_the_midst()
    assert len(told) == times


@pytest.mark.parametrize("call", [Resolver.feed, lambda resolver, frame: [*resolver.images([frame])]])
def test_what_waits_for_later_frames_is_one_threads_too(
    call: Callable[[Resolver, Frame], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    resolver, told = Resolver("gather-8", "numpy", look_ahead=1), list[str]()

    def reset() -> None:
        try:
            resolver.reset()
        except UsageError as error:
            told.append(error.what)

    def in_the_midst(frame: Frame) -> Coarse:
        thread = Thread(target=reset)
        thread.start()
        thread.join()
        return coarse_colours(frame)

    monkeypatch.setattr("cltaa.core.resolver.coarse_colours", in_the_midst)
    call(resolver, make_frame(0))
    assert set(told) == {"two threads use one resolver at once"}


@pytest.mark.parametrize("kind", [Resolver, BandedResolver])
def test_every_method_refuses_a_second_thread(kind: type[Resolver]) -> None:
    resolver = Resolver(device="numpy")
    methods = {name for name, _ in inspect.getmembers(kind, inspect.isfunction) if not name.startswith("_")}
    assert {"resolve", "reset", "restore", "release", "reserve", "reopen"} <= methods
    for name in methods:
        vars(resolver)[INSIDE] = get_ident() + 1
        given: list[Any] = {"feed": [make_frame(0)]}.get(name, [])
        frames = [[make_frame(0)]] if name == "images" else []
        method = partial(getattr(kind, name), resolver, *given, *frames)
        with pytest.raises(UsageError, match="two threads use one resolver at once"):
            list(method() if frames else [method()])


def test_pyopencl_keeps_no_struct_by_its_fields(monkeypatch: pytest.MonkeyPatch) -> None:
    """In its cache on disk it looks for them by size and compares fields: it would warn once one is renamed."""
    given, made = list[Any](), invoker.generate_enqueue_and_set_args

    def spy(*values: Any, **others: Any) -> Any:
        given.extend(values[3] or ())
        return made(*values, **others)  # type: ignore[no-untyped-call]

    monkeypatch.setattr(invoker, "generate_enqueue_and_set_args", spy)
    Resolver().resolve(make_frame(0))
    assert {None, np.void} <= set(given) <= {None, np.void, np.int32, np.float32}


def test_a_device_may_be_named_by_its_number_and_a_launcher_shared() -> None:
    first = Resolver(device=0)
    assert Resolver(device="0").launcher.description == first.launcher.description
    assert Resolver(device=first.launcher).launcher is first.launcher


def test_frames_and_sequences_are_reported_in_a_line(tmp_path: Path) -> None:
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


@pytest.mark.parametrize(("asked", "strict"), [({}, False), ({"strict": True}, True)])
def test_kernels_are_strict_only_where_it_is_asked_for(asked: dict[str, Any], strict: bool) -> None:
    built = set[bool]()

    class Noting(NumpyLauncher):
        def run(self, kernel: str, build: Build, *given: Any, **more: Any) -> None:
            if kernel == "resolve":
                built.add(build.strict)
            super().run(kernel, build, *given, **more)

    Resolver(device=Noting(), **asked).resolve(still_frame(0))
    assert built == {strict}


def test_unknown_names_are_refused() -> None:
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
    resolver, frames = Resolver(device="numpy"), [still_frame(index) for index in range(4)]
    floats = assert_type(resolver.resolve(frames[0]), NDArray[np.float32])
    halves = assert_type(resolver.resolve(frames[1], half=True), NDArray[np.float16])
    either = assert_type(resolver.resolve(frames[2], half=half), NDArray[np.float32] | NDArray[np.float16])
    buffer: NDArray[np.float16] = np.empty((23, 37, 3), np.float16)
    assert assert_type(resolver.resolve(frames[3], out=buffer), NDArray[np.float16]) is buffer
    assert [image.dtype for image in (floats, halves, either)] == [
        np.float32,
        np.float16,
        (np.float32, np.float16)[half],
    ]


NO_DEPTH: dict[str, Any] = {"depth": None}  # what a Frame takes, and has no attribute like


def test_without_depth_all_is_as_far_as_the_sky() -> None:
    """To the bit, though the steps that read depth do not run."""
    for preset in (name for name in preset_names() if not load_preset(name).settings.look_ahead):
        bare, told = Resolver(preset, "numpy"), Resolver(preset, "numpy")
        for index in range(3):
            frame = make_frame(index, camera=make_camera((0.2 * index, 0.0, 5.0)), motion=True, effects=None)
            sky = replace(frame, depth=np.full(frame.depth.shape, np.inf, np.float32))
            assert np.array_equal(bits(bare.resolve(replace(frame, **NO_DEPTH))), bits(told.resolve(sky))), preset
        assert bare.plan is not None, preset
        assert Reason("rejection", False, "no depth") in bare.plan.reasons, preset


def test_colour_alone_is_enough() -> None:
    bare, told, size = Resolver(device="numpy"), Resolver(device="numpy"), (23, 37)
    for index in range(3):
        frame = make_frame(index, camera=make_camera(), effects=None)
        still = replace(frame, depth=np.full(size, np.inf, np.float32), jitter_px=(0.0, 0.0))
        image = bare.resolve(Frame(index, frame.colour))
        assert np.array_equal(bits(image), bits(told.resolve(still)))
        assert image.flags.c_contiguous
    assert bare.plan is not None
    assert Reason("reprojection", False, "no camera") in bare.plan.reasons
    assert repr(Frame(1, frame.colour)) == "Frame(1: 37 x 23, colour)"


@pytest.mark.parametrize("left_out", ["depth", "camera"])
def test_what_comes_or_goes_starts_a_new_history(left_out: str) -> None:
    plain = load_preset().replace(current_filter="none")
    resolver = Resolver(plain, "numpy")
    resolver.resolve(make_frame(0))
    changes: dict[str, Any] = {left_out: None}
    frame = replace(make_frame(1), **changes)
    assert np.array_equal(bits(resolver.resolve(frame)), bits(frame.colour))


def test_depth_of_nothing_is_the_sky() -> None:
    """A frame that a farm has lost ends no sequence."""
    frame, resolver = make_frame(0), Resolver(device="numpy")
    empty = resolver.resolve(replace(frame, depth=np.full_like(frame.depth, np.inf)))
    for depth in (np.zeros_like(frame.depth), np.where(frame.depth < 5, np.float32(0), -frame.depth)):
        resolver.reset()
        with pytest.warns(UserWarning, match="depth is 0 (or less )?everywhere and counts as the sky") as told:
            zero = resolver.resolve(replace(frame, depth=depth))
        assert np.array_equal(zero, empty)
        assert told[0].filename == __file__
    resolver.reset()
    with pytest.warns(UserWarning, match="depth is NaN everywhere and counts as the sky"):
        lost = resolver.resolve(replace(frame, depth=np.full_like(frame.depth, np.nan)))
    assert np.array_equal(lost, empty)


@pytest.mark.parametrize("number", [np.nan, np.inf, -(2.0**51)])
@pytest.mark.parametrize("name", ["colour", "alpha"])
def test_the_first_frame_without_samples_is_told(name: str, number: float) -> None:
    """A farm may have lost it, and where there is history the image is that."""
    resolver, frame = Resolver(device="numpy"), make_frame(3, alpha=True)
    lost: dict[str, Any] = {name: np.full(getattr(frame, name).shape, number)}
    with pytest.warns(UserWarning, match="^frame 3 has no usable sample: its colour, or alpha") as told:
        assert not resolver.resolve(replace(frame, **lost)).any()
    assert [each.filename for each in told] == [__file__]
    resolver.resolve(replace(make_frame(4, alpha=True), **lost))  # once a resolver


def test_masked_colour_is_told_and_one_pixel_of_it_is_enough() -> None:
    frame = make_frame(0, width=301, height=203)
    mask = np.ones(frame.colour.shape, bool)
    with pytest.warns(UserWarning, match="frame 0 has no usable sample"):
        Resolver(device="numpy").resolve(replace(frame, colour=np.ma.array(frame.colour, mask=mask)))
    mask[1, 1] = False
    Resolver(device="numpy").resolve(replace(frame, colour=np.ma.array(frame.colour, mask=mask)))


def test_one_pixel_of_depth_is_enough() -> None:
    """Where all that is looked at first says nothing the rest is looked at too."""
    frame = make_frame(0, width=301, height=203)
    depth = np.full_like(frame.depth, np.nan)
    depth[1, 1] = 4.0
    Resolver(device="numpy").resolve(replace(frame, depth=depth))


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.longdouble, ">f8", np.int64])
def test_a_matrix_may_hold_numbers_of_any_type(kind: Any) -> None:
    """They are in double precision, so that the inverse of a camera far from the origin is found."""
    view = np.eye(4)
    view[:3, 3] = 700.0, -300.0, 40.0
    view[:2, :2] = (0.0, -1.0), (1.0, 0.0)
    cameras = [Camera(each, make_camera().view_to_clip) for each in (view, view.astype(kind))]
    assert cameras[1].world_to_view.dtype == np.float64
    images = [Resolver(device="numpy").resolve(make_frame(0, camera=each)) for each in cameras]
    assert np.array_equal(bits(images[0]), bits(images[1]))


def test_a_masked_number_of_a_matrix_is_missing() -> None:
    view = np.ma.masked_array(np.eye(4), mask=np.eye(4, k=1, dtype=bool))
    with pytest.raises(DataError, match=r"camera\.world_to_view holds NaN or infinity"):
        Resolver(device="numpy").resolve(make_frame(0, camera=Camera(view, make_camera().view_to_clip)))


def test_an_index_that_stands_still_is_refused() -> None:
    resolver = Resolver(device="numpy")
    resolver.resolve(make_frame(5))
    with pytest.raises(UsageError, match=r"index is 5 twice in a row.*1 apart"):
        resolver.resolve(make_frame(5))
    resolver.resolve(make_frame(5, cut=True))
    resolver.reset()
    resolver.resolve(make_frame(5))


def test_a_result_may_lie_in_memory_of_the_caller() -> None:
    fresh, resolver = Resolver(device="numpy"), Resolver(device="numpy")
    buffers = [
        np.empty((23, 37, 4), np.float32),
        np.moveaxis(np.empty((4, 23, 37), np.float32), 0, -1),
        np.empty((46, 37, 4), np.float32)[::-2],
    ]
    for index, out in enumerate(buffers):
        frame = make_frame(index, alpha=True)
        assert resolver.resolve(frame, out=out) is out
        assert np.array_equal(bits(out.copy()), bits(fresh.resolve(frame)))


@pytest.mark.parametrize(
    ("out", "found"),
    [
        (np.empty((23, 37, 4), np.float32), r"out cannot hold the result .*\(23, 37, 3\), found float32 \(23, 37, 4\)"),
        (np.empty((23, 37, 3)), "found float64"),
        ([], "found list"),
        (np.broadcast_to(np.float32(0), (23, 37, 3)), "out cannot be written to; give an array of your own"),
    ],
)
def test_what_cannot_hold_a_result_is_refused(out: Any, found: str) -> None:
    with pytest.raises(UsageError, match=found):
        Resolver(device="numpy").resolve(make_frame(0), out=out)


class Lent:
    """What another library's array says of itself."""

    def __init__(self, array: NDArray[Any], *, fails: bool = False) -> None:
        self._array, self._fails = array, fails

    def __dlpack__(self, **asked: Any) -> Any:
        """Lend it."""
        if self._fails:
            raise BufferError("requires grad")
        return self._array.__dlpack__(**asked)

    def __dlpack_device__(self) -> tuple[int, int]:
        """Tell where it is."""
        return self._array.__dlpack_device__()


def test_arrays_of_other_libraries_are_taken_where_they_are() -> None:
    frame = make_frame(0, motion=True)
    lent = replace(frame, colour=Lent(frame.colour), motion=Lent(frame.motion))  # type: ignore[arg-type]
    assert np.shares_memory(lent.colour, frame.colour)
    assert np.array_equal(Resolver(device="numpy").resolve(lent), Resolver(device="numpy").resolve(frame))
    assert measure(Lent(frame.colour), frame.colour, ["mse"]) == {"mse": 0.0}  # type: ignore[arg-type]
    with pytest.raises(DataError, match=r"colour cannot be shared: requires grad \(found Lent\); .* of floats"):
        replace(frame, colour=Lent(frame.colour, fails=True))  # type: ignore[arg-type]


def in_a_file(array: NDArray[Any], path: Path) -> NDArray[Any]:
    """A memory map, which begins behind the header of its file."""
    np.save(path, array)
    return np.asanyarray(np.load(path, mmap_mode="r+"))


KINDS: dict[str, Callable[[Any, Path], Any]] = {
    "memory map": in_a_file,
    "subclass": lambda array, _: array.view(np.recarray),
    "masked, with nothing masked": lambda array, _: np.ma.masked_array(array),
    "doubles": lambda array, _: array.astype(np.float64),
    "other byte order": lambda array, _: array.astype(">f4"),
    "columns first": lambda array, _: np.asfortranarray(array),
    "rows backwards": lambda array, _: array[::-1].copy()[::-1],
    "read-only": lambda array, _: np.frombuffer(array.tobytes(), array.dtype).reshape(array.shape),
}


@pytest.mark.parametrize("device", ["numpy", None])
def test_every_kind_of_array_is_the_numbers_in_it(device: str | None, tmp_path: Path) -> None:
    for kind, make in KINDS.items():
        plain, given = Resolver(device=device), Resolver(device=device)
        for index in range(2):
            frame, place = make_frame(index), tmp_path / f"{index}.npy"
            made = replace(frame, jitter_px=np.array(frame.jitter_px))  # type: ignore[arg-type]
            image = given.resolve(replace(made, colour=make(frame.colour, place)))
            assert np.array_equal(bits(image), bits(plain.resolve(frame))), kind
        out = in_a_file(image, tmp_path / "out.npy")
        given.resolve(make_frame(2), out=out)
        assert np.array_equal(bits(out.copy()), bits(plain.resolve(make_frame(2)))), kind


@pytest.mark.parametrize("device", ["numpy", None])
def test_doubles_beyond_a_float_are_missing_samples(device: str | None, tmp_path: Path) -> None:
    """Without NumPy's warning, of a place in our code."""
    frame = Frame(0, np.full((40, 60, 3), 1e300))
    with pytest.warns(UserWarning, match="frame 0 has no usable sample"):
        assert not Resolver(device=device).resolve(frame).any()
    write_frame(tmp_path / "a.0000.exr", frame)


class Torch(Lent):
    """The same of DLPack before 1.0, which does not say what may be written; NumPy is lent the memory besides."""

    def __dlpack__(self, **asked: Any) -> Any:
        """Lend it."""
        return super().__dlpack__()

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Lend it to NumPy."""
        return self._array


class Copying(Torch):
    """NumPy is given a copy."""

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Copy it."""
        return self._array.copy()


def test_a_result_is_not_written_into_a_copy() -> None:
    with pytest.raises(UsageError, match="out cannot be written to"):
        Resolver("fast", "numpy").resolve(make_frame(0), out=Copying(np.zeros((23, 37, 3), np.float32)))


@pytest.mark.parametrize("rows", [None, 8])
@pytest.mark.parametrize("library", [Lent, Torch])
def test_a_result_may_lie_in_memory_of_another_library(library: type[Lent], rows: int | None) -> None:
    def resolver() -> Resolver:
        return Resolver() if rows is None else BandedResolver(band_rows=rows)

    memory = np.empty((23, 37, 3), np.float32)
    lent = library(memory)
    assert resolver().resolve(make_frame(0), out=lent) is lent
    assert np.array_equal(bits(memory), bits(resolver().resolve(make_frame(0))))
    with pytest.raises(UsageError, match=r"out cannot hold the result .* found float32 \(2, 3\)"):
        resolver().resolve(make_frame(0), out=library(np.empty((2, 3), np.float32)))


def test_memory_of_another_library_may_be_no_place_for_a_result() -> None:
    memory, resolver = np.empty((23, 37, 3), np.float32), Resolver(device="numpy")
    with pytest.raises(DataError, match="out cannot be shared: requires grad"):
        resolver.resolve(make_frame(0), out=Lent(memory, fails=True))
    memory.flags.writeable = False
    with pytest.raises(UsageError, match="out cannot be written to"):
        resolver.resolve(make_frame(0), out=Lent(memory))


@pytest.mark.parametrize("copied", [lambda frame: pickle.loads(pickle.dumps(frame)), copy.copy, copy.deepcopy])
def test_a_copy_of_a_frame_has_what_the_frame_was_given(copied: Callable[[Frame], Frame]) -> None:
    for frame in (make_frame(0), Frame(0, make_frame(0).colour)):
        other = copied(frame)
        assert (other.has_depth, other.has_camera) == (frame.has_depth, frame.has_camera)
        assert repr(other) == repr(frame)


def test_numbers_of_numpy_number_frames() -> None:
    """Whatever their type: 0 less 1 is none of ``uint8``, and 255 more 1 neither."""
    colour = make_frame(0).colour
    resolver = Resolver(device="numpy")
    for index in (np.uint8(254), np.uint8(255), np.uint16(256)):
        resolver.resolve(Frame(index, colour, step=np.int8(1)))  # type: ignore[arg-type]
    assert resolver.debug("count")["count"].max() > 2


def test_a_jitter_may_be_two_arrays_of_one_number() -> None:
    plain, arrays = Resolver(device="numpy"), Resolver(device="numpy")
    for index in range(3):
        jitter = 0.1 * index, 0.2
        frame = make_frame(index, jitter_px=jitter)
        numbers: Any = tuple(map(np.array, jitter))
        given = replace(frame, jitter_px=numbers)
        assert np.array_equal(arrays.resolve(given), plain.resolve(frame))


def test_what_is_masked_is_missing() -> None:
    frame, mask = make_frame(0), np.zeros((23, 37, 3), bool)
    mask[3, 4] = True
    masked, damaged = replace(frame, colour=np.ma.masked_array(frame.colour, mask)), frame.colour.copy()
    damaged[3, 4] = np.nan
    images = [Resolver(device="numpy").resolve(each) for each in (masked, replace(frame, colour=damaged))]
    assert np.array_equal(bits(images[0]), bits(images[1]))


def test_an_exposure_in_half_precision_is_a_number(recwarn: pytest.WarningsRecorder) -> None:
    exposures: list[Any] = [2.0, np.float16(2)]
    images = [Resolver(device="numpy").resolve(replace(make_frame(0), exposure=each)) for each in exposures]
    assert np.array_equal(bits(images[0]), bits(images[1]))
    assert not recwarn


def test_the_last_frame_shows_what_was_decided() -> None:
    resolver = Resolver(device="numpy")
    resolver.resolve(make_frame(0))
    found = resolver.debug("count", "motion")
    assert {name: image.shape for name, image in found.items()} == {"count": (23, 37), "motion": (23, 37, 2)}
    assert (found["count"] == 1).all()
    assert [*resolver.debug()] == ["reject", "count", "motion", "clip"]
    resolver.reset()
    with pytest.raises(UsageError, match="nothing was resolved yet"):
        resolver.debug("count")


def test_a_frame_that_its_result_overwrote_shows_nothing() -> None:
    """The planes of a file are read in place, so the views would be of the result."""
    colour = np.moveaxis(haloed([*np.moveaxis(make_frame(0).colour, -1, 0)]), 0, -1)
    resolver = Resolver("fast")
    resolver.resolve(replace(make_frame(0), colour=colour), out=colour)
    with pytest.raises(UsageError, match="nothing was resolved"):
        resolver.debug("clip")


def test_a_preset_is_changed_by_its_keys() -> None:
    assert load_preset("fast").replace(box_scale_static=2, box="variance").settings.box_scale_static == 2.0
    with pytest.raises(UsageError, match="preset default: unknown key boxx; did you mean box"):
        load_preset().replace(boxx=1)


def test_looking_ahead_needs_no_depth_either() -> None:
    """What waits is held without its pixels, and tells still whether a depth was given."""
    for changes in ({}, NO_DEPTH):
        resolver = Resolver("gather-8", "numpy", look_ahead=2)
        frames = [replace(make_frame(index), **changes) for index in range(4)]
        images = list(resolver.images(frames))
        assert resolver.plan is not None
        assert (Reason("rejection", False, "no depth") in resolver.plan.reasons) == bool(changes)
        assert all(image.flags.c_contiguous for image in images)
        assert len(images) == 4


def test_a_resolver_shows_its_preset_and_its_device() -> None:
    assert repr(Resolver("fast", "numpy")) == "Resolver('fast' on NumPy (float32 oracle))"
