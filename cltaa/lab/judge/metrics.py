"""Errors of an image against the truth: MSE, PSNR, SSIM, FLIP, and the equal-quality samples.

Definitions, ranges and laws are in ``docs/metrics.md``.

Functions of two images take the test first and the reference second, linear [H, W, 3] float32 of one size.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from itertools import chain, pairwise
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cltaa import __version__
from cltaa.core.frame_checks import EXPOSURE_STOPS, NO_LIGHT, is_no_light
from cltaa.errors import DataError, UsageError, import_extra, known, public, several
from cltaa.frame import Image, shared
from cltaa.io.display import luma, shown_light, to_display
from cltaa.io.sequence import ImageSequence
from cltaa.printable import counted

SSIM_SIGMA = 1.5  # pixels; Wang et al. 2004, with their 11 x 11 Gaussian window
SSIM_SMALLEST_SIDE = 11
# Luminance; FLIP's range of exposures is inverted if the brightest luminance is below float32's epsilon.
FLIP_DARKEST = 1e-6
FLIP_PIXELS_PER_DEGREE = 67.0  # FLIP's own default: 0.7 m from a 3840 pixel, 0.7 m wide screen


@dataclass(frozen=True, slots=True)
class Measure:
    """A column of a table: its name, meaning, format, and which direction is better."""

    name: str
    title: str
    form: str = ".4f"
    higher_is_better: bool = False

    @property
    def head(self) -> str:
        """The head of its column."""
        return f"{self.name} {'↑' if self.higher_is_better else '↓'}"


ALPHA = Measure("alpha", "root mean square error of alpha, where both images have it")
SAMPLES = Measure(
    "samples", "equal-quality samples, so many a pixel a supersampler needs for the same error", higher_is_better=True
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Metric(Measure):
    """An error of an image: ``function(test, reference, stops)``.

    ``needs`` imports its library, ``package``; raises UsageError that says what to install.
    """

    function: Callable[[Image, Image, float], float]
    needs: Callable[[], object] = lambda: None
    package: str = "numpy"


def mse(test: Image, reference: Image) -> float:
    """Return the mean squared error over all pixels and channels, in float64; 0 is identical."""
    return float(np.mean(np.square(test.astype(np.float64) - reference)))


def light_mse(test: Image, reference: Image, stops: float = 0.0) -> float:
    """Return the mean squared error of the light that a screen can show, linear in [0, 1].

    Linear, so that it falls with the samples of a supersampler by the law of STRATIFIED_EXPONENT; clamped at white,
    because otherwise a few highlights far above white would outweigh the rest of the picture.
    """
    return mse(shown_light(test, stops), shown_light(reference, stops))


def psnr(mean_squared_error: float) -> float:
    """Return the peak signal-to-noise ratio in dB for a peak of 1; infinite if the error is 0."""
    return math.inf if mean_squared_error == 0 else -10 * math.log10(mean_squared_error)


def mean_psnr(values: Sequence[float]) -> float:
    """Return the PSNR of the mean of the squared errors behind ``values``: finite unless all are infinite."""
    return psnr(math.fsum(10 ** (-value / 10) for value in values) / len(values))


def ssim(test: Image, reference: Image, stops: float = 0.0) -> float:
    """Return the mean structural similarity of the display luma (Wang et al. 2004, Gaussian window); 1 is identical.

    Raises UsageError without scikit-image and DataError for images smaller than the window.
    """
    if min(test.shape[:2]) < SSIM_SMALLEST_SIDE:
        expected = f"at least {SSIM_SMALLEST_SIDE} pixels a side"
        found, cure = f"{test.shape[1]} x {test.shape[0]}", "judge by other metrics, as mse,psnr,flip, or larger images"
        raise DataError("image too small for SSIM", expected=expected, found=found, cure=cure)
    # In float32 the variances of smooth pictures are only rounding, and the mean could exceed 1.
    value = _import_skimage().structural_similarity(
        luma(to_display(test, stops)).astype(np.float64),
        luma(to_display(reference, stops)).astype(np.float64),
        gaussian_weights=True,
        sigma=SSIM_SIGMA,
        use_sample_covariance=False,
        data_range=1.0,
    )
    return float(value)


def _import_skimage() -> Any:
    return import_extra("skimage.metrics", package="scikit-image", extra="metrics", purpose="metric ssim")


def _import_flip() -> Any:
    return import_extra("flip_evaluator", package="flip-evaluator", extra="metrics", purpose="metric flip")


def flip_map(test: Image, reference: Image, stops: float = 0.0, *, hdr: bool = False) -> Image:
    """Return the FLIP error [H, W] in [0, 1] (Andersson et al. 2020), or HDR-FLIP (2021), at 67 pixels per degree.

    LDR: of the display images. HDR: of the linear images without negative values, the largest error over the range
    of exposures that FLIP derives from the reference, with its ACES curve. Raises UsageError without flip-evaluator.
    """
    light = [np.maximum(image, 0.0) * np.float32(2.0**stops) for image in (test, reference)]
    # In a picture too dark for HDR-FLIP's range of exposures the module would end the program.
    if hdr and float(luma(light[1]).max()) >= FLIP_DARKEST:
        return _flip(light[0], light[1], "HDR")
    return _flip(to_display(test, stops), to_display(reference, stops), "LDR")


def _flip(test: Image, reference: Image, scale: str) -> Image:
    reference_image, test_image = (np.ascontiguousarray(image, dtype=np.float32) for image in (reference, test))
    error, _, _ = _import_flip().evaluate(
        reference_image,
        test_image,
        scale,
        applyMagma=False,
        computeMeanError=False,
        parameters={"ppd": FLIP_PIXELS_PER_DEGREE},
    )
    per_pixel: Image = np.asarray(error, dtype=np.float32)[..., 0]
    return per_pixel


def _display_psnr(test: Image, reference: Image, stops: float) -> float:
    return psnr(mse(to_display(test, stops), to_display(reference, stops)))


METRICS = {
    metric.name: metric
    for metric in (
        Metric("mse", "mean squared error of linear light up to white", ".4g", function=light_mse),
        Metric("mse-linear", "mean squared error of all linear light", ".4g", function=lambda a, b, _: mse(a, b)),
        Metric("psnr", "PSNR of the display images, dB", ".2f", True, function=_display_psnr),
        Metric(
            "psnr-linear",
            "PSNR of all linear light for a peak of 1, dB",
            ".2f",
            True,
            function=lambda a, b, _: psnr(mse(a, b)),
        ),
        Metric(
            "ssim",
            "SSIM of display luma",
            higher_is_better=True,
            function=ssim,
            needs=_import_skimage,
            package="scikit-image",
        ),
        Metric(
            "flip",
            "mean FLIP of the display images",
            function=lambda a, b, s: float(flip_map(a, b, s).mean()),
            needs=_import_flip,
            package="flip-evaluator",
        ),
        Metric(
            "flip-hdr",
            "mean HDR-FLIP",
            function=lambda a, b, s: float(flip_map(a, b, s, hdr=True).mean()),
            needs=_import_flip,
            package="flip-evaluator",
        ),
    )
}
DEFAULT_METRICS = ("mse", "psnr", "ssim", "flip")


def versions_of(metrics: Iterable[Metric]) -> dict[str, str]:
    """Return the versions of the packages that compute these metrics, to make results reproducible."""
    return {"cltaa": __version__} | {metric.package: version(metric.package) for metric in metrics}


def parse_metrics(text: str) -> tuple[Metric, ...]:
    """Parse a comma-separated list of metrics, or ``all``; raises what ``named_metrics`` raises."""
    names = list(METRICS) if text == "all" else [name.strip() for name in text.split(",") if name.strip()]
    if not names:
        raise UsageError("no metric is named", expected=", ".join(METRICS))
    return named_metrics(names)


def named_metrics(names: Iterable[str]) -> tuple[Metric, ...]:
    """Return metrics by name, each once, with their libraries imported.

    Raises UsageError for an unknown name or a missing library, so that it fails before the work.
    """
    metrics = []
    for name in dict.fromkeys(names):
        if name not in METRICS:
            raise UsageError(f"unknown metric {name}", cure=known(name, METRICS, "metrics"))
        metrics.append(METRICS[name])
    for metric in metrics:
        metric.needs()
    return tuple(metrics)


@public("measure")
def measure(
    test: Image,
    reference: Image,
    metrics: str | Iterable[Metric | str] | None = None,
    stops: float = 0.0,
    *,
    path: Path | None = None,
    truth_path: Path | None = None,
    frame: int | None = None,
) -> dict[str, float]:
    """Return the value of every metric (by default ``DEFAULT_METRICS``) for one pair of images, linear light [H, W, 3]
    in floats.

    ``metrics`` are names, Metric objects, or names in one comma-separated text. Raises UsageError for an unknown
    metric, stops beyond 32 and other types than arrays; DataError for different sizes, images other than floats
    [H, W, 3] or without pixels, and NaN or infinity, with ``frame`` and the file's path in its text.
    """
    test, reference = shared("image", test), shared("reference", reference)
    for image in (test, reference):
        if not isinstance(image, np.ndarray):
            cure = "files are judged by cltaa compare"
            if image is None:
                cure = "the reference of a sequence without truth is None"
            elif isinstance(image, ImageSequence):
                cure = "take one of its images: .image(frame)"
            raise UsageError("no image to measure", expected="an array", found=type(image).__name__, cure=cure)
    if test.shape != reference.shape:
        expected, found = list(reference.shape), list(test.shape)
        raise DataError("images differ in size", path=path, frame=frame, expected=expected, found=found)
    for name, image, file in (("image", test, path), ("reference", reference, truth_path)):
        if image.dtype.kind != "f" or image.shape[2:] != (3,) or not image.size:
            what, given = f"the {name} is no linear light", f"{image.dtype} {list(image.shape)}"
            raise DataError(what, path=file, frame=frame, expected="floats [H, W, 3]", found=given)
        check_finite(name, image, file, frame)
        if why := is_no_light(image):
            warnings.warn(f"the {name} is {why} (expected linear light); {NO_LIGHT[why]}", stacklevel=4)
    if not isinstance(stops, Real) or not abs(stops) <= EXPOSURE_STOPS:
        within = f"a number from {-EXPOSURE_STOPS:g} to {EXPOSURE_STOPS:g}"
        raise UsageError("stops are out of range", expected=within, found=repr(stops))
    asked = several(DEFAULT_METRICS if metrics is None else metrics, "metrics", Metric)
    if not asked:
        raise UsageError("no metric is named", expected=", ".join(METRICS))
    chosen = chain.from_iterable(parse_metrics(each) if isinstance(each, str) else [each] for each in asked)
    return {metric.name: metric.function(test, reference, stops) for metric in chosen}


def check_finite(name: str, image: Image, path: Path | None, frame: int | None) -> None:
    """Raise DataError, with ``name``, for NaN or infinity in ``image``."""
    bad = image.size - int(np.isfinite(image).sum())
    if bad:
        what = f"NaN or infinity in {counted(bad, 'value')} of the {name}"
        raise DataError(what, path=path, frame=frame, cure="there is no error to state; look for their cause")


def finite(image: Image) -> Image:
    """Return single samples [H, W, 3] with black for non-finite texels, which are allowed because a resolve repairs
    them."""
    return np.where(np.isfinite(image), image, np.float32(0))


def mean_of(metric: str, values: Sequence[float]) -> float:
    """Return the mean of a metric over frames; for PSNR that of the mean squared error, so that it stays finite."""
    return mean_psnr(values) if metric.startswith("psnr") else math.fsum(values) / len(values)


def mean(frames: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Return ``mean_of`` each metric."""
    rows = list(frames)
    return {name: mean_of(name, [row[name] for row in rows]) for name in (rows[0] if rows else ())}


CVVDP_DISPLAY = "standard_fhd"  # 24 inch, 1920 x 1080, seen from 60 cm
CVVDP_TITLE = f"ColorVideoVDP in JOD on {CVVDP_DISPLAY}: 10 is indistinguishable, one less is seen by 3 of 4"


def import_cvvdp() -> Any:
    """Import pycvvdp; raises UsageError that says what to install."""
    return import_extra("pycvvdp", package="cvvdp", extra="vdp", purpose="--cvvdp")


def jod(test: Sequence[Image], reference: Sequence[Image], rate: float, stops: float) -> float:
    """Return ColorVideoVDP (Mantiuk et al. 2024), in JOD, of a film against its truth at ``rate`` frames per second.

    Holds all frames in memory. Raises UsageError without the extra ``vdp``.
    """
    films = [np.stack([to_display(image[..., :3], stops) for image in images]) for images in (test, reference)]
    metric = import_cvvdp().cvvdp(display_name=CVVDP_DISPLAY, quiet=True)
    found, _ = metric.predict(*(film.astype(np.float32) for film in films), dim_order="FHWC", frames_per_second=rate)
    return float(found)


# An edge crosses about sqrt(n) of a pixel's n strata; only those have an error, each of variance ~ 1/n^2 (Mitchell
# 1996, "Consequences of Stratified Sampling in Graphics"): the mean squared error of edges falls as n^(-3/2).
STRATIFIED_EXPONENT = 1.5


def equal_quality_samples(mse: float, one_sample_mse: float, *, truth_samples: int | None = None) -> float:
    """Return the stratified samples a pixel that give ``mse``, from the error of one sample and MSE(n) = MSE(1)
    n^(-3/2).

    Both errors are means of ``light_mse`` against one truth. If that truth has ``truth_samples`` samples a pixel, its
    own share of both errors is subtracted by the same law, and the result is at most ``truth_samples``, because a truth
    cannot prove more. Infinite for no error against an exact truth. Raises DataError for invalid errors.
    """
    if not (one_sample_mse > 0 and mse >= 0 and math.isfinite(one_sample_mse) and math.isfinite(mse)):
        found = f"{mse:g} against {one_sample_mse:g} for one sample"
        raise DataError("no equal-quality samples for these errors", expected="positive numbers", found=found)
    truth_error = 0.0
    if truth_samples is not None:
        noise = truth_samples**-STRATIFIED_EXPONENT
        one_sample_mse /= 1 + noise
        truth_error = one_sample_mse * noise
    limit = math.inf if truth_samples is None else float(truth_samples)
    error = mse - truth_error
    if error <= 0:
        return limit
    return float(min(limit, (one_sample_mse / error) ** (1 / STRATIFIED_EXPONENT)))


def falls(curve: Sequence[tuple[int, float]]) -> bool:
    """Return whether two or more errors are positive and fall with the samples, so that they can be interpolated."""
    errors = [error for _, error in sorted(curve)]
    return len(errors) > 1 and min(errors) > 0 and all(later < earlier for earlier, later in pairwise(errors))


def samples_on_curve(mse: float, curve: Sequence[tuple[int, float]]) -> float:
    """Return the samples a pixel that give ``mse``, interpolated between points (samples, error) linearly in log-log.

    All errors are against one truth, so that its own share cancels, and satisfy ``falls``. Beyond the ends of the curve
    the result is the nearest end.
    """
    samples, errors = np.array(sorted(curve)).T
    if mse <= 0:
        return float(samples[-1])
    return float(np.exp(np.interp(-math.log(mse), -np.log(errors), np.log(samples))))


class EqualQuality(NamedTuple):
    """Equal-quality samples of a test, the method, and whether they are a bound."""

    samples: float
    method: str  # "measured", or "n^-1.5 law"
    bound: str | None  # "at least" or "at most" at the ends of the curve, or of the truth


def equal_quality(
    test_mse: float, one_sample_mse: float, yardsticks: Mapping[int, Sequence[float]], count: int | None
) -> EqualQuality:
    """Return the equal-quality samples of a test, from its capture's yardsticks if their errors fall, else by the law.

    The errors are those of ``light_mse``: means over the frames of the test, and for the ``yardsticks``, by samples a
    pixel, those of each frame. ``count`` is the samples of the truth, if known.
    """
    # A yardstick without error was drawn exactly like the truth.
    means = [(samples, sum(errors) / len(errors)) for samples, errors in yardsticks.items() if any(errors)]
    curve = [(1, one_sample_mse), *means]
    if falls(curve):
        samples = samples_on_curve(test_mse, curve)
        if count is not None and samples >= count:  # a yardstick may have more, but the truth proves no more
            return EqualQuality(float(count), "measured", "at least")
        bound = "at most" if test_mse > one_sample_mse else "at least" if test_mse < curve[-1][1] else None
        return EqualQuality(samples, "measured", bound)
    samples = equal_quality_samples(test_mse, one_sample_mse, truth_samples=count)
    return EqualQuality(samples, "n^-1.5 law", "at least" if samples == count else None)
