// Disocclusion: where the previous frame did not show the surface, there is no history of it.
#include "taa/sampling.h"

// True where the previous frame saw the point: inside its image (half a texel of margin) and by less than MOTION_LIMIT.
// Every comparison is false for NaN.
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

// The range of inverse depth that the current 3x3 has, seen from the previous camera and widened by depth_tolerance.
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

// The previous frame saw this surface if one of the four texels around the history position lies within its range. One
// matching texel is enough: along silhouettes, and where a feature narrower than a pixel comes and goes with the
// jitter, some texel matches.
STAGE mask same_surface(quad previous, surface s, motion_t m, settings_t settings)
{
    const depth_range r = surface_range(s, m, settings);
    return ((previous.p00 <= r.high) & (previous.p00 >= r.low)) | ((previous.p10 <= r.high) & (previous.p10 >= r.low))
        | ((previous.p01 <= r.high) & (previous.p01 >= r.low)) | ((previous.p11 <= r.high) & (previous.p11 >= r.low));
}

STAGE real nearest_of(quad q) { return greater(greater(q.p00, q.p10), greater(q.p01, q.p11)); }

// Whether something nearer stood in front of the surface at one of the four texels: what the history holds there may be
// its colour.
STAGE mask partly_covered(quad previous, surface s, motion_t m, settings_t settings)
{
    return nearest_of(previous) > surface_range(s, m, settings).high;
}

// Whether a camera's motion has moved what was `nearest` around the place of the history, and nearer than the surface,
// by PASSES pixels against the surface since. It has then uncovered what it stood in front of; what comes and goes by
// the jitter alone has not, nor what moves with the surface by vectors of their own: so both are moved by the camera.
STAGE mask has_passed(real nearest, surface s, motion_t m, real x, real y, frame_t frame, settings_t settings)
{
    const mask nearer = nearest > surface_range(s, m, settings).high;
    if (LANES > 1 && !any_of(nearer))
        return nearer;
    surface passing = s;
    passing.x = passing.y = SPLAT(0.0);
    if (OWN_MOTION) {
        passing.inverse_depth = s.nearest;
        const motion_t by_camera = motion_from_depth(passing, x, y, frame);
        m.u = by_camera.u, m.v = by_camera.v;
    }
    passing.inverse_depth = quotient(nearest - m.shift, m.scale);
    const motion_t its = motion_from_depth(passing, x, y, frame);
    return nearer & ((absolute(its.u - m.u) >= SPLAT(PASSES)) | (absolute(its.v - m.v) >= SPLAT(PASSES)));
}
