"""Frames in which nothing moves, and resolvers that only accumulate: the recursion of the history and nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from cltaa.core.backend import Launcher
from cltaa.core.build import Storage
from cltaa.core.presets import Preset, load_preset, override
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect, Frame, Image
from tests.sequence_factory import make_camera

UNIT_ROUNDOFF = 2.0**-24  # of float32
STILL = frozenset({Effect.SKY})  # declares that nothing moves and nothing changes: plain accumulation
CAMERA = make_camera()


def still_frame(index: int, colour: Image, effects: frozenset[Effect] | None = STILL, **channels: Any) -> Frame:
    """A frame of ``colour`` [H, W, 3] seen by a camera that stands before a wall."""
    depth = np.full(colour.shape[:2], 4.0, np.float32)
    return Frame(index=index, colour=colour, depth=depth, camera=CAMERA, effects=effects, **channels)


def grey(values: Any) -> Image:
    """[H, W] as grey [H, W, 3] float32."""
    return np.repeat(np.asarray(values, np.float32)[..., None], 3, axis=-1)


def unfiltered() -> Preset:
    """The default preset, each sample taken as it was drawn."""
    return override(load_preset(), {"current_filter": "none"})


def accumulator(launcher: Launcher, weight: float = 0.0, storage: Storage = Storage.FLOAT, **changes: Any) -> Resolver:
    """A resolver of still frames: exponential with ``weight`` for the current sample, or the plain mean (0)."""
    values: dict[str, object] = {"accumulate": "count"}
    if weight:
        values |= {"accumulate": "exponential", "blend_weight": weight}
    return Resolver(override(unfiltered(), {**values, **changes}), launcher, strict=True, storage=storage)


def last_of(resolver: Resolver, images: Iterable[Image]) -> Image:
    """The result after the last of ``images``, which follow one another from frame 0."""
    result = None
    for index, image in enumerate(images):
        result = resolver.resolve(still_frame(index, image))
    assert result is not None
    return result


def looped(resolver: Resolver, images: Sequence[Image], count: int) -> Image:
    """The result after ``count`` still frames that show ``images`` in turn, uploaded once and not read in between."""
    for index in range(3):  # the third is built as all that follow
        resolver.resolve(still_frame(index, images[index % len(images)]))
    last = resolver.last
    assert last is not None
    launcher, layout, arguments = resolver.launcher, last.layout, dict(last.arguments)
    shown = []
    for image in images:
        shown.append(launcher.allocate((3, layout.rows, layout.stride), np.float32))
        with shown[-1].mapped(write=True) as planes:
            layout.inside(planes)[...] = np.moveaxis(image, -1, 0)
            layout.extend_edges(planes)
    for index in range(3, count):
        for read, written in (("history", "output"), ("history_count", "output_count")):
            arguments[read], arguments[written] = arguments[written], arguments[read]
        arguments["current"] = shown[index % len(images)]
        launcher.run("resolve", last.build, layout, arguments)
        if index % 1000 == 0:
            launcher.finish()
    launcher.finish()
    with arguments["output"].mapped(write=False) as planes:
        return np.moveaxis(layout.inside(planes).astype(np.float32), 0, -1)
