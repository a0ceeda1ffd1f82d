// The temporal resolve, fused. One work-item slides a segment of LANES pixels down ROWS rows, so that each row of the
// neighbourhood is read and converted once.
#include "pixel.h"
#include "ahead.h"

__kernel void resolve_kernel(plane_in current, plane_in closeness, plane_in motion, plane_in alpha, plane_in reactive,
    history_in history, plane_in history_count, plane_in previous_closeness, history_out output, plane_out output_count,
    const frame_t frame, const settings_t settings)
{
    const int x = (int)get_global_id(0) * LANES, first = frame.first_row + (int)get_global_id(1) * ROWS;
    const int below_band = frame.first_row + band_rows(frame);
    const int end = below_band < frame.height ? below_band : frame.height;
    if (x >= frame.width || first >= end)
        return;
    const int last = first + ROWS < end ? first + ROWS : end;
    if ((LANES == 1) & (CAMERA_MOTION | OWN_MOTION))
        fetch_first(current, closeness, motion, history, history_count, previous_closeness, x, first, frame);
    row_t above = { 0 }, centre = { 0 };
    ROLLED
    for (int y = first - 1; y <= first; ++y) {
        above = centre;
        centre = read_next_row(above, current, closeness, motion, x, y, frame);
    }
    kept_rows kept = nothing_kept();
    for (int y = first; y < last; ++y) {
        fetch_frame(current, closeness, motion, x, y, frame);
#if !COLUMNS_AHEAD
        if (LANES > 1)
            fetch_history(history, history_count, previous_closeness, history_offset(frame, x, y), frame);
#endif
        const row_t below = read_next_row(centre, current, closeness, motion, x, y + 1, frame);
        const pixel_t p = current_pixel(above, centre, below, alpha, reactive, x, y, frame);
        const surface s = nearest_surface(above, centre, below, settings);
        const motion_t m = surface_motion(s, LANE_INDEX + K(x), SPLAT(y), frame);
#if COLUMNS_AHEAD
        // Not beside the frame's: more would be asked for at a time than can be under way.
        fetch_history(history, history_count, previous_closeness, history_offset(frame, x, y), frame);
#endif
        history_t h = sample_history(
            current, below.texels, history, history_count, previous_closeness, m, s, x, y, frame, settings, &kept);
        const rectification r = rectify(h.rgb, p.filtered, p.near, m, box_gamma(m, settings), frame, settings);
        if (ALPHA)
            h.alpha = past_alpha(alpha + texel_offset(frame, x, y), h.alpha, frame);
        const resolved out = resolve_pixel(p, h, r, settings);
        store_resolved(output, output_count, out, x, y, frame);
        above = centre;
        centre = below;
    }
}
