// Accumulation: weights the current sample against the history, and blends the two.
#include "taa/history.h"
#include "taa/rectify.h"

// Sample count after one more sample. With `standing` (Bevy), a pixel that moves begins anew with 1, and one at rest
// gains STANDING_GAIN.
STAGE real next_count(real count, real blend_boost)
{
    if (ACCUMULATE == ACCUMULATE_STANDING)
        return blend_boost > SPLAT(0.0) ? SPLAT(1.0) : count + K(STANDING_GAIN);
    return count + K(1.0);
}

// Weight for `capped` (FSR 3): the sample has the odds of blend_weight, the history a weight of count / sample_limit,
// at most 1, and in motion at most what gives the sample moving_weight.
STAGE real capped_weight(real count, real blend_boost, settings_t settings)
{
    const real one = SPLAT(1.0), least = SPLAT(settings.blend_weight), most = SPLAT(settings.moving_weight);
    const real odds = least / (one - least), cap = odds * (one - most) / most;
    const real held = lesser(count / SPLAT(settings.sample_limit), one);
    const real history = lesser(held, held + blend_boost * (cap - held));
    return odds / (odds + history);
}

// Weight of the current sample when the history already holds `count` samples: 1 / (count + 1) for the running mean; at
// least blend_weight for the exponential one, always blend_weight for the constant one, and between it and
// moving_weight for the adaptive one.
STAGE real sample_weight(real count, real blend_boost, settings_t settings)
{
    if (ACCUMULATE == ACCUMULATE_CONSTANT)
        return SPLAT(settings.blend_weight);
    if (ACCUMULATE == ACCUMULATE_ADAPTIVE)
        return K(settings.blend_weight) + blend_boost * (K(settings.moving_weight) - K(settings.blend_weight));
    if (ACCUMULATE == ACCUMULATE_CAPPED)
        return capped_weight(count, blend_boost, settings);
    if (ACCUMULATE == ACCUMULATE_STANDING)
        return limit(
            reciprocal(next_count(count, blend_boost)), SPLAT(settings.blend_weight), SPLAT(settings.moving_weight));
    const real mean = reciprocal(count + K(1.0));
    if (ACCUMULATE == ACCUMULATE_COUNT)
        return mean;
    return greater(mean, SPLAT(settings.blend_weight));
}

// Samples that the mean of `accumulate` counts in a history of `count`: with the new one 1 / blend_weight at most.
STAGE real samples_in_mean(real count, settings_t settings)
{
    if (ACCUMULATE == ACCUMULATE_COUNT)
        return count;
    // Not `reciprocal`, which runs for every pixel: a compiler hoists a plain division by a setting out of the loop.
    return lesser(count, SPLAT(1.0) / SPLAT(settings.blend_weight) - K(1.0));
}

// 4 (knee + Y) from 4 Y: four times the inverse of a luminance weight (Karis 2014 with knee 1).
STAGE real inverse_luminance_weight(real luminance, settings_t settings)
{
    return K(4.0) * SPLAT(settings.luminance_knee) + greater(luminance, SPLAT(0.0));
}

// Folds the luminance weights 1 / (knee + Y) of both into one weight of the current sample, w_x / (w_x + w_h), so that
// blending stays a single step from the history. `current` and `history` are 4 Y.
STAGE real fold_luminance_weights(real weight, real current, real history, settings_t settings)
{
    if (WEIGHTING == WEIGHTING_NONE)
        return weight;
    const real x = inverse_luminance_weight(current, settings), h = inverse_luminance_weight(history, settings);
    const real for_current = weight * h, for_history = (SPLAT(1.0) - weight) * x;
    return quotient(for_current, for_current + for_history);
}

// Weight of the current sample against a history of `count`, before anti-flicker. In a running mean with luminance
// weights it is h / (h + count x), x and h the inverse weights of sample and history, without the step over 1 / (count
// + 1). A reactive sample gains as many samples as the history loses. `current` and `history` are 4 Y.
STAGE real weight_of_sample(
    real count, real current, real history, real reactivity, real blend_boost, settings_t settings)
{
    const int in_mean = (ACCUMULATE == ACCUMULATE_COUNT) | (ACCUMULATE == ACCUMULATE_EXPONENTIAL);
    if (in_mean & (WEIGHTING != WEIGHTING_NONE)) {
        const real x = inverse_luminance_weight(current, settings), h = inverse_luminance_weight(history, settings);
        const real samples = samples_in_mean(count, settings);
        // Reactivity 0 gives the bits of a frame without a mask.
        const real now = REACTIVE ? (SPLAT(1.0) + reactivity * samples) * h : h;
        const real before = REACTIVE ? samples * (SPLAT(1.0) - reactivity) * x : samples * x;
        return quotient(now, now + before);
    }
    real weight = sample_weight(count, blend_boost, settings);
    if (REACTIVE)
        weight += reactivity * (SPLAT(1.0) - weight);
    return fold_luminance_weights(weight, current, history, settings);
}

// Luminance weight 1 / (knee + Y): one firefly does not outweigh a pixel's whole past (Karis 2014 with knee 1).
STAGE real luminance_weight(colour v, settings_t settings)
{
    if (WEIGHTING == WEIGHTING_NONE)
        return SPLAT(1.0);
    return reciprocal(SPLAT(settings.luminance_knee) + greater(luminance(v), SPLAT(0.0)));
}

// Difference of two colours, each scaled by knee / (knee + Y): dim light hardly changes, and the luminance
// of no highlight exceeds luminance_knee.
STAGE colour weighted_difference(colour v, colour other, settings_t settings)
{
    const real knee = WEIGHTING == WEIGHTING_NONE ? SPLAT(1.0) : SPLAT(settings.luminance_knee);
    const real a = knee * luminance_weight(v, settings), b = knee * luminance_weight(other, settings);
    return (colour) { a * v.r - b * other.r, a * v.g - b * other.g, a * v.b - b * other.b };
}

// Lottes' measure u = 1 - |dY| / max(Y_x, Y_h, knee). Returns a factor of the weight that rises with u^2 from
// differing_share, where luminances differ, to agreeing_share, where they agree. `current` and `history` are 4 Y.
STAGE real difference_factor(real current, real history, settings_t settings)
{
    const real size = greater(greater(current, history), K(4.0) * SPLAT(settings.difference_knee));
    // Luminances of two signs may differ by more than `size`: u^2 would grow again, and the weight fall below 0.
    const real u = greater(SPLAT(1.0) - quotient(absolute(current - history), size), SPLAT(0.0));
    return K(settings.differing_share) + (u * u) * (K(settings.agreeing_share) - K(settings.differing_share));
}

// Share of the filtered sample (filter_use = few-samples). A bright sample that the filter has spread over its
// neighbours is weighted down twice: as the sample of each, and for the shares of the others.
STAGE real filtered_share(real share, colour filtered, settings_t settings)
{
    if (WEIGHTING == WEIGHTING_NONE)
        return share;
    const real knee = K(4.0) * SPLAT(settings.luminance_knee);
    const real dim = quotient(knee, knee + greater(luminance_4(filtered), SPLAT(0.0)));
    return share * (dim * dim);
}

// h + w (x - h): equal inputs keep their bits. A weight of 1, also of a pixel without history, selects the sample,
// which the sum would lose beside a far brighter history.
STAGE real blend(real history, real current, real weight)
{
    return weight < SPLAT(1.0) ? history + weight * (current - history) : current;
}

// Makes a value storable: inside the domain, no denormal, no -0, and not below the lesser of 0 and the current sample,
// so that a negative lobe or a chroma clamp never turns light negative.
STAGE real storable(real v, real current)
{
    const real floor_value = lesser(current, SPLAT(0.0));
    const real raised = NEGATIVES == NEGATIVES_RAISE ? greater(v, floor_value) : v;
    const mask nothing = absolute(raised) < SPLAT(TINY);
    return outside_domain(raised) | nothing ? SPLAT(0.0) : raised;
}

STAGE colour storable_colour(colour v, colour current)
{
    return (colour) { storable(v.r, current.r), storable(v.g, current.g), storable(v.b, current.b) };
}

// A pixel of the current frame: its `own` sample, and the `filtered` one of the current filter, which replaces `own`
// unless filter_use is few-samples.
typedef struct
{
    colour own, filtered;
    real luminance; // four times that of `filtered`
    real alpha, reactivity;
    real least_reactive, most_reactive; // of the 3x3, where temporal windows are weighted
    statistics stats; // of the 3x3
    mask missing; // its own sample is missing; set where frames are gathered
} pixel_t;

typedef struct
{
    colour rgb;
    real alpha, count;
    real change; // illumination change, where TESTS_LIGHT
} resolved;

// Sets the least and the greatest reactivity of the current 3x3.
STAGE void reactive_range(pixel_t* p, plane_in reactive_at, frame_t frame)
{
    for (int k = 0; k < 9; ++k) {
        const real r = load_share(reactive_at + (k / 3 - 1) * (ptrdiff_t)row_stride(frame) + (k % 3 - 1), SPLAT(0.0));
        p->least_reactive = lesser(p->least_reactive, r);
        p->most_reactive = greater(p->most_reactive, r);
    }
}

// Weight of a sample that was rendered with reactivity r: 1 within the range of the current 3x3, and 0 from a distance
// of 1 / REACTIVE_FALL on. Light seen through a pane differs from light seen without, in every frame.
STAGE real reactivity_weight(real r, pixel_t now)
{
    const real off = greater(greater(now.least_reactive - r, r - now.most_reactive), SPLAT(0.0));
    const real far = off * SPLAT(REACTIVE_FALL);
    return greater(SPLAT(1.0) - far * far, SPLAT(0.0));
}

STAGE pixel_t current_pixel(row_t above, row_t centre, row_t below, plane_in reactive, int x, int y, frame_t frame)
{
    const uint at = texel_offset(frame, x, y);
    pixel_t p;
    p.stats = neighbourhood_statistics(above, centre, below, frame);
    p.filtered = current_sample(above, centre, below, p.stats, frame);
    p.own = FILTER_USE == FILTER_USE_FEW_SAMPLES ? centre.centre : p.filtered;
    p.luminance = luminance_4(p.filtered);
    p.alpha = centre.texels.alpha[1];
    p.reactivity = REACTIVE ? load_share(reactive + at, SPLAT(0.0)) : SPLAT(0.0);
    p.least_reactive = p.most_reactive = p.reactivity;
    if (REACTIVE & (ILLUMINATION == ILLUMINATION_WINDOW))
        reactive_range(&p, reactive + at, frame);
    return p;
}

// Sample of a pixel without history, moved towards its neighbourhood's mean by disocclusion_blur, since one raw sample
// is fully aliased.
STAGE colour disoccluded_colour(colour current, boxed mean, settings_t settings)
{
    if (!DISOCCLUSION_BLUR)
        return current;
    const boxed c = to_box_space(current);
    const boxed offset = { mean.a - c.a, mean.b - c.b, mean.c - c.c };
    return plus_scaled(current, SPLAT(settings.disocclusion_blur), from_box_space(offset));
}

// Moves `own` towards `filtered` by a share; equal colours keep their bits.
STAGE colour lerp_colour(colour own, colour filtered, real share)
{
    return plus_scaled(own, share, minus(filtered, own));
}

// Share of the filtered sample in the n-th of a history, given its share 1 / n of the mean: 1 / n, but filter_samples /
// n^2 beyond filter_samples. The shares add up in the history: 1 / n alone would come to 7 % of 64 samples.
STAGE real fading_share(real of_mean, settings_t settings)
{
    return lesser(of_mean, K(settings.filter_samples) * (of_mean * of_mean));
}

// Effective sample count of the history, count_limit at most: less the more reactive the pixel is.
STAGE real effective_count(pixel_t p, history_t h)
{
    const real count = lesser(h.count, h.count_limit);
    return REACTIVE ? count * (SPLAT(1.0) - p.reactivity) : count;
}

// The history of a pixel after rectification.
STAGE colour rectified(history_t h, rectification r, settings_t settings)
{
    if (!BOX_LEAK)
        return plus(h.rgb, r.change);
    const mask full = h.count >= SPLAT(settings.sample_limit);
    const real share = SPLAT(1.0) - (full ? SPLAT(settings.box_leak) : SPLAT(0.0));
    return plus_scaled(h.rgb, share, r.change);
}

// The sample to blend with a history of `count` samples: the filtered one, or the pixel's own moved towards it.
STAGE colour sample_to_blend(pixel_t p, mask valid, real count, settings_t settings)
{
    if (FILTER_USE != FILTER_USE_FEW_SAMPLES)
        return p.filtered;
    const real share = valid ? fading_share(reciprocal(count + K(1.0)), settings) : SPLAT(1.0);
    return lerp_colour(p.own, p.filtered, filtered_share(share, p.filtered, settings));
}

// Blends the pixel's sample with its rectified history; without history the result begins anew.
STAGE resolved resolve_pixel(pixel_t p, history_t h, rectification r, settings_t settings)
{
    const real count = effective_count(p, h);
    const colour past = rectified(h, r, settings), current = sample_to_blend(p, h.valid, count, settings);
    const real y = FILTER_USE == FILTER_USE_FEW_SAMPLES ? luminance_4(current) : p.luminance,
               past_y = luminance_4(past);
    real weight = weight_of_sample(count, y, past_y, p.reactivity, r.blend_boost, settings);
    if (ANTI_FLICKER == ANTI_FLICKER_DIFFERENCE)
        weight *= difference_factor(y, past_y, settings);
    if (ANTI_FLICKER == ANTI_FLICKER_CLAMP_DISTANCE)
        weight *= r.anti_flicker_factor;
    // A count of 0, as of a fill, means no history; a running mean gives it no weight anyway.
    if ((ACCUMULATE == ACCUMULATE_CONSTANT) | (ACCUMULATE == ACCUMULATE_ADAPTIVE))
        weight = count > SPLAT(0.0) ? weight : SPLAT(1.0);
    if (!DISOCCLUSION_BLUR)
        weight = h.valid ? weight : SPLAT(1.0);

    const colour was = to_blend_range(past), now = to_blend_range(current);
    const colour mixed = { blend(was.r, now.r, weight), blend(was.g, now.g, weight), blend(was.b, now.b, weight) };
    colour v = mixed;
    if (DISOCCLUSION_BLUR && any_of(!h.valid))
        v = choose_colour(h.valid, mixed, to_blend_range(disoccluded_colour(current, p.stats.mean, settings)));
    resolved out;
    out.rgb = storable_colour(from_range(v), current);
    out.alpha = p.alpha;
    if (ALPHA_FROM == ALPHA_FROM_BLEND)
        out.alpha = h.valid ? blend(r.alpha, p.alpha, weight) : p.alpha;
    out.count = h.valid ? next_count(count, r.blend_boost) : (FIRST_SAMPLES ? h.count : SPLAT(1.0));
    out.change = h.valid ? h.change : SPLAT(0.0);
    return out;
}

// Result of a segment in which samples are missing. A pixel with a missing sample keeps its history, and its count up
// to count_limit, if that count is at least 1; else it is filled, with count 0.
STAGE resolved without_missing(resolved out, history_t h, plane_in current, plane_in alpha, int x, int y, frame_t frame)
{
    const mask missing = sample_is_missing(current, alpha, x, y, frame), kept = h.valid & (h.count >= SPLAT(1.0));
    const colour nothing = { 0 };
    colour v = storable_colour(from_range(h.rgb), nothing);
    real opacity = h.alpha;
    if (any_of(missing & !kept)) {
        const texel_t filled = filled_texels(current, alpha, x, y, frame);
        v = choose_colour(kept, v, storable_colour(from_range(filled.rgb), filled.rgb));
        opacity = kept ? opacity : filled.alpha;
    }
    out.rgb = choose_colour(missing, v, out.rgb);
    out.alpha = missing ? opacity : out.alpha;
    out.count = missing ? (kept ? lesser(h.count, h.count_limit) : SPLAT(0.0)) : out.count;
    out.change = missing ? (kept ? h.change : SPLAT(0.0)) : out.change;
    return out;
}

// Alpha of the history, clamped to the extremes of the current 3x3 where colour is rectified. Otherwise a trail that
// rectification removes from colour would stay in alpha, and darken the background of a composite.
STAGE real rectified_alpha(plane_in current, plane_in alpha, int has_missing, real past, int x, int y, frame_t frame)
{
    if (!RECTIFIES_ALPHA)
        return past;
    const real zero = SPLAT(0.0), one = SPLAT(1.0);
    real low = one, high = zero;
    if (has_missing) {
        NO_UNROLL
        for (int k = 0; k < 9; ++k) {
            const real a = texels_in_domain(current, alpha, x + k % 3 - 1, y + k / 3 - 1, frame).alpha;
            low = lesser(a, low);
            high = greater(a, high);
        }
        return limit(past, low, high);
    }
    plane_in own = alpha + texel_offset(frame, x, y);
    for (int k = 0; k < 9; ++k) {
        const real a = load(own + (k / 3 - 1) * (ptrdiff_t)row_stride(frame) + (k % 3 - 1));
        low = lesser(a, low);
        high = greater(a, high);
    }
    return limit(past, greater(low, zero), lesser(high, one));
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

// As store_resolved, and stores the illumination change in the plane after the count's.
STAGE void store_recurrent(history_out image, plane_out count, resolved r, int x, int y, frame_t frame)
{
    store_resolved(image, count, r, x, y, frame);
    if (TESTS_LIGHT)
        store(count + plane_size(frame) + texel_offset(frame, x, y), r.change);
}
