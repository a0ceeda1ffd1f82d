"""``cltaa bench kernels``: the kernels against a shader, a plain port and the floor, in one run."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from cltaa.core.build import Storage
from cltaa.core.presets import Preset
from cltaa.core.resolver import Resolver
from cltaa.errors import CltaaError, UsageError
from cltaa.frame import Frame, Image
from cltaa.lab.bench.contenders import (
    BASELINE,
    BORDER,
    PlainPort,
    Shader,
    check_same,
    copy_job,
    least_bytes,
)
from cltaa.lab.bench.environment import Environment, environment, load_average
from cltaa.lab.bench.frames import Motion, make_frames
from cltaa.lab.timing import (
    Clock,
    Interval,
    Job,
    Samples,
    measure,
    resolve_job,
    too_noisy,
)
from cltaa.opencl.launcher import DeviceLauncher

CORE, COPY, PORT, SHADER = "core", "copy", "plain port", "GLSL"
CONTROL = "core again"


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """What one contender took. Bandwidth and floor count the bytes that it would have to move at least."""

    name: str
    wall_ns: Interval  # a pixel
    device_ns: Interval | None  # a pixel, by the device's events
    least_wall_ns: float
    ratio: Interval  # of wall time to the core's, paired
    device_ratio: Interval | None
    gigabytes_a_second: float
    of_floor: float  # floor over time: 1 is the floor
    difference: float | None = None  # from the core's image, over its brightest value


class Timing(msgspec.Struct, frozen=True, kw_only=True):
    """All contenders under one kind of motion."""

    motion: Motion
    rows: list[Row]
    absent: dict[str, str]  # contender: why it could not run
    opengl: str | None  # who drew the shader
    noisy: bool  # by the host's clock: rows without device times cannot be ranked
    device_noisy: bool  # by the device's: the others cannot
    floor_ns: float  # a pixel: the core's bytes at the bandwidth of the copy
    copy_gigabytes_a_second: float


class KernelBench(msgspec.Struct, frozen=True, kw_only=True):
    """The whole measurement."""

    width: int
    height: int
    storage: Storage
    rounds: int
    environment: Environment
    timings: list[Timing]


class Contenders:
    """The jobs under one kind of motion, with what each moves and how far its image is from the core's."""

    def __init__(self, launcher: DeviceLauncher, storage: Storage, frames: list[Frame]) -> None:
        self._launcher, self._storage, self._frames = launcher, storage, frames
        self.jobs: list[Job] = []
        self.moved: dict[str, int] = {}  # bytes a pixel
        self.difference: dict[str, float] = {}
        self.absent: dict[str, str] = {}
        self.opengl: str | None = None
        self._shader: Shader | None = None
        self.core = self._add_preset(CORE, BASELINE)
        self.jobs.append(Job(CONTROL, self.jobs[0].run))
        self.moved[CONTROL] = self.moved[CORE]

    def _add_preset(self, name: str, preset: Preset) -> Image:
        resolver = Resolver(preset, self._launcher, storage=self._storage)
        job, image = resolve_job(name, resolver, self._frames)
        self.jobs.append(job)
        self.moved[name] = least_bytes(resolver, self._storage)
        return image

    def add_presets(self, presets: Sequence[Preset]) -> None:
        """Add presets as they are, which need not compute what the core does."""
        for preset in presets:
            self._add_preset(preset.name, preset)

    def add_ports(self) -> None:
        """Add the plain port and the shader, each checked against the core's image."""
        size = self._frames[0].width, self._frames[0].height
        self._add_port(PORT, PlainPort(self._launcher, self._storage, *size))
        try:
            self._shader = Shader(self._storage, *size)
        except CltaaError as error:
            self.absent[SHADER] = str(error)
            return
        self.opengl = self._shader.renderer
        self._add_port(SHADER, self._shader)

    def _add_port(self, name: str, port: PlainPort | Shader) -> None:
        image = self.core
        for index, frame in enumerate(self._frames):
            image = port.resolve(frame, self._frames[index - 1] if index else None)
        self.difference[name] = check_same(name, image, self.core, self._storage)
        self.jobs.append(Job(name, port.run))
        self.moved[name] = self.moved[CORE]

    def release(self) -> None:
        """Free the OpenGL context."""
        if self._shader is not None:
            self._shader.release()


def bench_kernels(
    presets: Sequence[Preset],
    device: str | None,
    *,
    width: int,
    height: int,
    motions: Sequence[Motion],
    rounds: int,
    storage: Storage = Storage.FLOAT,
) -> KernelBench:
    """Time the kernels of ``presets`` and of the core against everything else on ``device``.

    Raises UsageError for the NumPy launcher and an image that is all border, and InternalError where a contender
    computes something else.
    """
    least = 2 * BORDER + 1
    if min(width, height) < least:
        expected = f"at least {least}x{least}"
        raise UsageError("too small to compare images in", expected=expected, found=f"{width}x{height}")
    if device == "numpy":
        raise UsageError("bench kernels times OpenCL kernels", cure="name an OpenCL device")
    launcher, before = DeviceLauncher(device), load_average()
    timings = []
    for motion in motions:
        contenders = Contenders(launcher, storage, make_frames(width, height, motion))
        try:
            contenders.add_presets(presets)
            contenders.add_ports()
            timings.append(_timing(contenders, launcher, motion, width * height, rounds))
        finally:
            contenders.release()
    return KernelBench(
        width=width,
        height=height,
        storage=storage,
        rounds=rounds,
        environment=environment(launcher.description, before),
        timings=timings,
    )


def _timing(
    contenders: Contenders,
    launcher: DeviceLauncher,
    motion: Motion,
    pixels: int,
    rounds: int,
) -> Timing:
    moved = contenders.moved[CORE] * pixels
    jobs = [*contenders.jobs, copy_job(launcher, moved)]
    samples = measure(jobs, rounds, action="timing")
    # The device's own clock: on a GPU the host's would add the way there and back.
    bandwidth = moved / samples.interval(COPY, Clock.DEVICE).median
    rows = [
        _row(job.name, samples, pixels, contenders.moved.get(job.name, moved // pixels), bandwidth, contenders)
        for job in jobs
    ]
    return Timing(
        motion=motion,
        rows=rows,
        absent=contenders.absent,
        opengl=contenders.opengl,
        noisy=too_noisy(samples.ratio(CONTROL, CORE)),
        device_noisy=too_noisy(samples.ratio(CONTROL, CORE, Clock.DEVICE)),
        floor_ns=contenders.moved[CORE] / bandwidth * 1e9,
        copy_gigabytes_a_second=bandwidth * 1e-9,
    )


def _row(name: str, samples: Samples, pixels: int, moved: int, bandwidth: float, contenders: Contenders) -> Row:
    by_device, a_pixel = samples.has(name, Clock.DEVICE), 1e9 / pixels  # nanoseconds
    seconds = samples.interval(name, Clock.DEVICE).median
    return Row(
        name=name,
        wall_ns=samples.interval(name).times(a_pixel),
        device_ns=samples.interval(name, Clock.DEVICE).times(a_pixel) if by_device else None,
        least_wall_ns=float(samples.seconds(name).min()) * a_pixel,
        ratio=samples.ratio(name, CORE),
        device_ratio=samples.ratio(name, CORE, Clock.DEVICE) if by_device else None,
        gigabytes_a_second=moved * pixels / seconds * 1e-9,
        of_floor=moved * pixels / bandwidth / seconds,
        difference=contenders.difference.get(name),
    )
