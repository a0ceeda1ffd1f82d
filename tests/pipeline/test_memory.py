"""The memory of a resolve by what is read and kept of its files, and that of the program beside it."""

from __future__ import annotations

import mmap
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.core.build import Steps, Storage
from cltaa.core.planes import Layout
from cltaa.inputs.open import open_input
from cltaa.io.exr_frame import frame_attributes, frame_planes
from cltaa.io.exr_write import write_image
from cltaa.io.sequence import open_sequence
from cltaa.io.streams import AHEAD, BEHIND
from cltaa.lab.inspect.plan import plan
from cltaa.pipeline import memory
from cltaa.pipeline.memory import PROGRAM, DevicePlanes, Memory, of_sequence, program_bytes
from cltaa.pipeline.output import carried_kinds, chosen_layers
from tests.inputs.foreign import write_blender
from tests.sequence_factory import HEIGHT, WIDTH, make_frame, write_sequence

TEXELS = WIDTH * HEIGHT
LAYERS = {"albedo.R": np.float32, "mask.A": np.float16, "count": np.uint32}
HELD = DevicePlanes(Steps())


@pytest.fixture(scope="module")
def layered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("layered")
    for frame in (make_frame(0), make_frame(1)):
        path = folder / f"layered.{frame.index:04d}.exr"
        layers = {name: np.zeros((HEIGHT, WIDTH), kind) for name, kind in LAYERS.items()}
        write_image(path, {**frame_planes(frame, path), **layers}, frame_attributes(frame))
    return folder


def planned(folder: Path, **more: Any) -> Memory:
    return plan(folder, device="numpy", rounds=0, **more).memory


def test_channels_that_no_frame_holds_take_no_memory(layered: Path, tmp_path: Path) -> None:
    sequence = open_sequence(layered)
    assert sequence.channels == frozenset("RGBZ")
    plain = open_sequence(write_sequence(tmp_path, 1))
    assert of_sequence(sequence, HELD).frames == of_sequence(plain, HELD).frames


def test_layers_stay_until_their_result_is_written(layered: Path) -> None:
    without, none, some, every = (
        planned(layered, layers=layers) for layers in (None, ("none",), ("mask.*", "count"), ("all",))
    )
    assert without.layers == none.layers == 0  # own files keep none by themselves
    assert some.layers == (1 + BEHIND) * (2 + 4) * TEXELS
    assert every.layers == (1 + BEHIND) * (4 * 4 + 4 + 2 + 4) * TEXELS  # R G B Z are decoded once more
    blocks = 4 * 2 + 5 * BEHIND  # that are packed at a time, each of all rows here
    assert some.packing - none.packing == blocks * (2 + 4) * TEXELS
    assert every.packing - none.packing == blocks * (4 + 4 + 2 + 4) * TEXELS  # the result has its own R G B
    assert every.frames == none.frames


def test_what_decides_the_history_is_counted(layered: Path) -> None:
    haloed = Layout(WIDTH, HEIGHT).plane
    floats, halves = (planned(layered, storage=storage).device for storage in (Storage.FLOAT, Storage.HALF))
    assert halves - floats == -2 * 3 * 2 * haloed  # history and result


def test_bands_that_are_asked_for_are_counted(layered: Path) -> None:
    whole, bands = planned(layered), planned(layered, band_rows=4)
    assert bands.results == 4 * TEXELS  # the count of each pixel; nothing declared changes the light
    assert bands.device < whole.device


def test_a_layer_that_is_not_there_is_refused_by_name(layered: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(layered), "--plan", "--layers", "nothing"]) == 64
    assert "--layers: no such channel" in capsys.readouterr().err


def test_layers_of_another_tool_are_kept_unless_none_are_wanted(tmp_path: Path) -> None:
    sequence = open_input(write_blender(tmp_path, [make_frame(n, motion=True, effects=None) for n in (1, 2)]))
    assert sequence.channels == {*"RGBZ", "backward.u", "backward.v"}
    kept = carried_kinds(sequence, chosen_layers(None, sequence))
    assert set(kept) == {"ViewLayer.Depth.Z", *(f"ViewLayer.Vector.{name}" for name in "XYZW")}
    assert carried_kinds(sequence, chosen_layers(("none",), sequence)) == {}
    told = of_sequence(sequence, HELD, kept)
    assert told.layers == (1 + BEHIND) * 5 * 4 * TEXELS
    packed = max(path.stat().st_size for path in sequence.files)
    # Eight channels as they are decoded, and six beside each other to be converted.
    assert told.reading == AHEAD * (packed + (8 + 6) * 4 * TEXELS)


def test_what_openexr_decodes_beside_is_counted(layered: Path) -> None:
    sequence = open_sequence(layered)
    packed = max(path.stat().st_size for path in sequence.files)
    assert of_sequence(sequence, HELD).reading == AHEAD * packed + (3 + len(LAYERS)) * 4 * TEXELS


DRIVER = 32 * 2**20  # bytes


def test_files_that_a_driver_maps_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "driver"
    path.write_bytes(bytes(DRIVER))
    before = program_bytes()
    assert before > memory.ALLOCATED
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
        assert sum(mapped[:: mmap.PAGESIZE]) == 0  # each page of it is touched
        assert program_bytes() - before == pytest.approx(DRIVER, rel=0.1)


def test_what_building_kernels_maps_is_not_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The plan builds what it times, and a resolve after it builds nothing."""
    path, kept = tmp_path / "compiler", []
    path.write_bytes(bytes(DRIVER))

    def built(*_: object) -> None:
        with path.open("rb") as file:
            kept.append(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        assert sum(kept[-1][:: mmap.PAGESIZE]) == 0

    monkeypatch.setattr("cltaa.lab.inspect.plan._time", built)
    sequence = open_sequence(write_sequence(tmp_path / "in", 2))
    before = plan(sequence, device="numpy", rounds=0).memory.program
    assert plan(sequence, device="numpy").memory.program - before < DRIVER / 10
    assert kept
    kept[-1].close()


def test_a_system_that_does_not_tell_gets_what_was_measured(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(memory, "STATUS", tmp_path / "none")
    assert program_bytes() == PROGRAM
