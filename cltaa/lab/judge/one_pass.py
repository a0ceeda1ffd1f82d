"""Judge tests against their one truth in one pass, which decodes each file once for scores and error maps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cltaa.frame import Frame, Image
from cltaa.io.exr_layout import Part
from cltaa.io.names import name_of, number_of
from cltaa.io.numbered import ranges
from cltaa.io.sequence import FrameSequence, ImageSequence
from cltaa.io.streams import ReadAhead, Task
from cltaa.lab.judge.comparison import Comparison, truth_samples
from cltaa.lab.judge.metrics import METRICS, Metric, equal_quality, finite, flip_map, mean, measure
from cltaa.lab.judge.video_scores import SCORES, Sums, VideoScores
from cltaa.printable import printable
from cltaa.progress import track


def _write_map(folder: Path, path: Path, pair: tuple[Image, Image], stops: float, *, by_flip: bool) -> dict[str, float]:
    """Write the error map of the image at ``path`` under its name; returns the mean of FLIP, which is slow to compute.

    Raises OutputError and StorageError.
    """
    from cltaa.io.display import error_map, heat, write_png

    errors = flip_map(*pair, stops) if by_flip else error_map(*pair, stops)
    write_png(folder / f"{path.stem}.png", heat(errors))
    return {"flip": float(errors.mean())} if by_flip else {}


def stale_maps(folder: Path, images: ImageSequence) -> list[str]:
    """Return a warning about maps of earlier runs, of frames of this sequence that are not in ``images``.

    They are not deleted, because the folder may hold the user's own pictures under such names.
    """
    maps = [path for path in folder.glob("*.png") if name_of(path) == images.name]
    numbers = {number for path in maps if (number := number_of(path)) is not None}
    stale = sorted(numbers.difference(images.numbers))
    return [f"{printable(folder)}: maps of frames that are not judged now stay there: {ranges(stale)}"] if stale else []


MSE = METRICS["mse"]  # equal-quality samples need it


@dataclass(slots=True)
class Judged:
    """Results of one sequence of images."""

    metrics: list[dict[str, float]] = field(default_factory=list)  # by name, for each frame
    video: list[dict[str, float]] = field(default_factory=list)  # scores over time, for each frame, if asked for
    total: Sums | None = None  # scores over time of all frames
    alpha: dict[int, dict[str, float]] = field(default_factory=dict)  # for frames with alpha in test and truth


@dataclass(slots=True)
class Found:
    """Results of a pass: of each test, of the single samples, and the errors of the yardsticks by samples a pixel."""

    tests: list[Judged]
    one_sample: Judged | None = None  # None without a capture, or if only the capture is judged
    yardsticks: dict[int, list[float]] = field(default_factory=dict)  # MSE of each frame


class _Picture(NamedTuple):
    """A decoded file: its judged part [H, W, 3], and the whole frame if it is of the capture."""

    image: Image
    path: Path
    frame: Frame | None = None
    alpha: Image | None = None


def judge(
    comparisons: Sequence[Comparison],
    metrics: Sequence[Metric],
    stops: float,
    *,
    in_time: bool = False,
    heatmap: Path | None = None,
) -> Found:
    """Judge the tests of ``comparisons``, which share frames, region and truth; results equal those of each alone.

    ``in_time`` also scores them over time; ``heatmap`` is the folder for the maps of a single test. Keeps one frame of
    each in memory, and a few files read ahead. Raises DataError for a damaged file, with its path.
    """
    first = comparisons[0]
    others = [comparison for comparison in comparisons if not comparison.of_itself]
    found = Found([Judged() for _ in comparisons])
    if first.capture is not None and others:
        found.one_sample = Judged()
        found.yardsticks = {count: [] for count in first.yardsticks}
    video = VideoScores(len(comparisons) + (found.one_sample is not None), stops) if in_time else None
    capture = first.capture if in_time or found.one_sample is not None else None
    with ReadAhead(_reads(comparisons, capture, [*found.yardsticks])) as pictures:
        for number in track(first.test.numbers, len(first.test), "comparing"):
            _judge_frame(found, number, pictures, metrics, stops, video, sampled=capture is not None, heatmap=heatmap)
    if video is not None:
        for judged, total in zip(_judged(found), video.totals, strict=True):
            judged.total = total
    return found


def _judged(found: Found) -> list[Judged]:
    """Return the results that get scores over time, the single samples last."""
    return found.tests if found.one_sample is None else [*found.tests, found.one_sample]


def _judge_frame(
    found: Found,
    number: int,
    pictures: Iterator[_Picture],
    metrics: Sequence[Metric],
    stops: float,
    video: VideoScores | None,
    *,
    sampled: bool,
    heatmap: Path | None,
) -> None:
    """Judge one frame of each; ``pictures`` are in the order of ``_reads``."""
    truth = next(pictures)
    against = partial(_measure, truth, number, stops)
    sample = next(pictures) if sampled else None
    for errors in found.yardsticks.values():
        errors.append(against(next(pictures), [MSE])[MSE.name])
    images = []
    for judged in found.tests:
        test = next(pictures)
        judged.metrics.append(against(test, metrics, heatmap))
        judged.alpha |= _alpha(truth, test, number, stops)
        if video is not None:  # else free the image before the next one is read
            images.append(test.image)
    if sample is not None and found.one_sample is not None:
        found.one_sample.metrics.append(against(sample, metrics))
        found.one_sample.alpha |= _alpha(truth, sample, number, stops)
        images.append(sample.image)
    if video is not None and sample is not None and sample.frame is not None:
        for judged, sums in zip(_judged(found), video.add(sample.frame, truth.image, images), strict=True):
            judged.video.append(sums.scores())


def _measure(
    truth: _Picture, number: int, stops: float, test: _Picture, metrics: Sequence[Metric], heatmap: Path | None = None
) -> dict[str, float]:
    pair, flip = (test.image, truth.image), METRICS["flip"]
    others = [metric for metric in metrics if heatmap is None or metric is not flip]
    values = measure(*pair, others, stops, path=test.path, truth_path=truth.path, frame=number)
    return values if heatmap is None else values | _write_map(heatmap, test.path, pair, stops, by_flip=flip in metrics)


WHITE, GREY = 1.0, 0.18  # linear light of the backgrounds


def _alpha(truth: _Picture, test: _Picture, number: int, stops: float) -> dict[int, dict[str, float]]:
    """Return by frame number the errors of alpha, and of premultiplied colour over white and grey; the other metrics
    judge it over black.

    Empty if test or truth has no alpha.
    """
    if truth.alpha is None or test.alpha is None:
        return {}
    where: dict[str, Any] = {"path": test.path, "truth_path": truth.path, "frame": number}
    masks = np.repeat(test.alpha[..., None], 3, -1), np.repeat(truth.alpha[..., None], 3, -1)
    values = {"mse": measure(masks[0], masks[1], [METRICS["mse-linear"]], **where)["mse-linear"]}
    values["worst"] = float(np.abs(masks[0] - masks[1]).max())
    for name, ground in (("white", WHITE), ("grey", GREY)):
        one, other = (
            picture.image + (1 - mask) * np.float32(ground) for picture, mask in zip((test, truth), masks, strict=True)
        )
        values[f"psnr-{name}"] = measure(one, other, [METRICS["psnr"]], stops, **where)["psnr"]
    return {number: values}


def mean_alpha(errors: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Return the errors of alpha over frames or sequences: means, and the worst."""
    errors = list(errors)
    return mean(errors) | {"worst": max(each["worst"] for each in errors)}


def _reads(
    comparisons: Sequence[Comparison], capture: FrameSequence | None, yardsticks: Sequence[int]
) -> Iterator[Task[_Picture]]:
    """Yield the tasks that read the files: for each frame the truth, the capture's frame if any, yardsticks, tests."""
    first = comparisons[0]
    measured = [first.yardsticks[count] for count in yardsticks] + [comparison.test for comparison in comparisons]
    for number in first.test.numbers:
        yield partial(_read, first.reference, first.truth_number(number), first.part_of(first.reference))
        if capture is not None:
            yield partial(_read_sample, capture, number, first.part_of(capture))
        for images in measured:
            yield partial(_read, images, number, first.part_of(images))


def _read(images: ImageSequence, number: int, part: Part) -> _Picture:
    image = images.image(number, alpha=True)[part]
    alpha = image[..., 3] if image.shape[2] == 4 else None
    return _Picture(image[..., :3], images.path(number), alpha=alpha)


def _read_sample(capture: FrameSequence, number: int, part: Part) -> _Picture:
    frame = capture.frame(number)
    alpha = None if frame.alpha is None else finite(frame.alpha[part])
    return _Picture(finite(frame.colour[part]), capture.path(number), frame, alpha)


def summary_of(comparison: Comparison, judged: Judged, found: Found, metrics: tuple[Metric, ...]) -> dict[str, Any]:
    """Return the report of one test, beside the single samples unless the test is these."""
    single = None if comparison.of_itself else found.one_sample
    rows = [
        {"frame": number, "metrics": values}
        for number, values in zip(comparison.test.numbers, judged.metrics, strict=True)
    ]
    result: dict[str, Any] = {
        "definitions": {metric.name: metric.title for metric in metrics},
        "mean": mean(judged.metrics),
        "frames": rows,
    }
    if single is not None:
        _add(rows, "one_sample", single.metrics)
        result["mean_one_sample"] = mean(single.metrics)
        mse, one_sample_mse = (result[name]["mse"] for name in ("mean", "mean_one_sample"))
        if one_sample_mse > 0:  # undefined if one sample already has no error
            equal = equal_quality(mse, one_sample_mse, found.yardsticks, truth_samples(comparison.reference))
            result["equal_quality_samples"] = equal._asdict()
    if judged.alpha:
        for row in rows:
            row |= {"alpha": judged.alpha[row["frame"]]} if row["frame"] in judged.alpha else {}
        result["alpha"] = mean_alpha(judged.alpha.values())
        if single is not None and single.alpha:
            result["alpha_one_sample"] = mean_alpha(single.alpha.values())
    if judged.total is not None:
        _add(rows, "video", judged.video)
        result["definitions"] |= {score.name: score.title for score in SCORES}
        result["video"] = judged.total.scores()
        if single is not None and single.total is not None:
            result["video_one_sample"] = single.total.scores()
    return result


def _add(rows: list[dict[str, Any]], name: str, values: list[dict[str, float]]) -> None:
    for row, value in zip(rows, values, strict=True):
        row[name] = value
