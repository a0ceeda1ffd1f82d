// One output pixel from its current sample, its neighbourhood and its history.
#if !defined(ALPHA)
#error "pixel.h needs ALPHA from the prelude"
#endif

typedef struct
{
    colour rgb;
    real alpha, count;
} resolved;

// Half width of the box in standard deviations: wide where nothing moves, narrow from motion_px pixels a frame on.
STAGE real box_gamma(motion_t m, settings_t settings)
{
    const real speed = greater(absolute(m.u), absolute(m.v)) / K(settings.motion_px);
    const real still = greater(SPLAT(1.0) - speed, SPLAT(0.0));
    return SPLAT(settings.gamma_moving) + still * (K(settings.gamma_still) - K(settings.gamma_moving));
}

// The sample of a pixel without history: drawn towards the mean of its neighbourhood by fresh_blur, since one raw
// sample is as aliased as an image can be.
STAGE colour fresh_colour(colour current, boxed mean, settings_t settings)
{
    const boxed c = to_box_space(current);
    const boxed offset = { mean.a - c.a, mean.b - c.b, mean.c - c.c };
    const colour change = from_box_space(offset);
    const scalar k = K(settings.fresh_blur);
    colour v = { current.r + k * change.r, current.g + k * change.g, current.b + k * change.b };
    return v;
}

STAGE resolved resolve_pixel(
    colour current, real alpha, real reactivity, boxed mean, history_t h, rectification r, settings_t settings)
{
    const colour past = { h.rgb.r + r.change.r, h.rgb.g + r.change.g, h.rgb.b + r.change.b };
    real count = believed_count(h.count, h.fx, h.fy, r.pull, settings);
    if (REACTIVE)
        count *= SPLAT(1.0) - reactivity;
    real weight = sample_weight(count, settings);
    if (REACTIVE)
        weight += reactivity * (SPLAT(1.0) - weight);
    weight = luminance_weight(weight, current, past, settings);

    const colour fresh = fresh_colour(current, mean, settings);
    const real zero = SPLAT(0.0);
    resolved out;
    out.rgb.r = storable(h.valid ? blend(past.r, current.r, weight) : fresh.r, lesser(current.r, zero));
    out.rgb.g = storable(h.valid ? blend(past.g, current.g, weight) : fresh.g, lesser(current.g, zero));
    out.rgb.b = storable(h.valid ? blend(past.b, current.b, weight) : fresh.b, lesser(current.b, zero));
    out.alpha = h.valid ? blend(h.alpha, alpha, weight) : alpha;
    out.count = h.valid ? count + K(1.0) : SPLAT(1.0);
    return out;
}

// Alpha and reactivity are shares: outside [0, 1], or no number, means the nearer end (no number: `otherwise`).
STAGE real load_share(plane_in p, real otherwise)
{
    const real v = load(p);
    return outside_domain(v) ? otherwise : limit(v, SPLAT(0.0), SPLAT(1.0));
}

STAGE void store_resolved(history_out colour_at, plane_out count_at, resolved r, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame);
    store_history(colour_at, r.rgb.r, x, y, frame);
    store_history(colour_at + plane, r.rgb.g, x, y, frame);
    store_history(colour_at + 2 * plane, r.rgb.b, x, y, frame);
    if (ALPHA)
        store_history(colour_at + 3 * plane, r.alpha < SPLAT(TINY) ? SPLAT(0.0) : r.alpha, x, y, frame);
    store(count_at, r.count);
}
