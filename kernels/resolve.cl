// The temporal resolve. A work-item walks down a column of the image, a segment of LANES pixels at a time.
//
// `real` is one float on a GPU and a vector of LANES neighbouring pixels on a CPU. K(v) is v in the type of a lane,
// SPLAT(v) a `real` with v in every lane, LANE_INDEX the lane numbers from 0 (platform/lanes.h). plane_in and plane_out
// point to planes of floats with a halo, history_in and history_out to such planes in the storage format of the
// history.
//
// The prelude defines the other names in capitals, frame_t (numbers of the frame) and settings_t (those of the preset).
// cltaa/core/build.py writes it in front of this text; `cltaa kernels --show resolve` prints it.
//
// sample_history also tests the history for disocclusion and for changed light, hence its arguments `current`, `alpha`
// and `rows.below.texels`. extend_stored repeats the image's edges into the halo; on a GPU, extend_edges_kernel of
// store.cl does so instead.
#include "taa/fireflies.h"
#include "schedule/window.h"

__kernel void resolve_kernel(plane_in current, plane_in inverse_depth, plane_in motion, plane_in alpha,
    plane_in reactive, history_in history, plane_in history_count, plane_in previous_inverse_depth, history_out output,
    plane_out output_count, const frame_t frame, const settings_t settings)
{
    const column_t column = own_column(frame);
    if (is_empty(column, frame))
        return;
    const int x = column.x;
    window_t rows = open_window(current, alpha, inverse_depth, motion, column, frame);
    row_cache cache = empty_row_cache();
    for (int y = column.first; y < column.end; ++y) {
        // Read: the 3x3 around the pixel, its statistics, and the pixel's own sample.
        slide_window(&rows, current, alpha, inverse_depth, motion, x, y, frame);
        pixel_t p = current_pixel(rows.above, rows.centre, rows.below, reactive, x, y, frame);

        // Reproject: where the nearest surface of the 3x3 was in the previous frame.
        const surface s = borrowed_surface(
            nearest_surface(rows.above, rows.centre, rows.below, settings), inverse_depth, motion, x, y, frame);
        const motion_t m = surface_motion(s, LANE_INDEX + K(x), SPLAT(y), frame);

        // Sample the history there. It is invalid where the previous frame did not show that surface.
        const history_t h = sample_history(current, alpha, rows.below.texels, rows.centre.has_missing, history,
            history_count, previous_inverse_depth, m, s, x, y, frame, settings, &cache);

        // Rectify: move the history into the box of the 3x3, by neighbourhood clamp or variance clipping. The default
        // does not: its tests drop wrong history.
        rectification r = rectify(h.rgb, p.filtered, p.stats, m, box_scale_of(m, settings), frame, settings);
        const int has_missing = rows.above.has_missing | rows.centre.has_missing | rows.below.has_missing;
        r.alpha = rectified_alpha(current, alpha, has_missing, h.alpha, x, y, frame);

        // Dim fireflies, if the preset does so.
        p = without_firefly(p, rows.above.texels, rows.centre.texels, rows.below.texels, h, settings);

        // Accumulate: blend the sample with the history, by the history's effective sample count.
        resolved out = resolve_pixel(p, h, r, settings);
        if (rows.centre.has_missing) // a pixel without a usable sample keeps its history
            out = without_missing(out, h, current, alpha, x, y, frame);

        // Store: this result is the history of the next frame.
        store_recurrent(output, output_count, out, x, y, frame);
    }
    extend_stored(output, 3 + ALPHA, output_count, 1 + TESTS_LIGHT, stored_block(column), frame);
}
