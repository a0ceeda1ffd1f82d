// As gather.cl, but where light may change: each pixel from several windows of its past, and how far each is off. Which
// of them to believe is weigh_windows.cl's to say.
#include "gather/subpixel.h"
#include "gather/window.h"
#include "schedule/ahead.h"
#include "schedule/edges.h"

__kernel void gather_windows_kernel(plane_in current, plane_in inverse_depth, plane_in motion, plane_in alpha,
    plane_in reactive, plane_in ring, frame_records past, const int frames, const int standing, plane_out windows,
    const frame_t frame, const settings_t settings)
{
    const int x = (int)get_global_id(0) * LANES, first = (int)get_global_id(1) * ROWS;
    if (x >= frame.width || first >= frame.height)
        return;
    const int last = first + ROWS < frame.height ? first + ROWS : frame.height;
    row_t above = read_row(current, inverse_depth, motion, x, first - 1, frame);
    row_t centre = read_next_row(above, current, inverse_depth, motion, x, first, frame);
    for (int y = first; y < last; ++y) {
        fetch_frame(current, inverse_depth, motion, x, y, frame);
        const row_t below = read_next_row(centre, current, inverse_depth, motion, x, y + 1, frame);
        const pixel_t p = current_pixel(above, centre, below, alpha, reactive, x, y, frame);
        surface s = nearest_surface(above, centre, below, settings);
        const motion_t m = surface_motion(s, LANE_INDEX + K(x), SPLAT(y), frame);
        layers_t l = layers_of(above, centre, below, s, settings);
        find_subpixel_feature(&s, &l, ring, past, frames, x, y, frame, settings);
        way_t near = begin_way(s, l, NEARER, p, current, inverse_depth, motion, x, y, frame, settings);
        way_t far = begin_way(s, l, FARTHER, p, current, inverse_depth, motion, x, y, frame, settings);
        resolved out;
        real error = SPLAT(0.0);
        for (int window = 0, from = 0; window <= ALL_FRAMES; ++window) {
            const int to = window_end(window, frames);
            gather_samples(&near, ring, past, from, to, SHORT_WINDOW, p, x, y, frame, settings);
            if (has_edges(l))
                gather_samples(&far, ring, past, from, to, 0, p, x, y, frame, settings);
            out = resolve_gathered(near.sums, far.sums, l, p, m, frame, settings);
            error = window_error(near.sums, p.own, out, settings);
            store_window(windows, window, out, error, x, y, frame);
            from = to;
        }
        if (REACTIVE)
            stand_in(windows, near.sums, out, error, x, y, frame);
        gathered standing_sums;
        const resolved unmoved = resolve_unmoved(&standing_sums, ring, past, standing, p, x, y, frame, settings);
        // What no latest sample could contradict says nothing.
        const mask told = standing_sums.recent_count >= SPLAT(SHORT_WINDOW);
        out.rgb = choose_colour(told, unmoved.rgb, out.rgb);
        out.alpha = told ? unmoved.alpha : out.alpha;
        out.count = told ? unmoved.count : out.count;
        error = told ? window_error(standing_sums, p.own, unmoved, settings) : error;
        store_window(windows, UNMOVED, out, error, x, y, frame);
        above = centre;
        centre = below;
    }
    const block_t stored = { x, x + LANES, first, last };
    extend_stored(0, 0, windows, WINDOWS * WINDOW_PLANES, stored, frame);
}
