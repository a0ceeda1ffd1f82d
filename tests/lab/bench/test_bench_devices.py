"""``cltaa bench devices``: what it measures, what it keeps, and what becomes of a shape that does not build."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.core.resolver import Resolver
from cltaa.errors import InternalError, OutputError
from cltaa.frame import Frame
from cltaa.lab.bench import devices
from cltaa.lab.timing import Clock, Sample, Samples
from cltaa.opencl.device import choose_device, chosen_shape, usual_shape
from cltaa.opencl.shape import SHAPES


@pytest.fixture(autouse=True)
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(devices, "CPU_SIZE", (96, 54))


class Wrong(Resolver):
    """A resolver whose driver gives NaN for ``fast`` in a row of one shape; that of NVIDIA's builds on PoCL no more
    than elsewhere."""

    def resolve(self, frame: Frame, **more: Any) -> Any:
        device, image = getattr(self.launcher, "device", None), super().resolve(frame, **more)
        if device and device.shape == SHAPES["gpu-long"] and self.preset.name == "fast":
            image[1] = np.nan
        return image


@pytest.mark.optimised
def test_it_keeps_an_answer_until_it_is_forgotten(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    first = choose_device()
    usual, _ = usual_shape(first)
    monkeypatch.setattr(devices, "candidate_shapes", lambda _: [usual, "nvidia", "gpu-long", "gpu"])
    monkeypatch.setattr(devices, "Resolver", Wrong)
    monkeypatch.setattr(devices, "fastest", lambda samples, base, _: next(n for n in samples.by_job if n != base))
    assert main(["bench", "devices", "--json"]) == 0
    out, told = capsys.readouterr()
    found = json.loads(out)
    assert "building: 4 of 4 shapes, " in told
    assert "\ntiming: " in told
    base, none, wrong, other = found["rows"]
    assert (wrong["ratio"], none["ratio"]) == (None, None)
    assert "does not build" in none["absent"]
    assert wrong["absent"].startswith("gpu-long does not compute what the resolve computes")
    assert (found["usual"], base["ratio"]["median"], other["absent"]) == (usual, 1.0, None)
    assert 0.0 < other["seconds"]["low"] <= other["seconds"]["high"]
    assert (found["taken"], chosen_shape(first)) == ("gpu", ("gpu", "measured"))
    assert main(["bench", "devices", "--forget"]) == 0
    assert capsys.readouterr().out == "forgotten: 1 shape\n"
    assert (chosen_shape(first), Path(found["kept"]).exists()) == (usual_shape(first), False)


def test_where_no_shape_builds_that_is_the_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices, "candidate_shapes", lambda _: ["nvidia"])
    with pytest.raises(InternalError, match="does not build"):
        devices.bench_shapes(None)


def test_a_compiler_that_takes_its_time_is_not_asked_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices, "PATIENCE", 0.0)
    jobs, absent = devices._jobs(None, ["cpu-4", "cpu-8", "cpu-16"], (96, 54))
    assert ([*jobs], [*absent]) == (["cpu-4"], ["cpu-8", "cpu-16"])


@pytest.mark.parametrize(
    ("other", "taken"),
    [([0.5] * 9, "other"), ([0.97] * 9, "usual"), ([2.0] * 9, "usual"), ([0.5, 1.5] * 4 + [0.9], "usual")],
    ids=["half", "not worth it", "twice", "by chance"],
)
def test_another_shape_is_taken_where_it_pays_beyond_chance(other: list[float], taken: str) -> None:
    samples = Samples()
    for seconds in other:
        samples.add("usual", Sample(9.0, 1.0))
        samples.add("other", Sample(9.0, seconds))
        samples.add("slow", Sample(1.0, 0.99))
    assert devices.fastest(samples, "usual", devices.clock_of(samples)) == taken


@pytest.mark.parametrize(("device", "clock"), [(0.1, Clock.DEVICE), (2e-9, Clock.WALL), (None, Clock.WALL)])
def test_a_clock_that_does_not_run_is_not_asked(device: float | None, clock: Clock) -> None:
    samples = Samples()
    samples.add("one", Sample(1.0, 0.5))
    samples.add("other", Sample(1.0, device))
    assert devices.clock_of(samples) is clock


def test_without_a_home_nothing_can_be_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(devices, "kept_folder", homeless)
    for command in (lambda: devices.bench_shapes(None), devices.forget_shapes):
        with pytest.raises(OutputError, match="no home to keep shapes in; name a folder by XDG_CACHE_HOME"):
            command()


def test_the_usual_shape_is_timed_first(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked = list[str]()

    def jobs(_: object, names: list[str], __: object) -> NoReturn:
        asked.extend(names)
        raise KeyboardInterrupt

    monkeypatch.setattr(devices, "kept_folder", lambda: tmp_path)
    monkeypatch.setattr(devices, "_jobs", jobs)
    with pytest.raises(KeyboardInterrupt):
        devices.bench_shapes(None)
    assert asked[0] == usual_shape(choose_device(None))[0]
