"""Every parameter of the resolve, declared once: the choices here, the numbers in ``settings.py``.

From these declarations come the range check, the TOML key, the ``--set`` option, the row in the docs, the C struct that
a kernel receives and the ``#define`` lines of its prelude.
"""

from __future__ import annotations

import msgspec

from cltaa.parameters.filters import CurrentFilter as CurrentFilter
from cltaa.parameters.filters import FilterUse as FilterUse
from cltaa.parameters.filters import HistoryFilter as HistoryFilter
from cltaa.parameters.named_choice import Choice as Choice
from cltaa.parameters.settings import Settings as Settings


class HistoryOf(Choice):
    """What is remembered of earlier frames."""

    RESULT = "result", "their resolved image: any number of frames in one"
    DOUBLED = "doubled", "the same at 200 %: four texels a pixel"
    SAMPLES = "samples", "the samples of the last frames_kept frames, as they were drawn"


class GatherFit(Choice):
    """What the gathered samples of a pixel are taken for (history_of samples)."""

    MEAN = "mean", "as many draws of one value"
    PLANE = "plane", "points of a plane over the pixel, whose value at the centre is taken"
    LAYERS = "layers", "the same, and across a depth edge a nearer surface and a farther one, each on its own way"


class ThinSearch(Choice):
    """Along which ways things thinner than a pixel are looked for (gather_fit layers)."""

    OWN_WAY = "own-way", "that of what the pixel shows"
    BESIDE = "beside", "where light does not change, that of the nearest thing around it too, twice as many frames back"


class Tonemap(Choice):
    """The range in which everything is compared and blended."""

    NONE = "none"
    PEAK = "peak", "c / (1 + max(r, g, b)), undone when the result is stored"


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
    """Where in the pixel the surface is taken to lie that the depth tells of."""

    SAMPLE = "sample", "at the jittered sample that was drawn"
    CENTRE = "centre", "at the pixel's centre, as resolves that reproject by unjittered matrices have it"


class ExposureChange(Choice):
    """What a change of exposure does to the history."""

    FOLLOW = "follow", "it is scaled by the ratio"
    IGNORE = "ignore"


class ReactiveMask(Choice):
    """What the reactive channel does."""

    USE = "use", "less history where it is high"
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
    """What happens to light that a negative lobe or a chroma clamp made negative."""

    RAISE = "raise", "to 0, or to the current sample where that is negative itself"
    KEEP = "keep"


class Neighbourhood(Choice):
    """Which texels around a pixel its statistics are taken over."""

    CROSS = "cross"
    SQUARE = "square"
    WEIGHTED = "weighted", "the square, its mean and deviation with weights 1 2 1 both ways"


class Variance(Choice):
    """How the deviation of the neighbourhood is summed up."""

    SHIFTED = "shifted", "of differences from the centre: right at any mean"
    NAIVE = "naive", "E[x^2] - E[x]^2, the popular form: it cancels where the mean is large beside the deviation"


class Box(Choice):
    """What the history is held against."""

    VARIANCE = "variance", "mean +- gamma standard deviations"
    EXTREMES = "extremes", "least and greatest value of each channel"
    BOTH = "both", "the intersection of the two"
    ROUNDED = "rounded", "the mean of the extremes of the 3x3 and of the cross"
    UNIT = "unit", "the extremes, but at least [0, 1] is inside; alpha is held in its own"


class BoxSpace(Choice):
    """The colour space of the box."""

    RGB = "rgb"
    YCOCG = "ycocg"


class Rectify(Choice):
    """How implausible history is moved into the box."""

    NONE = "none"
    CLAMP = "clamp", "each channel on its own; moves no further than the history moved"
    CLIP = "clip", "along the line to the centre, extents floored"
    CLIP_UNGUARDED = "clip-unguarded", "the popular form without the floor: discontinuous for flat boxes"
    CLIP_CURRENT = "clip-current", "along the line to the current sample, itself clamped"
    ELLIPSOID = "ellipsoid", "along the line to the centre, onto the ellipsoid inside the box"


class Dilation(Choice):
    """Whose motion a pixel follows."""

    NONE = "none", "its own"
    CLOSEST = "closest", "that of the nearest surface in its 3x3"
    EDGE = "edge", "the same, but only across a depth edge"


class LightChange(Choice):
    """What becomes of history whose light has changed since."""

    IGNORE = "ignore", "its box alone tells"
    TEST = "test", "the more the 3x3 of now differs from that of the history all one way, the less it counts"
    SPANS = "spans", "the span of the past that the latest samples bear out; without gathered samples: test"


class Reject(Choice):
    """How history of another surface is recognised."""

    NONE = "none"
    DEPTH = "depth", "by the closeness that the previous frame should have had there"


class Accumulate(Choice):
    """How the weight of the current sample follows from the number of samples in the history."""

    COUNT = "count", "running mean: 1 / (count + 1)"
    EXPONENTIAL = "exponential", "the same, but never below blend_weight"
    CONSTANT = "constant", "blend_weight from the second frame on"
    ADAPTIVE = "adaptive", "from blend_weight to moving_weight, by motion and by what rectification moved"


class Weighting(Choice):
    """What else weighs in the blend."""

    NONE = "none"
    LUMINANCE = "luminance", "1 / (knee + Y): one firefly does not outweigh a pixel's whole past"


class AntiFlicker(Choice):
    """What lowers the weight of the current sample where the picture is likely to flicker."""

    NONE = "none"
    DIFFERENCE = "difference", "by the luminance difference between the sample and its history (Lottes)"
    CLAMP_DISTANCE = "clamp-distance", "by the distance of the history from the ends of its box (Karis 2014)"


class Choices(msgspec.Struct, frozen=True, kw_only=True, cache_hash=True, forbid_unknown_fields=True):
    """Parameters that shape the code; they reach the kernels as ``#define`` lines and cost one cached build."""

    history_filter: HistoryFilter = HistoryFilter.CATMULL_ROM
    history_of: HistoryOf = HistoryOf.RESULT
    gather_fit: GatherFit = GatherFit.MEAN
    thin_search: ThinSearch = ThinSearch.OWN_WAY
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
    light_change: LightChange = LightChange.IGNORE
    accumulate: Accumulate = Accumulate.COUNT
    weighting: Weighting = Weighting.LUMINANCE
    anti_flicker: AntiFlicker = AntiFlicker.NONE
    alpha_from: AlphaFrom = AlphaFrom.BLEND
    negatives: Negatives = Negatives.RAISE


# What the host alone looks at: it does not reach the kernels' text.
HOST_CHOICES = frozenset(
    {"exposure_change", "history_of", "on_camera_move", "ray_through", "reactive_mask", "reproject"}
)
