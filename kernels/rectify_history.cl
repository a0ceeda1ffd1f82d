// Stage 5 on its own: the change that moves the history of stage 4 into the box of stage 2. 6 planes: r, g, b, pull,
// unrest, calm.
#include "pixel.h"

STAGE boxed load_boxed(plane_in p, size_t plane)
{
    boxed v = { load(p), load(p + plane), load(p + 2 * plane) };
    return from_units(v);
}

__kernel void rectify_history_kernel(plane_in statistics_in, plane_in motion_in, plane_in history_at,
    plane_out change_out, const frame_t frame, const settings_t settings)
{
    const int x = (int)get_global_id(0) * LANES, y = (int)get_global_id(1);
    if (x >= frame.width || y >= frame.height)
        return;
    const size_t plane = plane_size(frame);
    const uint at = texel_offset(frame, x, y);
    plane_in q = statistics_in + at;
    const statistics near = { load_boxed(q, plane), load_boxed(q + 3 * plane, plane), load_boxed(q + 6 * plane, plane),
        load_boxed(q + 9 * plane, plane) };
    motion_t m;
    m.u = load(motion_in + at);
    m.v = load(motion_in + at + plane);
    const rectification r = rectify(load_colour(history_at + at, plane), load_colour(q + 12 * plane, plane), near, m,
        box_gamma(m, settings), frame, settings);
    plane_out p = change_out + at;
    store_colour(p, plane, r.change);
    store(p + 3 * plane, r.pull);
    store(p + 4 * plane, r.unrest);
    store(p + 5 * plane, r.calm);
}
