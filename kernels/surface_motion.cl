// Stage 3 on its own: the motion that each pixel follows. 7 planes: u, v, scale, shift, visible (1 or 0), and the
// nearest and farthest closeness of the 3x3. See neighbourhood.h and projection.h.
#include "projection.h"

__kernel void surface_motion_kernel(plane_in current, plane_in closeness, plane_in motion, plane_out motion_out,
    const frame_t frame, const settings_t settings)
{
    const int x = (int)get_global_id(0) * LANES, y = (int)get_global_id(1);
    if (x >= frame.width || y >= frame.height)
        return;
    const size_t plane = plane_size(frame);
    const surface s = nearest_surface(read_row(current, closeness, motion, x, y - 1, frame),
        read_row(current, closeness, motion, x, y, frame), read_row(current, closeness, motion, x, y + 1, frame),
        settings);
    const motion_t m = surface_motion(s, LANE_INDEX + K(x), SPLAT(y), frame);
    plane_out p = motion_out + texel_offset(frame, x, y);
    store(p, m.u);
    store(p + plane, m.v);
    store(p + 2 * plane, m.scale);
    store(p + 3 * plane, m.shift);
    store(p + 4 * plane, m.visible ? SPLAT(1.0) : SPLAT(0.0));
    store(p + 5 * plane, s.nearest);
    store(p + 6 * plane, s.farthest);
}
