"""Capture a sequence: draw the missing frames, write them in a thread, and update the manifest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cltaa.errors import CltaaError, ResourceError, UsageError
from cltaa.frame import Effect, Frame, Image, format_effects
from cltaa.io.atomic import make_folder, owned
from cltaa.io.exr_frame import Pixels, frame_attributes, frame_planes
from cltaa.io.exr_header import LARGEST_SIDE
from cltaa.io.manifest import file_sha256
from cltaa.io.streams import Writer
from cltaa.printable import counted
from cltaa_capture.jitter import LONGEST_PERIOD, USUAL, jitter_sequence
from cltaa_capture.manifest import REFERENCE, Manifest, code_sha256, frame_name, versions
from cltaa_capture.osmesa import Context, open_context
from cltaa_datasets.model_files import content_sha256, default_motion
from cltaa_datasets.scene import Instant, Scene
from cltaa_datasets.scenes import FILE_PREFIX, build_scene

if TYPE_CHECKING:
    from cltaa_capture.render import SceneRenderer

FASTEST = 1e6  # frames a second; slowest is its inverse: times of any frame are finite, and differ
UNWRITTEN = 3  # most finished pictures in memory that are not written yet


@dataclass(frozen=True, slots=True)
class Request:
    """Arguments of a capture."""

    scene: str  # registered name or file:PATH
    output: Path
    frames: int = 48
    width: int = 640
    height: int = 360
    jitter: str = USUAL
    reference: int = 0  # samples a pixel of the reference; 0 draws none
    yardstick: tuple[int, ...] = ()  # samples a pixel of each supersampled sequence for comparison
    seed: int = 0
    fps: float = 30.0
    motion: str | None = None  # of file:PATH
    backend: str = "auto"
    restart: bool = False

    def settings(self) -> dict[str, Any]:
        """Return everything that decides the pixels of a frame; not frames and yardstick, which may grow later."""
        settings = {
            "scene": self.scene,
            "seed": self.seed,
            "motion": self.motion,
            "width": self.width,
            "height": self.height,
            "fps": self.fps,
            "jitter": self.jitter,
            "reference": self.reference,
            "code_sha256": code_sha256(),
        }
        if self.scene.startswith(FILE_PREFIX):
            path = Path(self.scene.removeprefix(FILE_PREFIX))
            # Of a path only the name decides anything: that of the frames.
            settings |= {"scene": FILE_PREFIX + path.name, "motion": self.motion or default_motion(str(path))}
            settings["model_sha256"] = content_sha256(path)
        return settings


@dataclass(frozen=True, slots=True)
class Captured:
    """Result of a capture."""

    scene: Scene
    backend: str  # osmesa or egl
    opengl: str
    drawn: int  # frames drawn in this run, one sample a pixel
    kept: int  # frames kept from an earlier run
    supersampled: int  # images of the reference and of yardsticks drawn in this run


def capture_sequence(request: Request, progress: Callable[[int, int], None] | None = None) -> Captured:
    """Capture ``request``; calls ``progress(done, total)`` after each frame, including kept ones.

    The output folder then holds ``<scene>.<frame:04d>.exr``, ``reference/`` with the same names, and
    ``sequence.json``. The same request continues an interrupted run; two runs of one request are bit-identical.
    Raises UsageError, InputMissing, DataError, DeviceMissing, OutputError, StorageError and ResourceError.
    """
    if min(request.frames, request.width, request.height) < 1 or not 1.0 / FASTEST <= request.fps <= FASTEST:
        found = f"{counted(request.frames, 'frame')} of {request.width} x {request.height} at {request.fps:g} fps"
        raise UsageError(f"frames and size must be positive, fps must be {1.0 / FASTEST:g} to {FASTEST:g}", found=found)
    if max(request.width, request.height) > LARGEST_SIDE:
        expected, found = f"at most {LARGEST_SIDE} pixels a side", f"{request.width} x {request.height}"
        raise UsageError("the frames are too large", expected=expected, found=found)
    most = max(request.reference, *request.yardstick, 0)
    if most > LONGEST_PERIOD:
        raise UsageError("too many samples a pixel", expected=f"at most {LONGEST_PERIOD}", found=most)
    jitter_sequence(request.jitter)  # raises for a wrong name before anything is opened
    scene = build_scene(request.scene, request.seed, request.motion)
    with owned(request.output):
        context = open_context(request.backend)
        try:
            return _capture(request, scene, context, progress)
        finally:
            context.close()


def _capture(request: Request, scene: Scene, context: Context, progress: Callable[[int, int], None] | None) -> Captured:
    # Imported late: both bind PyOpenGL to the platform, which is chosen by now.
    from OpenGL.error import GLError
    from OpenGL.GL import GL_OUT_OF_MEMORY

    from cltaa_capture.render import SceneRenderer

    opengl = f"{context.version}, {context.renderer}"
    facts = {
        "scene": scene.name,
        "effects": format_effects(scene.effects),
        "frames": request.frames,
        "versions": versions(f"{opengl} ({context.backend})"),
    }
    settings = request.settings() | {"opengl": opengl}
    manifest = Manifest(request.output, settings, facts, restart=request.restart)
    drawn = supersampled = 0
    renderer = None
    try:
        renderer = SceneRenderer(scene, request.width, request.height)
        pen = _Pen(request, scene, renderer)
        with _saved(manifest), Writer(UNWRITTEN, threads=1) as writer:
            for index in range(request.frames):
                for path, channels, attributes in _missing_files(request, index, pen, manifest):
                    writer.write(path, channels, attributes, then=partial(_record, manifest, path))
                    alone = path.parent == request.output
                    drawn, supersampled = drawn + alone, supersampled + (not alone)
                if progress is not None:
                    progress(index + 1, request.frames)
            for samples, spent in pen.seconds.items():
                manifest.note_seconds(samples, median(spent))
    except GLError as error:
        what = "ran out of memory" if error.err == GL_OUT_OF_MEMORY else f"gave up with error {error.err:#x}"
        raise ResourceError(f"OpenGL {what}", cure="use a smaller --size") from error
    finally:
        if renderer is not None:
            renderer.delete()
    return Captured(scene, context.backend, opengl, drawn, request.frames - drawn, supersampled)


@contextmanager
def _saved(manifest: Manifest) -> Iterator[None]:
    """Save the manifest at the end of the block; an error of the block takes precedence over one of saving."""
    try:
        yield
    except BaseException:
        with suppress(CltaaError):  # still record the finished files
            manifest.save()
        raise
    manifest.save()


def _record(manifest: Manifest, path: Path) -> None:
    """List a file in the manifest once it has its final name."""
    manifest.add(path, file_sha256(path))


class _Pen:
    """Draws the frames of a request and records the time; reuses the last reference if nothing has changed since."""

    def __init__(self, request: Request, scene: Scene, renderer: SceneRenderer) -> None:
        self.scene, self._renderer = scene, renderer
        self._jitter = jitter_sequence(request.jitter)
        self._reference: tuple[Instant, Image] | None = None
        # By samples a pixel, 1 for the frames themselves, to compare with the time of a resolve.
        self.seconds: dict[int, list[float]] = {}

    @contextmanager
    def _timed(self, samples: int) -> Iterator[None]:
        begin = perf_counter()
        yield
        self.seconds.setdefault(samples, []).append(perf_counter() - begin)

    def frame(self, index: int, now: Instant, before: Instant) -> Frame:
        x, y = self._jitter[index % len(self._jitter)].tolist()
        cut = index > 0 and now.shot != before.shot
        with self._timed(1):
            drawn = self._renderer.draw(now, before, (x, y))
            if np.isinf(drawn.depth).any() and not self.scene.effects & {Effect.SKY, Effect.ALPHA}:
                what = f"frame {index} shows sky, which {self.scene.name} does not declare"
                raise UsageError(what, cure="use a less wide --size, or fewer --frames")
            return drawn.frame(self.scene, now, index=index, jitter_px=(x, y), cut=cut)

    def samples(self, now: Instant, samples: int) -> Image:
        with self._timed(samples) if samples > 1 else nullcontext():
            return self._renderer.draw_reference(now, jitter_sequence(f"hammersley:{samples}"))

    def reference(self, now: Instant, samples: int) -> Image:
        if self._reference is None or not now.looks_like(self._reference[0]):
            self._reference = now, self.samples(now, samples)
        return self._reference[1]


class _File(NamedTuple):
    """A file to write."""

    path: Path
    channels: Mapping[str, Pixels]
    attributes: Mapping[str, object]


def _missing_files(request: Request, index: int, pen: _Pen, manifest: Manifest) -> Iterator[_File]:
    """Draw the files of one frame that the manifest does not list as finished."""
    scene = pen.scene
    name = frame_name(scene.name, index)
    now, before = scene.at(index / request.fps), scene.at((index - 1) / request.fps)
    path = request.output / name
    if not manifest.has_finished(path):
        frame = pen.frame(index, now, before)
        yield _File(path, frame_planes(frame, path), frame_attributes(frame))
    # A yardstick also measures time, so each of its frames is drawn.
    folders = {f"{REFERENCE}-{samples}": (samples, pen.samples) for samples in request.yardstick}
    if request.reference:
        folders[REFERENCE] = request.reference, pen.reference
    for folder, (samples, draw) in folders.items():
        truth_path = request.output / folder / name
        if not manifest.has_finished(truth_path):
            make_folder(truth_path.parent)
            yield _truth_file(truth_path, draw(now, samples), scene, index, samples)


def _truth_file(path: Path, truth: Image, scene: Scene, index: int, samples: int) -> _File:
    channels: dict[str, Pixels] = {channel: truth[..., place] for place, channel in enumerate("RGBA")}
    if Effect.ALPHA not in scene.effects:
        del channels["A"]
    return _File(path, channels, {"cltaa:frame": index, "cltaa:scene": scene.name, "cltaa:samples": samples})
