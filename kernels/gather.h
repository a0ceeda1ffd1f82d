// Gathering: a pixel's past as the samples that earlier frames drew inside it, each read where it was drawn. Nothing is
// ever read between texels, so nothing blurs, however far and however long things move.
#include "gather_sample.h"
#include "gather_subpixel.h"

#if !defined(OWN_MOTION) || !defined(ALPHA)
#error "gather.h needs OWN_MOTION and ALPHA from the prelude"
#endif

// The way of the pixel's centre to a frame of the ring, by the sample that told the depth or by the track, and the
// stretch.
STAGE motion_t motion_to_frame(
    stretch_t* stretch, track_t t, surface s, layers_t l, real px, real py, frame_t frame, frame_t then)
{
    const real zero = SPLAT(0.0);
    motion_t m = motion_from_depth(s, px, py, then);
    *stretch = (stretch_t) { zero, zero, zero, zero };
    if (GATHER_FIT != GATHER_FIT_MEAN) {
        *stretch = stretch_of(s, l.slope_x, l.slope_y, m, px, py, then);
        const real ox = s.x + K(frame.jitter_x), oy = s.y + K(frame.jitter_y);
        m.u -= stretch->xx * ox + stretch->xy * oy;
        m.v -= stretch->yx * ox + stretch->yy * oy;
    }
    if (OWN_MOTION) {
        m.u = t.own ? t.u : m.u;
        m.v = t.own ? t.v : m.v;
        m.scale = t.own ? SPLAT(1.0) : m.scale;
        m.shift = t.own ? t.shift : m.shift;
        m.visible = m.visible | t.own;
        stretch->xx = t.own ? zero : stretch->xx, stretch->xy = t.own ? zero : stretch->xy;
        stretch->yx = t.own ? zero : stretch->yx, stretch->yy = t.own ? zero : stretch->yy;
    }
    return m;
}

// The sums of a layer before its way back. Those of the nearer one hold the current sample whatever it shows, those of
// the farther one if it shows that.
STAGE gathered begin_layer(surface s, layers_t l, int far, real w, frame_t frame)
{
    const mask front = !l.edge | (s.centre > l.cut);
    if (far)
        return first_sample(w, !front, !front, frame);
    return first_sample(w, front | !front, front, frame);
}

// What the current frame shows of a side around the pixel, as one sample: of what is disoccluded there is
// hardly another.
STAGE void add_side(gathered* g, side_t side, colour current, settings_t settings)
{
    const real zero = SPLAT(0.0);
    const mask any = side.count > zero;
    const colour d = { side.mean.r - current.r, side.mean.g - current.g, side.mean.b - current.b };
    add_sample(g, d, any ? sample_share(side.mean, settings) : zero, zero, zero, any);
}

// Whether a pixel of the segment has a farther side to follow on its own.
STAGE int has_edges(layers_t l) { return GATHER_FIT == GATHER_FIT_LAYERS && any_of(l.edge); }

#define NEARER 0
#define FARTHER 1

// The nearer or the farther surface of a pixel on its way back through the frames in the ring: where it is now, where
// its own motion has led so far, and the sums of the samples on it.
typedef struct
{
    side_t side;
    track_t track;
    gathered sums;
    int far; // NEARER or FARTHER
} way_t;

STAGE way_t begin_way(surface s, layers_t l, int far, pixel_t p, plane_in current, plane_in inverse_depth,
    plane_in motion, int x, int y, frame_t frame, settings_t settings)
{
    way_t way = { { s, l }, first_step(s), begin_layer(s, l, far, sample_share(p.own, settings), frame), far };
    if (!has_edges(l))
        return way;
    way.side = side_of(s, l, far, p.own, current, inverse_depth, motion, x, y, frame, settings);
    way.track = first_step(way.side.s);
    if (far)
        add_side(&way.sums, way.side, p.own, settings);
    return way;
}

// Follows a surface of the pixel `now` through the frames in the ring `from` to `to` - 1, the latest being 0, and adds
// their samples; those of the first `recent` frames are summed on their own too. past[k] says how to come from this
// frame to the k-th, where its samples lie in their pixels (jitter) and in which slot of `ring` it is. The place of the
// pixel's centre in frame k falls into the area of exactly one sample there: the one whose position rounds to it. It
// and the eight around it count by where they lie, seen from now.
STAGE void gather_samples(way_t* way, plane_in ring, frame_records past, int from, int to, int recent, pixel_t now,
    int x, int y, frame_t frame, settings_t settings)
{
    const surface s = way->side.s;
    const layers_t l = way->side.l;
    track_t* t = &way->track;
    const size_t plane = plane_size(frame);
    const uint at = texel_offset(frame, x, y);
    const real px = LANE_INDEX + K(x), py = SPLAT(y), reach = reach_of(to + 1, settings);
    const surface followed = GATHER_FIT == GATHER_FIT_LAYERS ? range_of_side(s, l, way->far) : s;
    for (int k = from; k < to; ++k) {
        const frame_t then = past[k];
        stretch_t stretch;
        view_t v;
        v.m = motion_to_frame(&stretch, *t, s, l, px, py, frame, then);
        v.seen = on_screen(v.m, px, py, frame) & !t->lost;
        motion_t nearest = v.m;
        nearest.u = v.m.u + (K(0.5) - K(then.jitter_x));
        nearest.v = v.m.v + (K(0.5) - K(then.jitter_y));
        v.f = footprint_of(nearest, v.seen, at, frame);
        v.column = (px + nearest.u) - v.f.fx;
        v.row = (py + nearest.v) - v.f.fy;
        v.places = places_now(SPLAT(0.5) - v.f.fx, SPLAT(0.5) - v.f.fy, stretch);
        v.reach = reach;
        v.recent = k < recent;
        v.planes = ring + (size_t)then.slot * RING_PLANES * plane;
        if (GATHER_FIT == GATHER_FIT_MEAN)
            gather_sample(&way->sums, v, 0, 0, now, s, l, way->far, then, frame, settings);
        else
            for (int i = 0; i < 9; ++i)
                gather_sample(&way->sums, v, i % 3 - 1, i / 3 - 1, now, s, l, way->far, then, frame, settings);
        if (OWN_MOTION) {
            motion_t place = nearest;
            place.u += s.x;
            place.v += s.y;
            follow(t, followed, v.m, v.planes, footprint_of(place, v.seen, at, frame), v.seen, plane, then, settings);
        }
    }
}

// What the samples of a pixel come to, less the current one. Across a depth edge the nearer surface's share and colour
// are fitted to the samples along its way, and behind it is the mean of the samples along the farther one's own way.
STAGE colour gathered_change(gathered g, gathered far, layers_t l, settings_t settings)
{
    const fit_t f = fit_at_centre(g, g.count + K(1.0), settings);
    colour v = { fitted(f, g.sum.r, g.along.r, g.down.r), fitted(f, g.sum.g, g.along.g, g.down.g),
        fitted(f, g.sum.b, g.along.b, g.down.b) };
    if (GATHER_FIT == GATHER_FIT_LAYERS) {
        const real zero = SPLAT(0.0), one = SPLAT(1.0);
        const real seen = one - limit(fitted(f, g.near, g.near_x, g.near_y), zero, one);
        const mask any = far.weight > zero;
        // Where no sample of the farther surface is left, the nearer one has to stand for it.
        const real mean = (l.edge ? seen : zero) / (any ? far.weight : (g.near > zero ? g.near : one));
        v.r += mean * (any ? far.sum.r : g.sum.r);
        v.g += mean * (any ? far.sum.g : g.sum.g);
        v.b += mean * (any ? far.sum.b : g.sum.b);
    }
    return v;
}

// Share of the filtered sample beside the n of a pixel, from their share 1 / n: as 1 / (n^2 - 1), at most 1, since a
// fit leaves little for it to do but between two samples or three; where light may change as 1 / n, beyond
// filter_samples as 1 / n^2. At a depth edge, where samples miss their surface and are worth fewer than they are,
// 1 / n.
STAGE real gathered_filter_share(real of_mean, gathered g, layers_t l, settings_t settings)
{
    if (ILLUMINATION == ILLUMINATION_WINDOW)
        return l.edge ? of_mean : fading_share(of_mean, settings);
    const real one = SPLAT(1.0), n = g.count + one;
    return l.edge ? of_mean : quotient(one, greater(n * n - one, one));
}

// How much of its samples a reactive pixel gives up for the current one. Temporal windows are each judged by the
// latest samples, so that there little of what is half to be trusted is.
STAGE real distrust(real reactivity)
{
    const real square = reactivity * reactivity;
    return ILLUMINATION == ILLUMINATION_WINDOW ? square * square : reactivity;
}

// The pixel from its samples, the current one among them.
STAGE resolved resolve_gathered(
    gathered g, gathered far, layers_t l, pixel_t p, motion_t m, frame_t frame, settings_t settings)
{
    const colour current = p.own;
    const real zero = SPLAT(0.0), one = SPLAT(1.0);
    const mask any = g.count > zero;
    const real weight = any ? g.weight : one;
    colour past = { current.r + g.sum.r / weight, current.g + g.sum.g / weight, current.b + g.sum.b / weight };
    if (GATHER_FIT != GATHER_FIT_MEAN) {
        const colour change = gathered_change(g, far, l, settings);
        past.r = current.r + change.r, past.g = current.g + change.g, past.b = current.b + change.b;
    }
    const rectification r = rectify(past, current, p.near, m, box_scale_of(m, settings), frame, settings);
    // The mean of the others has its share beside the current sample, which a fit holds already.
    real share = GATHER_FIT == GATHER_FIT_MEAN ? g.weight / (sample_share(current, settings) + g.weight) : one;
    real alpha_share = one;
    if (REACTIVE) {
        alpha_share = one - distrust(p.reactivity);
        share *= alpha_share;
    }
    const colour mixed = { current.r + share * ((past.r - current.r) + r.change.r),
        current.g + share * ((past.g - current.g) + r.change.g),
        current.b + share * ((past.b - current.b) + r.change.b) };
    colour chosen = choose_colour(any, mixed, disoccluded_colour(current, p.near.mean, settings));
    if ((FILTER_USE == FILTER_USE_FEW_SAMPLES) & (CURRENT_FILTER != CURRENT_FILTER_NONE)) {
        const real of_mean = one / (g.count + one), filter_share = gathered_filter_share(of_mean, g, l, settings);
        chosen = drawn_towards(chosen, p.filtered, filtered_share(filter_share, p.filtered, settings));
    }
    resolved out;
    out.rgb = storable_colour(from_range(chosen), current);
    out.alpha = p.alpha;
    if (ALPHA_FROM == ALPHA_FROM_BLEND)
        out.alpha = p.alpha + alpha_share * (g.alpha / (g.count + one));
    out.count = g.count + one;
    return out;
}
