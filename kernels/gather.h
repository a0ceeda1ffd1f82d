// Gathering: a pixel's past as the samples that earlier frames drew inside it, each read where it was drawn. Nothing is
// ever read between texels, so nothing blurs, however far and however long things move.
#if !defined(OWN_MOTION) || !defined(ALPHA) || !defined(REJECT) || !defined(EXPOSURE) || !defined(WEIGHTING)
#error "gather.h needs OWN_MOTION, ALPHA, REJECT, EXPOSURE and WEIGHTING from the prelude"
#endif

// Planes of a kept frame, as it was drawn: r, g, b, closeness, then own motion and alpha where there are such.
#define KEPT_CLOSENESS 3
#define KEPT_MOTION 4
#define KEPT_ALPHA (4 + 2 * OWN_MOTION)
#define KEPT_PLANES (4 + 2 * OWN_MOTION + ALPHA)

typedef __global const frame_t* restrict frames_in;

// Weighted differences of the samples from the current one, so that equal samples leave it as it is, to the bit.
typedef struct
{
    colour sum;
    real alpha, weight, count;
} gathered;

// Luminance weight 1 / (knee + Y): one firefly does not outweigh a pixel's whole past (Karis 2014 with knee 1).
STAGE real sample_share(colour v, settings_t settings)
{
    if (WEIGHTING == WEIGHTING_NONE)
        return SPLAT(1.0);
    return SPLAT(1.0) / (SPLAT(settings.luminance_knee) + greater(luminance(v), SPLAT(0.0)));
}

// The texel at the whole part of a footprint.
STAGE real texel_at(plane_in p, footprint f, int stride)
{
    plane_in q = p + f.offset;
#if LANES > 1
    if (f.lanes == LANES_CLOSE) {
        const mask right = f.step_x != 0, down = f.step_y != 0;
        const real a = right ? load(q + 1) : load(q), b = right ? load(q + stride + 1) : load(q + stride);
        return down ? b : a;
    }
    if (f.lanes == LANES_APART)
        return texel_apart(p, f, 0, 0, stride);
#endif
    return load(q);
}

STAGE colour colour_at(plane_in p, footprint f, size_t plane, int stride)
{
    const colour v = { texel_at(p, f, stride), texel_at(p + plane, f, stride), texel_at(p + 2 * plane, f, stride) };
    return v;
}

// True where a kept texel lies in the range of closeness that the current 3x3 has, as `then` saw it.
STAGE mask seen_then(real closeness, surface s, motion_t m, settings_t settings)
{
    const quad alone = { closeness, closeness, closeness, closeness };
    return REJECT == REJECT_NONE ? (closeness == closeness) : same_surface(alone, s, m, settings);
}

// The samples of `frames` kept frames, the latest first. past[k] says how to come from this frame to the k-th, where
// its samples lie in their pixels (jitter) and in which slot of `kept` it is. The pixel's place in frame k falls into
// the area of exactly one sample there: the one whose position rounds to it. A surface that moves on its own is
// followed from sample to sample, by the motion of the sample at the surface's own place (which is not the pixel's
// where the motion is a neighbour's). Where that sample has no motion the surface is lost, and so is all before it.
STAGE gathered gather_samples(plane_in kept, frames_in past, int frames, colour current, real alpha, surface s, int x,
    int y, frame_t frame, settings_t settings)
{
    const size_t plane = plane_size(frame), at = texel_offset(frame, x, y);
    const real zero = SPLAT(0.0), one = SPLAT(1.0);
    gathered g = { { zero, zero, zero }, zero, zero, zero };
    const mask own = OWN_MOTION ? !(outside_domain(s.u) | outside_domain(s.v)) : (s.x != s.x);
    real own_u = s.u, own_v = s.v;
    mask lost = (s.x != s.x);
    for (int k = 0; k < frames; ++k) {
        const frame_t then = past[k];
        motion_t m = motion_from_depth(s, LANE_INDEX + K(x), SPLAT(y), then);
        if (OWN_MOTION) {
            m.u = own ? own_u : m.u;
            m.v = own ? own_v : m.v;
            m.scale = own ? one : m.scale;
            m.shift = own ? zero : m.shift;
            m.visible = m.visible | own;
        }
        const mask seen = on_screen(m, LANE_INDEX + K(x), SPLAT(y), frame) & !lost;
        motion_t nearest = m;
        nearest.u = m.u + (K(0.5) - K(then.jitter_x));
        nearest.v = m.v + (K(0.5) - K(then.jitter_y));
        const footprint f = footprint_of(nearest, seen, frame);
        plane_in p = kept + (size_t)then.slot * KEPT_PLANES * plane + at;
        colour c = colour_at(p, f, plane, frame.stride);
        mask good = seen & !colour_outside_domain(c);
        const real q = usable_closeness(texel_at(p + KEPT_CLOSENESS * plane, f, frame.stride), then);
        good = good & seen_then(q, s, m, settings);
        if (EXPOSURE)
            c = scaled(c, SPLAT(then.exposure_ratio));
        c = choose_colour(good, to_range(c), current);
        const real w = good ? sample_share(c, settings) : zero;
        g.sum.r += w * (c.r - current.r);
        g.sum.g += w * (c.g - current.g);
        g.sum.b += w * (c.b - current.b);
        g.weight += w;
        g.count += good ? one : zero;
        if (ALPHA) {
            const real a = usable_share(texel_at(p + KEPT_ALPHA * plane, f, frame.stride), one);
            g.alpha += good ? a - alpha : zero;
        }
        if (OWN_MOTION) {
            motion_t place = nearest;
            place.u += s.x;
            place.v += s.y;
            const footprint there = footprint_of(place, seen, frame);
            const real u = texel_at(p + KEPT_MOTION * plane, there, frame.stride);
            const real v = texel_at(p + (KEPT_MOTION + 1) * plane, there, frame.stride);
            lost = lost | (own & (!seen | outside_domain(u) | outside_domain(v)));
            own_u += u;
            own_v += v;
        }
    }
    return g;
}

// The pixel as the weighted mean of its samples, the current one among them.
STAGE resolved resolve_gathered(gathered g, colour current, colour filtered, real alpha, real reactivity,
    statistics near, motion_t m, frame_t frame, settings_t settings)
{
    const real zero = SPLAT(0.0), one = SPLAT(1.0);
    const mask any = g.count > zero;
    const real weight = any ? g.weight : one;
    const colour past = { current.r + g.sum.r / weight, current.g + g.sum.g / weight, current.b + g.sum.b / weight };
    const rectification r = rectify(past, current, near, m, box_gamma(m, settings), frame, settings);
    real share = g.weight / (sample_share(current, settings) + g.weight);
    real alpha_share = one;
    if (REACTIVE) {
        share *= one - reactivity;
        alpha_share = one - reactivity;
    }
    const colour mixed = { current.r + share * ((past.r - current.r) + r.change.r),
        current.g + share * ((past.g - current.g) + r.change.g),
        current.b + share * ((past.b - current.b) + r.change.b) };
    colour chosen = choose_colour(any, mixed, fresh_colour(current, near.mean, settings));
    if (FILTER_USE == FILTER_USE_FEW_SAMPLES)
        chosen = drawn_towards(chosen, filtered, filtered_share(one / (g.count + one), filtered, settings));
    const colour v = from_range(chosen);
    resolved out;
    out.rgb.r = storable(v.r, lesser(current.r, zero));
    out.rgb.g = storable(v.g, lesser(current.g, zero));
    out.rgb.b = storable(v.b, lesser(current.b, zero));
    out.alpha = alpha;
    if (ALPHA_FROM == ALPHA_FROM_BLEND)
        out.alpha = alpha + alpha_share * (g.alpha / (g.count + one));
    out.count = g.count + one;
    return out;
}
