"""``cltaa bench devices``: find the fastest of a few kernel shapes on a device."""

from __future__ import annotations

import time
from pathlib import Path

import msgspec
import numpy as np

from cltaa.core.build import code_sha256
from cltaa.core.presets import load_preset
from cltaa.core.resolver import Resolver
from cltaa.errors import InternalError, OutputError
from cltaa.frame import Frame, Image
from cltaa.io.atomic import atomic_path, make_folder
from cltaa.lab.bench.kernels import check_same
from cltaa.lab.timing import (
    Clock,
    Environment,
    Interval,
    Job,
    Motion,
    Samples,
    environment,
    load_average,
    make_frames,
    measure,
    resolve_job,
)
from cltaa.opencl.device import candidate_shapes, choose_device, describe, is_cpu, measured_on, usual_shape
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.opencl.shape import SHAPES, Kept, kept_folder, kept_path
from cltaa.progress import track

CPU_SIZE, GPU_SIZE = (640, 360), (1920, 1080)  # large enough to fill a GPU; small because unsuitable lanes are slow
ROUNDS, WARM_UP = 9, 2  # few, because an unsuitable shape takes ten times as long
PAYS = 0.95  # largest share of the usual shape's time: docs/decisions/14 accepts no smaller gain
PROOF_SIZE = 160, 90
PROVEN = ("default", "fast")  # Rusticl of Mesa 25.0 is right for the default, wrong for fast
WILD = 0.02  # share of invalid pixels in the test: Rusticl of Mesa 22.3 is right on all others
LEAST_SHARE = 0.01  # least share of the host's time on a working device clock; Rusticl's counts only nanoseconds
# Seconds of building after which no other shape is begun, because a compiler may take minutes for vectors. The usual
# shape comes first.
PATIENCE = 60.0


class ShapeRow(msgspec.Struct, frozen=True, kw_only=True):
    """One shape: seconds of two frames, one for each kind of motion, or why it was not timed."""

    shape: str
    lanes: int
    seconds: Interval | None = None
    ratio: Interval | None = None  # to the usual shape, or if that was not timed, to the first
    absent: str | None = None


class ShapesBench(msgspec.Struct, frozen=True, kw_only=True):
    """The whole measurement, the chosen shape, and the file that stores it."""

    usual: str
    origin: str  # of the usual shape: "built in", or "a guess"
    taken: str
    kept: str
    rows: list[ShapeRow]
    environment: Environment


def bench_shapes(device: str | None) -> ShapesBench:
    """Time the default on ``device`` in each shape, and store the fastest.

    The usual shape stays unless another is faster beyond chance and by PAYS. Raises UsageError for the NumPy launcher,
    InternalError if no shape builds, and OutputError if the answer cannot be stored.
    """
    cl_device, before = choose_device(device), load_average()
    (usual, origin), names, facts = usual_shape(cl_device), candidate_shapes(cl_device), measured_on(cl_device)
    make_folder(_folder())
    jobs, absent = _jobs(device, names, CPU_SIZE if is_cpu(cl_device) else GPU_SIZE)
    base = usual if usual in jobs else next(iter(jobs))
    samples = measure(jobs, ROUNDS, warm_up=WARM_UP, action="timing")
    clock = clock_of(samples)
    taken = fastest(samples, base, clock)
    with atomic_path(kept_path(facts)) as path:
        path.write_bytes(msgspec.json.encode(Kept(measured_on=facts, code=code_sha256(), shape=taken)))
    return ShapesBench(
        usual=usual,
        origin=origin,
        taken=taken,
        kept=str(kept_path(facts)),
        rows=[_row(name, base, samples, clock, absent) for name in names],
        environment=environment(describe(cl_device), before, units=cl_device.max_compute_units),
    )


def forget_shapes() -> int:
    """Remove the stored shapes of all devices; returns the number of files."""
    paths = [path for path in _folder().glob("*.json") if path.is_file()]
    for path in paths:
        path.unlink(missing_ok=True)
    return len(paths)


def _folder() -> Path:
    try:
        return kept_folder()
    except RuntimeError:
        raise OutputError("no home to keep shapes in", cure="name a folder by XDG_CACHE_HOME") from None


def clock_of(samples: Samples) -> Clock:
    """Return the device's clock, which excludes transfers, if it works, else the host's."""
    runs = [sample for by_round in samples.by_job.values() for sample in by_round]
    return Clock.DEVICE if all((run.device or 0.0) > LEAST_SHARE * run.wall for run in runs) else Clock.WALL


def fastest(samples: Samples, base: str, clock: Clock) -> str:
    """Return the shape with the greatest sufficient gain over ``base``, else ``base``."""
    ratios = {name: samples.ratio(name, base, clock) for name in samples.by_job}
    paying = [name for name, ratio in ratios.items() if ratio.high < 1.0 and ratio.median <= PAYS]
    return min(paying, key=lambda name: ratios[name].median, default=base)


def _jobs(device: str | None, names: list[str], size: tuple[int, int]) -> tuple[dict[str, Job], dict[str, str]]:
    """Return a job for each shape that builds and matches the oracle, and the reason for each other shape."""
    motions, proof = [make_frames(*size, motion) for motion in Motion], wild_frames()
    oracles = {preset: last_image(Resolver(preset, "numpy"), proof) for preset in PROVEN}
    jobs, absent, deadline = dict[str, Job](), dict[str, str](), time.monotonic() + PATIENCE
    for name in track(names, len(names), "building", unit="shapes"):
        if jobs and time.monotonic() > deadline:
            absent[name] = f"not tried: the others took more than {PATIENCE:.0f} s to build"
            continue
        try:
            launcher = DeviceLauncher(device)
            launcher.device.shape = SHAPES[name]
            for preset, oracle in oracles.items():
                check_same(name, last_image(Resolver(preset, launcher), proof), oracle, border=0)
            jobs[name] = _job(launcher, motions)
        except InternalError as error:
            absent[name] = str(error)
            if name == names[-1] and not jobs:
                raise
    return jobs, absent


def wild_frames() -> list[Frame]:
    """Return three small frames with some invalid pixels in colour and depth."""
    frames, random = make_frames(*PROOF_SIZE, Motion.TURN), np.random.default_rng(0)
    for frame in frames:
        for plane, values in ((frame.colour, (np.nan, np.inf, -1.0)), (frame.depth, (np.nan, 0.0))):
            wild = random.random(plane.shape) < WILD
            plane[wild] = random.choice(values, int(wild.sum()))
    return frames


def last_image(resolver: Resolver, frames: list[Frame]) -> Image:
    """Return the image [H, W, 3] float32 of the last frame, infinite where it is NaN."""
    image = [resolver.resolve(frame) for frame in frames][-1]
    return np.where(np.isnan(image), np.float32(np.inf), image)  # NaN would compare as within any bound


def _job(launcher: DeviceLauncher, motions: list[list[Frame]]) -> Job:
    each = [resolve_job(Resolver(load_preset(), launcher), frames)[0] for frames in motions]
    return lambda: sum(job() or 0.0 for job in each)


def _row(name: str, base: str, samples: Samples, clock: Clock, absent: dict[str, str]) -> ShapeRow:
    lanes = SHAPES[name].lanes
    if name in absent:
        return ShapeRow(shape=name, lanes=lanes, absent=absent[name])
    seconds, ratio = samples.interval(name, clock), samples.ratio(name, base, clock)
    return ShapeRow(shape=name, lanes=lanes, seconds=seconds, ratio=ratio)
