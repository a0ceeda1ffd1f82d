"""The report of an accuracy measurement: one HTML file with everything in it, that needs no network and no server."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from importlib import resources
from io import BytesIO
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from PIL import Image as Pillow

from cltaa.camera import inverse_depth
from cltaa.frame import Frame, Image
from cltaa.io.display import to_picture
from cltaa.io.png import heat
from cltaa.lab.bench.accuracy.results import Accuracy
from cltaa.lab.bench.accuracy.tasks import load
from cltaa.lab.bench.accuracy.variants import COUNT_WHITE, Task, png
from cltaa.lab.judge.comparison import truth_of
from cltaa.lab.judge.metrics import METRICS

_FOLDER = resources.files("cltaa") / "lab" / "bench" / "accuracy" / "page"


def page(result: Accuracy, tasks: Sequence[Task], output: Path, pictured: int | None = None) -> str:
    """The report as HTML; ``tasks`` are those of the measurement, whose results lie in ``output``.

    ``pictured`` sequences, the first ones, have their frames in it; None: all.
    """
    data = {
        "accuracy": msgspec.to_builtins(result),
        "higher_is_better": [metric.name for metric in METRICS.values() if metric.higher_is_better],
        "count_white": COUNT_WHITE,
        "pictures": {
            measured.name: _pictures([task for task in tasks if Path(task.sequence) == Path(measured.folder)], output)
            for measured in result.sequences[:pictured]
        },
    }
    text = msgspec.json.encode(data).decode().replace("<", "\\u003c")  # nothing in it may end the script
    parts = {"STYLE": _read("page.css"), "SCRIPT": _read("page.js"), "DATA": text}
    html = _read("page.html")
    for name, part in parts.items():
        html = html.replace(f"/*{name}*/", part)
    return html


def _read(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


def _pictures(tasks: Sequence[Task], output: Path) -> dict[str, Any]:
    """Data addresses of what can be looked at of one sequence, all of its last frame."""
    sequence = tasks[0].open()
    (frame,) = sequence.select(sequence.last, sequence.last)
    truth = to_picture(truth_of(sequence).image(sequence.last))
    variants = {}
    for task in tasks:
        found = load(task, output)
        assert found is not None
        variants[task.variant.name] = {name: _address(picture) for name, picture in found.pictures.items()}
    return {
        "inputs": {
            "truth": {"picture": _address(png(truth))},
            "one sample": {"picture": _address(png(to_picture(frame.colour)))},
        },
        "variants": variants,
        "debug": {title: _address(picture) for title, picture in _debug_views(frame).items()},
    }


def _debug_views(frame: Frame) -> Mapping[str, bytes]:
    """What the resolve reads beside colour."""
    near = np.empty(frame.depth.shape, np.float32)
    inverse_depth(frame.depth, frame.camera, out=near)
    low, high = float(near.min()), float(near.max())
    views = {"inverse depth (bright is near)": png(heat(near - np.float32(low), max(high - low, 1e-30)))}
    if frame.motion is not None:
        length: Image = np.nan_to_num(np.hypot(frame.motion[..., 0], frame.motion[..., 1]), nan=0.0)
        longest = float(length.max())
        views[f"own motion (white: {longest:.3g} px)"] = png(heat(length, max(longest, 1e-30)))
    if frame.reactive is not None:
        views["reactive"] = png(heat(frame.reactive))
    return views


def _address(picture: bytes) -> str:
    """A PNG as a data address, packed as lossless WebP, which is about a third smaller."""
    stream = BytesIO()
    Pillow.open(BytesIO(picture)).convert("RGB").save(stream, format="WEBP", lossless=True, method=4)
    return f"data:image/webp;base64,{base64.b64encode(stream.getvalue()).decode()}"
