"""Arrays of a program become planes, distances inverse depth, and results arrays, to the bit.

Those in halves have the bits of NumPy's own conversion of the floats, limited to the largest half.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.camera import inverse_depth
from cltaa.core.backend import Launcher, storage_dtype
from cltaa.core.build import Build, Storage
from cltaa.core.constants import PAD_X, PAD_Y
from cltaa.core.planes import Kind, Layout, flat, places
from cltaa.core.resolver import Resolver
from cltaa.frame import Camera, Effect
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.pipeline.output import limit_halves, saturated_pixels
from cltaa.reference.launcher import NumpyLauncher
from tests.kernels.stage_chain import UNWRITTEN
from tests.numerics.exact_cameras import orthographic
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
    launcher: Launcher, build: Build, layout: Layout, planes: NDArray[np.generic], rows: int | None = None
) -> NDArray[np.float16]:
    """The padded halves that the kernel makes of padded planes; UNWRITTEN where it writes none."""
    image, halves = (launcher.allocate(planes.shape, kind) for kind in (planes.dtype, np.float16))
    for buffer, content in ((image, planes), (halves, UNWRITTEN)):
        with buffer.mapped(write=True) as target:
            target[...] = content
    flat_halves = halves.array.reshape(-1) if isinstance(launcher, NumpyLauncher) else halves  # type: ignore[attr-defined]
    given = {"image": image, "target": flat_halves, "planes": PLANES, **size_of(layout, rows)}
    steps = {"row_step": layout.stride, "column_step": 1, "plane_step": layout.plane}
    launcher.run("pack", build, layout, {**given, "first": PAD_Y * layout.stride + PAD_X, **steps, "halves": 1})
    launcher.finish()
    with halves.mapped(write=False) as written:
        copy: NDArray[np.float16] = written.copy()
        return copy


def size_of(layout: Layout, rows: int | None = None) -> dict[str, int]:
    """What kernels between planes and arrays are told of the planes."""
    return {"width": layout.width, "height": rows or layout.height, "stride": layout.stride, "rows": layout.rows}


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
def test_a_result_of_some_rows_leaves_the_others_unwritten(lanes: int) -> None:
    """As of the last band of an image."""
    launcher, layout = DeviceLauncher(), Layout(33, 5)
    planes = layout.zeros(PLANES)
    layout.inside(planes)[...] = np.random.default_rng(6).normal(0.0, 9.0, (PLANES, 5, 33))
    found = layout.inside(converted(launcher, launcher.build(Build(lanes=lanes)), layout, planes, 3))
    assert np.array_equal(bits(found[:, :3]), bits(expected_of(layout.inside(planes)[:, :3])))
    assert (found[:, 3:] == UNWRITTEN).all()


# Distances of every kind: of the sky and beyond, behind, nearest, denormal, none.
HARD_DEPTHS = np.array(
    [np.inf, -np.inf, np.nan, -np.nan, 0.0, -0.0, -3.0, 1e-45, -1e-45, 1e-39, 2.0**-127, 3.4e38, 1.0, 3.0, 1e5, 7e-7],
    np.float32,
)


@pytest.mark.parametrize("lanes", [1, 8])
def test_an_array_in_any_order_becomes_the_planes_that_it_holds(lanes: int) -> None:
    launcher, orders = DeviceLauncher(), ((0, 1, 2), (2, 0, 1), (0, 2, 1))  # pixels, planes, rows of planes
    for width, dtype, order in product((1, 37, 160), (np.float32, np.float16), orders):
        layout, random = Layout(width, 9), np.random.default_rng(7)
        array = np.empty([(9, width, 3)[axis] for axis in order], dtype).transpose(np.argsort(order))
        array[...] = random.normal(0.0, 9.0, array.shape)
        array[0, 0], array[1, 0, 0] = (np.nan, np.inf, -0.0), 3e4
        target = unpacked(launcher, launcher.build(Build(lanes=lanes, strict=True)), layout, array, 3)
        expected = layout.zeros(3)
        layout.inside(expected)[...] = np.moveaxis(array, -1, 0)
        layout.extend_edges(expected)
        np.testing.assert_array_equal(target, expected, f"{width} {dtype} {order}")
        twin = unpacked(NumpyLauncher(), Build(), layout, array, 3)
        np.testing.assert_array_equal(twin, target, f"{width} {dtype} {order}")


def unpacked(
    launcher: Launcher, build: Build, layout: Layout, array: NDArray[Any], planes: int, **kind: Any
) -> NDArray[np.float32]:
    target = launcher.allocate((planes, layout.rows, layout.stride))
    exchange = launcher.exchange()
    given = {"source": exchange.lend("array", array), "target": target, "planes": planes, **size_of(layout)}
    how = {"kind": 0, "below": np.float32(0), "at": np.float32(0), **kind}
    launcher.run("unpack", build, layout, {**given, "top": PAD_Y, **places(array), **how})
    launcher.finish()
    with target.mapped(write=False) as written:
        copy: NDArray[np.float32] = written.copy()
        return copy


@pytest.mark.parametrize("lanes", [1, 8])
def test_a_distance_becomes_its_inverse_depth_to_the_bit(lanes: int) -> None:
    """``camera.inverse_depth``, and of a perspective camera what is at or below a place of the sky is moved there."""
    launcher, layout, random = DeviceLauncher(), Layout(129, 65), np.random.default_rng(8)
    depth = (10.0 ** random.uniform(-6, 6, (65, 129))).astype(np.float32)
    depth[::3, ::5] = random.choice(HARD_DEPTHS, depth[::3, ::5].shape)
    depth[1, 1] = 2.0**13
    sound = -np.inf, 0.0  # no place of the sky
    for kind, sky in ((Kind.PERSPECTIVE, sound), (Kind.PERSPECTIVE, (2.0**-13, 1e-3)), (Kind.PARALLEL, sound)):
        expected = layout.zeros(1)
        camera = Camera(np.eye(4), orthographic(2.0, 1.5)) if kind is Kind.PARALLEL else make_camera()
        inside = layout.inside(expected)[0]
        inverse_depth(depth, inside, parallel=camera.orthographic)
        inside[inside <= np.float32(sky[0])] = sky[1]
        layout.extend_edges(expected)
        below, at = map(np.float32, sky)
        for on, build in ((launcher, launcher.build(Build(lanes=lanes, strict=True))), (NumpyLauncher(), Build())):
            found = unpacked(on, build, layout, depth, 1, kind=int(kind), below=below, at=at)
            assert np.array_equal(bits(found), bits(expected)), (kind, sky)


@pytest.mark.parametrize("lanes", [1, 8])
def test_a_result_becomes_an_array(lanes: int) -> None:
    launcher, layout, random = DeviceLauncher(), Layout(37, 9), np.random.default_rng(9)
    storages, dtypes = (Storage.FLOAT, Storage.HALF, Storage.DOUBLE), (np.float32, np.float16)
    for storage, dtype, planes in product(storages, dtypes, (3, 4)):
        build = launcher.build(Build(lanes=lanes, storage=storage))
        content = layout.zeros(planes, storage_dtype(build))
        content[...] = random.normal(0.0, 9.0, content.shape)
        for out in (np.zeros((9, 37, planes), dtype), np.moveaxis(np.zeros((planes, 9, 37), dtype), 0, -1)):
            image = launcher.allocate(content.shape, content.dtype)
            with image.mapped(write=True) as target:
                target[...] = content
            exchange = launcher.exchange()
            received = exchange.receive(out)
            given = {"image": image, "target": received, "planes": planes, **size_of(layout), **places(out)}
            exchange.hand_over(out, received, launcher.run("pack", build, layout, given))
            floats = np.moveaxis(layout.inside(content), 0, -1).astype(np.float32)
            assert np.array_equal(bits(out.copy()), bits(floats.astype(dtype))), (storage, dtype, planes)


def test_what_kernels_cannot_read_in_its_place() -> None:
    far_apart: NDArray[Any] = np.zeros((4, 50, 3), np.float32)[:, ::9]
    assert [flat(array) for array in (np.zeros((4, 5, 3))[::-1], far_apart, np.zeros((4, 5), ">f4"))] == [None] * 3
    frame = make_frame(0)
    odd = replace(frame, depth=frame.depth[::-1].astype(">f8")[::-1])
    assert np.array_equal(Resolver("basic").resolve(odd), Resolver("basic").resolve(frame))


@pytest.mark.parametrize(
    ("preset", "storage", "alpha"),
    [
        ("basic", Storage.FLOAT, True),
        ("basic", Storage.HALF_STOCHASTIC, False),
        ("gather-48", Storage.FLOAT, True),
    ],
)
@pytest.mark.parametrize("device", [None, "numpy"])
def test_a_result_in_halves_is_the_one_in_floats(
    preset: str, storage: Storage, alpha: bool, device: str | None
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


def test_kernels_of_every_frame_are_built_before_the_first() -> None:
    launcher, frame = DeviceLauncher(), make_frame(0)
    Resolver(device=launcher).reserve(frame.width, frame.height, alpha=False)
    assert {"pack", "unpack"} <= {name for name, _ in launcher._kernels}
    built = len(launcher._kernels)
    Resolver(device=launcher).resolve(frame, half=True)
    assert len(launcher._kernels) == built + 1  # the resolve itself


def test_rows_with_little_between_them_are_read_where_they_are() -> None:
    array = np.zeros((4, 6), np.float32)[:, :5]
    there = flat(array)
    assert there is not None
    assert np.shares_memory(there, array)
    assert flat(array, dense=True) is None
