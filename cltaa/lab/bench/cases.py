"""Sequences and presets of ``cltaa bench quality``: given ones, and those that ``cltaa capture`` draws as asked.

The two packages know each other by their command lines alone (docs/decisions/01).
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable
from functools import cache
from pathlib import Path
from typing import NamedTuple

from cltaa.errors import CltaaError, InputMissing, UsageError, known
from cltaa.frame import Effect
from cltaa.io.numbered import ranges
from cltaa.io.sequence import FrameSequence, ImageSequence, open_sequence
from cltaa.process import run_cltaa


def by_name(paths: Iterable[Path], what: str) -> dict[str, Path]:
    """Paths of ``what`` by their last word, which tables go by; raises UsageError for two of one name."""
    named: dict[str, Path] = {}
    for path in paths:
        if named.setdefault(path.name, path) != path:
            told, cure = f"two {what} of one name, which tables go by", "rename one of them"
            raise UsageError(told, path=path, found=named[path.name], cure=cure)
    return named


REDRAWN = "again"  # folder of such a capture, inside the sequence's


def redrawn_of(sequence: FrameSequence) -> ImageSequence | None:
    """The frames of ``sequence`` drawn again, or None where there is no such folder.

    Raises InputMissing and DataError where it is there but does not fit.
    """
    folder = sequence.folder / REDRAWN
    if not folder.is_dir():
        return None
    again = sequence.open_supersampled(folder)
    for number in sequence.numbers:
        if number not in again.numbers:
            what, cure = "this frame was not drawn again", "draw them all again, or take the folder away"
            raise InputMissing(what, path=folder, frame=number, found=ranges(again.numbers), cure=cure)
    return again.select(sequence.first, sequence.last)


TRAIN, HELD_OUT, GIVEN = "train", "held-out", "given"
MODEL = "file:"  # begins the name of a scene that is a model's path
OTHER_JITTERS = ("halton:64", "r2:64")  # of the capture REDRAWN: the second where the sequence itself has the first
# Without any of these nothing changes from frame to frame, and the truth has to be better than any resolve can get: so
# many times the samples.
_CHANGES = {*Effect} - {Effect.SKY, Effect.HDR, Effect.THIN, Effect.ALPHA, Effect.NOISE}
STILL = 4


class Shape(NamedTuple):
    """What every capture is asked for."""

    width: int
    height: int
    frames: int
    samples: int  # of the truth; of scenes in which nothing changes STILL times as many
    jitter: str  # sample positions, as cltaa capture reads them


class Case(NamedTuple):
    """One sequence of the table."""

    scene: str
    split: str  # TRAIN, HELD_OUT or GIVEN: whether the presets were tuned on it, as far as that is known
    folder: Path
    seed: int = 0
    samples: int = 0  # of the truth, where it is drawn

    @property
    def key(self) -> str:
        """Name of the folder, unique within the table."""
        return self.folder.name

    @property
    def title(self) -> str:
        """The scene as the table names it: a model by its file alone, wherever that lies."""
        return f"{MODEL}{Path(self.scene).name}" if self.scene.startswith(MODEL) else self.scene


@cache
def known_scenes() -> dict[str, frozenset[str]]:
    """Every scene that ``cltaa scenes`` lists, with its effects."""
    listed = json.loads(run_cltaa(["scenes", "--json"]))
    return {scene["name"]: frozenset(scene["effects"]) for scene in listed["scenes"]}


def check_scenes(names: Iterable[str], also: Collection[str] = ()) -> None:
    """Raise UsageError for a name that is no scene, no model's path and none of ``also``."""
    there = {*known_scenes(), *also}
    for name in names:
        if name not in there and not name.startswith(MODEL):
            raise UsageError(f"unknown scene {name}", cure=known(name, [*sorted(there), f"{MODEL}PATH"], "scenes"))


def planned(scenes: dict[str, frozenset[str]], seeds: dict[int, str], shape: Shape, work: Path) -> list[Case]:
    """The cases of every scene with every seed; the folder's name says what the capture was asked for."""
    size, jitter = f"{shape.width}x{shape.height}x{shape.frames}", shape.jitter.replace(":", "")
    cases = []
    for scene, effects in scenes.items():
        samples = shape.samples * (1 if effects & _CHANGES else STILL)
        name = Path(scene.removeprefix(MODEL)).stem if scene.startswith(MODEL) else scene
        for seed, split in seeds.items():
            folder = work / f"{name}-seed{seed}-{size}-{jitter}-{samples}"
            cases.append(Case(scene, split, folder, seed, samples))
    return cases


def open_case(case: Case) -> FrameSequence | None:
    """The captured sequence with its truth and REDRAWN, or None where one is not there or not finished."""
    try:
        sequence = open_sequence(case.folder)
        redrawn = redrawn_of(sequence)
        finished = sequence.reference is not None and len(sequence) == sequence.sequence_json.get("frames")
        finished = finished and redrawn is not None and len(redrawn) == len(sequence)
    except CltaaError:
        return None
    return sequence if finished else None


def capture(case: Case, shape: Shape) -> FrameSequence:
    """Draw a case, or what is missing of it; raises InternalError where the capture fails, with its own words above."""
    other, size = OTHER_JITTERS[shape.jitter == OTHER_JITTERS[0]], f"{shape.width}x{shape.height}"
    asked = ["--frames", str(shape.frames), "--size", size, "--seed", str(case.seed)]
    for folder, samples, jitter in ((case.folder, case.samples, shape.jitter), (case.folder / REDRAWN, 0, other)):
        told = ["-o", str(folder), "--reference", str(samples), "--jitter", jitter]
        run_cltaa(["capture", case.scene, *told, *asked])
    sequence = open_case(case)
    if sequence is None:
        raise InputMissing("the capture left no finished sequence", path=case.folder)
    return sequence
