// A pixel whose history is four texels: read where its surface was, rectified as one, and each blended with the sample
// by how near that was drawn.
#include "pixel.h"
#include "texels.h"

STAGE real mean_of_four(real a, real b, real c, real d) { return K(0.25) * ((a + b) + (c + d)); }

STAGE colour mean_colour(colour a, colour b, colour c, colour d)
{
    const colour v
        = { mean_of_four(a.r, b.r, c.r, d.r), mean_of_four(a.g, b.g, c.g, d.g), mean_of_four(a.b, b.b, c.b, d.b) };
    return v;
}

// The history of a pixel's texels, and what they come to together.
typedef struct
{
    history_t texel[4];
    colour mean;
} doubled_t;

// Whether history can be used is decided once for all four texels: a pixel has one surface, and it is the pixel's
// motion that they follow.
STAGE doubled_t sample_doubled(plane_in previous_closeness, history_in texels, motion_t m, surface s, int x, int y,
    frame_t frame, settings_t settings)
{
    const uint at = history_offset(frame, x, y);
    const size_t channel = 4 * history_plane_size(frame);
    const motion_t seen = motion_to_edge(m, LANE_INDEX + K(x), SPLAT(y), frame);
    mask valid = on_screen(seen, LANE_INDEX + K(x), SPLAT(y), frame) & (whole)(frame.reset ? 0 : -1);
    const footprint pixel = CAMERA_MOTION || OWN_MOTION ? footprint_of(seen, valid, at, frame) : own_texel(at);
    const footprint f = doubled_footprint(seen, valid, at, frame);
    const taps_at taps = place_taps(f, frame);
    const weights wx = history_weights(f.fx), wy = history_weights(f.fy);
    real v[CHANNELS][4];
    for (int i = 0; i < COUNT; ++i)
        sample_texels(v[i], texels + i * channel, &taps, wx, wy);
    sample_counts(v[COUNT], texels + COUNT * channel, &taps, f);
    if (REJECT == REJECT_DEPTH)
        valid = valid & same_surface(sample_quad(previous_closeness, pixel, row_stride(frame)), s, m, settings);

    doubled_t d;
    for (int t = 0; t < 4; ++t) {
        const colour rgb = { v[0][t], v[1][t], v[2][t] };
        valid = valid & !colour_outside_domain(rgb);
        d.texel[t].rgb = history_in_range(rgb, frame);
        d.texel[t].alpha = ALPHA ? limit(v[COUNT - 1][t], SPLAT(0.0), SPLAT(1.0)) : SPLAT(1.0);
        d.texel[t].count = v[COUNT][t];
        d.texel[t].most = most_samples(f.fx, f.fy, settings);
    }
    for (int t = 0; t < 4; ++t)
        d.texel[t].valid = valid;
    d.mean = mean_colour(d.texel[0].rgb, d.texel[1].rgb, d.texel[2].rgb, d.texel[3].rgb);
    return d;
}

// What the frame's sample counts for in texel t of its pixel: it falls with the distance between the two.
STAGE scalar sample_mass(int t, frame_t frame)
{
    const scalar across = t & 1 ? K(frame.right_mass) : K(frame.left_mass);
    return across * (t & 2 ? K(frame.lower_mass) : K(frame.upper_mass));
}

// A texel beside a sample of that mass. A mass of m beside a history of n is one sample beside n / m of them.
STAGE resolved resolve_texel(pixel_t p, history_t h, rectification r, scalar mass, settings_t settings)
{
    const real count = quotient(believed_samples(p, h, r, settings), SPLAT(mass));
    resolved out = resolve_beside(p, h, r, count, settings);
    out.count *= mass;
    return out;
}

STAGE void store_texel(history_out texels, resolved v, int t, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame);
    history_out p = texels + t * plane + texel_offset(frame, x, y);
    store_history(p, v.rgb.r, x, y, frame);
    store_history(p + 4 * plane, v.rgb.g, x, y, frame);
    store_history(p + 8 * plane, v.rgb.b, x, y, frame);
    if (ALPHA)
        store_history(p + 12 * plane, v.alpha < SPLAT(TINY) ? SPLAT(0.0) : v.alpha, x, y, frame);
    store_history(p + 4 * COUNT * plane, v.count, x, y, frame);
}

// The pixel is the mean of its texels, as the truth is of its samples.
STAGE resolved mean_of_texels(const resolved* v)
{
    const colour mean = mean_colour(v[0].rgb, v[1].rgb, v[2].rgb, v[3].rgb);
    resolved out;
    out.rgb = storable_colour(mean, mean);
    out.alpha = mean_of_four(v[0].alpha, v[1].alpha, v[2].alpha, v[3].alpha);
    out.count = mean_of_four(v[0].count, v[1].count, v[2].count, v[3].count);
    return out;
}
