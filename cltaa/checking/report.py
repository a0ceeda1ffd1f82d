"""The whole check of a sequence: its files, its frames, and what would read it right."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from cltaa.checking.detector import check_frames
from cltaa.checking.files import check_files
from cltaa.checking.finding import Finding
from cltaa.checking.shots import Shot
from cltaa.checking.untold import untold
from cltaa.inputs.correction import correct
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.intake import Intake, intake_lines, open_with_gaps
from cltaa.inputs.notes import OPAQUE
from cltaa.inputs.profile import Profile, load_profile
from cltaa.inputs.profile_text import assignments_of, differences, option_text
from cltaa.printable import counted
from cltaa.progress import track
from cltaa.sequences.frame_numbers import FrameRange
from cltaa.sequences.pixel_statistics import is_opaque

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
    counts. What is wrong is read again as it is right, since a wrong depth hides a wrong jitter. Raises what opening
    and reading raise.
    """
    count, only = (frames, None) if isinstance(frames, int) else (None, frames)
    reading: dict[str, Any] = {"side_file": side_file, "step": step, "frames": only}
    first = intake = open_with_gaps(folder, profile=profile, assignments=assignments, **reading)
    name = profile if profile != "auto" else intake.profile.name
    base, findings = load_profile(name), list[Finding]()
    for _ in range(ROUNDS):
        known = {finding.name for finding in findings}
        seen, shot = _look(intake, folder, count)
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
        folder=str(folder), frames=len(shot.frames), reading=[*intake_lines(first)], findings=findings,
        untold=untold(shot), options=options, profile=msgspec.to_builtins(mended),
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


def _look(intake: Intake, folder: Path, count: int | None) -> tuple[list[Finding], Shot]:
    """What files and pixels say under one reading, and the frames so read."""
    numbers = sorted(intake.declared)[:count]
    sequence = ForeignSequence(folder, intake, numbers, strict=False)
    sequence.refuse_result()
    read = [sequence.frame(number) for number in track(numbers, len(numbers), "reading")]
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
