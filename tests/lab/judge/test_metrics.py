"""Metrics against values that follow from their definitions."""

from __future__ import annotations

import builtins
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.errors import DataError, UsageError
from cltaa.frame import Image
from cltaa.io.display import luma, to_display
from cltaa.lab.judge.metrics import (
    METRICS,
    flip_map,
    light_mse,
    mean,
    measure,
    mse,
    parse_metrics,
    psnr,
    ssim,
)
from tests.sequence_factory import write_sequence


def picture(seed: int = 0, size: tuple[int, int] = (24, 32)) -> Image:
    """Smooth colour with edges, 0 to 0.9."""
    y, x = np.mgrid[: size[0], : size[1]].astype(np.float32)
    phase = np.float32(seed)
    planes = [0.45 + 0.45 * np.sin(x / 5 + phase), 0.9 * ((x + y) % 8 < 4), 0.45 + 0.45 * np.cos(y / 3 + phase)]
    return np.stack(planes, axis=-1).astype(np.float32)


def noisy(image: Image, sigma: float, seed: int = 1) -> Image:
    noise = np.random.default_rng(seed).standard_normal(image.shape).astype(np.float32)
    return image + np.float32(sigma) * noise


def test_mse_and_psnr_of_a_constant_difference() -> None:
    reference = np.full((5, 6, 3), 0.5, np.float32)
    assert mse(reference + np.float32(0.125), reference) == 0.125**2
    assert psnr(0.01) == pytest.approx(20.0, abs=1e-12)
    assert psnr(0.0) == math.inf


def test_mse_sums_in_double_precision() -> None:
    """A float32 sum of 12 million equal terms would be off by more than a thousandth."""
    reference = np.zeros((2000, 2000, 3), np.float32)
    value = np.float32(0.1)
    assert mse(np.full_like(reference, value), reference) == pytest.approx(float(value) ** 2, rel=1e-12)


def test_light_mse_does_not_see_beyond_white() -> None:
    reference = picture()
    reference[0, 0] = 70.0
    brighter = reference.copy()
    brighter[0, 0] = 50.0
    assert light_mse(brighter, reference) == 0
    assert mse(brighter, reference) > 0.5
    assert light_mse(brighter, reference, stops=-7.0) > 0


def test_psnr_metric_is_that_of_the_display_images() -> None:
    reference, test = picture(), noisy(picture(), 0.05)
    expected = -10 * math.log10(np.mean((to_display(test).astype(float) - to_display(reference)) ** 2))
    assert measure(test, reference, [METRICS["psnr"]])["psnr"] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("metric", METRICS.values(), ids=list(METRICS))
def test_stops_expose_what_a_screen_shows_and_no_linear_light(metric: Any) -> None:
    four = np.float32(4)
    reference, test = four * picture(), four * noisy(picture(), 0.05)
    there, without = (measure(test, reference, [metric], stops)[metric.name] for stops in (-2.0, 0.0))
    exposed = measure(test / four, reference / four, [metric])[metric.name]  # to the bit: a power of two rounds nothing
    assert there == (without if metric.name.endswith("-linear") else exposed)
    assert exposed != without or metric.name == "flip-hdr"  # which exposes to its own liking


def test_ssim_of_a_constant_shift_follows_its_formula() -> None:
    """Without structure only the luminance term is left: (2ab + C1) / (a^2 + b^2 + C1), C1 = 0.01^2."""
    reference, test = np.full((32, 32, 3), 0.2, np.float32), np.full((32, 32, 3), 0.4, np.float32)
    a, b = (float(to_display(image)[0, 0, 0]) for image in (test, reference))
    expected = (2 * a * b + 1e-4) / (a * a + b * b + 1e-4)
    # Luma of equal channels is off by 2^-23, and scikit-image works in float32.
    assert ssim(test, reference) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("size", [(24, 32), (11, 11)])
def test_ssim_of_smooth_pictures_follows_its_formula_and_stays_below_1(size: tuple[int, int]) -> None:
    """Written anew in float64: in float32 the variances are rounding, and the mean of these is 1.000003."""
    reference = np.full((*size, 3), 0.9, np.float32)
    test = noisy(reference, 1e-4)
    taps = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
    window = np.outer(taps, taps) / taps.sum() ** 2
    one, other = (
        np.lib.stride_tricks.sliding_window_view(luma(to_display(image)).astype(np.float64), (11, 11))
        for image in (test, reference)
    )

    def mean_of(values: Any) -> Any:
        return (values * window).sum((-2, -1))

    means = mean_of(one), mean_of(other)
    variances = mean_of(one**2) - means[0] ** 2 + mean_of(other**2) - means[1] ** 2
    covariance = mean_of(one * other) - means[0] * means[1]
    light = (2 * means[0] * means[1] + 0.01**2) / (means[0] ** 2 + means[1] ** 2 + 0.01**2)
    expected = float((light * (2 * covariance + 0.03**2) / (variances + 0.03**2)).mean())
    # Each variance is a difference of numbers near 1, rounded at 2^-53, over 0.03^2.
    assert ssim(test, reference) == pytest.approx(expected, abs=2**-53 * 16 / 0.03**2)
    assert ssim(test, reference) < 1


@pytest.mark.parametrize("metric", METRICS.values(), ids=list(METRICS))
def test_identical_images_and_growing_noise(metric: Any) -> None:
    reference = picture()
    perfect = measure(reference, reference, [metric])[metric.name]
    assert perfect == {"ssim": 1.0}.get(metric.name, math.inf if metric.higher_is_better else 0.0)
    values = [measure(noisy(reference, sigma), reference, [metric])[metric.name] for sigma in (0.01, 0.03, 0.1)]
    assert sorted(values, reverse=metric.higher_is_better) == values
    assert len(set(values)) == 3


def test_flip_is_the_published_one() -> None:
    """Black against white is FLIP's largest error: its colour difference is normalised to about 1 there."""
    black, white = np.zeros((16, 16, 3), np.float32), np.ones((16, 16, 3), np.float32)
    assert flip_map(black, white).mean() == pytest.approx(0.97, abs=0.03)


def test_flip_hdr_sees_what_the_display_does_not() -> None:
    reference = 8 * picture() + 2  # all above white
    test = np.maximum(noisy(reference, 1.0), 1.01)
    assert flip_map(test, reference).max() == 0
    assert flip_map(test, reference, hdr=True).mean() > 0.01


def test_flip_hdr_survives_any_brightness() -> None:
    """The module ends the whole program where its range of exposures is upside down; that must not happen."""
    images = {"flat": np.ones((12, 12, 3), np.float32), "point": np.zeros((12, 12, 3), np.float32), "real": picture()}
    for name, image in images.items():
        for value in [0.0, 1e-30, 1e-7, 1e-3, 1.0, 1e4, 1e30]:
            reference = image * np.float32(value)
            reference[5, 5] = value
            error = flip_map(reference * np.float32(0.5), reference, hdr=True)
            assert np.isfinite(error).all(), (name, value)


def test_arguments_that_are_not_contiguous() -> None:
    planar = np.moveaxis(np.ascontiguousarray(np.moveaxis(picture(), -1, 0)), 0, -1)
    test = noisy(picture(), 0.1)
    assert not planar.flags.c_contiguous
    assert measure(test[::-1], planar[::-1], METRICS.values()) == measure(
        test[::-1].copy(), picture()[::-1].copy(), METRICS.values()
    )


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("which", ["image", "reference"])
def test_not_finite_is_refused_with_its_place(bad: float, which: str) -> None:
    images = {"image": picture(), "reference": picture()}
    images[which][2, 3, 1] = bad
    with pytest.raises(DataError, match=f"frame 7: NaN or infinity in 1 value of the {which}"):
        measure(images["image"], images["reference"], frame=7)


def test_sizes_that_differ_and_images_too_small() -> None:
    with pytest.raises(DataError, match="differ in size"):
        measure(picture(), picture(size=(24, 31)))
    small = picture(size=(10, 40))
    with pytest.raises(
        DataError, match=r"too small for SSIM.*found .*judge by other metrics, as mse,psnr,flip, or larger"
    ):
        measure(small, small, [METRICS["ssim"]])


@pytest.mark.parametrize(("name", "package"), [("ssim", "skimage"), ("flip", "flip_evaluator")])
def test_missing_extra_says_what_to_install(name: str, package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def refuse(module: str, *arguments: Any, **named: Any) -> Any:
        if module.split(".")[0] == package:
            raise ModuleNotFoundError(f"No module named {module!r}")
        return real(module, *arguments, **named)

    def import_module(module: str) -> Any:
        return refuse(module)

    monkeypatch.setattr("importlib.import_module", import_module)
    with pytest.raises(UsageError, match=r"pip install 'cltaa\[metrics\]'"):
        measure(picture(), picture(), [METRICS[name]])


def test_metrics_are_parsed_from_a_list() -> None:
    assert [metric.name for metric in parse_metrics("flip, psnr,flip")] == ["flip", "psnr"]
    assert [metric.name for metric in parse_metrics("all")] == list(METRICS)
    for text in ("psnr,vmaf", "", ","):
        with pytest.raises(UsageError, match="metric"):
            parse_metrics(text)


def test_psnr_is_averaged_by_its_squared_error() -> None:
    rows = [{"mse": 0.01, "psnr": 20.0}, {"mse": 0.03, "psnr": math.inf}]
    result = mean(rows)
    assert result["mse"] == pytest.approx(0.02, rel=1e-15)
    assert result["psnr"] == pytest.approx(10 * math.log10(2 / 0.01), abs=1e-12)  # of the mean of 0.01 and 0
    assert mean([{"psnr": math.inf}]) == {"psnr": math.inf}
    assert mean([]) == {}


def test_flips_threads_do_not_spin() -> None:
    code = (
        "from cltaa.process import configure\n"
        "configure()\n"
        "import os, sys, numpy as np\n"
        "from cltaa.lab.judge.metrics import flip_map\n"
        "assert 'flip_evaluator' not in sys.modules\n"
        "flip_map(np.zeros((8, 8, 3), np.float32), np.ones((8, 8, 3), np.float32))\n"
        "print(os.environ['OMP_WAIT_POLICY'])"
    )
    plain = {name: value for name, value in os.environ.items() if name != "OMP_WAIT_POLICY"}
    for given, expected in ((plain, "passive"), ({**plain, "OMP_WAIT_POLICY": "active"}, "active")):
        child = subprocess.run([sys.executable, "-c", code], env=given, capture_output=True, text=True, check=True)
        assert child.stdout.split() == [expected]


@pytest.mark.parametrize(
    ("module", "arguments"),
    [
        ("flip_evaluator", ["compare", "SEQ"]),
        ("skimage.metrics", ["compare", "SEQ"]),
        ("scipy.ndimage", ["compare", "SEQ", "--metrics", "mse", "--video"]),
        ("flip_evaluator", ["bench", "accuracy", "SEQ", "-o", "OUT"]),
        ("flip_evaluator", ["bench", "quality", "--sequence", "SEQ", "--work", "OUT"]),
        ("scipy.ndimage", ["bench", "quality", "--sequence", "SEQ", "--work", "OUT"]),
        ("flip_evaluator", ["tune", "SEQ", "--target", "flip=0.02", "-o", "OUT"]),
        ("flip_evaluator", ["demo", "-o", "OUT"]),
        ("av", ["demo", "-o", "OUT"]),
    ],
)
def test_what_is_missing_is_reported_before_the_work(
    module: str,
    arguments: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    write_sequence(tmp_path / "SEQ", reference=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, module, None)
    assert main(arguments) == 64
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "pip install 'cltaa[" in message
    assert not (tmp_path / "OUT").exists()


@pytest.mark.parametrize("image", [np.zeros((16, 16, 3), np.uint8), np.zeros((16, 16), np.float32)])
def test_bytes_and_greys_are_no_linear_light(image: np.ndarray) -> None:
    with pytest.raises(DataError, match=r"the image is no linear light \(expected floats \[H, W, 3\]"):
        measure(image, image)
