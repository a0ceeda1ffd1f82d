"""Error maps of ``cltaa compare --heatmap``: worked out beside the metrics, and written as PNG."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from cltaa.files.names import NUMBERED
from cltaa.frames import Image
from cltaa.judging.metrics import Metric, flip_map, measure
from cltaa.printable import printable
from cltaa.sequences.frame_numbers import ranges
from cltaa.sequences.images import ImageSequence


def measure_map(
    test: Image, reference: Image, metrics: Iterable[Metric], stops: float, *, path: Path, truth_path: Path, frame: int
) -> tuple[dict[str, float], Image]:
    """Metrics of one frame by name, and its error map [H, W] in [0, 1]: FLIP's where that is among them.

    FLIP is slow, so it is not worked out twice. Raises as ``measure`` does.
    """
    from cltaa.pictures.png import error_map  # here and below: most comparisons draw none

    metrics = tuple(metrics)
    others = [metric for metric in metrics if metric.name != "flip"]
    values = measure(test, reference, others, stops, path=path, truth_path=truth_path, frame=frame)
    if len(others) == len(metrics):
        return values, error_map(test, reference, stops)
    errors = flip_map(test, reference, stops)
    values["flip"] = float(errors.mean())
    return {metric.name: values[metric.name] for metric in metrics}, errors


def write_map(folder: Path, path: Path, errors: Image) -> None:
    """Write the error map [H, W] of the image at ``path`` under its name; raises OutputError and StorageError."""
    from cltaa.pictures.png import heat, write_png

    write_png(folder / f"{path.stem}.png", heat(errors))


def stale_maps(folder: Path, images: ImageSequence) -> list[str]:
    """What to say of maps of frames of this sequence that are none of ``images``, as earlier runs leave them.

    They stay: pictures of anybody's may lie in the folder under such names.
    """
    matches = (NUMBERED.fullmatch(path.name) for path in folder.glob("*.png"))
    numbers = {int(match["number"]) for match in matches if match and match["name"] == images.name}
    stale = sorted(numbers.difference(images.numbers))
    return [f"{printable(folder)}: maps of frames that are not judged now stay there: {ranges(stale)}"] if stale else []
