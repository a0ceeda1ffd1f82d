// The temporal resolve. A work-item takes a column of the image, pixel by pixel from above: LANES of them at once.
#include "taa/accumulate.h"
#include "schedule/window.h"
#include "schedule/edges.h"

__kernel void resolve_kernel(plane_in current, plane_in inverse_depth, plane_in motion, plane_in alpha,
    plane_in reactive, history_in history, plane_in history_count, plane_in previous_inverse_depth, history_out output,
    plane_out output_count, const frame_t frame, const settings_t settings)
{
    const column_t column = own_column(frame);
    if (is_empty(column, frame))
        return;
    const int x = column.x;
    fetch_first(current, inverse_depth, motion, history, history_count, previous_inverse_depth, x, column.first, frame);
    window_t near = open_window(current, inverse_depth, motion, column, frame);
    row_cache cache = empty_row_cache();
    for (int y = column.first; y < column.end; ++y) {
        // Read: the 3x3 of the frame, of which the row below is new.
        slide_window(&near, current, inverse_depth, motion, x, y, frame);

        // Reproject: the nearest surface of the 3x3, and how it moved.
        const surface s = nearest_surface(near.above, near.centre, near.below, settings);
        const motion_t m = surface_motion(s, LANE_INDEX + K(x), SPLAT(y), frame);
        const pixel_t p = current_pixel(near.above, near.centre, near.below, alpha, reactive, x, y, frame);

        // Sample the history where that surface was, unless it was hidden there.
        history_t h = sample_history(current, near.below.texels, history, history_count, previous_inverse_depth, m, s,
            x, y, frame, settings, &cache);
        h.alpha = past_alpha(alpha, h.alpha, x, y, frame);

        // Rectify: pull its colour into the box of what the frame shows around the pixel.
        const rectification r = rectify(h.rgb, p.filtered, p.near, m, box_scale_of(m, settings), frame, settings);

        // Accumulate: blend the sample with it, by how many samples it stands for.
        const resolved out = resolve_pixel(p, h, r, settings);

        store_recurrent(output, output_count, out, x, y, frame);
    }
    const block_t stored = { x, x + LANES, column.first, column.end };
    extend_stored(output, 3 + ALPHA, output_count, 1 + TESTS_LIGHT, stored, frame);
}
