"""Twin of ``gather.cl``: pixels on their way back through the kept frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from cltaa.core.build import Build, Record, kept_planes
from cltaa.core.parameters import GatherFit
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import Pixel, Resolved, current_pixel, sample_share
from cltaa.reference.gather import add_side, gather_samples, in_front, resolve_gathered
from cltaa.reference.gather_fit import Gathered, first_sample
from cltaa.reference.gather_sides import Layers, layers_of, side_of, sides_of
from cltaa.reference.gather_thin import recall_thin
from cltaa.reference.gather_track import Track, untold
from cltaa.reference.neighbourhood import Surface, nearest_surface
from cltaa.reference.planes import extend_stored, read_rows, store_resolved
from cltaa.reference.real import Array, quiet
from cltaa.reference.reprojection import Motion, surface_motion

FARTHEST = 1  # its place among the layers of a pixel, after the nearest


def begin_layer(s: Surface, layers: Layers, w: Array, build: Build, frame: Record, *, far: bool) -> Gathered:
    """The sums of a layer before its way back, with the current sample if it shows the layer; of all but the farthest
    one also if it shows what lies behind."""
    front = ~layers.edge | (s.centre > layers.cut)
    if far:
        return first_sample(w, ~front, ~front, build, frame)
    counted = front | ~front if layers.over is None else layers.edge & (s.centre <= layers.over)
    return first_sample(w, counted, front, build, frame)


@dataclass(slots=True)
class Gathering:
    """Pixels on their way back through the kept frames; one layer of each, or the nearest, the farthest and, from the
    back on, those between them."""

    pixel: Pixel
    motion: Motion
    layers: Layers
    slots: Array
    sides: list[tuple[Surface, Layers, Gathered, Track]]
    none: Gathered  # what stands for the farthest layer where there is one

    @classmethod
    def begin(cls, build: Build, layout: Layout, given: Mapping[str, Any], *, parted: bool) -> Gathering:
        """Before the first kept frame, as ``given`` to the kernel; only with ``parted`` may a side be two surfaces."""
        current, closeness, motion, frame, settings = (
            given[name] for name in ("current", "closeness", "motion", "frame", "settings")
        )
        rows = read_rows(current, closeness, motion, build, layout, frame)
        p = current_pixel(rows, given["alpha"], given["reactive"], build, layout, frame)
        s = nearest_surface(*rows, build, settings["edge_tolerance"])
        m = surface_motion(s, build, layout, frame)
        slots = given["kept"].reshape(-1, kept_planes(build.steps), layout.rows, layout.stride)
        layers, told = layers_of(*rows, s, settings), given["past"][: given["frames"]]
        w = sample_share(p.own, build, settings)
        if build.choices.gather_fit is not GatherFit.LAYERS:
            g, far = (begin_layer(s, layers, w, build, frame, far=side) for side in (False, True))
            return cls(p, m, layers, slots, [(s, layers, g, Track.of(s, build))], far)
        seen = layers
        s, layers = recall_thin(s, layers, slots, told, build, layout, settings)
        parts = [layers, layers]
        if parted:
            open_here = seen.edge & untold(s.u, s.v) if build.steps.own_motion else seen.edge
            sides = sides_of(s, replace(layers, edge=open_here), closeness, layout, frame, settings)
            parts = [replace(part, edge=layers.edge) for part in (sides.front, sides.back)]
            parts += [sides.far_between, sides.near_between]
        followed = []
        for place, part in enumerate(parts):
            far_one = place == FARTHEST
            g = begin_layer(s, part, w, build, frame, far=far_one)
            side = side_of(s, part, p.own, current, closeness, motion, build, layout, frame, settings, far=far_one)
            if far_one:
                add_side(g, side, p.own, build, settings)
            followed.append((side.surface, side.layers, g, Track.of(side.surface, build)))
        return cls(p, m, layers, slots, followed, followed[FARTHEST][2])

    def add(
        self,
        past: Any,
        build: Build,
        layout: Layout,
        frame: Record,
        settings: Record,
        *,
        before: int = 0,
        recent: int = 0,
    ) -> None:
        """The samples of some kept frames, those that follow on what was gathered."""
        for place, (s, layers, sums, track) in enumerate(self.sides):
            gather_samples(
                self.slots,
                past,
                sums,
                self.pixel,
                s,
                layers,
                build,
                layout,
                frame,
                settings,
                far_only=place == FARTHEST,
                track=track,
                before=before,
                recent=0 if place else recent,
            )

    def resolved(self, build: Build, layout: Layout, settings: Record) -> Resolved:
        """The pixel from the samples gathered so far."""
        far = self.sides[FARTHEST][2] if len(self.sides) > 1 else self.none
        for _, layers, sums, _ in self.sides[FARTHEST + 1 :]:
            far = in_front(sums, far, layers, build, settings)
        return resolve_gathered(self.near, far, self.layers, self.pixel, self.motion, build, layout, settings)

    @property
    def moves(self) -> Array:
        """Where the nearest or the farthest layer moves on its own; before it is followed."""
        near, far = self.sides[0][3].own, self.sides[len(self.sides) > 1][3].own
        own: Array = near | (self.layers.edge & far)
        return own

    @property
    def near(self) -> Gathered:
        """The sums of the nearer side, or of the only one."""
        return self.sides[0][2]


@quiet
def gather(
    build: Build,
    layout: Layout,
    *,
    current: Array,
    closeness: Array,
    motion: Array | None,
    alpha: Array | None,
    reactive: Array | None,
    kept: Array,
    past: Any,
    frames: int,
    output: Array,
    output_count: Array,
    frame: Record,
    settings: Record,
) -> None:
    """Resolve one frame from padded planes and ``frames`` kept ones into ``output`` and ``output_count``."""
    gathering = Gathering.begin(build, layout, locals(), parted=True)
    gathering.add(past[:frames], build, layout, frame, settings)
    store_resolved(gathering.resolved(build, layout, settings), build, layout, frame, output, output_count)
    extend_stored(build, layout, output[: 3 + build.steps.alpha], output_count)
