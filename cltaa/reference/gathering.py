"""Twin of ``gather.cl``: pixels on their way back through the kept frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cltaa.build import Build, Record, kept_planes
from cltaa.layout import Layout
from cltaa.params import GatherFit
from cltaa.reference.gather import add_side, gather_samples, resolve_gathered
from cltaa.reference.gather_fit import Gathered, first_sample
from cltaa.reference.gather_sample import sample_share
from cltaa.reference.gather_sides import Layers, layers_of, side_of
from cltaa.reference.gather_thin import recall_thin
from cltaa.reference.gather_track import Track
from cltaa.reference.neighbourhood import Surface, nearest_surface
from cltaa.reference.pixel import Pixel, Resolved, current_pixel
from cltaa.reference.planes import read_rows, store_resolved
from cltaa.reference.projection import Motion, surface_motion
from cltaa.reference.real import Array, quiet


@dataclass(slots=True)
class Gathering:
    """Pixels on their way back through the kept frames; one side of each, or with layers the nearer and the farther."""

    pixel: Pixel
    motion: Motion
    layers: Layers
    slots: Array
    sides: list[tuple[Surface, Layers, Gathered, Track]]
    none: Gathered  # what stands for the farther side where there is one side

    @classmethod
    def begin(cls, build: Build, layout: Layout, given: Mapping[str, Any]) -> Gathering:
        """Before the first kept frame, from what the kernel is ``given``."""
        current, closeness, motion, frame, settings = (
            given[name] for name in ("current", "closeness", "motion", "frame", "settings")
        )
        rows = read_rows(current, closeness, motion, build, layout, frame)
        p = current_pixel(rows, given["alpha"], given["reactive"], build, layout, frame)
        s = nearest_surface(*rows, build, settings["edge_tolerance"])
        m = surface_motion(s, build, layout, frame)
        slots = given["kept"].reshape(-1, kept_planes(build.steps), layout.rows, layout.stride)
        layers, told = layers_of(*rows, s, settings), given["past"][: given["frames"]]
        in_layers = build.choices.gather_fit is GatherFit.LAYERS
        if in_layers:
            s, layers = recall_thin(s, layers, slots, told, build, layout, settings)
        near_one = ~layers.edge | (s.centre > layers.cut)
        w = sample_share(p.own, build, settings)
        g = first_sample(w, near_one | ~near_one, near_one, build, frame)
        far = first_sample(w, ~near_one, ~near_one, build, frame)
        if not in_layers:
            return cls(p, m, layers, slots, [(s, layers, g, Track.of(s, build))], far)
        of_sides = (s, layers, p.own, current, closeness, motion, build, layout, frame, settings)
        front, back = side_of(*of_sides, far=False), side_of(*of_sides, far=True)
        add_side(far, back, p.own, build, settings)
        sides = [(at.surface, at.layers, sums, Track.of(at.surface, build)) for at, sums in ((front, g), (back, far))]
        return cls(p, m, layers, slots, sides, far)

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
        for far_only, (s, layers, sums, track) in enumerate(self.sides):
            gather_samples(
                self.slots, past, sums, self.pixel, s, layers, build, layout, frame, settings,
                far_only=bool(far_only), track=track, before=before, recent=0 if far_only else recent,
            )  # fmt: skip

    def resolved(self, build: Build, layout: Layout, settings: Record) -> Resolved:
        """The pixel from the samples gathered so far."""
        far = self.sides[1][2] if len(self.sides) > 1 else self.none
        return resolve_gathered(self.near, far, self.layers, self.pixel, self.motion, build, layout, settings)

    @property
    def near(self) -> Gathered:
        """The sums of the nearer side, or of the only one."""
        return self.sides[0][2]


@quiet
def gather(
    build: Build, layout: Layout, *, current: Array, closeness: Array, motion: Array | None, alpha: Array | None,
    reactive: Array | None, kept: Array, past: Any, frames: int, output: Array, output_count: Array, frame: Record,
    settings: Record,
) -> None:  # fmt: skip
    """Resolve one frame from padded planes and ``frames`` kept ones into ``output`` and ``output_count``."""
    gathering = Gathering.begin(build, layout, locals())
    gathering.add(past[:frames], build, layout, frame, settings)
    store_resolved(gathering.resolved(build, layout, settings), build, layout, frame, output, output_count)
