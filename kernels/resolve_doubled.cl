// The temporal resolve with a history at 200 %: four texels a pixel, each at its own place, which motion reads with
// half the blur. One work-item slides a segment of LANES pixels down ROWS rows, as in resolve.cl.
#include "doubled.h"
#include "ahead.h"
#include "edges.h"

__kernel void resolve_doubled_kernel(plane_in current, plane_in closeness, plane_in motion, plane_in alpha,
    plane_in reactive, plane_in previous_closeness, history_in texels, history_out texels_out, history_out output,
    plane_out output_count, const frame_t frame, const settings_t settings)
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
        const surface s = nearest_surface(above, centre, below, settings);
        const motion_t m = surface_motion(s, LANE_INDEX + K(x), SPLAT(y), frame);
        doubled_t d = sample_doubled(previous_closeness, texels, m, s, x, y, frame, settings);
        const rectification r = rectify(d.mean, p.filtered, p.near, m, box_gamma(m, settings), frame, settings);
        resolved out[4];
        for (int t = 0; t < 4; ++t) {
            if (ALPHA)
                d.texel[t].alpha = past_alpha(alpha + texel_offset(frame, x, y), d.texel[t].alpha, frame);
            out[t] = resolve_texel(p, d.texel[t], r, sample_mass(t, frame), settings);
            store_texel(texels_out, out[t], t, x, y, frame);
        }
        store_resolved(output, output_count, mean_of_texels(out), x, y, frame);
        above = centre;
        centre = below;
    }
    const block_t stored = { x, x + LANES, first, last };
    extend_stored(texels_out, 4 * CHANNELS, 0, 0, stored, frame);
    extend_stored(output, 3 + ALPHA, output_count, 1, stored, frame);
}
