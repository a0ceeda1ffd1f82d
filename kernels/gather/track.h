// Tracks surfaces through the frames in the ring: back to earlier ones, and ahead to later ones.
#include "taa/disocclusion.h"

// Planes of a frame of the ring, as it was rendered: r, g, b, inverse depth, then own motion, alpha and reactivity
// where there are such.
#define RING_INVERSE_DEPTH 3
#define RING_MOTION 4
#define RING_ALPHA (4 + 2 * OWN_MOTION)
#define RING_REACTIVE (RING_ALPHA + ALPHA)
#define RING_PLANES (RING_REACTIVE + REACTIVE)

// One record a frame of the ring, the nearest first; with look-ahead, earlier and later frames in turn.
typedef __global const frame_t* restrict frame_records;

// Track of a surface with own motion from frame to frame: its displacement, its change of inverse depth, and its latest
// step ahead.
typedef struct
{
    mask own, lost;
    real u, v, shift, step_x, step_y;
} track_t;

STAGE mask no_motion_vector(real u, real v) { return outside_domain(u) | outside_domain(v); }

// Starts the track of surface s with its motion vector to the previous frame.
STAGE track_t begin_track(surface s)
{
    const real zero = SPLAT(0.0);
    track_t t = { (mask)(0), (mask)(0), s.u, s.v, zero, zero, zero };
    if (OWN_MOTION)
        t.own = !no_motion_vector(s.u, s.v);
    return t;
}

// Starts the track ahead at the surface itself; its first step is expected to equal the step that led to the surface.
STAGE track_t begin_track_ahead(surface s)
{
    track_t t = begin_track(s);
    t.u = t.v = SPLAT(0.0);
    t.step_x = -s.u, t.step_y = -s.v;
    return t;
}

// True where a texel of the ring lies in the range of inverse depth of the current 3x3, reprojected to its frame.
STAGE mask matches_surface(real inverse_depth, surface s, motion_t m, settings_t settings)
{
    const quad alone = { inverse_depth, inverse_depth, inverse_depth, inverse_depth };
    return REJECT == REJECT_NONE ? (mask)(-1) : same_surface(alone, s, m, settings);
}

// Where the sample at a footprint has no motion vector, takes that of the nearest surface of its 3x3 with one.
STAGE void nearest_motion(real* u, real* v, mask missing, plane_in p, footprint there, size_t plane, int stride)
{
    if (!any_of(missing))
        return;
    plane_in moved = p + RING_MOTION * plane;
    real best = SPLAT(-DOMAIN_LIMIT);
    for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
            const ptrdiff_t step = dy * (ptrdiff_t)stride + dx;
            const real near = texel_at(p + RING_INVERSE_DEPTH * plane + step, there, stride);
            const real a = texel_at(moved + step, there, stride), b = texel_at(moved + plane + step, there, stride);
            const mask nearer = missing & (near > best) & !no_motion_vector(a, b);
            best = nearer ? near : best;
            *u = nearer ? a : *u;
            *v = nearer ? b : *v;
        }
}

// One step back, by the motion of the sample at the surface's own position (not the pixel's where the motion is
// borrowed). Where that sample has no motion vector, the nearest of its neighbours with one replaces it, since the edge
// of an object covers a sample in one frame and misses it in the next. Without any the surface is lost in this frame
// and all before it. So is a surface that another one occludes there, by its inverse depth. From frame to frame a
// surface may come closer by as much as the range of `s` and the slack of the depth test allow.
STAGE void step_back(track_t* t, surface s, motion_t m, plane_in p, footprint there, mask seen, size_t plane,
    frame_t then, settings_t settings)
{
    plane_in moved = p + RING_MOTION * plane;
    const int stride = then.stride;
    real u = texel_at(moved, there, stride), v = texel_at(moved + plane, there, stride);
    const real q = inverse_depth_or_sky(texel_at(p + RING_INVERSE_DEPTH * plane, there, stride), then);
    const mask followed = t->own & seen, has_motion = !no_motion_vector(u, v),
               same = has_motion & matches_surface(q, s, m, settings);
    t->shift = followed & same ? q - s.inverse_depth : t->shift;
    nearest_motion(&u, &v, followed & !has_motion, p, there, plane, stride);
    t->lost = t->lost | (t->own & (!seen | no_motion_vector(u, v) | (has_motion & !same)));
    t->u += u;
    t->v += v;
}

// One step ahead, to the position in frame `then` from which the motion vector there leads back to where the surface
// was. That is a fixed point, since the vectors of a frame lead back only. The search begins where the surface would be
// if it went on as before; where vectors change by d pixels a pixel, each round multiplies its error by d. A surface is
// lost in this frame and all beyond it where the search does not converge, and as on a step back.
STAGE void step_ahead(track_t* t, surface s, plane_in p, real x, real y, uint at, size_t plane, frame_t then,
    frame_t frame, settings_t settings)
{
    plane_in moved = p + RING_MOTION * plane;
    const int stride = row_stride(frame);
    real u = t->u + t->step_x, v = t->v + t->step_y, off = u, q = u;
    mask seen = t->own & !t->lost, has_motion = seen;
    for (int round = 0; round < AHEAD_STEPS; ++round) {
        motion_t place = { u, v, SPLAT(1.0), t->shift, seen };
        seen = on_screen(place, x, y, frame);
        place.u = (u + (K(0.5) - K(then.jitter_x))) + s.x;
        place.v = (v + (K(0.5) - K(then.jitter_y))) + s.y;
        const footprint there = footprint_of(place, seen, at, frame);
        real back_x = texel_at(moved, there, stride), back_y = texel_at(moved + plane, there, stride);
        q = inverse_depth_or_sky(texel_at(p + RING_INVERSE_DEPTH * plane, there, stride), then);
        has_motion = !no_motion_vector(back_x, back_y);
        nearest_motion(&back_x, &back_y, seen & !has_motion, p, there, plane, stride);
        const real next_u = t->u - back_x, next_v = t->v - back_y;
        off = greater(absolute(next_u - u), absolute(next_v - v));
        u = next_u;
        v = next_v;
    }
    const motion_t m = { u, v, SPLAT(1.0), t->shift, seen };
    const mask same = has_motion & matches_surface(q, s, m, settings),
               converged = seen & (off <= SPLAT(AHEAD_TOLERANCE));
    t->shift = converged & same ? q - s.inverse_depth : t->shift;
    t->lost = t->lost | (t->own & (!converged | (has_motion & !same)));
    t->step_x = u - t->u;
    t->step_y = v - t->v;
    t->u = u;
    t->v = v;
}
