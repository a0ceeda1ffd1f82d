"""Vectors of every surface, as engines write them: gathering follows depth and camera where these explain a vector."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from cltaa.core.backend import Launcher
from cltaa.core.build import Build, Steps
from cltaa.core.constants import PAD_X, PAD_Y
from cltaa.core.planes import Layout
from cltaa.core.record import Past, frame_record
from cltaa.core.resolver import Resolver
from cltaa.frame import Camera, Effect, Frame, Image
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.reference.launcher import NumpyLauncher
from tests.core.standing import panned
from tests.kernels.hard_planes import hard_planes
from tests.kernels.test_resolve import turned
from tests.numerics.exact_cameras import displacement_of, orthographic
from tests.sequence_factory import bits, make_camera, make_frame

WIDTH, HEIGHT = 37, 23
OWN = np.s_[5:12, 9:20]  # pixels that move on their own, too
FOUND = frozenset({Effect.CAMERA, Effect.DISOCCLUSION})


def camera_motion(frame: Frame, previous: Camera, *, centre: bool = False) -> NDArray[np.float64]:
    """The motion in pixels [H, W, 2] of depth and cameras, of each sample or its pixel's ``centre``."""
    y, x = np.mgrid[: frame.height, : frame.width].astype(np.float64)
    across, down = (0.0, 0.0) if centre else frame.jitter_px
    px, py = x + 0.5 + across - frame.width / 2, y + 0.5 + down - frame.height / 2
    with np.errstate(divide="ignore"):
        depth = frame.depth.astype(np.float64)
        inverse = -depth if frame.camera.orthographic else 1.0 / depth
    return np.stack(displacement_of(px, py, inverse, frame.camera, previous, frame.width, frame.height)[:2], -1)


def frames(effects: frozenset[Effect], *, every: bool = True, centre: bool = False) -> list[Frame]:
    """Frames of a camera that turns, zooms and moves, with vectors of what moves on its own, or of all."""
    made = []
    for index in range(12):
        frame = make_frame(index, width=WIDTH, height=HEIGHT, camera=turned(index, WIDTH, HEIGHT), effects=None)
        before = turned(index - 1, WIDTH, HEIGHT)
        moved = camera_motion(frame, before, centre=centre)
        own = np.full_like(moved, np.nan)
        own[OWN] = moved[OWN] + (0.5, -0.25)
        # Nothing is before the first frame, so its vectors are kept.
        motion = np.where(np.isnan(own), moved, own) if every and index else own
        halves = motion.astype(np.float16)  # as most files hold them
        made.append(replace(frame, found=effects, motion=halves.astype(np.float32)))
    return made


ON = pytest.mark.parametrize("device", ["numpy", None], ids=["numpy", "device"])


def images(name: str, made: list[Frame], device: str | None) -> list[Image]:
    return list(Resolver(name, device, strict=True).images(made))


@pytest.mark.parametrize("effects", [FOUND, FOUND | {Effect.MOTION}], ids=["camera", "own"])
@pytest.mark.parametrize("name", ["gather-8", "gather-8+8"])
@pytest.mark.parametrize("centre", [False, True], ids=["sample", "centre"])
@ON
def test_vectors_of_the_camera_change_nothing(
    name: str, effects: frozenset[Effect], centre: bool, device: str | None
) -> None:
    made = (frames(effects, every=every, centre=centre) for every in (True, False))
    ours, theirs = (images(name, each, device) for each in made)
    for index, (one, other) in enumerate(zip(ours, theirs, strict=True)):
        assert np.array_equal(bits(one), bits(other)), index


def test_a_preset_that_follows_one_frame_takes_vectors_as_they_are() -> None:
    resolvers = [Resolver(name, "numpy") for name in ("default", "gather-8")]
    for frame in frames(FOUND | {Effect.MOTION})[:2]:
        kept = []
        for resolver in resolvers:
            resolver.resolve(frame)
            assert resolver.last is not None
            with resolver.last.arguments["motion"].mapped(write=False) as planes:
                kept.append(np.isfinite(Layout(WIDTH, HEIGHT).inside(planes)[0]))
    assert kept[0].all()
    moves = np.zeros((HEIGHT, WIDTH), bool)
    moves[OWN] = True
    assert np.array_equal(kept[1], moves)


@pytest.mark.parametrize(
    ("pan", "off", "kept"), [(0, 2.0**-12, False), (0, 2.0**-9, True), (12, 2.0**-6, False), (12, 2.0**-4, True)]
)
@ON
def test_what_moves_by_itself_moves_by_more_than_vectors_are_rounded(
    pan: int, off: float, kept: bool, device: str | None
) -> None:
    resolver, still = Resolver("gather-8", device), make_camera()
    for index in range(2):
        camera = panned(still, index * pan, WIDTH)
        frame = make_frame(index, width=WIDTH, height=HEIGHT, camera=camera, effects=None)
        motion = (camera_motion(frame, still) + off).astype(np.float32)
        resolver.resolve(replace(frame, motion=motion, found=FOUND))
    assert resolver.last is not None
    resolver.launcher.finish()
    with resolver.last.arguments["motion"].mapped(write=False) as planes:
        assert (np.isfinite(Layout(WIDTH, HEIGHT).inside(planes)) == kept).all()


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("lanes", [1, 8])
def test_the_kernel_is_its_twin(lanes: int, moves: bool, parallel: bool) -> None:
    layout = Layout(61, 35)
    planes = hard_planes(layout)
    cameras = [turned(index if moves else 0, 61, 35) for index in (40, 0)]  # by up to 40 pixels
    if parallel:
        cameras = [Camera(each.world_to_view, orthographic(2.0, 1.5)) for each in cameras]
    now, before = (make_frame(0, width=61, height=35, camera=each) for each in cameras)
    record = frame_record(now, Past.of(before), layout)
    steps = Steps(camera_motion=moves, orthographic=parallel)
    motion = planes["motion"]  # half of them the camera's, rounded to halves
    inverse = layout.inside(planes["inverse_depth"])[0]
    with np.errstate(all="ignore"):
        depth = (-inverse if parallel else 1 / inverse).astype(np.float32)
        explained = camera_motion(replace(now, depth=depth), before.camera).astype(np.float16)
        layout.inside(motion)[:, :, ::2] = np.moveaxis(explained, -1, 0)[:, :, ::2]
    found = [
        own_of(launcher, build, layout, planes["inverse_depth"], motion, record)
        for launcher, build in (
            (DeviceLauncher(), Build(strict=True, lanes=lanes, rows=9, steps=steps)),
            (NumpyLauncher(), Build(strict=True, steps=steps)),
        )
    ]
    assert np.array_equal(bits(found[0]), bits(found[1]))
    dropped = np.isinf(found[1]) & np.isfinite(layout.inside(motion))
    assert 0.3 < dropped.mean() < 0.7


def own_of(
    launcher: Launcher,
    build: Build,
    layout: Layout,
    depth: NDArray[np.float32],
    motion: NDArray[np.float32],
    record: object,
) -> NDArray[np.float32]:
    buffers = [launcher.allocate(planes.shape) for planes in (depth, motion, motion)]
    for buffer, content in zip(buffers, (depth, motion), strict=False):
        with buffer.mapped(write=True) as target:
            target[...] = content
    given = dict(zip(("inverse_depth", "motion", "own"), buffers, strict=True))
    launcher.run("own_motion", launcher.build(build), layout, {**given, "frame": record})
    launcher.finish()
    with buffers[2].mapped(write=False) as written:
        return layout.inside(written).copy()


def test_what_lies_beside_the_image_is_as_its_edge() -> None:
    """Filters read past it."""
    resolver = Resolver("gather-8")
    for frame in frames(FOUND)[:2]:
        resolver.resolve(frame)
    assert resolver.last is not None
    resolver.launcher.finish()
    with resolver.last.arguments["motion"].mapped(write=False) as planes:
        assert np.array_equal(bits(planes[:, PAD_Y - 1, :]), bits(planes[:, PAD_Y, :]))
        assert np.array_equal(bits(planes[:, :, PAD_X - 1]), bits(planes[:, :, PAD_X]))
