"""``cltaa bench accuracy``: what tells its tasks apart, what is kept of them, and other processes that run them."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from cltaa.core.build import Storage
from cltaa.errors import DataError, InputMissing
from cltaa.io.atomic import keep
from cltaa.lab.bench.accuracy.tasks import Errors, Rounding, load, path_of, run_all
from tests.lab.bench.accuracy_tasks import task
from tests.sequence_factory import write_sequence


def test_a_key_tells_tasks_apart(sequence: Path, tmp_path: Path) -> None:
    first = task(sequence)
    other = msgspec.structs.replace(first, metrics=("flip",))
    assert first.key() == task(sequence).key()
    assert len({first.key(), other.key(), task(sequence, strict=True).key(), task(tmp_path).key()}) == 4


def test_a_key_tells_devices_apart(sequence: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keys = set()
    for wish in ("one", "another"):  # by the variable, where the task names none
        monkeypatch.setenv("CLTAA_DEVICE", wish)
        keys |= {msgspec.structs.replace(task(sequence), device=device).key() for device in (None, "0")}
    assert len(keys) == 3


def test_results_come_back_as_they_were(sequence: Path, tmp_path: Path) -> None:
    errors = Errors(
        frames={"mse": [0.1, 1 / 3]}, rounding=Rounding(rms=1e-9, largest=1e-8, frames=[1e-9]), pictures={"p": b"\0x"}
    )
    assert load(task(sequence), tmp_path) is None
    keep(path_of(task(sequence), tmp_path), errors)
    assert load(task(sequence), tmp_path) == errors
    path_of(task(sequence), tmp_path).write_bytes(b"\xc1")
    with pytest.raises(DataError, match="no finished part of a measurement"):
        load(task(sequence), tmp_path)


def test_spawned_processes_find_the_same(sequence: Path, tmp_path: Path) -> None:
    asked = (task(sequence), task(sequence, storage=Storage.HALF))
    tasks = [msgspec.structs.replace(each, device="numpy") for each in asked]
    for folder, jobs in (("one", 1), ("two", 2)):
        assert {each.key() for each in run_all(tasks, tmp_path / folder, jobs=jobs)} == {each.key() for each in tasks}
    for each in tasks:
        assert load(each, tmp_path / "one") == load(each, tmp_path / "two")


def test_what_is_finished_outlives_an_error(sequence: Path, tmp_path: Path) -> None:
    bare = write_sequence(tmp_path / "bare", 1)
    tasks = [task(sequence), *(task(bare, name=str(number)) for number in range(3))]
    with pytest.raises(InputMissing):
        list(run_all(tasks, tmp_path / "out", jobs=2))
    assert load(tasks[1], tmp_path / "out") is None
