// Accumulation: how much the current sample counts against the history, and the pixel that comes of both.
#include "taa/history.h"
#include "taa/rectify.h"

// The count of a pixel with one sample more: of one that moves it begins anew, of one that stands it grows by many,
// where the preset says so.
STAGE real grown_count(real count, real blend_boost)
{
    if (ACCUMULATE == ACCUMULATE_STANDING)
        return blend_boost > SPLAT(0.0) ? SPLAT(1.0) : count + K(STANDING_GAIN);
    return count + K(1.0);
}

// Beside a sample's odds o of blend_weight a history weighs count / sample_limit, 1 at most, and in motion no more than
// where those odds make moving_weight.
STAGE real capped_weight(real count, real blend_boost, settings_t settings)
{
    const real one = SPLAT(1.0), least = SPLAT(settings.blend_weight), most = SPLAT(settings.moving_weight);
    const real odds = least / (one - least), cap = odds * (one - most) / most;
    const real held = lesser(count / SPLAT(settings.sample_limit), one);
    const real history = lesser(held, held + blend_boost * (cap - held));
    return odds / (odds + history);
}

// Weight of the current sample when the history already holds `count` samples: 1 / (count + 1) for the running mean;
// never below blend_weight for the exponential one, always that for the constant one, and between it and moving_weight
// for the adaptive one.
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
            reciprocal(grown_count(count, blend_boost)), SPLAT(settings.blend_weight), SPLAT(settings.moving_weight));
    const real mean = reciprocal(count + K(1.0));
    if (ACCUMULATE == ACCUMULATE_COUNT)
        return mean;
    return greater(mean, SPLAT(settings.blend_weight));
}

// The samples that the mean of `accumulate` takes a history of `count` for: with the new one 1 / blend_weight at most.
STAGE real samples_in_mean(real count, settings_t settings)
{
    if (ACCUMULATE == ACCUMULATE_COUNT)
        return count;
    // Not by `reciprocal`, which is worked out pixel by pixel: a compiler moves a division by a setting out of the
    // loop.
    return lesser(count, SPLAT(1.0) / SPLAT(settings.blend_weight) - K(1.0));
}

// knee + Y, the inverse of a luminance weight (Karis 2014 with knee 1), four times as large. Of four times a luminance.
STAGE real luminance_inertia(real luminance, settings_t settings)
{
    return K(4.0) * SPLAT(settings.luminance_knee) + greater(luminance, SPLAT(0.0));
}

// Luminance weights 1 / (knee + Y) as one weight of the current sample, so that blending stays a single step from the
// history: w_x / (w_x + w_h). Of four times the luminances of the sample and of the history.
STAGE real luminance_weight(real weight, real current, real history, settings_t settings)
{
    if (WEIGHTING == WEIGHTING_NONE)
        return weight;
    const real x = luminance_inertia(current, settings), h = luminance_inertia(history, settings);
    const real for_current = weight * h, for_history = (SPLAT(1.0) - weight) * x;
    return quotient(for_current, for_current + for_history);
}

// Weight of the current sample beside a history of `count`, before what stills flicker. In a mean of all of them the
// share 1 / (count + 1) is left to be worked out: with luminance weights it is h / (h + count x), and a reactive sample
// counts for as many more as are then missing among the count. Four times the luminances again.
STAGE real weight_of_sample(
    real count, real current, real history, real reactivity, real blend_boost, settings_t settings)
{
    const int in_mean = (ACCUMULATE == ACCUMULATE_COUNT) | (ACCUMULATE == ACCUMULATE_EXPONENTIAL);
    if (in_mean & (WEIGHTING != WEIGHTING_NONE)) {
        const real x = luminance_inertia(current, settings), h = luminance_inertia(history, settings);
        const real samples = samples_in_mean(count, settings);
        // Nothing reactive gives the bits of a frame without a mask.
        const real now = REACTIVE ? (SPLAT(1.0) + reactivity * samples) * h : h;
        const real before = REACTIVE ? samples * (SPLAT(1.0) - reactivity) * x : samples * x;
        return quotient(now, now + before);
    }
    real weight = sample_weight(count, blend_boost, settings);
    if (REACTIVE)
        weight += reactivity * (SPLAT(1.0) - weight);
    return luminance_weight(weight, current, history, settings);
}

// Luminance weight 1 / (knee + Y): one firefly does not outweigh a pixel's whole past (Karis 2014 with knee 1).
STAGE real sample_share(colour v, settings_t settings)
{
    if (WEIGHTING == WEIGHTING_NONE)
        return SPLAT(1.0);
    return reciprocal(SPLAT(settings.luminance_knee) + greater(luminance(v), SPLAT(0.0)));
}

// How far two colours differ, each as much as it counts: dim light as it is, highlights no more than luminance_knee.
STAGE colour share_difference(colour v, colour other, settings_t settings)
{
    const real knee = WEIGHTING == WEIGHTING_NONE ? SPLAT(1.0) : SPLAT(settings.luminance_knee);
    const real a = knee * sample_share(v, settings), b = knee * sample_share(other, settings);
    return (colour) { a * v.r - b * other.r, a * v.g - b * other.g, a * v.b - b * other.b };
}

// Lottes' measure u = 1 - |dY| / max(Y, Y, knee): the weight is scaled by a share that goes with u^2 from that of
// luminances that differ to that of luminances that agree. Of four times both luminances.
STAGE real difference_share(real current, real history, settings_t settings)
{
    const real size = greater(greater(current, history), K(4.0) * SPLAT(settings.difference_knee));
    const real u = SPLAT(1.0) - quotient(absolute(current - history), size);
    return K(settings.differing_share) + (u * u) * (K(settings.agreeing_share) - K(settings.differing_share));
}

// Share of the filtered sample where filter_use says few-samples. A bright sample that the filter has spread over its
// neighbours weighs less twice: as the sample of each, and for the shares of the others.
STAGE real filtered_share(real share, colour filtered, settings_t settings)
{
    if (WEIGHTING == WEIGHTING_NONE)
        return share;
    const real knee = K(4.0) * SPLAT(settings.luminance_knee);
    const real dim = quotient(knee, knee + greater(luminance_4(filtered), SPLAT(0.0)));
    return share * (dim * dim);
}

// h + w (x - h): equal inputs stay as they are, to the bit. A weight of 1 selects the sample, which the sum would lose
// beside a far brighter history; so does the caller where there is no history.
STAGE real blend(real history, real current, real weight)
{
    return weight < SPLAT(1.0) ? history + weight * (current - history) : current;
}

// A value fit to be stored: inside the domain, never a denormal, never -0, and not below the least of 0 and the current
// sample, so that light never turns negative through a negative lobe or a chroma clamp.
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
    real least_reactive, most_reactive; // of the 3x3, where temporal windows are weighed
    statistics stats; // of the 3x3
    mask missing; // whether its own sample is, where frames are gathered from
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
    p.stats = neighbourhood_statistics(above, centre, below, frame);
    p.filtered = current_sample(above, centre, below, p.stats, frame);
    p.own = FILTER_USE == FILTER_USE_FEW_SAMPLES ? centre.centre : p.filtered;
    p.luminance = luminance_4(p.filtered);
    p.alpha = ALPHA ? load_share(alpha + at, SPLAT(1.0)) : SPLAT(1.0);
    p.reactivity = REACTIVE ? load_share(reactive + at, SPLAT(0.0)) : SPLAT(0.0);
    p.least_reactive = p.most_reactive = p.reactivity;
    if (REACTIVE & (ILLUMINATION == ILLUMINATION_WINDOW))
        reactive_range(&p, reactive + at, frame);
    return p;
}

// The sample of a pixel without history: drawn towards the mean of its neighbourhood by disocclusion_blur, since one
// raw sample is as aliased as an image can be.
STAGE colour disoccluded_colour(colour current, boxed mean, settings_t settings)
{
    if (!DISOCCLUSION_BLUR)
        return current;
    const boxed c = to_box_space(current);
    const boxed offset = { mean.a - c.a, mean.b - c.b, mean.c - c.c };
    return plus_scaled(current, SPLAT(settings.disocclusion_blur), from_box_space(offset));
}

// `own` drawn towards `filtered` by a share; equal colours keep their bits.
STAGE colour drawn_towards(colour own, colour filtered, real share)
{
    return plus_scaled(own, share, minus(filtered, own));
}

// Share of the filtered sample in the n-th of a history, from its share 1 / n of the mean: the same, but as 1 / n^2
// beyond filter_samples. What each share leaves in the history adds up, and by 1 / n alone would be 7 % of 64 samples.
STAGE real fading_share(real of_mean, settings_t settings)
{
    return lesser(of_mean, K(settings.filter_samples) * (of_mean * of_mean));
}

// The effective sample count of a pixel's rectified history, count_limit at most: the further rectification moved it,
// the fewer samples it counts for (clip_penalty), and the more reactive the pixel is.
STAGE real effective_count(pixel_t p, history_t h, rectification r, settings_t settings)
{
    real count = h.count;
    if (CLIP_PENALTY)
        count = quotient(count, SPLAT(1.0) + K(settings.clip_penalty) * r.clip_distance);
    count = lesser(count, h.count_limit);
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

// The sample to blend with a history of `count` samples: the pixel's own, or the filtered one.
STAGE colour sample_beside(pixel_t p, mask valid, real count, settings_t settings)
{
    if (FILTER_USE != FILTER_USE_FEW_SAMPLES)
        return p.filtered;
    const real share = valid ? fading_share(reciprocal(count + K(1.0)), settings) : SPLAT(1.0);
    return drawn_towards(p.own, p.filtered, filtered_share(share, p.filtered, settings));
}

// The pixel's sample blended with its rectified history, or begun anew where there is none.
STAGE resolved resolve_pixel(pixel_t p, history_t h, rectification r, settings_t settings)
{
    const real count = effective_count(p, h, r, settings);
    const colour past = rectified(h, r, settings), current = sample_beside(p, h.valid, count, settings);
    const real y = FILTER_USE == FILTER_USE_FEW_SAMPLES ? luminance_4(current) : p.luminance,
               past_y = luminance_4(past);
    real weight = weight_of_sample(count, y, past_y, p.reactivity, r.blend_boost, settings);
    if (ANTI_FLICKER == ANTI_FLICKER_DIFFERENCE)
        weight *= difference_share(y, past_y, settings);
    if (ANTI_FLICKER == ANTI_FLICKER_CLAMP_DISTANCE)
        weight *= r.anti_flicker_factor;
    // What counts for nothing, such as what was filled, is no history; a mean of all gives it no weight by itself.
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
        out.alpha = h.valid ? blend(h.alpha, p.alpha, weight) : p.alpha;
    out.count = h.valid ? grown_count(count, r.blend_boost) : (FIRST_SAMPLES ? h.count : SPLAT(1.0));
    out.change = h.valid ? h.change : SPLAT(0.0);
    return out;
}

// The result of a segment in which samples are missing. A missing sample is none: the pixel keeps its history as it is,
// with its count, where one sample or more is in that; elsewhere it is filled, which counts for nothing.
STAGE resolved without_missing(resolved out, history_t h, plane_in current, int x, int y, frame_t frame)
{
    const mask missing = sample_is_missing(current, x, y, frame), kept = h.valid & (h.count >= SPLAT(1.0));
    const colour nothing = { 0 };
    colour v = storable_colour(from_range(h.rgb), nothing);
    if (any_of(missing & !kept)) {
        const colour filled = filled_colour(current, plane_size(frame), x, y, frame);
        v = choose_colour(kept, v, storable_colour(from_range(filled), filled));
    }
    out.rgb = choose_colour(missing, v, out.rgb);
    if (ALPHA_FROM == ALPHA_FROM_BLEND)
        out.alpha = missing & kept ? h.alpha : out.alpha;
    out.count = missing ? (kept ? lesser(h.count, h.count_limit) : SPLAT(0.0)) : out.count;
    out.change = missing ? (kept ? h.change : SPLAT(0.0)) : out.change;
    return out;
}

// The alpha of the history; where colour is moved into a box, clamped to the extremes of the current 3x3. A trail that
// colour has left would stay in alpha, and darken whatever it is laid over.
STAGE real rectified_alpha(plane_in alpha, real past, int x, int y, frame_t frame)
{
    if (!ALPHA | (RECTIFY == RECTIFY_NONE))
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
