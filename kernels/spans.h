// Where light may change, how far back should a pixel look? It is resolved from several spans of its past, and each
// leaves an error: how far its latest samples lie from what the span says. A span that is too short errs by their
// noise, one that is too long by what has changed since.
#include "gather.h"

// Planes of a span: r, g, b, error, count, alpha. The spans stand one behind the other: the latest frames, a few more,
// all, and without motion all since the camera came to stand. The count of the first says how many of the latest
// samples showed the surface, those too that do not count since they are unlike.
#define SPAN_PLANES (5 + ALPHA)
#define ALL_FRAMES (SPANS - 2)
#define UNMOVED (SPANS - 1)

// How many of the kept frames a span has.
STAGE int span_end(int span, int frames)
{
    const int end = span == 0 ? SHORT_SPAN : (span < ALL_FRAMES ? MIDDLE_SPAN : frames);
    return end < frames ? end : frames;
}

// Squared distances of the latest samples, the current one among them, from what a span says, all channels, of light as
// much as it counts in a mean: the edge of a highlight would outweigh all around it that a screen can show. A span
// holds these samples itself and lies the nearer to them the fewer others it has, which is made good (leave one out).
STAGE real span_error(gathered g, colour now, resolved span, settings_t settings)
{
    const real one = SPLAT(1.0), two = SPLAT(2.0);
    const colour d = share_difference(to_range(span.rgb), now, settings);
    const real along = (d.r * g.recent.r + d.g * g.recent.g) + d.b * g.recent.b;
    const real size = (d.r * d.r + d.g * d.g) + d.b * d.b;
    const real squares = (g.recent_squares - two * along) + (one + g.recent_count) * size;
    const real left = one - reciprocal(greater(span.count, SPLAT(1.5)));
    return quotient(greater(squares, SPLAT(0.0)), left * left);
}

// What the k-th kept frame drew at the pixel's own place, or the current sample where that is no colour.
STAGE colour drawn_here(mask* good, plane_in kept, frames_in past, int k, pixel_t p, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame);
    const frame_t then = past[k];
    colour c = load_colour(kept + (size_t)then.slot * KEPT_PLANES * plane + texel_offset(frame, x, y), plane);
    *good = !colour_outside_domain(c);
    if (EXPOSURE)
        c = scaled(c, SPLAT(then.exposure_ratio));
    return choose_colour(*good, to_range(c), p.own);
}

// How much counts of the sample that the k-th kept frame drew there, by its reactivity.
STAGE real alike_here(plane_in kept, frames_in past, int k, pixel_t p, int x, int y, frame_t frame)
{
    const real one = SPLAT(1.0);
    if (!REACTIVE)
        return one;
    plane_in q = kept + ((size_t)past[k].slot * KEPT_PLANES + KEPT_REACTIVE) * plane_size(frame);
    return as_reactive(load_share(q + texel_offset(frame, x, y), SPLAT(0.0)), p);
}

// Whether something as close as the surface stood at the pixel's own place before the latest frames, which were drawn
// by the camera of now.
STAGE mask stood_here(
    plane_in kept, frames_in past, int frames, surface s, int x, int y, frame_t frame, settings_t settings)
{
    const real zero = SPLAT(0.0);
    if (frames < SHORT_SPAN)
        return zero != zero;
    const size_t plane = plane_size(frame);
    const frame_t then = past[SHORT_SPAN - 1];
    const motion_t still = { zero, zero, SPLAT(1.0), zero, zero == zero };
    plane_in q = kept + ((size_t)then.slot * KEPT_PLANES + KEPT_CLOSENESS) * plane + texel_offset(frame, x, y);
    return seen_then(usable_closeness(load(q), then), s, still, settings);
}

// How far light at the pixel's own place differs from what frames drew whose samples lie nearly where those of the
// frame that is asked lie: squares, of the latest frames together and of each on average of all. What an edge or a
// texture within the pixel does to two samples of one place is the same, and no change.
typedef struct
{
    real latest, all, pairs;
    mask told; // each of the latest frames has such a frame
} repeats_t;

STAGE repeats_t no_repeats(void)
{
    const real zero = SPLAT(0.0);
    const repeats_t r = { zero, zero, zero, zero == zero };
    return r;
}

// One frame's sample and that of the frame that repeats it; `good` where both are colours.
STAGE void add_repeat(repeats_t* r, colour sample, colour again, mask good, int latest, settings_t settings)
{
    const colour d = share_difference(again, sample, settings);
    const real squares = good ? (d.r * d.r + d.g * d.g) + d.b * d.b : SPLAT(0.0);
    if (latest) {
        r->latest += squares;
        r->told = r->told & good;
    }
    r->all += squares;
    r->pairs += good ? SPLAT(1.0) : SPLAT(0.0);
}

// What repeated samples say of the span without motion, or `otherwise` where there are none or where the latest frames
// did not see the surface (`lately` false): they were drawn of another. What moves along itself is asked of the latest
// samples alone: before them other things may have been there. What stands has to have had the same light all the time,
// since now may look like then and not like what was between: of that the variance of so many samples counts, half of
// the squares of their differences.
STAGE real repeat_error(repeats_t r, mask lately, mask moves, real otherwise)
{
    const real all = K(0.5 * (SHORT_SPAN + 1)) * quotient(r.all, greater(r.pairs, SPLAT(1.0)));
    const mask some = lately & r.told & (r.pairs > SPLAT(0.0));
    return some ? (moves ? r.latest : greater(r.latest, all)) : otherwise;
}

// The plain mean of what was drawn at the pixel's own place in the `frames` latest frames, those from the camera of
// now: right for what only moves along itself, as a wheel does, and for light that stands on what moves. `sums` are
// those of its samples, `repeats` says how they differ from those that repeat them. So many samples may weigh nearly
// alike: a firefly among them does little, and what their weights take off where dark and bright meet is the same in
// every frame.
STAGE resolved resolve_unmoved(gathered* sums, repeats_t* repeats, plane_in kept, frames_in past, int frames, pixel_t p,
    int x, int y, frame_t frame, settings_t settings)
{
    const size_t plane = plane_size(frame);
    const uint at = texel_offset(frame, x, y);
    const real zero = SPLAT(0.0), one = SPLAT(1.0);
    gathered g = no_samples();
    repeats_t r = no_repeats();
    colour after = p.own;
    mask after_good = zero == zero;
    settings_t standing = settings;
    standing.luminance_knee *= STANDING_KNEE;
    for (int k = 0; k < frames; ++k) {
        mask good;
        const colour c = drawn_here(&good, kept, past, k, p, x, y, frame);
        const real counted = good ? alike_here(kept, past, k, p, x, y, frame) : zero;
        const real w = counted * sample_share(c, standing);
        const colour d = { c.r - p.own.r, c.g - p.own.g, c.b - p.own.b };
        if (k < SHORT_SPAN)
            add_recent(&g, share_difference(c, p.own, settings), counted);
        g.sum.r += w * d.r;
        g.sum.g += w * d.g;
        g.sum.b += w * d.b;
        g.weight += w;
        g.count += counted;
        if (past[k].again >= 0) {
            mask good_again;
            const colour again = drawn_here(&good_again, kept, past, past[k].again, p, x, y, frame);
            add_repeat(&r, after, again, good_again & after_good, k <= SHORT_SPAN, settings);
        }
        after = c;
        after_good = good;
        if (ALPHA) {
            plane_in q = kept + ((size_t)past[k].slot * KEPT_PLANES + KEPT_ALPHA) * plane + at;
            g.alpha += counted * (load_share(q, one) - p.alpha);
        }
    }
    const real whole_weight = sample_share(p.own, standing) + g.weight;
    const colour v = { p.own.r + quotient(g.sum.r, whole_weight), p.own.g + quotient(g.sum.g, whole_weight),
        p.own.b + quotient(g.sum.b, whole_weight) };
    resolved out;
    out.count = g.count + one;
    out.rgb = storable_colour(from_range(v), p.own);
    out.alpha = p.alpha;
    if (ALPHA_FROM == ALPHA_FROM_BLEND)
        out.alpha = p.alpha + quotient(g.alpha, out.count);
    *sums = g;
    *repeats = r;
    return out;
}

STAGE void store_span(plane_out spans, int span, resolved r, real error, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame);
    plane_out p = spans + (size_t)span * SPAN_PLANES * plane + texel_offset(frame, x, y);
    store(p, r.rgb.r);
    store(p + plane, r.rgb.g);
    store(p + 2 * plane, r.rgb.b);
    store(p + 3 * plane, error);
    store(p + 4 * plane, r.count);
    if (ALPHA)
        store(p + 5 * plane, r.alpha);
}

// All spans but that without motion say what that of all frames does where most of the latest samples are unlike: of
// what a veil has just come over or left they tell next to nothing.
STAGE void stand_in(plane_out spans, gathered latest, resolved all, real error, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame);
    const mask unlike = latest.unlike > latest.recent_count;
    if (!any_of(unlike))
        return;
    for (int span = 0; span < ALL_FRAMES; ++span) {
        plane_out p = spans + (size_t)span * SPAN_PLANES * plane + texel_offset(frame, x, y);
        resolved r = all;
        r.rgb = choose_colour(unlike, all.rgb, load_colour(p, plane));
        r.count = unlike ? (span ? all.count : all.count + latest.unlike) : load(p + 4 * plane);
        if (ALPHA)
            r.alpha = unlike ? all.alpha : load(p + 5 * plane);
        store_span(spans, span, r, unlike ? error : load(p + 3 * plane), x, y, frame);
    }
}
