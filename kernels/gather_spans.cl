// As gather.cl, but where light may change: each pixel from several spans of its past, and how far each is off. Which
// of them to believe is weigh_spans.cl's to say.
#include "temporal_window.h"
#include "schedule/ahead.h"
#include "schedule/edges.h"

__kernel void gather_spans_kernel(plane_in current, plane_in closeness, plane_in motion, plane_in alpha,
    plane_in reactive, plane_in kept, frames_in past, const int frames, const int standing, plane_out spans,
    const frame_t frame, const settings_t settings)
{
    const int x = (int)get_global_id(0) * LANES, first = (int)get_global_id(1) * ROWS;
    if (x >= frame.width || first >= frame.height)
        return;
    const int last = first + ROWS < frame.height ? first + ROWS : frame.height;
    row_t above = read_row(current, closeness, motion, x, first - 1, frame);
    row_t centre = read_next_row(above, current, closeness, motion, x, first, frame);
    for (int y = first; y < last; ++y) {
        fetch_frame(current, closeness, motion, x, y, frame);
        const row_t below = read_next_row(centre, current, closeness, motion, x, y + 1, frame);
        const pixel_t p = current_pixel(above, centre, below, alpha, reactive, x, y, frame);
        surface s = nearest_surface(above, centre, below, settings);
        const motion_t m = surface_motion(s, LANE_INDEX + K(x), SPLAT(y), frame);
        layers_t l = layers_of(above, centre, below, s, settings);
        recall_thin(&s, &l, kept, past, frames, x, y, frame, settings);
        way_t near = begin_way(s, l, NEARER, p, current, closeness, motion, x, y, frame, settings);
        way_t far = begin_way(s, l, FARTHER, p, current, closeness, motion, x, y, frame, settings);
        resolved out;
        real error = SPLAT(0.0);
        for (int span = 0, from = 0; span <= ALL_FRAMES; ++span) {
            const int to = span_end(span, frames);
            gather_samples(&near, kept, past, from, to, SHORT_SPAN, p, x, y, frame, settings);
            if (has_edges(l))
                gather_samples(&far, kept, past, from, to, 0, p, x, y, frame, settings);
            out = resolve_gathered(near.sums, far.sums, l, p, m, frame, settings);
            error = span_error(near.sums, p.own, out, settings);
            store_span(spans, span, out, error, x, y, frame);
            from = to;
        }
        if (REACTIVE)
            stand_in(spans, near.sums, out, error, x, y, frame);
        gathered standing_sums;
        const resolved unmoved = resolve_unmoved(&standing_sums, kept, past, standing, p, x, y, frame, settings);
        // What no latest sample could contradict says nothing.
        const mask told = standing_sums.recent_count >= SPLAT(SHORT_SPAN);
        out.rgb = choose_colour(told, unmoved.rgb, out.rgb);
        out.alpha = told ? unmoved.alpha : out.alpha;
        out.count = told ? unmoved.count : out.count;
        error = told ? span_error(standing_sums, p.own, unmoved, settings) : error;
        store_span(spans, UNMOVED, out, error, x, y, frame);
        above = centre;
        centre = below;
    }
    const block_t stored = { x, x + LANES, first, last };
    extend_stored(0, 0, spans, SPANS * SPAN_PLANES, stored, frame);
}
