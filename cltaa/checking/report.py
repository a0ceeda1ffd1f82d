"""The whole check of a sequence: its files, its frames, and what would read it right."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from cltaa.checking.detector import check_frames
from cltaa.checking.files import check_files, unreadable
from cltaa.checking.finding import Finding
from cltaa.checking.shots import Shot
from cltaa.checking.untold import untold
from cltaa.errors import CltaaError, DataError, UsageError
from cltaa.frames import Frame
from cltaa.inputs.correction import correct
from cltaa.inputs.damage import Damaged, damaged_files
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.intake import Intake, intake_lines, open_with_gaps
from cltaa.inputs.notes import OPAQUE
from cltaa.inputs.profile import Profile, load_profile
from cltaa.inputs.profile_text import assignments_of, differences, option_text
from cltaa.inputs.roles import file_sets
from cltaa.printable import counted
from cltaa.progress import track
from cltaa.sequences.frame_numbers import FrameRange
from cltaa.sequences.pixel_statistics import is_opaque
from cltaa.sequences.problems import Problems

FRAMES = 12  # looked at unless asked otherwise: 11 pairs tell a gain of jitter to a few hundredths
ROUNDS = 6  # of looking and reading again: matrices, depth, its unit, vectors and jitter, then nothing


class Report(msgspec.Struct, kw_only=True):
    """What ``cltaa check`` found; ``options`` reads the sequence right, ``profile`` is the same as data.

    ``untold`` are conventions that could be wrong without a trace in these frames.
    """

    folder: str
    frames: int
    reading: list[str]
    findings: list[Finding]
    untold: list[str]
    options: str
    profile: dict[str, Any]

    @property
    def mistakes(self) -> list[Finding]:
        """Findings that are mistakes."""
        return [finding for finding in self.findings if finding.mistake]


def check_folder(
    folder: Path,
    *,
    profile: str = "auto",
    assignments: Sequence[str] = (),
    side_file: Path | None = None,
    frames: int | FrameRange = FRAMES,
    step: int = 1,
) -> tuple[Report, Profile]:
    """Check some frames of ``folder``, read as ``profile`` says; also return the profile that mends it.

    ``frames`` is how many from the first on, or the numbers of the first and the last, both included: then no other
    counts. What is wrong is read again as it is right, since a wrong depth hides a wrong jitter. Files that cannot be
    read are findings, and left out. Raises what opening raises, and reading where no frame can be read.
    """
    count, only = (frames, None) if isinstance(frames, int) else (None, frames)
    damaged = damaged_files(file_sets(folder))
    without = {path: file.number for path, file in damaged.items()}
    reading: dict[str, Any] = {"side_file": side_file, "step": step, "frames": only, "damaged": without}
    try:
        first = intake = open_with_gaps(folder, profile=profile, assignments=assignments, **reading)
    except CltaaError as error:
        raise _weightier(error, damaged.values()) from None
    wrong = _wrong_with(first, damaged.values(), only)
    name = profile if profile != "auto" else intake.profile.name
    base, findings = load_profile(name), list[Finding]()
    for _ in range(ROUNDS):
        known = {finding.name for finding in findings}
        seen, shot = _look(intake, folder, count, wrong)
        found = [finding for finding in seen if finding.name not in known]
        findings += [_with_option(finding, intake.profile) for finding in found]
        mended = intake.profile
        for finding in found:
            mended = correct(mended, finding.fix)
        changes = differences(mended, base)
        if mended == intake.profile:
            break
        again = assignments_of(changes)
        intake = open_with_gaps(folder, profile=name, assignments=again, **reading)
    options = f"{profile_options(name, side_file, step)} {option_text(changes)}".strip()
    report = Report(
        folder=str(folder), frames=len(shot.frames), reading=[*intake_lines(first)],
        findings=unreadable(wrong) + findings, untold=untold(shot), options=options,
        profile=msgspec.to_builtins(mended),
    )  # fmt: skip
    return report, mended


def profile_options(profile: str, side_file: Path | None, step: int) -> str:
    """The options that read a folder by ``profile`` and with what no profile says, for a shell."""
    words = ["--profile", profile]
    if step != 1:
        words += ["--step", str(step)]
    if side_file is not None:
        words += ["--camera", str(side_file)]
    return shlex.join(words)


def _weightier(error: CltaaError, damaged: Iterable[Damaged]) -> CltaaError:
    """What to tell where a folder cannot be opened without its damaged files: what is wrong with one of them.

    That is of the frame that the error misses, where it is of one; other words that mean nothing are told first.
    """
    errors = {file.number: file.error for file in reversed([*damaged])}  # of a frame the first
    if error.frame in errors:
        return errors[error.frame]
    return error if isinstance(error, UsageError) or not errors else errors[min(errors)]


def _wrong_with(intake: Intake, damaged: Iterable[Damaged], frames: FrameRange | None) -> Problems:
    """What is wrong with files that would be read, or of whose set none can be, within ``frames``."""
    wrong = Problems()
    read = {place.files for places in intake.roles.values() for place in places}
    for file in damaged:
        asked = frames is None or frames[0] <= file.number <= frames[1]
        if asked and (file.label in read or file.label not in intake.sets):
            wrong.add(file.number, file.error)
    return wrong


def _look(intake: Intake, folder: Path, count: int | None, wrong: Problems) -> tuple[list[Finding], Shot]:
    """What files and pixels say under one reading, and the frames so read; those that cannot be are ``wrong``.

    Raises DataError where none can be.
    """
    numbers = sorted(intake.declared)[:count]
    sequence = ForeignSequence(folder, intake, numbers, strict=False)
    sequence.refuse_result()
    read, failed = list[Frame](), list[DataError]()
    for number in track(numbers, len(numbers), "reading"):
        try:
            read.append(sequence.frame(number))
        except DataError as error:
            wrong.add(number, error)
            failed.append(error)
    if not read:
        raise failed[0]
    known = Shot(
        read, sequence.layouts[numbers[0]].display_size, has_depth="depth" in intake.roles,
        has_camera=intake.has_camera, has_jitter=intake.has_jitter,
    )  # fmt: skip
    found = check_frames(
        read, known.window, has_depth=known.has_depth, has_camera=known.has_camera, has_jitter=known.has_jitter
    )
    if all(is_opaque(frame.alpha) for frame in read):
        evidence = counted(len(read), "frame")
        found.append(Finding(name="alpha-opaque", mistake=False, confidence=0.99, what=OPAQUE, evidence=evidence))
    return check_files(intake) + found, known


def _with_option(finding: Finding, profile: Profile) -> Finding:
    if not finding.fix:
        return finding
    option = option_text(differences(correct(profile, finding.fix), profile))
    return msgspec.structs.replace(finding, option=option)
