"""``cltaa bench kernels``: time the kernels, a GLSL shader (extra ``bench``), a plain port and the floor in one run.

``BASELINE`` is the widely used core (3x3 variance, the nearest surface's motion, 16 taps of Catmull-Rom, clip, weighted
blend, a counter): its choices, which decide the time, without cltaa's additions in the settings.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources

import msgspec
import numpy as np

from cltaa.core.backend import storage_dtype
from cltaa.core.build import Build, Real, Record, settings_record
from cltaa.core.parameters import Accumulate, Box, Choices, Dilation, Rectify, Reject, Settings
from cltaa.core.planes import Layout
from cltaa.core.presets import Preset
from cltaa.core.record import Past, frame_record
from cltaa.core.resolver import Resolver
from cltaa.errors import CltaaError, DeviceMissing, InternalError, UsageError, import_extra
from cltaa.frame import Frame, Image
from cltaa.lab.timing import (
    Clock,
    Environment,
    Interval,
    Job,
    Motion,
    Samples,
    device_seconds,
    environment,
    load_average,
    make_frames,
    measure,
    resolve_job,
    too_noisy,
)
from cltaa.opencl.launcher import DeviceLauncher

BASELINE = Preset(
    name="baseline",
    description="the core that the plain ports compute too",
    choices=Choices(
        box=Box.VARIANCE,
        rectify=Rectify.CLIP,
        dilation=Dilation.CLOSEST,
        reject=Reject.NONE,
        accumulate=Accumulate.EXPONENTIAL,
    ),
    settings=Settings(resampling_penalty=0.0, disocclusion_blur=0.0),
)
PLAIN_GROUP = {True: (64, 1), False: (16, 16)}  # work-group of the plain port: on a CPU, on a GPU
COPY_BYTES = 16  # bytes per work-item of copy.cl
# Two orders of the same operations, one with the cancelling variance: at 1920 x 1080 99.9 % of pixels are within 8e-6.
TOLERANCE = 2.0**-14
# Beyond the image border the nearest surface is a tie, which contenders break differently; the history filter spreads
# the difference by 2 px a frame.
BORDER = 8
# Share of pixels just outside their box, or the image, where rounding decides.
ODD_PIXELS = 1e-3


class PlainPort:
    """``kernels/bench/plain.cl`` on a device: interleaved pixels, one per work-item, no halo."""

    def __init__(self, launcher: DeviceLauncher, width: int, height: int) -> None:
        launcher.device.time_commands()
        self._launcher, self._size = launcher, (width, height)
        build = Build(choices=BASELINE.choices, real=Real.FLOAT, lanes=1, rows=1)
        self._kernel = launcher.kernel("bench/plain", build)
        self._inverse_depth = launcher.allocate((height, width))
        self._current, self._history, self._output = (launcher.allocate((height, width, 4)) for _ in range(3))
        self._record: Record | None = None

    def resolve(self, frame: Frame, record: Record) -> Image:
        """Return the resolved image [H, W, 3] float32 of ``frame``; the previous call's output is the history."""
        with self._current.mapped(write=True) as pixels:
            pixels[..., :3], pixels[..., 3] = frame.colour, 1.0
        with self._inverse_depth.mapped(write=True) as plane:
            np.divide(np.float32(1.0), frame.depth, out=plane)
        self._record = record
        self._history, self._output = self._output, self._history
        self.run()
        with self._output.mapped(write=False) as pixels:
            return pixels[..., :3].astype(np.float32)

    def run(self) -> float:
        """Run the kernel again on the arguments of the last ``resolve``; return the device's seconds."""
        given = {
            "current": self._current,
            "inverse_depth": self._inverse_depth,
            "history": self._history,
            "output": self._output,
            "frame": self._record,
            "settings": settings_record(BASELINE.settings),
        }
        group = PLAIN_GROUP[self._launcher.device.is_cpu]
        columns, rows = (-(-extent // items) * items for extent, items in zip(self._size, group, strict=True))
        event = self._kernel.enqueue(self._launcher.device.queue, (columns, rows), group, given)
        self._launcher.finish()
        return device_seconds([(self._kernel.name, event)])


def copy_job(launcher: DeviceLauncher, moved: int) -> Job:
    """Return a job that copies ``moved`` bytes, half read and half written: the floor for kernels that move as many."""
    launcher.device.time_commands()
    items = max(moved // (2 * COPY_BYTES), 1)
    source, target = (launcher.allocate((items, COPY_BYTES // 4)) for _ in range(2))
    kernel = launcher.kernel("bench/copy", Build(lanes=1, rows=1))
    given = {"from": source, "to": target}

    def copy() -> float:
        event = kernel.enqueue(launcher.device.queue, (items,), None, given)
        launcher.finish()
        return device_seconds([(kernel.name, event)])

    return copy


def least_bytes(resolver: Resolver) -> int:
    """Return the bytes per pixel that the last frame's resolve must move: each input and output once."""
    assert resolver.plan is not None
    steps, choices = resolver.plan.steps, resolver.plan.choices
    real, kept = 4, np.dtype(storage_dtype(Build(storage=resolver.storage))).itemsize
    history = int(kept) * (4 if steps.alpha else 3)
    planes = 3 + 1 + 1 + 1  # colour, inverse depth, count read, count written
    planes += 2 * steps.own_motion + steps.alpha + steps.reactive + (choices.reject is Reject.DEPTH)
    return real * planes + 2 * history


def check_same(name: str, image: Image, expected: Image, *, border: int = BORDER) -> None:
    """Raise InternalError for images [H, W, 3] of different algorithms; ``border`` pixels are not compared.

    A preset and its oracle break ties alike, so that theirs needs no border.
    """
    height, width = expected.shape[:2]
    inside = (slice(border, height - border), slice(border, width - border))
    apart = np.abs(image - expected).max(axis=-1)[inside] / float(np.abs(expected).max())
    share = float((apart > TOLERANCE).mean())
    if share > ODD_PIXELS:
        raise InternalError(
            f"{name} does not compute what the resolve computes",
            expected=f"at most {ODD_PIXELS:.2%} of the pixels apart by more than {TOLERANCE:.1e} of the brightest",
            found=f"{share:.2%}",
            cure="its time would say nothing; see docs/performance.md",
        )


_FOLDER = resources.files("cltaa") / "lab" / "bench"


class Shader:
    """``resolve.frag`` on float textures of an off-screen context."""

    def __init__(self, width: int, height: int) -> None:
        moderngl = import_extra("moderngl", package="moderngl", extra="bench", purpose="timing the shader")
        try:
            self._context = moderngl.create_context(standalone=True, backend="egl")
        except Exception as error:  # moderngl raises what its backend raises, Exception itself among others
            raise DeviceMissing(f"no off-screen OpenGL: {error}", cure="see: cltaa doctor") from error
        gl = self._context
        self.renderer = f"{gl.info['GL_RENDERER']}, OpenGL {gl.info['GL_VERSION']}"
        self._inverse_depth = gl.texture((width, height), 1, dtype="f4")
        self._current, self._history, self._output = (gl.texture((width, height), 4, dtype="f4") for _ in range(3))
        for texture in (self._current, self._inverse_depth, self._history, self._output):
            texture.repeat_x = texture.repeat_y = False
            texture.filter = (gl.NEAREST, gl.NEAREST)
        self._program = gl.program(
            vertex_shader=(_FOLDER / "resolve.vert").read_text(encoding="utf-8"),
            fragment_shader=(_FOLDER / "resolve.frag").read_text(encoding="utf-8"),
        )
        for unit, name in enumerate(("current", "inverse_depth", "history")):
            self._program[name] = unit
        settings = BASELINE.settings
        self._program["limits"] = (
            settings.sample_limit,
            settings.blend_weight,
            settings.luminance_knee,
            settings.box_floor,
        )
        self._program["box"] = (settings.box_scale_static, settings.box_scale_moving, settings.motion_px)
        self._triangle = gl.vertex_array(self._program, [])
        self._targets = {texture: gl.framebuffer([texture]) for texture in (self._history, self._output)}

    def resolve(self, frame: Frame, record: Record) -> Image:
        """Return the resolved image [H, W, 3] float32 of ``frame``; the previous call's output is the history."""
        pixels = np.ones((frame.height, frame.width, 4), np.float32)
        pixels[..., :3] = frame.colour
        self._current.write(pixels.tobytes())
        self._inverse_depth.write((np.float32(1.0) / frame.depth).tobytes())
        self._program["displacement"] = _matrix(record)
        self._history, self._output = self._output, self._history
        self.run()
        read = np.frombuffer(self._output.read(), np.float32).reshape(frame.height, frame.width, 4)
        return read[..., :3]

    def run(self) -> float | None:
        """Draw the last ``resolve`` again; return the seconds by OpenGL's clock, None if that is unusable."""
        for unit, texture in enumerate((self._current, self._inverse_depth, self._history)):
            texture.use(unit)
        self._targets[self._output].use()
        query = self._context.query(time=True)
        with query:
            self._triangle.render(vertices=3)
        self._context.finish()
        # A software rasteriser's clock stops when the triangle is binned, not when its pixels are done.
        return None if "pipe" in self.renderer else float(query.elapsed) * 1e-9

    def release(self) -> None:
        """Free the context."""
        self._context.release()


def _matrix(record: Record) -> tuple[float, ...]:
    """Return the rows x, y, w of D and the origin, as the columns of a mat4."""
    rows = [[float(record[letter + by]) for by in "xyq1"] for letter in "xyw"]
    last = [float(record["origin_x"]), float(record["origin_y"]), float(record["reset"]), 0.0]
    return tuple(value for row in [*rows, last] for value in row)


CORE, COPY, PORT, SHADER = "core", "copy", "plain port", "GLSL"
CONTROL = "core again"


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """Times of one contender. Bandwidth and floor count the least bytes that it must move."""

    name: str
    wall_ns: Interval  # per pixel
    device_ns: Interval | None  # per pixel, by the device's events
    least_wall_ns: float
    ratio: Interval  # of wall time to the core's, paired
    device_ratio: Interval | None
    gigabytes_a_second: float
    of_floor: float  # floor over time: 1 is the floor


class Timing(msgspec.Struct, frozen=True, kw_only=True):
    """All contenders under one kind of motion."""

    motion: Motion
    rows: list[Row]
    absent: dict[str, str]  # contender -> why it could not run
    opengl: str | None  # renderer of the shader
    noisy: bool  # the host's clock is too noisy to rank rows without device times
    device_noisy: bool  # the device's clock is too noisy to rank the other rows
    floor_ns: float  # per pixel: the core's bytes at the bandwidth of the copy
    copy_gigabytes_a_second: float


class KernelBench(msgspec.Struct, frozen=True, kw_only=True):
    """The whole measurement."""

    width: int
    height: int
    rounds: int
    environment: Environment
    timings: list[Timing]


class Contenders:
    """The jobs under one kind of motion, with the bytes that each moves."""

    def __init__(self, launcher: DeviceLauncher, frames: list[Frame]) -> None:
        self._launcher, self._frames = launcher, frames
        self.jobs: dict[str, Job] = {}
        self.moved: dict[str, int] = {}  # bytes per pixel
        self.absent: dict[str, str] = {}
        self.opengl: str | None = None
        self._shader: Shader | None = None
        self.core = self.add_preset(CORE, BASELINE)
        self.jobs[CONTROL] = self.jobs[CORE]
        self.moved[CONTROL] = self.moved[CORE]

    def add_preset(self, name: str, preset: Preset) -> Image:
        """Add an unchanged preset, which may compute something else than the core; returns its image."""
        resolver = Resolver(preset, self._launcher)
        self.jobs[name], image = resolve_job(resolver, self._frames)
        self.moved[name] = least_bytes(resolver)
        return image

    def add_ports(self) -> None:
        """Add the plain port and the shader, each checked against the core's image."""
        size = self._frames[0].width, self._frames[0].height
        self._add_port(PORT, PlainPort(self._launcher, *size))
        try:
            self._shader = Shader(*size)
        except CltaaError as error:
            self.absent[SHADER] = str(error)
            return
        self.opengl = self._shader.renderer
        self._add_port(SHADER, self._shader)

    def _add_port(self, name: str, port: PlainPort | Shader) -> None:
        image, past = self.core, None
        for frame in self._frames:
            image = port.resolve(frame, frame_record(frame, past, Layout(frame.width, frame.height)))
            past = Past.of(frame)
        check_same(name, image, self.core)
        self.jobs[name] = port.run
        self.moved[name] = self.moved[CORE]

    def release(self) -> None:
        """Free the OpenGL context."""
        if self._shader is not None:
            self._shader.release()


def bench_kernels(
    presets: Sequence[Preset], device: str | None, *, width: int, height: int, motions: Sequence[Motion], rounds: int
) -> KernelBench:
    """Time the kernels of ``presets`` and of the core against the other contenders on ``device``.

    Raises UsageError for the NumPy launcher and for an image no larger than its border, and InternalError if a
    contender computes something else.
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
        contenders = Contenders(launcher, make_frames(width, height, motion))
        try:
            for preset in presets:
                contenders.add_preset(preset.name, preset)
            contenders.add_ports()
            timings.append(_timing(contenders, launcher, motion, width * height, rounds))
        finally:
            contenders.release()
    return KernelBench(
        width=width,
        height=height,
        rounds=rounds,
        environment=environment(launcher.description, before),
        timings=timings,
    )


def _timing(contenders: Contenders, launcher: DeviceLauncher, motion: Motion, pixels: int, rounds: int) -> Timing:
    moved = contenders.moved[CORE] * pixels
    jobs = contenders.jobs | {COPY: copy_job(launcher, moved)}
    samples = measure(jobs, rounds, action="timing")
    # By the device's own clock, because on a GPU the host's would add transfers.
    bandwidth = moved / samples.interval(COPY, Clock.DEVICE).median
    rows = [_row(name, samples, pixels, contenders.moved.get(name, moved // pixels), bandwidth) for name in jobs]
    return Timing(
        motion=motion,
        rows=rows,
        absent=contenders.absent,
        opengl=contenders.opengl,
        noisy=too_noisy(samples.ratio(CONTROL, CORE, Clock.WALL)),
        device_noisy=too_noisy(samples.ratio(CONTROL, CORE, Clock.DEVICE)),
        floor_ns=contenders.moved[CORE] / bandwidth * 1e9,
        copy_gigabytes_a_second=bandwidth * 1e-9,
    )


def _row(name: str, samples: Samples, pixels: int, moved: int, bandwidth: float) -> Row:
    by_device, a_pixel = samples.has(name, Clock.DEVICE), 1e9 / pixels  # nanoseconds
    seconds = samples.interval(name, Clock.DEVICE).median
    return Row(
        name=name,
        wall_ns=samples.interval(name, Clock.WALL).times(a_pixel),
        device_ns=samples.interval(name, Clock.DEVICE).times(a_pixel) if by_device else None,
        least_wall_ns=float(samples.seconds(name, Clock.WALL).min()) * a_pixel,
        ratio=samples.ratio(name, CORE, Clock.WALL),
        device_ratio=samples.ratio(name, CORE, Clock.DEVICE) if by_device else None,
        gigabytes_a_second=moved * pixels / seconds * 1e-9,
        of_floor=moved * pixels / bandwidth / seconds,
    )
