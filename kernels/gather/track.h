// Surfaces on their ways back through the frames in the ring.
#include "taa/disocclusion.h"

#if !defined(OWN_MOTION) || !defined(ALPHA) || !defined(GATHER_FIT) || !defined(REJECT)
#error "track.h needs OWN_MOTION, ALPHA, GATHER_FIT and REJECT from the prelude"
#endif

// Planes of a frame of the ring, as it was drawn: r, g, b, inverse depth, then own motion and alpha where there are
// such.
#define RING_INVERSE_DEPTH 3
#define RING_MOTION 4
#define RING_ALPHA (4 + 2 * OWN_MOTION)
#define RING_REACTIVE (RING_ALPHA + ALPHA)
#define RING_PLANES (RING_REACTIVE + REACTIVE)

typedef __global const frame_t* restrict frame_records; // of the frames of the ring, the latest first

// The texel at the whole part of a footprint.
STAGE real texel_at(plane_in p, footprint f, int stride)
{
    plane_in q = p + f.at;
    if (LANES > 1 && f.lanes == LANES_CLOSE) {
        const mask right = f.step_x != 0, down = f.step_y != 0;
        const real a = right ? load(q + 1) : load(q), b = right ? load(q + stride + 1) : load(q + stride);
        return down ? b : a;
    }
    if (LANES > 1 && f.lanes == LANES_APART)
        return texels_apart(p + f.own, steps_apart(f.dx, f.dy, stride));
    return load(q);
}

// A surface that moves on its own, on its way back from frame to frame: where it was, and how much closer.
typedef struct
{
    mask own, lost;
    real u, v, shift;
} track_t;

STAGE mask no_motion_vector(real u, real v) { return outside_domain(u) | outside_domain(v); }

// The way of surface s before its first step.
STAGE track_t first_step(surface s)
{
    track_t t = { s.x != s.x, s.x != s.x, s.u, s.v, SPLAT(0.0) };
    if (OWN_MOTION)
        t.own = !no_motion_vector(s.u, s.v);
    return t;
}

// True where a texel of the ring lies in the range of inverse depth that the current 3x3 has, as `then` saw it.
STAGE mask matches_surface(real inverse_depth, surface s, motion_t m, settings_t settings)
{
    const quad alone = { inverse_depth, inverse_depth, inverse_depth, inverse_depth };
    return REJECT == REJECT_NONE ? (inverse_depth == inverse_depth) : same_surface(alone, s, m, settings);
}

// One step back, by the motion of the sample at the surface's own place (which is not the pixel's where the motion is a
// neighbour's). Where that sample has no motion vector, the nearest of its neighbours with one replaces it, since the
// edge of an object covers a sample in one frame and misses it in the next. Without any the surface is lost in this
// frame and all before it. So is a surface that another one covers there, by its inverse depth. From frame to frame a
// surface may come closer by as much as the range of `s` and the slack of the depth test allow.
STAGE void follow(track_t* t, surface s, motion_t m, plane_in p, footprint there, mask seen, size_t plane, frame_t then,
    settings_t settings)
{
    plane_in moved = p + RING_MOTION * plane;
    const int stride = then.stride;
    real u = texel_at(moved, there, stride), v = texel_at(moved + plane, there, stride);
    const real q = inverse_depth_or_sky(texel_at(p + RING_INVERSE_DEPTH * plane, there, stride), then);
    const mask followed = t->own & seen, has_motion = !no_motion_vector(u, v),
               same = has_motion & matches_surface(q, s, m, settings);
    t->shift = followed & same ? q - s.inverse_depth : t->shift;
    const mask missing = followed & !has_motion;
    if (GATHER_FIT == GATHER_FIT_LAYERS && any_of(missing)) {
        real best = SPLAT(-DOMAIN_LIMIT);
        for (int dy = -1; dy <= 1; ++dy)
            for (int dx = -1; dx <= 1; ++dx) {
                const ptrdiff_t step = dy * (ptrdiff_t)stride + dx;
                const real near = texel_at(p + RING_INVERSE_DEPTH * plane + step, there, stride);
                const real a = texel_at(moved + step, there, stride), b = texel_at(moved + plane + step, there, stride);
                const mask nearer = missing & (near > best) & !no_motion_vector(a, b);
                best = nearer ? near : best;
                u = nearer ? a : u;
                v = nearer ? b : v;
            }
    }
    t->lost = t->lost | (t->own & (!seen | no_motion_vector(u, v) | (has_motion & !same)));
    t->u += u;
    t->v += v;
}
