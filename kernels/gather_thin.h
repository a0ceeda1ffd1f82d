// Things thinner than a pixel, which the samples of one frame hit here and miss there.
#include "gather_sides.h"
#include "gather_track.h"

#if !defined(OWN_MOTION) || !defined(THIN_REACH) || !defined(THIN_HITS)
#error "gather_thin.h needs OWN_MOTION, THIN_REACH and THIN_HITS from the prelude"
#endif

typedef __global const frame_t* restrict frames_in;

// What has been found of a thing that the 3x3 of now misses: how far off the pixel's centre it lies, and how close it
// is.
typedef struct
{
    mask found;
    real off, closeness;
} thin_t;

// Of the surfaces that the 3x3 of the latest kept frames show in front of all that the 3x3 of now shows of `s`, the one
// that now lies nearest to the pixel's centre, if that is within THIN_REACH. What filled more of that 3x3 than a line
// does is not missed now but gone.
STAGE thin_t look_for_thin(
    mask open, surface s, plane_in kept, frames_in past, int frames, int x, int y, frame_t frame, settings_t settings)
{
    const size_t plane = plane_size(frame);
    const uint at = texel_offset(frame, x, y);
    const int stride = row_stride(frame), wanted = (int)settings.thin_frames, count = wanted < frames ? wanted : frames;
    const real px = LANE_INDEX + K(x), py = SPLAT(y);
    thin_t thin = { open & !open, SPLAT(THIN_REACH), s.closeness };
    for (int k = 0; k < count; ++k) {
        const frame_t then = past[k];
        const motion_t m = motion_from_depth(s, px, py, then);
        const mask seen = open & on_screen(m, px, py, frame);
        motion_t nearest = m;
        nearest.u = m.u + (K(0.5) - K(then.jitter_x));
        nearest.v = m.v + (K(0.5) - K(then.jitter_y));
        const footprint f = footprint_of(nearest, seen, at, frame);
        plane_in p = kept + (size_t)then.slot * KEPT_PLANES * plane;
        const real near = s.nearest * m.scale + m.shift, high = near + K(settings.depth_tolerance) * absolute(near);
        real hits = SPLAT(0.0), best = thin.off, thinner = thin.closeness;
        for (int dy = -1; dy <= 1; ++dy)
            for (int dx = -1; dx <= 1; ++dx) {
                const ptrdiff_t step = dy * (ptrdiff_t)stride + dx;
                const real q = usable_closeness(texel_at(p + KEPT_CLOSENESS * plane + step, f, stride), then);
                mask nearer = seen & (q > high);
                if (!any_of(nearer))
                    continue;
                hits += nearer ? SPLAT(1.0) : SPLAT(0.0);
                surface hit = s;
                hit.closeness = (q - m.shift) / m.scale;
                const motion_t way = motion_from_depth(hit, px, py, then);
                // From where such a surface was seen at the pixel's place to where the sample is.
                const real ox = ((K(0.5) - f.fx) + K(dx)) + (m.u - way.u),
                           oy = ((K(0.5) - f.fy) + K(dy)) + (m.v - way.v);
                const real off = greater(absolute(ox), absolute(oy));
                if (OWN_MOTION) {
                    plane_in moved = p + KEPT_MOTION * plane + step;
                    nearer = nearer & untold(texel_at(moved, f, stride), texel_at(moved + plane, f, stride));
                }
                const mask here = nearer & way.visible & (off < best);
                best = here ? off : best;
                thinner = here ? hit.closeness : thinner;
            }
        const mask is_thin = (best < thin.off) & (hits <= SPLAT(THIN_HITS));
        thin.off = is_thin ? best : thin.off;
        thin.closeness = is_thin ? thinner : thin.closeness;
        thin.found = thin.found | is_thin;
    }
    return thin;
}

// A surface that kept frames show and the current 3x3 misses, if it lies within THIN_REACH of the pixel's centre. It is
// taken for the nearer side of a depth edge, and the samples along its way tell what share of the pixel it has, none
// included. Only what the camera alone moves is looked for: where a thing that moves on its own is now, an earlier
// frame does not tell.
STAGE void recall_thin(surface* s, layers_t* l, plane_in kept, frames_in past, int frames, int x, int y, frame_t frame,
    settings_t settings)
{
    if (GATHER_FIT != GATHER_FIT_LAYERS)
        return;
    mask open = !l->edge;
    if (OWN_MOTION)
        open = open & untold(s->u, s->v);
    const thin_t thin = look_for_thin(open, *s, kept, past, frames, x, y, frame, settings);
    l->cut = thin.found ? K(0.5) * (thin.closeness + s->nearest) : l->cut;
    l->slope_x = thin.found ? SPLAT(0.0) : l->slope_x;
    l->slope_y = thin.found ? SPLAT(0.0) : l->slope_y;
    l->edge = l->edge | thin.found;
    s->closeness = thin.closeness;
    s->nearest = thin.found ? thin.closeness : s->nearest;
}
