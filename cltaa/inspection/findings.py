"""What is in a captured sequence, and what is wrong with it, file by file and together."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

from cltaa.errors import CltaaError
from cltaa.exr.attributes import FrameHeader
from cltaa.exr.channels import COLOUR, check_float_channels, frame_channels
from cltaa.exr.layout import Layout
from cltaa.exr.read import ImageHeader, read_header, read_image
from cltaa.files.manifest import recorded_hashes
from cltaa.inspection.facts import Inspection, describe_headers, describe_layouts, describe_reference, size_of
from cltaa.inspection.promises import Witness
from cltaa.sequences.frame_numbers import even_step, one_range
from cltaa.sequences.numbered import numbered_files
from cltaa.sequences.pixel_statistics import ChannelStatistics, needless_channels, pixel_problems
from cltaa.sequences.problems import Problems
from cltaa.sequences.sources import RESOLVED


def inspect_folder(
    folder: Path, *, pixels: bool = False, step: int = 1, advance: Callable[[int, int], None] | None = None
) -> Inspection:
    """Look at every file of a sequence. What is wrong is listed, not raised.

    With ``pixels`` the files are also decoded, and held against the SHA-256 that is recorded for them and against the
    effects that they declare.
    ``advance(done, total)`` is called after every file. Raises InputMissing or DataError only where there is no one
    sequence to look at.
    """
    _, name, paths = numbered_files(folder)
    result = Inspection(folder=str(folder), name=name, first=min(paths), last=max(paths), frames=len(paths))
    result.problems += _missing(sorted(paths), step)
    recorded = _recorded(folder, result.problems) if pixels else {}
    layouts: dict[int, Layout] = {}
    headers: dict[int, FrameHeader] = {}
    witness, wrong = Witness(), Problems()
    for done, (number, path) in enumerate(sorted(paths.items()), start=1):
        try:
            header = read_header(path)
            layouts[number] = header.layout
            result.resolved_by = str(header.attributes.get(RESOLVED, ""))
            _check_channels(header)
            if not result.resolved_by or "cltaa:jitterPx" in header.attributes:  # other tools' files may have none
                headers[number] = FrameHeader(path, header.attributes, header.layout)
            if pixels:
                channels = read_image(path, sha256=recorded.get(path.name))[0]
                for channel, plane in channels.items():
                    result.statistics.setdefault(channel, ChannelStatistics()).add(plane)
                if not result.resolved_by:
                    witness.look(headers[number], channels)
        except CltaaError as error:
            wrong.add(number, error)
        result.disk_bytes += size_of(path)
        if advance is not None:
            advance(done, len(paths))
    result.problems += wrong.lines
    describe_layouts(result, layouts)
    if headers:
        describe_headers(result, headers)
    describe_reference(result, folder, paths)
    result.problems += pixel_problems(result.statistics) + needless_channels(result.statistics)
    if pixels and headers and not result.resolved_by:
        declared = next(iter(headers.values())).effects
        result.problems += witness.broken(declared)
        result.idle = witness.idle(declared)
    return result


def _missing(numbers: list[int], step: int) -> list[str]:
    """The problem of frames that are not there, if any."""
    gaps = [one_range(one + 1, other - 1) for one, other in pairwise(numbers) if other != one + step]
    if not gaps:
        return []
    apart, what = even_step(numbers), f"frames missing: {', '.join(gaps)}"
    return [what if apart == 1 else f"{what}; those there are {apart} apart: --step {apart}"]


def _recorded(folder: Path, problems: list[str]) -> dict[str, str]:
    """The hashes that files must have; a record that cannot be read is among the ``problems``."""
    try:
        return recorded_hashes(folder)
    except CltaaError as error:
        problems.append(str(error))
        return {}


def _check_channels(header: ImageHeader) -> None:
    """Refuse a frame without the channels that it needs: an image that a resolve wrote needs no depth."""
    if RESOLVED in header.attributes:
        check_float_channels(header.layout, COLOUR)
    else:
        frame_channels(header.layout)
