"""Parts of a sequence on the workers of a Dask cluster: the same bytes, whatever ends a worker or a run."""

from __future__ import annotations

import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple
from unittest.mock import Mock

import numpy as np
import pytest

import cltaa
from cltaa.cli import main
from cltaa.core.build import Storage
from cltaa.core.presets import load_preset, override
from cltaa.errors import CltaaError, DataError, ResourceError, StorageError, UsageError
from cltaa.io.exr_write import write_frame
from cltaa.io.sequence import open_sequence
from cltaa.pipeline.cluster import Cluster, Tool, _outcome, _resolve_part, resolve_part
from cltaa.pipeline.output import OutputFolder, Written
from cltaa.pipeline.part import How
from cltaa.pipeline.run import Order
from cltaa.process import Stop
from cltaa.reference.launcher import NumpyLauncher
from tests.inputs.foreign import write_blender
from tests.sequence_factory import make_frame, write_sequence

FRAMES = 12
PRESET = override(load_preset("gather-8"), {"history_frames": 3, "look_ahead": 1})
TOOL = Tool(PRESET, "numpy", Storage.FLOAT, strict=False, band_rows=None, every_step=False)
HOW = How(effects="auto", half=False, compression="zip", layers=(), denoise="none")

HELD = 7  # the frame that workers do not go on behind while they are held

# A process of its own: the cluster starts others by importing this file again, in a folder that is none of the tests'.
SCRIPT = f"""
import json, os, sys, time
from pathlib import Path
from distributed import LocalCluster
from cltaa.pipeline.output import ResolvedFiles

write = ResolvedFiles.write

def held(files, writer, read, image):
    while read.frame.index >= {HELD} and Path("hold").exists():
        Path("held").write_text(str(os.getpid()))
        time.sleep(0.05)
    write(files, writer, read, image)

ResolvedFiles.write = held

if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""


class Running(NamedTuple):
    folder: Path
    address: str

    @property
    def hold(self) -> Path:
        """What holds workers while it is there."""
        return self.folder / "hold"

    def kill(self) -> None:
        """Kill the worker that is held, once one is, and hold no other."""
        while not (pid := (self.folder / "held").read_text() if (self.folder / "held").exists() else ""):
            time.sleep(0.05)
        os.kill(int(pid), signal.SIGKILL)
        self.hold.unlink()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("cluster")
    (folder / "cluster.py").write_text(SCRIPT)
    command = [sys.executable, "cluster.py"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=folder) as process:
        assert process.stdout is not None
        yield Running(folder, process.stdout.readline().strip())
        process.communicate()


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_sequence(tmp_path_factory.mktemp("shot") / "in", FRAMES, width=33, height=17, motion=True)
    frame = make_frame(5, width=33, height=17, motion=True)
    frame.colour[3, 4] = np.nan
    write_frame(folder / "synthetic.0005.exr", frame)
    return folder


@pytest.fixture(scope="module")
def whole(shot: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What one process writes."""
    output = tmp_path_factory.mktemp("whole")
    cltaa.resolve(shot, output, PRESET, "numpy")
    return output


def contents(folder: Path) -> dict[str, object]:
    """All that is in a folder, but for times; lines of the manifest in any order."""
    found: dict[str, object] = {path.name: path.read_bytes() for path in folder.glob("*.exr")}
    lines = (folder / "manifest.jsonl").read_bytes().splitlines()
    return {**found, **{path.name: ... for path in folder.iterdir() if path.name not in found}, "lines": {*lines}}


def when_finished(monkeypatch: pytest.MonkeyPatch, count: int, act: Callable[[], object]) -> list[int]:
    """Call ``act`` once so many frames are recorded; returns these."""
    finish, recorded = OutputFolder.finish, list[int]()

    def watched(folder: OutputFolder, written: Written) -> None:
        finish(folder, written)
        recorded.append(written.number)
        if len(recorded) == count:
            act()

    monkeypatch.setattr(OutputFolder, "finish", watched)
    return recorded


@pytest.mark.parametrize("jobs", [1, 3, None])
def test_workers_write_the_bytes_of_one_process(
    jobs: int | None, cluster: Running, shot: Path, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(shot.parent)  # where no worker is
    output = Path(os.path.relpath(tmp_path / "out"))
    report = cltaa.resolve(shot.name, output, PRESET, "numpy", dask=cluster.address, jobs=jobs)
    before, now = (json.loads((folder / "resolve.json").read_bytes())["outcome"] for folder in (whole, output))
    assert {name for name in now if now[name] != before[name]} == {"output", "seconds"}
    assert (report.resolved, [each.frame for each in report.missing]) == (FRAMES, [5])
    assert min(report.seconds.read, report.seconds.kernels, report.seconds.write) > 0
    assert contents(output) == contents(whole)


def test_workers_read_and_write_the_files_of_another_tool(
    cluster: Running, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    frames = [make_frame(index, width=33, height=17, alpha=True, motion=True, effects=None) for index in range(6)]
    write_blender(Path("in"), frames)
    how: dict[str, Any] = {"effects": "all", "half": True, "compression": "piz", "layers": ("all",)}
    cltaa.resolve("in", "one", PRESET, "numpy", **how)
    cltaa.resolve("in", "parts", PRESET, "numpy", **how, dask=cluster.address, jobs=2)
    assert contents(Path("parts")) == contents(Path("one"))


def test_a_killed_worker_loses_nothing(
    cluster: Running, shot: Path, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told, resolve = Counter[int](), Cluster.resolve

    def counted(*given: Any) -> Iterator[Any]:
        for result in resolve(*given):
            told[result.written.number] += 1
            yield result

    monkeypatch.setattr(Cluster, "resolve", counted)
    cluster.hold.touch()
    recorded = when_finished(monkeypatch, 3, cluster.kill)
    report = cltaa.resolve(shot, tmp_path / "out", PRESET, "numpy", dask=cluster.address, jobs=1)
    # In any order: a worker writes with several threads.
    assert (report.resolved, sorted(recorded)) == (FRAMES, [*range(FRAMES)])
    assert contents(tmp_path / "out") == contents(whole)
    # As it is written, and with its part where that has ended, so that nobody resolved the first three again.
    assert [told[number] for number in [*recorded[:3], *range(HELD, FRAMES)]] == [1] * 3 + [2] * (FRAMES - HELD)


def test_a_requested_stop_keeps_finished_frames(
    cluster: Running, shot: Path, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop, output = Stop(), tmp_path / "out"
    cluster.hold.touch()
    recorded = when_finished(monkeypatch, 3, lambda: setattr(stop, "requested", True))
    with pytest.raises(KeyboardInterrupt):
        cltaa.resolve(
            shot, output, PRESET, "numpy", dask=cluster.address, jobs=1, stopping=nullcontext(stop), restart=True
        )
    cluster.hold.unlink()
    kept = len(recorded)
    assert 3 <= kept <= HELD
    assert not [path for path in output.iterdir() if ".tmp." in path.name]
    report = cltaa.resolve(shot, output, PRESET, "numpy", dask=cluster.address, jobs=2)
    assert report.resolved == FRAMES - kept
    assert contents(output) | {"lines": ...} == contents(whole) | {"lines": ...}  # one frame has two


def test_what_is_wrong_with_a_frame_is_reported_as_by_one_process(
    cluster: Running, shot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Path(shutil.copytree(shot, tmp_path / "in"))
    path = sorted(folder.iterdir())[9]
    path.write_bytes(path.read_bytes()[:-9])
    command = ["resolve", str(folder), "--preset", "gather-8", "--device", "numpy", "-o", str(tmp_path / "out")]
    said = []
    for how in ([], ["--dask", cluster.address, "--jobs", "2", "--restart"]):
        assert main([*command, *how]) == 65
        said.append(capsys.readouterr().err.splitlines()[-1])
    assert said[0] == said[1]
    assert "synthetic.0009.exr" in said[0]


def order(shot: Path, output: Path) -> Order:
    """A part that a worker may be given, over all of ``shot``."""
    sequence, place = open_sequence(shot), output / "place"
    place.mkdir(parents=True)
    settings = TOOL.elsewhere("NumPy (float32 oracle)").settings()
    return Order(sequence, [*sequence.numbers], HOW, settings, output, place, {})


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"place": Path("/nowhere")}, "out: Dask worker tcp://there:1 cannot write there: No such file or directory; "),
        ({"settings": {"code_sha256": "?"}}, "Dask worker tcp://there:1 has other kernels; install one version of"),
        ({"device": "a GPU"}, r"tcp://there:1 has another device \(expected a GPU, found NumPy .*\); .* by --device"),
        ({"gone": True}, r"0000\.exr: Dask worker tcp://there:1 does not see the frames; share it with every worker"),
    ],
)
def test_a_worker_that_cannot_do_it_is_named(wrong: dict[str, Any], told: str, shot: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(shot, tmp_path / "in"))
    asked = order(folder, tmp_path / "out")
    if "device" in wrong:
        wrong = {"settings": asked.settings | wrong}
    if wrong.pop("gone", False):
        shutil.rmtree(folder)
    with pytest.raises(CltaaError, match=told):
        _resolve_part(asked._replace(**wrong), TOOL, 0, "tcp://there:1", lambda _: None)


def test_another_version_on_a_worker_and_no_worker_are_refused() -> None:
    def client(found: str | None, threads: int) -> Any:
        workers = {"tcp://there:1": {"packages": {"cltaa": found}}} if threads else {}
        nthreads = dict.fromkeys(workers, threads)
        return SimpleNamespace(nthreads=lambda: nthreads, get_versions=lambda **_: {"workers": workers})

    for found in ("0.0.1", None):
        told = rf"tcp://there:1 has another cltaa \(expected {cltaa.__version__}, found {found or 'none'}\)"
        with pytest.raises(UsageError, match=told):
            Cluster(client(found, 2), TOOL, None)
    with pytest.raises(UsageError, match="the Dask cluster has no workers; start some"):
        Cluster(client(None, 0), TOOL, None)
    assert Cluster(client(None, 0), TOOL, 3).parts == 3
    assert Cluster(client(cltaa.__version__, 4), TOOL, None).parts == 4


def test_a_cluster_that_fails_is_one_line() -> None:
    with pytest.raises(ResourceError, match=r"^the Dask scheduler was lost; run the same again: what is finished is k"):
        _outcome(SimpleNamespace(status="lost"), "a part")
    failed = SimpleNamespace(status="error", exception=lambda: RuntimeError("killed it"))
    with pytest.raises(ResourceError, match=r"^a part failed on the Dask cluster: RuntimeError: killed it; run the"):
        _outcome(failed, "a part")


def test_a_worker_hands_back_what_another_try_would_meet_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an error that is raised Dask tries again, on another worker."""
    monkeypatch.setattr("distributed.get_worker", lambda: SimpleNamespace(address="tcp://there:1"))
    work = pickle.dumps((None, TOOL, 0, "topic"))
    for kind in (DataError, UsageError, ResourceError, StorageError):
        error = kind("it failed")
        monkeypatch.setattr("cltaa.pipeline.cluster._resolve_part", Mock(side_effect=error))
        with pytest.raises(kind) if kind in (ResourceError, StorageError) else nullcontext():
            assert resolve_part(work) is error


def test_what_cannot_be_given_to_workers_is_refused(
    shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cltaa.pipeline.cluster.PATIENCE", "0.2s")
    command = ["resolve", str(shot), "-o", str(tmp_path / "out"), "--dask", "tcp://127.0.0.1:9", "--device", "numpy"]
    gathered = ["--preset", "gather-8"]
    for options, told in (
        ([], "--dask: preset default resolves each frame from the result before it; leave out --dask, or"),
        ([*gathered, "--debug", "count"], "--dask does not resolve frames in order, which --debug needs"),
        ([*gathered, "--follow"], "--dask does not resolve frames in order, which --follow needs"),
        (gathered, "no Dask scheduler answers at tcp://127.0.0.1:9: "),
    ):
        assert main([*command, *options]) == 64
        said = capsys.readouterr().err
        assert said.startswith(f"cltaa: error: {told}"), said
        assert said.count("\n") == 1
    assert said.endswith("; start one: dask scheduler\n")
    with pytest.raises(UsageError, match=r"workers open devices by name \(expected a name, found <.*Numpy"):
        cltaa.resolve(shot, tmp_path / "out", "gather-8", NumpyLauncher(), dask="tcp://127.0.0.1:9")
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main([*command, *gathered]) == 64
    assert "--dask needs distributed, which cannot be imported" in (said := capsys.readouterr().err)
    assert said.endswith("install it with: pip install 'cltaa[dask]'\n")
    assert not (tmp_path / "out").exists()
