"""Twin of ``gather/track.h``: surfaces that move on their own, on their ways back through the frame ring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cltaa.core.build import Build, Record, Steps
from cltaa.core.parameters import GatherFit, Reject
from cltaa.reference.disocclusion import same_surface
from cltaa.reference.neighbourhood import Surface, inverse_depth_or_sky
from cltaa.reference.real import Array, Mask, constant, outside_domain
from cltaa.reference.reprojection import Motion
from cltaa.reference.sampling import Footprint, Quad

RING_INVERSE_DEPTH, RING_MOTION = 3, 4


def ring_alpha(steps: Steps) -> int:
    """Which plane of a frame of the ring holds alpha, where one does."""
    return RING_MOTION + 2 * steps.own_motion


def ring_reactive(steps: Steps) -> int:
    """Which plane holds reactivity, where one does."""
    return ring_alpha(steps) + steps.alpha


def texel_at(plane: Array, f: Footprint, real: Any) -> Array:
    """The texel at the whole part of a footprint."""
    texels: Array = plane[f.row, f.column].astype(real)
    return texels


def no_motion_vector(u: Array, v: Array) -> Mask:
    """Where a motion is no vector."""
    return outside_domain(u) | outside_domain(v)


def matches_surface(inverse_depth: Array, s: Surface, m: Motion, build: Build, settings: Record) -> Mask:
    """Where a texel of the ring lies in the range of inverse depth that the current 3x3 has, as that frame saw it."""
    if build.choices.reject is Reject.NONE:
        everywhere: Mask = inverse_depth == inverse_depth
        return everywhere
    return same_surface(
        Quad(inverse_depth, inverse_depth, inverse_depth, inverse_depth), s, m, settings["depth_tolerance"]
    )


@dataclass(slots=True)
class Track:
    """Where surfaces that move on their own were, how much closer, and which of them were lost on the way."""

    own: Mask
    u: Array
    v: Array
    shift: Array
    lost: Mask

    @classmethod
    def of(cls, s: Surface, build: Build) -> Track:
        """The way of surface ``s`` before its first step."""
        zero = np.zeros_like(s.centre)
        none = np.zeros(zero.shape, bool)
        return cls(~no_motion_vector(s.u, s.v) if build.steps.own_motion else none, s.u, s.v, zero, none)

    def motion(self, m: Motion) -> Motion:
        """``m`` where the camera alone moves a surface, the track elsewhere."""
        one = np.ones_like(m.scale)
        return Motion(
            np.where(self.own, self.u, m.u),
            np.where(self.own, self.v, m.v),
            np.where(self.own, one, m.scale),
            np.where(self.own, self.shift, m.shift),
            m.visible | self.own,
        )

    def follow(
        self,
        s: Surface,
        m: Motion,
        planes: Array,
        there: Footprint,
        seen: Mask,
        build: Build,
        then: Record,
        settings: Record,
    ) -> None:
        """Take the step that the sample at the surface's place tells, or the nearest of its neighbours that tells one;
        where none does the surface is lost, and where the sample tells another thing's, by its inverse depth."""
        real: Any = self.u.dtype
        u, v = (texel_at(planes[RING_MOTION + axis], there, real) for axis in (0, 1))
        z = inverse_depth_or_sky(texel_at(planes[RING_INVERSE_DEPTH], there, real), then)
        followed, told = self.own & seen, ~no_motion_vector(u, v)
        same = told & matches_surface(z, s, m, build, settings)
        self.shift = np.where(followed & same, z - s.inverse_depth, self.shift)
        missing = followed & ~told
        if build.choices.gather_fit is GatherFit.LAYERS:
            best = np.full_like(self.u, -constant("DOMAIN_LIMIT", self.u))
            for dy in (-1, 0, 1):
                for dx in (-1, 0, 1):
                    beside = there._replace(row=there.row + dy, column=there.column + dx)
                    q = texel_at(planes[RING_INVERSE_DEPTH], beside, real)
                    a, b = (texel_at(planes[RING_MOTION + axis], beside, real) for axis in (0, 1))
                    nearer = missing & (q > best) & ~no_motion_vector(a, b)
                    best, u, v = np.where(nearer, q, best), np.where(nearer, a, u), np.where(nearer, b, v)
        self.lost = self.lost | (self.own & (~seen | no_motion_vector(u, v) | (told & ~same)))
        self.u, self.v = self.u + u, self.v + v
