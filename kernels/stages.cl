// The stages of resolve.cl one by one, for tests and debug views: each entry point reads the planes that the ones
// before it wrote.
#include "taa/fireflies.h"

STAGE boxed load_boxed(plane_in p, size_t plane)
{
    return from_units((boxed) { load(p), load(p + plane), load(p + 2 * plane) });
}

STAGE void store_boxed(plane_out p, boxed v, size_t plane)
{
    store(p, v.a);
    store(p + plane, v.b);
    store(p + 2 * plane, v.c);
}

// Repair: every texel outside the domain replaced by its neighbours' mean.
__kernel void repair_colour_kernel(plane_in current, plane_in alpha, plane_out repaired, const frame_t frame)
{
    const int x = (int)get_global_id(0) * LANES, y = (int)get_global_id(1);
    if (x >= frame.width || y >= frame.height)
        return;
    const size_t plane = plane_size(frame);
    texel_t v;
    repair_texels(&v, 1, current, alpha, plane, x, y, frame);
    store_colour(repaired + texel_offset(frame, x, y), plane, v.rgb);
}

// Statistics: mean, standard deviation and extremes of the 3x3, and the current sample. 15 planes: 12 in the box space,
// 3 of colour.
__kernel void neighbourhood_statistics_kernel(plane_in current, plane_in alpha, plane_in inverse_depth, plane_in motion,
    plane_out statistics_out, const frame_t frame)
{
    const int x = (int)get_global_id(0) * LANES, y = (int)get_global_id(1);
    if (x >= frame.width || y >= frame.height)
        return;
    const size_t plane = plane_size(frame);
    const row_t above = read_row(current, alpha, inverse_depth, motion, x, y - 1, frame),
                centre = read_next_row(above, current, alpha, inverse_depth, motion, x, y, frame),
                below = read_next_row(centre, current, alpha, inverse_depth, motion, x, y + 1, frame);
    const statistics s = neighbourhood_statistics(above, centre, below, frame);
    const colour sample = current_sample(above, centre, below, s, frame);
    plane_out p = statistics_out + texel_offset(frame, x, y);
    store_boxed(p, in_units(s.mean), plane);
    store_boxed(p + 3 * plane, in_units(s.deviation), plane);
    store_boxed(p + 6 * plane, in_units(s.low), plane);
    store_boxed(p + 9 * plane, in_units(s.high), plane);
    store_colour(p + 12 * plane, plane, sample);
}

// Motion of the surface that each pixel follows. 10 planes: u, v, scale, shift, visible (1 or 0), the nearest and
// farthest inverse depth of the 3x3, the pixel's own, and the surface's offset from the pixel.
__kernel void surface_motion_kernel(plane_in current, plane_in alpha, plane_in inverse_depth, plane_in motion,
    plane_out motion_out, const frame_t frame, const settings_t settings)
{
    const int x = (int)get_global_id(0) * LANES, y = (int)get_global_id(1);
    if (x >= frame.width || y >= frame.height)
        return;
    const size_t plane = plane_size(frame);
    const surface nearest = nearest_surface(read_row(current, alpha, inverse_depth, motion, x, y - 1, frame),
        read_row(current, alpha, inverse_depth, motion, x, y, frame),
        read_row(current, alpha, inverse_depth, motion, x, y + 1, frame), settings);
    const surface s = borrowed_surface(nearest, inverse_depth, motion, x, y, frame);
    const motion_t m = surface_motion(s, LANE_INDEX + K(x), SPLAT(y), frame);
    plane_out p = motion_out + texel_offset(frame, x, y);
    store(p, m.u);
    store(p + plane, m.v);
    store(p + 2 * plane, m.scale);
    store(p + 3 * plane, m.shift);
    store(p + 4 * plane, m.visible ? SPLAT(1.0) : SPLAT(0.0));
    store(p + 5 * plane, s.nearest);
    store(p + 6 * plane, s.farthest);
    store(p + 7 * plane, s.centre);
    store(p + 8 * plane, s.x);
    store(p + 9 * plane, s.y);
}

// History at that motion. 9 planes: r, g, b, alpha, count, fx, fy, valid (1 or 0), and the illumination change, where
// it is tested.
__kernel void sample_history_kernel(plane_in current, plane_in alpha, plane_in motion_in, history_in history,
    plane_in history_count, plane_in previous_inverse_depth, plane_out history_at, const frame_t frame,
    const settings_t settings)
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
    s.centre = load(q + 7 * plane);
    s.x = load(q + 8 * plane);
    s.y = load(q + 9 * plane);
    row_cache cache = empty_row_cache();
    const history_t h = sample_history(current, alpha, read_boxed(current, alpha, x, y + 1, frame), 1, history,
        history_count, previous_inverse_depth, m, s, x, y, frame, settings, &cache);
    plane_out p = history_at + at;
    store_colour(p, plane, h.rgb);
    store(p + 3 * plane, h.alpha);
    store(p + 4 * plane, h.count);
    store(p + 5 * plane, h.fx);
    store(p + 6 * plane, h.fy);
    store(p + 7 * plane, h.valid ? SPLAT(1.0) : SPLAT(0.0));
    store(p + 8 * plane, h.change);
}

// Rectification: the change that moves that history into the box of the statistics. 5 planes: r, g, b, blend boost,
// anti-flicker factor.
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
        box_scale_of(m, settings), frame, settings);
    plane_out p = change_out + at;
    store_colour(p, plane, r.change);
    store(p + 3 * plane, r.blend_boost);
    store(p + 4 * plane, r.anti_flicker_factor);
}

// Blend: the current sample with the rectified history. Writes the output and its count.
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
    h.count_limit = count_limit_of(h.fx, h.fy, settings);
    h.valid = load(q + 7 * plane) > SPLAT(0.5);
    h.change = load(q + 8 * plane);
    const boxed_row above = read_boxed(current, alpha, x, y - 1, frame), own = read_boxed(current, alpha, x, y, frame),
                    below = read_boxed(current, alpha, x, y + 1, frame);
    const rectification r = { load_colour(c, plane), load(c + 3 * plane), load(c + 4 * plane),
        rectified_alpha(current, alpha, 1, h.alpha, x, y, frame) };
    pixel_t p; // only the fields that are read after rectification
    p.stats.mean = load_boxed(statistics_in + at, plane);
    p.alpha = own.alpha[1];
    p.reactivity = REACTIVE ? load_share(reactive + at, SPLAT(0.0)) : SPLAT(0.0);
    p.filtered = load_colour(statistics_in + at + 12 * plane, plane);
    p.luminance = luminance_4(p.filtered);
    p.own = FILTER_USE == FILTER_USE_FEW_SAMPLES ? texels_in_domain(current, alpha, x, y, frame).rgb : p.filtered;
    if (FIREFLIES == FIREFLIES_CLAMP)
        p = without_firefly(p, above, own, below, h, settings);
    const resolved out = without_missing(resolve_pixel(p, h, r, settings), h, current, alpha, x, y, frame);
    store_recurrent(output, output_count, out, x, y, frame);
}
