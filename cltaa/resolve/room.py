"""Whether the results that are left to be written find room on the disk, told once some show how large they are."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from cltaa.printable import bytes_of, counted, printable

TOLD_AFTER = 2  # files, of which frames of one sequence differ little


class Room:
    """Looks once whether ``count`` results fit into ``folder``; a guess, so that it warns and refuses nothing."""

    def __init__(self, folder: Path, count: int) -> None:
        """Nothing is looked at before results are there."""
        self._folder, self._count, self._looked = folder, count, False

    def look(self, sizes: Sequence[int]) -> None:
        """Warn on standard error if as many bytes a file as ``sizes``, of those that are finished, will not fit."""
        finished = len(sizes)
        if self._looked or finished < TOLD_AFTER:
            return
        self._looked = True
        try:
            free = shutil.disk_usage(self._folder).free
        except OSError:  # a folder that is gone: the next file tells
            return
        left = self._count - finished
        wanted = left * sum(sizes) / finished
        if wanted > free:
            frames = f"{counted(left, 'frame')} left will take about {bytes_of(wanted)}, {bytes_of(free)} are free"
            cure = "free some space; a run that ends for want of it goes on by the same command"
            print(f"cltaa: warning: {printable(self._folder)}: {frames}: {cure}", file=sys.stderr)
