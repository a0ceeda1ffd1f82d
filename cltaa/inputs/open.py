"""Open a folder of frames as a sequence, whether cltaa or another tool wrote it."""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Sequence as Many
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from cltaa.errors import CltaaError, UsageError, check_flags, known, public
from cltaa.frame import ASKED, Asked, Effect, format_effects, parse_effects
from cltaa.inputs.fitted_camera import with_fitted_cameras
from cltaa.inputs.found import find_effects, with_found
from cltaa.io.exr_frame import MATRICES
from cltaa.io.exr_read import read_any_header
from cltaa.io.names import Named, has_suffix, selection_of
from cltaa.io.numbered import OnBreak, files_in
from cltaa.io.sequence import RESOLVED, FrameSequence, open_sequence
from cltaa.printable import counted, shell_word

if TYPE_CHECKING:
    from cltaa.inputs.profile import Profile

PLACE = "{}"  # stands for the sequence's folder in a file name that applies to several sequences


@public("open")
def open_input(
    named: Named,
    *,
    profile: str | Path | Profile = "auto",
    assignments: Many[str] = (),
    side_file: str | Path | None = None,
    effects: Asked = "auto",
    **options: Any,
) -> FrameSequence:
    """Open a sequence as its profile says; ``options`` are those of ``open_sequence``, for files of any tool.

    ``named`` is a folder, a file, a pattern of files such as ``x.####.exr``, or several of these. ``profile`` is a
    name, a TOML file, or the profile that ``cltaa.check`` returns. ``effects`` replace the effects that the files
    declare; ``all`` and ``find`` declare none. Raises what ``open_sequence`` and ``open_intake`` raise, and UsageError
    for the output of a resolve.
    """
    for name in options.keys() - ARGUMENTS:
        raise UsageError(f"open takes no {name}", cure=known(name, sorted(ARGUMENTS), "arguments"))
    place = selection_of(named)
    if not isinstance(profile, str | Path):
        from cltaa.inputs.profile import load_profile

        profile = load_profile(profile)
        profile = "cltaa" if profile == load_profile("cltaa") else profile
    plain = not assignments and side_file is None and effects == "auto"
    if plain and str(profile) in ("auto", "cltaa") and is_own(place):
        own = open_sequence(place, **options)
        own.refuse_result()
        own.warn_of_truth()
        return own
    from cltaa.inputs.foreign import ForeignSequence
    from cltaa.inputs.intake import open_intake

    check_flags(verify=options.get("verify"))
    verify = options.pop("verify", True)
    intake = open_intake(place, profile=profile, assignments=assignments, side_file=side_file, **options)
    sequence = ForeignSequence(place.folder, intake, sorted(intake.declared), verify=verify)
    sequence.refuse_result()
    sequence.warn_of_truth()
    check_declared(sequence, effects)
    if not isinstance(effects, str):
        sequence = ForeignSequence(place.folder, intake, sorted(intake.declared), verify=verify, effects=effects)
    for _, error in sequence.unreadable():
        raise error
    return sequence


# All but what is opened.
ARGUMENTS = frozenset({*signature(open_input).parameters, *signature(open_sequence).parameters} - {"named", "options"})


def check_declared(sequence: FrameSequence, effects: Asked) -> None:
    """Raise UsageError for an invalid declaration, and if it would drop the vectors that alone tell what moves."""
    declared = isinstance(effects, set | frozenset) and effects <= {*Effect}
    if not declared and effects not in ASKED:
        expected = "auto, find, all or a set of effects"
        raise UsageError("no such declaration of effects", expected=expected, found=effects)
    without = "motion" in sequence.holds and not sequence.undeclared.isdisjoint(MATRICES)
    if not isinstance(effects, str) and Effect.MOTION not in effects and without:
        what, cure = "without matrices the vectors alone tell what moves", "declare motion too, or give --camera FILE"
        raise UsageError(what, path=sequence.folder, found=f"effects {format_effects(effects) or 'none'}", cure=cure)


def looked_for(sequence: FrameSequence, effects: Asked) -> bool:
    """Return True if the effects must be found in the pixels of ``sequence``, because none are declared."""
    return effects == "find" or (effects == "auto" and sequence.effects is None)


class Reading(msgspec.Struct, frozen=True, kw_only=True):
    """How a sequence is read: the options of ``open_input`` and its truth, as strings that a remote task can take."""

    profile: str = "auto"
    assignments: tuple[str, ...] = ()
    side_file: str | None = None
    truth: str | None = None  # folder of the truth, or a capture with reference/; None: reference/ of the sequence
    effects: str = "auto"  # or find, all, or a comma-separated list
    step: int = 1

    def open(self, folder: Path) -> FrameSequence:
        """Open a folder this way; raises what ``open_input`` raises."""
        named: Any = self.effects if self.effects in ASKED else parse_effects(self.effects)
        sequence = open_input(
            folder,
            profile=self.profile,
            assignments=self.assignments,
            side_file=self.side_file,
            step=self.step,
            effects=named,
        )
        sequence = with_fitted_cameras(sequence, named)
        if looked_for(sequence, named):
            sequence = with_found(sequence, find_effects(sequence))
        if self.truth is not None:
            from cltaa.inputs.foreign import open_pictures

            within = Path(self.truth) / "reference"
            sequence.truth = open_pictures(
                within if within.is_dir() else Path(self.truth),
                gaps=OnBreak.RESET,
                profile=self.profile,
                assignments=self.assignments,
            )
        return sequence

    def within(self, folder: Path) -> Reading:
        """Return a copy with ``folder`` in place of ``{}`` in its file names."""
        named = {"profile": self.profile, "side_file": self.side_file, "truth": self.truth}
        placed = {key: name and name.replace(PLACE, str(folder)) for key, name in named.items()}
        return msgspec.structs.replace(self, **placed)


DEFAULT_READING = Reading()  # cltaa's own files as they are, other tools' files by their headers


def readings(folders: Iterable[Path], asked: Reading) -> dict[Path, Reading]:
    """Return how to read each of several folders as ``asked``; profile, assignments and side file leave out cltaa's own
    beside others. Raises UsageError if one side file would apply to several sequences."""
    folders = list(dict.fromkeys(folders))
    spoken_of = [folder for folder in folders if not is_own(folder)] or folders
    if len(spoken_of) > 1 and asked.side_file is not None and PLACE not in asked.side_file:
        option = shell_word(f"{PLACE}/{Path(asked.side_file).name}")
        cure = f"write {PLACE} for the folder of each: --camera {option}"
        what = "--camera is of one sequence"
        raise UsageError(what, path=asked.side_file, found=counted(len(spoken_of), "sequence"), cure=cure)
    usual = {"profile": "auto", "assignments": (), "side_file": None}
    placed = {folder: asked.within(folder) for folder in folders}
    return {
        folder: how if folder in spoken_of else msgspec.structs.replace(how, **usual) for folder, how in placed.items()
    }


def is_own(named: Named) -> bool:
    """Return False if the first readable file is another tool's or has several parts, or if only subfolders hold files.

    cltaa's own reader reports errors of its files. The output of a resolve counts as cltaa's own, with any layers.
    """
    place = selection_of(named)
    files = files_in(place) if place.files is not None or place.folder.is_dir() else []
    if not files:
        return not place.folder.is_dir() or not any(has_suffix(path, ".exr") for path in place.folder.glob("*/*"))
    for file in files:
        try:
            header = read_any_header(file)
            several = bool(header.layout.windows)  # several parts: another tool has rewritten the file
            return not several and not {"cltaa:worldToView", RESOLVED}.isdisjoint(header.attributes)
        except CltaaError:
            continue
    return True
