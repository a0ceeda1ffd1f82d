"""What the pixels of a sequence hold: range and special values of every channel, gathered a frame at a time."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from cltaa.core.constants import value
from cltaa.frame import Image
from cltaa.io.exr_frame import Pixels


class ChannelStatistics(msgspec.Struct):
    """Smallest and largest finite value of a channel over all frames, and counts of what is not finite."""

    lowest: float = math.inf
    highest: float = -math.inf
    nan: int = 0
    infinite: int = 0
    zero: int = 0
    count: int = 0

    def add(self, plane: Pixels) -> None:
        """Take in the values [H, W] of one frame."""
        finite = np.isfinite(plane)
        if finite.any():
            self.lowest = min(self.lowest, float(plane[finite].min()))
            self.highest = max(self.highest, float(plane[finite].max()))
        self.nan += int(np.isnan(plane).sum())
        self.infinite += int(np.isinf(plane).sum())
        self.zero += int((plane == 0).sum())
        self.count += plane.size


def unusable_pixels(colour: Image) -> int:
    """Count the pixels of [H, W, 3] whose colour a resolve replaces: NaN, infinite, or beyond the kernels' domain."""
    limit = value("DOMAIN_LIMIT")
    if -limit <= float(colour.min()) and float(colour.max()) <= limit:  # NaN is not within, and min and max hand it on
        return 0
    return int((~(np.abs(colour) <= limit)).any(axis=-1).sum())


def is_opaque(alpha: Image | None) -> bool:
    """True for alpha [H, W] that is 1 in every pixel."""
    return alpha is not None and bool((alpha == 1.0).all())


def pixel_problems(statistics: dict[str, ChannelStatistics]) -> list[str]:
    """Sentences about values that a resolve has to repair or cannot use."""
    problems = []
    for name, channel in statistics.items():
        not_finite = channel.nan + (0 if name == "Z" else channel.infinite)
        # NaN in the motion means "use the depth", infinite depth means sky.
        if name.startswith("backward."):
            not_finite = channel.infinite
        if not_finite:
            problems.append(f"channel {name}: {not_finite} of {channel.count} values are not finite")
    depth = statistics.get("Z")
    if depth is not None and depth.lowest <= 0:
        problems.append(f"channel Z: depth {depth.lowest:g} is not in front of the camera")
    alpha = statistics.get("A")
    if alpha is not None and not 0 <= alpha.lowest <= alpha.highest <= 1:
        problems.append(f"channel A: alpha from {alpha.lowest:g} to {alpha.highest:g} leaves 0 to 1")
    return problems


def needless_channels(statistics: dict[str, ChannelStatistics]) -> list[str]:
    """Sentences about channels that say nothing, which whoever declares what moves had better leave out."""
    return [
        f"channel {name}: all zero; nothing moves, so the channel is not needed"
        for name, channel in statistics.items()
        if name.startswith("backward.") and channel.zero == channel.count
    ]
