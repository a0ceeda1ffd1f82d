"""Sequences of ``cltaa bench quality``: given ones, and those that ``cltaa capture`` draws.

The two packages communicate only by their command lines (docs/decisions/01).
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import NamedTuple

from cltaa.errors import CltaaError, InputMissing, UsageError
from cltaa.frame import Effect
from cltaa.io.numbered import ranges
from cltaa.io.sequence import FrameSequence, ImageSequence, open_sequence
from cltaa.process import run_cltaa


def by_name(paths: Iterable[Path], what: str) -> dict[str, Path]:
    """Return paths of ``what`` by their last part, which names them in tables; raises UsageError for equal names."""
    named: dict[str, Path] = {}
    for path in paths:
        if named.setdefault(path.name, path) != path:
            told, cure = f"two {what} of one name, which tables go by", "rename one of them"
            raise UsageError(told, path=path, found=named[path.name], cure=cure)
    return named


REDRAWN = "again"  # subfolder of a sequence with the same frames drawn with another jitter


def redrawn_of(sequence: FrameSequence) -> ImageSequence | None:
    """Return the frames of ``sequence`` drawn again, or None without such a folder.

    Raises InputMissing and DataError for a folder that does not match.
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
MODEL = "file:"  # prefix of a scene name that is the path of a model
OTHER_JITTERS = ("halton:64", "r2:64")  # jitter of the capture REDRAWN: the second if the sequence has the first
# Without any of these nothing changes from frame to frame, a resolve converges, and the truth needs STILL times as many
# samples to remain better.
_CHANGES = {*Effect} - {Effect.SKY, Effect.HDR, Effect.THIN, Effect.ALPHA, Effect.NOISE}
STILL = 4


class Shape(NamedTuple):
    """Arguments of every capture."""

    width: int
    height: int
    frames: int
    samples: int  # of the truth; STILL times as many for scenes in which nothing changes
    jitter: str  # sample positions, as cltaa capture reads them


class Case(NamedTuple):
    """One sequence of the table."""

    scene: str
    split: str  # TRAIN or HELD_OUT: whether presets were tuned on it; GIVEN: unknown
    folder: Path
    seed: int = 0
    samples: int = 0  # of the truth, if it is drawn

    @property
    def key(self) -> str:
        """The folder's name, unique within the table."""
        return self.folder.name

    @property
    def of_a_model(self) -> bool:
        """True if a model is drawn, whose file may change: then only the capture knows whether its frames are right."""
        return self.scene.startswith(MODEL)

    @property
    def title(self) -> str:
        """The scene's name in tables: for a model its file name only."""
        return f"{MODEL}{Path(self.scene).name}" if self.of_a_model else self.scene


@cache
def known_scenes() -> dict[str, frozenset[str]]:
    """Return every scene that ``cltaa scenes`` lists, with its effects."""
    listed = json.loads(run_cltaa(["scenes", "--json"]))
    return {scene["name"]: frozenset(scene["effects"]) for scene in listed["scenes"]}


def planned(scenes: dict[str, frozenset[str]], seeds: dict[int, str], shape: Shape, work: Path) -> list[Case]:
    """Return a case for every scene and seed; the folder's name contains the arguments of the capture.

    Raises UsageError for two models of one name.
    """
    size, jitter = f"{shape.width}x{shape.height}x{shape.frames}", shape.jitter.replace(":", "")
    cases = []
    by_name((Path(scene.removeprefix(MODEL)) for scene in scenes if scene.startswith(MODEL)), "models")
    for scene, effects in scenes.items():
        samples = shape.samples * (1 if effects & _CHANGES else STILL)
        name = Path(scene.removeprefix(MODEL)).name  # of a model with its suffix, which no scene has
        for seed, split in seeds.items():
            folder = work / f"{name}-seed{seed}-{size}-{jitter}-{samples}"
            cases.append(Case(scene, split, folder, seed, samples))
    return cases


def open_case(case: Case) -> FrameSequence | None:
    """Open the captured sequence with its truth and REDRAWN; None if one is missing or unfinished."""
    try:
        sequence = open_sequence(case.folder)
        redrawn = redrawn_of(sequence)
        finished = sequence.reference is not None and len(sequence) == sequence.sequence_json.get("frames")
        finished = finished and redrawn is not None and len(redrawn) == len(sequence)
    except CltaaError:
        return None
    return sequence if finished else None


def capture(case: Case, shape: Shape) -> FrameSequence:
    """Draw the missing parts of a case; raises InternalError for a failed capture, which has printed its own error."""
    other, size = OTHER_JITTERS[shape.jitter == OTHER_JITTERS[0]], f"{shape.width}x{shape.height}"
    asked = ["--frames", str(shape.frames), "--size", size, "--seed", str(case.seed)]
    for folder, samples, jitter in ((case.folder, case.samples, shape.jitter), (case.folder / REDRAWN, 0, other)):
        told = ["-o", str(folder), "--reference", str(samples), "--jitter", jitter]
        run_cltaa(["capture", case.scene, *told, *asked])
    sequence = open_case(case)
    if sequence is None:
        raise InputMissing("the capture left no finished sequence", path=case.folder)
    return sequence
