"""How much memory a resolve takes: counted in planes, so that it is known before anything is allocated."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from pathlib import Path
from types import MappingProxyType

import msgspec
import numpy as np

from cltaa.core.backend import storage_dtype
from cltaa.core.build import Build, Steps, Storage, ring_planes, window_planes
from cltaa.core.planes import SMALLEST, Layout, in_large_pages
from cltaa.io import exr_write as exr_zip
from cltaa.io.exr_frame import GROUPS
from cltaa.io.exr_layout import PIXEL_BYTES
from cltaa.io.manifest import PIECE
from cltaa.io.openexr import OpenEXR
from cltaa.io.sequence import FrameSequence
from cltaa.io.streams import AHEAD, BEHIND

REAL, HALF = 4, 2  # bytes of a float, and of a half
FRAMES = 1 + AHEAD  # in work, and those that are decoded or being decoded
RESULTS = 1 + BEHIND  # just made, and those that wait to be written or are being written
# Blocks of the size of what it works on that each thread that packs or unpacks holds: packed, unpacked, between the
# two. Seen with 2 and 16 threads of OpenEXR: 2.5 to 3.1. What is packed waits besides until its file is written so far.
BLOCKS = 3
# Interpreter, libraries and driver: the peak of a resolve of 16 x 16 pixels with built kernels, PoCL 3.0, 2026-11-21,
# and what of it is no file's (2026-11-22). Kernels that have to be built first take 100 to 190 MB more, and keep them.
PROGRAM, ALLOCATED = 102_000_000, 38_000_000
RUNNING = 12_000_000  # of files, seen to be touched by the first frame that is read and resolved (2026-11-24)
STATUS = Path("/proc/self/status")
MADE = frozenset("RGBA")  # channels that a result has of its own
NO_LAYERS: Mapping[str, str] = MappingProxyType({})


class DevicePlanes(msgspec.Struct, frozen=True):
    """What decides how many planes a resolve holds."""

    steps: Steps
    storage: Storage = Storage.FLOAT
    band_rows: int = 0  # of a band, the only part of the frame and its result that is held at a time; 0: all rows
    history_frames: int = 0  # a ring holds these and one more
    look_ahead: int = 0  # and these, whose results wait
    windows: int = 0  # temporal ones that are weighed, and hold planes
    recursion: bool = False  # beside the ring, whose result is not what recurs then
    changes: bool = False  # of light, beside the count of what recurs and of the result
    shared: bool = False  # the device has the host's memory: of a whole frame only inverse depth lies anywhere else
    half: bool = False  # the result goes in halves
    staged: bool = False  # the device holds the arrays too that frames come in and results go in


def device_bytes(width: int, height: int, held: DevicePlanes) -> int:
    """Bytes of the planes on the device, halos included.

    Per texel and in floats: the frame holds 4 (R G B, inverse depth), and 2, 1 and 1 more for own motion, alpha and
    reactive; what recurs holds count and inverse depth; the result its count, and each count the illumination change
    where that is tested for. Both hold 3 or, with alpha, 4 planes of ``storage``. A device with memory of its own holds
    the arrays too that frame and result are unpacked from and packed into.
    """
    steps, whole = held.steps, Layout(width, height)
    band = Layout(width, held.band_rows) if held.band_rows else whole
    stored = int(np.dtype(storage_dtype(Build(storage=held.storage))).itemsize)
    colour = (3 + steps.alpha) * stored
    in_place = held.shared and not held.band_rows and not held.look_ahead
    frame = REAL * (1 if in_place else 4 + 2 * steps.own_motion + steps.alpha + steps.reactive)
    kept = held.history_frames + 1 + held.look_ahead if held.history_frames else 0
    ring = REAL * ring_planes(steps) * kept
    ring += REAL * held.windows * window_planes(steps)
    count = REAL * (1 + held.changes)
    # As arrays, without a halo: what comes, and the result in the numbers in which it goes.
    arrays = frame + (HALF if held.half else REAL) * (3 + steps.alpha) if held.staged else 0
    planes = (frame + colour + count) * band.plane + (colour + count + REAL + ring) * whole.plane
    planes += (colour + REAL) * whole.plane if held.recursion else 0
    return planes + arrays * band.width * band.height


class Memory(msgspec.Struct, frozen=True, kw_only=True):
    """Bytes that ``cltaa resolve`` takes at its peak; on a CPU the planes of the device are the process's too."""

    device: int
    frames: int
    layers: int = 0  # channels that are carried over from a frame's file to that of its result
    results: int
    reading: int  # packed files, and planes that stand beside those of their frames while they are decoded
    packing: int  # what the threads that unpack hold of each file that is read, those that pack, and those that hash
    program: int = PROGRAM

    @property
    def whole(self) -> int:
        """All of it together."""
        return self.device + self.frames + self.layers + self.results + self.reading + self.packing + self.program


def program_bytes() -> int:
    """Bytes that this process takes without planes: what it allocates, and the pages of files that it has touched,
    the device opened and no kernel run: one that is built here leaves pages of the compiler that a resolve never sees.

    With the device the drivers of every OpenCL platform are loaded that is installed, and those may be large.
    """
    try:
        status = STATUS.read_text(encoding="utf-8")
    except OSError:  # another system than Linux
        return PROGRAM
    return (
        ALLOCATED
        + RUNNING
        + 1024 * sum(int(kilobytes) for kilobytes in re.findall(r"^Rss(?:File|Shmem):\s+(\d+)", status, re.M))
    )


def of_resolve(
    width: int,
    height: int,
    channels: Collection[str],
    file: int,
    chunk: int,
    held: DevicePlanes,
    *,
    recorded: bool,
    converted: bool,
    layers: Mapping[str, str],
) -> Memory:
    """Memory of a resolve of frames in float ``channels``, whose packed files have ``file`` bytes.

    ``chunk`` is what a chunk of such a file unpacks to. Memory of packed files, of groups of planes and of results is
    kept from frame to frame. What is decoded stands beside the planes of the frame until it is moved there, and is
    counted for one of the frames that are read at a time, since they seldom are in one step. In bands one frame at a
    time is in memory, its result in its place, and beside it the count of each pixel, and the result in halves where
    that is what is written; nothing is kept. Those that read hash files too, of which no hash was ``recorded``.
    ``layers`` are channels that are carried over -> "uint", "half" or "float": each stays until its result is written,
    and is not there yet while its file is being read. Those of another tool are ``converted``: then each that reads
    holds channels as they were decoded, and beside each other, until they are.
    """
    banded, half = bool(held.band_rows), held.half
    plane, planes = REAL * width * height, 3 + held.steps.alpha
    groups = [len(group) for group in GROUPS if group[0] in channels]
    frame = sum(in_large_pages(REAL * count * Layout(width, height).plane) for count in groups)
    frame += (len(channels) - sum(groups)) * plane
    number = HALF if half else REAL
    image = _mapped(planes * number * width * height, banded)
    carried = sum(_mapped(PIXEL_BYTES[kind] * width * height, banded) for kind in layers.values())
    texel = planes * number + sum(PIXEL_BYTES[kind] for name, kind in layers.items() if name not in MADE)
    frames, results, decoded = (1, plane + half * image, 1) if banded else (FRAMES, RESULTS * image, AHEAD)
    unpacking = (1 if converted else decoded) * OpenEXR.global_thread_count() * BLOCKS * chunk
    readers, writers = (1, 1) if banded else (AHEAD, BEHIND)
    beside = 0 if banded else sum(groups)
    if converted:
        beside = readers * 2 * len(channels)
    blocks = exr_zip.THREADS * (BLOCKS - 1) + writers * exr_zip.BEGUN
    packing = blocks * texel * width * min(exr_zip.ROWS, height)
    return Memory(
        device=device_bytes(width, height, held),
        frames=frames * frame,
        layers=(held.look_ahead + (1 if banded else RESULTS)) * carried,
        results=results,
        reading=readers * file + beside * plane,
        packing=unpacking + packing + (writers + (0 if recorded else readers)) * PIECE,
    )


def _mapped(size: int, banded: bool) -> int:
    """Bytes that what is kept from frame to frame takes for planes of that ``size``."""
    return size if banded or size < SMALLEST else in_large_pages(size)


def of_sequence(sequence: FrameSequence, held: DevicePlanes, layers: Mapping[str, str] = NO_LAYERS) -> Memory:
    """Memory of a resolve of ``sequence``; ``layers`` as for ``of_resolve``."""
    memory = of_resolve(
        sequence.width,
        sequence.height,
        sequence.channels,
        max(path.stat().st_size for path in sequence.files),
        max(layout.chunk_bytes for layout in sequence.layouts.values()),
        held,
        recorded=all(sequence.sha256(number) for number in sequence.numbers),
        converted=sequence.converted,
        layers=layers,
    )
    # OpenEXR's module decodes every channel, whether it is read or not.
    readers = AHEAD if sequence.converted and not held.band_rows else 1
    spare = readers * max(0, max(len(layout.channels) for layout in sequence.layouts.values()) - len(sequence.channels))
    return msgspec.structs.replace(memory, reading=memory.reading + REAL * sequence.width * sequence.height * spare)
