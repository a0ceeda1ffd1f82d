"""Channels that a device which shares the host's memory reads where they are."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cltaa.core.bands import BandedResolver
from cltaa.core.planes import Layout, around, haloed, mapped_image
from cltaa.core.resolver import Resolver
from cltaa.frame import Frame
from cltaa.opencl.launcher import DeviceLauncher
from tests.last_frame import last_planes
from tests.sequence_factory import make_frame

WIDTH, HEIGHT = 45, 27  # odd, and no multiple of any vector
CHANNELS = ("colour", "motion", "alpha", "reactive")


class Counting(DeviceLauncher):
    """A device that counts what it takes."""

    taken = 0

    def take(self, planes: Any) -> Any:
        self.taken += 1
        return super().take(planes)


@pytest.fixture(scope="module")
def launcher() -> Counting:
    launcher = Counting("pthread")
    assert launcher.shares_memory
    return launcher


def frames(count: int) -> list[Frame]:
    """Frames with every channel, as a program makes them."""
    return [
        make_frame(index, width=WIDTH, height=HEIGHT, motion=True, alpha=True, reactive=True, effects=None)
        for index in range(count)
    ]


def as_read(frame: Frame) -> Frame:
    """The frame as the reader of files gives it."""
    planes = {name: np.atleast_3d(getattr(frame, name)).transpose(2, 0, 1) for name in CHANNELS}
    given: dict[str, Any] = {name: np.moveaxis(haloed(list(each)), 0, -1) for name, each in planes.items()}
    return replace(frame, **given | {name: given[name][..., 0] for name in ("alpha", "reactive")})


@pytest.mark.parametrize("preset", ["default", "gather-48"])
def test_what_is_read_where_it_is_becomes_what_its_copies_do(launcher: Counting, preset: str) -> None:
    """Each other frame is copied, so that one way follows the other."""
    copied, taken, mixed = (Resolver(preset, launcher, strict=True) for _ in range(3))
    for frame in frames(4):
        launcher.taken = 0
        expected = copied.resolve(frame)
        assert launcher.taken == 0
        found = taken.resolve(as_read(frame))
        assert launcher.taken == len(CHANNELS)
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(mixed.resolve(frame if frame.index % 2 else as_read(frame)), expected)


def test_a_frame_that_was_changed_after_it_was_read(launcher: Counting) -> None:
    """Its halo is made when it is resolved, and not before."""
    frame = frames(1)[0]
    read = as_read(frame)
    resolver = Resolver(device=launcher, strict=True)
    resolver.resolve(read)
    read.colour[...] *= 0.25
    read.motion[...] = 0.5  # type: ignore[index]
    resolver.reset()
    expected = Resolver(device="numpy").resolve(replace(frame, colour=read.colour.copy(), motion=read.motion.copy()))  # type: ignore[union-attr]
    np.testing.assert_array_equal(resolver.resolve(read), expected)


def test_the_device_keeps_the_memory_that_it_reads(launcher: Counting) -> None:
    resolver = Resolver(device=launcher)
    read = as_read(frames(1)[0])
    colour = read.colour.copy()
    resolver.resolve(read)
    del read
    others = [haloed([np.zeros((HEIGHT, WIDTH))] * 3) for _ in range(4)]
    assert len(others) == 4
    np.testing.assert_array_equal(np.moveaxis(last_planes(resolver, "current"), 0, -1), colour)


def test_bands_copy_their_rows(launcher: Counting) -> None:
    launcher.taken = 0
    whole, banded = Resolver(device=launcher), BandedResolver(device=launcher, band_rows=8)
    for frame in frames(2):
        expected = whole.resolve(frame)
        np.testing.assert_array_equal(banded.resolve(as_read(frame)), expected)  # which uses up the frame's depth
    assert launcher.taken == 0


def test_only_all_of_an_image_is_taken() -> None:
    layout = Layout(WIDTH, HEIGHT)
    planes = haloed([np.ones((HEIGHT, WIDTH))] * 3)
    whole = around(planes, layout)
    assert whole is not None
    assert np.shares_memory(whole, planes)
    np.testing.assert_array_equal(layout.inside(whole), planes)
    assert around(planes[:2], layout) is not None
    flipped = (planes[::-1], planes[:, ::-1], planes[:, :, ::-1])
    parts = (planes[1:], planes[:, 1:], planes[:, :-1], planes[:, :, 1:], planes[:, :, :-1])
    others = (planes.copy(), planes.view(np.uint32), np.broadcast_to(planes[:1], planes.shape), planes.astype(float))
    own = (layout.inside(layout.zeros(3)), np.ones((3, 1, 1), np.float32))
    other: Any
    for other in (*flipped, *parts, *others, *own):
        assert around(other, layout) is None
    assert around(planes[:, : HEIGHT - 8], Layout(WIDTH, HEIGHT - 8)) is None
    assert around(planes[:, 8:], Layout(WIDTH, HEIGHT - 8)) is None
    assert around(mapped_image((1, 512, 1024)), Layout(1024, 512)) is None  # which fills its large page without a halo
