// Blending: how much the current sample counts against the history.
#include "taa/colour.h"

#if !defined(ACCUMULATE) || !defined(WEIGHTING) || !defined(ANTI_FLICKER) || !defined(NEGATIVES)
#error "blend.h needs ACCUMULATE, WEIGHTING, ANTI_FLICKER and NEGATIVES from the prelude"
#endif

// Weight of the current sample when the history already holds `count` samples: 1 / (count + 1) for the running mean;
// never below blend_weight for the exponential one, always that for the constant one, and between it and moving_weight
// for the adaptive one.
STAGE real sample_weight(real count, real blend_boost, settings_t settings)
{
    if (ACCUMULATE == ACCUMULATE_CONSTANT)
        return SPLAT(settings.blend_weight);
    if (ACCUMULATE == ACCUMULATE_ADAPTIVE)
        return K(settings.blend_weight) + blend_boost * (K(settings.moving_weight) - K(settings.blend_weight));
    const real mean = reciprocal(count + K(1.0));
    if (ACCUMULATE == ACCUMULATE_COUNT)
        return mean;
    return greater(mean, SPLAT(settings.blend_weight));
}

// What `count` samples count as in the mean that `accumulate` takes: with the new one 1 / blend_weight at most.
STAGE real samples_in_mean(real count, settings_t settings)
{
    if (ACCUMULATE == ACCUMULATE_COUNT)
        return count;
    // Not by `reciprocal`, which is worked out pixel by pixel: a compiler moves a division by a setting out of the
    // loop.
    return lesser(count, SPLAT(1.0) / SPLAT(settings.blend_weight) - K(1.0));
}

// The most samples that a history may stand for. Resampling between texels blurs, the more the further the position
// lies from a texel, so it limits the count (resampling_penalty); and sample_limit is the most that is ever counted.
STAGE real count_limit_of(real fx, real fy, settings_t settings)
{
    real least = reciprocal(SPLAT(settings.sample_limit));
    if (RESAMPLING_PENALTY)
        least += K(settings.resampling_penalty) * (fx * (SPLAT(1.0) - fx) + fy * (SPLAT(1.0) - fy));
    return reciprocal(least);
}

// How many samples the history still stands for, `count_limit` at most: history that had to be pulled into its box is
// less to be believed (clip_penalty).
STAGE real effective_count(real count, real count_limit, real clip_distance, settings_t settings)
{
    real effective = count;
    if (CLIP_PENALTY)
        effective = quotient(count, SPLAT(1.0) + K(settings.clip_penalty) * clip_distance);
    return lesser(effective, count_limit);
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
    const colour d = { a * v.r - b * other.r, a * v.g - b * other.g, a * v.b - b * other.b };
    return d;
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
// sample, so that light never turns negative through a negative lobe or a chroma clamp. On a GPU that stores halves
// also nothing that would round to 0 or -0, which half_storable need not ask again.
STAGE real storable(real v, real current)
{
    const real floor_value = lesser(current, SPLAT(0.0));
    const real raised = NEGATIVES == NEGATIVES_RAISE ? greater(v, floor_value) : v;
#if NATIVE && STORAGE_HALF
    const mask nothing = absolute(raised) <= SPLAT(HALF_TINY);
#else
    const mask nothing = absolute(raised) < SPLAT(TINY);
#endif
    return outside_domain(raised) | nothing ? SPLAT(0.0) : raised;
}

STAGE colour storable_colour(colour v, colour current)
{
    const colour stored = { storable(v.r, current.r), storable(v.g, current.g), storable(v.b, current.b) };
    return stored;
}
