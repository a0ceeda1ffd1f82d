"""Kernels are started without the interpreter, to the same result, and what is wrong with a call is still told."""

from __future__ import annotations

import numpy as np
import pytest

from cltaa.devices import program
from cltaa.devices.device_launcher import DeviceLauncher
from cltaa.errors import InternalError
from cltaa.memory.layout import Layout
from cltaa.parameters.build import FRAME_DTYPE, Build
from cltaa.resolve.resolver import Resolver
from tests.sequence_factory import bits, make_frame


def test_the_function_is_found() -> None:
    assert program._enqueue() is not None


def test_without_it_results_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = [make_frame(index) for index in range(2)]
    found = [Resolver().resolve(frame) for frame in frames]
    monkeypatch.setattr(program, "_enqueue", lambda: None)
    for frame, image in zip(frames, found, strict=True):
        np.testing.assert_array_equal(bits(Resolver().resolve(frame)), bits(image))


@pytest.mark.parametrize("found", [True, False])
def test_a_wrong_call_is_told(found: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    launcher, layout = DeviceLauncher(), Layout(16, 8)
    if not found:
        monkeypatch.setattr(program, "_enqueue", lambda: None)
    monkeypatch.setattr(DeviceLauncher, "_range", lambda *_: ((16, 8), (3, 8)))  # no multiple of its group
    memory = launcher.allocate((1, layout.rows, layout.stride))
    given = {"image": memory, "floats": memory, "planes": 1, "more": 0, "frame": np.zeros((), FRAME_DTYPE)}
    with pytest.raises(InternalError, match="refused a call: clEnqueueNDRangeKernel"):
        launcher.run("extend_edges", launcher.build(Build()), layout, given)
