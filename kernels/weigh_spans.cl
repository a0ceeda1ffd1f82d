// The pixel from the spans of its past that gather_spans.cl found, each as far as the texels around it bear it out.
#include "temporal_window.h"

__kernel void weigh_spans_kernel(
    plane_in spans, history_out output, plane_out output_count, const frame_t frame, const settings_t settings)
{
    const int x = (int)get_global_id(0) * LANES, y = (int)get_global_id(1);
    if (x >= frame.width || y >= frame.height)
        return;
    const size_t plane = plane_size(frame);
    plane_in p = spans + texel_offset(frame, x, y);
    real error[SPANS], least = SPLAT(0.0);
    for (int span = 0; span < SPANS; ++span) {
        error[span] = sum_around(span_plane(p, span, 3, frame), frame);
        least = span == 0 ? error[span] : lesser(least, error[span]);
    }
    // Sums of differences from the shortest span, so that spans that agree keep their bits.
    const colour first = load_colour(p, plane);
    const real zero = SPLAT(0.0), alpha = ALPHA ? load(p + 5 * plane) : SPLAT(1.0), count = load(p + 4 * plane);
    real weight = trust(error[0], least), alpha_sum = zero, count_sum = zero;
    colour sum = { zero, zero, zero }, darkest = first;
    for (int span = 1; span < SPANS; ++span) {
        const real w = trust(error[span], least);
        plane_in q = span_plane(p, span, 0, frame);
        const colour v = load_colour(q, plane), moved = drift_to_shortest(q, p, frame, settings);
        sum.r += w * ((v.r + moved.r) - first.r);
        sum.g += w * ((v.g + moved.g) - first.g);
        sum.b += w * ((v.b + moved.b) - first.b);
        darkest.r = lesser(darkest.r, v.r);
        darkest.g = lesser(darkest.g, v.g);
        darkest.b = lesser(darkest.b, v.b);
        count_sum += w * (load(q + 4 * plane) - count);
        if (ALPHA)
            alpha_sum += w * (load(q + 5 * plane) - alpha);
        weight += w;
    }
    const colour v
        = { first.r + quotient(sum.r, weight), first.g + quotient(sum.g, weight), first.b + quotient(sum.b, weight) };
    resolved out;
    out.rgb = storable_colour(v, darkest);
    out.alpha = alpha + quotient(alpha_sum, weight);
    out.count = count + quotient(count_sum, weight);
    store_resolved(output, output_count, out, x, y, frame);
}
