"""Writes frames the way other tools do, without any of the checks that cltaa's own writer makes, and reads them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import OpenEXR

from cltaa.frame import Frame
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.open import open_input
from cltaa.io.exr_frame import Pixels, frame_planes
from cltaa.io.exr_write import write_image
from tests.sequence_factory import make_camera, make_frame, write_images


def frames(count: int = 3) -> list[Frame]:
    """Frames with every vector given and a camera whose numbers need all of a double."""
    made = []
    for index in range(count):
        camera = make_camera((index / 3, 0.1, 5.0))
        frame = make_frame(index, motion=True, camera=camera, jitter_px=(0.3 - index / 7, index / 9), effects=None)
        assert frame.motion is not None
        made.append(replace(frame, motion=np.nan_to_num(frame.motion, nan=0.25)))
    return made


def write_own(
    folder: Path, frames: Sequence[Frame], channels: Any = MappingProxyType({}), **attributes: object
) -> Path:
    """Write frames in cltaa's own form, whatever their matrices say, with other ``channels`` beside."""
    for frame in frames:
        path = folder / f"own.{frame.index:04d}.exr"
        folder.mkdir(parents=True, exist_ok=True)
        header = {
            "cltaa:worldToView": np.ascontiguousarray(frame.camera.world_to_view.T),
            "cltaa:viewToClip": np.ascontiguousarray(frame.camera.view_to_clip.T),
            "cltaa:jitterPx": np.array(frame.jitter_px),
            "cltaa:frame": frame.index,
            "cltaa:cut": int(frame.cut),
            "cltaa:exposure": frame.exposure,
        }
        write_image(path, {**frame_planes(frame, path), **channels}, header | attributes)
    return folder


def write_parts(path: Path, parts: Mapping[str, Mapping[str, Pixels]], header: Mapping[str, object]) -> None:
    """Write a multi-part EXR: part name -> channels."""
    path.parent.mkdir(parents=True, exist_ok=True)
    made = [
        OpenEXR.Part(
            {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION, **header},
            {name: np.ascontiguousarray(plane) for name, plane in channels.items()},
            name,
        )
        for name, channels in parts.items()
    ]
    OpenEXR.File(made).write(str(path))


def write_blender(folder: Path, frames: Sequence[Frame]) -> Path:
    """Write frames as Blender 5 does: a part a pass, names repeated, y up, background 1e10, no matrices, no jitter."""
    for frame in frames:
        passes: dict[str, dict[str, Pixels]] = {
            "ViewLayer.Combined": {
                f"ViewLayer.Combined.{name}": frame.colour[..., place] for place, name in enumerate("RGB")
            },
            "ViewLayer.Depth": {"ViewLayer.Depth.Z": np.where(np.isinf(frame.depth), np.float32(1e10), frame.depth)},
        }
        if frame.motion is not None:
            u, v = frame.motion[..., 0], -frame.motion[..., 1]
            planes = {"X": u, "Y": v, "Z": u, "W": v}
            passes["ViewLayer.Vector"] = {f"ViewLayer.Vector.{name}": plane for name, plane in planes.items()}
        write_parts(folder / f"shot.{frame.index:04d}.exr", passes, {"Software": "Blender 5.0.1"})
    return folder


def side_text(frames: Sequence[Frame]) -> str:
    """Matrices and jitter of frames as a text side file, every double in full."""
    lines = []
    for frame in frames:
        lines.append(f"frame {frame.index}")
        camera = frame.camera
        for name, numbers in (
            ("world_to_view", camera.world_to_view.ravel()),
            ("view_to_clip", camera.view_to_clip.ravel()),
            ("jitter_px", np.array(frame.jitter_px)),
        ):
            lines.append(f"{name} {' '.join(repr(float(number)) for number in numbers)}")
    return "\n".join(lines) + "\n"


def write_colour(folder: Path, made: list[Frame], name: str = "picture", rows: int | None = None) -> Path:
    """Files of R G B alone, of the first ``rows`` rows; the folder."""
    for frame in made:
        write_images(folder, [frame.colour[:rows]], name=name, first=frame.index)
    return folder


def write_depth(folder: Path, made: list[Frame], name: str = "depth", channels: str = "Z") -> None:
    """Files of depth alone, in each of ``channels``."""
    folder.mkdir(parents=True, exist_ok=True)
    for frame in made:
        write_image(folder / f"{name}.{frame.index:04d}.exr", dict.fromkeys(channels, frame.depth))


def read(folder: Path, *assignments: str, profile: str = "auto", side: Path | None = None) -> list[Frame]:
    """The frames of a folder as a resolve gets them."""
    sequence = open_input(folder, profile=profile, assignments=assignments, side_file=side)
    assert isinstance(sequence, ForeignSequence)
    return list(sequence)
