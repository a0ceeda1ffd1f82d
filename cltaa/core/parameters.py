"""Every parameter of the resolve, declared once: choices that shape the kernels, and settings passed to them.

The range check, the TOML key, the ``--set`` option, the row in the docs, the C struct that a kernel receives and the
``#define`` lines of its prelude all derive from these declarations.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Self

import msgspec
from msgspec import Meta


class Choice(StrEnum):
    """A value of a parameter that shapes the code; ``meaning`` is empty where the word explains itself."""

    meaning: str

    def __new__(cls, word: str, meaning: str = "") -> Self:
        """Create the value that presets call ``word``."""
        value = str.__new__(cls, word)
        value._value_, value.meaning = word, meaning
        return value


class HistoryFilter(Choice):
    """How the history is sampled between its texels."""

    NEAREST = "nearest"
    BILINEAR = "bilinear"
    CATMULL_ROM = "catmull-rom", "4x4 texels"
    CATMULL_ROM_5 = (
        "catmull-rom-5",
        "five bilinear reads: the nine that regroup 4x4 texels, less the corners, normalised",
    )
    CATMULL_ROM_5_RAW = "catmull-rom-5-raw", "the same five reads, not normalised: their weights sum to less than 1"
    CROSS_20 = "cross-20", "20 texels, six along each axis; ringing limited to a quarter of the contrast"


class HistoryRange(Choice):
    """The range in which the history is sampled between its texels."""

    LINEAR = "linear", "linear light; the sample is tonemapped afterwards"
    TONEMAPPED = "tonemapped", "each texel is tonemapped first, as if the history were stored tonemapped"


class CurrentFilter(Choice):
    """How the sample at the pixel's centre is reconstructed from the jittered samples of its 3x3."""

    NONE = "none", "the pixel's own sample, unfiltered"
    BILINEAR = "bilinear", "interpolated at the unjittered position, as by a texture unit"
    GAUSSIAN = "gaussian", "exp(-filter_falloff d^2), d in pixels from the centre"
    LANCZOS = "lanczos", "windowed sinc of radius 2, clamped to the extremes of the 3x3"


class FilterUse(Choice):
    """Where the current filter replaces the pixel's own sample."""

    ALWAYS = "always"
    FEW = "few-samples", "in part, while samples are few: its share falls as 1 / n, in a longer history as 1 / n^2"


def _number(meaning: str, low: float, high: float, unit: str = "1", source: str = "measured") -> Meta:
    return Meta(ge=low, le=high, description=meaning, extra={"unit": unit, "source": source})


class Settings(msgspec.Struct, frozen=True, kw_only=True, cache_hash=True):
    """Numbers; kernels receive those that they read as one struct by value, so that changing one costs nothing."""

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
        float, _number("least luminance that a difference is divided by", 1e-3, 1e6, "scene units", "INSIDE: 0.2")
    ] = 0.2
    filter_falloff: Annotated[
        float,
        _number(
            "falloff of the gaussian current filter and of the jittered 3x3",
            0.0,
            64.0,
            "1 / pixel^2",
            "2.29: Blackman-Harris, 3.3",
        ),
    ] = 2.29
    filter_samples: Annotated[
        float,
        _number(
            "samples of a history beyond which the filter's share falls as 1 / n^2; a quarter of it beside a ring if "
            "no light is known to change",
            1.0,
            2.0**20,
        ),
    ] = 8.0
    history_frames: Annotated[
        int, _number("earlier frames whose samples are kept (history frames)", 1, 64, "frames")
    ] = 15
    look_ahead: Annotated[
        int, _number("later frames whose samples are gathered too (history frames)", 0, 64, "frames")
    ] = 0
    fit_ridge: Annotated[float, _number("damping of the fitted slope, in evenly placed samples", 2.0**-6, 2.0**20)] = (
        0.125
    )
    fit_reach: Annotated[
        float, _number("offset from the centre beyond which few samples do not count", 0.5625, 1.0, "pixels")
    ] = 0.8
    drift_t: Annotated[
        float,
        _number(
            "Student's t above which a longer window shifts to the shortest; doubled if no light is known to change",
            0.5,
            2.0**20,
        ),
    ] = 2.0
    refuted_samples: Annotated[
        float,
        _number(
            "frames at rest after which a recursive history of fewer samples is refuted; 0 if no light is known to "
            "change",
            0.0,
            64.0,
            "samples",
        ),
    ] = 7.0
    subpixel_frames: Annotated[
        int, _number("frames of the ring that are searched for sub-pixel features", 0, 64, "frames")
    ] = 4
    sample_limit: Annotated[float, _number("upper limit of the effective sample count", 1.0, 2.0**20, "samples")] = 24.0
    illumination_t: Annotated[
        float, _number("Student's t of the 3x3, over frames, above which light has changed", 0.125, 1e6)
    ] = 2.6
    disocclusion_t: Annotated[
        float, _number("the same where an occluder was beside the history position", 0.125, 1e6)
    ] = 0.8
    passing_t: Annotated[float, _number("the same where an occluder has passed that position", 0.125, 1e6)] = 0.4
    behind_t: Annotated[float, _number("the same where a pixel follows a nearer surface past its own", 0.125, 1e6)] = (
        1.0
    )
    illumination_decay: Annotated[float, _number("share of that t carried over to the next frame", 0.0, 1.0)] = 0.72
    falling_t: Annotated[
        float, _number("factor of these thresholds where light decreases", 0.125, 8.0, "1", "even")
    ] = 1.0
    largest_t: Annotated[
        float, _number("most of that t that one frame counts for", 0.125, 2.0**50, "1", "none: the domain's limit")
    ] = 2.0**50
    illumination_floor: Annotated[
        float, _number("standard error added to that of the 3x3, relative to its luminance", 0.0, 1.0)
    ] = 0.03
    first_samples: Annotated[
        float, _number("sample count of the first frame of a history", 0.0, 2.0**20, "samples", "what it is: 1")
    ] = 1.0
    resampling_penalty: Annotated[
        float, _number("loss of sample count per f(1-f), f the fraction between texels", 0.0, 16.0)
    ] = 1.5
    box_scale_static: Annotated[
        float, _number("half width of the box where nothing moves", 0.0, 64.0, "deviations, half extents")
    ] = 1.0
    box_scale_moving: Annotated[
        float, _number("half width of the box in motion", 0.0, 64.0, "the same", "Salvi 2016: 0.75 to 1.25")
    ] = 1.0
    luma_scale: Annotated[
        float, _number("factor of the box's width in its first channel (variance)", 0.0, 64.0, "1", "FSR 3.1: 1.7")
    ] = 1.0
    box_leak: Annotated[
        float,
        _number("share of its distance outside the box that a full history keeps", 0.0, 1.0, "1", "FSR 3.1's flicker"),
    ] = 0.0
    motion_widths: Annotated[
        float, _number("motion_px as a share of the image's width; 0: motion_px", 0.0, 16.0, "widths a frame", "-")
    ] = 0.0
    motion_px: Annotated[float, _number("motion from which box_scale_moving applies", 1e-3, 1e6, "pixels a frame")] = (
        1.0
    )
    box_floor: Annotated[
        float, _number("least half extent of the box over its size (clip, ellipsoid)", 0.0, 1.0, "1", "2^-10: no jumps")
    ] = 2.0**-10
    depth_tolerance: Annotated[
        float, _number("relative tolerance of the depth test", 0.0, 1.0, "1", "0.02, two engines' value")
    ] = 0.05
    covered_share: Annotated[
        float, _number("share covered by an occluder above which history is dropped", 0.0, 1.0)
    ] = 0.25
    edge_samples: Annotated[
        float, _number("limit of samples on an edge whose background moves past it", 0.0, 2.0**20, "samples")
    ] = 2.0
    edge_tolerance: Annotated[
        float, _number("relative skew of inverse depth in the 3x3 that makes a depth edge", 0.0, 1.0)
    ] = 0.03
    luminance_knee: Annotated[
        float,
        _number("luminance from which a sample's weight falls", 1e-3, 1e6, "scene units", "Karis 2014: 1; measured: 4"),
    ] = 4.0
    firefly_threshold: Annotated[
        float, _number("luminance of a firefly over its 3x3's second greatest and history", 1.0, 1e6)
    ] = 5.0
    firefly_floor: Annotated[
        float, _number("luminance up to which no sample is a firefly", 0.0, 1e6, "scene units")
    ] = 0.25
    sky_below: Annotated[
        float, _number("reversed depth up to which a texel counts as sky (perspective)", 0.0, 0.5, "1", "simvx: 1e-4")
    ] = 0.0
    sky_at: Annotated[
        float, _number("reversed depth at which the sky is reprojected; 0: at infinity", 0.0, 0.5, "1", "simvx: 1e-3")
    ] = 0.0
    disocclusion_blur: Annotated[float, _number("share of the 3x3 mean in a pixel without history", 0.0, 1.0)] = 0.5


# Read by the host alone, so not part of the kernels' struct.
HOST_SETTINGS = frozenset({"filter_falloff", "history_frames", "look_ahead", "motion_widths", "sky_at", "sky_below"})
KERNEL_SETTINGS = tuple(name for name in Settings.__struct_fields__ if name not in HOST_SETTINGS)


class HistoryKind(Choice):
    """What is kept of earlier frames."""

    ACCUMULATED = "accumulated", "one resolved image"
    FRAMES = "frames", "the samples of the last history_frames frames, unresampled"


class Recursion(Choice):
    """Whether a recursive resolve runs beside the gathered samples (history frames, illumination window)."""

    NONE = "none"
    STANDING = "standing", "while the camera stands still, where its history holds more samples than a window"


class Tonemap(Choice):
    """The range in which colours are compared and blended."""

    NONE = "none"
    PEAK = "peak", "c / (1 + max(r, g, b)), undone when the result is stored"
    BLEND = "blend", "as peak, for the blend alone: boxes and comparisons use linear light"
    CHANNEL = "channel", "c / (1 + c), each channel by itself, undone in the same way (Reinhard et al. 2002)"


class Reproject(Choice):
    """What the history position follows."""

    FULL = "full", "camera and own motion"
    CAMERA = "camera", "the camera alone"
    NONE = "none", "nothing: the same pixel"


class OnCameraMove(Choice):
    """What happens to the history when the camera moves."""

    KEEP = "keep"
    RESET = "reset"


class RayThrough(Choice):
    """Where in the pixel the surface at its depth is assumed to lie."""

    SAMPLE = "sample", "at the jittered sample"
    CENTRE = "centre", "at the pixel's centre, as in resolves that reproject with unjittered matrices"


class ExposureChange(Choice):
    """What a change of exposure does to the history."""

    FOLLOW = "follow", "scales it by the ratio"
    IGNORE = "ignore"


class ReactiveMask(Choice):
    """What the reactive channel does."""

    USE = "use", "reduces the history where it is high"
    IGNORE = "ignore"


class OffScreen(Choice):
    """What a history position outside the previous image means."""

    FRESH = "fresh", "no history"
    EDGE = "edge", "the nearest texel of the edge"


class AlphaFrom(Choice):
    """Where the alpha of the result comes from."""

    BLEND = "blend", "accumulated like colour"
    CURRENT = "current", "the current frame's"


class Negatives(Choice):
    """How light that a negative lobe or a chroma clamp made negative is treated."""

    RAISE = "raise", "to 0, or to the current sample where that is negative itself"
    KEEP = "keep"


class Neighbourhood(Choice):
    """Which texels around a pixel its statistics cover."""

    SQUARE = "square"
    LUMINANCE = "luminance", "the square, its mean and deviation with weights 1 / (1 + Y)"
    JITTERED = "jittered", "the square, with weights exp(-filter_falloff d^2), d from a sample to the pixel's centre"


class Variance(Choice):
    """How the deviation of the neighbourhood is computed."""

    SHIFTED = "shifted", "from differences to the centre: accurate at any mean"
    NAIVE = "naive", "E[x^2] - E[x]^2, the popular form: cancels where the mean is much larger than the deviation"


class Box(Choice):
    """What the history is compared with."""

    VARIANCE = "variance", "mean +- gamma standard deviations"
    EXTREMES = "extremes", "least and greatest value of each channel"
    BOTH = "both", "the intersection of the two"
    ROUNDED = "rounded", "the mean of the extremes of the 3x3 and of its cross without corners"
    UNIT = "unit", "the extremes, widened to contain [0, 1]"


class BoxSpace(Choice):
    """The colour space of the box."""

    RGB = "rgb"
    YCOCG = "ycocg"


class Rectify(Choice):
    """How implausible history is moved into the box."""

    NONE = "none"
    CLAMP = "clamp", "each channel by itself; continuous: moves no further than the history moved"
    CLIP = "clip", "along the line to the centre, extents floored"
    CLIP_UNGUARDED = "clip-unguarded", "the popular form, 1e-8 added to its extents: discontinuous for flat boxes"
    CLIP_CURRENT = "clip-current", "along the line to the current sample, itself clamped"
    ELLIPSOID = "ellipsoid", "along the line to the centre, onto the ellipsoid inside the box"


class Dilation(Choice):
    """Whose motion a pixel follows."""

    NONE = "none", "its own"
    CLOSEST = "closest", "that of the nearest surface in its 3x3"
    EDGE = "edge", "the same, but only across a depth edge"
    CORNERS = "corners", "that of the nearest among itself and the texels two away along both diagonals"
    BESIDE = "beside", "that of the texel above left of the nearest surface in its 3x3; none beyond the image"


class Illumination(Choice):
    """How history is treated whose light has changed since."""

    STATIC = "static", "not tested: only the box limits it"
    TEST = "test", "fewer samples, the more consistently the current 3x3 differs from its history; of "
    "gathered samples: window"
    WINDOW = "window", "mixes the temporal windows that agree with the latest samples; without gathered samples: test"


class Reject(Choice):
    """How history of another surface is recognised."""

    NONE = "none"
    DEPTH = "depth", "by the inverse depth expected in the previous frame"


class Accumulate(Choice):
    """How the weight of the current sample follows from the number of samples in the history."""

    COUNT = "count", "running mean: 1 / (count + 1)"
    EXPONENTIAL = "exponential", "the same, but at least blend_weight"
    CONSTANT = "constant", "blend_weight from the second frame on"
    ADAPTIVE = "adaptive", "from blend_weight to moving_weight, by motion and by the distance of rectification"
    CAPPED = (
        "capped",
        "the history's weight grows with count / sample_limit until a sample has blend_weight; in motion moving_weight",
    )
    STANDING = "standing", "moving_weight; at rest 1 / count, down to blend_weight, the count growing by ten a frame"


class Weighting(Choice):
    """Further weights in the blend."""

    NONE = "none"
    LUMINANCE = "luminance", "1 / (knee + Y), so that a firefly does not outweigh the history"


class AntiFlicker(Choice):
    """What lowers the weight of the current sample where the picture is likely to flicker."""

    NONE = "none"
    DIFFERENCE = "difference", "by the luminance difference between the sample and its history (Lottes)"
    CLAMP_DISTANCE = "clamp-distance", "by the distance of the history from the ends of its box (Karis 2014)"


class Fireflies(Choice):
    """How isolated samples far above their 3x3 and their history are treated (history accumulated alone)."""

    KEEP = "keep"
    CLAMP = "clamp", "above firefly_threshold times the greater of both they are ignored"


class Choices(msgspec.Struct, frozen=True, kw_only=True, cache_hash=True):
    """Parameters that shape the code; they reach the kernels as ``#define`` lines and cost one cached build."""

    history_filter: HistoryFilter = HistoryFilter.CATMULL_ROM
    history_range: HistoryRange = HistoryRange.LINEAR
    history: HistoryKind = HistoryKind.ACCUMULATED
    recursion: Recursion = Recursion.NONE
    current_filter: CurrentFilter = CurrentFilter.NONE
    filter_use: FilterUse = FilterUse.ALWAYS
    tonemap: Tonemap = Tonemap.NONE
    reproject: Reproject = Reproject.FULL
    on_camera_move: OnCameraMove = OnCameraMove.KEEP
    off_screen: OffScreen = OffScreen.FRESH
    ray_through: RayThrough = RayThrough.SAMPLE
    exposure_change: ExposureChange = ExposureChange.FOLLOW
    reactive_mask: ReactiveMask = ReactiveMask.USE
    neighbourhood: Neighbourhood = Neighbourhood.SQUARE
    variance: Variance = Variance.SHIFTED
    box: Box = Box.EXTREMES
    box_space: BoxSpace = BoxSpace.YCOCG
    rectify: Rectify = Rectify.CLAMP
    dilation: Dilation = Dilation.EDGE
    reject: Reject = Reject.DEPTH
    illumination: Illumination = Illumination.STATIC
    accumulate: Accumulate = Accumulate.COUNT
    weighting: Weighting = Weighting.LUMINANCE
    anti_flicker: AntiFlicker = AntiFlicker.NONE
    alpha_from: AlphaFrom = AlphaFrom.BLEND
    negatives: Negatives = Negatives.RAISE
    fireflies: Fireflies = Fireflies.KEEP


# Read by the host alone, so not part of the kernels' text.
HOST_CHOICES = frozenset({"exposure_change", "history", "on_camera_move", "ray_through", "reactive_mask", "reproject"})
