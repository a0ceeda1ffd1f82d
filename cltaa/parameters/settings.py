"""The continuous parameters of the resolve, declared once: range, unit, meaning and source."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta


def _number(meaning: str, low: float, high: float, unit: str, source: str) -> Meta:
    return Meta(ge=low, le=high, description=meaning, extra={"unit": unit, "source": source})


class Settings(msgspec.Struct, frozen=True, kw_only=True, cache_hash=True, forbid_unknown_fields=True):
    """Numbers; those that kernels look at reach them as one struct of floats by value.

    Changing one costs nothing, except where a term comes to nothing, or to something again: that is another build
    (``Terms``).
    """

    blend_weight: Annotated[
        float, _number("least weight of the current sample (exponential)", 1e-6, 1.0, "1", "Karis 2014: 0.1")
    ] = 0.1
    moving_weight: Annotated[
        float, _number("greatest weight of the current sample (adaptive)", 1e-6, 1.0, "1", "the Vireo article: 0.25")
    ] = 0.25
    motion_rate: Annotated[
        float, _number("rise of that weight by motion (adaptive)", 0.0, 1e6, "1 / screens a frame", "the same: 30")
    ] = 30.0
    clip_rate: Annotated[
        float, _number("rise of that weight by the rectified distance (adaptive)", 0.0, 1e6, "1 / scene unit", "3")
    ] = 3.0
    differing_share: Annotated[
        float, _number("factor of the weight where luminances differ (difference)", 0.0, 1.0, "1", "INSIDE 2016: 0.12")
    ] = 0.12
    agreeing_share: Annotated[
        float, _number("factor of the weight where luminances agree (difference)", 0.0, 1.0, "1", "INSIDE 2016: 0.03")
    ] = 0.03
    difference_knee: Annotated[
        float, _number("least luminance that a difference is held against", 1e-3, 1e6, "scene units", "INSIDE: 0.2")
    ] = 0.2
    filter_falloff: Annotated[
        float, _number("falloff of the gaussian current filter", 0.0, 64.0, "1 / pixel^2", "2.29: Blackman-Harris, 3.3")
    ] = 2.29
    texel_falloff: Annotated[
        float, _number("falloff of a sample's mass (history_of doubled)", 0.0, 16.0, "1 / pixel^2", "measured")
    ] = 8.0
    filter_samples: Annotated[
        float,
        _number("samples of a history beyond which the filter's share falls as 1 / n^2", 1.0, 2.0**20, "1", "measured"),
    ] = 8.0
    frames_kept: Annotated[
        int, _number("earlier frames whose samples are kept (history_of samples)", 1, 64, "frames", "measured")
    ] = 15
    fit_ridge: Annotated[
        float,
        _number("even samples' worth that holds the fitted slope back", 2.0**-6, 2.0**20, "1", "measured"),
    ] = 0.125
    fit_reach: Annotated[
        float,
        _number(
            "where few samples no longer count, from the pixel's centre along an axis",
            0.5625,
            1.0,
            "pixels",
            "measured",
        ),
    ] = 0.8
    thin_frames: Annotated[
        int, _number("kept frames in which things thinner than a pixel are looked for", 0, 64, "frames", "measured")
    ] = 4
    sample_limit: Annotated[
        float, _number("most samples that the history counts for", 1.0, 2.0**20, "samples", "measured")
    ] = 24.0
    changing_cost: Annotated[
        float, _number("resample_cost, where light is declared to change", 0.0, 16.0, "1", "measured")
    ] = 0.0
    changing_gamma: Annotated[
        float, _number("gamma_still, where a change of light is tested for", 0.0, 64.0, "the same", "measured")
    ] = 1.0
    change_t: Annotated[
        float, _number("Student's t of the 3x3 from which light that goes on has changed", 0.125, 1e6, "1", "measured")
    ] = 2.3
    change_kept: Annotated[
        float, _number("share of such a t that is added to that of the next frame", 0.0, 1.0, "1", "measured")
    ] = 0.75
    change_floor: Annotated[
        float, _number("standard error added to that of the 3x3, over its luminance", 0.0, 1.0, "1", "measured")
    ] = 0.03
    lobe_floor: Annotated[
        float,
        _number("share of the least of 3 texels that history keeps (light_change test)", 0.0, 1.0, "1", "measured"),
    ] = 0.5
    resample_cost: Annotated[
        float, _number("loss of count per fraction f(1-f) read between texels", 0.0, 16.0, "1", "measured")
    ] = 1.5
    pull_cost: Annotated[
        float, _number("loss of count per half extent that rectification moved the history", 0.0, 64.0, "1", "measured")
    ] = 0.5
    gamma_still: Annotated[
        float, _number("half width of the box where nothing moves", 0.0, 64.0, "deviations, half extents", "measured")
    ] = 1.0
    gamma_moving: Annotated[
        float, _number("half width of the box in motion", 0.0, 64.0, "the same", "Salvi 2016: 0.75 to 1.25")
    ] = 1.0
    motion_px: Annotated[
        float, _number("motion from which gamma_moving holds", 1e-3, 1e6, "pixels a frame", "measured")
    ] = 1.0
    box_floor: Annotated[
        float,
        _number("least half extent of the box over its size (clip, ellipsoid)", 0.0, 1.0, "1", "2^-10: NUMERICS D2"),
    ] = 2.0**-10
    depth_tolerance: Annotated[
        float, _number("relative slack of the depth test", 0.0, 1.0, "1", "0.02, two engines' value")
    ] = 0.05
    edge_tolerance: Annotated[
        float, _number("relative skew of closeness in the 3x3 that makes a depth edge", 0.0, 1.0, "1", "measured")
    ] = 0.03
    luminance_knee: Annotated[
        float,
        _number("luminance from which a sample's weight falls", 1e-3, 1e6, "scene units", "Karis 2014: 1; measured: 4"),
    ] = 4.0
    sky_below: Annotated[
        float, _number("reversed depth up to which a texel counts as sky (perspective)", 0.0, 0.5, "1", "simvx: 1e-4")
    ] = 0.0
    sky_at: Annotated[
        float, _number("reversed depth at which the sky is reprojected; 0: at infinity", 0.0, 0.5, "1", "simvx: 1e-3")
    ] = 0.0
    fresh_blur: Annotated[
        float, _number("share of the 3x3 mean in a pixel without history", 0.0, 1.0, "1", "measured")
    ] = 0.5


# What the host alone looks at: it does not reach the kernels' struct.
HOST_SETTINGS = frozenset(
    {"changing_cost", "changing_gamma", "filter_falloff", "frames_kept", "sky_at", "sky_below", "texel_falloff"}
)
KERNEL_SETTINGS = tuple(name for name in Settings.__struct_fields__ if name not in HOST_SETTINGS)
