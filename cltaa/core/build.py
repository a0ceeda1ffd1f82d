"""The build of a kernel: its source, behind a prelude with structs, constants and choices."""

from __future__ import annotations

import hashlib
import re
from enum import StrEnum
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from numpy.typing import NDArray

from cltaa.core.constants import CENTRED_WINDOWS, CONSTANTS, FIRST_WINDOWS, LONG_WINDOW, PAD_X, PAD_Y, WHOLE_NUMBERS
from cltaa.core.parameters import HOST_CHOICES, KERNEL_SETTINGS, Choices, Recursion, Settings
from cltaa.errors import UsageError, known

if TYPE_CHECKING:
    from collections.abc import Iterator


class Real(StrEnum):
    """The type in which the stages compute."""

    FLOAT = "float"
    DOUBLE = "double"


class Storage(StrEnum):
    """The type in which the history is stored."""

    FLOAT = "float"
    HALF = "half"  # rounded to nearest: an old history stops within ulp / (2 weight) of its target
    HALF_STOCHASTIC = "half-stochastic"  # rounded up or down at random: unbiased, but noisy
    DOUBLE = "double"  # only for the ladder of cltaa bench accuracy


def storage_of(name: str) -> Storage:
    """Return the storage of that name; raises UsageError: kernels of an unknown one would write beyond memory."""
    try:
        return Storage(name)
    except ValueError:
        raise UsageError(f"no such storage {name}", cure=known(str(name), Storage, "storages")) from None


HALVES = (Storage.HALF, Storage.HALF_STOCHASTIC)
BUILDS_KEPT = 64  # of resolves, and of the kernels that copy results
# The storages that a user can choose.
STORAGES = (Storage.FLOAT, *HALVES)


class Steps(msgspec.Struct, frozen=True, kw_only=True, cache_hash=True):
    """The optional steps that a frame needs; the others are not compiled."""

    camera_motion: bool = True
    own_motion: bool = True
    orthographic: bool = False
    exposure: bool = True
    alpha: bool = False
    reactive: bool = False
    look_ahead: bool = False
    long_ring: bool = False  # of more than LONG_WINDOW frames, some of them ahead
    centred: bool = False  # as many of the nearest frames are ahead as earlier, for the shortest window at least


class Terms(msgspec.Struct, frozen=True, kw_only=True, cache_hash=True):
    """The terms that have an effect with these settings. The others are not compiled, which changes no bit."""

    resampling_penalty: bool = True
    box_scale_by_motion: bool = True
    disocclusion_blur: bool = True
    first_samples: bool = True
    luma_scale: bool = True
    box_leak: bool = True
    covered_share: bool = True

    @classmethod
    def of(cls, settings: Settings) -> Terms:
        """Return the terms that have an effect with ``settings``."""
        return cls(
            resampling_penalty=settings.resampling_penalty != 0.0,
            box_scale_by_motion=settings.box_scale_static != settings.box_scale_moving,
            disocclusion_blur=settings.disocclusion_blur != 0.0,
            first_samples=settings.first_samples != 1.0,
            luma_scale=settings.luma_scale != 1.0,
            box_leak=settings.box_leak != 0.0,
            covered_share=settings.covered_share != 1.0,
        )


def ring_planes(steps: Steps) -> int:
    """Return the planes of a frame in the ring: r, g, b, inverse depth, and what steps read."""
    return 4 + 2 * steps.own_motion + steps.alpha + steps.reactive


def ring_steps(frames: int, ahead: int) -> dict[str, bool]:
    """Return the steps that a ring of ``frames`` earlier and ``ahead`` later ones decides."""
    return {"look_ahead": ahead > 0, "long_ring": ahead > 0 and frames + ahead > LONG_WINDOW}


def first_windows(*, centred: bool) -> tuple[int, int]:
    """Return the frames of the ring in the first two temporal windows (SHORT_WINDOW, MIDDLE_WINDOW)."""
    return CENTRED_WINDOWS if centred else FIRST_WINDOWS


def unmoved_window(steps: Steps) -> int:
    """Return the place of the temporal window that follows no motion, after those of the ring (UNMOVED)."""
    return 3 + steps.long_ring


def window_count(choices: Choices, steps: Steps) -> int:
    """Return the number of temporal windows of a pixel: two more beside a recursive resolve (WINDOWS)."""
    return unmoved_window(steps) + 1 + 2 * (choices.recursion is Recursion.STANDING)


def window_planes(steps: Steps) -> int:
    """Return the planes of a window: r, g, b, error, count, and alpha where steps read it (WINDOW_PLANES)."""
    return 5 + steps.alpha


class Build(msgspec.Struct, frozen=True, kw_only=True, cache_hash=True):
    """Everything that decides a kernel's text and flags, apart from its source files."""

    choices: Choices = Choices()
    steps: Steps = Steps()
    terms: Terms = Terms()
    real: Real = Real.FLOAT
    storage: Storage = Storage.FLOAT
    lanes: int = 0  # 0: the device's
    rows: int = 0
    stride: int = 0  # texels between rows of a plane, where kernels are built for one width; 0: any
    plane: int = 0  # texels of a plane, where kernels are built for one size of whole images; 0: any
    registers: int = 0  # most registers of a work-item, where the compiler takes a limit; 0: no limit
    columns_ahead: int = 0  # distance of the prefetch to the right, in work-items (kernels/schedule/ahead.h)
    far_first: bool = False  # whether that prefetch fills the first-level cache too, not the second alone
    strict: bool = False
    relaxed: bool = False  # built with -cl-fast-relaxed-math: only for timing (decisions/04)

    @property
    def extends(self) -> bool:
        """True where kernels repeat the edges of what they store, as on a CPU (``kernels/schedule/edges.h``)."""
        return self.lanes > 1

    def flags(self) -> tuple[str, ...]:
        """Return the options of the OpenCL compiler."""
        always: tuple[str, ...] = ("-cl-std=CL1.2", "-Werror", "-cl-kernel-arg-info")
        if self.registers:
            always += (f"-cl-nv-maxrregcount={self.registers}",)
        if self.strict:
            return (*always, "-cl-fp32-correctly-rounded-divide-sqrt")
        return (*always, "-cl-fast-relaxed-math") if self.relaxed else always


def build_of(asked: Build, choices: Choices, settings: Settings, steps: Steps) -> Build:
    """Return the build of a frame's kernels: what was ``asked`` for, and what the frame's plan decides.

    ``Launcher.build`` then adds the shape of a device.
    """
    return msgspec.structs.replace(asked, choices=choices, steps=steps, terms=Terms.of(settings))


@lru_cache(maxsize=BUILDS_KEPT)
def edge_build(build: Build) -> Build:
    """Return the build of ``extend_edges`` and ``pack``: they copy the result, by lanes, rows and storage alone."""
    return Build(lanes=build.lanes, rows=build.rows, storage=build.storage)


@lru_cache(maxsize=BUILDS_KEPT)
def mix_build(build: Build) -> Build:
    """Return the build of ``mix_windows``, which many ways to gather share: it looks at few of their choices."""
    asked = build.choices
    choices = Choices(negatives=asked.negatives, recursion=asked.recursion, weighting=asked.weighting)
    its = build.steps
    steps = Steps(alpha=its.alpha, look_ahead=its.look_ahead, long_ring=its.long_ring, centred=its.centred)
    return msgspec.structs.replace(build, choices=choices, steps=steps, terms=Terms())


# The per-frame struct: name -> (C type, meaning). All members have 4 bytes, so that every compiler lays it out alike.
FRAME_FIELDS: dict[str, tuple[str, str]] = {
    "width": ("int", "pixels a row"),
    "height": ("int", "rows"),
    "stride": ("int", "floats from one row to the next"),
    "first_row": ("int", "row of the image that the planes of the frame begin with"),
    "band_rows": ("int", "rows that the planes of the frame hold; 0: all"),
    "reset": ("int", "1: there is no history"),
    "number": ("int", "number of the frame, for what differs from frame to frame"),
    "origin_x": ("float", "px of pixel x's sample = x + origin_x: 0.5 + jitter - width / 2"),
    "origin_y": ("float", "py of pixel y's sample = y + origin_y: 0.5 + jitter - height / 2"),
    "xx": ("float", "row x of D, by px"),
    "xy": ("float", "row x of D, by py"),
    "xq": ("float", "row x of D, by inverse depth"),
    "x1": ("float", "row x of D, constant"),
    "yx": ("float", "row y of D, by px"),
    "yy": ("float", "row y of D, by py"),
    "yq": ("float", "row y of D, by inverse depth"),
    "y1": ("float", "row y of D, constant"),
    "wx": ("float", "row w of D, by px"),
    "wy": ("float", "row w of D, by py"),
    "wq": ("float", "row w of D, by inverse depth"),
    "w1": ("float", "row w of D, constant"),
    "zx": ("float", "change of inverse depth by px (orthographic)"),
    "zy": ("float", "change of inverse depth by py (orthographic)"),
    "zq": ("float", "change of inverse depth by inverse depth (orthographic)"),
    "z1": ("float", "change of inverse depth, constant (orthographic)"),
    "sky_inverse_depth": ("float", "inverse depth of the sky"),
    "exposure_ratio": ("float", "exposure now over exposure then"),
    "jitter_x": ("float", "the frame's sample, in pixels right of the pixel's centre"),
    "jitter_y": ("float", "the same, below it"),
    "slot": ("int", "slot of the ring that holds the frame"),
    "ahead": ("int", "frames after the current one; negative: before"),
    "left_weight": ("float", "weight of the left column in the current filter"),
    "right_weight": ("float", "weight of the right column"),
    "above_weight": ("float", "weight of the row above"),
    "below_weight": ("float", "weight of the row below"),
    "box_left": ("float", "weight of the left column in the jittered neighbourhood, over that of the middle one"),
    "box_right": ("float", "weight of the right column"),
    "box_above": ("float", "weight of the row above, over that of the middle one"),
    "box_below": ("float", "weight of the row below"),
    "own_vectors": ("int", "1: the frame was given with motion vectors"),
    "camera_moved": ("int", "1: the camera differs from that of the frame before"),
}

# A struct of a kernel as a 0-dimensional structured array.
Record = NDArray[np.void]

_NUMPY_TYPES = {"int": np.int32, "float": np.float32}
FRAME_DTYPE = np.dtype([(name, _NUMPY_TYPES[kind]) for name, (kind, _) in FRAME_FIELDS.items()])
SETTINGS_KEPT = 16  # most cached records: the frames of a sequence have one, or a few by their effects
SETTINGS_DTYPE = np.dtype([(name, np.float32) for name in KERNEL_SETTINGS])


@lru_cache(maxsize=SETTINGS_KEPT)
def settings_record(settings: Settings) -> Record:
    """Return the settings as the struct that a kernel receives, each rounded to float32; read-only."""
    record = np.array(tuple(getattr(settings, name) for name in KERNEL_SETTINGS), SETTINGS_DTYPE)
    record.flags.writeable = False
    return record


def _macro(name: str) -> str:
    return name.upper().replace("-", "_")


def _enum_lines(name: str, value: StrEnum) -> Iterator[str]:
    macro = _macro(name)
    for number, member in enumerate(type(value)):
        yield f"#define {macro}_{_macro(member.value)} {number}"
    yield f"#define {macro} {macro}_{_macro(value.value)}"


def _struct_lines(name: str, fields: dict[str, str]) -> Iterator[str]:
    yield "typedef struct {"
    yield from (f"    {kind} {field};" for field, kind in fields.items())
    yield f"}} {name};"


# Members of a build that kernels see under their own names.
SHAPED = "lanes", "rows", "stride", "plane", "columns_ahead", "far_first", "strict", "relaxed"


def prelude(build: Build) -> str:
    """Return the text in front of every kernel: build constants, choices, named constants and structs."""
    numbers = {
        **{_macro(name): int(getattr(build, name)) for name in SHAPED},
        "REAL_DOUBLE": int(build.real is Real.DOUBLE),
        "STORAGE_DOUBLE": int(build.storage is Storage.DOUBLE),
        "STORAGE_HALF": int(build.storage in HALVES),
        "STORAGE_STOCHASTIC": int(build.storage is Storage.HALF_STOCHASTIC),
        **WHOLE_NUMBERS,
        **dict(zip(("SHORT_WINDOW", "MIDDLE_WINDOW"), first_windows(centred=build.steps.centred), strict=True)),
        **{_macro(name): int(getattr(build.steps, name)) for name in Steps.__struct_fields__},
        **{_macro(name): int(getattr(build.terms, name)) for name in Terms.__struct_fields__},
    }
    lines = [f"#define {name} {value}" for name, value in numbers.items()]
    for name in sorted(set(Choices.__struct_fields__) - HOST_CHOICES):
        lines.extend(_enum_lines(name, getattr(build.choices, name)))
    for name, constant in CONSTANTS.items():
        as_float = f"{float(np.float32(constant.value)).hex()}f"
        lines.append(f"#define {name} {as_float if build.real is Real.FLOAT else constant.value.hex()}")
    lines.extend(_struct_lines("frame_t", {name: kind for name, (kind, _) in FRAME_FIELDS.items()}))
    lines.extend(_struct_lines("settings_t", dict.fromkeys(KERNEL_SETTINGS, "float")))
    return "\n".join(lines) + "\n"


# The function of a kernel has the suffix _kernel, so that the stage function can have the plain name.
_ENTRY = re.compile(r"^__kernel void (\w+)_kernel\(", re.MULTILINE)

# Raise it where changed Python code changes bits, or a folder of results changes its contents: then no run resumes one
# of the earlier code.
FORMAT = 4


@cache
def kernel_folder() -> Path:
    """Return the folder of the kernels: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    packaged = package / "kernels"
    return packaged if packaged.is_dir() else package.parent / "kernels"


@cache
def kernel_files() -> dict[str, str]:
    """Return the entry points of all kernels, sorted, each with its file."""
    files = sorted(kernel_folder().glob("*.cl"))
    return dict(sorted((name, path.name) for path in files for name in _ENTRY.findall(path.read_text("utf-8"))))


def kernel_names() -> list[str]:
    """Names of all kernels, sorted."""
    return list(kernel_files())


@cache
def code_sha256() -> str:
    """Return the SHA-256 of what decides a result besides preset and device: kernels, constants and ``FORMAT``."""
    folder = kernel_folder()
    values = {name: constant.value for name, constant in CONSTANTS.items()}
    digest = hashlib.sha256(repr([FORMAT, PAD_X, PAD_Y, sorted(values.items())]).encode())
    for path in sorted([*folder.rglob("*.cl"), *folder.rglob("*.h")]):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _pasted(name: str, seen: set[str]) -> list[str]:
    lines = [f'#line 1 "{name}"']
    for number, line in enumerate((kernel_folder() / name).read_text(encoding="utf-8").splitlines(), start=1):
        if not line.startswith("#include"):
            lines.append(line)
        elif (included := line.split('"')[1]) not in seen:
            seen.add(included)
            lines += [*_pasted(included, seen), f'#line {number + 1} "{name}"']
    return lines


@cache
def source(kernel: str, build: Build) -> str:
    """Return the whole text of a kernel as the compiler sees it: prelude, then the file with its includes pasted."""
    name = kernel_files().get(kernel, f"{kernel}.cl")  # benchmark kernels have a folder of their own
    if not (kernel_folder() / name).is_file():
        raise UsageError(f"unknown kernel {kernel}", cure=known(kernel, kernel_names(), "kernels"))
    return prelude(build) + "\n".join(_pasted(name, set())) + "\n"


def source_hash(kernel: str, build: Build) -> str:
    """Return the SHA-256 of a kernel's name, text and flags, which decide a result on one device."""
    return hashlib.sha256("\0".join([kernel, source(kernel, build), *build.flags()]).encode()).hexdigest()
