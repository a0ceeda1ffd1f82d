// As gather.cl, but where light may change: each pixel from several spans of its past, and how far each is off. Which
// of them to believe is weigh_spans.cl's to say.
#include "window.h"
#include "ahead.h"
#include "edges.h"

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
        gathering b = begin_gathering(above, centre, below, p, kept, past, frames, x, y, frame, settings);
        side_t front = { b.s, b.l }, back = front;
        if (b.edges) {
            front = side_of(b.s, b.l, 0, p.own, current, closeness, motion, x, y, frame, settings);
            back = side_of(b.s, b.l, 1, p.own, current, closeness, motion, x, y, frame, settings);
            add_side(&b.far, back, p.own, settings);
        }
        track_t t = first_step(front.s), far_t = first_step(back.s);
        resolved out;
        real error = SPLAT(0.0);
        for (int span = 0, from = 0; span <= ALL_FRAMES; ++span) {
            const int to = span_end(span, frames);
            b.near = gather_samples(
                kept, past, from, to, SHORT_SPAN, &t, b.near, p, front.s, front.l, 0, x, y, frame, settings);
            if (b.edges)
                b.far = gather_samples(
                    kept, past, from, to, 0, &far_t, b.far, p, back.s, back.l, 1, x, y, frame, settings);
            out = resolve_gathered(b.near, b.far, b.l, p, b.m, frame, settings);
            error = span_error(b.near, p.own, out, settings);
            store_span(spans, span, out, error, x, y, frame);
            from = to;
        }
        if (REACTIVE)
            stand_in(spans, b.near, out, error, x, y, frame);
        const resolved unmoved = resolve_unmoved(&b.near, kept, past, standing, p, x, y, frame, settings);
        // What no latest sample could contradict says nothing.
        const mask told = b.near.recent_count >= SPLAT(SHORT_SPAN);
        out.rgb = choose_colour(told, unmoved.rgb, out.rgb);
        out.alpha = told ? unmoved.alpha : out.alpha;
        out.count = told ? unmoved.count : out.count;
        error = told ? span_error(b.near, p.own, unmoved, settings) : error;
        store_span(spans, UNMOVED, out, error, x, y, frame);
        above = centre;
        centre = below;
    }
    const block_t stored = { x, x + LANES, first, last };
    extend_stored(0, 0, spans, SPANS * SPAN_PLANES, stored, frame);
}
