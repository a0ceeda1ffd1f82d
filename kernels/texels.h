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

// Where the taps of the upper left texel and of those beside and below it lie: columns and rows of them as steps from
// the texel of the segment's own place, in elements.
typedef struct
{
    whole column[LINE], row[LINE];
    uint own;
    int lanes;
} taps_at;

STAGE taps_at place_taps(footprint f, frame_t frame)
{
    const scalar_whole plane = (scalar_whole)history_plane_size(frame), stride = row_stride(frame);
    taps_at at;
    for (int i = 0; i < LINE; ++i) {
        const whole dx = f.dx + (i + FIRST_TAP), dy = f.dy + (i + FIRST_TAP);
        at.column[i] = (dx & 1) * plane + (dx >> 1);
        at.row[i] = (dy & 1) * (2 * plane) + (dy >> 1) * stride;
    }
    at.own = f.own;
    at.lanes = f.lanes;
    return at;
}

// The tap that lies `column` and `row` texels from the footprint, of the channel p.
STAGE real load_tap(history_in p, const taps_at* at, int column, int row)
{
    const whole step = at->column[column - FIRST_TAP] + at->row[row - FIRST_TAP];
    history_in q = p + at->own;
#if LANES > 1
    if (at->lanes > LANES_ALIKE)
        return history_apart(q, step + (whole)(LANE_NUMBERS));
#endif
    return load_history(q + first_lane(step));
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
STAGE void sample_texels(real* v, history_in p, const taps_at* at, weights wx, weights wy)
{
    if (at->lanes == LANES_ON_TEXELS) {
        for (int t = 0; t < 4; ++t)
            v[t] = load_tap(p, at, t & 1, t >> 1);
        return;
    }
    row_taps left[LINE], right[LINE];
    for (int row = 0; row < LINE; ++row) {
        real taps[LINE];
        for (int column = 0; column < LINE; ++column)
            taps[column] = load_tap(p, at, column + FIRST_TAP, row + FIRST_TAP);
        left[row] = weigh_taps(taps, wx);
        right[row] = weigh_taps(taps + 1, wx);
    }
    v[0] = weigh_lines(left, wx, wy);
    v[1] = weigh_lines(right, wx, wy);
    v[2] = weigh_lines(left + 1, wx, wy);
    v[3] = weigh_lines(right + 1, wx, wy);
}

// The same of the channel of counts, which are interpolated.
STAGE void sample_counts(real* v, history_in p, const taps_at* at, footprint f)
{
    real c[3][3];
    for (int i = 0; i < 9; ++i)
        c[i / 3][i % 3] = load_tap(p, at, i % 3, i / 3);
    for (int t = 0; t < 4; ++t) {
        const int x = t & 1, y = t >> 1;
        const quad around = { c[y][x], c[y][x + 1], c[y + 1][x], c[y + 1][x + 1] };
        v[t] = bilinear(around, f);
    }
}
