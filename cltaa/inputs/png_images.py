"""PNGs to be judged, as any tool writes them: 8 bits a channel, sRGB-encoded, with straight alpha."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from cltaa.errors import DataError
from cltaa.exr.layout import Layout
from cltaa.files.content import open_regular
from cltaa.files.names import name_of, number_of
from cltaa.frames import Image
from cltaa.inputs.convert import linear_colour
from cltaa.inputs.profile import Encoding
from cltaa.sequences.frame_numbers import FrameRange, OnBreak, even_step
from cltaa.sequences.images import ImageSequence
from cltaa.sequences.numbered import numbered_files

SUFFIX = ".png"
HEADER = struct.Struct(">8s4x4sIIB")  # signature, length, kind of the first chunk, columns, rows, bits a channel
SIGNATURE, FIRST = b"\x89PNG\r\n\x1a\n", b"IHDR"
DEEPEST = 8  # bits a channel: of 16 Pillow reads the upper 8


def is_png(path: Path) -> bool:
    """True for a PNG, and for a folder that holds some and no EXR."""
    return path.suffix == SUFFIX or (path.is_dir() and not any(path.glob("*.exr")) and any(path.glob(f"*{SUFFIX}")))


class PngImages(ImageSequence):
    """PNGs as linear light, premultiplied where they are see-through."""

    @property
    def notes(self) -> list[str]:
        """How they are read."""
        return ["PNG, taken for sRGB: what was above white is lost"]

    @staticmethod
    def layout_of(path: Path) -> Layout:
        """Read the size from the header; raises InputMissing, and DataError for what is no PNG of 8 bits."""
        with open_regular(path) as file:
            start = file.read(HEADER.size)
        if len(start) < HEADER.size or not start.startswith(SIGNATURE) or HEADER.unpack(start)[1] != FIRST:
            raise DataError("is no PNG", path=path, cure="write it again")
        *_, width, height, bits = HEADER.unpack(start)
        if bits > DEEPEST:
            cure = "write it with 8 bits, or as EXR"
            raise DataError("too many bits a channel", path=path, expected=DEEPEST, found=bits, cure=cure)
        window = (0, 0, width - 1, height - 1)
        return Layout(path, dict.fromkeys("RGB", "uint"), window, window, "zip")

    def image(self, number: int) -> Image:
        """Read one frame number, [H, W, 3] linear float32; raises DataError where it is damaged."""
        from PIL import Image as Pillow  # here: most comparisons read none

        path = self.path(number)
        try:
            with Pillow.open(path) as file:
                texels = np.asarray(file.convert("RGBA"), np.float32) / np.float32(255)
        except (OSError, ValueError, SyntaxError, Pillow.DecompressionBombError) as error:
            raise DataError(f"the PNG cannot be read ({error})", path=path, cure="write it again") from error
        return linear_colour(texels[..., :3], Encoding.SRGB) * texels[..., 3:]


def open_png(path: Path, *, gaps: OnBreak = OnBreak.ERROR, frames: FrameRange | None = None) -> PngImages:
    """Open a PNG, or a folder of numbered ones, with the options and errors of ``open_images``."""
    if path.is_dir():
        files = numbered_files(path, SUFFIX)
        return PngImages(*files, verify=False, gaps=gaps, frames=frames, step=even_step(sorted(files[2])))
    return PngImages(path.parent, name_of(path), {number_of(path) or 0: path}, verify=False, frames=frames)
