// Disocclusion test: rejects history where the previous frame did not show the surface.
#include "schedule/footprint.h"

// True where the reprojected point lies inside the previous image (half a texel of margin) and moved by less than
// MOTION_LIMIT. Every comparison is false for NaN.
STAGE mask on_screen(motion_t m, real x, real y, frame_t frame)
{
    const real hx = x + m.u, hy = y + m.v;
    const mask inside = m.visible & (hx >= SPLAT(-0.5)) & (hy >= SPLAT(-0.5)) & (hx <= SPLAT(frame.width) - K(0.5))
        & (hy <= SPLAT(frame.height) - K(0.5));
    // A motion that ends inside an image smaller than MOTION_LIMIT is shorter than that.
    if ((PLANE > 0) & (STRIDE < MOTION_LIMIT) & (PLANE < STRIDE * MOTION_LIMIT))
        return inside;
    return inside & (absolute(m.u) < SPLAT(MOTION_LIMIT)) & (absolute(m.v) < SPLAT(MOTION_LIMIT));
}

// Inverse-depth range of the current 3x3, seen from the previous camera and widened by depth_tolerance.
typedef struct
{
    real low, high;
} depth_range;

STAGE depth_range surface_range(surface s, motion_t m, settings_t settings)
{
    const real near = s.nearest * m.scale + m.shift, far = s.farthest * m.scale + m.shift;
    const real slack = K(settings.depth_tolerance) * greater(absolute(near), absolute(far));
    return (depth_range) { far - slack, near + slack };
}

// Replaces texels of no bilinear weight (a fraction is 0) by the neighbour that has the weight.
STAGE quad weighted_texels(quad q, real fx, real fy)
{
    const mask one_column = fx == SPLAT(0.0), one_row = fy == SPLAT(0.0);
    q.p10 = one_column ? q.p00 : q.p10;
    q.p11 = one_column ? q.p01 : q.p11;
    q.p01 = one_row ? q.p00 : q.p01;
    q.p11 = one_row ? q.p10 : q.p11;
    return q;
}

// True where one of the four texels around the history position lies in the surface's range. One is enough: along
// silhouettes, and where jitter hits and misses a sub-pixel feature, some texel matches.
STAGE mask same_surface(quad previous, surface s, motion_t m, settings_t settings)
{
    const depth_range r = surface_range(s, m, settings);
    return ((previous.p00 <= r.high) & (previous.p00 >= r.low)) | ((previous.p10 <= r.high) & (previous.p10 >= r.low))
        | ((previous.p01 <= r.high) & (previous.p01 >= r.low)) | ((previous.p11 <= r.high) & (previous.p11 >= r.low));
}

// Returns 1 for a texel nearer than `than`, 0 for others.
STAGE quad nearer_than(quad q, real than)
{
    const real one = SPLAT(1.0), none = SPLAT(0.0);
    return (quad) { q.p00 > than ? one : none, q.p10 > than ? one : none, q.p01 > than ? one : none,
        q.p11 > than ? one : none };
}

STAGE mask any_nearer(quad q, real than) { return (q.p00 > than) | (q.p10 > than) | (q.p01 > than) | (q.p11 > than); }

STAGE real nearest_of(quad q) { return greater(greater(q.p00, q.p10), greater(q.p01, q.p11)); }

// Parallax in pixels, by camera motion alone, between the surface and a point of inverse depth `other` at the same
// pixel. Own motion is left out of both: a point that moves along with the surface has not moved against it.
STAGE real parallax_of(real other, surface s, motion_t m, real x, real y, frame_t frame)
{
    surface point = s;
    point.x = point.y = SPLAT(0.0);
    if (OWN_MOTION & frame.own_vectors) {
        point.inverse_depth = s.nearest;
        const motion_t by_camera = motion_from_depth(point, x, y, frame);
        m.u = by_camera.u, m.v = by_camera.v;
    }
    point.inverse_depth = other;
    const motion_t its = motion_from_depth(point, x, y, frame);
    return greater(absolute(its.u - m.u), absolute(its.v - m.v));
}

// True where that parallax is large enough for one to have passed the other.
STAGE mask has_parallax(real other, surface s, motion_t m, real x, real y, frame_t frame)
{
    return parallax_of(other, s, m, x, y, frame) >= SPLAT(LEAST_PARALLAX);
}

// True where the nearest texel around the history position is nearer than the surface and has moved against it since,
// so that it disoccluded what it hid. A texel that comes and goes by jitter alone has not moved.
STAGE mask occluder_has_passed(real nearest, surface s, motion_t m, real x, real y, frame_t frame, settings_t settings)
{
    const mask nearer = nearest > surface_range(s, m, settings).high;
    if (LANES > 1 && !any_of(nearer))
        return nearer;
    return nearer & has_parallax(quotient(nearest - m.shift, m.scale), s, m, x, y, frame);
}

// Middle of the nearest and the farthest inverse depth of the 3x3, seen from the previous camera.
STAGE real middle_inverse_depth(surface s, motion_t m) { return K(0.5) * (s.nearest + s.farthest) * m.scale + m.shift; }

// True where the pixel follows a nearer surface past its own, and three of the four texels did not show that surface:
// the history holds the background at another place.
STAGE mask shows_background(quad previous, surface s, motion_t m, real x, real y, frame_t frame)
{
    const mask borrowed = (s.x != SPLAT(0.0)) | (s.y != SPLAT(0.0));
    if (!any_of(borrowed))
        return borrowed;
    const quad nearer = nearer_than(previous, middle_inverse_depth(s, m));
    const real shown = (nearer.p00 + nearer.p10) + (nearer.p01 + nearer.p11);
    return borrowed & (shown <= SPLAT(1.0)) & has_parallax(s.centre, s, m, x, y, frame);
}

// Upper limit of the sample count at a depth edge. There the pixel mixes the nearer surface with the background, and
// the history mixes it with the background of an earlier frame. Where camera motion moves one past the other by a pixel
// a frame or more, the limit is edge_samples; where slower, edge_samples over that distance. A wire keeps its history:
// either the four texels or the corners of the 4x4 show it, not both.
STAGE real edge_count_limit(
    quad previous, quad corners, surface s, motion_t m, real x, real y, frame_t frame, settings_t settings)
{
    const real middle = middle_inverse_depth(s, m), any = SPLAT(DOMAIN_LIMIT);
    const mask edge = has_edge(s, settings) & any_nearer(previous, middle) & any_nearer(corners, middle);
    if (LANES > 1 && !any_of(edge))
        return any;
    const real parallax = parallax_of(s.farthest, s, m, x, y, frame);
    const real count_limit = quotient(SPLAT(settings.edge_samples), limit(parallax, SPLAT(LEAST_PARALLAX), SPLAT(1.0)));
    return (edge & (parallax >= SPLAT(LEAST_PARALLAX))) ? count_limit : any;
}

// True where an occluder nearer than `high` hid the surface: it covered more than covered_share of the footprint, by
// bilinear weights, and a corner of the 4x4. A wire that jitter hits and misses covers no such corner.
STAGE mask occluder_covered(quad previous, quad corners, real high, footprint f, settings_t settings)
{
    return (bilinear(nearer_than(previous, high), f) > SPLAT(settings.covered_share)) & any_nearer(corners, high);
}
