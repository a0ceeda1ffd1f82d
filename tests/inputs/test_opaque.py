"""Alpha that is 1 everywhere: told with the option that does without, which gives the same colours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.inputs.intake import OPAQUE
from cltaa.io.exr_read import read_image
from cltaa.io.exr_write import write_image
from cltaa.lab.check.report import check_folder
from cltaa.lab.inspect.findings import describe_input
from tests.inputs.foreign import frames


def shot(folder: Path, last: float) -> Path:
    """Three opaque frames but for one pixel of the last."""
    folder.mkdir()
    for frame in frames(3):
        planes = {name: np.ascontiguousarray(frame.colour[..., at]) for at, name in enumerate("RGB")}
        alpha = np.ones_like(frame.depth)
        alpha[3, 4] = last if frame.index == 2 else 1.0
        write_image(folder / f"a.{frame.index:04d}.exr", planes | {"A": alpha, "Z": frame.depth})
    return folder


@pytest.mark.parametrize(("last", "told"), [(1.0, True), (0.5, False)])
def test_alpha_that_is_1_everywhere_is_reported(
    last: float, told: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shot(tmp_path / "in", last)
    assert main(["resolve", str(folder), "-o", str(tmp_path / "out"), "--device", "numpy"]) == 0
    assert ("alpha is 1 everywhere" in capsys.readouterr().out) == told
    assert (OPAQUE in describe_input(folder, profile="auto", pixels=True).notes) == told
    assert OPAQUE not in describe_input(folder, profile="auto").notes
    assert ("alpha-opaque" in [finding.name for finding in check_folder(folder)[0].findings]) == told


def test_without_it_the_colours_are_the_same(tmp_path: Path) -> None:
    folder = shot(tmp_path / "in", 1.0)
    for name, options in (("with", []), ("without", ["--input", "colour.alpha=none"])):
        assert main(["resolve", str(folder), "-o", str(tmp_path / name), "--device", "numpy", *options]) == 0
    for number in range(3):
        here, without = (read_image(tmp_path / name / f"a.{number:04d}.exr")[0] for name in ("with", "without"))
        assert here.keys() == without.keys()  # the layer A of the input is kept
        for name, plane in here.items():
            np.testing.assert_array_equal(plane, without[name], err_msg=name)
        assert (here["A"] == 1.0).all()
