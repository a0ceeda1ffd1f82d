"""The transform from linear, scene-referred colour to a display, for PNGs, films and perceptual metrics alike.

It has no tone curve, on purpose: exposure in stops, clamp to [0, 1], sRGB encoding (IEC 61966-2-1). A curve that
compresses highlights would hide errors that a compositor sees; the HDR metrics judge values above white.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cltaa.frame import Image
from cltaa.io.atomic import atomic_path
from cltaa.printable import printable

Floats = TypeVar("Floats", NDArray[np.float32], NDArray[np.float64])

DARK_LIGHT, DARK_CODE = 0.0031308, 0.04045  # where the linear part ends
SLOPE, SCALE, OFFSET, POWER = 12.92, 1.055, 0.055, 2.4


def encoded(linear: Floats) -> Floats:
    """Encode linear light from 0 on as sRGB values: 1 stays 1."""
    return np.where(linear <= DARK_LIGHT, SLOPE * linear, SCALE * linear ** (1 / POWER) - OFFSET)


def decoded(values: Floats) -> Floats:
    """Decode sRGB values from 0 on to linear light; the power continues above 1."""
    return np.where(values <= DARK_CODE, values / SLOPE, ((values + OFFSET) / SCALE) ** POWER)


Picture = NDArray[np.uint8]  # [H, W, 3], sRGB-encoded

LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)  # of ITU-R BT.709 for luma, and of its primaries for luminance


def shown_light(linear: Image, stops: float = 0.0) -> Image:
    """Return linear colour as a screen can show it: exposed by ``stops``, clamped to [0, 1]; NaN becomes black."""
    with np.errstate(over="ignore", invalid="ignore"):  # signalling NaN, and stops that overflow float32
        exposed = np.multiply(linear, np.float32(2.0**stops), dtype=np.float32)
    light: Image = np.where(np.isnan(exposed), np.float32(0), np.clip(exposed, 0.0, 1.0))
    return light


def to_display(linear: Image, stops: float = 0.0) -> Image:
    """Encode linear colour [..., 3] as sRGB in [0, 1], float32, after ``stops`` of exposure; NaN shows as black."""
    return np.clip(encoded(shown_light(linear, stops)), 0.0, 1.0)  # rounding may exceed 1


def to_picture(linear: Image, stops: float = 0.0) -> Picture:
    """Encode linear colour [H, W, 3] as 8-bit sRGB, rounded to nearest."""
    return quantise(to_display(linear, stops))


def quantise(display: Image) -> Picture:
    """Round display values in [0, 1] to 8 bits."""
    rounded: Picture = np.rint(display * np.float32(255)).astype(np.uint8)
    return rounded


def luma(display: Image) -> Image:
    """Return luma [H, W] of encoded colour [H, W, 3] (ITU-R BT.709)."""
    weighted: Image = display @ LUMA
    return weighted


LABEL_SHARE = 1 / 20  # height of a label's letters over that of the picture
SMALLEST_LETTERS = 10  # pixels
GAP = 2  # white pixels between two pictures


def write_png(path: Path, picture: Picture) -> None:
    """Write an 8-bit picture [H, W, 3] as PNG, atomically; raises OutputError and StorageError."""
    from PIL import Image as Pillow  # imported here and below: a resolve starts without it

    with atomic_path(path) as temporary:
        Pillow.fromarray(np.ascontiguousarray(picture)).save(temporary, format="PNG")


def side_by_side(before: Image, after: Image, labels: tuple[str, str] = ("before", "after")) -> Picture:
    """Draw two linear images of one size side by side as one picture [H, 2 W + gap, 3], each with its label."""
    return beside([to_picture(image) for image in (before, after)], labels)


def beside(pictures: Sequence[Picture], labels: Sequence[str]) -> Picture:
    """Draw pictures [H, W, 3] of one height side by side, each with its label."""
    gap = np.full((pictures[0].shape[0], GAP, 3), 255, np.uint8)
    row: list[Picture] = []
    for picture, text in zip(pictures, labels, strict=True):
        row += [*([gap] if row else []), label(picture, text)]
    return np.concatenate(row, axis=1)


def wipe(before: Image, after: Image, share: float, labels: tuple[str, str]) -> Picture:
    """Draw two linear images [H, W, 3] as one: the first left of a line at ``share`` of the width, the second right."""
    left, right = (label(to_picture(image), text) for image, text in zip((before, after), labels, strict=True))
    line = round(share * before.shape[1])
    picture = np.concatenate([left[:, :line], right[:, line:]], axis=1)
    picture[:, max(line - 1, 0) : line + 1] = 255
    return picture


def label(picture: Picture, text: str) -> Picture:
    """Return a copy of a picture with ``text`` in its upper left corner, white on a dark ground."""
    text = printable(text)
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    size = max(SMALLEST_LETTERS, round(picture.shape[0] * LABEL_SHARE))
    canvas = Pillow.fromarray(np.ascontiguousarray(picture))
    draw = ImageDraw.Draw(canvas)
    font = ImageFont.load_default(size)
    corner, margin = (size // 2, size // 2), size // 4
    left, top, right, bottom = draw.textbbox(corner, text, font=font)
    draw.rectangle((left - margin, top - margin, right + margin, bottom + margin), fill=(24, 24, 24))
    draw.text(corner, text, font=font, fill=(255, 255, 255))
    return np.asarray(canvas)


def error_map(test: Image, reference: Image, stops: float = 0.0) -> Image:
    """Return the largest absolute difference of the display images over the channels, [H, W] in [0, 1]."""
    largest: Image = np.abs(to_display(test, stops) - to_display(reference, stops)).max(axis=-1)
    return largest


def heat(values: Image, white: float = 1.0) -> Picture:
    """Colour values [H, W] from black at 0 over red and yellow to white at ``white`` and above, [H, W, 3].

    Red, green and blue rise one after another over a third of the range each, so that brightness never falls and
    the picture reads in grey too.
    """
    thirds = 3 * np.clip(values / np.float32(white), 0, 1)
    ramps = np.stack([np.clip(thirds - start, 0, 1) for start in range(3)], axis=-1)
    return quantise(ramps)
