"""Arguments of wrong kinds from a program: one line of cltaa's own that says what was expected."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cltaa as public
from cltaa.errors import CltaaError
from tests.sequence_factory import make_frame, write_sequence

cltaa: Any = public  # whose types forbid what is tried here
LIGHT = np.ones((8, 8, 3), np.float32)
CALLS: dict[str, tuple[Callable[[Any], object], str]] = {
    "open nothing": (lambda _: cltaa.open(None), "no sequence is named .*found None"),
    "open a number": (lambda _: cltaa.inspect(3), "no sequence is named"),
    "frames as text": (lambda seq: cltaa.open(seq, frames="0-1"), "frames that are no range .*found '0-1'"),
    "effects as a word": (lambda seq: cltaa.open(seq, effects="magic"), "no such declaration of effects"),
    "a frame beyond": (lambda seq: cltaa.open(seq).frame(9), r"frame 9: no such frame \(expected 0-1\)"),
    "a frame by text": (lambda seq: cltaa.open(seq).frame("0"), "no such frame"),
    "a preset of None": (lambda _: cltaa.load_preset(None), "a preset is named by text"),
    "no frames": (lambda seq: cltaa.check(seq, frames=0), "no frames to check"),
    "measure files": (lambda seq: cltaa.measure(seq, seq), "no image to measure"),
    "a metric's name": (lambda _: cltaa.measure(LIGHT, LIGHT, ["nope"]), "unknown metric nope"),
    "a plan of nothing": (lambda _: cltaa.plan("nowhere"), "nowhere: the folder is missing"),
    "a plan of no denoiser": (lambda seq: cltaa.plan(seq, denoise="optix"), "no such denoiser .*found 'optix'"),
    "no checkpoint": (lambda seq: cltaa.resolve(seq, "out", checkpoint_every=0), "a checkpoint every so many frames"),
    "preview by text": (lambda seq: cltaa.resolve(seq, "out", preview="x.gif"), "a film is an MP4"),
    "no comparison": (lambda seq: cltaa.resolve(seq, "out", compare="diagonal"), "no such comparison"),
    "a PNG": (lambda _: cltaa.write_frame("x.png", make_frame()), "x.png: frames are written as EXR"),
    "a number for a path": (lambda _: cltaa.write_frame(3, make_frame()), "no frame to write .*found int, Frame"),
    "a frame of None": (lambda _: cltaa.write_frame("x.0000.exr", None), "found str, NoneType"),
    "resolve nothing": (lambda _: cltaa.resolve(None, "out"), "no sequence is named"),
    "resolve by a preset of None": (lambda seq: cltaa.resolve(seq, "out", None), "a preset is named by text"),
    "a layer by text": (lambda seq: cltaa.resolve(seq, "out", layers="foo"), "no such channel .*found foo"),
    "no film": (lambda seq: cltaa.resolve(seq, "out", compare="side"), "comparison side is of a film"),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_wrong_use_is_told_in_one_line(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    call, line = CALLS[name]
    with pytest.raises(CltaaError, match=line) as caught:
        call(write_sequence(tmp_path / "in", 2))
    assert "\n" not in str(caught.value)


def test_metrics_are_named() -> None:
    assert cltaa.measure(LIGHT, LIGHT, ["mse"]) == {"mse": 0.0}
