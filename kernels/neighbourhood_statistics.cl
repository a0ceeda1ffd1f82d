// Stage 2 on its own: mean, standard deviation and extremes of the 3x3, and the current sample. 15 planes: 12 in the
// box space, 3 of colour. See neighbourhood.h.
#include "neighbourhood.h"

STAGE void store_boxed(plane_out p, boxed v, size_t plane)
{
    store(p, v.a);
    store(p + plane, v.b);
    store(p + 2 * plane, v.c);
}

__kernel void neighbourhood_statistics_kernel(
    plane_in current, plane_in closeness, plane_in motion, plane_out statistics_out, const frame_t frame)
{
    const int x = (int)get_global_id(0) * LANES, y = (int)get_global_id(1);
    if (x >= frame.width || y >= frame.height)
        return;
    const size_t plane = plane_size(frame);
    const row_t above = read_row(current, closeness, motion, x, y - 1, frame),
                centre = read_next_row(above, current, closeness, motion, x, y, frame),
                below = read_next_row(centre, current, closeness, motion, x, y + 1, frame);
    const statistics s = neighbourhood_statistics(above, centre, below);
    const colour sample = current_sample(above, centre, below, s, frame);
    plane_out p = statistics_out + texel_offset(frame, x, y);
    store_boxed(p, in_units(s.mean), plane);
    store_boxed(p + 3 * plane, in_units(s.deviation), plane);
    store_boxed(p + 6 * plane, in_units(s.low), plane);
    store_boxed(p + 9 * plane, in_units(s.high), plane);
    store_boxed(p + 12 * plane, (boxed) { sample.r, sample.g, sample.b }, plane);
}
