"""The times of calls from a program: every way is timed, on what it says, and what cannot be timed is refused."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pyopencl as cl
import pytest
from click.testing import CliRunner

from cltaa.cli import root
from cltaa.core import resolver
from cltaa.core.frame_checks import check_frame
from cltaa.core.planes import checked_out
from cltaa.core.presets import load_preset
from cltaa.errors import UsageError
from cltaa.frame import Frame
from cltaa.lab.bench.api import CALLS, bench_api
from cltaa.opencl.exchange import PlainCopies
from cltaa.opencl.launcher import DeviceLauncher
from tests.sequence_factory import make_frame

WAYS = ("kernels", "device_arrays", "host_arrays", "pinned_arrays", "copies", "pinned_copies")


def test_each_way_is_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    """In each of three rounds, and once before them, ``CALLS`` calls of each way; two are with arrays of the device.

    Each call gives its image in an array of its own kind.
    """
    kinds, given = list[str](), list[str]()

    def noted(frame: Frame, told: bool) -> bool:
        kinds.append(type(frame.colour).__name__)
        return check_frame(frame, told)

    def noted_out(out: Any, frame: Frame, *, half: bool) -> Any:
        given.append(type(out).__name__)
        return checked_out(out, frame, half=half)

    monkeypatch.setattr(resolver, "check_frame", noted)
    monkeypatch.setattr(resolver, "checked_out", noted_out)
    done = CliRunner().invoke(root, ["bench", "api", "--size", "32x18", "--rounds", "3", "--json"])
    assert done.exit_code == 0, done.output
    (row,) = json.loads(done.stdout)["rows"]
    assert (row["width"], row["height"], row["bytes"]) == (32, 18, 32 * 18 * 4 * 7)
    assert all(row[way]["median"] > 0 for way in WAYS)
    assert (kinds.count("Array"), kinds.count("ndarray")) == (2 * 4 * CALLS, 2 * 4 * CALLS)
    assert given == kinds
    assert done.stderr.startswith("timing 32 x 18: 3 of 3 rounds, ")


def test_commands_are_timed_only_where_it_is_asked_for() -> None:
    launcher, timed = DeviceLauncher(), cl.command_queue_properties.PROFILING_ENABLE
    assert not launcher.device.queue.properties & timed
    resolver.Resolver(load_preset(), launcher).resolve(make_frame(0))
    events = launcher.timed(lambda: resolver.Resolver(load_preset(), launcher).resolve(make_frame(0)))
    assert launcher.device.queue.properties & timed
    assert [name for name, _ in events] == ["unpack", "unpack", "resolve", "pack"]
    assert all(event.profile.end > event.profile.start for _, event in events)


@pytest.mark.parametrize("pinned", [False, True])
def test_plain_copies_are_there(pinned: bool) -> None:
    device, array, result = DeviceLauncher().device, np.arange(12, dtype=np.float32), np.ones(7, np.float32)
    copies = PlainCopies(device, [array], result, pinned=pinned)
    cl.enqueue_copy(device.queue, copies._back, 5 * result)
    copies.run()
    there = np.empty_like(array)
    cl.enqueue_copy(device.queue, there, copies._there[0])
    assert np.array_equal(there, array)
    assert (copies._result.view(np.float32) == 5).all()
    assert pinned or copies._result is result


def test_what_cannot_be_timed_is_refused() -> None:
    with pytest.raises(UsageError, match="this needs an OpenCL device, which numpy is not"):
        bench_api(load_preset(), "numpy", ((64, 36),), rounds=3)
    with pytest.raises(UsageError, match="looks ahead, so no call gives an image"):
        root.main(["bench", "api", "--preset", "gather-8+8"], standalone_mode=False)
