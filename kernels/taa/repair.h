// Repair: a texel outside the domain (NaN, infinite, beyond DOMAIN_LIMIT) becomes the mean of the usable texels of its
// own 3x3, or 0 where there are none. Such texels are rare: a whole row segment is tested at once, and only a segment
// that holds one takes the slow way, texel by texel.
#include "taa/colour.h"
#include "platform/image.h"

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
    int in_domain = 0;
    for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i) {
            plane_in q = p + (ptrdiff_t)j * row_stride(frame) + i;
            if (!texel_outside_domain(q, plane)) {
                sum += q[(size_t)channel * plane];
                in_domain += 1;
            }
        }
    return in_domain > 0 ? sum / (float)in_domain : 0.0f;
}

// The colours at (x, y) and the texels right of it, `count` of them, of LANES texels each. On a CPU in a loop that
// stays one: what is rare shall be small, for the compiler took a third of its time over this.
STAGE void repair_colours(colour* out, int count, plane_in image, size_t plane, int x, int y, frame_t frame)
{
#if LANES == 1
#pragma unroll
    for (int i = 0; i < count; ++i) {
        out[i].r = repaired_texel(image, plane, 0, x + i, y, frame);
        out[i].g = repaired_texel(image, plane, 1, x + i, y, frame);
        out[i].b = repaired_texel(image, plane, 2, x + i, y, frame);
    }
#else
    scalar* values = (scalar*)out;
#ifdef __clang__
#pragma clang loop unroll(disable) vectorize(disable)
#endif
    for (int i = 0; i < count * 3 * LANES; ++i) {
        const int texel = i / (3 * LANES), channel = i / LANES % 3, lane = i % LANES;
        values[i] = repaired_texel(image, plane, channel, x + texel + lane, y, frame);
    }
#endif
}

// The colour at (x, y), repaired where need be, in the range that everything is compared in.
STAGE colour colour_in_domain(plane_in image, size_t plane, int x, int y, frame_t frame)
{
    colour v = load_colour(image + texel_offset(frame, x, y), plane);
    if (any_of(colour_outside_domain(v)))
        repair_colours(&v, 1, image, plane, x, y, frame);
    return to_range(v);
}
