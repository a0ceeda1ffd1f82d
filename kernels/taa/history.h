// History: sampled where the surface was in the previous frame, and valid only if that frame showed the surface.
#include "schedule/ahead.h"
#include "schedule/row_cache.h"
#include "taa/disocclusion.h"

typedef struct
{
    colour rgb;
    real alpha, count, fx, fy;
    real change; // illumination change, where TESTS_LIGHT
    real count_limit; // upper limit of the sample count
    mask valid;
} history_t;

// Loads the texel at the footprint's integer position. p points into the red plane, offset to the tap.
STAGE colour load_colour_lanes(history_in p, footprint f, size_t plane, int stride)
{
    if (LANES == 1)
        return load_history_colour(p + f.at, plane);
    const whole offsets = lane_offsets(f.dx, f.dy, stride);
    history_in q = p + f.own;
    return (colour) { load_history_lanes(q, offsets), load_history_lanes(q + plane, offsets),
        load_history_lanes(q + 2 * plane, offsets) };
}

STAGE colour sample_colour(history_in p, footprint f, weights wx, weights wy, size_t plane, int stride)
{
    if (f.lanes == LANES_ON_TEXELS) // one test for three planes is faster than sample_plane's own alone
        return load_history_colour(p + f.at, plane);
    real sample[3];
    NO_UNROLL
    for (int i = 0; i < 3; ++i)
        sample[i] = sample_plane(p + (size_t)i * plane, f, wx, wy, stride);
    return (colour) { sample[0], sample[1], sample[2] };
}

// As sample_colour, but exposes and tonemaps each texel before it is weighted (HISTORY_RANGE_TONEMAPPED). The loops
// stay rolled: of the presets only bevy reads so, and its speed does not matter.
STAGE colour sample_in_range(history_in p, footprint f, weights wx, weights wy, size_t plane, frame_t frame)
{
    const int stride = row_stride(frame);
    real tap[3][6];
    row_taps row[3][6];
    NO_UNROLL
    for (int j = CROSS ? 0 : 1; j < (CROSS ? 6 : 5); ++j) {
        NO_UNROLL
        for (int i = CROSS ? 0 : 1; i < (CROSS ? 6 : 5); ++i) {
            history_in q = p + (j - 2) * (ptrdiff_t)stride + (i - 2);
            const colour c = history_in_range(load_colour_lanes(q, f, plane, stride), frame);
            tap[0][i] = c.r, tap[1][i] = c.g, tap[2][i] = c.b;
        }
        for (int k = 0; k < 3; ++k)
            row[k][j] = filter_taps(tap[k][0], tap[k][1], tap[k][2], tap[k][3], tap[k][4], tap[k][5], wx);
    }
    real v[3];
    for (int k = 0; k < 3; ++k)
        v[k] = filter_rows(row[k][0], row[k][1], row[k][2], row[k][3], row[k][4], row[k][5], wx, wy);
    return (colour) { v[0], v[1], v[2] };
}

// The history at a footprint, and the four texels of previous inverse depth around it.
typedef struct
{
    history_t h;
    quad inverse_depth;
} sampled;

STAGE real sample_count(plane_in count, footprint f, int stride) { return bilinear(sample_quad(count, f, stride), f); }

STAGE sampled sample_planes(history_in history, plane_in previous_inverse_depth, footprint f, weights wx, weights wy,
    colour rgb, real count, real count_limit, frame_t frame)
{
    sampled v;
    v.h.rgb = rgb;
    v.h.alpha = SPLAT(1.0);
    if (ALPHA)
        v.h.alpha = sample_plane(history + 3 * history_plane_size(frame), f, wx, wy, row_stride(frame));
    v.h.count = count;
    if (REJECT == REJECT_DEPTH)
        v.inverse_depth = sample_quad(previous_inverse_depth, f, row_stride(frame));
    v.h.fx = f.fx;
    v.h.fy = f.fy;
    v.h.count_limit = count_limit;
    return v;
}

// Returns the footprint of a segment of displacement m. With a row cache, sets *as_above if it moves as the one above
// it.
STAGE footprint find_footprint(motion_t m, mask valid, uint at, frame_t frame, row_cache* cache, int* as_above)
{
    *as_above = 0;
    if (!(CAMERA_MOTION || OWN_MOTION))
        return footprint_at_rest(at);
    if (!ROW_CACHE | (LANES == 1))
        return footprint_of(m, valid, at, frame);
    const real u = valid ? m.u : SPLAT(0.0), v = valid ? m.v : SPLAT(0.0);
    if (same_motion_as_above(cache, u, v)) {
        const footprint f = footprint_below(cache, at, row_stride(frame));
        cache->at = f.at;
        *as_above = 1;
        return f;
    }
    const footprint f = footprint_of(m, valid, at, frame);
    *as_above = continues_row_cache(cache, f, u, v, row_stride(frame));
    return f;
}

STAGE sampled sample_at(history_in history, plane_in count, plane_in previous_inverse_depth, footprint f, int as_above,
    frame_t frame, settings_t settings, row_cache* cache)
{
    const size_t plane = history_plane_size(frame);
    if (LANES == 1)
        prefetch_history(history, count, previous_inverse_depth, f.at, frame);
    if (ROW_CACHE & (LANES == 1)) {
        real counted;
        const colour rgb = slide_history(cache, history, count, f, plane, row_stride(frame), &counted);
        const real count_limit = count_limit_of(f.fx, f.fy, settings);
        return sample_planes(
            history, previous_inverse_depth, f, cache->wx, cache->wy, rgb, counted, count_limit, frame);
    }
    if (ROW_CACHE && as_above) {
        f.fx = cache->fx;
        f.fy = cache->fy;
        f.lanes = LANES_UNIFORM;
        const colour rgb = sample_cached_colour(cache, history, f.at, plane, row_stride(frame), settings);
        const real counted = sample_count(count, f, row_stride(frame));
        return sample_planes(
            history, previous_inverse_depth, f, cache->wx, cache->wy, rgb, counted, cache->count_limit, frame);
    }
    const weights wx = history_weights(f.fx), wy = history_weights(f.fy);
    const colour rgb = HISTORY_RANGE == HISTORY_RANGE_TONEMAPPED
        ? sample_in_range(history, f, wx, wy, plane, frame)
        : sample_colour(history, f, wx, wy, plane, row_stride(frame));
    const real counted = sample_count(count, f, row_stride(frame)), count_limit = count_limit_of(f.fx, f.fy, settings);
    return sample_planes(history, previous_inverse_depth, f, wx, wy, rgb, counted, count_limit, frame);
}

// How an occluder, now or in the previous frame, affects a pixel's history.
typedef struct
{
    mask nearer_beside; // one of the four texels showed something nearer, so the history may hold its colour
    mask passed; // as `nearer_beside`, or at a corner of the 4x4, and camera motion has moved the occluder away since
    mask covered; // an occluder covered so much of the footprint that the history holds its colour, and has left
    mask background; // the pixel lies behind the surface that it follows; the history shows the background elsewhere
    real count_limit; // upper limit of the sample count, where pixel and history mix both sides of an edge
} occlusion;

STAGE occlusion find_occlusion(plane_in previous_inverse_depth, quad previous, footprint f, surface s, motion_t m,
    int x, int y, frame_t frame, settings_t settings)
{
    occlusion o = { 0 };
    o.count_limit = SPLAT(DOMAIN_LIMIT);
    if ((REJECT != REJECT_DEPTH) | !(CAMERA_MOTION | OWN_MOTION))
        return o;
    // Without motion, jitter alone shows something nearer now and then. A mask: a GPU's compiler moves no load past a
    // branch on what it does not know.
    const int moves = (CAMERA_MOTION & frame.camera_moved) | (OWN_MOTION & frame.own_vectors);
    const real high = surface_range(s, m, settings).high;
    o.nearer_beside = any_nearer(previous, high) & (whole)(moves ? -1 : 0);
    if (!(TESTS_LIGHT & CAMERA_MOTION)) {
        if (!COVERED_SHARE)
            return o;
        if (!any_of(o.nearer_beside))
            return o;
    }
    const quad corners = sample_corners(previous_inverse_depth, f, row_stride(frame));
    if (CAMERA_MOTION) {
        const real nearest = greater(nearest_of(previous), nearest_of(corners));
        o.passed = occluder_has_passed(nearest, s, m, LANE_INDEX + K(x), SPLAT(y), frame, settings);
        if (TESTS_LIGHT) {
            o.background = shows_background(previous, s, m, LANE_INDEX + K(x), SPLAT(y), frame);
            o.count_limit = edge_count_limit(previous, corners, s, m, LANE_INDEX + K(x), SPLAT(y), frame, settings);
        }
    }
    // With own motion, an occluder may have left where camera motion alone would not have moved it.
    if (COVERED_SHARE)
        o.covered = occluder_covered(previous, corners, high, f, settings)
            & (o.passed | (whole)(OWN_MOTION & frame.own_vectors ? -1 : 0));
    return o;
}

// The |t| above which an illumination change reduces the sample count.
STAGE real illumination_threshold(occlusion o, settings_t settings)
{
    const real background = o.background ? SPLAT(settings.behind_t) : SPLAT(settings.illumination_t);
    const real beside = o.nearer_beside ? SPLAT(settings.disocclusion_t) : background;
    return o.passed ? lesser(SPLAT(settings.passing_t), beside) : beside;
}

// `next` holds the texels of the row below the pixel's; `has_missing` is 1 if a sample of the segment may be missing.
STAGE history_t sample_history(plane_in current, plane_in alpha, boxed_row next, int has_missing, history_in history,
    plane_in count, plane_in previous_inverse_depth, motion_t m, surface s, int x, int y, frame_t frame,
    settings_t settings, row_cache* cache)
{
    const uint at = history_offset(frame, x, y);
    if (LANES > 1) // not with the frame's: all at once exceed the loads a core can have in flight
        prefetch_history(history, count, previous_inverse_depth, at, frame);
    const motion_t seen = motion_to_edge(m, LANE_INDEX + K(x), SPLAT(y), frame);
    const mask shown = on_screen(seen, LANE_INDEX + K(x), SPLAT(y), frame) & (whole)(frame.reset ? 0 : -1);
    int as_above;
    const footprint f = find_footprint(seen, shown, at, frame, cache, &as_above);
    const sampled v = sample_at(history, count, previous_inverse_depth, f, as_above, frame, settings, cache);
    history_t h = v.h;
    h.valid = shown & !colour_outside_domain(h.rgb);
    const occlusion o = find_occlusion(previous_inverse_depth, v.inverse_depth, f, s, m, x, y, frame, settings);
    if (REJECT == REJECT_DEPTH) {
        // Without own motion, a neighbour that appears or vanishes does so by jitter: it is a thin feature, and counts.
        quad previous = v.inverse_depth;
        if (OWN_MOTION & frame.own_vectors)
            previous = weighted_texels(previous, h.fx, h.fy);
        mask same = same_surface(previous, s, m, settings) & ~o.covered;
        // A missing sample without depth is no evidence of another surface.
        if (has_missing)
            same = same
                | (sample_is_missing(current, alpha, x, y, frame) & (s.nearest <= SPLAT(frame.sky_inverse_depth)));
        h.valid = h.valid & same;
    }
    h.change = SPLAT(0.0);
    if (TESTS_LIGHT) {
        illumination_result l = illumination_test(h.count, illumination_threshold(o, settings), current, alpha, next,
            history, count, f, x, y, frame, settings, &cache->illumination);
        if (has_missing)
            l = illumination_without_missing(l, h.count, current, alpha, x, y, frame);
        h.count = lesser(l.count, o.count_limit);
        h.change = l.change;
    }
    if (HISTORY_RANGE == HISTORY_RANGE_LINEAR)
        h.rgb = history_in_range(h.rgb, frame);
    if (ALPHA)
        h.alpha = limit(h.alpha, SPLAT(0.0), SPLAT(1.0));
    if (FIRST_SAMPLES) // initial count of a pixel without history
        h.count = h.valid ? h.count : SPLAT(frame.reset ? settings.first_samples : K(1.0));
    return h;
}
