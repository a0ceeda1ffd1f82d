"""A denoiser of single frames before the resolve: Intel's Open Image Denoise, which is an optional extra."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cltaa.core.build import Build
from cltaa.core.planes import Layout
from cltaa.errors import DataError, UsageError, import_extra
from cltaa.frame import Effect, Frame, Image
from cltaa.io.denoiser_guides import GUIDES
from cltaa.io.pixel_statistics import is_missing
from cltaa.printable import written
from cltaa.reference.colour import filled_texels

DENOISERS = ("none", "oidn")
Denoise = Callable[[Frame, Mapping[str, Image]], Frame]


def guide_line(guides: Mapping[str, tuple[str, ...]], faults: Mapping[str, str]) -> str:
    """Return the line that names the channels that guide a denoiser, or says why none does."""
    without = {role: f"no {role}{f' ({faults[role]})' if role in faults else ''}" for role in GUIDES}
    told = (f"{role} {written(guides[role])}" if role in guides else without[role] for role in GUIDES)
    return f"denoised with: {'; '.join(told)}"


def denoises(name: str) -> bool:
    """True where a denoiser of that name does anything; raises UsageError for an unknown one."""
    if not isinstance(name, str) or name not in DENOISERS:
        raise UsageError("no such denoiser", expected=", ".join(DENOISERS), found=repr(name))
    return name != "none"


def denoiser(name: str) -> Denoise | None:
    """Return a function that denoises a frame by its guides [H, W, 3], None for ``none``; raises UsageError for an
    unknown one, and where the extra is not installed."""
    if not denoises(name):
        return None
    oidn: Any = import_extra("pyoidn", package="pyoidn", extra="denoise", purpose="--denoise oidn")

    def denoise(frame: Frame, guides: Mapping[str, Image]) -> Frame:
        colour = np.array(frame.colour, np.float32)
        lost = is_missing(colour, frame.alpha)
        sound = {role: np.nan_to_num(image) for role, image in guides.items()}
        try:
            cleaned = oidn.denoise(_filled(colour) if lost.any() else colour, **sound, hdr=True)
        except (RuntimeError, TypeError, ValueError) as error:
            raise DataError(f"the denoiser failed: {error}", path=frame.path, frame=frame.index) from error
        cleaned[lost] = np.nan  # missing samples stay missing, so that their history replaces them
        return without_noise(replace(frame, colour=cleaned))

    return denoise


def without_noise(frame: Frame) -> Frame:
    """Return ``frame`` without the effect of noise, which a denoised frame no longer has, declared or not."""
    return frame if frame.effects is None else replace(frame, effects=frame.effects - {Effect.NOISE})


def _filled(colour: Image) -> Image:
    """Fill the missing samples of [H, W, 3] as a resolve without history does."""
    layout = Layout(colour.shape[1], colour.shape[0])
    planes = layout.zeros(3)
    layout.inside(planes)[:] = np.moveaxis(colour, -1, 0)
    return np.ascontiguousarray(np.moveaxis(filled_texels(planes, None, Build(), layout)[0], 0, -1))
