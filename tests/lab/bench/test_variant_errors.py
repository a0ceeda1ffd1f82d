"""``cltaa bench accuracy``: errors of the algorithm and of rounding."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cltaa.core.build import Real, Storage
from cltaa.core.presets import load_preset, preset_names
from cltaa.errors import DataError
from cltaa.io.exr_write import write_frame
from cltaa.io.sequence import open_sequence
from cltaa.lab.bench.accuracy.measurement import yardstick_errors
from cltaa.lab.bench.cells import Cell, Task, run, task_of
from cltaa.lab.bench.variants import ladder
from tests.lab.bench.accuracy_tasks import ERRORS, FRAMES, task
from tests.sequence_factory import read_frame, write_images, write_sequence


def found(task: Task) -> Cell:
    (cell,) = run(task).values()
    return cell


def test_rounding_is_that_of_the_numbers(sequence: Path) -> None:
    single = found(task(sequence)).rounding
    half = found(task(sequence, storage=Storage.HALF)).rounding
    assert single is not None
    assert half is not None
    # Half an ulp of the storage each frame, relative to the image: 2^-25 and 2^-12, and a few of them.
    assert 22.0 < single.bits < 26.5  # seen: 24.6
    assert 10.0 < half.bits < 13.5  # seen: 11.9
    assert len(single.frames) == 3
    # Doubles throughout but for the count of samples, which stays in float: what is left is its rounding, in weights.
    double = found(task(sequence, storage=Storage.DOUBLE, real=Real.DOUBLE)).rounding
    assert double is not None
    assert double.bits > single.bits + 2.0
    assert single.largest >= max(single.frames)


def test_every_rung_has_its_twin_in_double(tmp_path: Path) -> None:
    # Whatever is added to the choices or the presets must run on the ladder, in both axes. If a twin in double computed
    # anything else, floats would be further away than rounding can explain.
    folder = write_sequence(tmp_path / "seq", 2, reference=True, width=20, height=12)
    for variant in ladder(load_preset(), [load_preset(name) for name in preset_names()]):
        rounding = found(task_of(open_sequence(folder), [variant], "numpy", ERRORS)).rounding
        assert rounding is not None
        assert rounding.bits > (10.0 if variant.storage is not Storage.FLOAT else 20.0), variant.name


def test_error_is_that_against_the_truth(sequence: Path) -> None:
    cell = found(task(sequence))
    assert len(cell.errors["mse"]) == FRAMES
    assert cell.errors["mse"][0] > 0.01  # random colour against grey
    assert cell.pictures["picture"].startswith(b"RIFF")


def test_a_texel_that_a_resolve_mends_is_black_in_the_yardstick(tmp_path: Path) -> None:
    folders = write_sequence(tmp_path / "nan", 2, reference=True), write_sequence(tmp_path / "black", 2, reference=True)
    for folder, value in zip(folders, (np.nan, 0.0), strict=True):
        path = folder / "synthetic.0001.exr"
        frame = read_frame(path)
        frame.colour[5, 7] = value
        write_frame(path, frame)
    broken, black = (list(yardstick_errors(open_sequence(folder), ("mse",)).items()) for folder in folders)
    assert broken == black


def test_a_yardstick_that_is_not_finite_is_refused_by_name(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "capture", 2, reference=True)
    bad = np.full((23, 37, 3), 0.3, np.float32)
    bad[5, 7] = np.inf
    write_images(folder / "reference-2", [bad, bad], name="synthetic")
    with pytest.raises(DataError, match=r"reference-2/synthetic\.0000\.exr frame 0: NaN or infinity in 3 values"):
        yardstick_errors(open_sequence(folder), ("mse",))
