// The 3x3 neighbourhood, gathered row by row so that a window sliding down a column reads and converts each row once.
#include "taa/colour.h"

// Shifted first and second moments of a row of three or of the 3x3: mean = shift + offset, and spread is 3/2 of the sum
// of squared distances from the mean, which saves a factor a row.
typedef struct
{
    real shift, offset, spread, low, high;
} moments;

// The spread of a, b and 0. Nothing cancels: it is (a^2 + b^2 + (a - b)^2) / 2, and never less than 0.
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

// A row joined with the one above: the step from that row's mean to this one's, the sum of their spreads, and the
// extremes of both. The step up is minus the step down, to the bit, so a window that slides down computes each once a
// row.
typedef struct
{
    real step, spreads, low, high;
} joined;

STAGE joined joined_rows(moments above, moments row)
{
    return (joined) { (row.shift - above.shift) + (row.offset - above.offset), above.spread + row.spread,
        lesser(above.low, row.low), greater(above.high, row.high) };
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

// The popular form of the variance, E[x^2] - E[x]^2, an option so that its failure can be seen: it cancels where the
// mean is large beside the deviation. Rows hold their sum as offset and their sum of squares as spread; the whole has
// its mean as shift, and its variance as spread.
STAGE moments naive_row(moments m, real left, real centre, real right)
{
    m.offset = (left + right) + centre;
    m.spread = (left * left + right * right) + centre * centre;
    return m;
}

STAGE moments naive_window(moments m, moments above, moments centre, moments below)
{
    const real sum = (above.offset + below.offset) + centre.offset;
    const real squares = (above.spread + below.spread) + centre.spread;
    m.shift = sum * K(ONE_NINTH);
    m.offset = SPLAT(0.0);
    m.spread = squares * K(ONE_NINTH) - m.shift * m.shift;
    return m;
}

// Moments of a row, in the form that the chosen variance needs.
STAGE moments chosen_row(real left, real centre, real right)
{
    const moments m = row_moments(left, centre, right);
    return VARIANCE == VARIANCE_NAIVE ? naive_row(m, left, centre, right) : m;
}

STAGE real deviation_of(moments m)
{
    return square_root(VARIANCE == VARIANCE_NAIVE ? greater(m.spread, SPLAT(0.0)) : m.spread * K(TWO_27THS));
}

STAGE moments neighbourhood_moments(moments above, moments centre, moments below, joined upper, joined lower)
{
    moments m = window_moments(centre, below, upper, lower);
    if (BOX == BOX_ROUNDED) { // halfway to the extremes of the five texels without the corners (Pedersen 2016)
        m.low = K(0.5) * (m.low + lesser(lesser(above.shift, below.shift), centre.low));
        m.high = K(0.5) * (m.high + greater(greater(above.shift, below.shift), centre.high));
    }
    return VARIANCE == VARIANCE_NAIVE ? naive_window(m, above, centre, below) : m;
}

// Three texels of a row in the box space, with their alpha where there is one.
typedef struct
{
    boxed left, own, right;
    real alpha[3];
} boxed_row;

// One row of the 3x3: moments of each channel, and the nearest surface of the three texels. Inverse depth is 1/Z (-Z
// for an orthographic camera): the greater, the nearer.
typedef struct
{
    moments a, b, c;
    boxed_row texels;
    joined a_above, b_above, c_above; // with the row above
    colour centre;
    colour across, across_step; // the three texels filtered along x by the current filter; its step from the row above
    real nearest, nearest_x, farthest, inverse_depth;
    real rise; // of inverse depth, from the left texel to the right one
    real u, v; // own motion of the nearest texel
    real centre_u, centre_v;
    int has_missing; // of three_texels
} row_t;

// Mean, standard deviation and extremes of the neighbourhood in the box space.
typedef struct
{
    boxed mean, deviation, low, high;
} statistics;

// Luminance weight of a texel, 1 / (1 + Y), so that one firefly hardly widens the box of its neighbours (Karis 2014).
STAGE real texel_weight(boxed v)
{
    const real y = BOX_SPACE == BOX_SPACE_YCOCG ? K(0.25) * v.a : luminance((colour) { v.a, v.b, v.c });
    return SPLAT(1.0) / (SPLAT(1.0) + greater(y, SPLAT(0.0)));
}

// Weighted mean and deviation of a channel of nine texels, by squared distances from the mean.
STAGE void weighted_channel(real* mean, real* deviation, const real* v, const real* w, real total)
{
    real sum = SPLAT(0.0), spread = SPLAT(0.0);
    for (int k = 0; k < 9; ++k)
        sum += w[k] * (v[k] - v[4]);
    *mean = v[4] + sum / total;
    for (int k = 0; k < 9; ++k)
        spread += w[k] * ((v[k] - *mean) * (v[k] - *mean));
    *deviation = square_root(spread / total);
}

// Replaces mean and deviation by weighted ones: by luminance, or by the distance of samples from the pixel's centre.
STAGE void weighted_statistics(statistics* s, boxed_row above, boxed_row centre, boxed_row below, frame_t frame)
{
    const boxed texels[9] = { above.left, above.own, above.right, centre.left, centre.own, centre.right, below.left,
        below.own, below.right };
    const scalar columns[3] = { K(frame.box_left), K(1.0), K(frame.box_right) };
    const scalar rows[3] = { K(frame.box_above), K(1.0), K(frame.box_below) };
    real a[9], b[9], c[9], w[9], total = SPLAT(0.0);
    for (int k = 0; k < 9; ++k) {
        a[k] = texels[k].a, b[k] = texels[k].b, c[k] = texels[k].c;
        w[k] = NEIGHBOURHOOD == NEIGHBOURHOOD_LUMINANCE ? texel_weight(texels[k]) : SPLAT(columns[k % 3] * rows[k / 3]);
        total += w[k];
    }
    weighted_channel(&s->mean.a, &s->deviation.a, a, w, total);
    weighted_channel(&s->mean.b, &s->deviation.b, b, w, total);
    weighted_channel(&s->mean.c, &s->deviation.c, c, w, total);
}

STAGE statistics neighbourhood_statistics(row_t above, row_t centre, row_t below, frame_t frame)
{
    const moments a = neighbourhood_moments(above.a, centre.a, below.a, centre.a_above, below.a_above);
    const moments b = neighbourhood_moments(above.b, centre.b, below.b, centre.b_above, below.b_above);
    const moments c = neighbourhood_moments(above.c, centre.c, below.c, centre.c_above, below.c_above);
    statistics s;
    s.mean = (boxed) { a.shift + a.offset, b.shift + b.offset, c.shift + c.offset };
    s.deviation = (boxed) { deviation_of(a), deviation_of(b), deviation_of(c) };
    s.low = (boxed) { a.low, b.low, c.low };
    s.high = (boxed) { a.high, b.high, c.high };
    if ((NEIGHBOURHOOD == NEIGHBOURHOOD_LUMINANCE) | (NEIGHBOURHOOD == NEIGHBOURHOOD_JITTERED)) {
        weighted_statistics(&s, above.texels, centre.texels, below.texels, frame);
        // Rounding may move a weighted mean beyond the extremes, and turn a box inside out.
        s.mean = (boxed) { limit(s.mean.a, s.low.a, s.high.a), limit(s.mean.b, s.low.b, s.high.b),
            limit(s.mean.c, s.low.c, s.high.c) };
    }
    return s;
}

// Replaces inverse depth outside the domain (no depth, infinite) by the sky's.
STAGE real inverse_depth_or_sky(real v, frame_t frame) { return in_domain_or(v, SPLAT(frame.sky_inverse_depth)); }

// Weights three colours as the middle one plus the weighted steps to it and from it: equal colours keep their bits.
STAGE colour filter_three(colour to, colour middle, colour from, scalar first, scalar last)
{
    colour v = middle;
    if (CURRENT_FILTER != CURRENT_FILTER_NONE) {
        v.r = middle.r + (last * from.r - first * to.r);
        v.g = middle.g + (last * from.g - first * to.g);
        v.b = middle.b + (last * from.b - first * to.b);
    }
    return v;
}

// Three texels of a row, repaired and tonemapped to the range of comparison.
typedef struct
{
    texel_t left, own, right;
    int has_missing; // 1: an own texel was outside the domain, or with RECTIFIES_ALPHA one beside it
} three_texels;

STAGE texel_t in_range(texel_t v)
{
    return (texel_t) { to_range(v.rgb), ALPHA ? limit(v.alpha, SPLAT(0.0), SPLAT(1.0)) : v.alpha };
}

STAGE three_texels read_texels(plane_in image, plane_in alpha, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame);
    const uint at = texel_offset(frame, x, y);
    plane_in p = image + at, a = alpha + at;
    texel_t l = load_texel(p - 1, a - 1, plane), c = load_texel(p, a, plane), r = load_texel(p + 1, a + 1, plane);
    int has_missing = 0;
    if (any_outside_domain(l, c, r)) {
        has_missing = RECTIFIES_ALPHA | (any_of(outside_domain_of(c)) ? 1 : 0);
        texel_t line[3];
        repair_texels(line, 3, image, alpha, plane, x - 1, y, frame);
        l = line[0], c = line[1], r = line[2];
    }
    return (three_texels) { in_range(l), in_range(c), in_range(r), has_missing };
}

STAGE boxed_row to_boxed_row(three_texels t)
{
    return (boxed_row) { to_box_space(t.left.rgb), to_box_space(t.own.rgb), to_box_space(t.right.rgb),
        { t.left.alpha, t.own.alpha, t.right.alpha } };
}

STAGE row_t read_row(
    plane_in image, plane_in alpha, plane_in inverse_depth, plane_in motion, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame);
    const uint at = texel_offset(frame, x, y);
    plane_in z = inverse_depth + at;
    // Loaded before the branch in read_texels: a GPU's compiler moves no load past it.
    const real zl = inverse_depth_or_sky(load(z - 1), frame), zc = inverse_depth_or_sky(load(z), frame),
               zr = inverse_depth_or_sky(load(z + 1), frame);
    const three_texels t = read_texels(image, alpha, x, y, frame);
    const colour l = t.left.rgb, c = t.own.rgb, r = t.right.rgb;
    row_t row = { 0 };
    row.has_missing = t.has_missing;
    row.texels = to_boxed_row(t);
    const boxed bl = row.texels.left, bc = row.texels.own, br = row.texels.right;
    row.a = chosen_row(bl.a, bc.a, br.a);
    row.b = chosen_row(bl.b, bc.b, br.b);
    row.c = chosen_row(bl.c, bc.c, br.c);
    row.centre = c;
    row.across = filter_three(minus(c, l), c, minus(r, c), K(frame.left_weight), K(frame.right_weight));

    const mask left = zl > zc;
    row.inverse_depth = zc;
    row.rise = zr - zl;
    row.nearest = greater(zl, zc);
    row.nearest_x = left ? SPLAT(-1.0) : SPLAT(0.0);
    const mask right = zr > row.nearest;
    row.nearest = greater(zr, row.nearest);
    row.nearest_x = right ? SPLAT(1.0) : row.nearest_x;
    row.farthest = lesser(lesser(zl, zr), zc);
    row.u = row.v = row.centre_u = row.centre_v = SPLAT(0.0);
    if (OWN_MOTION) {
        plane_in m = motion + at;
        row.centre_u = load(m);
        row.centre_v = load(m + plane);
        row.u = right ? load(m + 1) : (left ? load(m - 1) : row.centre_u);
        row.v = right ? load(m + plane + 1) : (left ? load(m + plane - 1) : row.centre_v);
    }
    return row;
}

// Three texels of a row of the current frame, in the box space.
STAGE boxed_row read_boxed(plane_in image, plane_in alpha, int x, int y, frame_t frame)
{
    return to_boxed_row(read_texels(image, alpha, x, y, frame));
}

// Reads the row at (x, y) and joins it to the one above.
STAGE row_t read_next_row(
    row_t above, plane_in image, plane_in alpha, plane_in inverse_depth, plane_in motion, int x, int y, frame_t frame)
{
    row_t row = read_row(image, alpha, inverse_depth, motion, x, y, frame);
    row.a_above = joined_rows(above.a, row.a);
    row.b_above = joined_rows(above.b, row.b);
    row.c_above = joined_rows(above.c, row.c);
    row.across_step = minus(row.across, above.across);
    return row;
}

// The surface whose motion a pixel follows: its offset from the pixel, its inverse depth, and its own motion.
typedef struct
{
    real x, y, inverse_depth, u, v;
    real centre, nearest, farthest; // inverse depth: of the pixel itself, and the range in its 3x3
} surface;

// 1 if dilation may borrow the motion of a texel beyond the 3x3 (dilation.h).
#define BORROWS_BEYOND ((DILATION == DILATION_CORNERS) | (DILATION == DILATION_BESIDE))

// True where a depth edge runs through the 3x3. Inverse depth is linear in the pixel coordinates on every plane, so on
// a plane the window is symmetric about its centre: nearest + farthest = 2 centre.
STAGE mask has_edge(surface s, settings_t settings)
{
    const real skew = (s.nearest - s.centre) - (s.centre - s.farthest);
    return absolute(skew) > K(settings.edge_tolerance) * absolute(s.nearest);
}

STAGE surface nearest_surface(row_t above, row_t centre, row_t below, settings_t settings)
{
    const real nearer = greater(above.nearest, centre.nearest);
    surface s = { SPLAT(0.0), SPLAT(0.0), centre.inverse_depth, centre.centre_u, centre.centre_v, centre.inverse_depth,
        greater(below.nearest, nearer), lesser(lesser(above.farthest, below.farthest), centre.farthest) };
    if ((DILATION == DILATION_NONE) | BORROWS_BEYOND)
        return s;
    const mask up = above.nearest > centre.nearest;
    const mask down = below.nearest > nearer;
    // On a smooth receding surface a borrowed motion would be wrong by the slope.
    const mask across = DILATION == DILATION_EDGE ? has_edge(s, settings) : (mask)(-1);
    s.inverse_depth = across ? s.nearest : s.inverse_depth;
    s.x = across ? (down ? below.nearest_x : (up ? above.nearest_x : centre.nearest_x)) : s.x;
    s.y = across ? (down ? SPLAT(1.0) : (up ? SPLAT(-1.0) : SPLAT(0.0))) : s.y;
    s.u = across ? (down ? below.u : (up ? above.u : centre.u)) : s.u;
    s.v = across ? (down ? below.v : (up ? above.v : centre.v)) : s.v;
    return s;
}

// The current sample: the pixel's own, or the one that the current filter reconstructs at the pixel's centre from the
// 3x3. A filter with negative lobes is clamped to the extremes.
STAGE colour current_sample(row_t above, row_t centre, row_t below, statistics near, frame_t frame)
{
    if (CURRENT_FILTER == CURRENT_FILTER_NONE)
        return centre.centre;
    colour v = filter_three(
        centre.across_step, centre.across, below.across_step, K(frame.above_weight), K(frame.below_weight));
    if (CURRENT_FILTER == CURRENT_FILTER_LANCZOS) {
        const boxed b = to_box_space(v);
        const boxed over = { limit(b.a, near.low.a, near.high.a) - b.a, limit(b.b, near.low.b, near.high.b) - b.b,
            limit(b.c, near.low.c, near.high.c) - b.c };
        v = plus(v, from_box_space(over));
    }
    return v;
}
