"""Whether two sequences that are compared show the same, and one is a truth: by headers and records, never by pixels.

Two pictures of one size may be of anything, and a bad resolve of the right scene can be further from the truth than a
picture of another. So nothing is guessed: where the files do not say what they show, nothing is said.
"""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np

from cltaa.files.manifest import CAPTURE, Manifest, file_sha256
from cltaa.inputs.pictures import stated
from cltaa.judging.comparison import Comparison
from cltaa.printable import printable
from cltaa.sequences.numbered import NumberedFiles
from cltaa.sequences.sources import RESOLVED, Sequence

VIEW = "cltaa:worldToView"
PRIMARIES = "chromaticities"  # of red, green, blue and white, x and y each
SAME_PRIMARIES = 1e-3  # they are commonly stated in three digits
NO_TRUTH = (
    "which has no truth in a folder reference/: the figures are no errors; capture it with --reference 64, or render"
    " the truth there, with many samples a pixel"
)
SAME_VIEW = 1e-6  # of the largest number of the two matrices; a still camera's are equal to the bit


def doubts(comparison: Comparison, *, followed: bool = False) -> list[str]:
    """Why A may not show what B shows, or B is no truth: the weightiest alone, empty where nothing speaks against it.

    With ``followed`` the motion that B's files tell counts too, and so how they are read.
    Raises what reading a header and a manifest raises.
    """
    truth = stated(comparison.reference.path(comparison.reference.first))
    if comparison.capture is not None and RESOLVED in truth:
        return [f"the truth of B, {printable(comparison.reference.folder)}, was written by a resolve: capture it again"]
    if comparison.of_itself:
        return []
    test = comparison.test
    other: NumberedFiles = comparison.reference if comparison.capture is None else comparison.capture
    number = test.first if test.first in other.numbers else other.first
    ours, theirs = (stated(path) for path in (test.path(test.first), other.path(number)))
    scenes = [str(attributes.get("cltaa:scene", "")) for attributes in (ours, theirs)]
    if all(scenes) and scenes[0] != scenes[1]:
        return [f"A shows scene {printable(scenes[0])} and B scene {printable(scenes[1])}"]
    views = [attributes.get(VIEW) for attributes in (ours, theirs)]
    if test.first == number and _differ(*views):
        return [f"A and B are seen by different cameras in frame {number}"]
    if _other_primaries(ours.get(PRIMARIES), truth.get(PRIMARIES)):
        return ["A and B state different primaries (attribute chromaticities), and neither is converted"]
    if comparison.capture is None and (without := _no_truth(comparison, truth)):
        return [f"{without}, {NO_TRUTH}"]
    if comparison.capture is not None and _of_other_frames(test, comparison.capture):
        return [
            "A was resolved from other frames than those of B: from another seed or jitter, or before a new capture"
        ]
    if followed and comparison.capture is not None and _read_otherwise(test, comparison.capture):
        return [
            "A was resolved from B as other options read it: give --profile, --input, --camera and --step as then,"
            " for by B's depth, vectors and matrices things are followed"
        ]
    return []


def _differ(one: object, other: object) -> bool:
    """True where both are matrices, and not the same."""
    if not (isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and one.shape == other.shape):
        return False
    return bool(np.abs(one - other).max() > SAME_VIEW * max(np.abs(one).max(), np.abs(other).max()))


def _other_primaries(one: object, other: object) -> bool:
    """True where both are stated, and not the same."""
    if not (isinstance(one, tuple) and isinstance(other, tuple) and len(one) == len(other)):
        return False
    return bool(np.abs(np.subtract(one, other)).max() > SAME_PRIMARIES)


def _no_truth(comparison: Comparison, attributes: Mapping[str, object]) -> str | None:
    """How it is known that B, of such attributes, holds what a resolve begins with; None where nothing says so."""
    test, reference = comparison.test, comparison.reference
    entry = Manifest(test.folder).entries.get(test.path(test.first).name)
    source = reference.path(comparison.truth_number(test.first))
    if entry is not None and entry.input_sha256 == file_sha256(source):
        return "A was resolved from the frames of B"
    # The truth lies in a folder of the capture's, which has the record.
    drawn = (reference.folder / CAPTURE).exists() and RESOLVED not in attributes
    return "B is a capture of one sample a pixel" if drawn else None


def _of_other_frames(test: NumberedFiles, capture: NumberedFiles) -> bool:
    """True where the manifest of a resolve names another input than the capture records, for the first frame."""
    entry = Manifest(test.folder).entries.get(test.path(test.first).name)
    recorded = capture.sha256(test.first) if test.first in capture.numbers else None
    return entry is not None and recorded is not None and entry.input_sha256 != recorded


def _read_otherwise(test: NumberedFiles, capture: Sequence) -> bool:
    """True where the manifest of a resolve tells another profile or step, or for its first frame other matrices."""
    manifest = Manifest(test.folder)
    entry = manifest.entries.get(test.path(test.first).name)
    if manifest.settings is None or entry is None or test.first not in capture.numbers:
        return False
    reading = json.loads(json.dumps(capture.reading))  # as it comes back from a manifest
    otherwise = any(manifest.settings.get(key) != value for key, value in reading.items())
    return otherwise or entry.beside_sha256 != capture.beside_sha256(test.first)
