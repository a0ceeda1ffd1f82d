// Sub-pixel features, which the samples of one frame hit and those of another miss.
#include "gather/sides.h"
#include "gather/track.h"

// A feature that the current 3x3 misses: its distance from the pixel's centre, and its inverse depth.
typedef struct
{
    mask found;
    real off, inverse_depth;
} subpixel_feature;

// Searches the 3x3 of the latest frames in the ring, and of the next ones, for surfaces in front of all that the
// current 3x3 shows of `s`. Returns the one that now lies nearest to the pixel's centre, if within SUBPIXEL_REACH. A
// surface that filled more of that 3x3 than a line does is not missed now but gone.
STAGE subpixel_feature search_subpixel_feature(mask open, surface s, plane_in ring, frame_records past, int frames,
    int x, int y, frame_t frame, settings_t settings)
{
    const size_t plane = plane_size(frame);
    const uint at = texel_offset(frame, x, y);
    const int stride = row_stride(frame), wanted = (int)settings.subpixel_frames,
              count = LOOK_AHEAD || frames < wanted ? frames : wanted;
    const real px = LANE_INDEX + K(x), py = SPLAT(y);
    subpixel_feature feature = { (mask)(0), SPLAT(SUBPIXEL_REACH), s.inverse_depth };
    for (int k = 0; k < count; ++k) {
        const frame_t then = past[k];
        if (LOOK_AHEAD && (then.ahead > wanted || then.ahead < -wanted))
            continue;
        const motion_t m = motion_from_depth(s, px, py, then);
        const mask seen = open & on_screen(m, px, py, frame);
        motion_t nearest = m;
        nearest.u = m.u + (K(0.5) - K(then.jitter_x));
        nearest.v = m.v + (K(0.5) - K(then.jitter_y));
        const footprint f = footprint_of(nearest, seen, at, frame);
        plane_in p = ring + (size_t)then.slot * RING_PLANES * plane;
        const real near = s.nearest * m.scale + m.shift, high = near + K(settings.depth_tolerance) * absolute(near);
        real hits = SPLAT(0.0), best = feature.off, nearer_one = feature.inverse_depth;
        for (int dy = -1; dy <= 1; ++dy)
            for (int dx = -1; dx <= 1; ++dx) {
                const ptrdiff_t step = dy * (ptrdiff_t)stride + dx;
                const real q = inverse_depth_or_sky(texel_at(p + RING_INVERSE_DEPTH * plane + step, f, stride), then);
                mask nearer = seen & (q > high);
                if (!any_of(nearer))
                    continue;
                hits += nearer ? SPLAT(1.0) : SPLAT(0.0);
                surface hit = s;
                hit.inverse_depth = (q - m.shift) / m.scale;
                const motion_t hit_motion = motion_from_depth(hit, px, py, then);
                // Offset of the sample from this pixel, reprojected at the depth of the hit.
                const real ox = ((K(0.5) - f.fx) + K(dx)) + (m.u - hit_motion.u),
                           oy = ((K(0.5) - f.fy) + K(dy)) + (m.v - hit_motion.v);
                const real off = greater(absolute(ox), absolute(oy));
                if (OWN_MOTION) {
                    plane_in moved = p + RING_MOTION * plane + step;
                    nearer = nearer & no_motion_vector(texel_at(moved, f, stride), texel_at(moved + plane, f, stride));
                }
                const mask here = nearer & hit_motion.visible & (off < best);
                best = here ? off : best;
                nearer_one = here ? hit.inverse_depth : nearer_one;
            }
        const mask is_subpixel = (best < feature.off) & (hits <= SPLAT(SUBPIXEL_HITS));
        feature.off = is_subpixel ? best : feature.off;
        feature.inverse_depth = is_subpixel ? nearer_one : feature.inverse_depth;
        feature.found = feature.found | is_subpixel;
    }
    return feature;
}

// Makes a surface that frames in the ring show and the current 3x3 misses the nearer side of a depth edge, if it lies
// within SUBPIXEL_REACH of the pixel's centre. The samples along its track give its coverage, which may be none.
// Features with own motion are not searched for: an earlier frame does not show where such an object is now.
STAGE void find_subpixel_feature(surface* s, layers_t* l, plane_in ring, frame_records past, int frames, int x, int y,
    frame_t frame, settings_t settings)
{
    mask open = !l->edge;
    if (OWN_MOTION)
        open = open & no_motion_vector(s->u, s->v);
    const subpixel_feature feature = search_subpixel_feature(open, *s, ring, past, frames, x, y, frame, settings);
    l->cut = feature.found ? K(0.5) * (feature.inverse_depth + s->nearest) : l->cut;
    l->slope_x = feature.found ? SPLAT(0.0) : l->slope_x;
    l->slope_y = feature.found ? SPLAT(0.0) : l->slope_y;
    l->edge = l->edge | feature.found;
    s->inverse_depth = feature.inverse_depth;
    s->nearest = feature.found ? feature.inverse_depth : s->nearest;
}
