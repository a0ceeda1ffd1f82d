// Stage 1 on its own: every texel outside the domain replaced by its neighbours' mean. See repair.h.
#include "repair.h"

__kernel void repair_colour_kernel(plane_in current, plane_out repaired, const frame_t frame)
{
    const int x = (int)get_global_id(0) * LANES, y = (int)get_global_id(1);
    if (x >= frame.width || y >= frame.height)
        return;
    const size_t plane = plane_size(frame);
    colour v;
    repair_colours(&v, 1, current, plane, x, y, frame);
    store_colour(repaired + texel_offset(frame, x, y), plane, v);
}
