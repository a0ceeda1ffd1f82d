"""Matrices and jitter from a file beside the frames: exact in each format, and refused where damaged."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from cltaa.errors import DataError
from cltaa.inputs.side_file import read_side_file
from tests.inputs.foreign import frames, side_text


def test_side_files_hold_exact_doubles_in_each_format(tmp_path: Path) -> None:
    made = frames()
    text = tmp_path / "camera.txt"
    text.write_text(side_text(made))
    content = {
        str(f.index): {
            "world_to_view": f.camera.world_to_view.tolist(), "view_to_clip": f.camera.view_to_clip.tolist(),
            "jitter_px": f.jitter_px,
        }
        for f in made
    }  # fmt: skip
    (tmp_path / "camera.json").write_text(json.dumps({"frames": content}))
    with (tmp_path / "camera.csv").open("w") as file:
        writer = csv.writer(file)
        names = [
            f"{key}.{n}"
            for key, count in (("world_to_view", 16), ("view_to_clip", 16), ("jitter_px", 2))
            for n in range(count)
        ]
        writer.writerow(["frame", *names])
        for f in made:
            writer.writerow([f.index, *f.camera.world_to_view.ravel(), *f.camera.view_to_clip.ravel(), *f.jitter_px])
    for name in ("camera.txt", "camera.json", "camera.csv"):
        side = read_side_file(tmp_path / name)
        for frame in made:
            found = side[frame.index]
            assert found.world_to_view is not None
            assert found.view_to_clip is not None
            np.testing.assert_array_equal(found.world_to_view, frame.camera.world_to_view)
            np.testing.assert_array_equal(found.view_to_clip, frame.camera.view_to_clip)
            assert found.jitter_px == frame.jitter_px


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.json", "{"), ("a.json", "[]"), ("a.json", '{"frames": {"1": {"jitter_px": [1]}}}'), ("a.csv", "a,b\n1,2\n"),
        ("a.txt", "world_to_view 1"), ("a.txt", "frame 1\njitter_px x y"), ("a.txt", "frame 1\nnear 1"), ("a.txt", ""),
    ],
)  # fmt: skip
def test_damaged_side_files(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(DataError, match=name):
        read_side_file(tmp_path / name)
