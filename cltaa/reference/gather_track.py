"""Twin of ``gather_track.h``: the surfaces of a pixel and their ways back through the kept frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cltaa.build import Build, Record
from cltaa.constants import PAD_X, PAD_Y
from cltaa.layout import Layout
from cltaa.params import GatherFit
from cltaa.reference.neighbourhood import Row, Surface, usable_closeness
from cltaa.reference.projection import Motion
from cltaa.reference.real import Array, Mask, constant, number, outside_domain
from cltaa.reference.sampling import Footprint

KEPT_CLOSENESS, KEPT_MOTION = 3, 4


def texel_at(plane: Array, f: Footprint, real: Any) -> Array:
    """The texel at the whole part of a footprint."""
    texels: Array = plane[f.row, f.column].astype(real)
    return texels


@dataclass(slots=True)
class Track:
    """Where surfaces that move on their own were, and which of them were lost on the way."""

    own: Mask
    u: Array
    v: Array
    lost: Mask

    def motion(self, m: Motion) -> Motion:
        """``m`` where the camera alone moves a surface, the track elsewhere."""
        one, zero = np.ones_like(m.scale), np.zeros_like(m.shift)
        return Motion(
            np.where(self.own, self.u, m.u),
            np.where(self.own, self.v, m.v),
            np.where(self.own, one, m.scale),
            np.where(self.own, zero, m.shift),
            m.visible | self.own,
        )

    def follow(self, planes: Array, there: Footprint, seen: Mask, build: Build) -> None:
        """Take the step that the sample at the surface's place tells, or the nearest of its neighbours that tells one;
        where none does the surface is lost."""
        real: Any = self.u.dtype
        u, v = (texel_at(planes[KEPT_MOTION + axis], there, real) for axis in (0, 1))
        missing = self.own & seen & untold(u, v)
        if build.choices.gather_fit is GatherFit.LAYERS:
            best = np.full_like(self.u, -constant("DOMAIN_LIMIT", self.u))
            for dy in (-1, 0, 1):
                for dx in (-1, 0, 1):
                    beside = there._replace(row=there.row + dy, column=there.column + dx)
                    q = texel_at(planes[KEPT_CLOSENESS], beside, real)
                    a, b = (texel_at(planes[KEPT_MOTION + axis], beside, real) for axis in (0, 1))
                    nearer = missing & (q > best) & ~untold(a, b)
                    best, u, v = np.where(nearer, q, best), np.where(nearer, a, u), np.where(nearer, b, v)
        self.lost = self.lost | (self.own & (~seen | untold(u, v)))
        self.u, self.v = self.u + u, self.v + v


@dataclass(frozen=True, slots=True)
class Layers:
    """The two surfaces that a depth edge runs between, and how closeness changes on one that fills others."""

    edge: Mask
    cut: Array
    slope: tuple[Array, Array]


def untold(u: Array, v: Array) -> Mask:
    """Where a motion is no vector."""
    return outside_domain(u) | outside_domain(v)


def layers_of(above: Row, centre: Row, below: Row, s: Surface, settings: Record) -> Layers:
    """Where a depth edge runs through the 3x3, the closeness that parts its sides, and the slope where none does."""
    zero, half = np.zeros_like(s.centre), number(0.5, s.centre)
    skew = (s.nearest - s.centre) - (s.centre - s.farthest)
    edge = np.abs(skew) > number(settings["edge_tolerance"], zero) * np.abs(s.nearest)
    slopes = (half * centre.rise, half * (below.closeness - above.closeness))
    x, y = (np.where(edge, zero, slope) for slope in slopes)
    return Layers(edge, half * (s.nearest + s.farthest), (x, y))


def farthest_surface(
    s: Surface, closeness: Array, motion: Array | None, build: Build, layout: Layout, frame: Record
) -> Surface:
    """The farthest surface of the 3x3, to be followed by its own motion."""
    real: Any = s.centre.dtype

    def window(plane: Array, dx: int, dy: int) -> Array:
        top, left = PAD_Y + dy, PAD_X + dx
        texels: Array = plane[top : top + layout.height, left : left + layout.width].astype(real)
        return texels

    x, y, u, v = s.x, s.y, s.u, s.v
    for dy in (1, 0, -1):
        for dx in (1, 0, -1):
            here = usable_closeness(window(closeness[0], dx, dy), frame) == s.farthest
            x, y = np.where(here, number(dx, x), x), np.where(here, number(dy, y), y)
            if build.steps.own_motion and motion is not None:
                u, v = np.where(here, window(motion[0], dx, dy), u), np.where(here, window(motion[1], dx, dy), v)
    return s._replace(x=x, y=y, closeness=s.farthest, u=u, v=v)
