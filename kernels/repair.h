// Repair: a texel outside the domain (NaN, infinite, beyond DOMAIN_LIMIT) becomes the mean of the usable texels of its
// own 3x3, or 0 where there are none. Such texels are rare: a whole row segment is tested at once, and only a segment
// that holds one takes the slow way, texel by texel.

STAGE int texel_outside_domain(plane_in p, size_t plane)
{
    const int limit = as_int((float)DOMAIN_LIMIT);
    return ((as_int(p[0]) & 0x7fffffff) > limit) | ((as_int(p[plane]) & 0x7fffffff) > limit)
        | ((as_int(p[2 * plane]) & 0x7fffffff) > limit);
}

// The repaired channel of the texel at (x, y); coordinates outside the image mean its edge.
STAGE float repaired_texel(plane_in image, size_t plane, int channel, int x, int y, frame_t frame)
{
    x = x < 0 ? 0 : (x >= frame.width ? frame.width - 1 : x);
    y = y < 0 ? 0 : (y >= frame.height ? frame.height - 1 : y);
    plane_in p = image + texel_offset(frame, x, y);
    if (!texel_outside_domain(p, plane))
        return p[(size_t)channel * plane];
    float sum = 0.0f;
    int usable = 0;
    for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i) {
            plane_in q = p + (ptrdiff_t)j * frame.stride + i;
            if (!texel_outside_domain(q, plane)) {
                sum += q[(size_t)channel * plane];
                usable += 1;
            }
        }
    return usable > 0 ? sum / (float)usable : 0.0f;
}

STAGE real repaired_channel(plane_in image, size_t plane, int channel, int x, int y, frame_t frame)
{
#if LANES == 1
    return repaired_texel(image, plane, channel, x, y, frame);
#else
    real v;
    for (int lane = 0; lane < LANES; ++lane)
        ((scalar*)&v)[lane] = repaired_texel(image, plane, channel, x + lane, y, frame);
    return v;
#endif
}

// The colour at (x, y) and the LANES - 1 texels right of it.
STAGE colour repaired_colour(plane_in image, size_t plane, int x, int y, frame_t frame)
{
    colour v;
    v.r = repaired_channel(image, plane, 0, x, y, frame);
    v.g = repaired_channel(image, plane, 1, x, y, frame);
    v.b = repaired_channel(image, plane, 2, x, y, frame);
    return v;
}

// The colour at (x, y), repaired where need be, in the range that everything is compared in.
STAGE colour usable_colour(plane_in image, size_t plane, int x, int y, frame_t frame)
{
    const colour v = load_colour(image + texel_offset(frame, x, y), plane);
    return to_range(any_of(colour_outside_domain(v)) ? repaired_colour(image, plane, x, y, frame) : v);
}
