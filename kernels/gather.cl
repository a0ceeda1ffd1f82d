// The temporal resolve from a ring of frames: each pixel gathers the samples that the last frames rendered inside it.
#include "gather/samples.h"
#include "gather/subpixel.h"
#include "schedule/window.h"

__kernel void gather_kernel(plane_in current, plane_in inverse_depth, plane_in motion, plane_in alpha,
    plane_in reactive, plane_in ring, frame_records past, const int frames, history_out output, plane_out output_count,
    const frame_t frame, const settings_t settings)
{
    const column_t column = own_column(frame);
    if (is_empty(column, frame))
        return;
    const int x = column.x;
    window_t rows = open_window(current, alpha, inverse_depth, motion, column, frame);
    for (int y = column.first; y < column.end; ++y) {
        // Read: the 3x3 around the pixel, its statistics, and the pixel's own sample.
        slide_window(&rows, current, alpha, inverse_depth, motion, x, y, frame);
        pixel_t p = current_pixel(rows.above, rows.centre, rows.below, reactive, x, y, frame);
        p.missing = sample_is_missing(current, alpha, x, y, frame);

        // Reproject: the nearest surface of the 3x3, and at a depth edge the one behind it.
        surface s = nearest_surface(rows.above, rows.centre, rows.below, settings);
        const motion_t m = surface_motion(s, LANE_INDEX + K(x), SPLAT(y), frame);
        layers_t l = layers_of(rows.above, rows.centre, rows.below, s, settings);
        find_subpixel_feature(&s, &l, ring, past, frames, x, y, frame, settings);
        path_t near = begin_path(s, l, NEARER, p, current, alpha, inverse_depth, motion, x, y, frame, settings);
        path_t far = begin_path(s, l, FARTHER, p, current, alpha, inverse_depth, motion, x, y, frame, settings);

        // Sample the history: follow each surface back through the frame ring, and sum up the samples on it.
        gather_samples(&near, ring, past, 0, frames, 0, p, x, y, frame, settings);
        if (any_of(l.edge))
            gather_samples(&far, ring, past, 0, frames, 0, p, x, y, frame, settings);

        // Accumulate: fit the pixel's colour to these samples, rectified if the preset does so.
        const resolved out = resolve_gathered(near.sums, far.sums, l, p, m, current, alpha, x, y, frame, settings);

        // Store.
        store_resolved(output, output_count, out, x, y, frame);
    }
    extend_stored(output, 3 + ALPHA, output_count, 1, stored_block(column), frame);
}
