"""ColorVideoVDP: how far a film looks from its truth, in just-objectionable differences (Mantiuk et al. 2024)."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

from cltaa.errors import UsageError, import_extra
from cltaa.io.display import to_display
from cltaa.lab.judge.comparison import Comparison

DISPLAY = "standard_fhd"  # 24 inch, 1920 x 1080, seen from 60 cm
TITLE = f"ColorVideoVDP in JOD on {DISPLAY}: 10 is indistinguishable, one less is seen by 3 of 4"


def import_cvvdp() -> Any:
    """Import pycvvdp; raises UsageError that says what to install."""
    return import_extra("pycvvdp", package="cvvdp", extra="vdp", purpose="--cvvdp")


def quality(comparison: Comparison, numbers: list[int], rate: Fraction | int, stops: float = 0.0) -> float:
    """ColorVideoVDP of the frames ``numbers`` of a test against its truth at ``rate`` frames a second, in JOD.

    All of them are in memory at once. Raises UsageError without the extra ``vdp``, and where a region alone is shared.
    """
    pycvvdp = import_cvvdp()
    if comparison.region is not None:
        raise UsageError("--cvvdp judges whole pictures only", path=comparison.test.folder, cure="leave --cvvdp out")
    films = [
        np.stack([to_display(images.image(number)[..., :3], stops) for number in numbers]).astype(np.float32)
        for images in (comparison.test, comparison.reference)
    ]
    metric = pycvvdp.cvvdp(display_name=DISPLAY, quiet=True)
    jod, _ = metric.predict(films[0], films[1], dim_order="FHWC", frames_per_second=float(rate))
    return float(jod)
