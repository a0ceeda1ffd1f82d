"""Check a whole sequence: its files, its frames, and the options that read it correctly."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from cltaa.errors import CltaaError, DataError, UsageError, public
from cltaa.frame import Frame
from cltaa.inputs.convert import correct, unit_px
from cltaa.inputs.foreign import ForeignSequence
from cltaa.inputs.intake import OPAQUE, SHOWN, Damaged, Intake, damaged_files, intake_lines, open_with_gaps
from cltaa.inputs.profile import (
    Depth,
    Profile,
    Units,
    assignments_of,
    differences,
    load_profile,
    option_text,
    profile_names,
)
from cltaa.inputs.roles import file_sets, shown_name
from cltaa.io.exr_layout import LOSSLESS
from cltaa.io.exr_read import read_any_header
from cltaa.io.names import Named, selection_of
from cltaa.io.numbered import FrameRange, Problems
from cltaa.io.pixel_statistics import is_opaque
from cltaa.lab.check.camera import (
    check_agreement,
    check_disagreement,
    check_late_vectors,
    check_structure,
    check_travel,
    check_upside_down,
    check_zeroes,
    sound,
)
from cltaa.lab.check.colour import check_channels, check_colour, check_exposure
from cltaa.lab.check.depth import AS_DECLARED, check_depth, check_depth_scale, check_sign, planes_decide, tell_device
from cltaa.lab.check.depth_travel import check_kind
from cltaa.lab.check.hypotheses import ASKED, DOUBTFUL, Finding, mistake
from cltaa.lab.check.jitter import check_jitter, check_mean, check_size, settled_shifts
from cltaa.lab.check.motion import JITTERED, LEAST_EFFECT_PX, LEAST_FILLED, check_motion, may_leak, without_leak
from cltaa.lab.check.projection_jitter import check_held_jitter, check_projection_jitter
from cltaa.lab.check.registration import Shot, measure_shifts
from cltaa.lab.check.unverifiable import unverifiable
from cltaa.printable import counted, shell_word, written
from cltaa.process import is_own
from cltaa.progress import shown_progress, track


def check_files(intake: Intake) -> list[Finding]:
    """Return findings about lossy compression, half-precision channels, and missing frames and channels."""
    found = []
    if intake.missing:
        what = f"frames are missing: {intake.missing_text}; render them again, or cltaa resolve --gaps reset"
        found.append(mistake("frames-missing", what, "the files' names", 0.99))
    for role in ("depth", "motion"):
        places = intake.roles.get(role, ())
        for label in {place.files for place in places}:
            files = [path for number, path in intake.sets[label].items() if number in intake.layouts]
            codecs = {read_any_header(path, chunks=False).layout.compression for path in files}
            if lossy := sorted(codecs - LOSSLESS):
                what = f"compression {', '.join(lossy)} loses precision that {role} needs"
                evidence = f"{role} {written(place.channel for place in places)} in {counted(len(files), 'file')}"
                found.append(mistake("file-lossy", what, evidence, 0.99))
        types = {intake.first[place.files].channels[place.channel] for place in places}
        if "half" in types:
            what = f"{role} is half precision: 11 bits, wrong by up to 1/2048 of its size"
            evidence = written(shown_name(place, intake.sets) for place in places)
            wrong = role == "depth"
            found.append(Finding(name=f"{role}-half", mistake=wrong, confidence=0.99, what=what, evidence=evidence))
    for note in intake.notes:
        name, what = note.split(":")[0].replace(" ", "-"), note.removesuffix(SHOWN)
        found.append(Finding(name=name, mistake=False, confidence=0.99, what=what, evidence="the files' headers"))
    return found


def check_frames(
    frames: Sequence[Frame],
    window: tuple[int, int] | None = None,
    *,
    has_camera: bool = True,
    has_depth: bool = True,
    has_jitter: bool = True,
    unit: tuple[float, float] = (1.0, 1.0),
    jittered: int = 0,
    depth: Depth = AS_DECLARED,
) -> list[Finding]:
    """Return findings about frames read as their profile says; ``has_*`` is False for data that the reader filled in.

    ``window`` is the width and height of the display window if the frames show a region of it; ``unit``, ``jittered``
    and ``depth`` are how their vectors and depth were read.

    Later checks rely on earlier ones: if matrices or depth are wrong, checks that need them do not run.
    """
    found = [*check_channels(frames, has_camera=has_camera, has_depth=has_depth)]
    found += check_colour(frames) + check_exposure(frames)
    if has_camera:
        structure, mend = check_structure(frames)
        found += structure
        if structure and mend is None:
            has_camera = False
        elif mend is not None:
            frames = [replace(frame, camera=mend(frame.camera)) for frame in frames]
    if has_depth and has_camera:
        found += check_depth(frames, depth)
    elif has_depth and not frames[0].camera.orthographic:
        found += check_sign([frame.depth for frame in frames])
    window = window or (frames[0].width, frames[0].height)
    shot = Shot(
        frames,
        window,
        has_camera=has_camera,
        has_depth=has_depth,
        has_jitter=has_jitter,
        unit=unit,
        jittered=jittered,
    )
    two_planes = ("depth-inverse", "depth-device")
    if not shot.narrow:
        told = any(finding.name.startswith("depth-") for finding in found)
        if has_depth and has_camera and not told and not planes_decide(frames, depth):
            found += check_kind(shot, depth)
        found = [tell_device(shot, finding, depth) if finding.name in two_planes else finding for finding in found]
    found = _excused(shot, found + _check_motions(shot, found, depth))
    if not any(finding.name.startswith("jitter") and finding.settled.mistake for finding in found):
        found += check_size(shot)
    return [finding.settled for finding in found if finding.confidence >= ASKED or not finding.mistake]


def _check_motions(shot: Shot, before: Sequence[Finding], depth: Depth) -> list[Finding]:
    """Return findings that need two frames; each check relies on those before it."""
    wrong = {finding.name.partition("-")[0] for finding in before if finding.mistake}
    found, held = list[Finding](), list[Finding]()
    if shot.has_camera and (found := check_projection_jitter(shot)):
        return found
    if shot.narrow:
        return check_mean(shot)
    if shot.has_camera and "depth" not in wrong:
        late, mended = check_late_vectors(shot)
        if late:
            return late + _check_motions(mended, before, depth)
        held = check_held_jitter(shot)
        if any(finding.settled.mistake for finding in held):
            return held
        # The next round, which reads the corrected files, runs the rest.
        if found := check_zeroes(shot) or check_agreement(shot):
            return found
        # A wrong camera and a wrong scale of depth both change the parallax; a wrong camera changes it more.
        found = check_travel(shot) or check_upside_down(shot) or check_depth_scale(shot, depth)
    wrong |= {finding.name.partition("-")[0] for finding in found if finding.settled.mistake}
    if held and not found:  # shifts measured with a camera that may contain the jitter are inconclusive
        return held
    if not wrong & {"camera", "depth"}:
        jitter = None  # of the pixels, where the vectors' part in it is known
        if (less := without_leak(shot)) is not shot:
            jitter = check_jitter(less)
            # Only with the right jitter can its part in the vectors be found.
            if any(finding.settled.mistake for finding in jitter):
                return found + jitter
        _, anchored = measure_shifts(shot)
        wrong_vectors = check_motion(shot, settled_shifts(shot))
        found += wrong_vectors
        # Shifts measured with wrong vectors say nothing about the jitter.
        if anchored or not wrong_vectors:
            found += _unless_leaking(shot, jitter if jitter is not None else check_jitter(shot))
        if not wrong_vectors:
            found += check_disagreement(shot)
    return found


LIKE_LEAKS = {"jitter-absent": 1, "jitter-scaled-2": -1, "jitter-negated": 2}  # whose shift is left by such a leak


def _unless_leaking(shot: Shot, found: Sequence[Finding]) -> list[Finding]:
    """Make a jitter in ``found`` a question if vectors that may contain it would leave the same shift."""
    if not may_leak(shot):
        return list(found)
    names = {leak: name for name, leak in shot.leaks.items()}
    made = list[Finding]()
    for finding in found:
        leak = LIKE_LEAKS.get(finding.name)
        if leak in names:
            or_else = f"; or {JITTERED[names[leak]]}, which takes {LEAST_FILLED + 1} frames to tell"
            finding = msgspec.structs.replace(finding, evidence=finding.evidence + or_else, confidence=DOUBTFUL)
        made.append(finding)
    return made


def _excused(shot: Shot, found: Sequence[Finding]) -> list[Finding]:
    """Adjust the finding of constant vectors in ``found``: no mistake if they are right, doubtful without matrices and
    depth, and dropped if another finding corrects the vectors or the matrices that may support them."""
    if not any(finding.name == "motion-constant" for finding in found):
        return list(found)
    if any({"motion", "camera"} & finding.fix.keys() or "source" in finding.fix.get("jitter", {}) for finding in found):
        return [finding for finding in found if finding.name != "motion-constant"]
    right, told = _agrees(shot), shot.has_camera and shot.has_depth
    change = {"mistake": False} if right else {} if told else {"confidence": DOUBTFUL}
    return [
        msgspec.structs.replace(finding, **change) if finding.name == "motion-constant" else finding
        for finding in found
    ]


def _agrees(shot: Shot) -> bool:
    """Return True if the vectors agree with matrices and depth, as for a plane that the camera moves along; without
    those, if the pictures match under the vectors."""
    if not shot.pairs:
        return False
    if shot.has_camera and shot.has_depth:
        apart = np.concatenate([np.abs(pair.own - pair.camera_motion()) for pair in shot.pairs], axis=1)
        apart = apart[:, np.isfinite(apart).all(0)]
        return apart.size > 0 and float(np.median(apart)) < LEAST_EFFECT_PX
    fits, _ = measure_shifts(shot)
    left = [np.abs(fit.shift - pair.jitter_change).max() for fit, pair in zip(fits, shot.pairs, strict=True) if fit]
    return len(left) == len(fits) and max(left) < (STEADY_PX if shot.has_jitter else 1.0)


STEADY_PX = 0.3  # largest remaining shift of the picture under right vectors
FRAMES = 12  # default number of frames: 11 pairs give the gain of jitter to a few hundredths
ROUNDS = 6  # rounds of checking and reading again: matrices, depth, its unit, vectors, jitter, and a clean one


class Report(msgspec.Struct, kw_only=True):
    """The result of ``cltaa check``; ``options`` reads the sequence correctly, ``profile`` is the same as data.

    ``unverifiable`` lists conventions that could be wrong without a trace in these frames.
    """

    folder: str
    frames: int
    reading: list[str]
    findings: list[Finding]
    unverifiable: list[str]
    options: str
    profile: dict[str, Any]

    @property
    def mistakes(self) -> list[Finding]:
        """Findings that are mistakes."""
        return [finding for finding in self.findings if finding.mistake]

    @property
    def questions(self) -> list[Finding]:
        """Findings that may be mistakes; they have no fix, and rule out a clean result."""
        return [finding for finding in self.findings if finding.question]


@public("check")
def check_folder(
    named: Named,
    *,
    profile: str | Path | Profile = "auto",
    assignments: Sequence[str] = (),
    side_file: str | Path | None = None,
    frames: int | FrameRange = FRAMES,
    step: int = 1,
) -> tuple[Report, Profile]:
    """Check some frames of a sequence, read as ``profile`` says; also return the corrected profile.

    ``frames`` is a count from the first frame on, or the numbers of the first and the last one, both included. After
    each round the files are read again with all corrections, because a wrong depth hides a wrong jitter. Unreadable
    files become findings and are left out. Raises what opening raises, and what reading raises if no frame is readable.
    """
    count, only = (frames, None) if isinstance(frames, int) else (None, frames)
    if count is not None and count < 1:
        raise UsageError("no frames to check", expected="a number of 1 or more, or (first, last)", found=count)
    place = selection_of(named)
    damaged = damaged_files(file_sets(place))
    without = {path: file.number for path, file in damaged.items()}
    reading: dict[str, Any] = {"side_file": side_file, "step": step, "frames": only, "damaged": without}
    try:
        first = intake = open_with_gaps(place, profile=profile, assignments=assignments, **reading)
    except CltaaError as error:
        raise _weightier(error, damaged.values()) from None
    wrong = _wrong_with(first, damaged.values(), only)
    name = intake.profile.name if profile == "auto" else str(profile)
    if isinstance(profile, Profile):  # options can name only a profile that comes with cltaa, plus the differences
        name = profile.name if profile.name in profile_names() else "cltaa"
    base, findings, tried = load_profile(name), list[Finding](), list[Profile]()
    for _ in range(ROUNDS):
        tried.append(intake.profile)
        seen, frames_read, told = _look(intake, place.folder, count, wrong)
        known = {finding.name for finding in findings}
        # What is found again still stands, unless mending it leads back.
        found = [one for one in seen if one.name not in known or correct(intake.profile, one.fix) not in tried]
        findings += [_with_option(finding, intake.profile) for finding in found]
        mended = intake.profile
        for finding in found:
            mended = correct(mended, finding.fix)
        changes = differences(mended, base)
        if mended == intake.profile:
            break
        again = assignments_of(changes)
        intake = open_with_gaps(place, profile=name, assignments=again, **reading)
    told["has_camera"] &= all(map(sound, frames_read))
    lost = [mistake("file-unreadable", line, "left out of all else that is found", 0.99) for line in wrong.lines]
    options = f"{profile_options(name, side_file, step)} {option_text(changes)}".strip()
    with shown_progress("checking", shown=is_own()):
        not_verified = unverifiable(Shot(frames_read, **told))
    report = Report(
        folder=str(place),
        frames=len(frames_read),
        reading=[*intake_lines(first)],
        findings=lost + findings,
        unverifiable=not_verified,
        options=options,
        profile=msgspec.to_builtins(mended),
    )
    return report, mended


def profile_options(profile: str, side_file: str | Path | None, step: int) -> str:
    """Return the options, for a shell, that read a folder by ``profile``, ``side_file`` and ``step``."""
    words = ["--profile", profile]
    if step != 1:
        words += ["--step", str(step)]
    if side_file is not None:
        words += ["--camera", str(side_file)]
    return " ".join(map(shell_word, words))


def _weightier(error: CltaaError, damaged: Iterable[Damaged]) -> CltaaError:
    """Return the error to report for a folder that cannot be opened without its damaged files.

    A damaged file of the frame named in ``error`` comes first, then a UsageError, then the first damaged file.
    """
    errors = {file.number: file.error for file in reversed([*damaged])}  # the first error of each frame
    if error.frame in errors:
        return errors[error.frame]
    return error if isinstance(error, UsageError) or not errors else errors[min(errors)]


def _wrong_with(intake: Intake, damaged: Iterable[Damaged], frames: FrameRange | None) -> Problems:
    """Return the errors, within ``frames``, of files with a role, or of sets without a readable file."""
    wrong = Problems()
    read = {place.files for places in intake.roles.values() for place in places}
    for file in damaged:
        asked = frames is None or frames[0] <= file.number <= frames[1]
        if asked and (file.label in read or file.label not in intake.sets):
            wrong.add(file.number, file.error)
    return wrong


def _look(
    intake: Intake, folder: Path, count: int | None, wrong: Problems
) -> tuple[list[Finding], list[Frame], dict[str, Any]]:
    """Return the findings of files and pixels under one reading, the frames, and the other arguments of their Shot.

    Adds unreadable frames to ``wrong``. Raises DataError if no frame is readable.
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
    told: dict[str, Any] = {
        "window": sequence.layouts[numbers[0]].display_size,
        "has_depth": "depth" in intake.roles,
        "has_camera": intake.has_camera,
        "has_jitter": intake.has_jitter,
        "unit": unit_px(intake.profile.motion.units, sequence.layouts[numbers[0]].display_size),
        "jittered": intake.profile.motion.jittered,
    }
    with shown_progress("checking", shown=is_own()):  # moves on a terminal; nobody knows how far it is
        found = check_frames(read, **told, depth=intake.profile.depth)
    if intake.profile.motion.units is Units.PIXELS:
        found = [_by_unit(finding, told["window"]) for finding in found]
    if all(is_opaque(frame.alpha) for frame in read):
        evidence = counted(len(read), "frame")
        found.append(Finding(name="alpha-opaque", mistake=False, confidence=0.99, what=OPAQUE, evidence=evidence))
    return check_files(intake) + found, read, told


def _by_unit(finding: Finding, window: tuple[int, int]) -> Finding:
    """Correct vectors in UV or NDC by their unit, not by a number of pixels: it holds for pictures of every size."""
    unit = next((unit for unit in (Units.UV, Units.NDC) if f"-{unit}" in finding.name), None)
    if unit is None or "motion" not in finding.fix:
        return finding
    keys = finding.fix["motion"]
    scale = [factor / pixels for factor, pixels in zip(keys["scale"], unit_px(unit, window), strict=True)]
    return msgspec.structs.replace(finding, fix={"motion": {**keys, "units": unit.value, "scale": scale}})


def _with_option(finding: Finding, profile: Profile) -> Finding:
    """Return ``finding`` with the option that corrects it; without one if the profile already has that value."""
    option = option_text(differences(correct(profile, finding.fix), profile))
    return msgspec.structs.replace(finding, option=option, fix=finding.fix if option else {})
