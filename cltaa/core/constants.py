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
    "LEAST_W": Constant(2.0**-6, "least previous w over current w: points nearer to the camera plane have no history"),
    "CAMERA_TOLERANCE": Constant(
        2.0**-11, "pixels by which a vector may differ from the camera's motion that it is: rounding of floats"
    ),
    "CAMERA_SHARE": Constant(2.0**-9, "the same as a share of the vector: twice what halves round by"),
    "SUBPIXEL_REACH": Constant(
        0.75, "pixels from the centre within which a missed sub-pixel feature is searched: measured"
    ),
    "SUBPIXEL_HITS": Constant(3.0, "samples of a 3x3 that a line hits; a feature with more hits is not thin"),
    "AHEAD_TOLERANCE": Constant(
        0.5, "largest move in pixels of the last round of a step ahead: half a sample's distance"
    ),
    "HALF_LIMIT": Constant(65504.0, "largest half; larger magnitudes saturate"),
    "HALF_NORMAL": Constant(2.0**-14, "least normal half; below it halves have one distance"),
    "HALF_STEP": Constant(2.0**-10, "distance of halves over the power of two below them"),
    "HALF_TINY": Constant(2.0**-25, "half the least half: smaller magnitudes round to 0, and are stored as +0"),
    "DITHER_STEP": Constant(2.0**-24, "24 bits as a number in [0, 1)"),
    "LEAST_ERROR_RATIO": Constant(
        2.0**-6, "least ratio of two windows' errors: its 16th power is well above the denormals"
    ),
    "DRIFT_FLOOR": Constant(0.01, "share of the light below which a change is invisible"),
    "REACTIVE_FALL": Constant(
        10.0,
        "1 / the largest distance of a sample's reactivity from the range of the 3x3: measured (decisions/08)",
    ),
    "MOVING_ERROR": Constant(0.5, "share of the error of a moving recursive result that counts: measured"),
    "PRESENT_PENALTY": Constant(
        2.0, "factor of the neighbours' error beside that of the pixel's own samples: measured"
    ),
    "LEAST_NEIGHBOUR_SHARE": Constant(
        0.25, "least share of the filter beside its centre for neighbours to be evidence"
    ),
    "LEAST_PARALLAX": Constant(0.25, "parallax in pixels from which an occluder has passed a surface: measured"),
    "LARGEST_PARALLAX": Constant(
        1.0, "parallax in pixels between a gathered sample and the surface, above which it shows another: measured"
    ),
    "ADDED_EXTENT": Constant(1e-8, "added to half extents that the popular clip divides by: Playdead's and Bevy's"),
    "STATIC_MOTION": Constant(0.01, "motion in pixels along an axis below which a pixel is static (standing): Bevy's"),
    "STANDING_GAIN": Constant(10.0, "growth a frame of a static pixel's count (standing): Bevy's"),
    "MOST_CHANGE": Constant(8.0, "largest stored Student's t of an illumination change"),
    "LEAST_HEADROOM": Constant(2.0**-16, "least 1 - peak when a tonemap is undone: half's largest number, 65504"),
    "ONE_THIRD": Constant(1.0 / 3.0, "mean of a row of three"),
    "TWO_27THS": Constant(2.0 / 27.0, "variance over the spread of the 3x3: a ninth of that"),
    "ONE_NINTH": Constant(1.0 / 9.0, "mean of the 3x3"),
}

# Halo of every plane, in texels. The history filter of 20 taps reads 3 texels past the edge at an on-screen position,
# and a segment of 16 lanes that starts inside the image up to 15 + 3 past it; rounding rows up to ROW_ALIGNMENT and 16
# more covers both and keeps rows aligned.
PAD_X: Final = 16
PAD_Y: Final = 4
# Temporal windows. Where light may change, a pixel is resolved from the latest frames, from more, from all that are
# kept, and from all without following its motion; the texels around it decide which to use (docs/decisions).
FIRST_WINDOWS: Final = 3, 7  # frames of the ring in the first two
# The same where as many lie ahead as are earlier: with one more, a window lags by half a frame.
CENTRED_WINDOWS: Final = 4, 6
LONG_WINDOW: Final = 14  # and in the third, where the ring holds more and some lie ahead
WINDOW_REACH: Final = 2  # texels up, down, left and right that take part in that decision
BALANCED_DRIFT: Final = 0.75  # share of a drift by which pixels go on where frames ahead balance the earlier: measured
HELD_SHARE: Final = 7 / 8  # of a ring's frames that the history of a still scene has to hold to be better: measured
FILL_REACH: Final = 128  # texels within which a usable one is searched for: half a tile of 256
AHEAD_STEPS: Final = 3  # iterations of the search for the place to which a surface moves in a later frame
# The whole numbers that kernels use, by these names.
WHOLE_NUMBERS: Final = {
    "PAD_X": PAD_X,
    "PAD_Y": PAD_Y,
    "LONG_WINDOW": LONG_WINDOW,
    "WINDOW_REACH": WINDOW_REACH,
    "AHEAD_STEPS": AHEAD_STEPS,
    "FILL_REACH": FILL_REACH,
}
# Rows begin on a multiple of this many floats, the widest vector of any device.
ROW_ALIGNMENT: Final = 16


def value(name: str) -> float:
    """The value of a constant of the table."""
    return CONSTANTS[name].value
