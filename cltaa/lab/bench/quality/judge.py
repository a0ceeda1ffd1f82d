"""Presets judged against the truth in one pass over a sequence; finished cells of the table stay on disk."""

from __future__ import annotations

import hashlib
import math
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, TypeVar

import msgspec
import numpy as np

from cltaa.core.backend import Launcher
from cltaa.core.kernel_source import code_sha256
from cltaa.core.presets import Preset
from cltaa.core.resolver import Resolver
from cltaa.errors import DataError
from cltaa.frame import Frame, Image
from cltaa.io.atomic import atomic_path, make_folder
from cltaa.io.display import shown_light, to_display
from cltaa.io.sequence import FrameSequence, ImageSequence
from cltaa.io.streams import read_ahead
from cltaa.lab.bench.quality.cases import redrawn_of
from cltaa.lab.judge.comparison import content_sha256, truth_of, truth_samples
from cltaa.lab.judge.correspondence import Mask
from cltaa.lab.judge.metrics import (
    METRICS,
    Measure,
    display_flip,
    display_ssim,
    equal_quality_samples,
    finite,
    mean,
    mse,
    named_metrics,
    psnr,
)
from cltaa.lab.judge.video_scores import SCORES, Sums, VideoScores, import_ndimage
from cltaa.progress import track

Item = TypeVar("Item")

ONE_SAMPLE = "one sample"  # what was captured, judged beside its resolves
LEAST_FRESH = 100  # disoccluded pixels for a score: with fewer, single samples at other places score 0.3 to 7


COLUMNS = (
    *(METRICS[name] for name in ("psnr", "ssim", "flip")),
    Measure("samples", "equal-quality samples a pixel, mean of the judged frames", ".1f", True),
    Measure("last", "the same in the last frame", ".1f", True),
    Measure("disoccluded", "the same over pixels in the frame in which they appear", ".2f", True),
    *SCORES,
)
ALPHA = Measure("alpha", "root mean square error of alpha")


class Judged(msgspec.Struct, kw_only=True):
    """What a preset scored on a sequence; None where there was nothing to judge."""

    scores: dict[str, float | None]
    frames: int
    not_finite: int  # values of the output that were NaN or infinite, and judged as 0
    device: str


class _Shown(NamedTuple):
    """An image as far as a screen can show it: what every score looks at, worked out once."""

    light: Image  # linear, in [0, 1]
    display: Image  # encoded

    @classmethod
    def of(cls, image: Image) -> _Shown:
        light = shown_light(image)
        return cls(light, to_display(light))

    @classmethod
    def of_each(cls, images: Sequence[Image]) -> list[_Shown]:
        """What is shown of every image; images of the same bits share one, so that they are judged once."""
        different: dict[bytes, Image] = {}
        kept = [different.setdefault(image.tobytes(), image) for image in images]
        shown = {id(image): cls.of(image) for image in different.values()}
        return [shown[id(image)] for image in kept]


class _FrameScores(NamedTuple):
    """What one frame scores by itself."""

    row: dict[str, float]
    flip: float | None  # None where it is not judged by FLIP
    fresh_square: float  # error of the pixels that appeared in it
    fresh_count: int

    @classmethod
    def of(cls, image: _Shown, truth: _Shown, fresh: Mask, *, flip: bool) -> _FrameScores:
        row = {
            "mse": mse(image.light, truth.light),
            "psnr": psnr(mse(image.display, truth.display)),
            "ssim": display_ssim(image.display, truth.display),
        }
        error = float(display_flip(image.display, truth.display).mean()) if flip else None
        return cls(row, error, _square(image, truth, fresh), 3 * int(fresh.sum()))


@dataclass(slots=True)
class _ScoreSums:
    """What is gathered of one contender."""

    rows: list[dict[str, float]] = field(default_factory=list)
    flip: list[float] = field(default_factory=list)
    video: Sums = field(default_factory=Sums)
    fresh_square: float = 0.0
    fresh_count: int = 0
    not_finite: int = 0
    alpha: list[float] = field(default_factory=list)  # mean squared errors, where both sides have it

    def repaired(self, image: Image) -> Image:
        """The image with 0 for what is not finite, which is counted."""
        finite = np.isfinite(image)
        bad = image.size - int(finite.sum())
        self.not_finite += bad
        return np.where(finite, image, np.float32(0)) if bad else image

    def add(self, marks: _FrameScores, sums: Sums) -> None:
        """Count one frame."""
        self.rows.append(marks.row)
        if marks.flip is not None:
            self.flip.append(marks.flip)
        self.video += sums
        self.fresh_square += marks.fresh_square
        self.fresh_count += marks.fresh_count

    def scores(self, one: _ScoreSums, redrawn_square: float, truth_samples: int | None) -> dict[str, float | None]:
        """All scores, with the single samples as the currency of two of them.

        Where pixels appear it is those of ``redrawn_of``, which err by ``redrawn_square`` there: that the captured
        samples show what has appeared is why these pixels are the ones, so that they are nearer to the truth than
        samples are by chance.
        """
        means, single = mean(self.rows), mean(one.rows)["mse"]

        def samples(error: float, of_one: float) -> float:
            return equal_quality_samples(error, of_one, truth_samples=truth_samples) if of_one > 0 else math.nan

        enough = one.fresh_count >= 3 * LEAST_FRESH
        fresh = redrawn_square / one.fresh_count if enough else 0.0
        values = {
            "psnr": means["psnr"],
            "ssim": means["ssim"],
            "flip": math.fsum(self.flip) / len(self.flip),
            "samples": samples(means["mse"], single),
            "last": samples(self.rows[-1]["mse"], single),
            "disoccluded": samples(self.fresh_square / self.fresh_count, fresh) if enough else math.nan,
            **self.video.scores(),
            ALPHA.name: math.sqrt(math.fsum(self.alpha) / len(self.alpha)) if self.alpha else math.nan,
        }
        return {name: value if math.isfinite(value) else None for name, value in values.items()}


def import_judges() -> None:
    """Import the libraries that judge; raises UsageError where one is missing."""
    named_metrics(("ssim", "flip"))
    import_ndimage()


def check_judged(sequence: FrameSequence, settled: int) -> ImageSequence:
    """The truth of a sequence that can be judged; raises InputMissing without one, DataError for too few frames."""
    reference = truth_of(sequence)
    if len(sequence) <= settled:
        raise DataError(
            "the sequence is over before it is judged",
            path=sequence.folder,
            expected=f"more than {settled} frames",
            found=len(sequence),
            cure="capture more, or judge sooner: --settled 0",
        )
    return reference


def judge_sequence(
    sequence: FrameSequence, presets: Sequence[Preset], launcher: Launcher, *, settled: int = 8, flip_every: int = 4
) -> dict[str, Judged]:
    """Resolve ``sequence`` with every preset and judge each, and the single samples, from frame ``settled`` on.

    Disoccluded pixels are told in equal-quality samples where the sequence's folder holds ``again`` and enough of them
    are there. FLIP, which takes longer than all else, judges the last frame and every ``flip_every``-th before it. The
    history of every preset is in memory at once. Raises InputMissing for a sequence without its truth and DataError
    for one that is over before it settles.
    """
    reference = check_judged(sequence, settled)
    redrawn, redrawn_square = redrawn_of(sequence), 0.0
    resolvers = {preset.name: Resolver(preset, launcher) for preset in presets}
    tallies = {name: _ScoreSums() for name in (ONE_SAMPLE, *resolvers)}
    video = VideoScores(len(tallies))
    given = ((place, frame, reference.image(frame.index, alpha=True)) for place, frame in enumerate(sequence))
    with read_ahead(given) as read:
        tracked = track(read, len(sequence), f"judging {sequence.folder.name}")
        for (place, frame, truth), resolved in in_step(resolvers.values(), tracked, lambda given: given[1]):
            outputs = [frame.colour, *(image[..., :3] for image in resolved)]
            repaired = [tally.repaired(image) for tally, image in zip(tallies.values(), outputs, strict=True)]
            shown, images = _Shown.of(truth[..., :3]), _Shown.of_each(repaired)
            judged = place >= settled
            sums = video.add_shown(frame, shown.display, [image.display for image in images], judged=judged)
            if judged:
                flip = (len(sequence) - 1 - place) % flip_every == 0
                different = {id(image): image for image in images}
                marks = {key: _FrameScores.of(image, shown, video.fresh, flip=flip) for key, image in different.items()}
                for tally, image, score in zip(tallies.values(), images, sums, strict=True):
                    tally.add(marks[id(image)], score)
                if frame.alpha is not None and truth.shape[2] == 4:
                    alphas = [finite(frame.alpha), *(image[..., 3] for image in resolved)]
                    for tally, alpha in zip(tallies.values(), alphas, strict=True):
                        tally.alpha.append(mse(alpha, truth[..., 3]))
                if redrawn is not None and video.fresh.any():
                    other = _Shown.of(redrawn.image(frame.index))
                    redrawn_square += _square(other, shown, video.fresh)
    return _judged(tallies, redrawn_square, truth_samples(reference), len(sequence), launcher.description)


def in_step(
    resolvers: Collection[Resolver], items: Iterable[Item], frame_of: Callable[[Item], Frame]
) -> Iterator[tuple[Item, list[Image]]]:
    """Each of ``items``, of which ``frame_of`` is resolved, with the images of all resolvers, once the last one that
    looks ahead has its own."""
    waiting, ready = deque[Item](), [deque[Image]() for _ in resolvers]

    def done() -> Iterator[tuple[Item, list[Image]]]:
        while waiting and all(ready):
            yield waiting.popleft(), [images.popleft() for images in ready]

    for item in items:
        waiting.append(item)
        for images, resolver in zip(ready, resolvers, strict=True):
            images.extend(resolver.feed(frame_of(item)))
        yield from done()
    for images, resolver in zip(ready, resolvers, strict=True):
        images.extend(resolver.flush())
    yield from done()


def _square(image: _Shown, truth: _Shown, where: Mask) -> float:
    """Squared differences of linear light, summed over some pixels and the channels."""
    return float(((image.light[where].astype(np.float64) - truth.light[where]) ** 2).sum())


def _judged(
    tallies: Mapping[str, _ScoreSums], redrawn_square: float, samples: int | None, frames: int, device: str
) -> dict[str, Judged]:
    one = tallies[ONE_SAMPLE]
    return {
        name: Judged(
            scores=tally.scores(one, redrawn_square, samples), frames=frames, not_finite=tally.not_finite, device=device
        )
        for name, tally in tallies.items()
    }


FORMAT = 2  # of the file and of the way to judge


class Cell(msgspec.Struct, kw_only=True):
    """One cell: what was judged, by which code, and the outcome."""

    inputs: str  # SHA-256 over sequence and how it is read, truth, REDRAWN, preset, judged frames and FORMAT
    code: str  # of the kernels and the package
    judged: Judged


class Cells:
    """The cells of one sequence in ``folder``. With ``any_code`` those of other versions of the code are taken too."""

    def __init__(
        self, folder: Path, sequence: FrameSequence, settled: int, flip_every: int, *, any_code: bool = False
    ) -> None:
        self._folder, self._any_code = make_folder(folder), any_code
        redrawn = redrawn_of(sequence)
        files = content_sha256(sequence, [] if redrawn is None else [redrawn])
        # A step of 1 goes unsaid, so that cells of before it was known still count.
        step = "" if sequence.step == 1 else f" step {sequence.step}"
        self._base = f"{FORMAT} {settled} {flip_every} {files}{step}"

    def get(self, name: str, preset: Preset | None) -> Judged | None:
        """The cell of a preset (None: of the single samples), or None where it must be measured."""
        try:
            cell = msgspec.json.decode(self._path(name).read_bytes(), type=Cell)
        except (OSError, msgspec.MsgspecError):
            return None
        same_code = self._any_code or cell.code == code_sha256()
        return cell.judged if same_code and cell.inputs == self._inputs(preset) else None

    def put(self, name: str, preset: Preset | None, judged: Judged) -> None:
        """Keep a cell; raises StorageError where it cannot be written."""
        cell = Cell(inputs=self._inputs(preset), code=code_sha256(), judged=judged)
        with atomic_path(self._path(name)) as temporary:
            temporary.write_bytes(msgspec.json.format(msgspec.json.encode(cell), indent=1))

    def _path(self, name: str) -> Path:
        return self._folder / f"{name.replace(' ', '-')}.json"

    def _inputs(self, preset: Preset | None) -> str:
        what = b"" if preset is None else msgspec.json.encode([preset.choices, preset.settings])
        if preset is not None and preset.published:  # else it goes unsaid, as a step of 1 does
            what += b" published"
        return hashlib.sha256(self._base.encode() + what).hexdigest()
