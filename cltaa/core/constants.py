"""Named constants of the kernels and of their NumPy twins: one table of name, value and source."""

from __future__ import annotations

from typing import Final, NamedTuple


class Constant(NamedTuple):
    """One row of the table."""

    value: float
    source: str


CONSTANTS: Final[dict[str, Constant]] = {
    "DOMAIN_LIMIT": Constant(2.0**50, "largest usable magnitude: nine squares of it stay below the largest float32"),
    "TINY": Constant(2.0**-100, "smaller magnitudes are stored as 0: well above the denormals, below any light"),
    "MOTION_LIMIT": Constant(2.0**20, "largest displacement in pixels; larger ones, and NaN, mean no history"),
    "LEAST_W": Constant(2.0**-6, "least previous w over current w: nearer to the camera plane nothing was seen"),
    "THIN_REACH": Constant(0.75, "pixels from the centre to which a thing that the 3x3 misses is looked for: measured"),
    "THIN_HITS": Constant(3.0, "samples of a 3x3 that a line through it hits: what hits more is not thin"),
    "HALF_LIMIT": Constant(65504.0, "largest half; larger magnitudes are stored as it"),
    "HALF_NORMAL": Constant(2.0**-14, "least normal half; below it halves have one distance"),
    "HALF_STEP": Constant(2.0**-10, "distance of halves over the power of two below them"),
    "HALF_TINY": Constant(2.0**-25, "half the least half: smaller magnitudes round to 0, and are stored as +0"),
    "DITHER_STEP": Constant(2.0**-24, "24 bits as a number in [0, 1)"),
    "LEAST_TRUST": Constant(2.0**-6, "least ratio of two spans' errors: its 16th power is well above the denormals"),
    "STANDING_KNEE": Constant(2.0, "times luminance_knee: that of the many samples of a span without motion: measured"),
    "SURELY_STANDS": Constant(
        4.0,
        "times repeated samples differ by: where that is below what the short spans err, light stands (decision 35)",
    ),
    "SHARED_NOISE": Constant(
        0.003, "share of the latest samples' variance that the texels around have in common: measured"
    ),
    "SURE_T": Constant(3.0, "Student's t from which the step between the two shortest spans is no chance: measured"),
    "SURE_FLOOR": Constant(0.001, "share of the light below which such a step is one that nobody sees: measured"),
    "DRIFT_T": Constant(2.0, "Student's t from which light has moved since a longer span: as measured for t5"),
    "DRIFT_FLOOR": Constant(0.01, "share of the light below which nobody sees that"),
    "LAG": Constant(0.5, "of such a step, what the shortest span is behind now: 0.75 if steady, 0 if over: measured"),
    "NOW_T": Constant(12.0, "deviations that chance may move the mean of the texels of now by: measured"),
    "NOW_HELD": Constant(2.0, "times the range of the 5x5 of now that the result may lie beside it: measured"),
    "NOW_FLOOR": Constant(0.0001, "share of the light by which each of these texels is off all the same: rounding"),
    "NOW_SHARED": Constant(0.2, "share of the variance of a texel of now that all of a 3x3 have in common: measured"),
    "REACTIVE_FALL": Constant(
        10.0,
        "1 over how far beside the reactivities of the 3x3 of now that of a sample may lie: measured (decision 43)",
    ),
    "SEEN_LATELY": Constant(
        1.25, "samples of the latest frames that are enough to say that they saw a surface: measured"
    ),
    "HARDLY_SEEN": Constant(1.5, "samples of the shortest span that leave nothing to a recursive result: measured"),
    "BEGUN_ANEW": Constant(4.0, "samples of a recursive result that has begun anew; all the way one sample below"),
    "FEW_GATHERED": Constant(6.0, "samples that are few for spans of the past; all the way one below"),
    "BESIDE_MOST": Constant(0.85, "most share of a recursive result in either case: measured (decision 39)"),
    "BESIDE_FEW": Constant(3.75, "over the samples of the spans: the same where they have some: measured"),
    "BESIDE_MANY": Constant(35.0, "over their square: the same where they have many: measured"),
    "LASTED": Constant(6.0, "samples from which on a recursive result has lasted: measured"),
    "LASTED_STEP": Constant(1.0 / 4.0, "a sample more of it, till it counts wholly"),
    "GATHERED": Constant(7.0, "samples of spans from which on it counts beside them by its own: measured"),
    "GATHERED_STEP": Constant(1.0 / 7.0, "a sample more of them, till it does so wholly"),
    "CHANGE_STEP": Constant(0.125, "of Student's t: what is kept of a change of light comes in steps of it"),
    "KEPT_CHANGES": Constant(63.0, "most such steps: the last six bits of a count hold them"),
    "LEAST_HEADROOM": Constant(2.0**-16, "least 1 - peak when a tonemap is undone: half's largest number, 65504"),
    "ONE_THIRD": Constant(1.0 / 3.0, "mean of a row of three"),
    "TWO_THIRDS": Constant(2.0 / 3.0, "sum of squared distances over a row's spread (moments.h)"),
    "TWO_27THS": Constant(2.0 / 27.0, "variance over the spread of the 3x3: a ninth of that"),
    "ONE_FIFTH": Constant(1.0 / 5.0, "mean of the cross"),
    "ONE_NINTH": Constant(1.0 / 9.0, "mean of the 3x3"),
}

# Halo of every plane, in texels. A 4x4 history filter of an on-screen position reads 2 texels past the edge, and a
# segment of 16 lanes that starts inside the image reads up to 15 + 2 past it; rounding rows up to ROW_ALIGNMENT and
# 16 more covers both and keeps rows aligned.
PAD_X: Final = 16
PAD_Y: Final = 4
# Where light may change, a pixel is resolved from the latest frames, from a few more, from all that are kept, and from
# all without following its motion; which of them to believe, the texels around it tell (docs/decisions).
SPANS: Final = 4
SHORT_SPAN: Final = 3  # kept frames of the first
MIDDLE_SPAN: Final = 7  # and of the second
SPAN_REACH: Final = 2  # texels up, down, left and right that are asked
# Those of them that kernels know, by these names.
WHOLE_NUMBERS: Final = {
    "PAD_X": PAD_X,
    "PAD_Y": PAD_Y,
    "SPANS": SPANS,
    "SHORT_SPAN": SHORT_SPAN,
    "MIDDLE_SPAN": MIDDLE_SPAN,
    "SPAN_REACH": SPAN_REACH,
}
# Rows begin on a multiple of this many floats, the widest vector of any device.
ROW_ALIGNMENT: Final = 16


def value(name: str) -> float:
    """The value of a constant of the table."""
    return CONSTANTS[name].value
