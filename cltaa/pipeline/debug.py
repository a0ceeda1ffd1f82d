"""Debug views, the decisions of the resolve at each pixel, as layers of EXRs and as pictures."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from cltaa.core.debug import Reason, View
from cltaa.core.resolver import Resolver
from cltaa.frame import Image
from cltaa.io.atomic import make_folder
from cltaa.io.display import Picture, heat, quantise, write_png

COLOURS = {
    Reason.KEPT: (0, 0, 0),
    Reason.NO_HISTORY: (255, 255, 255),
    Reason.OFF_SCREEN: (40, 90, 255),
    Reason.BAD_TEXEL: (255, 0, 255),
    Reason.DEPTH: (255, 40, 30),
    Reason.REACTIVE: (255, 220, 0),
}
MOST_SAMPLES = 1023  # count that its picture shows as white, unless the run has fewer frames
GREY_PX = 8.0  # motion at which red or green of its picture is three quarters of the way (tanh 1) to its end
WHITE_CLIP = 0.5  # change of colour that its picture shows as white


class DebugViews:
    """The debug views of the frame that ``resolver`` resolved last, in a run of so many ``frames``."""

    def __init__(self, resolver: Resolver, views: Iterable[View], frames: int = MOST_SAMPLES) -> None:
        self.views = tuple(views)
        self._resolver, self._frames = resolver, min(frames, MOST_SAMPLES)

    def layers(self) -> dict[str, Image]:
        """Return EXR layers ``debug.*`` of the views, [H, W] float32; raises ValueError before the first frame."""
        layers: dict[str, Image] = {}
        for name, image in self._resolver.debug(*self.views).items():
            if image.ndim == 2:
                layers[f"debug.{name}"] = image
            else:
                layers |= {f"debug.{name}.u": image[..., 0], f"debug.{name}.v": image[..., 1]}
        return layers

    def write(self, folder: Path, number: int) -> dict[str, Image]:
        """Write a PNG of each view into ``folder``, and return the layers; raises OutputError and StorageError."""
        if not self.views:
            return {}
        layers = self.layers()
        make_folder(folder)
        for view in self.views:
            write_png(folder / f"{view}.{number:04d}.png", view_picture(view, layers, self._frames))
        return layers


def view_picture(view: View, layers: dict[str, Image], frames: int = MOST_SAMPLES) -> Picture:
    """Return a view as an 8-bit picture [H, W, 3] (docs/debug-views.md); the count is white at that of ``frames``."""
    if view is View.REJECT:
        palette = np.array([COLOURS[reason] for reason in Reason], np.uint8)
        return palette[layers["debug.reject"].astype(np.int64)]
    if view is View.COUNT:
        return heat(np.log2(1 + layers["debug.count"]), float(np.log2(1 + frames)))
    if view is View.CLIP:
        return heat(layers["debug.clip"], WHITE_CLIP)
    with np.errstate(invalid="ignore"):
        red, green = (0.5 + 0.5 * np.tanh(layers[f"debug.motion.{axis}"] / GREY_PX) for axis in "uv")
    return quantise(np.nan_to_num(np.stack([red, green, np.full_like(red, 0.5)], axis=-1)))
