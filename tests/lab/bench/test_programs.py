"""``cltaa bench accuracy``: programs that are built before anything is timed, and what is timed."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.io.exr_write import write_frame
from cltaa.io.sequence import open_sequence
from cltaa.lab.bench.accuracy.tasks import Program, dearest_first, programs_needed, programs_of
from cltaa.lab.bench.accuracy.variants import enlarged, run_task
from cltaa.lab.timing import resolve_job, timed_frames
from cltaa.opencl.device import Device
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.opencl.program import source
from cltaa.opencl.shape import Shape
from tests.kernels.test_resolve import hard_frames
from tests.lab.bench.accuracy_tasks import task
from tests.sequence_factory import HEIGHT, WIDTH, bits, make_camera, make_frame, write_sequence


def built(launcher: DeviceLauncher) -> set[Program]:
    return {Program(kernel=kernel, build=build) for kernel, build in launcher._kernels}


@pytest.mark.parametrize(("one_size", "presets"), [(False, ["accumulate"]), (True, ["accumulate", "gather-48"])])
def test_what_is_built_first_is_all_that_is_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, one_size: bool, presets: list[str]
) -> None:
    shape = Shape(lanes=1, rows=5, group=(1, 1), one_size=one_size)
    monkeypatch.setattr(Device, "shape", property(lambda _: shape))
    folder = write_sequence(tmp_path / "seq", 4, reference=True, motion=one_size)
    for number in range(4):  # the camera stands from the second on: the last two frames alone do not tell that it moved
        camera = make_camera((0.1 * min(number, 1), 0.0, 5.0), WIDTH / HEIGHT)
        frame = make_frame(
            number, camera=camera, effects=frozenset(), motion=one_size, alpha=one_size, reactive=one_size
        )
        write_frame(folder / f"synthetic.{number:04d}.exr", frame)
    every = [task(folder, choices=load_preset(name).choices) for name in presets]
    planned = programs_of(every, DeviceLauncher(None), 3000)
    run = set[Program]()
    for each in every:
        launcher = DeviceLauncher(None)
        monkeypatch.setattr("cltaa.lab.bench.accuracy.variants.opened", lambda _, own=launcher: own)
        run_task(each)
        frames = [enlarged(frame, 2) for frame in timed_frames(open_sequence(folder))]
        resolve_job("timed", each.variant.resolver(launcher), frames)
        run |= built(launcher)
    assert planned == run


def test_a_program_of_many_sequences_is_built_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    one, same = (write_sequence(tmp_path / name, 3, reference=True) for name in ("one", "same"))
    moving = write_sequence(tmp_path / "moving", 3, reference=True, motion=True)
    of_two = [task(folder, place) for folder in (one, same) for place in (0, 1)]
    found: set[Program] = set()
    assert list(programs_needed(of_two, DeviceLauncher(None), None, found)) == [str(one), str(same)]
    assert found == programs_of([task(one, place) for place in (0, 1)], DeviceLauncher(None))
    assert found < found | programs_of([task(moving)], DeviceLauncher(None))
    in_order = dearest_first(found)
    assert set(in_order) == found
    lengths = [len(source(program.kernel, program.build)) for program in in_order]
    assert lengths == sorted(lengths, reverse=True)
    cache = tmp_path / "cache"
    monkeypatch.setenv("POCL_CACHE_DIR", str(cache))
    arguments = ["bench", "accuracy", str(one), str(same), "-o", str(tmp_path / "out"), "--variant", "accumulate"]
    assert main([*arguments, "--jobs", "2", "--build-only"]) == 0
    count = int(capsys.readouterr().out.split()[0])
    assert len(list((cache / "locks").iterdir())) == count
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("preset", ["gather-8", "gather-48"])
def test_what_is_timed_gathers_from_as_many_frames_as_it_keeps(preset: str) -> None:
    few = override(load_preset(preset), {"history_frames": 3})
    *_, frame, last = hard_frames(24, 14, count=5)
    _, image = resolve_job("job", Resolver(few, "numpy"), [frame, last])
    resolver = Resolver(few, "numpy")
    for ago in (3, 2, 1, 0):
        resolver.resolve(dataclasses.replace(frame, index=frame.index - ago))
    assert (bits(image) == bits(resolver.resolve(last))).all()
    fresh = Resolver(few, "numpy")
    fresh.resolve(frame)
    assert (bits(image) != bits(fresh.resolve(last))).any()


def test_what_is_timed_looks_as_far_ahead_as_it_does() -> None:
    few = override(load_preset("gather-8+8"), {"history_frames": 2, "look_ahead": 2})
    *_, frame, last = hard_frames(24, 14, count=5)
    resolver = Resolver(few, "numpy")
    job, image = resolve_job("job", resolver, [frame, last])
    before = [dataclasses.replace(frame, index=frame.index - ago) for ago in (2, 1)]
    ahead = [dataclasses.replace(last, index=last.index + later) for later in (1, 2)]
    expected = [*Resolver(few, "numpy").images([*before, frame, last, *ahead])][3]
    assert (bits(image) == bits(expected)).all()
    job.run()
    assert resolver.last is not None
    with resolver.last.arguments["output"].mapped(write=False) as planes:
        again = np.moveaxis(resolver.last.layout.inside(planes), 0, -1)
    assert (bits(again) == bits(expected)).all()


def test_an_enlarged_frame_moves_as_far_in_pictures() -> None:
    frame = make_frame(1, motion=True, alpha=True)
    large = enlarged(frame, 3)
    assert (large.width, large.height) == (3 * frame.width, 3 * frame.height)
    np.testing.assert_array_equal(large.colour[1::3, 1::3], frame.colour)
    assert large.motion is not None
    assert frame.motion is not None
    np.testing.assert_array_equal(large.motion[::3, ::3], 3 * frame.motion)
    assert large.alpha is not None
    assert large.alpha.shape == large.depth.shape
