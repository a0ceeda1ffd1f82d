"""What the files alone say: precision that depth and motion need and their channels do not have."""

from __future__ import annotations

from cltaa.checking.finding import Finding
from cltaa.exr.layout import LOSSLESS
from cltaa.inputs.intake import Intake
from cltaa.inputs.parts import read_any_header
from cltaa.inputs.roles import shown_name
from cltaa.printable import counted
from cltaa.sequences.frame_numbers import ranges
from cltaa.sequences.problems import Problems


def unreadable(wrong: Problems) -> list[Finding]:
    """Findings about files that cannot be read, one for each thing that is ``wrong``."""
    evidence = "left out of all else that is found"
    return [
        Finding(name="file-unreadable", mistake=True, confidence=0.99, what=line, evidence=evidence)
        for line in wrong.lines
    ]


def check_files(intake: Intake) -> list[Finding]:
    """Findings about compression that loses, half-precision channels, and frames and channels that are not there."""
    found = []
    if intake.missing:
        what = f"frames are missing: {ranges(intake.missing)}; render them again, or cltaa resolve --gaps reset"
        evidence = "the files' names"
        found.append(Finding(name="frames-missing", mistake=True, confidence=0.99, what=what, evidence=evidence))
    for role in ("depth", "motion"):
        places = intake.roles.get(role, ())
        for label in {place.files for place in places}:
            files = [path for number, path in intake.sets[label].items() if number in intake.layouts]
            codecs = {read_any_header(path, chunks=False).layout.compression for path in files}
            if lossy := sorted(codecs - LOSSLESS):
                what = f"compression {', '.join(lossy)} loses precision that {role} needs"
                evidence = f"{role} {' '.join(place.channel for place in places)} in {counted(len(files), 'file')}"
                found.append(Finding(name="file-lossy", mistake=True, confidence=0.99, what=what, evidence=evidence))
        types = {intake.first[place.files].channels[place.channel] for place in places}
        if "half" in types:
            what = f"{role} is half precision: 11 bits, wrong by up to 1/2048 of its size"
            evidence = " ".join(shown_name(place, len(intake.sets) > 1) for place in places)
            found.append(
                Finding(name=f"{role}-half", mistake=role == "depth", confidence=0.99, what=what, evidence=evidence)
            )
    for note in intake.notes:
        name = note.split(":")[0].replace(" ", "-")
        found.append(Finding(name=name, mistake=False, confidence=0.99, what=note, evidence="the files' headers"))
    return found
