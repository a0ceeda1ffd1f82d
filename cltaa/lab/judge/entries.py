"""Entries of a leaderboard: results of a resolve on standard sequences, one folder for each, judged together."""

from __future__ import annotations

import math
import sys
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from cltaa.errors import DataError, InputMissing, UsageError, known
from cltaa.inputs.foreign import is_png
from cltaa.inputs.open import Reading, is_own, readings
from cltaa.io.atomic import make_folder
from cltaa.io.content import read_text
from cltaa.io.names import number_of
from cltaa.io.numbered import FrameRange, OnBreak, chosen_numbers, missing_from, named_frames, numbered_files, ranges
from cltaa.io.preset_file import read_preset
from cltaa.io.video import USUAL_RATE, import_av, open_video, rate_of
from cltaa.lab.judge.comparison import Comparison, doubts, pair_up
from cltaa.lab.judge.metrics import Metric, import_cvvdp, jod, mean_of
from cltaa.lab.judge.one_pass import judge, mean_alpha, summary_of
from cltaa.printable import counted, printable

Row = dict[str, Any]

FACTS = "entry.toml"
LARGEST_FACTS = 1 << 16  # bytes


class Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An entry's description of itself; every field is optional."""

    name: str = ""
    version: str = ""
    settings: str = ""
    device: str = ""
    milliseconds: float | None = None  # per frame


@dataclass(frozen=True, slots=True)
class Entry:
    """One row of the table: its name, its facts, and its folder for each sequence, by name."""

    name: str
    facts: Facts
    folders: Mapping[str, Path]


@dataclass(frozen=True, slots=True)
class Round:
    """A sequence and the results of each entry that has it, all on the same frames."""

    name: str
    sequence: Path
    entries: list[Entry]
    comparisons: list[Comparison]
    numbers: list[int]
    lacking: list[int]  # frames that are asked for, and not all have

    @property
    def in_time(self) -> bool:
        """True if all frames are consecutive, so that they can be scored over time."""
        capture = self.comparisons[0].capture
        return capture is not None and len(self.numbers) > 1 and not missing_from(self.numbers, capture.step)


def divided(paths: Sequence[Path]) -> tuple[list[Path], dict[str, Path]]:
    """Return the folders of entries, and of sequences by name; raises UsageError for no sequence or a repeated name."""
    sequences = [path for path in paths if (path / "reference").is_dir()]
    if not sequences:
        raise UsageError(
            "--table: no captured sequence among the folders",
            expected="ENTRY... SEQUENCE..., a SEQUENCE with its truth in reference/",
            cure="make one: cltaa capture corridor -o corridor --size 320x180 --jitter halton:8 --reference 64",
        )
    names = [sequence.resolve().name for sequence in sequences]
    if twice := [name for name in names if names.count(name) > 1]:
        raise UsageError(f"--table: two sequences are called {twice[0]}", cure="name their folders apart")
    return [path for path in paths if path not in sequences], dict(zip(names, sequences, strict=True))


def read_entry(folder: Path, sequences: Collection[str]) -> Entry:
    """Read the entry in a folder: one subfolder of frames for each sequence, or the frames of a single sequence.

    Raises InputMissing if it has none of the sequences, DataError for a damaged ``entry.toml``.
    """
    if not folder.is_dir():
        raise InputMissing("no such folder", path=folder)
    folders = {name: folder / name for name in sequences if (folder / name).is_dir()}
    if not folders and len(sequences) == 1 and any(number_of(path) is not None for path in folder.iterdir()):
        folders = dict.fromkeys(sequences, folder)
    if not folders:
        expected = f"folders {', '.join(sequences)}"
        raise InputMissing("an entry of none of the sequences", path=folder, expected=expected)
    facts = read_facts(folder / FACTS)
    return Entry(facts.name or folder.resolve().name, facts, folders)


def read_facts(path: Path) -> Facts:
    """Read an entry's facts; empty without a file. Raises DataError for an invalid one."""
    if not path.exists():
        return Facts()
    try:
        said = tomllib.loads(read_text(path, "the facts of an entry", LARGEST_FACTS))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise DataError(f"not TOML: {error}", path=path) from None
    for key, value in said.items():
        if key not in Facts.__struct_fields__:
            raise DataError(f"unknown key {key}", path=path, cure=known(key, Facts.__struct_fields__, "keys"))
        number = isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= sys.float_info.max
        if not (number if key == "milliseconds" else isinstance(value, str)):
            expected = "a number above 0" if key == "milliseconds" else "a text in quotes"
            raise DataError(f"{key} has no such value", path=path, expected=expected, found=value)
    return Facts(**said)


def numbered(folder: Path) -> dict[int, Path]:
    """Return the frames in a folder by number, PNGs if it has no EXR; raises what ``numbered_files`` does."""
    try:
        return numbered_files(folder, ".png" if is_png(folder) else ".exr")[2]
    except DataError as error:  # a pattern of names would be no entry
        cure = "leave the frames of one there, a file each"
        raise DataError(error.what, path=error.path, frame=error.frame, found=error.found, cure=cure) from None


@contextmanager
def resolved_by_us(
    presets: Sequence[str],
    sequences: Mapping[str, Path],
    side_files: Mapping[str, str | None],
    reading: Mapping[str, Any],
) -> Iterator[list[Entry]]:
    """Resolve with our own presets, with no declared effects, and yield their entries in a temporary folder.

    Other tools' sequences are opened by ``reading``, as ``pair_up`` opens them; cltaa's own without its profile.
    """
    from cltaa.pipeline.folder import resolve_folder

    with TemporaryDirectory(prefix="cltaa-table-") as folder:
        entries = []
        read = {preset: read_preset(preset) for preset in presets}  # all, before the first is resolved
        for place, (preset, settings) in enumerate(read.items()):
            folders = {name: Path(folder) / str(place) / name for name in sequences}
            for name, output in folders.items():
                own = is_own(sequences[name])
                how = {key: reading[key] for key in reading if key in ("step", "verify") or not own}
                how |= {"side_file": side_files[name]}
                resolve_folder(sequences[name], output, settings, effects="find", layers=(), reading=how)
            entries.append(Entry(preset, Facts(settings="nothing declared"), folders))
        yield entries


def rounds(
    entries: Sequence[Entry],
    sequences: Mapping[str, Path],
    frames: int | FrameRange | None,
    side_files: Mapping[str, str | None],
    **reading: Any,
) -> list[Round]:
    """Return each sequence with the entries that have it, paired over their common frames: the range ``frames``, or
    the first this many.

    Raises InputMissing if they have no frame in common, UsageError for frames that none has, and what ``pair_up``
    raises.
    """
    found = []
    for name, sequence in sequences.items():
        there = [entry for entry in entries if name in entry.folders]
        files = [numbered(entry.folders[name]) for entry in there]
        truth = set(numbered(sequence / "reference"))
        shared = sorted(truth.intersection(*files))
        numbers, asked = shared, frames
        if isinstance(asked, int):
            numbers = shared[:asked]
            asked = (min(truth), numbers[-1]) if numbers else None
        elif asked is not None:
            numbers = [number for number in shared if asked[0] <= number <= asked[1]]
            numbers = numbers or (chosen_numbers(shared, asked, sequence) if shared else [])
        if not numbers:
            have = "; ".join(f"{entry.name} {ranges(sorted(one))}" for entry, one in zip(there, files, strict=True))
            raise InputMissing(f"the entries of {name} have no frame in common", path=sequence, found=have or "none")
        tests = [tuple(one[number] for number in numbers) for one in files]
        # A list of one file would mean a picture named by itself.
        folders = [test if len(test) > 1 else test[0].parent for test in tests]
        how = {**reading, "frames": (numbers[0], numbers[-1]), "gaps": OnBreak.RESET}
        paired = pair_up(folders, sequence, side_file=side_files[name], **how)
        for each in paired:
            if each.region is not None:
                expected, shown = (images.layouts[images.first].size for images in (each.reference, each.test))
                what, cure = "an entry shows another region than the sequence", "resolve its whole frames"
                raise DataError(what, path=each.test.folder, expected=expected, found=shown, cure=cure)
        lacking = [n for n in sorted(truth - {*shared}) if asked is None or asked[0] <= n <= asked[1]]
        found.append(Round(name, sequence, there, paired, numbers, lacking))
    return found


def warnings_of(one: Round) -> list[str]:
    """Return doubts about the entries of a sequence, and the frames that are not judged, a line each."""
    named = zip(one.entries, one.comparisons, strict=True)
    told = [f"{entry.name}: {doubt}" for entry, each in named for doubt in doubts(each, followed=one.in_time)]
    left = [f"not judged: {named_frames(one.lacking)}, which not all have"] if one.lacking else []
    return [f"{one.name}: {printable(line)}" for line in (*told, *left)]


def judged_entries(
    paths: Sequence[Path],
    ours: Sequence[str],
    metrics: tuple[Metric, ...],
    frames: int | FrameRange | None,
    *,
    stops: float,
    cvvdp: bool,
    film: Path | None,
    side_file: Path | None,
    **reading: Any,
) -> tuple[list[Row], list[str]]:
    """Return a row for each entry and preset of ``ours`` on each captured sequence of ``paths``, and the warnings.

    Raises what ``divided``, ``read_entry`` and ``rounds`` raise, and UsageError for a package that ``cvvdp`` or
    ``film`` needs.
    """
    folders, sequences = divided(paths)
    entries = [read_entry(folder, sequences) for folder in folders]
    names = [*(entry.name for entry in entries), *dict.fromkeys(ours)]
    if twice := [name for name in names if names.count(name) > 1]:
        raise UsageError(f"--table: two entries are called {twice[0]}", cure=f"give one another name in its {FACTS}")
    without = [name for name in sequences if not ours and not any(name in entry.folders for entry in entries)]
    if without:
        what, cure = "no entry to judge on this sequence", "name one, or presets of ours by --ours default,fast"
        raise UsageError(what, path=sequences[without[0]], cure=cure)
    allotted = readings(sequences.values(), Reading(side_file=None if side_file is None else str(side_file)))
    side_files = {name: allotted[sequence].side_file for name, sequence in sequences.items()}
    if cvvdp:
        import_cvvdp()
    if film is not None:
        import_av()
        make_folder(film)
    if ours:  # reports what is wrong with entries before the presets are resolved
        entered = {name: sequences[name] for name in sequences if any(name in entry.folders for entry in entries)}
        rounds(entries, entered, frames, side_files, **reading)
    with resolved_by_us(ours, sequences, side_files, reading) as own:
        played = rounds([*entries, *own], sequences, frames, side_files, **reading)
        rows = [row for one in played for row in _judged(one, metrics, stops, cvvdp=cvvdp)]
        for one in played if film is not None else ():
            assert film is not None
            _write_film(film / f"{one.name}.mp4", one, stops)
        warnings = [line for one in played for line in warnings_of(one)]
    return rows, warnings


def _judged(one: Round, metrics: tuple[Metric, ...], stops: float, *, cvvdp: bool) -> list[Row]:
    found = judge(one.comparisons, metrics, stops, in_time=one.in_time)
    rows = []
    for entry, comparison, judged in zip(one.entries, one.comparisons, found.tests, strict=True):
        summary = summary_of(comparison, judged, found, metrics)
        facts = msgspec.structs.asdict(entry.facts)
        row: Row = {
            "sequence": one.name,
            "entry": entry.name,
            **{key: value for key, value in facts.items() if key != "name" and value not in ("", None)},
            "frames": one.numbers,
            **{key: summary[key] for key in ("mean", "alpha", "video", "equal_quality_samples") if key in summary},
        }
        if cvvdp and one.in_time:
            test, truth = ([side.image(n) for n in one.numbers] for side in (comparison.test, comparison.reference))
            row["cvvdp"] = jod(test, truth, float(_rate_of(one)), stops)
        rows.append(row)
    return rows


def means_of(rows: Sequence[Row]) -> list[Row]:
    """Return the means over all of several sequences, for the entries that have all of them; none of one sequence."""
    count = len({row["sequence"] for row in rows})
    means: list[Row] = []
    if count < 2:
        return means
    for name in dict.fromkeys(row["entry"] for row in rows):
        of_it = [row for row in rows if row["entry"] == name]
        if len(of_it) == count:
            row: Row = {"sequence": f"mean of {counted(count, 'sequence')}", "entry": name}
            for part in ("mean", "video"):
                if all(part in one for one in of_it):
                    row[part] = {key: _mean(key, [one[part][key] for one in of_it]) for key in of_it[0][part]}
            if all("alpha" in one for one in of_it):
                row["alpha"] = mean_alpha(one["alpha"] for one in of_it)
            if all("cvvdp" in one for one in of_it):
                row["cvvdp"] = _mean("cvvdp", [one["cvvdp"] for one in of_it])
            means.append(row | {key: of_it[0][key] for key in ("milliseconds",) if key in of_it[0]})
    return means


def _mean(name: str, values: Sequence[float]) -> float:
    """Return the mean of the values that are not NaN."""
    known = [value for value in values if not math.isnan(value)]
    return mean_of(name, known) if known else math.nan


def _rate_of(one: Round) -> Fraction:
    """Return the frames per second of a sequence."""
    capture = one.comparisons[0].capture
    return USUAL_RATE if capture is None else rate_of(capture.attributes, capture.sequence_json, capture.step)


MAGNIFIED = 2  # magnification in a film, without interpolation


def _write_film(path: Path, one: Round, stops: float) -> None:
    """Write the entries of a sequence and its truth side by side as an MP4, magnified without a filter."""
    from cltaa.io.display import beside, to_picture

    first = one.comparisons[0]
    names = [*(entry.name for entry in one.entries), "truth"]
    images = [*(comparison.test for comparison in one.comparisons), first.reference]
    with open_video(path, _rate_of(one)) as video:
        for number in one.numbers:
            pictures = [to_picture(source.image(number)[..., :3], stops) for source in images]
            video.add(beside([p.repeat(MAGNIFIED, 0).repeat(MAGNIFIED, 1) for p in pictures], names))
