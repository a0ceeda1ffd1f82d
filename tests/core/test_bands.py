"""A resolve in bands gives the bits of one in one piece, whatever the height of a band."""

from __future__ import annotations

import os
import time
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from cltaa.cli import main
from cltaa.core.bands import BandedResolver
from cltaa.core.build import Steps, Storage
from cltaa.core.planes import BLOCK_POOL
from cltaa.core.planes import Layout as PlaneLayout
from cltaa.core.presets import load_preset
from cltaa.core.resolver import Resolver
from cltaa.errors import ResourceError, UsageError
from cltaa.frame import Frame
from cltaa.io.exr_layout import Layout
from cltaa.io.exr_write import write_image
from cltaa.io.manifest import Manifest
from cltaa.io.sequence import FrameSequence, open_sequence
from cltaa.lab.inspect.plan import plan
from cltaa.opencl.device import Device
from cltaa.opencl.launcher import DeviceLauncher
from cltaa.opencl.shape import Shape
from cltaa.pipeline.checkpoint import Checkpoints
from cltaa.pipeline.folder import band_rows_for, of_whole, resolver_for
from cltaa.pipeline.memory import DevicePlanes, Memory, of_sequence
from cltaa.pipeline.run import resolve_sequence
from tests.sequence_factory import bits, make_camera, make_frame, special_values, write_sequence

ROWS = (1, 2, 3, 4, 5, 7, 8, 22, 23, 24, 100)


def frames(**channels: bool) -> list[Frame]:
    """Frames whose camera travels and turns so far that the history comes from other bands, with wrong texels."""
    sequence = []
    for index in range(5):
        camera = make_camera((0.4 * index, 0.9 * index, 5.0 - 0.3 * index))
        frame = make_frame(index, camera=camera, effects=None, exposure=1.0 + index / 5, **channels)  # type: ignore[arg-type]
        frame.colour[3:21:4, ::7, 1] = special_values()[3:21:4, ::7]
        sequence.append(frame)
    return sequence


def copied(frame: Frame) -> Frame:
    """A frame of its own arrays: a banded resolve uses them up."""
    names = ("colour", "depth", "motion", "alpha", "reactive")
    arrays: dict[str, Any] = {name: deepcopy(getattr(frame, name)) for name in names}
    return replace(frame, **arrays)


def test_bands_of_any_height_give_the_bits_of_whole_images() -> None:
    """From one row to more than there are; 4 rows around a band are taken along, 32 are a work-item's."""
    whole = Resolver()
    banded = [BandedResolver(device=whole.launcher, band_rows=rows) for rows in ROWS]
    for frame in frames(motion=True):
        expected = whole.resolve(frame)
        for rows, resolver in zip(ROWS, banded, strict=True):
            assert np.array_equal(bits(resolver.resolve(copied(frame))), bits(expected)), rows


@pytest.mark.parametrize(
    ("how", "channels"),
    [
        ({"storage": Storage.HALF_STOCHASTIC}, ("alpha", "motion", "reactive")),
        ({"storage": Storage.DOUBLE}, ("alpha", "motion", "reactive")),
        ({"every_step": True}, ()),
    ],
    ids=str,
)
def test_bands_with_every_channel_storage_and_step(how: dict[str, Any], channels: tuple[str, ...]) -> None:
    whole, banded = Resolver("fast", **how), BandedResolver("fast", band_rows=6, **how)
    for frame in frames(**dict.fromkeys(channels, True)):
        expected = whole.resolve(frame)
        assert np.array_equal(bits(banded.resolve(copied(frame))), bits(expected))


def test_bands_in_halves_give_the_bits_of_whole_images() -> None:
    # Of a kernel that another test builds.
    whole, banded = (made("fast", storage=Storage.DOUBLE) for made in (Resolver, partial(BandedResolver, band_rows=6)))
    for frame in frames(alpha=True, motion=True, reactive=True):
        frame.colour[5:9, 3] = 1e6
        expected = whole.resolve(frame, half=True)
        assert np.isinf(expected).any()
        assert np.array_equal(bits(banded.resolve(copied(frame), half=True)), bits(expected))


def test_bands_where_kernels_are_built_for_one_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """Planes of a band and of the history are of two sizes: a build that knew one would read the other wrongly."""
    monkeypatch.setattr(Device, "shape", property(lambda _: Shape(lanes=1, rows=5, group=(1, 1), one_size=True)))
    whole, banded = Resolver("fast"), BandedResolver("fast", band_rows=6)
    for frame in frames()[:3]:
        expected = whole.resolve(frame)
        assert np.array_equal(bits(banded.resolve(copied(frame))), bits(expected))


def test_state_of_one_is_the_state_of_the_other(tmp_path: Path) -> None:
    whole, banded = Resolver(), BandedResolver(band_rows=6)
    sequence = frames(motion=True)
    for frame in sequence[:3]:
        banded.resolve(copied(frame))
        expected = whole.resolve(frame)
    checkpoints = Checkpoints(tmp_path, "one key")
    checkpoints.save(banded, "inputs")
    restored = Resolver()
    assert checkpoints.restore(restored, dict.fromkeys(range(9), "inputs")) == 2
    for frame in sequence[3:]:
        expected = whole.resolve(frame)
        assert np.array_equal(bits(restored.resolve(frame)), bits(expected))


def test_a_history_that_was_kept_in_part_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    resolver, fresh = BandedResolver(band_rows=6), BandedResolver(band_rows=6)
    first, second, *_ = frames()
    resolver.resolve(first)
    with monkeypatch.context() as patch:
        patch.setattr(PlaneLayout, "extend_edges", Mock(side_effect=KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            resolver.resolve(copied(second))
    assert np.array_equal(bits(resolver.resolve(copied(second))), bits(fresh.resolve(copied(second))))


def test_the_image_lies_in_the_arrays_of_its_frame() -> None:
    frame = frames()[0]
    assert np.shares_memory(BandedResolver(band_rows=6).resolve(frame), frame.colour)


def test_numpy_has_no_bands() -> None:
    with pytest.raises(UsageError, match="NumPy resolves whole images only; leave --band-rows out, or name a device"):
        BandedResolver(device="numpy")


def test_only_large_images_are_banded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cltaa.pipeline.folder.memory_limit", lambda: 24 * 10**9)
    assert band_rows_for(whole_images(tmp_path, 3840, 2160)) == 0
    assert band_rows_for(whole_images(tmp_path, 7680, 4320)) == 0
    assert band_rows_for(whole_images(tmp_path, 16384, 16384)) > 0


def whole_images(folder: Path, width: int, height: int) -> Memory:
    """What a run takes whose frames have motion of their own and do not pack at all."""
    channels = dict.fromkeys(("R", "G", "B", "Z", "backward.u", "backward.v"), "float")
    path, window = folder / "large.0000.exr", (0, 0, width - 1, height - 1)
    layout = Layout(path, channels, window, window, "zip")
    path.touch()
    os.truncate(path, layout.decoded_bytes)  # takes no room on the disk
    sequence = FrameSequence(folder, "large", {0: path}, verify=False, layouts={0: layout})
    return of_sequence(sequence, DevicePlanes(Steps()))


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("storage", [Storage.FLOAT, Storage.HALF])
def test_bands_begin_where_the_formula_says(
    storage: Storage, half: bool, shared: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A device with the host's memory reads channels where they are, so that larger images fit whole."""
    sequence, launcher = open_sequence(write_sequence(tmp_path / "in", 2)), DeviceLauncher()
    launcher.shares_memory = False
    plain = of_whole(sequence, Resolver("default", launcher), half=False, layers={}).whole
    launcher.shares_memory = shared
    whole = of_whole(sequence, Resolver("default", launcher, storage=storage), half=half, layers={}).whole
    assert (whole != plain) == (half or shared or storage is Storage.HALF)
    for memory, banded in ((whole, False), (whole - 1, True)):
        monkeypatch.setattr("cltaa.pipeline.folder.memory_limit", lambda memory=memory: memory)
        resolver = resolver_for(load_preset("default"), launcher, sequence, storage=storage, half=half)
        assert isinstance(resolver, BandedResolver) == banded
        found = plan(sequence, device=launcher, rounds=0, storage=storage, half=half).memory
        assert (found.results < plan(sequence, rounds=0, half=half, band_rows=0).memory.results) == banded


def test_jobs_share_the_memory_of_the_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sequence, preset = open_sequence(write_sequence(tmp_path / "in", 2)), load_preset("gather-8")
    one, four = (of_whole(sequence, Resolver(preset), half=False, layers={}, jobs=jobs) for jobs in (1, 4))
    assert four.whole - one.program == 4 * (one.whole - one.program) > 0
    monkeypatch.setattr("cltaa.pipeline.folder.memory_limit", lambda: four.whole)
    assert resolver_for(preset, None, sequence, jobs=4).preset == preset
    with pytest.raises(ResourceError, match="keeps frames, so it resolves whole images only"):
        resolver_for(preset, None, sequence, jobs=5)


def test_numpy_that_the_environment_names_resolves_whole_images(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cltaa.pipeline.folder.memory_limit", lambda: 10**5)
    monkeypatch.setenv("CLTAA_DEVICE", "numpy")
    assert main(["resolve", str(write_sequence(tmp_path / "in", 2)), "-o", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "synthetic.0001.exr").exists()
    told = plan(open_sequence(tmp_path / "in"), rounds=0).memory
    whole = plan(open_sequence(tmp_path / "in"), rounds=0, band_rows=0).memory
    assert (told.device, told.results) == (whole.device, whole.results)


def test_bands_open_the_device_again_by_the_wish_for_it(tmp_path: Path) -> None:
    resolver = resolver_for(load_preset("default"), "pthread", open_sequence(write_sequence(tmp_path / "in", 2)), 6)
    assert isinstance(resolver, BandedResolver)
    lost = resolver.launcher
    resolver.reopen()
    assert resolver.launcher is not lost


def test_a_preset_that_keeps_frames_has_no_bands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where images would need them it says so before it reads one, and what to do; so it does when it is asked to."""
    folder = write_sequence(tmp_path / "in", 2)
    command = ["resolve", str(folder), "-o", str(tmp_path / "out"), "--preset", "gather-48"]
    assert main([*command, "--band-rows", "6"]) == 64
    assert (
        "preset gather-48 keeps frames, so it resolves whole images only; leave --band-rows out"
        in capsys.readouterr().err
    )
    monkeypatch.setattr("cltaa.pipeline.folder.memory_limit", lambda: 10**5)
    assert main(command) == 75
    said = capsys.readouterr().err
    assert (
        "37 x 23 pixels are too many for preset gather-48, which keeps frames, so it resolves whole images only" in said
    )
    assert "take --preset default, which resolves them in bands, or --band-rows 0" in said
    assert not list(tmp_path.glob("out/*.exr"))
    whole = resolver_for(load_preset("gather-48"), None, open_sequence(folder), 0)
    assert not isinstance(whole, BandedResolver)
    assert isinstance(resolver_for(load_preset("default"), None, open_sequence(folder)), BandedResolver)


def test_no_second_image_waits_beside_a_band(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is written before the next frame is resolved: of images that large little else fits into memory."""
    output = tmp_path / "out"
    there: list[int] = []

    class Looking(BandedResolver):
        def resolve(self, frame: Frame, **options: Any) -> Any:
            there.append(len(list(output.glob("*.exr"))))
            assert not BLOCK_POOL._users  # nor is one kept for what comes next
            return super().resolve(frame, **options)

    def slowly(*given: Any, **named: Any) -> None:
        time.sleep(0.01)
        write_image(*given, **named)

    monkeypatch.setattr("cltaa.io.streams.write_image", slowly)
    folder = write_sequence(tmp_path / "in", 4, width=9, height=7)
    resolve_sequence(open_sequence(folder), output, Looking(band_rows=4))
    assert there == [0, 1, 2, 3]


def test_command_line_writes_the_same_files(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "in", 4)
    for name, more in (("whole", ["--band-rows", "0"]), ("bands", ["--band-rows", "6"])):
        assert main(["resolve", str(folder), "-o", str(tmp_path / name), "--checkpoint", "2", *more]) == 0
    assert Manifest(tmp_path / "whole").entries == Manifest(tmp_path / "bands").entries
    # The bits do not depend on the bands, so that a run may go on with others.
    (tmp_path / "whole" / "synthetic.0002.exr").unlink()
    assert main(["resolve", str(folder), "-o", str(tmp_path / "whole"), "--checkpoint", "2", "--band-rows", "9"]) == 0
    assert Manifest(tmp_path / "whole").entries == Manifest(tmp_path / "bands").entries
