// The history's filters: what the taps around a position weigh. Taps 0 to 3 surround it, tap 1 is the texel at its
// whole part; a filter of six has one more before them and one behind. Every filter is applied to differences from a
// tap, so that equal taps give exactly their value, and a fraction of 0 gives exactly tap 1.
#include "platform/real.h"

#if !defined(HISTORY_FILTER)
#error "history_filter.h needs HISTORY_FILTER from the prelude"
#endif

#define SIX_TAPS (HISTORY_FILTER == HISTORY_FILTER_LANCZOS_3)
// Taps 1 and 2 are read as one pair, as a texture unit would read them: w2 is then the place between the two.
#define IN_PAIRS (HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM_9 || HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM_5)

// All weights but that of tap 1, which is what is left of 1. Of Catmull-Rom's 16 taps they are those of the steps from
// tap to tap instead: w0 of that from tap 0 to 1, w2 of that from 1 to 2, w3 of that from 2 to 3.
typedef struct
{
    real first, w0, w2, w3, last;
} weights;

// What the taps of a row come to: their weighted mean, or the pair of taps 1 and 2 and apart from it what 0 and 3 add.
typedef struct
{
    real middle, sides;
} row_taps;

#define NO_TAPS { SPLAT(0.0), SPLAT(0.0) }

// Catmull and Rom 1974, tension 1/2, at fraction t.
STAGE weights catmull_rom(real t)
{
    weights w;
    w.w3 = (t * t) * (K(-0.5) + K(0.5) * t);
    w.first = w.last = SPLAT(0.0);
    if (!IN_PAIRS) {
        w.w0 = t * (K(0.5) - t * (K(1.0) - K(0.5) * t));
        w.w2 = t * (K(0.5) + t * (K(1.5) - t));
        return w;
    }
    w.w0 = t * (K(-0.5) + t * (K(1.0) - K(0.5) * t));
    w.w2 = t * (K(0.5) + t * (K(2.0) - K(1.5) * t));
    w.w2 = w.w2 / (SPLAT(1.0) - (w.w0 + w.w3));
    return w;
}

// sinc(x) sinc(x / 3) for s = x^2 <= 9: its zeros as factors, so that they are exact, and a polynomial for the rest,
// interpolated in the Chebyshev nodes of [0, 9]; within 1e-5 of the function.
STAGE real lanczos_3(real s)
{
    real q = K(1.08880002e-9) * s + K(-5.33705067e-8);
    q = q * s + K(1.250181346e-6);
    q = q * s + K(-1.846066788e-5);
    q = q * s + K(1.8136861741e-4);
    q = q * s + K(-1.0968711551e-3);
    q = q * s + K(3.08639261435e-3);
    const real double_zero = SPLAT(9.0) - s;
    return ((SPLAT(1.0) - s) * (SPLAT(4.0) - s)) * ((double_zero * double_zero) * q);
}

// Six taps of Lanczos' kernel (Duchon 1979) at fraction t, made to sum to 1.
STAGE weights lanczos(real t)
{
    const real a = t + K(2.0), b = t + K(1.0), c = SPLAT(1.0) - t, d = SPLAT(2.0) - t, e = SPLAT(3.0) - t;
    weights w = { lanczos_3(a * a), lanczos_3(b * b), lanczos_3(c * c), lanczos_3(d * d), lanczos_3(e * e) };
    const real sum = ((w.first + w.last) + (w.w0 + w.w3)) + (w.w2 + lanczos_3(t * t));
    w.first = w.first / sum;
    w.w0 = w.w0 / sum;
    w.w2 = w.w2 / sum;
    w.w3 = w.w3 / sum;
    w.last = w.last / sum;
    return w;
}

STAGE weights history_weights(real t)
{
    const real zero = SPLAT(0.0);
    weights w = { zero, zero, t, zero, zero }; // bilinear
    if (HISTORY_FILTER == HISTORY_FILTER_NEAREST)
        w.w2 = t >= SPLAT(0.5) ? SPLAT(1.0) : zero;
    if (HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM || IN_PAIRS)
        return catmull_rom(t);
    if (HISTORY_FILTER == HISTORY_FILTER_LANCZOS_3)
        return lanczos(t);
    return w;
}

STAGE row_taps weigh(real first, real p0, real p1, real p2, real p3, real last, weights w)
{
    row_taps v = { p1 + w.w2 * (p2 - p1), SPLAT(0.0) };
    const real pair = v.middle;
    if (HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM)
        v.middle = ((p1 + w.w0 * (p1 - p0)) + w.w2 * (p2 - p1)) + w.w3 * (p3 - p2);
    if (HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM_9)
        v.middle = pair + (w.w0 * (p0 - pair) + w.w3 * (p3 - pair));
    if (HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM_5)
        v.sides = w.w0 * (p0 - pair) + w.w3 * (p3 - pair);
    if (HISTORY_FILTER == HISTORY_FILTER_LANCZOS_3) {
        const real inner = (w.w0 * (p0 - p1) + w.w2 * (p2 - p1)) + w.w3 * (p3 - p1);
        v.middle = p1 + (inner + (w.first * (first - p1) + w.last * (last - p1)));
    }
    return v;
}

// Five of the nine pairs of Catmull-Rom, without the four in the corners, and what is left made to sum to 1 (Jimenez
// 2016, Filmic SMAA): pair_x pair_y + (1 - pair_x) pair_y + pair_x (1 - pair_y).
STAGE real without_corners(row_taps r0, row_taps r1, row_taps r2, row_taps r3, weights wx, weights wy)
{
    const real one = SPLAT(1.0), pair_x = one - (wx.w0 + wx.w3), pair_y = one - (wy.w0 + wy.w3);
    const real centre = r1.middle + wy.w2 * (r2.middle - r1.middle), sides = r1.sides + wy.w2 * (r2.sides - r1.sides);
    const real ends = wy.w0 * (r0.middle - centre) + wy.w3 * (r3.middle - centre);
    return centre + (pair_y * sides + pair_x * ends) / (pair_y + pair_x * (one - pair_y));
}

// Rows weighed along y.
STAGE real weigh_rows(
    row_taps first, row_taps r0, row_taps r1, row_taps r2, row_taps r3, row_taps last, weights wx, weights wy)
{
    if (HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM_5)
        return without_corners(r0, r1, r2, r3, wx, wy);
    return weigh(first.middle, r0.middle, r1.middle, r2.middle, r3.middle, last.middle, wy).middle;
}
