"""Sizes from one pixel to 16384 x 16384: docs/numerics.md, G5."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cltaa.core.bands import BandedResolver
from cltaa.core.planes import Layout
from cltaa.core.resolver import Resolver
from cltaa.errors import ResourceError
from cltaa.frame import Effect, Frame, Image
from cltaa.io.content import memory_limit
from cltaa.opencl.launcher import DeviceLauncher
from tests.kernels.test_resolve import hard_frames
from tests.numerics.kernel_text import kernel_files, without_comments
from tests.sequence_factory import bits, make_camera, make_frame

SIZES = [(1, 1), (1, 13), (13, 1), (2, 2), (3, 3), (17, 13), (97, 5), (241, 131)]


# The hard frames of a few pixels have depth of 0 everywhere, which is told.
@pytest.mark.filterwarnings("ignore:depth is 0:cltaa.core.frame_checks.MeaninglessNumbers")
@pytest.mark.parametrize("size", [*SIZES, pytest.param((1919, 1081), marks=pytest.mark.big)])
def test_g5_every_size_gives_the_oracles_bits(launcher: DeviceLauncher, size: tuple[int, int]) -> None:
    ours, theirs = Resolver(device=launcher, strict=True), Resolver(device="numpy")
    for frame in hard_frames(*size, 2):
        assert np.array_equal(bits(ours.resolve(frame)), bits(theirs.resolve(frame)))


def test_g5_a_plane_is_counted_in_32_bits_and_planes_in_64() -> None:
    text = without_comments(kernel_files()["platform/image.h"])
    assert text.count("(size_t)row_stride(frame) * (size_t)") == 2  # both kinds of plane_size
    assert "uint texel_offset" in text
    assert Layout(16384, 16384).plane < 2**31  # larger images are refused: cltaa.core.resolver


SIDE, TILE = 16384, 256


def huge(frame: Frame) -> Frame:
    """16384 x 16384 pixels of one tile before a wall: a plane is 2^30 bytes, four of them 2^32."""

    def wide(plane: Any) -> Any:
        return np.tile(plane, (SIDE // TILE, SIDE // TILE) + (1,) * (plane.ndim - 2))

    alpha = None if frame.alpha is None else wide(frame.alpha)
    return replace(frame, colour=wide(frame.colour), depth=np.full((SIDE, SIDE), 4.0, np.float32), alpha=alpha)


def assert_tiles_are_equal(resolved: Image) -> None:
    expected = bits(resolved[TILE : 2 * TILE, TILE : 2 * TILE])
    for y in range(TILE, SIDE - TILE, TILE):
        for x in range(TILE, SIDE - TILE, TILE):
            assert np.array_equal(bits(resolved[y : y + TILE, x : x + TILE]), expected), (y, x)


@pytest.mark.big
def test_g5_sixteen_thousand_squared(launcher: DeviceLauncher) -> None:
    # 15 GB on the device, which may be the host's, and 13 of the host: what takes more than there is is killed.
    if memory_limit() < 30e9:
        pytest.skip(f"16384 x 16384 in one piece takes 28 GB, and here are {memory_limit() / 1e9:.0f}")
    effects, camera = frozenset({Effect.ALPHA}), make_camera()
    small = [make_frame(i, width=TILE, height=TILE, alpha=True, effects=effects, camera=camera) for i in range(2)]
    resolver = Resolver(device=launcher)
    try:
        for frame in small:
            resolved = resolver.resolve(huge(frame))
    except ResourceError as error:
        pytest.skip(f"this device has too little memory for 16384 x 16384 in one piece: {error}")
    assert_tiles_are_equal(resolved)
    assert not np.array_equal(resolved[TILE : 2 * TILE, TILE : 2 * TILE], small[1].colour)


@pytest.mark.big
def test_g5_sixteen_thousand_squared_in_bands_of_two_heights(launcher: DeviceLauncher) -> None:
    # Two frames of a camera that stands still, where all tiles have to come out alike, and one of another camera.
    if memory_limit() < 14e9:  # 11 GB were seen, for files read ahead too
        pytest.skip(f"16384 x 16384 in bands takes 11 GB, and here are {memory_limit() / 1e9:.0f}")
    cameras = [make_camera(), make_camera(), make_camera((0.01, 0.02, 4.9))]
    digests = []
    for rows in (512, 1000):
        resolver = BandedResolver(device=launcher, strict=True, band_rows=rows)
        for index, camera in enumerate(cameras):
            resolved = resolver.resolve(huge(make_frame(index, width=TILE, height=TILE, camera=camera, effects=None)))
            if index == 1:
                assert_tiles_are_equal(resolved)
            digests.append(hashlib.sha256(bits(resolved).data).hexdigest())
            del resolved
    assert digests[:3] == digests[3:]
    assert len(set(digests)) == 3
