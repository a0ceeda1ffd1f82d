"""Results in halves have the bits of NumPy's own conversion of the floats, limited to the largest half."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.core.backend import Launcher, storage_dtype
from cltaa.core.build import FRAME_DTYPE, Build, Storage
from cltaa.core.constants import PAD_X, PAD_Y
from cltaa.core.planes import Layout
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect
from cltaa.opencl.device import Device
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.opencl.shape import Shape
from cltaa.pipeline.output import limit_halves, saturated_pixels
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.stage_chain import UNWRITTEN
from tests.sequence_factory import bits, make_camera, make_frame, special_values

PLANES = 3
LARGEST = np.float32(65504.0)


def around_halves() -> NDArray[np.float32]:
    """Every half, what lies half-way to the next, the floats on either side of both, and what lies beyond halves."""
    every = np.arange(0x7C00, dtype=np.uint16).view(np.float16).astype(np.float32)
    upper = np.append(every[1:], np.float32(65536.0))
    exact = np.concatenate([every, (every + upper) / 2])
    with np.errstate(under="ignore"):
        near = np.concatenate([exact, np.nextafter(exact, np.inf), np.nextafter(exact, -np.inf)])
    beyond = np.array([65519.0, 65520.0, 65536.0, 1e6, 1e30, 3.4e38, 1e-40, 2.0**-126], np.float32)
    values = np.concatenate([near, beyond])
    return np.concatenate([values, -values]).astype(np.float32)


def converted(
    launcher: Launcher, build: Build, layout: Layout, planes: NDArray[np.generic], **rows: int
) -> NDArray[np.float16]:
    """The padded halves that the kernel makes of padded planes; UNWRITTEN where it writes none."""
    frame = np.zeros((), FRAME_DTYPE)
    frame["width"], frame["height"], frame["stride"] = layout.width, layout.height, layout.stride
    for name, value in rows.items():
        frame[name] = value
    image, halves = launcher.allocate(planes.shape, planes.dtype), launcher.allocate(planes.shape, np.float16)
    for buffer, content in ((image, planes), (halves, UNWRITTEN)):
        with buffer.mapped(write=True) as target:
            target[...] = content
    given = {"image": image, "halves": halves, "frame": frame, "planes": PLANES}
    launcher.run("to_halves", build, layout, given)
    launcher.finish()
    with halves.mapped(write=False) as written:
        copy: NDArray[np.float16] = written.copy()
        return copy


def expected_of(values: NDArray[np.generic]) -> NDArray[np.float16]:
    """What files held before there was the kernel."""
    return np.clip(values.astype(np.float32), -LARGEST, LARGEST).astype(np.float16)


@pytest.mark.parametrize("lanes", [0, 1, 4, 8, "numpy"])  # 0: as many as suit the device
def test_every_half_and_what_lies_around_it(lanes: int | str) -> None:
    values = around_halves()
    layout = Layout(1021, -(-len(values) // (PLANES * 1021)))  # no multiple of any vector's length
    launcher = NumpyLauncher() if lanes == "numpy" else DeviceLauncher()
    planes = layout.zeros(PLANES + 1)
    inside = layout.inside(planes)
    inside[:PLANES] = np.resize(values, (PLANES, layout.height, layout.width))
    halves = converted(launcher, launcher.build(Build(lanes=0 if lanes == "numpy" else int(lanes))), layout, planes)
    found = np.moveaxis(layout.inside(halves)[:PLANES], 0, -1)
    given = np.moveaxis(inside[:PLANES], 0, -1)
    assert np.array_equal(np.isinf(found), np.abs(given) >= LARGEST)
    assert limit_halves(found) == saturated_pixels(given) > 0
    assert np.array_equal(bits(found), bits(expected_of(given)))
    # Nothing but the pixels, and at most the rest of their last vector.
    assert (halves[PLANES] == UNWRITTEN).all()
    assert (halves[:, :PAD_Y] == UNWRITTEN).all()
    assert (halves[:, -PAD_Y:] == UNWRITTEN).all()
    assert (halves[:, :, :PAD_X] == UNWRITTEN).all()
    assert (halves[:, :, PAD_X + -(-layout.width // 16) * 16 :] == UNWRITTEN).all()


@pytest.mark.parametrize("storage", [Storage.HALF, Storage.DOUBLE])
@pytest.mark.parametrize("lanes", [1, 8])
def test_of_every_number_that_a_history_is_kept_in(storage: Storage, lanes: int) -> None:
    launcher, layout = DeviceLauncher(), Layout(33, 9)
    build = launcher.build(Build(lanes=lanes, storage=storage))
    planes = layout.zeros(PLANES, storage_dtype(build))
    random = np.random.default_rng(5)
    layout.inside(planes)[...] = np.clip(random.standard_cauchy((PLANES, 9, 33)) * 1e4, -65504, 65504)
    ours, twin = (layout.inside(converted(on, build, layout, planes)) for on in (launcher, NumpyLauncher()))
    assert np.array_equal(bits(ours), bits(twin))
    assert limit_halves(ours) > 0
    assert np.array_equal(bits(ours), bits(expected_of(layout.inside(planes))))


@pytest.mark.parametrize("lanes", [1, 8])
def test_of_a_band_of_rows(lanes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    # Of one lane in groups as on a GPU: more work-items than pixels, down and across.
    monkeypatch.setattr(Device, "shape", property(lambda _: Shape(lanes=lanes, rows=5, group=(8, 3))))
    launcher, band = DeviceLauncher(), Layout(33, 5)
    planes = band.zeros(PLANES)
    band.inside(planes)[...] = np.random.default_rng(6).normal(0.0, 9.0, (PLANES, 5, 33))
    build = launcher.build(Build(lanes=lanes))
    found = converted(launcher, build, band, planes, height=23, first_row=10, band_rows=5)
    assert np.array_equal(bits(band.inside(found)), bits(expected_of(band.inside(planes))))
    assert (found[:, -PAD_Y:] == UNWRITTEN).all()


@pytest.mark.parametrize(
    ("preset", "storage"),
    [
        ("default", Storage.FLOAT),
        ("default", Storage.HALF_STOCHASTIC),
        ("gather-48", Storage.FLOAT),
    ],
)
@pytest.mark.parametrize("device", [None, "numpy"])
@pytest.mark.parametrize("alpha", [False, True])
def test_a_result_in_halves_is_the_one_in_floats(
    preset: str, storage: Storage, device: str | None, alpha: bool
) -> None:
    floats, halves = (Resolver(preset, device, storage=storage) for _ in range(2))
    for index in range(3):
        frame = make_frame(index, camera=make_camera((0.2 * index, 0.0, 5.0)), alpha=alpha, effects=frozenset(Effect))
        frame.colour[3:21:4, ::7, 1] = special_values()[3:21:4, ::7]
        frame.colour[5, 5:9] = (7e4, 65504.0, -1e9)
        of_floats = floats.resolve(frame)
        # Every other frame alone: the history does not change by it.
        if index == 1:
            assert np.array_equal(bits(halves.resolve(frame)), bits(of_floats))
            continue
        result = halves.resolve(frame, half=True)
        assert result.dtype == np.float16
        assert limit_halves(result) == saturated_pixels(of_floats)
        assert np.array_equal(bits(result), bits(expected_of(of_floats)))


def test_the_kernel_is_built_only_for_halves_and_before_the_first_frame() -> None:
    launcher = DeviceLauncher()
    frame = make_frame(0)
    for half in (False, True):
        Resolver(device=launcher).reserve(frame.width, frame.height, alpha=False, half=half)
        assert ("to_halves" in {name for name, _ in launcher._kernels}) == half
    built = len(launcher._kernels)
    Resolver(device=launcher).resolve(frame, half=True)
    assert len(launcher._kernels) == built + 1  # the resolve itself
