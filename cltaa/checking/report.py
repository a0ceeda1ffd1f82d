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
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.intake import intake_lines, open_intake
from cltaa.inputs.profile import Profile, correct, load_profile
from cltaa.inputs.profile_text import differences, option_text
from cltaa.progress import track

FRAMES = 12  # looked at unless asked otherwise: 11 pairs tell a gain of jitter to a few hundredths


class Report(msgspec.Struct, kw_only=True):
    """What ``cltaa check`` found; ``options`` reads the sequence right, ``profile`` is the same as data."""

    folder: str
    frames: int
    reading: list[str]
    findings: list[Finding]
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
    frames: int = FRAMES,
    step: int = 1,
) -> tuple[Report, Profile]:
    """Check the first ``frames`` frames of ``folder``, read as ``profile`` says; also return the profile that mends it.

    Raises what opening and reading raise.
    """
    intake = open_intake(folder, profile=profile, assignments=assignments, side_file=side_file, step=step)
    numbers = sorted(intake.declared)[:frames]
    sequence = ForeignSequence(folder, intake, numbers, strict=False)
    if "depth" not in intake.roles:
        sequence.refuse_result()
    read = [sequence.frame(number) for number in track(numbers, len(numbers), "reading")]
    found = check_frames(
        read,
        sequence.layouts[numbers[0]].display_size,
        has_camera=intake.has_camera,
        has_depth="depth" in intake.roles,
        has_jitter=intake.has_jitter,
    )
    findings = [_with_option(finding, intake.profile) for finding in check_files(intake) + found]
    mended = intake.profile
    for finding in findings:
        mended = correct(mended, finding.fix)
    base = load_profile(profile) if profile != "auto" else load_profile(intake.profile.name)
    changes = differences(mended, base)
    options = option_text(changes)
    if side_file is not None:
        options = f"--camera {shlex.quote(str(side_file))} {options}".strip()
    if step != 1:
        options = f"--step {step} {options}".strip()
    report = Report(
        folder=str(folder), frames=len(read), reading=[*intake_lines(intake)], findings=findings,
        options=f"--profile {profile if profile != 'auto' else intake.profile.name} {options}".strip(),
        profile=msgspec.to_builtins(mended),
    )  # fmt: skip
    return report, mended


def _with_option(finding: Finding, profile: Profile) -> Finding:
    if not finding.fix:
        return finding
    option = option_text(differences(correct(profile, finding.fix), profile))
    return msgspec.structs.replace(finding, option=option)
