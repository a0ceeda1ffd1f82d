// Moments of a 3x3, row by row: means, spreads and extremes of its rows, and of the three rows together.
#include "platform/real.h"

#if !defined(BOX) || !defined(NEIGHBOURHOOD) || !defined(VARIANCE)
#error "moments.h needs BOX, NEIGHBOURHOOD and VARIANCE from the prelude"
#endif

// Shifted first and second moments: mean = shift + offset, spread = sum of squared distances from the mean; 3/2 of it
// in a row of three and in the 3x3.
typedef struct
{
    real shift, offset, spread, low, high;
} moments;

// 3/2 of the spread of a, b and 0. Nothing cancels: it is (a^2 + b^2 + (a - b)^2) / 2, and never less than 0.
STAGE real spread_of_three(real a, real b) { return a * (a - b) + b * b; }

// Three texels of a row. The shift is the centre texel, so the differences are exact for neighbours within a factor of
// 2 (Sterbenz) and a flat row has exactly no spread, whatever its level.
STAGE moments row_moments(real left, real centre, real right)
{
    const real dl = left - centre, dr = right - centre;
    moments m;
    m.shift = centre;
    m.offset = (dl + dr) * K(ONE_THIRD);
    m.spread = spread_of_three(dl, dr);
    m.low = lesser(lesser(left, right), centre);
    m.high = greater(greater(left, right), centre);
    return m;
}

// A row with the one above it: by how much its mean is above that one's, and the sum of their spreads and the extremes
// of both. The step up is that down with the other sign, to the bit, so that a window that slides down works each of
// these out once a row.
typedef struct
{
    real step, spreads, low, high;
} joined;

STAGE joined joined_rows(moments above, moments row)
{
    const joined both = { (row.shift - above.shift) + (row.offset - above.offset), above.spread + row.spread,
        lesser(above.low, row.low), greater(above.high, row.high) };
    return both;
}

// Three rows of three (Chan, Golub and LeVeque 1983, pairwise update for equal counts): the spread of the whole is the
// spread inside the rows plus three times the spread of the row means about their mean. `upper` is the centre row with
// the one above it, `lower` the one below with the centre row.
STAGE moments window_moments(moments centre, moments below, joined upper, joined lower)
{
    const real da = -upper.step, db = lower.step;
    moments m;
    m.shift = centre.shift;
    m.offset = centre.offset + (da + db) * K(ONE_THIRD);
    m.spread = (upper.spreads + below.spread) + K(3.0) * spread_of_three(da, db);
    m.low = lesser(upper.low, below.low);
    m.high = greater(upper.high, below.high);
    return m;
}

// The cross: the centre row of three and the texels above and below. Five values, the same shifted form.
STAGE moments cross_moments(moments above, moments centre, moments below)
{
    const real du = above.shift - centre.shift, dd = below.shift - centre.shift;
    const real across = K(3.0) * centre.offset, sum = across + (du + dd);
    const real squares = (K(TWO_THIRDS) * centre.spread + across * centre.offset) + (du * du + dd * dd);
    moments m;
    m.shift = centre.shift;
    m.offset = sum * K(ONE_FIFTH);
    m.spread = squares - sum * m.offset;
    m.low = lesser(lesser(above.shift, below.shift), centre.low);
    m.high = greater(greater(above.shift, below.shift), centre.high);
    return m;
}

// The weighted 3x3: 1 2 1 along a row and down the rows, 16 in all. The middle's own difference is 0.
STAGE moments weighted_row(moments m, real left, real centre, real right)
{
    const real dl = left - centre, dr = right - centre, sum = dl + dr;
    m.offset = sum * K(0.25);
    m.spread = (dl * dl + dr * dr) - sum * m.offset;
    return m;
}

STAGE moments weighted_window(moments m, moments above, moments centre, moments below, real da, real db)
{
    const real sum = da + db, offset = sum * K(0.25);
    m.offset = centre.offset + offset;
    m.spread = ((above.spread + below.spread) + K(2.0) * centre.spread) + K(4.0) * ((da * da + db * db) - sum * offset);
    return m;
}

// The popular form of the variance, E[x^2] - E[x]^2, an option so that its failure can be seen: it cancels where the
// mean is large beside the deviation. Rows hold their sum as offset and their sum of squares as spread; the whole has
// its mean as shift, and its variance as spread.
#define MIDDLE (NEIGHBOURHOOD == NEIGHBOURHOOD_WEIGHTED ? 2 : 1)
#define SHARE                                                                                                          \
    (NEIGHBOURHOOD == NEIGHBOURHOOD_CROSS ? ONE_FIFTH : (NEIGHBOURHOOD == NEIGHBOURHOOD_WEIGHTED ? 0.0625 : ONE_NINTH))

STAGE moments naive_row(moments m, real left, real centre, real right)
{
    m.offset = (left + right) + K(MIDDLE) * centre;
    m.spread = (left * left + right * right) + K(MIDDLE) * (centre * centre);
    return m;
}

STAGE moments naive_window(moments m, moments above, moments centre, moments below)
{
    real sum = (above.offset + below.offset) + K(MIDDLE) * centre.offset;
    real squares = (above.spread + below.spread) + K(MIDDLE) * centre.spread;
    if (NEIGHBOURHOOD == NEIGHBOURHOOD_CROSS) {
        sum = centre.offset + (above.shift + below.shift);
        squares = centre.spread + (above.shift * above.shift + below.shift * below.shift);
    }
    m.shift = sum * K(SHARE);
    m.offset = SPLAT(0.0);
    m.spread = squares * K(SHARE) - m.shift * m.shift;
    return m;
}

// The moments of a row as the chosen neighbourhood and variance need them.
STAGE moments chosen_row(real left, real centre, real right)
{
    moments m = row_moments(left, centre, right);
    if (NEIGHBOURHOOD == NEIGHBOURHOOD_WEIGHTED)
        m = weighted_row(m, left, centre, right);
    return VARIANCE == VARIANCE_NAIVE ? naive_row(m, left, centre, right) : m;
}

STAGE real deviation_of(moments m)
{
    if ((VARIANCE != VARIANCE_NAIVE) & (NEIGHBOURHOOD == NEIGHBOURHOOD_SQUARE))
        return square_root(m.spread * K(TWO_27THS));
    const real variance = VARIANCE == VARIANCE_NAIVE ? m.spread : m.spread * K(SHARE);
    return square_root(greater(variance, SPLAT(0.0)));
}

STAGE moments neighbourhood_moments(moments above, moments centre, moments below, joined upper, joined lower)
{
    moments m = window_moments(centre, below, upper, lower);
    if (NEIGHBOURHOOD == NEIGHBOURHOOD_WEIGHTED)
        m = weighted_window(m, above, centre, below, -upper.step, lower.step);
    if (BOX == BOX_ROUNDED) {
        m.low = K(0.5) * (m.low + lesser(lesser(above.shift, below.shift), centre.low));
        m.high = K(0.5) * (m.high + greater(greater(above.shift, below.shift), centre.high));
    }
    if (NEIGHBOURHOOD == NEIGHBOURHOOD_CROSS)
        m = cross_moments(above, centre, below);
    return VARIANCE == VARIANCE_NAIVE ? naive_window(m, above, centre, below) : m;
}
