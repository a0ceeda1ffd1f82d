"""A denoiser of single frames before the resolve: Intel's Open Image Denoise, which is installed as an extra."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cltaa.core.build import Build
from cltaa.core.planes import Layout
from cltaa.errors import DataError, UsageError, import_extra
from cltaa.frame import Frame, Image
from cltaa.io.exr_frame import Pixels
from cltaa.io.pixel_statistics import is_missing
from cltaa.printable import written
from cltaa.reference.colour import filled_colour

DENOISERS = ("none", "oidn")
# What a layer's name ends with that helps a denoiser, and its channels: albedo 0 to 1, normals -1 to 1.
GUIDES = {"albedo": (("albedo",), ("RGB",)), "normal": (("normal", "normals", "n"), ("XYZ", "RGB"))}

Denoise = Callable[[Frame, Mapping[str, Sequence[Pixels]]], Frame]


def guides_of(channels: Iterable[str], colour: Iterable[str] = ()) -> dict[str, tuple[str, ...]]:
    """The channels of a file that guide a denoiser: ``albedo`` and ``normal`` -> three names; what is not there is left
    out. Those of the layer and view of the ``colour`` channels come first, then what is named for a denoiser."""
    names, own = set(channels), {word for name in colour for word in name.split(".")[:-1]}

    def is_of_another(layer: str) -> bool:  # of a layer or view that has a picture of its own
        above = layer.rpartition(".")[0]
        return f"{above}.R" in names and not own.issuperset(above.split("."))

    others = {
        layer: [word for word in layer.split(".") if word not in own]
        for layer in {n.rpartition(".")[0] for n in names}
        if not is_of_another(layer)
    }

    def rank(layer: str) -> tuple[int, bool, int, str]:
        shared = len(layer.split(".")) - len(others[layer])
        return -shared, "denois" not in layer.lower(), len(others[layer]), layer

    found: dict[str, tuple[str, ...]] = {}
    for role, (words, kinds) in GUIDES.items():
        for layer in sorted(others, key=rank):
            last = "".join(others[layer][-1:]).lower().replace("_", " ").split(" ")[-1]
            triples = (tuple(f"{layer}.{axis}" for axis in axes) for axes in kinds)
            triple = next((each for each in triples if names.issuperset(each)), None)
            if last in words and triple and role not in found:
                found[role] = triple
    return found


def guide_line(guides: Mapping[str, tuple[str, ...]]) -> str:
    """Which channels guide a denoiser, for who renders them elsewhere or under other names."""
    told = (
        f"{role} {written(guides[role])}" if role in guides else f"no {role} in the colour's file" for role in GUIDES
    )
    return f"denoised with: {'; '.join(told)}"


def denoises(name: str) -> bool:
    """Whether a denoiser of that name does anything; raises UsageError for no such denoiser."""
    if name not in DENOISERS:
        raise UsageError("no such denoiser", expected=", ".join(DENOISERS), found=repr(name))
    return name != "none"


def denoiser(name: str) -> Denoise | None:
    """What denoises a frame, from it and from three planes [H, W] of each guide; None for ``none``.

    Raises UsageError for no such denoiser, and where the extra is not installed.
    """
    if not denoises(name):
        return None
    oidn: Any = import_extra("pyoidn", package="pyoidn", extra="denoise", purpose="--denoise oidn")

    def denoise(frame: Frame, planes: Mapping[str, Sequence[Pixels]]) -> Frame:
        colour = np.array(frame.colour, np.float32)
        lost = is_missing(colour)
        guides = {role: np.nan_to_num(np.stack(its, -1).astype(np.float32)) for role, its in planes.items()}
        try:
            cleaned = oidn.denoise(_filled(colour) if lost.any() else colour, **guides, hdr=True)
        except (RuntimeError, TypeError, ValueError) as error:
            raise DataError(f"the denoiser failed: {error}", path=frame.path, frame=frame.index) from error
        cleaned[lost] = np.nan  # a missing sample stays one, for its history to stand in
        return replace(frame, colour=cleaned)

    return denoise


def _filled(colour: Image) -> Image:
    """[H, W, 3] with its missing samples filled as a resolve without history fills them."""
    layout = Layout(colour.shape[1], colour.shape[0])
    planes = layout.zeros(3)
    layout.inside(planes)[:] = np.moveaxis(colour, -1, 0)
    return np.stack(filled_colour(planes, Build(), layout), axis=-1)
