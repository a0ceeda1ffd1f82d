// The pixel from the spans of its past that gather_spans.cl found, each as far as the texels around it bear it out, and
// beside them from the recursive resolve of the same frame.
#include "span_now.h"
#include "span_recursive.h"

__kernel void weigh_spans_kernel(plane_in current, plane_in spans, plane_in repeats, history_in recursive,
    plane_in recursive_count, history_out output, plane_out output_count, const frame_t frame,
    const settings_t settings)
{
    const int x = (int)get_global_id(0) * LANES, y = (int)get_global_id(1);
    if (x >= frame.width || y >= frame.height)
        return;
    const size_t plane = plane_size(frame);
    plane_in p = spans + texel_offset(frame, x, y);
    const real repeated = sum_around(repeats + texel_offset(frame, x, y), frame);
    real error[SPANS], least = SPLAT(0.0);
    for (int span = 0; span < SPANS; ++span) {
        error[span] = sum_around(span_plane(p, span, 3, frame), frame);
        if (span == UNMOVED)
            error[span] = lesser(error[span], repeated);
        least = span == 0 ? error[span] : lesser(least, error[span]);
    }
    // What light does now: the step from the middle span to the shortest, as far as it is sure. The shortest lags
    // behind now by half as much again.
    const real sharp = SPLAT(SURE_FLOOR);
    const drifts latest = drifts_of(span_plane(p, 1, 0, frame), p, p, SPLAT(0.0), plane, frame, settings);
    const colour rate = believed(latest, shared_noise(error[0]), sharp, SPLAT(SURE_T));
    // Longer spans are moved to where the two shorter ones are, the better of them for the more, and on from there.
    const real better = lesser(error[0], error[1]);
    const real short_trust = trust(error[0], better), middle_trust = trust(error[1], better),
               share = quotient(middle_trust, short_trust + middle_trust);
    // Sums of differences from the shortest span, so that spans that agree keep their bits.
    const colour first = { load(p), load(p + plane), load(p + 2 * plane) };
    const real zero = SPLAT(0.0), one = SPLAT(1.0), alpha = ALPHA ? load(p + 5 * plane) : SPLAT(1.0),
               count = load(p + 4 * plane);
    real weight = trust(error[0], least), alpha_sum = zero, count_sum = zero, ahead = weight * K(LAG);
    colour sum = { zero, zero, zero }, darkest = first;
    real shares[SPANS];
    for (int span = 1; span < SPANS; ++span) {
        const real w = trust(error[span], least);
        plane_in q = span_plane(p, span, 0, frame);
        const drifts d
            = span == 1 ? latest : drifts_of(q, p, span_plane(p, 1, 0, frame), share, plane, frame, settings);
        const colour moved = believed(d, zero, SPLAT(DRIFT_FLOOR), SPLAT(DRIFT_T));
        const real moves = span == UNMOVED ? unsettled(repeated, better) : one;
        ahead += w * (moves * (span == 1 ? SPLAT(LAG) : K(LAG) + share));
        const colour v
            = { load(q) + moves * moved.r, load(q + plane) + moves * moved.g, load(q + 2 * plane) + moves * moved.b };
        sum.r += w * (v.r - first.r);
        sum.g += w * (v.g - first.g);
        sum.b += w * (v.b - first.b);
        darkest.r = lesser(darkest.r, load(q));
        darkest.g = lesser(darkest.g, load(q + plane));
        darkest.b = lesser(darkest.b, load(q + 2 * plane));
        count_sum += w * (load(q + 4 * plane) - count);
        if (ALPHA)
            alpha_sum += w * (load(q + 5 * plane) - alpha);
        shares[span] = w;
        weight += w;
    }
    for (int span = 1; span < SPANS; ++span)
        shares[span] = quotient(shares[span], weight);
    const colour carried = { first.r + quotient(sum.r + ahead * rate.r, weight),
        first.g + quotient(sum.g + ahead * rate.g, weight), first.b + quotient(sum.b + ahead * rate.b, weight) };
    plane_in now = current + texel_offset(frame, x, y);
    const colour v = held_by_now(moved_to_now(carried, p, shares, now, frame, settings), now, frame);
    resolved out;
    out.rgb = storable_colour(v, darkest);
    out.alpha = alpha + quotient(alpha_sum, weight);
    out.count = count + quotient(count_sum, weight);
    const size_t at = texel_offset(frame, x, y);
    out = beside_recursive(out, recursive + at, load(recursive_count + at), count, frame);
    store_resolved(output, output_count, out, x, y, frame);
}
