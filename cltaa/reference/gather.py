"""Twin of ``gather.cl``: each pixel from the samples that the frames of the ring rendered inside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cltaa.core.build import Build, Record, ring_planes
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import Pixel, Resolved, current_pixel
from cltaa.reference.colour import filled_texels, sample_is_missing, whole_samples
from cltaa.reference.gather_fit import SampleSums, resolve_gathered
from cltaa.reference.gather_samples import add_side, begin_layer, gather_samples
from cltaa.reference.gather_sides import Layers, find_subpixel_feature, layers_of, side_of
from cltaa.reference.gather_track import Track
from cltaa.reference.neighbourhood import Surface, nearest_surface
from cltaa.reference.planes import extend_stored, read_rows, store_resolved
from cltaa.reference.real import Array, Run, quiet
from cltaa.reference.reprojection import Motion, surface_motion


@dataclass(slots=True)
class Gathering:
    """Pixels while they are followed back through the frames in the ring: the nearer layer of each and, at depth edges,
    the farther."""

    pixel: Pixel
    motion: Motion
    layers: Layers
    slots: Array
    sides: list[tuple[Surface, Layers, SampleSums, Track]]
    far: SampleSums  # sums of the farther side; empty without edges

    @classmethod
    def begin(cls, run: Run, given: Mapping[str, Any]) -> Gathering:
        """State before the first frame of the ring, from the arguments ``given`` to the kernel."""
        current, inverse_depth, motion = (given[name] for name in ("current", "inverse_depth", "motion"))
        current, alpha = whole_samples(current, given["alpha"], run)
        rows = read_rows(current, inverse_depth, motion, run)
        p = current_pixel(rows, alpha, given["reactive"], run)._replace(
            missing=sample_is_missing(current, run.layout), filled=filled_texels(current, alpha, run.build, run.layout)
        )
        s = nearest_surface(*rows, run)
        m = surface_motion(s, run)
        slots = given["ring"].reshape(-1, ring_planes(run.steps), run.layout.rows, run.layout.stride)
        layers, past = layers_of(*rows, s, run), given["past"][: given["frames"]]
        s, layers = find_subpixel_feature(s, layers, slots, past, run)
        near, far = (begin_layer(s, layers, p, run, far=side) for side in (False, True))
        fronts, backs = (
            side_of(s, layers, p.own, current, inverse_depth, motion, run, far=side) for side in (False, True)
        )
        add_side(far, backs, p.own, run)
        sides = [
            (side.surface, side.layers, g, Track.of(side.surface, run.build))
            for side, g in ((fronts, near), (backs, far))
        ]
        return cls(p, m, layers, slots, sides, far)

    def add(self, past: Any, run: Run, *, before: int = 0, recent: int = 0) -> None:
        """Add the samples of further frames in the ring, which follow those gathered so far."""
        for place, (s, layers, sums, track) in enumerate(self.sides):
            gather_samples(
                self.slots,
                past,
                sums,
                self.pixel,
                s,
                layers,
                run,
                far_only=place > 0,
                track=track,
                before=before,
                recent=0 if place else recent,
            )

    def resolved(self, run: Run) -> Resolved:
        """The pixel from the samples gathered so far."""
        return resolve_gathered(self.near, self.far, self.layers, self.pixel, self.motion, run)

    @property
    def near(self) -> SampleSums:
        """Sums of the nearer side, or of the only one."""
        return self.sides[0][2]


@quiet
def gather(
    build: Build,
    layout: Layout,
    *,
    current: Array,
    inverse_depth: Array,
    motion: Array | None,
    alpha: Array | None,
    reactive: Array | None,
    ring: Array,
    past: Any,
    frames: int,
    output: Array,
    output_count: Array,
    frame: Record,
    settings: Record,
) -> None:
    """Resolve one frame from padded planes and ``frames`` ring frames into ``output`` and ``output_count``."""
    run = Run(build, layout, frame, settings)
    gathering = Gathering.begin(run, locals())
    gathering.add(past[:frames], run)
    store_resolved(gathering.resolved(run), run, output, output_count)
    extend_stored(run, output[: 3 + build.steps.alpha], output_count)
