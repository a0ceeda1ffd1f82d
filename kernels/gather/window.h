// The adaptive temporal window: how far back a pixel looks where light may change. It is resolved from several windows
// of its past, and each has an error: the distance of the latest samples from its result. A window that is too short
// errs by their noise, one that is too long by what has changed since. The errors summed over the texels around weight
// the windows, and the texels' mean difference from the shortest shifts the longer ones. Changes without a motion
// vector, such as water's, happen within the shortest: the current filtered sample is a window too. The recursive
// resolve errs in other ways than all these; its mean with them errs less than either.
#include "gather/samples.h"

// Planes of a window: r, g, b, error, count, alpha. The windows in order: the latest frames, more, in a long ring with
// frames ahead more again, all, all at the pixel's own position since the camera stopped (UNMOVED), and beside a
// recursive resolve the current frame alone (PRESENT) and that resolve itself (RECURSIVE), which competes with no
// other.
#define WINDOW_PLANES (5 + ALPHA)
#define ALL_FRAMES (2 + LONG_RING)
#define UNMOVED (ALL_FRAMES + 1)
#define PRESENT (UNMOVED + 1)
#define RECURSIVE (PRESENT + 1)
#define RIVALS (PRESENT + (RECURSION == RECURSION_STANDING)) // windows weighted by their errors
#define WINDOWS (RIVALS + (RECURSION == RECURSION_STANDING))

// Number of frames of the ring in a window.
STAGE int window_end(int window, int frames)
{
    const int more = window == 1 ? MIDDLE_WINDOW : LONG_WINDOW;
    const int end = window == 0 ? SHORT_WINDOW : (window < ALL_FRAMES ? more : frames);
    return end < frames ? end : frames;
}

// Squared distances of the samples of the nearest frames, the current one among them, from a window's result, over all
// channels and alpha. Colours have luminance weights: else the edge of a highlight would outweigh all displayable light
// around it. A window contains these samples and lies the nearer to them the fewer others it has; dividing by (1 - 1 /
// count)^2 corrects that (leave one out).
STAGE real window_error(sample_sums g, pixel_t now, resolved window, settings_t settings)
{
    const real one = SPLAT(1.0), two = SPLAT(2.0);
    const colour d = weighted_difference(to_range(window.rgb), now.own, settings);
    real along = inner(d, g.recent), square = inner(d, d);
    if (ACCUMULATES_ALPHA) {
        const real alpha = window.alpha - now.alpha;
        along += alpha * g.recent_alpha;
        square += alpha * alpha;
    }
    const real squares = (g.recent_squares - two * along) + (own_samples(now) + g.recent_count) * square;
    const real left = one - reciprocal(greater(window.count, SPLAT(1.5)));
    return quotient(greater(squares, SPLAT(0.0)), left * left);
}

// Mean of the samples at the pixel's own position in the `frames` latest frames, which share the current camera: right
// for a surface that moves along itself, such as a wheel, and for light that rests on a moving one. `sums` are those of
// its samples, without the current one.
STAGE resolved resolve_unmoved(sample_sums* sums, plane_in ring, frame_records past, int frames, pixel_t p, int x,
    int y, frame_t frame, settings_t settings)
{
    const size_t plane = plane_size(frame);
    const real zero = SPLAT(0.0), one = SPLAT(1.0);
    sample_sums g = { 0 };
    for (int k = 0; k < frames; ++k) {
        const frame_t then = past[k];
        plane_in q = ring + (size_t)then.slot * RING_PLANES * plane + texel_offset(frame, x, y);
        const texel_t texel = load_texel(q, q + RING_ALPHA * plane, plane);
        colour c = texel.rgb;
        const mask good = !outside_domain_of(texel);
        if (EXPOSURE)
            c = scaled(c, SPLAT(then.exposure_ratio));
        c = choose_colour(good, to_range(c), p.own);
        real counted = good ? one : zero;
        if (REACTIVE)
            counted *= reactivity_weight(load_share(q + RING_REACTIVE * plane, zero), p);
        const real w = counted * luminance_weight(c, settings);
        g.sum = plus_scaled(g.sum, w, minus(c, p.own));
        g.weight += w;
        g.count += counted;
        const real alpha = ALPHA ? share_in_domain(texel.alpha, one) - p.alpha : zero;
        g.alpha += w * alpha;
        if (k < SHORT_WINDOW)
            add_recent(&g, weighted_difference(c, p.own, settings), alpha, counted);
    }
    const real whole_weight = (p.missing ? zero : luminance_weight(p.own, settings)) + g.weight;
    resolved out;
    out.count = g.count + own_samples(p);
    out.rgb = storable_colour(from_range(plus(p.own, quotients(g.sum, whole_weight))), p.own);
    out.alpha = takes_alpha_of_others(p) ? p.alpha + quotient(g.alpha, whole_weight) : p.alpha;
    *sums = g;
    return out;
}

STAGE mask at_rest(motion_t m) { return (m.u == SPLAT(0.0)) & (m.v == SPLAT(0.0)); }

// The result of the recursive resolve, which contains all frames before.
STAGE resolved recursive_result(history_in recursive, plane_in recursive_count, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame);
    const uint at = texel_offset(frame, x, y);
    resolved r;
    r.rgb = load_history_colour(recursive + at, plane);
    r.count = load(recursive_count + at);
    r.alpha = ALPHA ? load_history(recursive + 3 * plane + at) : SPLAT(1.0);
    return r;
}

// Returns a window, or, `where` the recursive resolve holds more samples, its result.
STAGE resolved longer_history(resolved window, mask where, resolved recursive)
{
    const mask longer = where & (recursive.count > window.count);
    resolved out;
    out.rgb = choose_colour(longer, recursive.rgb, window.rgb);
    out.count = longer ? recursive.count : window.count;
    out.alpha = longer ? recursive.alpha : window.alpha;
    return out;
}

// Error of the recursive resolve. Where the surface moves, its blur is a part of it, which a mean with sharper windows
// lessens: hence MOVING_ERROR.
STAGE real recursive_error(sample_sums g, pixel_t p, motion_t m, resolved recursive, settings_t settings)
{
    const real error = window_error(g, p, recursive, settings);
    return at_rest(m) ? error : error * K(MOVING_ERROR);
}

// Number of earlier frames among the nearest `static_frames` frames in the ring.
STAGE int frames_before(frame_records past, int static_frames)
{
    int before = static_frames;
    for (int k = 0; LOOK_AHEAD && k < static_frames; ++k)
        before -= past[k].ahead > 0 ? 1 : 0;
    return before;
}

// True where the tests have refuted the history: the camera was at rest for `before` frames and the surface is now, but
// the recursive resolve holds too few of their samples. A reactive mask marks such pixels by itself.
STAGE mask history_is_refuted(motion_t m, pixel_t p, resolved recursive, int before, settings_t settings)
{
    if (K(before) < K(settings.refuted_samples))
        return (mask)(0);
    const mask few = recursive.count < SPLAT(settings.refuted_samples);
    const mask refuted = at_rest(m) & few & (p.most_reactive <= SPLAT(0.0));
    return p.missing ? (mask)(0) : refuted;
}

// Error of the filtered sample as a window: the distance of the pixel's own sample from the others in the filter, as if
// each of the latest samples had it. Neighbours that agree prove less than samples of the pixel itself, hence
// PRESENT_PENALTY. Where it is not `valid`, or the filter has little weight beside its centre, an error beyond any
// other.
STAGE real present_error(sample_sums g, pixel_t p, mask valid, frame_t frame, settings_t settings)
{
    if ((FILTER_USE != FILTER_USE_FEW_SAMPLES) | (CURRENT_FILTER == CURRENT_FILTER_NONE))
        return SPLAT(DOMAIN_LIMIT);
    const real one = SPLAT(1.0);
    const real across = one - (SPLAT(frame.left_weight) + SPLAT(frame.right_weight)),
               down = one - (SPLAT(frame.above_weight) + SPLAT(frame.below_weight)), others = one - across * down;
    const colour d = weighted_difference(p.filtered, p.own, settings);
    const real error
        = K(PRESENT_PENALTY) * ((own_samples(p) + g.recent_count) * quotient(inner(d, d), others * others));
    return (valid & (others > SPLAT(LEAST_NEIGHBOUR_SHARE))) ? error : SPLAT(DOMAIN_LIMIT);
}

STAGE int has_more_frames(int window, int frames)
{
    return window == 0 || window_end(window, frames) > window_end(window - 1, frames);
}

// 1 if a window equals the one before it, and is not stored: it has no more frames, or it is UNMOVED and the camera has
// been at rest for too few frames to contradict it. Beside a recursive resolve both may hold its history.
STAGE int repeats_previous(int window, int frames, int static_frames)
{
    const int longer = RECURSION == RECURSION_STANDING ? ALL_FRAMES : PRESENT;
    if (window >= longer)
        return 0;
    return window == UNMOVED ? static_frames < SHORT_WINDOW : !has_more_frames(window, frames);
}

STAGE void store_window(plane_out windows, int window, resolved r, real error, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame);
    plane_out p = windows + (size_t)window * WINDOW_PLANES * plane + texel_offset(frame, x, y);
    store_colour(p, plane, r.rgb);
    store(p + 3 * plane, error);
    store(p + 4 * plane, r.count);
    if (ALPHA)
        store(p + 5 * plane, r.alpha);
}

// Where most of the latest samples are unlike, replaces the shorter windows by that of all frames: they hold next to
// nothing of a surface that a veil has just covered or disoccluded.
STAGE void replace_unlike_windows(
    plane_out windows, sample_sums latest, resolved all, real error, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame);
    const mask unlike = latest.unlike > latest.recent_count;
    if (!any_of(unlike))
        return;
    for (int window = 0; window < ALL_FRAMES; ++window) {
        plane_out p = windows + (size_t)window * WINDOW_PLANES * plane + texel_offset(frame, x, y);
        resolved r = all;
        r.rgb = choose_colour(unlike, all.rgb, load_colour(p, plane));
        r.count = unlike ? all.count : load(p + 4 * plane);
        if (ALPHA)
            r.alpha = unlike ? all.alpha : load(p + 5 * plane);
        store_window(windows, window, r, unlike ? error : load(p + 3 * plane), x, y, frame);
    }
}
