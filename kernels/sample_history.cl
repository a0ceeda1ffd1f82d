// Stage 4 on its own: the history at the motion of stage 3. 9 planes: r, g, b, alpha, count, fx, fy, valid (1 or 0),
// and how light changes, where that is tested for.
#include "history.h"

__kernel void sample_history_kernel(plane_in current, plane_in motion_in, history_in history, plane_in history_count,
    plane_in previous_closeness, plane_out history_at, const frame_t frame, const settings_t settings)
{
    const int x = (int)get_global_id(0) * LANES, y = (int)get_global_id(1);
    if (x >= frame.width || y >= frame.height)
        return;
    const size_t plane = plane_size(frame);
    const uint at = texel_offset(frame, x, y);
    plane_in q = motion_in + at;
    const motion_t m
        = { load(q), load(q + plane), load(q + 2 * plane), load(q + 3 * plane), load(q + 4 * plane) > SPLAT(0.5) };
    surface s;
    s.nearest = load(q + 5 * plane);
    s.farthest = load(q + 6 * plane);
    kept_rows kept = nothing_kept();
    const history_t h = sample_history(current, read_boxed(current, x, y + 1, frame), history, history_count,
        previous_closeness, m, s, x, y, frame, settings, &kept);
    plane_out p = history_at + at;
    store_colour(p, plane, h.rgb);
    store(p + 3 * plane, h.alpha);
    store(p + 4 * plane, h.count);
    store(p + 5 * plane, h.fx);
    store(p + 6 * plane, h.fy);
    store(p + 7 * plane, h.valid ? SPLAT(1.0) : SPLAT(0.0));
    store(p + 8 * plane, h.change);
}
