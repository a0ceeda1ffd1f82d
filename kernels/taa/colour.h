// Colour: three reals, as RGB, or in the space in which history is compared with the neighbourhood (the box space).
#include "platform/image.h"

typedef struct
{
    real r, g, b;
} colour;

// Coordinates in the box space: 4 Y, 2 Co, 4 Cg or R, G, B.
typedef struct
{
    real a, b, c;
} boxed;

// Scale of the boxed coordinates: BOX_A times Y and Cg, BOX_B times Co.
#define BOX_A (BOX_SPACE == BOX_SPACE_YCOCG ? 4.0 : 1.0)
#define BOX_B (BOX_SPACE == BOX_SPACE_YCOCG ? 2.0 : 1.0)

// Malvar and Sullivan 2003: all coefficients are powers of two, so that greys have exactly no chroma, and so that
// the coordinates without their divisors have the same digits.
STAGE boxed to_box_space(colour v)
{
    boxed out = { v.r, v.g, v.b };
    if (BOX_SPACE == BOX_SPACE_YCOCG) {
        const real rb = v.r + v.b;
        out.a = rb + K(2.0) * v.g;
        out.b = v.r - v.b;
        out.c = K(2.0) * v.g - rb;
    }
    return out;
}

STAGE colour from_box_space(boxed v)
{
    colour out = { v.a, v.b, v.c };
    if (BOX_SPACE == BOX_SPACE_YCOCG) {
        const real t = K(0.25) * (v.a - v.c);
        out.r = t + K(0.5) * v.b;
        out.g = K(0.25) * (v.a + v.c);
        out.b = t - K(0.5) * v.b;
    }
    return out;
}

// To Y, Co, Cg (or R, G, B), and back.
STAGE boxed in_units(boxed v) { return (boxed) { v.a * K(1.0 / BOX_A), v.b * K(1.0 / BOX_B), v.c * K(1.0 / BOX_A) }; }
STAGE boxed from_units(boxed v) { return (boxed) { v.a * K(BOX_A), v.b * K(BOX_B), v.c * K(BOX_A) }; }

// Y of YCoCg, whatever the box space: R/4 + G/2 + B/4. And four times it.
STAGE real luminance(colour v) { return K(0.25) * (v.r + v.b) + K(0.5) * v.g; }
STAGE real luminance_4(colour v) { return (v.r + v.b) + K(2.0) * v.g; }

// The largest channel. At least 0, so that no tone curve divides by less than 1.
STAGE real peak(colour v) { return greater(greater(greater(v.r, v.g), v.b), SPLAT(0.0)); }

STAGE colour plus(colour a, colour b) { return (colour) { a.r + b.r, a.g + b.g, a.b + b.b }; }
STAGE colour minus(colour a, colour b) { return (colour) { a.r - b.r, a.g - b.g, a.b - b.b }; }
STAGE colour scaled(colour v, real k) { return (colour) { v.r * k, v.g * k, v.b * k }; }
STAGE colour plus_scaled(colour v, real k, colour d)
{
    return (colour) { v.r + k * d.r, v.g + k * d.g, v.b + k * d.b };
}
STAGE colour quotients(colour v, real by)
{
    return (colour) { quotient(v.r, by), quotient(v.g, by), quotient(v.b, by) };
}
STAGE real inner(colour a, colour b) { return (a.r * b.r + a.g * b.g) + a.b * b.b; }

// Tone curve c / (1 + peak). One factor for all three channels keeps the hue.
STAGE colour peak_range(colour v) { return scaled(v, SPLAT(1.0) / (SPLAT(1.0) + peak(v))); }

// Tonemaps for the blend alone.
STAGE colour to_blend_range(colour v) { return TONEMAP == TONEMAP_BLEND ? peak_range(v) : v; }

// Tonemaps one channel by itself, c / (1 + c), and back (Reinhard et al. 2002); negative values stay unchanged.
STAGE real compressed(real v) { return v / (SPLAT(1.0) + greater(v, SPLAT(0.0))); }
STAGE real untonemapped(real v) { return v / greater(SPLAT(1.0) - greater(v, SPLAT(0.0)), SPLAT(LEAST_HEADROOM)); }

// Tonemaps scene-referred colour to the range in which it is compared and blended, and back. The way back leaves at
// least LEAST_HEADROOM of headroom: 1 - peak of a colour near white is all rounding.
STAGE colour to_range(colour v)
{
    if ((TONEMAP == TONEMAP_NONE) | (TONEMAP == TONEMAP_BLEND))
        return v;
    if (TONEMAP == TONEMAP_CHANNEL)
        return (colour) { compressed(v.r), compressed(v.g), compressed(v.b) };
    return peak_range(v);
}

STAGE colour from_range(colour v)
{
    if (TONEMAP == TONEMAP_NONE)
        return v;
    if (TONEMAP == TONEMAP_CHANNEL)
        return (colour) { untonemapped(v.r), untonemapped(v.g), untonemapped(v.b) };
    return scaled(v, SPLAT(1.0) / greater(SPLAT(1.0) - peak(v), SPLAT(LEAST_HEADROOM)));
}

STAGE mask colour_outside_domain(colour v) { return outside_domain(v.r) | outside_domain(v.g) | outside_domain(v.b); }

// Bits of the largest magnitude of the three. Such bits have the order of the magnitudes; NaN is above all.
STAGE whole larger_bits(whole a, whole b) { return a > b ? a : b; }
STAGE whole largest_bits(colour v)
{
    return larger_bits(larger_bits(magnitude_bits(v.r), magnitude_bits(v.g)), magnitude_bits(v.b));
}

// A texel of the frame: colour and alpha, of which neither is usable without the other.
typedef struct
{
    colour rgb;
    real alpha; // 1 where the frame has none
} texel_t;

STAGE mask outside_domain_of(texel_t v)
{
    return ALPHA ? colour_outside_domain(v.rgb) | outside_domain(v.alpha) : colour_outside_domain(v.rgb);
}

// 1 if a row of texels has one outside the domain: left neighbours of a segment's texels, its own, and right ones. With
// several lanes, each own texel is also a neighbour of another.
STAGE int any_outside_domain(texel_t left, texel_t own, texel_t right)
{
    if ((LANES == 1) | REAL_DOUBLE)
        return any_of(outside_domain_of(left) | outside_domain_of(own) | outside_domain_of(right));
    whole most = larger_bits(largest_bits(left.rgb), largest_bits(right.rgb));
    if (ALPHA)
        most = larger_bits(most, larger_bits(magnitude_bits(left.alpha), magnitude_bits(right.alpha)));
    return any_of(most > DOMAIN_BITS);
}

// Clamps a share (alpha, reactivity) to [0, 1]; outside the domain it is `otherwise`.
STAGE real share_in_domain(real v, real otherwise)
{
    return outside_domain(v) ? otherwise : limit(v, SPLAT(0.0), SPLAT(1.0));
}

STAGE real load_share(plane_in p, real otherwise) { return share_in_domain(load(p), otherwise); }

// 1 if alpha is accumulated; then whatever judges the history judges its alpha too.
#define ACCUMULATES_ALPHA (ALPHA & (ALPHA_FROM == ALPHA_FROM_BLEND))
// 1 if the history's alpha is clamped to that of the 3x3.
#define RECTIFIES_ALPHA (ALPHA & (RECTIFY != RECTIFY_NONE))

STAGE colour load_colour(plane_in p, size_t plane)
{
    return (colour) { load(p), load(p + plane), load(p + 2 * plane) };
}

STAGE texel_t load_texel(plane_in p, plane_in alpha, size_t plane)
{
    return (texel_t) { load_colour(p, plane), ALPHA ? load(alpha) : SPLAT(1.0) };
}

STAGE void store_colour(plane_out p, size_t plane, colour v)
{
    store(p, v.r);
    store(p + plane, v.g);
    store(p + 2 * plane, v.b);
}

STAGE colour choose_colour(mask m, colour a, colour b)
{
    return (colour) { m ? a.r : b.r, m ? a.g : b.g, m ? a.b : b.b };
}

// Repair: a texel outside the domain (NaN, infinite, beyond DOMAIN_LIMIT) becomes the mean of the usable texels of its
// own 3x3, or 0 where there are none. Such texels are rare: one test covers a whole row segment, and only a segment
// that holds one takes the slow path, texel by texel.
STAGE int texel_outside_domain(plane_in image, plane_in alpha, size_t plane, size_t at)
{
    const int limit = as_int((float)DOMAIN_LIMIT);
    plane_in p = image + at;
    return ((as_int(p[0]) & 0x7fffffff) > limit) | ((as_int(p[plane]) & 0x7fffffff) > limit)
        | ((as_int(p[2 * plane]) & 0x7fffffff) > limit) | (ALPHA && (as_int(alpha[at]) & 0x7fffffff) > limit);
}

// Channel 0 to 3 of the texel `at`: r, g, b, alpha as a share.
STAGE float channel_of(plane_in image, plane_in alpha, size_t plane, int channel, size_t at)
{
    if (channel < 3)
        return image[(size_t)channel * plane + at];
    const float a = ALPHA ? alpha[at] : 1.0f;
    return a > 0.0f ? (a < 1.0f ? a : 1.0f) : 0.0f;
}

// Returns the repaired channel of the texel at (x, y); coordinates are clamped to the image.
STAGE float repaired_texel(plane_in image, plane_in alpha, size_t plane, int channel, int x, int y, frame_t frame)
{
    const size_t at = texel_offset(frame, limit_index(x, frame.width - 1), limit_index(y, frame.height - 1));
    if (!texel_outside_domain(image, alpha, plane, at))
        return channel_of(image, alpha, plane, channel, at);
    float sum = 0.0f;
    int in_domain = 0;
    for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i) {
            const size_t near = at + (size_t)(j * (ptrdiff_t)row_stride(frame) + i);
            if (!texel_outside_domain(image, alpha, plane, near)) {
                sum += channel_of(image, alpha, plane, channel, near);
                in_domain += 1;
            }
        }
    return in_domain > 0 ? sum / (float)in_domain : 0.0f;
}

// Writes `count` times LANES repaired texels: at (x, y), one texel to the right, and so on. On a CPU the loop stays
// rolled: this is rare, and a compiler spent a third of its time on it.
STAGE void repair_texels(
    texel_t* out, int count, plane_in image, plane_in alpha, size_t plane, int x, int y, frame_t frame)
{
    if (LANES == 1) {
#pragma unroll
        for (int i = 0; i < count; ++i) {
            out[i].rgb.r = repaired_texel(image, alpha, plane, 0, x + i, y, frame);
            out[i].rgb.g = repaired_texel(image, alpha, plane, 1, x + i, y, frame);
            out[i].rgb.b = repaired_texel(image, alpha, plane, 2, x + i, y, frame);
            out[i].alpha = ALPHA ? repaired_texel(image, alpha, plane, 3, x + i, y, frame) : SPLAT(1.0);
        }
        return;
    }
    scalar* values = (scalar*)out;
    ONE_BY_ONE
    for (int i = 0; i < count * 4 * LANES; ++i) {
        const int texel = i / (4 * LANES), channel = i / LANES % 4, lane = i % LANES;
        values[i] = repaired_texel(image, alpha, plane, channel, x + texel + lane, y, frame);
    }
}

// Fill: replaces a missing sample of a pixel without history by the mean of the nearest usable texel along each of
// eight rays, FILL_REACH steps at most, weighted by one over the squared distance; 0 where there is none. The sum is of
// differences from the first texel, so that equal texels keep their bits. A band sees only the rows that it holds.
STAGE void fill_texel(scalar* filled, plane_in image, plane_in alpha, size_t plane, int x, int y, frame_t frame)
{
    const int above = frame.first_row - PAD_Y, below = frame.first_row + band_rows(frame) + PAD_Y,
              top = above > 0 ? above : 0, bottom = below < frame.height ? below : frame.height;
    float first[4] = { 0.0f, 0.0f, 0.0f, 0.0f }, sum[4] = { 0.0f, 0.0f, 0.0f, 0.0f }, weight = 0.0f;
    NO_UNROLL
    for (int ray = 0; ray < 9; ++ray) {
        const int right = ray % 3 - 1, down = ray / 3 - 1, length = right * right + down * down;
        ONE_BY_ONE
        for (int step = 1; step <= (length > 0 ? FILL_REACH : 0); ++step) {
            const int i = x + step * right, j = y + step * down;
            if ((i < 0) | (i >= frame.width) | (j < top) | (j >= bottom))
                break;
            const size_t at = texel_offset(frame, i, j);
            if (texel_outside_domain(image, alpha, plane, at))
                continue;
            const float share = 1.0f / (float)(step * step * length);
            for (int channel = 0; channel < 3 + ALPHA; ++channel) {
                const float v = channel_of(image, alpha, plane, channel, at);
                first[channel] = weight > 0.0f ? first[channel] : v;
                sum[channel] += share * (v - first[channel]);
            }
            weight += share;
            break;
        }
    }
    for (int channel = 0; channel < 3 + ALPHA; ++channel)
        filled[channel * LANES] = weight > 0.0f ? first[channel] + sum[channel] / weight : 0.0f;
}

// Loads the segment at (x, y), fills each texel outside the domain, and tonemaps it to the range of comparison.
STAGE texel_t filled_texels(plane_in image, plane_in alpha, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame), at = texel_offset(frame, x, y);
    texel_t v = load_texel(image + at, alpha + at, plane);
    scalar* values = (scalar*)&v;
    ONE_BY_ONE
    for (int lane = 0; lane < LANES; ++lane)
        if (x + lane < frame.width && texel_outside_domain(image, alpha, plane, at + (size_t)lane))
            fill_texel(values + lane, image, alpha, plane, x + lane, y, frame);
    return (texel_t) { to_range(v.rgb), share_in_domain(v.alpha, SPLAT(1.0)) };
}

// True where the pixel's own sample is missing: its texel is outside the domain.
STAGE mask sample_is_missing(plane_in image, plane_in alpha, int x, int y, frame_t frame)
{
    const uint at = texel_offset(frame, x, y);
    return outside_domain_of(load_texel(image + at, alpha + at, plane_size(frame)));
}

// Loads the texels at (x, y), repairs them where necessary, and tonemaps them to the range of comparison.
STAGE texel_t texels_in_domain(plane_in image, plane_in alpha, int x, int y, frame_t frame)
{
    const uint at = texel_offset(frame, x, y);
    texel_t v = load_texel(image + at, alpha + at, plane_size(frame));
    if (any_of(outside_domain_of(v)))
        repair_texels(&v, 1, image, alpha, plane_size(frame), x, y, frame);
    return (texel_t) { to_range(v.rgb), share_in_domain(v.alpha, SPLAT(1.0)) };
}
