// One output pixel from its current sample, its neighbourhood and its history.
#include "taa/history.h"
#include "taa/rectify.h"
#include "taa/blend.h"

#if !defined(ALPHA) || !defined(REACTIVE) || !defined(ALPHA_FROM) || !defined(FILTER_USE)
#error "pixel.h needs ALPHA, REACTIVE, ALPHA_FROM and FILTER_USE from the prelude"
#endif

// What the current frame says of a pixel. `own` is its sample, `filtered` what the current filter makes of it, which
// takes the place of `own` but where filter_use is few-samples.
typedef struct
{
    colour own, filtered;
    real luminance; // four times that of `filtered`
    real alpha, reactivity;
    real least_reactive, most_reactive; // of the 3x3, where temporal windows are weighed
    statistics near;
} pixel_t;

typedef struct
{
    colour rgb;
    real alpha, count;
    real change; // of light, where that is tested for
} resolved;

// Alpha and reactivity are shares: outside [0, 1], or NaN, means the nearer end (NaN: `otherwise`).
STAGE real share_in_domain(real v, real otherwise)
{
    return outside_domain(v) ? otherwise : limit(v, SPLAT(0.0), SPLAT(1.0));
}

STAGE real load_share(plane_in p, real otherwise) { return share_in_domain(load(p), otherwise); }

// The least and the greatest reactivity of the 3x3 of now.
STAGE void reactive_range(pixel_t* p, plane_in reactive_at, frame_t frame)
{
    for (int k = 0; k < 9; ++k) {
        const real r = load_share(reactive_at + (k / 3 - 1) * (ptrdiff_t)row_stride(frame) + (k % 3 - 1), SPLAT(0.0));
        p->least_reactive = lesser(p->least_reactive, r);
        p->most_reactive = greater(p->most_reactive, r);
    }
}

// How much counts of a sample that was drawn with reactivity r: all of it within the range of now, nothing from
// 1 / REACTIVE_FALL beside it on. What is seen through a pane has another light than what is not, then as now.
STAGE real as_reactive(real r, pixel_t now)
{
    const real off = greater(greater(now.least_reactive - r, r - now.most_reactive), SPLAT(0.0));
    const real far = off * SPLAT(REACTIVE_FALL);
    return greater(SPLAT(1.0) - far * far, SPLAT(0.0));
}

STAGE pixel_t current_pixel(
    row_t above, row_t centre, row_t below, plane_in alpha, plane_in reactive, int x, int y, frame_t frame)
{
    const uint at = texel_offset(frame, x, y);
    pixel_t p;
    p.near = neighbourhood_statistics(above, centre, below);
    p.filtered = current_sample(above, centre, below, p.near, frame);
    p.own = FILTER_USE == FILTER_USE_FEW_SAMPLES ? centre.centre : p.filtered;
    // In YCoCg that of the pixel's own sample is worked out already, to the bit.
    const int known = (CURRENT_FILTER == CURRENT_FILTER_NONE) & (BOX_SPACE == BOX_SPACE_YCOCG);
    p.luminance = known ? centre.a.shift : luminance_4(p.filtered);
    p.alpha = ALPHA ? load_share(alpha + at, SPLAT(1.0)) : SPLAT(1.0);
    p.reactivity = REACTIVE ? load_share(reactive + at, SPLAT(0.0)) : SPLAT(0.0);
    p.least_reactive = p.most_reactive = p.reactivity;
    if (REACTIVE & (ILLUMINATION == ILLUMINATION_WINDOW))
        reactive_range(&p, reactive + at, frame);
    return p;
}

// Half width of the box in standard deviations: wide where nothing moves, narrow from motion_px pixels a frame on.
STAGE real box_scale_of(motion_t m, settings_t settings)
{
    if (!BOX_SCALE_BY_MOTION)
        return SPLAT(settings.box_scale_moving);
    const real speed = over(greater(absolute(m.u), absolute(m.v)), divisor(SPLAT(settings.motion_px)));
    const real still = greater(SPLAT(1.0) - speed, SPLAT(0.0));
    return SPLAT(settings.box_scale_moving) + still * (K(settings.box_scale_static) - K(settings.box_scale_moving));
}

// The sample of a pixel without history: drawn towards the mean of its neighbourhood by disocclusion_blur, since one
// raw sample is as aliased as an image can be.
STAGE colour disoccluded_colour(colour current, boxed mean, settings_t settings)
{
    if (!DISOCCLUSION_BLUR)
        return current;
    const boxed c = to_box_space(current);
    const boxed offset = { mean.a - c.a, mean.b - c.b, mean.c - c.c };
    const colour change = from_box_space(offset);
    const scalar k = K(settings.disocclusion_blur);
    colour v = { current.r + k * change.r, current.g + k * change.g, current.b + k * change.b };
    return v;
}

// `own` drawn towards `filtered` by a share; equal colours keep their bits.
STAGE colour drawn_towards(colour own, colour filtered, real share)
{
    const colour v = { own.r + share * (filtered.r - own.r), own.g + share * (filtered.g - own.g),
        own.b + share * (filtered.b - own.b) };
    return v;
}

// Share of the filtered sample in the n-th of a history, from its share 1 / n of the mean: the same, but as 1 / n^2
// beyond filter_samples. What each share leaves in the history adds up, and by 1 / n alone would be 7 % of 64 samples.
STAGE real fading_share(real of_mean, settings_t settings)
{
    return lesser(of_mean, K(settings.filter_samples) * (of_mean * of_mean));
}

// How many samples a pixel's rectified history is believed to stand for.
STAGE real effective_samples(pixel_t p, history_t h, rectification r, settings_t settings)
{
    const real count = effective_count(h.count, h.count_limit, r.clip_distance, settings);
    return REACTIVE ? count * (SPLAT(1.0) - p.reactivity) : count;
}

// The history of a pixel, moved into its box.
STAGE colour rectified(history_t h, rectification r)
{
    const colour past = { h.rgb.r + r.change.r, h.rgb.g + r.change.g, h.rgb.b + r.change.b };
    return past;
}

// What is blended with a history of `count` samples: the pixel's own sample, or the filtered one.
STAGE colour sample_beside(pixel_t p, mask valid, real count, settings_t settings)
{
    if (FILTER_USE != FILTER_USE_FEW_SAMPLES)
        return p.filtered;
    const real share = valid ? fading_share(reciprocal(count + K(1.0)), settings) : SPLAT(1.0);
    return drawn_towards(p.own, p.filtered, filtered_share(share, p.filtered, settings));
}

// The pixel's sample `current` blended with its rectified history `past` of `count` samples, or begun anew where there
// is none.
STAGE resolved blend_pixel(
    pixel_t p, history_t h, rectification r, colour past, colour current, real count, settings_t settings)
{
    const real y = FILTER_USE == FILTER_USE_FEW_SAMPLES ? luminance_4(current) : p.luminance,
               past_y = luminance_4(past);
    real weight = weight_of_sample(count, y, past_y, p.reactivity, r.blend_boost, settings);
    if (ANTI_FLICKER == ANTI_FLICKER_DIFFERENCE)
        weight *= difference_share(y, past_y, settings);
    if (ANTI_FLICKER == ANTI_FLICKER_CLAMP_DISTANCE)
        weight *= r.anti_flicker_factor;
    if (!DISOCCLUSION_BLUR)
        weight = h.valid ? weight : SPLAT(1.0);

    const colour mixed
        = { blend(past.r, current.r, weight), blend(past.g, current.g, weight), blend(past.b, current.b, weight) };
    colour v = mixed;
    if (DISOCCLUSION_BLUR && any_of(!h.valid))
        v = choose_colour(h.valid, mixed, disoccluded_colour(current, p.near.mean, settings));
    resolved out;
    out.rgb = storable_colour(from_range(v), current);
    out.alpha = p.alpha;
    if (ALPHA_FROM == ALPHA_FROM_BLEND)
        out.alpha = h.valid ? blend(h.alpha, p.alpha, weight) : p.alpha;
    out.count = h.valid ? count + K(1.0) : SPLAT(1.0);
    out.change = h.valid ? h.change : SPLAT(0.0);
    return out;
}

STAGE resolved resolve_pixel(pixel_t p, history_t h, rectification r, settings_t settings)
{
    const real count = effective_samples(p, h, r, settings);
    return blend_pixel(p, h, r, rectified(h, r), sample_beside(p, h.valid, count, settings), count, settings);
}

// The alpha of the history; where the box is `unit`, held in the extremes of the current 3x3 as colour is.
STAGE real past_alpha(plane_in alpha, real past, int x, int y, frame_t frame)
{
    if (!ALPHA | (BOX != BOX_UNIT))
        return past;
    plane_in alpha_at = alpha + texel_offset(frame, x, y);
    real low = SPLAT(1.0), high = SPLAT(0.0);
    for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
            const real a = load_share(alpha_at + dy * (ptrdiff_t)row_stride(frame) + dx, SPLAT(1.0));
            low = lesser(a, low);
            high = greater(a, high);
        }
    return limit(past, low, high);
}

STAGE void store_resolved(history_out image, plane_out count, resolved r, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame);
    const uint at = texel_offset(frame, x, y);
    store_history(image + at, r.rgb.r, x, y, frame);
    store_history(image + plane + at, r.rgb.g, x, y, frame);
    store_history(image + 2 * plane + at, r.rgb.b, x, y, frame);
    if (ALPHA)
        store_history(image + 3 * plane + at, r.alpha < SPLAT(TINY) ? SPLAT(0.0) : r.alpha, x, y, frame);
    store(count + at, r.count);
}

// The same, and how light changes, in the plane after the count's.
STAGE void store_recurrent(history_out image, plane_out count, resolved r, int x, int y, frame_t frame)
{
    store_resolved(image, count, r, x, y, frame);
    if (TESTS_LIGHT)
        store(count + plane_size(frame) + texel_offset(frame, x, y), r.change);
}
