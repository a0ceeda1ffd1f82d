"""A folder that is followed frame by frame gives what the finished folder gives, or is refused as that is."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cltaa.core.resolver import Resolver
from cltaa.errors import CltaaError, DataError, DeviceLost, UsageError
from cltaa.frame import Effect
from cltaa.io.exr_frame import frame_attributes, frame_planes
from cltaa.io.exr_write import write_image
from cltaa.pipeline import follow
from cltaa.pipeline.folder import resolve_folder
from cltaa.pipeline.follow import Arrivals
from cltaa.process import Stop
from tests.sequence_factory import digests, make_frame, write_frames, write_sequence

NUMPY: dict[str, Any] = {"device": "numpy", "compression": "none"}
SIZE: dict[str, Any] = {"width": 9, "height": 7}
Followed = Callable[..., int]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    folder = tmp_path / "in"
    folder.mkdir()
    return folder


@pytest.fixture
def followed(source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Followed:
    """Follows a folder into which one file of ``source`` comes at each look; returns how many were resolved."""

    def run(begun: int = 0, **options: Any) -> int:
        given, files = tmp_path / "given", sorted(source.glob("*.exr"))
        given.mkdir(exist_ok=True)
        coming = iter(files[begun:])
        waiting = SimpleNamespace(monotonic=time.monotonic, sleep=lambda _: shutil.copy(next(coming), given))
        monkeypatch.setattr(follow, "time", waiting)
        options = {"frames": (0, len(files) - 1), **options}
        return resolve_folder(given, tmp_path / "out", follow=True, **NUMPY, **options).resolved

    return run


def refused_alike(source: Path, out: Path, followed: Followed, said: str, **options: Any) -> None:
    for resolve in (lambda: resolve_folder(source, out, **NUMPY, **options), lambda: followed(**options)):
        with pytest.raises(CltaaError, match=said):
            resolve()


def test_a_step_ends_at_the_last_number_that_it_reaches(source: Path, followed: Followed) -> None:
    write_frames(source, (make_frame(number, **SIZE) for number in (1, 3, 5)))
    assert followed(frames=(1, 6), step=2) == 3


def test_a_wrong_step_or_range_is_refused_at_the_start(source: Path, tmp_path: Path) -> None:
    write_sequence(source, 1, **SIZE)
    for wrong, said in (
        ({"step": 0}, "the step between frames is wrong"),
        ({"frames": (1, 0)}, "range of frames is empty"),
        ({"frames": (1,)}, "invalid range of frames"),
    ):
        with pytest.raises(UsageError, match=said):
            resolve_folder(source, tmp_path / "out", follow=True, idle=0.0, **NUMPY, **wrong)


def test_the_folder_is_listed_once_for_all_frames_that_are_there(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_sequence(source, 5, **SIZE)
    listed, list_files = list[str](), Arrivals._files

    def counted(arrivals: Arrivals) -> Any:
        listed.append("once")
        return list_files(arrivals)

    monkeypatch.setattr(Arrivals, "_files", counted)
    assert len(Arrivals(source, None, 0.0, {})._wait(Stop()) or ()) == 5
    assert listed == ["once"]


@pytest.mark.parametrize("at", [0, 2])
def test_a_device_that_is_lost_is_opened_again_once(
    source: Path, tmp_path: Path, followed: Followed, monkeypatch: pytest.MonkeyPatch, at: int
) -> None:
    write_sequence(source, 4, **SIZE)
    resolve_folder(source, tmp_path / "whole", **NUMPY)
    resolve, losses = Resolver.resolve, [1, 2]

    def losing(resolver: Resolver, frame: Any, **options: Any) -> Any:
        if frame.index == at and losses:
            losses.pop()
            raise DeviceLost("the device stopped working")
        return resolve(resolver, frame, **options)

    monkeypatch.setattr(Resolver, "resolve", losing)
    with pytest.raises(DeviceLost):
        followed()
    losses[:] = [1]
    assert followed(begun=at + 1) == 4 - at
    assert digests(tmp_path / "out") == digests(tmp_path / "whole")


def test_another_size_is_refused_as_in_a_finished_folder(source: Path, tmp_path: Path, followed: Followed) -> None:
    write_sequence(source, 2, **SIZE)
    write_sequence(source, 1, first=2, width=10, height=7)
    refused_alike(source, tmp_path / "whole", followed, r"frame 2: size differs \(expected 9 x 7, found 10 x 7\)")


def test_other_effects_are_refused_as_in_a_finished_folder(source: Path, tmp_path: Path, followed: Followed) -> None:
    declared = frozenset({Effect.CAMERA}), frozenset[Effect]()
    write_frames(source, (make_frame(number, effects=effects, **SIZE) for number, effects in enumerate(declared)))
    refused_alike(source, tmp_path / "whole", followed, "frame 1: declares other effects than the first frame")


def test_a_channel_that_is_gone_is_refused_as_in_a_finished_folder(
    source: Path, tmp_path: Path, followed: Followed
) -> None:
    write_frames(source, (make_frame(number, motion=number < 1, effects=None, **SIZE) for number in range(2)), "x")
    told: dict[str, Any] = {"assignments": ["depth.scale=1"], "effects": "all"}
    refused_alike(source, tmp_path / "whole", followed, r"x\.0001\.exr channel backward\.u: channel is missing", **told)


def test_other_data_windows_are_refused(source: Path, followed: Followed) -> None:
    """The finished folder would resolve the display window from the first frame on."""
    for number in range(2):
        frame = make_frame(number, **SIZE)
        planes = {name: np.ascontiguousarray(plane[:, number : number + 5]) for name, plane in planes_of(frame)}
        windows = ((number, 0, number + 4, 6), (0, 0, 8, 6))
        write_image(source / f"x.{number:04d}.exr", planes, frame_attributes(frame), windows=windows)
    with pytest.raises(DataError, match="frame 1: --follow: the data windows differ"):
        followed(effects="all")


def planes_of(frame: Any) -> Any:
    return frame_planes(frame, Path()).items()


def test_jitter_in_vectors_is_that_of_the_frame_before(source: Path, tmp_path: Path, followed: Followed) -> None:
    given: dict[str, Any] = {"effects": None, "motion": True, **SIZE}
    write_frames(source, (make_frame(n, jitter_px=(0.1 * n, -0.1 * n), **given) for n in range(3)))
    told: dict[str, Any] = {"assignments": ["motion.jittered=1"], "effects": "all"}
    assert followed(**told) == 3
    resolve_folder(source, tmp_path / "whole", **NUMPY, **told)
    assert digests(tmp_path / "out") == digests(tmp_path / "whole")


@pytest.mark.parametrize("delay", ["jitter.delay=1", "camera.delay=-1"])
def test_a_delay_is_refused(source: Path, followed: Followed, delay: str) -> None:
    write_sequence(source, 2, **SIZE)
    with pytest.raises(UsageError, match="a delay of jitter or camera needs frames that are not there yet"):
        followed(assignments=[delay], effects="all")


def test_effects_that_the_run_was_not_begun_with_are_refused(source: Path, tmp_path: Path, followed: Followed) -> None:
    made = [make_frame(n, exposure=factor, effects=None, **SIZE) for n, factor in enumerate((1.0, 1.0, 0.25))]
    write_frames(source, made)
    write_frames(tmp_path / "given", made[:2])
    resolve_folder(tmp_path / "given", tmp_path / "out", **NUMPY)
    with pytest.raises(UsageError, match=r"given: headers show effects .* not begun with .*found exposure"):
        followed(begun=2)
