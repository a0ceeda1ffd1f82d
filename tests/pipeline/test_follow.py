"""A folder that is still written: its frames are resolved as they are finished, to the bits of a finished folder."""

from __future__ import annotations

import re
import shutil
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cltaa.errors import CltaaError, DataError, InputMissing, UsageError
from cltaa.inputs.open import open_input
from cltaa.io.content import open_regular
from cltaa.io.exr_header import read_outline
from cltaa.io.exr_write import write_image
from cltaa.pipeline import follow
from cltaa.pipeline.folder import resolve_folder
from cltaa.pipeline.follow import check_whole
from cltaa.process import Stop
from tests.inputs.foreign import write_parts
from tests.io.stream_threads import wait_for
from tests.sequence_factory import write_sequence

IDLE = 0.5
NUMPY: dict[str, Any] = {"device": "numpy", "compression": "none"}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with six frames, and what a resolve of it gives."""
    folder = tmp_path_factory.mktemp("made")
    resolve_folder(write_sequence(folder / "in", 6), folder / "out", **NUMPY)
    return folder


@pytest.fixture(autouse=True)
def hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(follow, "POLL", 0.01)


def frame(made: Path, number: int) -> Path:
    return made / "in" / f"synthetic.{number:04d}.exr"


def resolved(folder: Path, number: int) -> bytes:
    return (folder / f"synthetic.{number:04d}.exr").read_bytes()


def farm(work: Callable[[], None]) -> threading.Thread:
    thread = threading.Thread(target=work)
    thread.start()
    return thread


def copied(made: Path, folder: Path, *numbers: int) -> None:
    folder.mkdir(exist_ok=True)
    for number in numbers:
        shutil.copy(frame(made, number), folder)


@pytest.mark.parametrize("pattern", ["", "synthetic.####.exr"])
def test_frames_are_resolved_as_they_come(pattern: str, made: Path, tmp_path: Path) -> None:
    """Out of their order, half written, each before the next is there; the first into a folder that is not there."""
    given, out = tmp_path / "in", tmp_path / "out"

    def write() -> None:
        copied(made, given, 1)
        copied(made, given, 0)
        wait_for((out / "synthetic.0001.exr").exists)
        whole = frame(made, 2).read_bytes()
        with (given / frame(made, 2).name).open("wb", buffering=0) as file:
            for place in range(0, len(whole), len(whole) // 7):
                file.write(whole[place : place + len(whole) // 7])
                time.sleep(0.03)
        wait_for((out / "synthetic.0002.exr").exists)
        copied(made, given, 5, 4, 3)

    thread = farm(write)
    report = resolve_folder(given / pattern, out, follow=True, reading={"frames": (0, 5)}, **NUMPY)
    thread.join()
    assert (report.frames, report.resolved) == (6, 6)
    assert all(resolved(out, number) == resolved(made / "out", number) for number in range(6))
    assert not [*out.glob(".checkpoint*")]  # no more can come


def test_progress_is_of_what_is_followed_and_not_of_each_part(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nor of the first one behind frames that were finished before."""
    given, out, late = tmp_path / "in", tmp_path / "out", iter((1, 2, 3))
    copied(made, given, 0)
    resolve_folder(given, out, follow=True, idle=0.0, **NUMPY)
    waiting = SimpleNamespace(monotonic=time.monotonic, sleep=lambda _: copied(made, given, next(late)))
    monkeypatch.setattr(follow, "time", waiting)
    resolve_folder(given, out, follow=True, progress=True, reading={"frames": (0, 3)}, **NUMPY)
    shown = [line.partition(",")[0] for line in capsys.readouterr().err.splitlines()]
    assert [line for line in shown if line.startswith(("resolving", "following"))] == ["following: 4 of 4 frames"]


@pytest.mark.parametrize("size", ["short", "no table"])
def test_half_a_file_is_not_whole(made: Path, tmp_path: Path, size: str) -> None:
    """A copy that was cut short; and what a writer leaves that fills in the table of chunks last."""
    check_whole(frame(made, 0))
    whole = bytearray(frame(made, 0).read_bytes())
    if size == "short":
        del whole[-10:]
    else:
        with open_regular(frame(made, 0)) as file:
            table = read_outline(frame(made, 0), file).tables[0]
        whole[table.place : table.place + 8] = bytes(8)
    (tmp_path / "half.exr").write_bytes(whole)
    with pytest.raises(DataError, match="truncated or was never finished"):
        check_whole(tmp_path / "half.exr")


def test_a_file_of_many_parts_can_be_whole(tmp_path: Path) -> None:
    flat = np.zeros((3, 4), np.float16)
    write_parts(tmp_path / "parts.exr", {"colour": dict.fromkeys("RGB", flat), "depth": {"Z": flat}}, {})
    check_whole(tmp_path / "parts.exr")


@pytest.mark.parametrize(
    ("there", "frames", "error", "said"),
    [
        ((), None, InputMissing, "the folder is missing"),
        ((0, 2), None, InputMissing, "frame 1: the frame is missing; capture or render it again"),
        ((0, 1), (0, 5), InputMissing, "frame 2: the frame is missing"),
        ((1, 2), (0, 2), InputMissing, "frame 0: the frame is missing"),
    ],
)
def test_a_frame_that_never_arrives_is_reported(
    made: Path, tmp_path: Path, there: tuple[int, ...], frames: Any, error: type[CltaaError], said: str
) -> None:
    if there:
        copied(made, tmp_path / "in", *there)
    with pytest.raises(error, match=said):
        resolve_folder(tmp_path / "in", tmp_path / "out", follow=True, idle=IDLE, reading={"frames": frames}, **NUMPY)
    if there and there[0] == 0:
        assert resolved(tmp_path / "out", 0) == resolved(made / "out", 0)


def test_a_file_that_is_never_finished_is_reported(made: Path, tmp_path: Path) -> None:
    copied(made, tmp_path / "in", 0, 1)
    half = tmp_path / "in" / frame(made, 1).name
    half.write_bytes(half.read_bytes()[:-10])
    with pytest.raises(DataError, match=r"synthetic\.0001\.exr: the file is truncated or was never finished"):
        resolve_folder(tmp_path / "in", tmp_path / "out", follow=True, idle=IDLE, **NUMPY)


def passes(folder: Path, form: str, colours: int, depths: int, *, stray: bool = False) -> Path:
    """A file of colour and one of depth for each of so many frames; ``form`` puts a pass in its place."""
    there = {"beauty": (colours, "RGB"), "depth": (depths, "Z")} | ({"stray": (1, ("mask",))} if stray else {})
    for name, (count, channels) in there.items():
        for number in range(count):
            path = folder / form.format(name, number)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_image(path, dict.fromkeys(channels, np.full((4, 5), 1.0 + number, np.float32)))
    return folder


@pytest.mark.parametrize("form", ["{}.{:04d}.exr", "{}/x.{:04d}.exr"])
def test_passes_are_followed_in_files_and_folders_of_their_own(form: str, tmp_path: Path) -> None:
    folder = passes(tmp_path / "in", form, 3, 3, stray=True)
    taken = follow.Arrivals(folder, None, IDLE, {})
    first = taken.first()
    assert (first.numbers, first.frame(0).depth[0, 0]) == ((0,), 1.0)  # of the others it cannot know what is read
    (part,) = taken.behind(Stop())
    assert [(frame.index, frame.depth[0, 0]) for frame in part] == [(1, 2.0), (2, 3.0)]


@pytest.mark.parametrize("form", ["{}.{:04d}.exr", "{}/x.{:04d}.exr"])
def test_a_pass_that_never_arrives_is_reported(form: str, tmp_path: Path) -> None:
    folder, name = passes(tmp_path / "in", form, 3, 1), Path(form.format("depth", 1)).name
    with pytest.raises(InputMissing, match=f"{re.escape(name)} frame 1: the frame is missing"):
        resolve_folder(folder, tmp_path / "out", follow=True, idle=IDLE, **NUMPY)
    lax = {"gaps": "reset"}
    assert resolve_folder(folder, tmp_path / "out2", follow=True, idle=IDLE, reading=lax, **NUMPY).resolved == 1


@pytest.mark.parametrize("first", ["tmp_synthetic.0000.exr", "synthetic.0000.tmp.exr"])
def test_a_frame_that_was_begun_under_another_name_is_reported(first: str, made: Path, tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    begun = shutil.copy(frame(made, 0), folder / first)

    def work() -> None:
        wait_for(lambda: (tmp_path / "out" / first).exists())
        shutil.move(begun, folder / "synthetic.0000.exr")

    thread = farm(work)
    with pytest.raises(DataError, match=r"has another name now .*name the frames by a pattern: .*synthetic\.####\.exr"):
        resolve_folder(folder, tmp_path / "out", follow=True, idle=5.0, **NUMPY)
    thread.join()


def test_a_gap_may_be_allowed(made: Path, tmp_path: Path) -> None:
    copied(made, tmp_path / "in", 0, 2)
    report = resolve_folder(
        tmp_path / "in", tmp_path / "out", follow=True, idle=IDLE, reading={"gaps": "reset"}, **NUMPY
    )
    assert report.resolved == 2


def test_a_run_goes_on_behind_its_end(made: Path, tmp_path: Path) -> None:
    """It waits in vain, is interrupted, and then all is there: each run goes on by the state of the one before."""
    given, out = tmp_path / "in", tmp_path / "out"
    copied(made, given, 0, 1)
    assert resolve_folder(given, out, follow=True, idle=IDLE, **NUMPY).resolved == 2
    assert [*out.glob(".checkpoint*")]
    stop = Stop()

    class Stopping:
        def __enter__(self) -> Stop:
            return stop

        def __exit__(self, *_: object) -> None:
            """Nothing was changed."""

    def write() -> None:
        copied(made, given, 2, 3)
        wait_for((out / "synthetic.0003.exr").exists)
        stop.requested = True

    thread = farm(write)
    with pytest.raises(KeyboardInterrupt):
        resolve_folder(given, out, follow=True, stopping=Stopping(), **NUMPY)
    thread.join()
    copied(made, given, 4, 5)
    report = resolve_folder(given, out, **NUMPY)
    assert (report.frames, report.resolved) == (6, 2)
    assert all(resolved(out, number) == resolved(made / "out", number) for number in range(6))


def test_what_only_a_finished_sequence_has_is_refused(made: Path, tmp_path: Path) -> None:
    for given, said in (
        ({"preset": "gather-8+8"}, "looks ahead, so it cannot follow"),
        ({"preview": tmp_path / "film.mp4"}, "--preview needs a finished sequence"),
    ):
        with pytest.raises(UsageError, match=said):
            resolve_folder(made / "in", tmp_path / "out", follow=True, **NUMPY, **given)
    with pytest.raises(UsageError, match="only a folder or a pattern of files can be followed"):
        resolve_folder(open_input(made / "in"), tmp_path / "out", follow=True, **NUMPY)


def test_jitter_of_a_projection_is_not_followed(tmp_path: Path) -> None:
    """Each frame alone is its own mean, and would have none."""
    folder = write_sequence(tmp_path / "in", 2)
    with pytest.raises(UsageError, match="jitter in the projection shows over a whole shot"):
        resolve_folder(
            folder, tmp_path / "out", follow=True, idle=IDLE, assignments=["jitter.source=projection"], **NUMPY
        )
