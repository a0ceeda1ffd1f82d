"""The sequences of ``cltaa bench quality``: those that are there, and those that ``cltaa capture`` draws as a child.

The two packages know each other by their command lines alone (docs/decisions/0001).
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import NamedTuple

from cltaa.bench.quality.redrawn import REDRAWN, redrawn_of
from cltaa.child_command import run_cltaa
from cltaa.errors import CltaaError, InputMissing, UsageError, known
from cltaa.frames import Effect
from cltaa.sequences.sources import Sequence, open_sequence

TRAIN, HELD_OUT, GIVEN = "train", "held-out", "given"
MODEL = "file:"  # begins the name of a scene that is a model's path
OTHER_JITTERS = ("halton:64", "r2:64")  # of the capture REDRAWN: the second where the sequence itself has the first
# Without any of these nothing changes from frame to frame, and the truth has to be better than any resolve can get.
_CHANGES = {*Effect} - {Effect.SKY, Effect.HDR, Effect.THIN, Effect.ALPHA}


class Shape(NamedTuple):
    """What every capture is asked for."""

    width: int
    height: int
    frames: int
    samples: int  # of the truth
    still_samples: int  # of the truth of scenes in which nothing changes
    jitter: str  # sample positions, as cltaa capture reads them


class Case(NamedTuple):
    """One sequence of the table."""

    scene: str
    split: str  # TRAIN, HELD_OUT or GIVEN: whether the presets were tuned on it, as far as that is known
    folder: Path

    @property
    def key(self) -> str:
        """Name of the folder, unique within the table."""
        return self.folder.name

    @property
    def title(self) -> str:
        """The scene as the table names it: a model by its file alone, wherever that lies."""
        return f"{MODEL}{Path(self.scene).name}" if self.scene.startswith(MODEL) else self.scene


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
    size = f"{shape.width}x{shape.height}x{shape.frames}"
    return [
        Case(scene, split, work / f"{_stem(scene)}-seed{seed}-{size}-{shape.jitter.replace(':', '')}-{truth}")
        for scene, effects in scenes.items()
        for truth in (shape.samples if effects & _CHANGES else shape.still_samples,)
        for seed, split in seeds.items()
    ]


def _stem(scene: str) -> str:
    return Path(scene.removeprefix(MODEL)).stem if scene.startswith(MODEL) else scene


def open_case(case: Case) -> Sequence | None:
    """The captured sequence with its truth and REDRAWN, or None where one is not there or not finished."""
    try:
        sequence = open_sequence(case.folder)
        redrawn = redrawn_of(sequence)
        finished = sequence.reference is not None and len(sequence) == sequence.sequence_json.get("frames")
        finished = finished and redrawn is not None and len(redrawn) == len(sequence)
    except CltaaError:
        return None
    return sequence if finished else None


def capture(case: Case, seed: int, shape: Shape) -> Sequence:
    """Draw a case, or what is missing of it; raises InternalError where the capture fails, with its own words above."""
    truth = case.folder.name.rpartition("-")[2]
    other = OTHER_JITTERS[shape.jitter == OTHER_JITTERS[0]]
    for folder, samples, jitter in ((case.folder, truth, shape.jitter), (case.folder / REDRAWN, "0", other)):
        run_cltaa([
            "capture", case.scene, "-o", str(folder), "--frames", str(shape.frames),
            "--size", f"{shape.width}x{shape.height}", "--reference", samples, "--seed", str(seed),
            "--jitter", jitter,
        ])  # fmt: skip
    sequence = open_case(case)
    if sequence is None:
        raise InputMissing("the capture left no finished sequence", path=case.folder)
    return sequence
