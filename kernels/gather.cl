// The temporal resolve without a recurrent image: each pixel gathers the samples that the last frames drew inside it.
// One work-item slides a segment of LANES pixels down ROWS rows, as in resolve.cl.
#include "gather/samples.h"
#include "gather/subpixel.h"
#include "schedule/ahead.h"
#include "schedule/edges.h"

__kernel void gather_kernel(plane_in current, plane_in inverse_depth, plane_in motion, plane_in alpha,
    plane_in reactive, plane_in ring, frame_records past, const int frames, history_out output, plane_out output_count,
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
        gather_samples(&near, ring, past, 0, frames, 0, p, x, y, frame, settings);
        way_t far = begin_way(s, l, FARTHER, p, current, inverse_depth, motion, x, y, frame, settings);
        if (has_edges(l))
            gather_samples(&far, ring, past, 0, frames, 0, p, x, y, frame, settings);
        const resolved out = resolve_gathered(near.sums, far.sums, l, p, m, frame, settings);
        store_resolved(output, output_count, out, x, y, frame);
        above = centre;
        centre = below;
    }
    const block_t stored = { x, x + LANES, first, last };
    extend_stored(output, 3 + ALPHA, output_count, 1, stored, frame);
}
