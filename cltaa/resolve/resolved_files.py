"""What is written of each resolved frame: its result, what its input's file carries over, and debug views."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.exr.attributes import frame_attributes
from cltaa.exr.channels import Pixels
from cltaa.frames import Frame
from cltaa.resolve.carried_over import merged
from cltaa.resolve.debug import DebugViews
from cltaa.resolve.halves import image_channels, limit_halves, saturated_pixels
from cltaa.resolve.output import DEBUG, OutputFolder, Source
from cltaa.resolve.reading import Read
from cltaa.resolve.resolver import Resolver
from cltaa.sequences.streams import Writer


class ResolvedFiles:
    """Writes results into ``folder`` under the names of their inputs, and counts what a user is to hear of.

    ``undeclared`` are the attributes that no input declared and that are not made up for a result.
    """

    def __init__(
        self, folder: OutputFolder, resolver: Resolver, debug: DebugViews, *, undeclared: frozenset[str]
    ) -> None:
        self.folder = folder
        self._resolver, self._debug, self._undeclared = resolver, debug, undeclared
        self._numbers: set[int] = set()
        self.sizes: list[int] = []  # bytes of each file that is finished
        self._saturated: list[int] = []  # of each frame, from the threads that write
        self.repaired = 0  # pixels of the frames that were written whose colour was no usable number
        self.opaque = 0  # frames of those whose alpha is 1 everywhere

    @property
    def count(self) -> int:
        """How many frames were written, each counted once."""
        return len(self._numbers)

    @property
    def saturated(self) -> int:
        """Pixels as bright as the largest half, once the writer is closed."""
        return sum(self._saturated)

    def write(self, writer: Writer, read: Read, image: NDArray[Any]) -> None:
        """Queue the result ``image`` [H, W, 3 or 4], floats or halves, of the frame ``read`` and resolved last.

        Raises OutputError and StorageError, which may be those of an earlier image that was queued.
        """
        assert read.frame.path is not None
        views = self._debug.write(self.folder.folder / DEBUG, read.frame.index)
        path = self.folder.folder / read.frame.path.name
        attributes = merged(read.carried, resolved_attributes(read.frame, self._resolver), self._undeclared)
        finish = partial(self._finish, path, read.source)
        kept, windows = read.carried.channels, read.carried.windows
        writer.write(path, lambda: {**kept, **self._channels(image), **views}, attributes, then=finish, windows=windows)
        self._numbers.add(read.frame.index)
        self.repaired += read.unusable
        self.opaque += read.opaque

    def _finish(self, path: Path, source: Source) -> None:
        self.folder.finish(path, source)
        self.sizes.append(path.stat().st_size)

    def _channels(self, image: NDArray[Any]) -> dict[str, Pixels]:
        """The channels of a result, limited to what halves hold by the thread that writes it."""
        if image.dtype == np.float16:
            self._saturated.append(limit_halves(image))
        elif self._resolver.keeps_halves:
            self._saturated.append(saturated_pixels(image))
        return image_channels(image)


def resolved_attributes(frame: Frame, resolver: Resolver) -> dict[str, object]:
    """Attributes of a resolved image: those of its frame, and what resolved it."""
    made_by = {"cltaa:preset": resolver.preset.name, "cltaa:device": resolver.launcher.description}
    return {**frame_attributes(frame), **made_by}
