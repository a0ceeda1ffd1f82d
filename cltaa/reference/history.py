"""Twin of ``taa/history.h``: the history of each pixel, and whether it is valid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cltaa.core.build import Record
from cltaa.core.constants import value
from cltaa.core.parameters import HistoryRange, Reject
from cltaa.reference.colour import Colour, colour_outside_domain, sample_is_missing
from cltaa.reference.disocclusion import (
    any_nearer,
    edge_count_limit,
    nearest_of,
    occluder_covered,
    occluder_has_passed,
    on_screen,
    same_surface,
    shows_background,
    surface_range,
    weighted_texels,
)
from cltaa.reference.illumination import history_in_range, illumination_test, tests_light
from cltaa.reference.neighbourhood import Surface
from cltaa.reference.real import Array, Mask, Run, greater, lesser, limit, number
from cltaa.reference.reprojection import Motion, motion_to_edge
from cltaa.reference.sampling import (
    Footprint,
    Quad,
    bilinear,
    footprint_of,
    history_weights,
    sample_corners,
    sample_plane,
    sample_quad,
)


@dataclass(frozen=True, slots=True)
class History:
    """Colour, alpha and sample count at the history position, its fractions, whether it is valid, and the illumination
    change (0 where the build does not test light)."""

    rgb: Colour
    alpha: Array
    count: Array
    fx: Array
    fy: Array
    valid: Mask
    change: Array


class Occlusion(NamedTuple):
    """How occluders, now or in the previous frame, affect each history, masks [H, W]: something nearer beside its
    position, moved away since, over so much of it that the history holds its colour; pixels behind the surface that
    they follow. ``count_limit`` [H, W] limits the sample count where pixel and history mix both sides of an edge."""

    nearer_beside: Mask
    passed: Mask
    covered: Mask
    background: Mask
    count_limit: Array


def find_occlusion(
    previous_inverse_depth: Array, previous: Quad, f: Footprint, s: Surface, m: Motion, run: Run
) -> Occlusion:
    """Find from the previous inverse depth [rows, stride] how occluders affect each pixel's history."""
    no, count_limit = np.zeros(m.u.shape, np.bool_), np.full_like(m.u, value("DOMAIN_LIMIT"))
    steps, frame = run.steps, run.frame
    moves = (steps.camera_motion and frame["camera_moved"]) or (steps.own_motion and frame["own_vectors"])
    if run.choices.reject is not Reject.DEPTH or not (steps.camera_motion or steps.own_motion):
        return Occlusion(no, no, no, no, count_limit)
    _, high = surface_range(s, m, run)
    nearer_beside, passed, covered, background = any_nearer(previous, high) & bool(moves), no, no, no
    corners = sample_corners(previous_inverse_depth, f, m.u.dtype)
    if steps.camera_motion:
        nearest = greater(nearest_of(previous), nearest_of(corners))
        passed = occluder_has_passed(nearest, s, m, run)
        background = shows_background(previous, s, m, run)
        count_limit = edge_count_limit(previous, corners, s, m, run)
    if run.build.terms.covered_share:
        covered = occluder_covered(previous, corners, high, f, run.settings["covered_share"])
        covered &= passed | bool(steps.own_motion and frame["own_vectors"])
    return Occlusion(nearer_beside, passed, covered, background, count_limit)


def illumination_threshold(o: Occlusion, settings: Record, like: Array) -> Array:
    """The |t| above which an illumination change reduces the sample count, [H, W] in the type of ``like``."""
    background = np.where(o.background, number(settings["behind_t"], like), number(settings["illumination_t"], like))
    beside: Array = np.where(o.nearer_beside, settings["disocclusion_t"], background)
    return np.where(o.passed, lesser(settings["passing_t"], beside), beside)


def sample_history(
    current: Array,
    alpha: Array | None,
    history: Array,
    history_count: Array,
    previous_inverse_depth: Array,
    m: Motion,
    s: Surface,
    run: Run,
) -> History:
    """Sample history planes [3 or 4, rows, stride], count and illumination change [1 or 2, ...] and the previous
    inverse depth [1, ...] at the motion; only the illumination-change test reads ``current`` [3, ...] and ``alpha``
    [1, ...]."""
    real: Any = m.u.dtype
    seen = motion_to_edge(m, run)
    valid = on_screen(seen, run.layout) & np.bool_(run.frame["reset"] == 0)
    f = footprint_of(seen, valid, run.layout)
    wx, wy = history_weights(f.fx, run.build), history_weights(f.fy, run.build)
    planes = history[:3]
    in_range = run.choices.history_range is HistoryRange.TONEMAPPED
    if in_range:
        planes = history_in_range(planes.astype(real), run)
    rgb = np.stack([sample_plane(plane, f, wx, wy, run.build, real) for plane in planes])
    valid &= ~colour_outside_domain(rgb)
    count = bilinear(sample_quad(history_count[0], f, real), f)
    previous = sample_quad(previous_inverse_depth[0], f, real)
    o = find_occlusion(previous_inverse_depth[0], previous, f, s, m, run)
    if run.choices.reject is Reject.DEPTH:
        no_depth = sample_is_missing(current, run.layout) & (s.nearest <= run.frame["sky_inverse_depth"])
        read = weighted_texels(previous, f) if run.steps.own_motion and run.frame["own_vectors"] else previous
        valid &= (same_surface(read, s, m, run) & ~o.covered) | no_depth
    change = np.zeros_like(count)
    if tests_light(run.build):
        threshold = illumination_threshold(o, run.settings, count)
        count, change = illumination_test(count, threshold, current, alpha, history, history_count[1], f, run)
        count = lesser(count, o.count_limit)
    rgb = rgb if in_range else history_in_range(rgb, run)
    past = np.ones_like(count)
    if run.steps.alpha:
        past = limit(sample_plane(history[3], f, wx, wy, run.build, real), 0, 1)
    if run.build.terms.first_samples:
        first = run.settings["first_samples"] if run.frame["reset"] else 1.0
        count = np.where(valid, count, first)
    return History(rgb, past, count, f.fx, f.fy, valid, change)
