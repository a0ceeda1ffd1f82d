"""Statistics of the pixels of a sequence: range and special values of every channel, collected frame by frame."""

from __future__ import annotations

import math
from collections.abc import Iterable

import msgspec
import numpy as np
from numpy.typing import NDArray

from cltaa.core.constants import value
from cltaa.core.frame_checks import NO_LIGHT, SHARE_SLACK, SHARES, is_no_light, is_no_share, is_too_long
from cltaa.frame import Frame, Image
from cltaa.io.exr_frame import Pixels
from cltaa.io.numbered import named_frames


class ChannelStatistics(msgspec.Struct):
    """Smallest and largest finite value of a channel over all frames, and counts of non-finite ones."""

    lowest: float = math.inf
    highest: float = -math.inf
    nan: int = 0
    infinite: int = 0
    zero: int = 0
    count: int = 0

    @property
    def is_one(self) -> bool:
        """True if every value is 1."""
        return self.lowest == self.highest == 1.0 and not self.nan + self.infinite

    def add(self, plane: Pixels) -> None:
        """Add the values [H, W] of one frame."""
        finite = np.isfinite(plane)
        if finite.any():
            self.lowest = min(self.lowest, float(plane[finite].min()))
            self.highest = max(self.highest, float(plane[finite].max()))
        self.nan += int(np.isnan(plane).sum())
        self.infinite += int(np.isinf(plane).sum())
        self.zero += int((plane == 0).sum())
        self.count += plane.size


class Missing(msgspec.Struct, kw_only=True, frozen=True):
    """The missing samples of a frame: how many of its pixels, and the first and last column and row that hold one."""

    frame: int
    pixels: int
    among: int
    columns: tuple[int, int]
    rows: tuple[int, int]


def is_missing(colour: Image, alpha: Image | None = None) -> NDArray[np.bool_]:
    """Return which pixels [H, W] a resolve treats as missing: a channel is NaN, infinite, or beyond the kernels'
    domain."""
    missing = np.asarray((~(np.abs(colour) <= value("DOMAIN_LIMIT"))).any(axis=-1))
    return missing if alpha is None else missing | ~(np.abs(alpha) <= value("DOMAIN_LIMIT"))


def missing_samples(colour: Image, alpha: Image | None, frame: int) -> Missing | None:
    """Return the missing samples of colour [H, W, 3] and alpha [H, W]; None where there are none."""
    limit = value("DOMAIN_LIMIT")
    planes = (colour,) if alpha is None else (colour, alpha)
    # NaN fails this: min and max propagate it.
    if all(-limit <= float(plane.min()) and float(plane.max()) <= limit for plane in planes):
        return None
    missing = is_missing(colour, alpha)
    rows, columns = np.flatnonzero(missing.any(axis=1)), np.flatnonzero(missing.any(axis=0))
    return Missing(
        frame=frame,
        pixels=int(missing.sum()),
        among=missing.size,
        columns=(int(columns[0]), int(columns[-1])),
        rows=(int(rows[0]), int(rows[-1])),
    )


def missing_lines(found: Iterable[Missing]) -> list[str]:
    """Return a sentence for each frame with missing samples; frames that lack the same share one."""
    alike: dict[Missing, list[int]] = {}
    for each in found:
        alike.setdefault(msgspec.structs.replace(each, frame=0), []).append(each.frame)
    return [f"{named_frames(frames)}: {_lacks(each)}" for each, frames in alike.items()]


def _lacks(missing: Missing) -> str:
    if missing.pixels == missing.among:
        return f"all {missing.among} pixels are without a usable sample"
    (left, right), (top, bottom) = missing.columns, missing.rows
    place = f"x {left} to {right}, y {top} to {bottom}" if missing.pixels > 1 else f"x {left}, y {top}"
    verb = "is" if missing.pixels == 1 else "are"
    return f"{missing.pixels} of {missing.among} pixels {verb} without a usable sample: {place}"


class Meaningless(msgspec.Struct, kw_only=True, frozen=True):
    """Numbers of a frame that say nothing, or another thing: what they are, and how many of its pixels hold one."""

    frame: int
    what: str
    pixels: int
    among: int


# What a resolve does with each, and what to do.
MEANINGLESS = {
    "depth is NaN": "counts as the sky; render it again, or leave it out",
    "depth is negative": "counts as the sky; cltaa check tells whether an option mends it",
    "motion is infinite": "history is dropped there; NaN says that the camera's motion is all",
    "motion is NaN": "taken to stand still, for no matrices and depth stand in",
    "alpha is beyond 0 to 1": "counts as 0 or 1; divide bytes by 255 when writing them, or leave it out",
    "reactive is beyond 0 to 1": "counts as 0 or 1; divide bytes by 255 when writing them, or leave it out",
    "reactive is NaN": "counts as 0; write 0 to 1, or leave it out",
    "motion is longer than the picture": "history is dropped; cltaa check tells whether an option mends it",
    **{f"colour is {why}": f"taken for linear light; {cure}" for why, cure in NO_LIGHT.items()},
}


def meaningless(frame: Frame, *, first: bool) -> list[Meaningless]:
    """Return what says nothing in a frame; the vectors of a ``first`` one, or after a cut, may be anything.

    Vectors that are NaN leave the motion to matrices and depth, so they only count where these do not exist.
    """
    found: dict[str, int] = {}
    if not frame.depth.min() >= 0.0:  # also where one number is NaN
        found["depth is NaN"] = int(np.isnan(frame.depth).sum())
        found["depth is negative"] = 0 if frame.camera.orthographic else int((frame.depth < 0.0).sum())
    motion = None if first or frame.cut else frame.motion
    if motion is not None and not np.isfinite([motion.min(), motion.max()]).all():
        found["motion is infinite"] = int(np.isinf(motion).any(axis=-1).sum())
        lost = int(np.isnan(motion).any(axis=-1).sum())
        alone = not (frame.has_camera and frame.has_depth)
        found["motion is NaN"] = lost if alone and lost == frame.depth.size else 0
    if motion is not None and is_too_long(motion[:1], frame) and is_too_long(motion, frame):
        found["motion is longer than the picture"] = frame.depth.size
    for name in SHARES:
        share = getattr(frame, name)
        if share is not None and not (
            share.min(initial=0.0) >= -SHARE_SLACK and share.max(initial=1.0) <= 1.0 + SHARE_SLACK
        ):
            found[f"{name} is beyond 0 to 1"] = int(is_no_share(share).sum())
            found[f"{name} is NaN"] = int(np.isnan(share).sum()) if name == "reactive" else 0
    if why := is_no_light(frame.colour):
        found[f"colour is {why}"] = frame.depth.size
    among, counts = frame.depth.size, found.items()
    return [Meaningless(frame=frame.index, what=what, pixels=n, among=among) for what, n in counts if n]


def meaningless_lines(found: Iterable[Meaningless]) -> list[str]:
    """Return a sentence for each kind of what says nothing."""
    alike: dict[str, list[Meaningless]] = {}
    for each in found:
        alike.setdefault(each.what, []).append(each)
    return [
        f"{named_frames([each.frame for each in its])}: {what} in {_most(its)} pixels: {MEANINGLESS[what]}"
        for what, its in alike.items()
    ]


def _most(found: list[Meaningless]) -> str:
    most = max(found, key=lambda each: each.pixels)
    count = f"{most.pixels} of {most.among}" if most.pixels < most.among else f"all {most.among}"
    return count if all(each.pixels == most.pixels for each in found) else f"up to {count}"


def is_opaque(alpha: Image | None) -> bool:
    """True for alpha [H, W] that is 1 in every pixel."""
    return alpha is not None and bool((alpha == 1.0).all())


SAID_BY_FRAME = ("Z", "backward.u", "backward.v")  # in ``meaningless_lines``; there some may say something


def pixel_problems(statistics: dict[str, ChannelStatistics], *, orthographic: bool) -> list[str]:
    """Return sentences about values that a resolve has to repair or cannot use.

    An ``orthographic`` camera may have surfaces on both sides of it.
    """
    problems = []
    for name, channel in statistics.items():
        not_finite = channel.nan + channel.infinite
        if not_finite and name not in SAID_BY_FRAME:
            problems.append(f"channel {name}: {not_finite} of {channel.count} values are not finite")
    depth = statistics.get("Z")
    if depth is not None and depth.zero and not orthographic:
        problems.append("channel Z: depth 0 is not in front of the camera")
    alpha = statistics.get("A")
    near = alpha is not None and -SHARE_SLACK <= alpha.lowest <= alpha.highest <= 1 + SHARE_SLACK  # else said by frame
    if alpha is not None and near and (alpha.lowest < 0 or alpha.highest > 1):
        problems.append(f"channel A: alpha from {alpha.lowest:g} to {alpha.highest:g} leaves 0 to 1")
    return problems


def needless_channels(statistics: dict[str, ChannelStatistics]) -> list[str]:
    """Return sentences about channels without information, which a sequence that declares its motion need not have."""
    return [
        f"channel {name}: all zero; nothing moves, so the channel is not needed"
        for name, channel in statistics.items()
        if name.startswith("backward.") and channel.zero == channel.count
    ]
