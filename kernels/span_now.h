// What the current frame says of what the spans of a pixel's past came to. It has one sample a pixel, whose noise is
// that of an edge or a texture within it; but all of them are of now, and the latest frames are not.
#include "span_weights.h"

#define NOW_TEXELS 9

// Of one channel the differences of the texels from what the spans say there, and the slope of that.
typedef struct
{
    real sum, level, along, down, of_texel[NOW_TEXELS];
} now_t;

STAGE now_t nothing_now(void)
{
    now_t n;
    n.sum = n.level = n.along = n.down = SPLAT(0.0);
    return n;
}

STAGE void add_now(now_t* n, int k, real said, real now, real weight)
{
    n->of_texel[k] = now - said;
    n->sum += weight * n->of_texel[k];
    n->level += weight * absolute(said);
    n->along += K(k % 3 - 1) * said;
    n->down += K(k / 3 - 1) * said;
}

// Their mean, its variance, and the mean light.
STAGE drift_t now_drift(now_t n, const real* weights, real weight)
{
    const real mean = quotient(n.sum, weight);
    real squares = SPLAT(0.0);
    for (int k = 0; k < NOW_TEXELS; ++k) {
        const real off = n.of_texel[k] - mean;
        squares += weights[k] * (off * off);
    }
    const drift_t drift = { mean, quotient(squares, weight * SPLAT(NOW_TEXELS - 1)), quotient(n.level, weight) };
    return drift;
}

// What is left of a difference that what the spans came to has from now, without what chance may have made of it: the
// noise of the texels, and in their mean that of one sample of a slope beside its middle (the jitter is that of all).
// A slope is the least squares' one of a 3x3, whose steps have squares that add up to 6.
STAGE real no_chance(real difference, drift_t d, now_t n, real shared, frame_t frame)
{
    const real zero = SPLAT(0.0);
    const real by_jitter = (n.along * K(frame.jitter_x) + n.down * K(frame.jitter_y)) * SPLAT(1.0 / 6.0);
    const real noise = SPLAT(NOW_T) * (square_root(d.variance + shared) + SPLAT(NOW_FLOOR) * d.level);
    return difference - limit(difference, lesser(by_jitter, zero) - noise, greater(by_jitter, zero) + noise);
}

// What the spans say of the texel `step` from p: by what each counts at p.
STAGE colour said_at(plane_in spans, const real* shares, ptrdiff_t step, frame_t frame)
{
    const size_t plane = plane_size(frame);
    const colour first = load_colour(spans + step, plane);
    colour said = first;
    for (int span = 1; span < SPANS; ++span) {
        const colour v = load_colour(span_plane(spans, span, 0, frame) + step, plane);
        said.r += shares[span] * (v.r - first.r);
        said.g += shares[span] * (v.g - first.g);
        said.b += shares[span] * (v.b - first.b);
    }
    return said;
}

// v, which the spans came to, moved to what the 3x3 of now shows, as far as that is not chance.
STAGE colour moved_to_now(
    colour v, plane_in spans, const real* shares, plane_in current, frame_t frame, settings_t settings)
{
    const size_t plane = plane_size(frame);
    now_t r = nothing_now(), g = r, b = r;
    real weights[NOW_TEXELS], weight = SPLAT(0.0);
    for (int k = 0; k < NOW_TEXELS; ++k) {
        const ptrdiff_t step = (k / 3 - 1) * (ptrdiff_t)row_stride(frame) + (k % 3 - 1);
        const colour said = said_at(spans, shares, step, frame);
        colour now = load_colour(current + step, plane);
        const mask good = !colour_outside_domain(now);
        now = choose_colour(good, now, said);
        weights[k] = good ? sample_share(said, settings) * sample_share(now, settings) : SPLAT(0.0);
        weight += weights[k];
        add_now(&r, k, said.r, now.r, weights[k]);
        add_now(&g, k, said.g, now.g, weights[k]);
        add_now(&b, k, said.b, now.b, weights[k]);
    }
    const mask some = weight > SPLAT(0.0);
    weight = some ? weight : SPLAT(1.0);
    const drift_t dr = now_drift(r, weights, weight), dg = now_drift(g, weights, weight),
                  db = now_drift(b, weights, weight);
    const real shared = ((dr.variance + dg.variance) + db.variance) * K(NOW_SHARED * (NOW_TEXELS - 1) / 3.0);
    const colour here = said_at(spans, shares, 0, frame);
    const colour there = { v.r + no_chance(dr.mean - (v.r - here.r), dr, r, shared, frame),
        v.g + no_chance(dg.mean - (v.g - here.g), dg, g, shared, frame),
        v.b + no_chance(db.mean - (v.b - here.b), db, b, shared, frame) };
    return choose_colour(some, there, v);
}

// v as far as the 5x5 of now can hold it: no farther from what its texels range over than NOW_HELD times as much. A
// thing of the past that is gone leaves nothing there.
STAGE colour held_by_now(colour v, plane_in current, frame_t frame)
{
    const size_t plane = plane_size(frame);
    colour low = v, high = v;
    for (int k = 0; k < SPAN_TEXELS; ++k) {
        colour now = load_colour(current + span_step(k, frame), plane);
        now = choose_colour(!colour_outside_domain(now), now, v);
        low.r = k ? lesser(low.r, now.r) : now.r, high.r = k ? greater(high.r, now.r) : now.r;
        low.g = k ? lesser(low.g, now.g) : now.g, high.g = k ? greater(high.g, now.g) : now.g;
        low.b = k ? lesser(low.b, now.b) : now.b, high.b = k ? greater(high.b, now.b) : now.b;
    }
    const real times = SPLAT(NOW_HELD);
    const colour wide = { times * (high.r - low.r), times * (high.g - low.g), times * (high.b - low.b) };
    const colour held = { limit(v.r, low.r - wide.r, high.r + wide.r), limit(v.g, low.g - wide.g, high.g + wide.g),
        limit(v.b, low.b - wide.b, high.b + wide.b) };
    return held;
}
