"""A sequence through the resolver, streaming: frames are read ahead and images written behind while kernels run."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any, Literal

import msgspec
import numpy as np

from cltaa.allocator import return_freed_frames
from cltaa.atomic import atomic_path
from cltaa.display import to_picture
from cltaa.errors import OutputError, UsageError
from cltaa.exr_attributes import frame_attributes
from cltaa.exr_channels import Pixels
from cltaa.frames import Effect, Frame, Image
from cltaa.params import Preset
from cltaa.progress import track
from cltaa.resolve import Resolver
from cltaa.sources import Sequence
from cltaa.streams import Writer, read_ahead
from cltaa.video import open_video


class StageTimes(msgspec.Struct, kw_only=True):
    """Median seconds a frame of each stage, and of the whole; stages overlap, so the whole is less than their sum."""

    read: float
    upload: float
    kernels: float
    read_back: float
    write: float
    whole: float


class Outcome(msgspec.Struct, kw_only=True):
    """What a run of ``resolve_sequence`` did."""

    output: str
    frames: int
    width: int
    height: int
    device: str
    preset: str
    seconds: StageTimes


def resolve_sequence(
    sequence: Sequence,
    output: Path,
    resolver: Resolver,
    *,
    effects: frozenset[Effect] | Literal["auto", "all"] = "auto",
    half: bool = False,
    compression: str = "zip",
    preview: Path | None = None,
) -> Outcome:
    """Resolve every frame of ``sequence`` into ``output``, one EXR a frame under the same names.

    ``effects`` overrides what the sequence declares: ``auto`` keeps it, ``all`` turns every step on. Frames
    written before an error stay complete. ``preview`` is an MP4 of the result. Raises OutputError where ``output``
    cannot be created and UsageError where it is the sequence's own folder.
    """
    return_freed_frames()
    _prepare(sequence, output)
    upload, kernels, read_back = [], [], []
    with ExitStack() as stack:
        video = stack.enter_context(open_video(preview)) if preview is not None else None
        writer = stack.enter_context(Writer(compression=compression))
        frames = stack.enter_context(read_ahead(sequence))
        started = time.perf_counter()
        for frame in track(frames, len(sequence), "resolving"):
            image = resolver.resolve(_with_effects(frame, effects))
            assert frame.path is not None
            writer.write(
                output / frame.path.name, image_channels(image, half=half), resolved_attributes(frame, resolver)
            )
            if video is not None:
                video.add(to_picture(image[..., :3]))
            upload.append(resolver.times.upload)
            kernels.append(resolver.times.kernels)
            read_back.append(resolver.times.read_back)
        writer.close()
        whole = (time.perf_counter() - started) / len(sequence)
        seconds = StageTimes(
            read=median(frames.seconds),
            upload=median(upload),
            kernels=median(kernels),
            read_back=median(read_back),
            write=median(writer.seconds),
            whole=whole,
        )
    outcome = Outcome(
        output=str(output),
        frames=len(sequence),
        width=sequence.width,
        height=sequence.height,
        device=resolver.launcher.description,
        preset=resolver.preset.name,
        seconds=seconds,
    )
    _write_record(output, outcome, resolver.preset)
    return outcome


def image_channels(image: Image, *, half: bool = False) -> dict[str, Pixels]:
    """A resolved image [H, W, 3 or 4] as EXR channels R G B [A], in half (saturated to its range) or float32."""
    if half:
        largest = np.finfo(np.float16).max
        image = np.clip(image, -largest, largest).astype(np.float16)
    return {name: image[..., channel] for channel, name in enumerate("RGBA"[: image.shape[-1]])}


def resolved_attributes(frame: Frame, resolver: Resolver) -> Mapping[str, object]:
    """Attributes of a resolved image: those of its frame, and what resolved it."""
    return {
        **frame_attributes(frame),
        "cltaa:preset": resolver.preset.name,
        "cltaa:device": resolver.launcher.description,
    }


def _with_effects(frame: Frame, effects: frozenset[Effect] | Literal["auto", "all"]) -> Frame:
    if effects == "auto":
        return frame
    return replace(frame, effects=None if effects == "all" else effects)


def _prepare(sequence: Sequence, output: Path) -> None:
    if output.resolve() == sequence.folder.resolve():
        raise UsageError("the output would overwrite the sequence", path=output, cure="name another folder with -o")
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"cannot create the output folder: {error.strerror}", path=output, cure="name a folder you may write to"
        ) from None


def _write_record(output: Path, outcome: Outcome, preset: Preset) -> None:
    """Beside the images, what made them: ``resolve.json``."""
    record: dict[str, Any] = {"outcome": msgspec.to_builtins(outcome), "preset": msgspec.to_builtins(preset)}
    with atomic_path(output / "resolve.json") as temporary:
        temporary.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


def stage_rows(seconds: StageTimes) -> Iterable[tuple[str, float]]:
    """Name and milliseconds a frame of each stage, for a table."""
    for field in StageTimes.__struct_fields__:
        yield field.replace("_", " "), getattr(seconds, field) * 1e3
