"""The memory of a resolve, counted in planes, so that it is known before anything is allocated."""

from __future__ import annotations

import re
from collections.abc import Mapping
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
from cltaa.io.openexr import OpenEXR
from cltaa.io.sequence import FrameSequence
from cltaa.io.streams import AHEAD, BEHIND

REAL, HALF = 4, 2  # bytes of a float, and of a half
FRAMES = 1 + AHEAD  # the current one, and those decoded or being decoded
RESULTS = 1 + BEHIND  # the latest, and those that wait to be written or are being written
# Blocks that each packing or unpacking thread holds, of the size of its work: packed, unpacked, and one between.
# Measured with 2 and 16 threads of OpenEXR: 2.5 to 3.1. Packed blocks also wait until the file is written up to them.
BLOCKS = 3
# Interpreter, libraries and driver: the peak of a resolve of 16 x 16 pixels with built kernels, PoCL 3.0, 2026-11-21,
# and its part that no file backs (2026-11-22). Kernels that must be built first take 100 to 190 MB more, and keep them.
PROGRAM, ALLOCATED = 102_000_000, 38_000_000
RUNNING = 12_000_000  # pages of files that the first frame to be read and resolved touches, as measured (2026-11-24)
STATUS = Path("/proc/self/status")
MADE = frozenset("RGBA")  # channels of the result itself
NO_LAYERS: Mapping[str, str] = MappingProxyType({})


class DevicePlanes(msgspec.Struct, frozen=True):
    """Everything that decides how many planes a resolve holds."""

    steps: Steps
    storage: Storage = Storage.FLOAT
    band_rows: int = 0  # of a band, the only part of the frame and its result that is held at a time; 0: all rows
    history_frames: int = 0  # a ring holds these and one more
    look_ahead: int = 0  # and these, whose results wait
    windows: int = 0  # temporal windows that hold planes
    recursion: bool = False  # beside the ring, whose result then is not the recurrent one
    changes: bool = False  # illumination changes, beside the recurrent count and that of the result
    shared: bool = False  # the device uses the host's memory: of a whole frame only inverse depth lies elsewhere
    half: bool = False  # the result is in halves
    staged: bool = False  # the device also holds the arrays of frames and of results


def device_bytes(width: int, height: int, held: DevicePlanes) -> int:
    """Return the bytes of the planes on the device, halos included.

    Per texel and in floats: the frame holds 4 (R G B, inverse depth), and 2, 1 and 1 more for own motion, alpha and
    reactive; the recurrent state holds count and inverse depth; the result its count. With the illumination test each
    count has a second plane, and beside a ring own motion has two more. State and result hold 3 or, with alpha, 4
    planes of ``storage``. A device with memory of its own also holds the arrays from which the frame is unpacked and
    into which the result is packed.
    """
    steps, whole = held.steps, Layout(width, height)
    band = Layout(width, held.band_rows) if held.band_rows else whole
    stored = int(np.dtype(storage_dtype(Build(storage=held.storage))).itemsize)
    colour = (3 + steps.alpha) * stored
    in_place = held.shared and not held.band_rows and not held.look_ahead
    frame = REAL * (1 if in_place else 4 + 2 * steps.own_motion + steps.alpha + steps.reactive)
    kept = held.history_frames + 1 + held.look_ahead if held.history_frames else 0
    ring = REAL * ring_planes(steps) * kept
    ring += REAL * (held.windows * window_planes(steps) + 2 * (kept > 0 and steps.own_motion))
    count = REAL * (1 + held.changes)
    # Arrays have no halo: those of the frame, and the result in its output type.
    arrays = frame + (HALF if held.half else REAL) * (3 + steps.alpha) if held.staged else 0
    planes = (frame + colour + count) * band.plane + (colour + count + REAL + ring) * whole.plane
    planes += (colour + REAL) * whole.plane if held.recursion else 0
    return planes + arrays * band.width * band.height


class Memory(msgspec.Struct, frozen=True, kw_only=True):
    """Peak memory of ``cltaa resolve`` in bytes; on a CPU it includes the planes of the device."""

    device: int
    frames: int
    layers: int = 0  # channels that are carried over from a frame's file to that of its result
    results: int
    reading: int  # packed files, and planes decoded beside those of their frames
    packing: int  # blocks of the threads that unpack each file that is read, and of those that pack
    program: int = PROGRAM
    jobs: int = 1  # parts that are resolved at once, each in memory of its own

    @property
    def whole(self) -> int:
        """The sum of everything."""
        own = self.device + self.frames + self.layers + self.results + self.reading + self.packing
        return self.jobs * own + self.program


def program_bytes() -> int:
    """Return the bytes that this process takes without planes: its allocations, and the pages of files that it has
    touched, with the device, whose drivers may be large, open and no kernel run: building one touches pages that a
    resolve never does."""
    try:
        status = STATUS.read_text(encoding="utf-8")
    except OSError:  # not Linux
        return PROGRAM
    return (
        ALLOCATED
        + RUNNING
        + 1024 * sum(int(kilobytes) for kilobytes in re.findall(r"^Rss(?:File|Shmem):\s+(\d+)", status, re.M))
    )


def of_sequence(sequence: FrameSequence, held: DevicePlanes, layers: Mapping[str, str] = NO_LAYERS) -> Memory:
    """Return the memory of a resolve of ``sequence``.

    ``layers`` are channels that are carried over -> "uint", "half" or "float": each stays until its result is written.
    Memory of packed files, of groups of planes and of results is reused from frame to frame. Decoded channels exist
    beside the planes of their frame until they are moved there; this counts for one of the frames read at a time, since
    they are seldom in step. In bands, one frame at a time is in memory, its result in its place, and beside it the
    counts of each pixel, and the result itself where it has alpha or halves; nothing is reused. Until frames of another
    tool are converted, each reader holds their channels twice.
    """
    width, height, channels, converted = sequence.width, sequence.height, sequence.channels, sequence.converted
    layouts = sequence.layouts.values()
    file, chunk = max(path.stat().st_size for path in sequence.files), max(each.chunk_bytes for each in layouts)
    banded, half = bool(held.band_rows), held.half
    plane, planes = REAL * width * height, 3 + held.steps.alpha
    groups = [len(group) for group in GROUPS if group[0] in channels]
    frame = sum(in_large_pages(REAL * count * Layout(width, height).plane) for count in groups)
    frame += (len(channels) - sum(groups)) * plane
    number = HALF if half else REAL
    image = _mapped(planes * number * width * height, banded)
    carried = sum(_mapped(PIXEL_BYTES[kind] * width * height, banded) for kind in layers.values())
    texel = planes * number + sum(PIXEL_BYTES[kind] for name, kind in layers.items() if name not in MADE)
    in_bands = (1 + held.changes) * plane + (half or held.steps.alpha) * image
    frames, results, decoded = (1, in_bands, 1) if banded else (FRAMES, RESULTS * image, AHEAD)
    unpacking = (1 if converted else decoded) * OpenEXR.global_thread_count() * BLOCKS * chunk
    readers, writers = (1, 1) if banded else (AHEAD, BEHIND)
    beside = 0 if banded else sum(groups)
    if converted:
        beside = readers * 2 * len(channels)
    # OpenEXR's module decodes every channel, whether it is read or not.
    spare = max(0, max(len(each.channels) for each in layouts) - len(channels))
    beside += spare * (readers if converted else 1)
    blocks = exr_zip.THREADS * (BLOCKS - 1) + writers * exr_zip.BEGUN
    packing = blocks * texel * width * min(exr_zip.ROWS, height)
    return Memory(
        device=device_bytes(width, height, held),
        frames=frames * frame,
        layers=(held.look_ahead + (1 if banded else RESULTS)) * carried,
        results=results,
        reading=readers * file + beside * plane,
        packing=unpacking + packing,
    )


def _mapped(size: int, banded: bool) -> int:
    """Return the bytes of planes of that ``size`` in memory that is reused from frame to frame."""
    return size if banded or size < SMALLEST else in_large_pages(size)
