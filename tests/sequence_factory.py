"""Small synthetic frames and sequences for tests, made with NumPy alone.

``from tests.sequence_factory import make_frame, write_sequence``. Content is a function of frame number and seed, so
that two calls agree to the bit. Sizes default to something odd, so that a swap of width and height shows.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.frame import Camera, Effect, Frame, Image
from cltaa.io.exr_read import read_frame_and_header
from cltaa.io.exr_write import write_frame, write_image
from cltaa.io.manifest import file_sha256

WIDTH, HEIGHT = 37, 23
EVERY_CHANNEL: dict[str, Any] = {"motion": True, "alpha": True, "reactive": True}  # that a resolve reads

# float32 bit patterns that a careless path changes: quiet and signalling NaN with payloads, -0, denormals, infinities,
# the largest number, and values that half precision cannot hold.
SPECIAL_BITS = (
    0x7FC00000,
    0x7FC12345,
    0x7F800001,
    0xFFC0BEEF,
    0x80000000,
    0x00000001,
    0x807FFFFF,
    0x7F800000,
    0xFF800000,
    0x7F7FFFFF,
    0x477FF000,
    0x3F800001,
)


def make_camera(position: tuple[float, float, float] = (0.0, 0.0, 5.0), aspect: float = WIDTH / HEIGHT) -> Camera:
    """Look along -z from ``position`` with a 60 degree field of view, near 0.1, far 100."""
    view = np.eye(4)
    view[:3, 3] = [-coordinate for coordinate in position]
    scale = 1.0 / np.tan(np.radians(60.0) / 2)
    near, far = 0.1, 100.0
    clip = np.zeros((4, 4))
    clip[0, 0], clip[1, 1] = scale / aspect, scale
    clip[2, 2], clip[2, 3] = (far + near) / (near - far), 2 * far * near / (near - far)
    clip[3, 2] = -1.0
    return Camera(world_to_view=view, view_to_clip=clip)


def special_values(height: int = HEIGHT, width: int = WIDTH) -> Image:
    """[H, W] float32 that repeats ``SPECIAL_BITS``."""
    bits = np.resize(np.array(SPECIAL_BITS, dtype=np.uint32), (height, width))
    return bits.view(np.float32)


def make_frame(
    index: int = 0,
    *,
    width: int = WIDTH,
    height: int = HEIGHT,
    seed: int = 0,
    motion: bool = False,
    alpha: bool = False,
    reactive: bool = False,
    object_id: bool = False,
    normal: bool = False,
    cut: bool = False,
    exposure: float = 1.0,
    jitter_px: tuple[float, float] = (0.25, -0.125),
    camera: Camera | None = None,
    effects: frozenset[Effect] | None = frozenset({Effect.CAMERA}),
) -> Frame:
    """One frame of random colour (0 to 4) and depth (1 to 10, top row sky) with the channels that are asked for."""
    random = np.random.default_rng((seed, index))

    def numbers(*shape: int) -> Image:
        return random.random(shape, dtype=np.float32)

    depth = 1 + 9 * numbers(height, width)
    depth[0] = np.inf
    return Frame(
        index=index,
        colour=4 * numbers(height, width, 3),
        depth=depth,
        camera=camera or make_camera((0.1 * index, 0.0, 5.0), width / height),
        jitter_px=jitter_px,
        motion=numbers(height, width, 2) - 0.5 if motion else None,
        alpha=numbers(height, width) if alpha else None,
        reactive=numbers(height, width) if reactive else None,
        object_id=random.integers(0, 2**32, (height, width), dtype=np.uint32) if object_id else None,
        normal=numbers(height, width, 3) if normal else None,
        cut=cut,
        exposure=exposure,
        scene="synthetic",
        effects=effects,
    )


def read_frame(path: Path, sha256: str | None = None) -> Frame:
    """Read one frame, whose file must have that SHA-256."""
    return read_frame_and_header(path, sha256=sha256)[0]


def write_images(
    folder: Path, images: list[Image], *, name: str = "image", first: int = 0, samples: int | None = None
) -> Path:
    """Write ``[H, W, 3]`` images as ``<name>.<frame:04d>.exr``, as a truth of ``samples``; return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, image in enumerate(images, start=first):
        channels = {channel: image[..., position] for position, channel in enumerate("RGB")}
        attributes = {} if samples is None else {"cltaa:samples": samples}
        write_image(folder / f"{name}.{number:04d}.exr", channels, attributes)
    return folder


def write_frames(folder: Path, frames: Iterable[Frame], name: str = "synthetic") -> Path:
    """Write frames under their own numbers, and return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for frame in frames:
        write_frame(folder / f"{name}.{frame.index:04d}.exr", frame)
    return folder


def write_sequence(
    folder: Path,
    count: int = 3,
    *,
    name: str = "synthetic",
    first: int = 0,
    reference: bool = False,
    width: int = WIDTH,
    height: int = HEIGHT,
    motion: bool = False,
    seed: int = 0,
) -> Path:
    """Write ``count`` frames (and, if asked, a reference of smooth grey) as a capture would, and return the folder."""
    numbers = range(first, first + count)
    write_frames(folder, (make_frame(n, width=width, height=height, motion=motion, seed=seed) for n in numbers), name)
    if reference:
        truth = [np.full((height, width, 3), 0.25 + number / 100, np.float32) for number in range(count)]
        write_images(folder / "reference", truth, name=name, first=first)
    return folder


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every image under its final name, by its place in ``folder``."""
    images = [path for path in sorted(folder.rglob("*.exr")) if path.name[0] != "."]
    return {path.relative_to(folder).as_posix(): file_sha256(path) for path in images}


def any_bits(random: np.random.Generator, like: Image) -> Image:
    """An image of which few, half or all values are any bit patterns."""
    wild = random.integers(0, 2**32, like.shape, np.uint32).view(np.float32)
    return np.where(random.random(like.shape) < random.choice([0.01, 0.5, 1.0]), wild, like)


def bits(array: NDArray[np.generic]) -> NDArray[np.generic]:
    """Bit patterns of an array, so that equal means identical, NaN and -0 included."""
    return np.ascontiguousarray(array).view(f"u{array.dtype.itemsize}")
