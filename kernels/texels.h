// A history of two by two texels a pixel, at 200 % of the image. The texels that lie alike in their pixels share a
// plane of the image's own layout, so that the lanes of a segment lie side by side here too. Four planes follow one
// another for each of r, g, b, alpha where there is any, and count: of the upper left texels, upper right, lower left,
// lower right.
#include "sampling.h"

#if !defined(ALPHA)
#error "texels.h needs ALPHA from the prelude"
#endif

#define CHANNELS (4 + ALPHA)
#define COUNT (3 + ALPHA) // the channel of counts
#define FIRST_TAP (SIX_TAPS ? -2 : -1)
#define TAPS (SIX_TAPS ? 6 : 4)
#define LINE (TAPS + 1) // taps in a line of the two texels of a pixel: their footprints lie one texel apart

// Where the texels of a segment were, in texels: two a pixel.
STAGE footprint doubled_footprint(motion_t m, mask valid, uint at, frame_t frame)
{
    if (!(CAMERA_MOTION || OWN_MOTION))
        return own_texel(at);
    m.u *= K(2.0);
    m.v *= K(2.0);
    return footprint_of(m, valid, at, frame);
}

// From the upper left texel of a pixel to that `dx` texels right of it and `dy` below, in elements of their planes.
STAGE ptrdiff_t texel_step(int dx, int dy, frame_t frame)
{
    const ptrdiff_t plane = (ptrdiff_t)history_plane_size(frame);
    return ((dy & 1) * 2 + (dx & 1)) * plane + (dy >> 1) * (ptrdiff_t)row_stride(frame) + (dx >> 1);
}

// The tap of the upper left texel that lies `column` and `row` texels from its footprint, of the channel p.
STAGE real load_tap(history_in p, footprint f, int column, int row, frame_t frame)
{
    history_in q = p + f.own;
#if LANES > 1
    if (f.lanes > LANES_ALIKE) {
        real v;
        for (int lane = 0; lane < LANES; ++lane) {
            const int dx = (int)((const scalar_whole*)&f.dx)[lane], dy = (int)((const scalar_whole*)&f.dy)[lane];
            history_in texel = q + texel_step(dx + column, dy + row, frame) + lane;
#if STORAGE_HALF
            ((scalar*)&v)[lane] = vload_half(0, texel);
#else
            ((scalar*)&v)[lane] = (scalar)*texel;
#endif
        }
        return v;
    }
#endif
    return load_history(q + texel_step((int)first_lane(f.dx) + column, (int)first_lane(f.dy) + row, frame));
}

STAGE row_taps weigh_taps(const real* t, weights w)
{
    const real zero = SPLAT(0.0);
    return SIX_TAPS ? weigh(t[0], t[1], t[2], t[3], t[4], t[TAPS - 1], w)
                    : weigh(zero, t[0], t[1], t[2], t[3], zero, w);
}

STAGE real weigh_lines(const row_taps* r, weights wx, weights wy)
{
    const row_taps none = NO_TAPS;
    return SIX_TAPS ? weigh_rows(r[0], r[1], r[2], r[3], r[4], r[TAPS - 1], wx, wy)
                    : weigh_rows(none, r[0], r[1], r[2], r[3], none, wx, wy);
}

// The four texels of a pixel from a channel of colour. They lie between taps alike, so that each row of taps is weighed
// along x for both texels of a line, and once for both lines.
STAGE void sample_texels(real* v, history_in p, footprint f, weights wx, weights wy, frame_t frame)
{
    if (f.lanes == LANES_ON_TEXELS) {
        for (int t = 0; t < 4; ++t)
            v[t] = load_tap(p, f, t & 1, t >> 1, frame);
        return;
    }
    row_taps left[LINE], right[LINE];
    for (int row = 0; row < LINE; ++row) {
        real taps[LINE];
        for (int column = 0; column < LINE; ++column)
            taps[column] = load_tap(p, f, column + FIRST_TAP, row + FIRST_TAP, frame);
        left[row] = weigh_taps(taps, wx);
        right[row] = weigh_taps(taps + 1, wx);
    }
    v[0] = weigh_lines(left, wx, wy);
    v[1] = weigh_lines(right, wx, wy);
    v[2] = weigh_lines(left + 1, wx, wy);
    v[3] = weigh_lines(right + 1, wx, wy);
}

// The same of the channel of counts, which are interpolated.
STAGE void sample_counts(real* v, history_in p, footprint f, frame_t frame)
{
    real c[3][3];
    for (int i = 0; i < 9; ++i)
        c[i / 3][i % 3] = load_tap(p, f, i % 3, i / 3, frame);
    for (int t = 0; t < 4; ++t) {
        const int x = t & 1, y = t >> 1;
        const quad around = { c[y][x], c[y][x + 1], c[y + 1][x], c[y + 1][x + 1] };
        v[t] = bilinear(around, f);
    }
}
