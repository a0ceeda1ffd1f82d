// Blending: how much the current sample counts against the history.
#if !defined(ACCUMULATE) || !defined(WEIGHTING) || !defined(REACTIVE)
#error "blend.h needs ACCUMULATE, WEIGHTING and REACTIVE from the prelude"
#endif

// Weight of the current sample when the history already holds `count` samples: 1 / (count + 1) for the running mean, a
// constant once the history is older than its reciprocal for the exponential one.
STAGE real sample_weight(real count, settings_t settings)
{
    const real mean = SPLAT(1.0) / (count + K(1.0));
    if (ACCUMULATE == ACCUMULATE_COUNT)
        return mean;
    return greater(mean, SPLAT(settings.blend_weight));
}

// How many samples the history still stands for. Resampling between texels blurs, the more the further the position
// lies from a texel, so it limits the count (resample_cost); history that had to be pulled into its box is less to be
// believed (pull_cost); and sample_limit is the most that is ever counted.
STAGE real believed_count(real count, real fx, real fy, real pull, settings_t settings)
{
    const real between = fx * (SPLAT(1.0) - fx) + fy * (SPLAT(1.0) - fy);
    const real most = SPLAT(1.0) / (SPLAT(1.0) / K(settings.sample_limit) + K(settings.resample_cost) * between);
    const real believed = count / (SPLAT(1.0) + K(settings.pull_cost) * pull);
    return lesser(believed, most);
}

// Luminance weights 1 / (knee + Y) (Karis 2014 with knee 1) as one weight of the current sample, so that blending stays
// a single step from the history: w_x / (w_x + w_h).
STAGE real luminance_weight(real weight, colour current, colour history, settings_t settings)
{
    if (WEIGHTING == WEIGHTING_NONE)
        return weight;
    const real x = SPLAT(settings.luminance_knee) + greater(luminance(current), SPLAT(0.0));
    const real h = SPLAT(settings.luminance_knee) + greater(luminance(history), SPLAT(0.0));
    const real for_current = weight * h, for_history = (SPLAT(1.0) - weight) * x;
    return for_current / (for_current + for_history);
}

// h + w (x - h): equal inputs stay as they are, to the bit. The caller selects x where there is no history.
STAGE real blend(real history, real current, real weight) { return history + weight * (current - history); }

// A value fit to be stored: inside the domain, never a denormal, never -0. `floor_value` is the least of 0 and the
// current sample, so that light never turns negative through a negative lobe or a chroma clamp.
STAGE real storable(real v, real floor_value)
{
    const real raised = greater(v, floor_value);
    const mask bad = outside_domain(raised) | (absolute(raised) < SPLAT(TINY));
    return bad ? SPLAT(0.0) : raised;
}
