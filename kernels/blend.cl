// Stage 6 on its own: the current sample blended with the rectified history. Writes the output and its count.
#include "pixel.h"

__kernel void blend_kernel(plane_in current, plane_in alpha, plane_in reactive, plane_in statistics_in,
    plane_in history_at, plane_in change_in, history_out output, plane_out output_count, const frame_t frame,
    const settings_t settings)
{
    const int x = (int)get_global_id(0) * LANES, y = (int)get_global_id(1);
    if (x >= frame.width || y >= frame.height)
        return;
    const size_t plane = plane_size(frame);
    const uint at = texel_offset(frame, x, y);
    plane_in q = history_at + at, c = change_in + at;
    history_t h;
    h.rgb = load_colour(q, plane);
    h.alpha = load(q + 3 * plane);
    h.count = load(q + 4 * plane);
    h.fx = load(q + 5 * plane);
    h.fy = load(q + 6 * plane);
    h.most = most_samples(h.fx, h.fy, settings);
    h.valid = load(q + 7 * plane) > SPLAT(0.5);
    h.change = load(q + 8 * plane);
    const rectification r = { load_colour(c, plane), load(c + 3 * plane), load(c + 4 * plane), load(c + 5 * plane) };
    h.alpha = past_alpha(alpha, h.alpha, x, y, frame);
    const colour mean = load_colour(statistics_in + at, plane);
    pixel_t p; // of it only what is looked at after rectification
    p.near.mean = from_units((boxed) { mean.r, mean.g, mean.b });
    p.alpha = ALPHA ? load_share(alpha + at, SPLAT(1.0)) : SPLAT(1.0);
    p.reactivity = REACTIVE ? load_share(reactive + at, SPLAT(0.0)) : SPLAT(0.0);
    p.filtered = load_colour(statistics_in + at + 12 * plane, plane);
    p.luminance = luminance_4(p.filtered);
    p.own = FILTER_USE == FILTER_USE_FEW_SAMPLES ? usable_colour(current, plane, x, y, frame) : p.filtered;
    const resolved out = resolve_pixel(p, h, r, settings);
    store_recurrent(output, output_count, out, x, y, frame);
}
