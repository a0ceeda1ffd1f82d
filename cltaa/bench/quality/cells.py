"""Finished cells of the table, one file a sequence and preset, kept until something that decides them changes."""

from __future__ import annotations

import hashlib
from pathlib import Path

import msgspec

from cltaa.bench.quality.judge import Judged
from cltaa.bench.quality.redrawn import redrawn_of
from cltaa.devices.kernel_files import code_sha256
from cltaa.files.atomic import atomic_path, make_folder
from cltaa.judging.decided_by import content_sha256
from cltaa.parameters.presets import Preset
from cltaa.sequences.sources import Sequence

FORMAT = 2  # of the file and of the way to judge


class Cell(msgspec.Struct, kw_only=True):
    """One cell: what was judged, by which code, and the outcome."""

    inputs: str  # SHA-256 over sequence and how it is read, truth, REDRAWN, preset, judged frames and FORMAT
    code: str  # of the kernels and the package
    judged: Judged


class Cells:
    """The cells of one sequence in ``folder``. With ``any_code`` those of other versions of the code are taken too."""

    def __init__(
        self, folder: Path, sequence: Sequence, settled: int, flip_every: int, *, any_code: bool = False
    ) -> None:
        self._folder, self._any_code = make_folder(folder), any_code
        redrawn = redrawn_of(sequence)
        files = content_sha256(sequence, [] if redrawn is None else [redrawn])
        # A step of 1 goes unsaid, so that cells of before it was known still count.
        step = "" if sequence.step == 1 else f" step {sequence.step}"
        self._base = f"{FORMAT} {settled} {flip_every} {files}{step}"

    def get(self, name: str, preset: Preset | None) -> Judged | None:
        """The cell of a preset (None: of the single samples), or None where it must be measured."""
        try:
            cell = msgspec.json.decode(self._path(name).read_bytes(), type=Cell)
        except (OSError, msgspec.MsgspecError):
            return None
        same_code = self._any_code or cell.code == code_sha256()
        return cell.judged if same_code and cell.inputs == self._inputs(preset) else None

    def put(self, name: str, preset: Preset | None, judged: Judged) -> None:
        """Keep a cell; raises StorageError where it cannot be written."""
        cell = Cell(inputs=self._inputs(preset), code=code_sha256(), judged=judged)
        with atomic_path(self._path(name)) as temporary:
            temporary.write_bytes(msgspec.json.format(msgspec.json.encode(cell), indent=1))

    def _path(self, name: str) -> Path:
        return self._folder / f"{name.replace(' ', '-')}.json"

    def _inputs(self, preset: Preset | None) -> str:
        what = b"" if preset is None else msgspec.json.encode([preset.choices, preset.settings])
        if preset is not None and preset.published:  # else it goes unsaid, as a step of 1 does
            what += b" published"
        return hashlib.sha256(self._base.encode() + what).hexdigest()
