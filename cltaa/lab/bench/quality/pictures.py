"""Pictures of each preset's worst failure, found by its scores, magnified beside the default and the truth."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import numpy as np

from cltaa.core.backend import Launcher
from cltaa.core.presets import Preset, load_preset, preset_names
from cltaa.core.resolver import Resolver
from cltaa.frame import Image
from cltaa.io.atomic import make_folder
from cltaa.io.display import Picture, beside, error_map, to_picture, write_png
from cltaa.io.sequence import FrameSequence
from cltaa.lab.bench.cells import ONE_SAMPLE, in_step
from cltaa.lab.bench.quality.table import DEFAULT, Row, Table
from cltaa.lab.judge.video_scores import SCORES, import_ndimage
from cltaa.printable import literal
from cltaa.progress import track

SHARE = 4  # the image's height over the crop's side
ZOOM = 5
FAULTS = {score.name: score.form for score in SCORES}


class Crop(NamedTuple):
    """The same region of one frame in several images."""

    excess: float  # of the error over the default's, mean over the crop, display values
    frame: int
    images: dict[str, Image]


def write_pictures(
    table: Table,
    sequences: Mapping[str, FrameSequence],
    presets: Sequence[Preset],
    output: Path,
    page: Path | None,
    launcher: Launcher,
) -> dict[str, str]:
    """Write one PNG for each preset into ``output``, and delete outdated ones.

    Returns the Markdown of each, by preset.
    """
    make_folder(output)
    texts, stale = {}, {*preset_names(), *(preset.name for preset in presets)}
    for preset in track(presets, len(presets), "showing failures", unit="presets"):
        if preset.name != DEFAULT and all(row.presets[preset.name] == row.presets.get(DEFAULT) for row in table.rows):
            texts[preset.name] = f"The same as {DEFAULT} on every sequence."
            continue
        if preset.name != DEFAULT and not any(_worse(row, preset.name) for row in table.rows):
            texts[preset.name] = f"By FLIP worse than {DEFAULT} on no sequence."
            continue
        row = worst_row(table.rows, preset.name)
        others = [] if preset.name == DEFAULT else [load_preset(DEFAULT)]
        resolvers = {each.name: Resolver(each, launcher) for each in (preset, *others)}
        crop = max(_crops(sequences[row.key], resolvers, preset.name), key=lambda crop: crop.excess)
        path = output / f"{preset.name}.png"
        write_png(path, _magnified(crop))
        stale.remove(preset.name)
        link = os.path.relpath(path, path.parent if page is None else page.parent)
        picture = f"![{literal(preset.name)}]({quote(os.fsencode(Path(link)))})"
        texts[preset.name] = f"{caption(row, preset.name, crop.frame)}\n\n{picture}"
    for name in stale:
        (output / f"{name}.png").unlink(missing_ok=True)
    return texts


def worst_row(rows: Sequence[Row], preset: str) -> Row:
    """Return the sequence with the largest FLIP of the preset over the default's (for the default: one sample's)."""
    against = ONE_SAMPLE if preset == DEFAULT else DEFAULT

    def ratio(row: Row) -> float:
        own, other = (row.presets[name].scores["flip"] if name in row.presets else 1.0 for name in (preset, against))
        return (own or 0.0) / (other or 1e-9)

    return max(rows, key=ratio)


def _worse(row: Row, preset: str) -> bool:
    """Return whether the preset's FLIP is above the default's; True if either is unknown."""
    own, default = (row.presets[name].scores["flip"] if name in row.presets else None for name in (preset, DEFAULT))
    return own is None or default is None or own > default


def _crops(sequence: FrameSequence, resolvers: Mapping[str, Resolver], preset: str) -> Iterator[Crop]:
    """Yield, for each frame in the second half of a sequence, the region with the preset's worst excess error."""
    reference = sequence.reference
    assert reference is not None
    side = max(8, sequence.height // SHARE)
    ndimage, half = import_ndimage(), side // 2
    for (place, frame), images in in_step(resolvers.values(), enumerate(sequence), lambda given: given[1]):
        outputs = {name: image[..., :3] for name, image in zip(resolvers, images, strict=True)}
        if place < len(sequence) // 2:
            continue
        truth = reference.image(frame.index)
        excess = error_map(outputs[preset], truth)
        for name in outputs.keys() - {preset}:
            excess = excess - error_map(outputs[name], truth)
        window = ndimage.uniform_filter(excess, side)[half:-half, half:-half]
        row, column = (int(place) for place in np.unravel_index(window.argmax(), window.shape))
        area = np.s_[row : row + side, column : column + side]
        shown = {ONE_SAMPLE: frame.colour, **outputs, "truth": truth}
        yield Crop(float(window.max()), frame.index, {name: image[area].copy() for name, image in shown.items()})


def _magnified(crop: Crop) -> Picture:
    """Return the named crops side by side, magnified without interpolation."""
    large = [to_picture(image).repeat(ZOOM, axis=0).repeat(ZOOM, axis=1) for image in crop.images.values()]
    return beside(large, [*crop.images])


def caption(row: Row, preset: str, frame: int) -> str:
    """Return a caption with the preset's worst fault there, relative to the median of all presets on the sequence."""
    scores = {name: judged.scores for name, judged in row.presets.items() if name != ONE_SAMPLE}
    excess = {}
    for fault in FAULTS:
        values = [value for each in scores.values() if (value := each[fault]) is not None]
        own = scores[preset][fault]
        if own is not None and values:
            excess[fault] = own / max(float(np.median(np.abs(values))), 1e-3)
    if not excess:
        return f"{row.scene} ({row.split}), frame {frame}."
    worst = max(excess, key=lambda fault: excess[fault])
    return f"{row.scene} ({row.split}), frame {frame}: {worst} {scores[preset][worst]:{FAULTS[worst]}}."
