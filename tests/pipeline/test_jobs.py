"""Parts of a sequence that are resolved at the same time: the same bytes, whatever ends a run."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import cltaa
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.errors import DataError, UsageError
from cltaa.frame import Frame
from cltaa.io.exr_write import write_image
from cltaa.io.sequence import open_sequence
from cltaa.pipeline.folder import devices_of
from cltaa.pipeline.part import Parts
from cltaa.pipeline.run import resolve_sequence
from cltaa.process import Stop
from tests.sequence_factory import write_sequence

FRAMES = 11
PATIENCE = 600.0  # seconds that one job may wait for another
PRESETS = {  # rings shorter than a part, and longer
    "behind": override(load_preset("gather-8"), {"history_frames": 2}),
    "ahead": override(load_preset("gather-8"), {"history_frames": 4, "look_ahead": 2}),
}
RING_ALONE = override(PRESETS["behind"], {"recursion": "none"})


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_sequence(tmp_path_factory.mktemp("shot") / "in", FRAMES, width=19, height=9, motion=True)


class Named(NamedTuple):
    """A device by its name."""

    name: str


def contents(folder: Path) -> dict[str, bytes]:
    found = {path.name: path.read_bytes() for path in folder.glob("*.exr")}
    assert len(found) == FRAMES
    return found


@pytest.mark.parametrize("preset", PRESETS.values(), ids=PRESETS)
def test_any_number_of_jobs_writes_the_same_bytes(preset: cltaa.Preset, shot: Path, tmp_path: Path) -> None:
    expected = None
    for jobs in (1, 3, FRAMES + 2):
        report = cltaa.resolve(shot, tmp_path / str(jobs), preset, "numpy", effects="all", jobs=jobs)
        assert (report.frames, report.resolved) == (FRAMES, FRAMES)
        expected = expected or contents(tmp_path / "1")
        assert contents(tmp_path / str(jobs)) == expected


class Watched(Resolver):
    """Calls ``before`` ahead of each frame that is to be resolved, and remembers what it was; ``kept``: all others."""

    def __init__(self, preset: cltaa.Preset, before: Callable[[int], None], **options: Any) -> None:
        super().__init__(preset, "numpy", **options)
        self.before, self.began, self.kept, self.every = before, list[int](), list[int](), set[bool]()

    def keep(self, frame: Frame) -> None:
        self.kept.append(frame.index)
        super().keep(frame)

    def images(self, frames: Iterable[Frame], **how: Any) -> Iterator[Any]:
        def watched() -> Iterator[Frame]:
            for frame in frames:
                self.before(frame.index)
                self.began.append(frame.index)
                self.every.add(self.every_step)
                yield frame

        return super().images(watched(), **how)


def begun(
    shot: Path,
    output: Path,
    *before: Callable[[int], None],
    preset: cltaa.Preset = PRESETS["behind"],
    ends: AbstractContextManager[object] | None = None,
    **options: Any,
) -> list[Watched]:
    """Resolve by one job for each of ``before``, and return their resolvers; ``ends`` is told what is raised."""
    resolver, *others = [Watched(preset, each) for each in before]
    with ends or nullcontext():
        resolve_sequence(open_sequence(shot), output, resolver, others=others, **options)
    return [resolver, *others]


def goes_on(shot: Path, output: Path) -> None:
    """Finish what is begun in ``output`` by one job, and compare it with a whole run."""
    cltaa.resolve(shot, output.parent / "whole", PRESETS["behind"], "numpy")
    assert 0 < cltaa.resolve(shot, output, PRESETS["behind"], "numpy").resolved < FRAMES
    assert contents(output) == contents(output.parent / "whole")


def test_a_job_that_fails_ends_the_others_and_a_rerun_goes_on(
    shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    resolve, halted = Parts.resolve, list[threading.Event]()

    def noted(parts: Parts, *given: Any) -> None:
        halted.append(parts.halted)
        resolve(parts, *given)

    def fail(number: int) -> None:
        if number == 8:
            raise DataError("no such light", frame=8)

    def wait(number: int) -> None:
        if number == 2:
            assert halted[0].wait(PATIENCE)

    monkeypatch.setattr(Parts, "resolve", noted)

    ends = pytest.raises(DataError, match="no such light")
    first, _ = begun(shot, tmp_path / "out", wait, fail, ends=ends)
    assert first.began == [0, 1, 2]  # of five
    goes_on(shot, tmp_path / "out")


def test_a_wish_to_stop_ends_every_job(shot: Path, tmp_path: Path) -> None:
    stop, wished = Stop(), threading.Event()

    def ask(number: int) -> None:
        if number == 2:
            stop.requested = True
            wished.set()

    def wait(_: int) -> None:
        assert wished.wait(PATIENCE)

    ends, asked = pytest.raises(KeyboardInterrupt), nullcontext(stop)
    jobs = begun(shot, tmp_path / "out", ask, wait, ends=ends, stopping=asked)
    assert all(len(each.began) < FRAMES // 2 for each in jobs)
    goes_on(shot, tmp_path / "out")


def test_every_step_is_run_by_every_job(shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    jobs: list[Watched] = []

    def made(preset: cltaa.Preset, _: str, **options: Any) -> Watched:
        jobs.append(Watched(preset, lambda _: None, **options))
        return jobs[-1]

    monkeypatch.setattr("cltaa.pipeline.folder.Resolver", made)
    cltaa.resolve(shot, tmp_path / "out", RING_ALONE, "numpy", effects="all", jobs=3)
    assert [each.every for each in jobs] == [{True}] * 3
    assert [each.began for each in jobs] == [[0, 1, 2], [3, 4, 5, 6], [7, 8, 9, 10]]
    assert [each.kept for each in jobs] == [
        [],
        [0, 1, 2],
        [4, 5, 6],
    ]  # by the rings and the one before, and not resolved


@pytest.mark.parametrize("effects", [frozenset[str](), "all"], ids=["mean", "recursion"])
def test_a_recurrent_history_is_resolved_in_one_part(
    effects: Any, shot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = begun(shot, tmp_path / "out", *[lambda _: None] * 2, effects=effects, progress=True)
    assert (first.began, second.began) == ([*range(FRAMES)], [])
    said = "cltaa: resolved in one part: each result of preset gather-8 holds all frames before it here; plan:"
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("motion", [False, True])
def test_frames_without_cameras_are_split_where_vectors_lead_back_and_ahead(
    motion: bool, preset: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "in").mkdir()
    rng = np.random.default_rng(5)
    for number in range(FRAMES):
        names = ("R", "G", "B", *(("backward.u", "backward.v") if motion else ()))
        write_image(tmp_path / f"in/f.{number}.exr", {name: rng.random((9, 19), np.float32) for name in names})
    for jobs in (1, 2):
        cltaa.resolve(tmp_path / "in", tmp_path / str(jobs), PRESETS[preset], "numpy", jobs=jobs, progress=True)
    assert ("in one part" not in capsys.readouterr().err) == (motion and preset == "ahead")
    assert contents(tmp_path / "2") == contents(tmp_path / "1")


def test_jobs_take_devices_of_one_name_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    cards = [Named(name) for name in ("big", "small", "big", "big")]
    monkeypatch.delenv("CLTAA_DEVICE", raising=False)
    monkeypatch.setattr("cltaa.opencl.device.devices", lambda: cards)
    monkeypatch.setattr("cltaa.opencl.device.describe", lambda device: device.name)
    assert devices_of(None, 4) == ["0", "2", "3", "0"]
    assert devices_of("small", 2) == ["1", "1"]
    assert devices_of("2", 2) == ["2", "2"]
    assert devices_of(0, 2) == [0, 0]
    assert devices_of("numpy", 2) == ["numpy", "numpy"]
    assert devices_of(None, 1) == [None]


def test_what_cannot_be_parted_is_refused(shot: Path, tmp_path: Path) -> None:
    cases: tuple[tuple[str, dict[str, Any], str], ...] = (
        ("default", {}, "--jobs: preset default resolves each frame from the result before it"),
        ("gather-8", {"debug": ("count",)}, "which --debug needs"),
        ("gather-8", {"follow": True}, "which --follow needs"),
        ("gather-8", {"jobs": 0}, "invalid number of parts"),
        ("gather-8", {"jobs": 2.0}, "invalid number of parts"),
        ("gather-8", {"jobs": "2"}, "invalid number of parts"),
        ("gather-8", {"jobs": 1, "follow": True, "idle": "1"}, "idle is no time to wait"),
        ("gather-8", {"jobs": 1, "follow": True, "idle": float("nan")}, "idle is no time to wait"),
    )
    for preset, options, told in cases:
        with pytest.raises(UsageError, match=told):
            cltaa.resolve(shot, tmp_path / "out", preset, "numpy", **{"jobs": 2, **options})
