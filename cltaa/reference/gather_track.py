"""Twin of ``gather/track.h``: tracks surfaces with own motion through the frame ring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cltaa.core.build import Build, Record, Steps
from cltaa.core.constants import AHEAD_STEPS, value
from cltaa.core.parameters import Reject
from cltaa.reference.disocclusion import on_screen, same_surface
from cltaa.reference.neighbourhood import Surface, inverse_depth_or_sky
from cltaa.reference.real import NEIGHBOURS, Array, Mask, Run, greater, number, outside_domain
from cltaa.reference.reprojection import Motion
from cltaa.reference.sampling import Footprint, Quad, footprint_of

RING_INVERSE_DEPTH, RING_MOTION = 3, 4
MOTION = slice(RING_MOTION, RING_MOTION + 2)


def ring_alpha(steps: Steps) -> int:
    """Index of a ring frame's plane of alpha, where there is one."""
    return RING_MOTION + 2 * steps.own_motion


def ring_reactive(steps: Steps) -> int:
    """Index of the plane of reactivity, where there is one."""
    return ring_alpha(steps) + steps.alpha


def texel_at(plane: Array, f: Footprint, real: Any) -> Array:
    """The texel at the footprint's integer position, of a plane [rows, stride] or of several."""
    return plane[..., f.row, f.column].astype(real)


def no_motion_vector(u: Array, v: Array) -> Mask:
    """True where a motion is no vector."""
    return outside_domain(u) | outside_domain(v)


def matches_surface(inverse_depth: Array, s: Surface, m: Motion, run: Run) -> Mask:
    """True where a texel of the ring lies in the range of inverse depth of the current 3x3, reprojected to its
    frame."""
    if run.choices.reject is Reject.NONE:
        return inverse_depth == inverse_depth
    return same_surface(Quad(inverse_depth, inverse_depth, inverse_depth, inverse_depth), s, m, run)


@dataclass(slots=True)
class Track:
    """Tracks of surfaces with own motion: their displacement, their change of inverse depth, and where they were
    lost."""

    own: Mask
    u: Array
    v: Array
    shift: Array
    lost: Mask
    step: tuple[Array, Array]  # the latest one
    ahead: Track | None = None  # the track to later frames, once it has begun

    @classmethod
    def of(cls, s: Surface, build: Build) -> Track:
        """Start the track of surface ``s`` with its motion vector to the previous frame."""
        zero = np.zeros_like(s.centre)
        none = np.zeros(zero.shape, bool)
        own = ~no_motion_vector(s.u, s.v) if build.steps.own_motion else none
        return cls(own, s.u, s.v, zero, none, (zero, zero))

    def ahead_of(self, s: Surface, build: Build) -> Track:
        """The track ahead, whose first step is expected to equal the step that led to the surface."""
        if self.ahead is None:
            zero = np.zeros_like(s.centre)
            self.ahead = Track.of(s, build)
            self.ahead.u, self.ahead.v, self.ahead.step = zero, zero, (-s.u, -s.v)
        return self.ahead

    def motion(self, m: Motion) -> Motion:
        """``m`` where a surface has no own motion, the track elsewhere."""
        return Motion(
            np.where(self.own, self.u, m.u),
            np.where(self.own, self.v, m.v),
            np.where(self.own, 1.0, m.scale),
            np.where(self.own, self.shift, m.shift),
            m.visible | self.own,
        )

    def step_back(
        self, s: Surface, m: Motion, planes: Array, there: Footprint, seen: Mask, run: Run, then: Record
    ) -> None:
        """Step back by the motion vector at the surface's position, or that of the nearest neighbour with one; the
        surface is lost without any, and where another surface, by its inverse depth, occludes it."""
        real: Any = self.u.dtype
        u, v = texel_at(planes[MOTION], there, real)
        z = inverse_depth_or_sky(texel_at(planes[RING_INVERSE_DEPTH], there, real), then)
        followed, has_motion = self.own & seen, ~no_motion_vector(u, v)
        same = has_motion & matches_surface(z, s, m, run)
        self.shift = np.where(followed & same, z - s.inverse_depth, self.shift)
        u, v = _nearest_motion(u, v, followed & ~has_motion, planes, there)
        self.lost = self.lost | (self.own & (~seen | no_motion_vector(u, v) | (has_motion & ~same)))
        self.u, self.v = self.u + u, self.v + v

    def step_ahead(self, s: Surface, planes: Array, run: Run, then: Record) -> None:
        """Step ahead to the position whose motion vector leads back to where the surface was; it is lost where the
        search does not converge, and as on a step back."""
        real: Any = self.u.dtype
        half = number(0.5, self.u)
        u, v = self.u + self.step[0], self.v + self.step[1]
        seen = self.own & ~self.lost
        off, z, has_motion = u, u, seen
        one, jitter = np.ones_like(u), [number(then[name], u) for name in ("jitter_x", "jitter_y")]
        for _ in range(AHEAD_STEPS):
            place = Motion(u, v, one, self.shift, seen)
            seen = on_screen(place, run.layout)
            nearest = place._replace(u=(u + (half - jitter[0])) + s.x, v=(v + (half - jitter[1])) + s.y)
            there = footprint_of(nearest, seen, run.layout)
            back_x, back_y = texel_at(planes[MOTION], there, real)
            z = inverse_depth_or_sky(texel_at(planes[RING_INVERSE_DEPTH], there, real), then)
            has_motion = ~no_motion_vector(back_x, back_y)
            back_x, back_y = _nearest_motion(back_x, back_y, seen & ~has_motion, planes, there)
            next_u, next_v = self.u - back_x, self.v - back_y
            off = greater(np.abs(next_u - u), np.abs(next_v - v))
            u, v = next_u, next_v
        same = has_motion & matches_surface(z, s, Motion(u, v, one, self.shift, seen), run)
        converged = seen & (off <= value("AHEAD_TOLERANCE"))
        self.shift = np.where(converged & same, z - s.inverse_depth, self.shift)
        self.lost = self.lost | (self.own & (~converged | (has_motion & ~same)))
        self.step = u - self.u, v - self.v
        self.u, self.v = u, v


def _nearest_motion(u: Array, v: Array, missing: Mask, planes: Array, there: Footprint) -> tuple[Array, Array]:
    """``u`` and ``v``, where they are ``missing`` replaced by those of the neighbour nearest to the camera with a
    vector."""
    real: Any = u.dtype
    best = np.full_like(u, -value("DOMAIN_LIMIT"))
    for dx, dy in NEIGHBOURS:
        at = there._replace(row=there.row + dy, column=there.column + dx)
        q = texel_at(planes[RING_INVERSE_DEPTH], at, real)
        a, b = texel_at(planes[MOTION], at, real)
        nearer = missing & (q > best) & ~no_motion_vector(a, b)
        best, u, v = np.where(nearer, q, best), np.where(nearer, a, u), np.where(nearer, b, v)
    return u, v
