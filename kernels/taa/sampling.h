// Sampling: the filters that read the previous frame between its texels, and what they cost the sample count.
#include "platform/storage.h"

// The history filters: weights of the taps around a position. Taps 0 to 3 surround it, tap 1 is the texel at its
// integer position; a six-tap filter has one more tap before and one after them. Equal taps give exactly their value,
// and a fraction of 0 gives exactly tap 1: filters are applied to differences from a tap, and the cross is clamped.
//
// The cross reads six texels along each axis, through the four in the middle. It is the product of both axes' filters
// without the product of what each adds to a linear one: Lx Ly + Sx Ly + Lx Sy.
#define CROSS (HISTORY_FILTER == HISTORY_FILTER_CROSS_20)
// Taps 1 and 2 are read as one pair, as a texture unit would read them: w2 is then the position between the two.
#define FIVE_PAIRS                                                                                                     \
    (HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM_5 || HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM_5_RAW)

// Weights of all taps but tap 1, which has 1 minus their sum. For Catmull-Rom's 16 taps they are weights of the steps
// between taps instead: w0 from tap 0 to 1, w2 from tap 1 to 2, w3 from tap 2 to 3. For the cross they are what the six
// taps, tap 1 among them, add to a linear filter, and `linear` is tap 2's weight in that filter.
typedef struct
{
    real first, w0, w1, w2, w3, last, linear;
} weights;

// A filtered row. `middle` is the weighted mean of its taps, or with FIVE_PAIRS the pair of taps 1 and 2, and `sides`
// the share of taps 0 and 3. For the cross, `middle` and `right` are taps 1 and 2, and `sides` is what the six add to a
// linear filter between them.
typedef struct
{
    real middle, right, sides;
} row_taps;

// Catmull and Rom 1974, tension 1/2, at fraction t.
STAGE weights catmull_rom(real t)
{
    weights w;
    w.w3 = (t * t) * (K(-0.5) + K(0.5) * t);
    w.first = w.last = w.w1 = w.linear = SPLAT(0.0);
    if (!FIVE_PAIRS) {
        w.w0 = t * (K(0.5) - t * (K(1.0) - K(0.5) * t));
        w.w2 = t * (K(0.5) + t * (K(1.5) - t));
        return w;
    }
    w.w0 = t * (K(-0.5) + t * (K(1.0) - K(0.5) * t));
    w.w2 = t * (K(0.5) + t * (K(2.0) - K(1.5) * t));
    w.w2 = w.w2 / (SPLAT(1.0) - (w.w0 + w.w3));
    return w;
}

// Six taps of least squares: of all weights t (1 - t) (a + b t) that preserve ramps and parabolas, those whose response
// is nearest to a displacement by t at frequencies up to 0.3 cycles a texel (Laakso et al. 1996).
STAGE weights least_squares(real t)
{
    const real u = SPLAT(1.0) - t, both = t * u;
    weights w;
    w.first = both * (K(0.105) - K(0.0376) * t);
    w.last = both * (K(0.105) - K(0.0376) * u);
    w.w0 = both * (K(0.3342) * t - K(0.6758));
    w.w3 = both * (K(0.3342) * u - K(0.6758));
    w.w2 = ((w.first + w.first) + w.w0) - ((w.w3 + w.w3) + K(3.0) * w.last);
    w.w1 = -(((w.first + w.last) + (w.w0 + w.w3)) + w.w2);
    w.linear = t;
    return w;
}

STAGE weights history_weights(real t)
{
    const real zero = SPLAT(0.0);
    weights w = { zero, zero, zero, t, zero, zero, zero }; // bilinear
    if (HISTORY_FILTER == HISTORY_FILTER_NEAREST)
        w.w2 = t >= SPLAT(0.5) ? SPLAT(1.0) : zero;
    if (HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM || FIVE_PAIRS)
        return catmull_rom(t);
    if (CROSS)
        return least_squares(t);
    return w;
}

// What six taps add to a linear filter.
STAGE real six_taps(real first, real p0, real p1, real p2, real p3, real last, weights w)
{
    return ((((w.first * first + w.last * last) + w.w0 * p0) + w.w3 * p3) + w.w1 * p1) + w.w2 * p2;
}

STAGE row_taps filter_taps(real first, real p0, real p1, real p2, real p3, real last, weights w)
{
    if (CROSS)
        return (row_taps) { p1, p2, six_taps(first, p0, p1, p2, p3, last, w) };
    row_taps v = { p1 + w.w2 * (p2 - p1), SPLAT(0.0), SPLAT(0.0) };
    const real pair = v.middle;
    if (HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM)
        v.middle = ((p1 + w.w0 * (p1 - p0)) + w.w2 * (p2 - p1)) + w.w3 * (p3 - p2);
    if (FIVE_PAIRS)
        v.sides = w.w0 * (p0 - pair) + w.w3 * (p3 - pair);
    return v;
}

// Five of the nine pairs of Catmull-Rom, without the four corners. The weights sum to pair_x pair_y + (1 - pair_x)
// pair_y + pair_x (1 - pair_y), and are normalised to 1 (Jimenez 2016, Filmic SMAA) or left so (RAW).
STAGE real without_corners(row_taps r0, row_taps r1, row_taps r2, row_taps r3, weights wx, weights wy)
{
    const real one = SPLAT(1.0), pair_x = one - (wx.w0 + wx.w3), pair_y = one - (wy.w0 + wy.w3);
    const real centre = r1.middle + wy.w2 * (r2.middle - r1.middle), sides = r1.sides + wy.w2 * (r2.sides - r1.sides);
    const real ends = wy.w0 * (r0.middle - centre) + wy.w3 * (r3.middle - centre);
    const real sum = pair_y + pair_x * (one - pair_y), rest = pair_y * sides + pair_x * ends;
    return HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM_5_RAW ? sum * centre + rest : centre + rest / sum;
}

STAGE real lerp(real a, real b, real t) { return a + t * (b - a); }

// Sums both arms of the cross, clamped to the range of the four middle texels plus a quarter of it at either end: a
// sharp filter rings beside an edge, and a history accumulates the ringing. Below, at most a quarter of the darkest of
// the four is added: a quarter of the range beside a highlight leaves black.
STAGE real cross_of(
    row_taps first, row_taps r0, row_taps r1, row_taps r2, row_taps r3, row_taps last, weights wx, weights wy)
{
    const real left = lerp(r1.middle, r2.middle, wy.linear)
        + six_taps(first.middle, r0.middle, r1.middle, r2.middle, r3.middle, last.middle, wy);
    const real right = lerp(r1.right, r2.right, wy.linear)
        + six_taps(first.right, r0.right, r1.right, r2.right, r3.right, last.right, wy);
    const real low = lesser(lesser(r1.middle, r1.right), lesser(r2.middle, r2.right)),
               high = greater(greater(r1.middle, r1.right), greater(r2.middle, r2.right));
    const real range = high - low, along_x = lerp(r1.sides, r2.sides, wy.linear);
    return limit(
        lerp(left, right, wx.linear) + along_x, low - K(0.25) * lesser(range, absolute(low)), high + K(0.25) * range);
}

// Filters rows along y.
STAGE real filter_rows(
    row_taps first, row_taps r0, row_taps r1, row_taps r2, row_taps r3, row_taps last, weights wx, weights wy)
{
    if (CROSS)
        return cross_of(first, r0, r1, r2, r3, last, wx, wy);
    if (FIVE_PAIRS)
        return without_corners(r0, r1, r2, r3, wx, wy);
    return filter_taps(first.middle, r0.middle, r1.middle, r2.middle, r3.middle, last.middle, wy).middle;
}

// Upper limit of a history's sample count: sample_limit, and less the further the position lies from a texel, since
// resampling blurs (resampling_penalty).
STAGE real count_limit_of(real fx, real fy, settings_t settings)
{
    real least = reciprocal(SPLAT(settings.sample_limit));
    if (RESAMPLING_PENALTY)
        least += K(settings.resampling_penalty) * (fx * (SPLAT(1.0) - fx) + fy * (SPLAT(1.0) - fy));
    return reciprocal(least);
}
