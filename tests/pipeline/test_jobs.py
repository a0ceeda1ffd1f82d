"""Parts of a sequence that are resolved at the same time: the same bytes, whatever ends a run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

import cltaa
from cltaa.core.presets import load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.errors import DataError, UsageError
from cltaa.frame import Frame
from cltaa.io.sequence import open_sequence
from cltaa.pipeline.run import resolve_sequence
from tests.sequence_factory import write_sequence

FRAMES = 11
PRESETS = {  # rings shorter than a part, and longer
    "behind": override(load_preset("gather-8"), {"history_frames": 2}),
    "ahead": override(load_preset("gather-8"), {"history_frames": 4, "look_ahead": 2}),
}


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_sequence(tmp_path_factory.mktemp("shot") / "in", FRAMES, width=19, height=9, motion=True)


def contents(folder: Path) -> dict[str, bytes]:
    found = {path.name: path.read_bytes() for path in folder.glob("*.exr")}
    assert len(found) == FRAMES
    return found


@pytest.mark.parametrize("preset", PRESETS.values(), ids=PRESETS)
def test_any_number_of_jobs_writes_the_same_bytes(preset: cltaa.Preset, shot: Path, tmp_path: Path) -> None:
    expected = None
    for jobs in (1, 2, 3, FRAMES + 2):
        report = cltaa.resolve(shot, tmp_path / str(jobs), preset, "numpy", effects="all", jobs=jobs)
        assert (report.frames, report.resolved) == (FRAMES, FRAMES)
        expected = expected or contents(tmp_path / "1")
        assert contents(tmp_path / str(jobs)) == expected


class Failing(Resolver):
    """Ends at one frame."""

    def images(self, frames: Iterable[Frame], **how: Any) -> Iterator[Any]:
        def until_then() -> Iterator[Frame]:
            for frame in frames:
                if frame.index == 8:
                    raise DataError("no such light", frame=8)
                yield frame

        return super().images(until_then(), **how)


def test_a_job_that_fails_ends_the_others_and_the_run_goes_on_with_fewer(shot: Path, tmp_path: Path) -> None:
    preset = PRESETS["behind"]
    cltaa.resolve(shot, tmp_path / "whole", preset, "numpy")
    with pytest.raises(DataError, match="no such light"):
        resolve_sequence(
            open_sequence(shot), tmp_path / "out", Resolver(preset, "numpy"), others=[Failing(preset, "numpy")]
        )
    assert not (tmp_path / "out" / "synthetic.0008.exr").exists()
    resumed = cltaa.resolve(shot, tmp_path / "out", preset, "numpy")
    assert 0 < resumed.resolved < FRAMES
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_what_cannot_be_parted_is_refused(shot: Path, tmp_path: Path) -> None:
    cases: tuple[tuple[str, dict[str, Any], str], ...] = (
        ("default", {}, "--jobs: preset default resolves each frame from the result before it"),
        ("gather-8", {"debug": ("count",)}, "as --debug wants"),
        ("gather-8", {"follow": True}, "as --follow wants"),
        ("gather-8", {"jobs": 0}, "so many parts at once"),
    )
    for preset, options, told in cases:
        with pytest.raises(UsageError, match=told):
            cltaa.resolve(shot, tmp_path / "out", preset, "numpy", **{"jobs": 2, **options})
