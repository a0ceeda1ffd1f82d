// The history of a pixel: its colour at the place where the surface was, and whether it can be used at all.
#if !defined(EXPOSURE) || !defined(ALPHA) || !defined(REJECT)
#error "history.h needs EXPOSURE, ALPHA and REJECT from the prelude"
#endif

typedef struct
{
    colour rgb;
    real alpha, count, fx, fy;
    mask valid;
} history_t;

// The 4x4 taps of a column's last pixel, a channel. Work-items of one lane keep them in registers: where the next pixel
// down moves by the same whole number of texels, twelve of its sixteen taps are there already.
typedef struct
{
    int held;
#if LANES == 1
    scalar_whole dx, dy;
    real r[16], g[16], b[16];
#endif
} taps_t;

// The first pixel of a column finds nothing there.
STAGE void forget_taps(taps_t* taps)
{
    taps->held = 0;
#if LANES == 1
    taps->dx = taps->dy = 0;
#endif
}

#if LANES == 1
STAGE real sample_taps(history_in p, footprint f, real* taps, int same, weights wx, weights wy, int stride)
{
    history_in q = p + f.offset - stride - 1;
    for (int row = 0; row < 4; ++row)
        for (int column = 0; column < 4; ++column)
            taps[4 * row + column]
                = (same & (row < 3)) ? taps[4 * row + column + 4] : load_history(q + (ptrdiff_t)row * stride + column);
    return weigh(weigh(taps[0], taps[1], taps[2], taps[3], wx), weigh(taps[4], taps[5], taps[6], taps[7], wx),
        weigh(taps[8], taps[9], taps[10], taps[11], wx), weigh(taps[12], taps[13], taps[14], taps[15], wx), wy);
}
#endif

STAGE colour sample_colour(history_in p, footprint f, weights wx, weights wy, size_t plane, int stride, taps_t* taps)
{
    colour v;
#if LANES == 1
    const int same = taps->held & (f.dx == taps->dx) & (f.dy == taps->dy);
    v.r = sample_taps(p, f, taps->r, same, wx, wy, stride);
    v.g = sample_taps(p + plane, f, taps->g, same, wx, wy, stride);
    v.b = sample_taps(p + 2 * plane, f, taps->b, same, wx, wy, stride);
    taps->held = 1, taps->dx = f.dx, taps->dy = f.dy;
#else
    v.r = sample_plane(p, f, wx, wy, stride);
    v.g = sample_plane(p + plane, f, wx, wy, stride);
    v.b = sample_plane(p + 2 * plane, f, wx, wy, stride);
#endif
    return v;
}

STAGE history_t sample_history(history_in history, plane_in count, plane_in previous_closeness, motion_t m, surface s,
    int x, int y, frame_t frame, settings_t settings, taps_t* taps)
{
    const size_t plane = history_plane_size(frame), at = history_offset(frame, x, y);
    history_t h;
    const motion_t seen = motion_to_edge(m, LANE_INDEX + K(x), SPLAT(y), frame);
    h.valid = on_screen(seen, LANE_INDEX + K(x), SPLAT(y), frame) & (whole)(frame.reset ? 0 : -1);
    const footprint f = footprint_of(seen, h.valid, frame);
    const weights wx = history_weights(f.fx), wy = history_weights(f.fy);
    h.rgb = sample_colour(history + at, f, wx, wy, plane, frame.stride, taps);
    h.valid = h.valid & !colour_outside_domain(h.rgb);
    if (EXPOSURE) {
        h.rgb.r *= K(frame.exposure_ratio);
        h.rgb.g *= K(frame.exposure_ratio);
        h.rgb.b *= K(frame.exposure_ratio);
    }
    h.rgb = to_range(h.rgb);
    h.alpha = SPLAT(1.0);
    if (ALPHA)
        h.alpha = limit(sample_plane(history + at + 3 * plane, f, wx, wy, frame.stride), SPLAT(0.0), SPLAT(1.0));
    h.count = bilinear(sample_quad(count + at, f, frame.stride), f);
    if (REJECT == REJECT_DEPTH)
        h.valid = h.valid & same_surface(sample_quad(previous_closeness + at, f, frame.stride), s, m, settings);
    h.fx = f.fx;
    h.fy = f.fy;
    return h;
}
