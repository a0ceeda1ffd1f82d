"""Judge tests against their one truth in one pass, which decodes each file once for scores and error maps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cltaa.frame import Frame, Image
from cltaa.io.display import error_map, heat, write_png
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
    found = Found([Judged() for _ in comparisons])
    if first.capture is not None and not all(comparison.of_itself for comparison in comparisons):
        found.one_sample = Judged()
        found.yardsticks = {count: [] for count in first.yardsticks}
    capture = first.capture if in_time or found.one_sample is not None else None
    judges = _Pass(found, metrics, stops, heatmap, in_time=in_time)
    with ReadAhead(_reads(comparisons, capture, [*found.yardsticks])) as pictures:
        for number in track(first.test.numbers, len(first.test), "comparing"):
            judges.look(number, next(pictures), None if capture is None else next(pictures), pictures)
    if judges.video is not None:
        for judged, total in zip(judges.all, judges.video.totals, strict=True):
            judged.total = total
    return found


class _Pass:
    """The judges of one pass, and the results that they fill."""

    def __init__(
        self, found: Found, metrics: Sequence[Metric], stops: float, heatmap: Path | None, *, in_time: bool
    ) -> None:
        self._found, self._metrics, self._stops, self._heatmap = found, metrics, stops, heatmap
        self.all = [*found.tests, *([found.one_sample] if found.one_sample else [])]  # that get scores over time
        self.video = VideoScores(len(self.all), stops) if in_time else None

    def look(self, number: int, truth: _Picture, sample: _Picture | None, others: Iterator[_Picture]) -> None:
        """Judge one frame of each; ``others`` are the pictures of yardsticks and tests, as ``_reads`` orders them."""
        for errors in self._found.yardsticks.values():
            errors.append(self._measure(number, truth, next(others), [MSE])[MSE.name])
        images = []
        for judged in self._found.tests:
            test = next(others)
            judged.metrics.append(self._judge(number, truth, test))
            judged.alpha |= _alpha(truth, test, number, self._stops)
            if self.video is not None:  # else free the image before the next one is read
                images.append(test.image)
        single = self._found.one_sample
        if sample is not None and single is not None:
            single.metrics.append(self._measure(number, truth, sample, self._metrics))
            single.alpha |= _alpha(truth, sample, number, self._stops)
            images.append(sample.image)
        if self.video is not None and sample is not None and sample.frame is not None:
            for judged, sums in zip(self.all, self.video.add(sample.frame, truth.image, images), strict=True):
                judged.video.append(sums.scores())

    def _judge(self, number: int, truth: _Picture, test: _Picture) -> dict[str, float]:
        """Return the metrics of a test after writing its error map, if asked for; FLIP, which is slow, is made once."""
        flip = METRICS["flip"]
        if self._heatmap is None:
            return self._measure(number, truth, test, self._metrics)
        values = self._measure(number, truth, test, [metric for metric in self._metrics if metric is not flip])
        mapped = flip_map if flip in self._metrics else error_map
        errors = mapped(test.image, truth.image, self._stops)
        write_png(self._heatmap / f"{test.path.stem}.png", heat(errors))
        return values | ({"flip": float(errors.mean())} if mapped is flip_map else {})

    def _measure(self, number: int, truth: _Picture, test: _Picture, metrics: Sequence[Metric]) -> dict[str, float]:
        where: dict[str, Any] = {"path": test.path, "truth_path": truth.path, "frame": number}
        return measure(test.image, truth.image, metrics, self._stops, **where)


WHITE, GREY = 1.0, 0.18  # linear light of the backgrounds


def _alpha(truth: _Picture, test: _Picture, number: int, stops: float) -> dict[int, dict[str, float]]:
    """Return by frame number the errors of alpha, if both have it, and of premultiplied colour over white and grey."""
    if truth.alpha is None or test.alpha is None:
        return {}
    where: dict[str, Any] = {"path": test.path, "truth_path": truth.path, "frame": number}
    masks = np.repeat(test.alpha[..., None], 3, -1), np.repeat(truth.alpha[..., None], 3, -1)
    values = {"mse": measure(masks[0], masks[1], [METRICS["mse-linear"]], **where)["mse-linear"]}
    values["worst"] = float(np.abs(masks[0] - masks[1]).max())
    for name, ground in (("white", WHITE), ("grey", GREY)):
        pairs = zip((test, truth), masks, strict=True)
        one, other = (picture.image + (1 - mask) * np.float32(ground) for picture, mask in pairs)
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
    numbered = zip(comparison.test.numbers, judged.metrics, strict=True)
    rows: list[dict[str, Any]] = [{"frame": number, "metrics": values} for number, values in numbered]
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
