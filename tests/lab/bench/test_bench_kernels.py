"""``cltaa bench kernels``: that the contenders compute one thing, and that the numbers hang together."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import nullcontext

import numpy as np
import pytest

from cltaa.camera import displacement
from cltaa.core.build import Record, Storage
from cltaa.core.planes import Layout
from cltaa.core.presets import load_preset, override
from cltaa.core.record import Past, frame_record
from cltaa.core.resolver import Resolver
from cltaa.errors import InternalError
from cltaa.frame import Frame, Image
from cltaa.lab.bench.kernels import BASELINE, BORDER, CONTROL, CORE, Contenders, PlainPort, check_same, least_bytes
from cltaa.lab.timing import SHIFT_PX, Motion, camera_at, make_frames
from cltaa.opencl.launcher import DeviceLauncher

SIZE = ["--size", "72x40", "--rounds", "3"]


def run(*arguments: str, without: str | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own: two rasterisers and PoCL do not share one well."""
    hide = "" if without is None else f"sys.modules[{without!r}] = None;"
    code = f"import sys; {hide} from cltaa.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "bench", "kernels", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_every_contender_is_timed_in_one_run() -> None:
    done = run(*SIZE, "--json")
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("timing: 3 of 3 rounds, ") == 2
    bench = json.loads(done.stdout)
    assert [timing["motion"] for timing in bench["timings"]] == ["uniform", "turn"]
    assert len(bench["environment"]["kernels_sha256"]) == 64
    for timing in bench["timings"]:
        rows = {row["name"]: row for row in timing["rows"]}
        assert list(rows)[:4] == [CORE, CONTROL, "default", "plain port"]
        assert "copy" in rows
        assert rows["copy"]["of_floor"] == pytest.approx(1.0)
        assert rows[CORE]["ratio"]["median"] == 1.0
        assert all(rows[name]["device_ns"] for name in (CORE, CONTROL, "default", "plain port", "copy"))
        for row in rows.values():
            assert row["least_wall_ns"] <= row["wall_ns"]["median"]
            assert row["wall_ns"]["low"] <= row["wall_ns"]["median"] <= row["wall_ns"]["high"]
            if row["device_ns"] is not None:
                assert row["device_ns"]["median"] <= row["wall_ns"]["median"]


def test_a_missing_shader_is_reported() -> None:
    done = run(*SIZE, "--motion", "turn", without="moderngl")
    assert done.returncode == 0, done.stderr
    assert "GLSL is absent" in done.stdout
    assert "pip install 'cltaa[bench]'" in done.stdout
    assert "plain port" in done.stdout


def test_motion_is_what_it_says() -> None:
    now, before = (camera_at(index, Motion.UNIFORM, 64, 36) for index in (1, 0))
    uniform = displacement(now, before, 64, 36).rows
    assert np.abs(np.abs(uniform[:2, 2] / 5.0) - np.abs(SHIFT_PX)).max() < 1e-12
    now, before = (camera_at(index, Motion.TURN, 64, 36) for index in (1, 0))
    turn = displacement(now, before, 64, 36).rows
    assert np.abs(turn[:2, :2]).min() > 1e-3


@pytest.mark.parametrize("motion", list(Motion))
def test_plain_port_computes_the_core(motion: Motion) -> None:
    frames = make_frames(131, 67, motion)
    launcher = DeviceLauncher()
    port = PlainPort(launcher, 131, 67)
    resolver = Resolver(BASELINE, launcher)
    past = None
    for frame in frames:
        image = port.resolve(frame, frame_record(frame, past, Layout(131, 67)))
        expected, past = resolver.resolve(frame), Past.of(frame)
    check_same("plain port", image, expected)
    with pytest.raises(
        InternalError,
        match=r"does not compute what the resolve computes .*; its time would say nothing; see docs/performance\.md",
    ):
        check_same("another frame", frames[0].colour, expected)


@pytest.mark.parametrize(("odd", "same"), [(1, True), (2, False)])
def test_one_pixel_of_a_thousand_may_be_odd(odd: int, same: bool) -> None:
    """Inside the border, which is not looked at."""
    expected = np.ones((25 + 2 * BORDER, 40 + 2 * BORDER, 3), np.float32)
    image = expected.copy()
    image[:BORDER] = 0.0
    image[BORDER, BORDER : BORDER + odd] = 0.0
    with nullcontext() if same else pytest.raises(InternalError, match=r"found 0\.20%"):
        check_same("port", image, expected)


def test_a_shader_that_computes_something_else_is_not_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    class OffShader(PlainPort):
        renderer = "a renderer"

        def resolve(self, frame: Frame, record: Record) -> Image:
            return super().resolve(frame, record) * np.float32(1.0 + 2.0**-9)

    monkeypatch.setattr("cltaa.lab.bench.kernels.Shader", lambda *shape: OffShader(DeviceLauncher(), *shape))
    with pytest.raises(InternalError, match="GLSL does not compute"):
        Contenders(DeviceLauncher(), make_frames(64, 36, Motion.TURN)).add_ports()


@pytest.mark.parametrize("changes", [{}, {"history": "frames", "history_frames": 2}])
def test_running_again_gives_the_same(changes: dict[str, object]) -> None:
    frames = make_frames(61, 33, Motion.TURN, count=4)
    resolver = Resolver(override(load_preset(), changes), "numpy")
    for frame in frames:
        image = resolver.resolve(frame)
    for _ in range(2):
        resolver.run_again(frames[-1], frames[-2])
        assert resolver._buffers is not None
        assert resolver.last is not None
        resolver._buffers.swap()
        again = np.zeros_like(image)
        resolver._buffers.read(resolver.last.arguments["output"], again, resolver.last.build)
        np.testing.assert_array_equal(again, image)
        resolver._buffers.swap()


@pytest.mark.parametrize(("storage", "expected"), [(Storage.FLOAT, 52), (Storage.HALF, 40)])
def test_the_least_bytes_are_each_plane_once(storage: Storage, expected: int) -> None:
    # Read: colour 12, inverse depth 4, last inverse depth 4, history 12 (half: 6), count 4. Written: history and count
    # again.
    resolver = Resolver("default", "numpy", storage=storage)
    for frame in make_frames(16, 9, Motion.TURN):
        resolver.resolve(frame)
    assert least_bytes(resolver) == expected
