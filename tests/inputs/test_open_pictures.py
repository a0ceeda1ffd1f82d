"""Pictures that are judged: each way to open them takes the frames that are asked for, and looks at hashes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cltaa.errors import DataError
from cltaa.inputs.foreign import open_pictures
from cltaa.io.display import to_picture, write_png
from cltaa.io.exr_write import write_image
from tests.sequence_factory import write_images

IMAGES = [np.full((4, 5, 3), 0.25 * index, np.float32) for index in range(4)]


@pytest.mark.parametrize("kind", ["exr", "png"])
def test_only_the_frames_that_are_asked_for(tmp_path: Path, kind: str) -> None:
    if kind == "exr":
        write_images(tmp_path, IMAGES, name="a")
    else:
        for index, image in enumerate(IMAGES):
            write_png(tmp_path / f"a.{index:04d}.png", to_picture(image))
    assert [*open_pictures(tmp_path).numbers] == [0, 1, 2, 3]
    assert [*open_pictures(tmp_path, frames=(1, 2)).numbers] == [1, 2]


@pytest.mark.parametrize(("assignments", "layer"), [((), ""), (("colour.encoding=srgb",), ""), ((), "beauty.")])
def test_a_picture_has_alpha_only_where_it_is_asked_for(tmp_path: Path, assignments: tuple[str], layer: str) -> None:
    """As it is, encoded, and of another tool."""
    channels = {f"{layer}{name}": np.ascontiguousarray(IMAGES[1][..., 0]) for name in "RGBA"}
    write_image(tmp_path / "a.0000.exr", channels, {})
    pictures = open_pictures(tmp_path, assignments=assignments)
    assert [each.shape[2] for each in (*pictures, pictures.image(0), pictures.image(0, alpha=True))] == [3, 3, 4]


def test_a_wrong_hash_is_refused_unless_told_otherwise(tmp_path: Path) -> None:
    write_images(tmp_path, IMAGES, name="a")
    record = {"files": {path.name: "0" * 64 for path in tmp_path.glob("*.exr")}}
    (tmp_path / "sequence.json").write_text(json.dumps(record))
    with pytest.raises(DataError, match="not what was recorded"):
        open_pictures(tmp_path).image(1)
    assert np.array_equal(open_pictures(tmp_path, verify=False).image(1), IMAGES[1])
