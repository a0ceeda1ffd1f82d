// The surfaces of a pixel and their ways back through the kept frames.
#include "sampling.h"

#if !defined(OWN_MOTION) || !defined(ALPHA) || !defined(GATHER_FIT)
#error "gather_track.h needs OWN_MOTION, ALPHA and GATHER_FIT from the prelude"
#endif

// Planes of a kept frame, as it was drawn: r, g, b, closeness, then own motion and alpha where there are such.
#define KEPT_CLOSENESS 3
#define KEPT_MOTION 4
#define KEPT_ALPHA (4 + 2 * OWN_MOTION)
#define KEPT_PLANES (4 + 2 * OWN_MOTION + ALPHA)

// The texel at the whole part of a footprint.
STAGE real texel_at(plane_in p, footprint f, int stride)
{
    plane_in q = p + f.at;
#if LANES > 1
    if (f.lanes == LANES_CLOSE) {
        const mask right = f.step_x != 0, down = f.step_y != 0;
        const real a = right ? load(q + 1) : load(q), b = right ? load(q + stride + 1) : load(q + stride);
        return down ? b : a;
    }
    if (f.lanes == LANES_APART)
        return texel_apart(p + f.own, f, 0, 0, stride);
#endif
    return load(q);
}

// The two surfaces of a pixel that a depth edge runs through, and how closeness changes on the one that fills others.
typedef struct
{
    mask edge;
    real cut; // closeness that parts the nearer from the farther one
    real slope_x, slope_y; // of closeness, a pixel
} layers_t;

STAGE layers_t layers_of(row_t above, row_t centre, row_t below, surface s, settings_t settings)
{
    layers_t l;
    const real zero = SPLAT(0.0);
    l.edge
        = absolute((s.nearest - s.centre) - (s.centre - s.farthest)) > K(settings.edge_tolerance) * absolute(s.nearest);
    l.cut = K(0.5) * (s.nearest + s.farthest);
    l.slope_x = l.edge ? zero : K(0.5) * centre.rise;
    l.slope_y = l.edge ? zero : K(0.5) * (below.closeness - above.closeness);
    return l;
}

// The farthest surface of the 3x3, to be followed by its own motion.
STAGE surface farthest_surface(surface s, plane_in closeness, plane_in motion, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame), at = texel_offset(frame, x, y);
    s.closeness = s.farthest;
    for (int dy = 1; dy >= -1; --dy)
        for (int dx = 1; dx >= -1; --dx) {
            const ptrdiff_t step = (ptrdiff_t)at + dy * (ptrdiff_t)frame.stride + dx;
            const mask here = usable_closeness(load(closeness + step), frame) == s.farthest;
            s.x = here ? SPLAT(dx) : s.x;
            s.y = here ? SPLAT(dy) : s.y;
            if (OWN_MOTION) {
                s.u = here ? load(motion + step) : s.u;
                s.v = here ? load(motion + plane + step) : s.v;
            }
        }
    return s;
}

// A surface that moves on its own, on its way back from frame to frame.
typedef struct
{
    mask own, lost;
    real u, v;
} track_t;

STAGE mask untold(real u, real v) { return outside_domain(u) | outside_domain(v); }

// One step back, by the motion of the sample at the surface's own place (which is not the pixel's where the motion is a
// neighbour's). Where that sample tells none, the nearest of its neighbours that tells one is taken, since the edge of
// a thing lies in front of a sample in one frame and beside it in the next. Where none does the surface is lost, and so
// is all before it.
STAGE void follow(track_t* t, plane_in p, footprint there, mask seen, size_t plane, int stride)
{
    plane_in moved = p + KEPT_MOTION * plane;
    real u = texel_at(moved, there, stride), v = texel_at(moved + plane, there, stride);
    const mask missing = t->own & seen & untold(u, v);
    if (GATHER_FIT == GATHER_FIT_LAYERS && any_of(missing)) {
        real best = SPLAT(-DOMAIN_LIMIT);
        for (int dy = -1; dy <= 1; ++dy)
            for (int dx = -1; dx <= 1; ++dx) {
                const ptrdiff_t step = dy * (ptrdiff_t)stride + dx;
                const real q = texel_at(p + KEPT_CLOSENESS * plane + step, there, stride);
                const real a = texel_at(moved + step, there, stride), b = texel_at(moved + plane + step, there, stride);
                const mask nearer = missing & (q > best) & !untold(a, b);
                best = nearer ? q : best;
                u = nearer ? a : u;
                v = nearer ? b : v;
            }
    }
    t->lost = t->lost | (t->own & (!seen | untold(u, v)));
    t->u += u;
    t->v += v;
}
