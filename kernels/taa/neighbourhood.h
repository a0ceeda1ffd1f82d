// The 3x3 neighbourhood, gathered row by row so that a window sliding down a column reads and converts each row once.
#include "taa/moments.h"
#include "taa/repair.h"

#if !defined(DILATION) || !defined(OWN_MOTION) || !defined(CURRENT_FILTER)
#error "neighbourhood.h needs DILATION, OWN_MOTION and CURRENT_FILTER from the prelude"
#endif

// Three texels of a row in the box space.
typedef struct
{
    boxed left, own, right;
} boxed_row;

// What one row contributes: moments a channel, and the nearest surface of the three texels. Inverse depth is 1/Z (-Z
// for an orthographic camera): the greater, the nearer.
typedef struct
{
    moments a, b, c;
    boxed_row texels;
    joined a_above, b_above, c_above; // with the row above
    colour centre;
    colour across, across_step; // the three texels weighed by the current filter along x; from those of the row above
    real nearest, nearest_x, farthest, inverse_depth;
    real rise; // of inverse depth from the left texel to the right one
    real u, v; // own motion of the nearest texel
    real centre_u, centre_v;
} row_t;

// Mean, standard deviation and extremes of the neighbourhood in the box space.
typedef struct
{
    boxed mean, deviation, low, high;
} statistics;

STAGE statistics neighbourhood_statistics(row_t above, row_t centre, row_t below)
{
    const moments a = neighbourhood_moments(above.a, centre.a, below.a, centre.a_above, below.a_above);
    const moments b = neighbourhood_moments(above.b, centre.b, below.b, centre.b_above, below.b_above);
    const moments c = neighbourhood_moments(above.c, centre.c, below.c, centre.c_above, below.c_above);
    statistics s;
    s.mean = (boxed) { a.shift + a.offset, b.shift + b.offset, c.shift + c.offset };
    s.deviation = (boxed) { deviation_of(a), deviation_of(b), deviation_of(c) };
    s.low = (boxed) { a.low, b.low, c.low };
    s.high = (boxed) { a.high, b.high, c.high };
    return s;
}

// Inverse depth outside the domain (no depth, infinite) is the sky's.
STAGE real inverse_depth_or_sky(real v, frame_t frame) { return in_domain_or(v, SPLAT(frame.sky_inverse_depth)); }

STAGE colour colour_step(colour from, colour to) { return (colour) { to.r - from.r, to.g - from.g, to.b - from.b }; }

// Three colours weighed as the middle one plus the weighted steps to it and from it: equal colours keep their bits.
STAGE colour weigh_line(colour to, colour middle, colour from, scalar first, scalar last)
{
    colour v = middle;
    if (CURRENT_FILTER != CURRENT_FILTER_NONE) {
        v.r = middle.r + (last * from.r - first * to.r);
        v.g = middle.g + (last * from.g - first * to.g);
        v.b = middle.b + (last * from.b - first * to.b);
    }
    return v;
}

STAGE row_t read_row(plane_in image, plane_in inverse_depth, plane_in motion, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame);
    const uint at = texel_offset(frame, x, y);
    plane_in reds = image + at, greens = image + plane + at, blues = image + 2 * plane + at, z = inverse_depth + at;
    colour l = { load(reds - 1), load(greens - 1), load(blues - 1) }, c = { load(reds), load(greens), load(blues) },
           r = { load(reds + 1), load(greens + 1), load(blues + 1) };
    // Asked for before the branch below, past which a GPU's compiler moves no load.
    const real zl = inverse_depth_or_sky(load(z - 1), frame), zc = inverse_depth_or_sky(load(z), frame),
               zr = inverse_depth_or_sky(load(z + 1), frame);
    if (any_outside_domain(l, c, r)) {
        colour line[3];
        repair_colours(line, 3, image, plane, x - 1, y, frame);
        l = line[0], c = line[1], r = line[2];
    }
    l = to_range(l), c = to_range(c), r = to_range(r);
    const boxed bl = to_box_space(l), bc = to_box_space(c), br = to_box_space(r);
    row_t row = { 0 };
    row.a = chosen_row(bl.a, bc.a, br.a);
    row.b = chosen_row(bl.b, bc.b, br.b);
    row.c = chosen_row(bl.c, bc.c, br.c);
    row.texels = (boxed_row) { bl, bc, br };
    row.centre = c;
    row.across = weigh_line(colour_step(l, c), c, colour_step(c, r), K(frame.left_weight), K(frame.right_weight));

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
STAGE boxed_row read_boxed(plane_in image, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame);
    plane_in p = image + texel_offset(frame, x, y);
    colour l = load_colour(p - 1, plane), c = load_colour(p, plane), r = load_colour(p + 1, plane);
    if (any_outside_domain(l, c, r)) {
        colour line[3];
        repair_colours(line, 3, image, plane, x - 1, y, frame);
        l = line[0], c = line[1], r = line[2];
    }
    return (boxed_row) { to_box_space(to_range(l)), to_box_space(to_range(c)), to_box_space(to_range(r)) };
}

// The row at (x, y), below the one that is given.
STAGE row_t read_next_row(
    row_t above, plane_in image, plane_in inverse_depth, plane_in motion, int x, int y, frame_t frame)
{
    row_t row = read_row(image, inverse_depth, motion, x, y, frame);
    row.a_above = joined_rows(above.a, row.a);
    row.b_above = joined_rows(above.b, row.b);
    row.c_above = joined_rows(above.c, row.c);
    row.across_step = colour_step(above.across, row.across);
    return row;
}

// The surface whose motion a pixel follows: where it lies relative to the pixel, how close it is, and its own motion.
typedef struct
{
    real x, y, inverse_depth, u, v;
    real centre, nearest, farthest; // inverse depth: of the pixel itself, and the range in its 3x3
} surface;

STAGE surface nearest_surface(row_t above, row_t centre, row_t below, settings_t settings)
{
    const real nearer = greater(above.nearest, centre.nearest);
    surface s = { SPLAT(0.0), SPLAT(0.0), centre.inverse_depth, centre.centre_u, centre.centre_v, centre.inverse_depth,
        greater(below.nearest, nearer), lesser(lesser(above.farthest, below.farthest), centre.farthest) };
    if (DILATION == DILATION_NONE)
        return s;
    const mask up = above.nearest > centre.nearest;
    const mask down = below.nearest > nearer;
    mask across = (mask)(-1);
    if (DILATION == DILATION_EDGE) {
        // Inverse depth is linear in the pixel coordinates on every plane, so there the window is symmetric about its
        // centre: nearest + farthest = 2 centre. Only where it is not does an edge pass through, and only there is the
        // motion of the nearer side borrowed; on a smooth receding surface it would be wrong by the slope.
        const real skew = (s.nearest - s.centre) - (s.centre - s.farthest);
        across = absolute(skew) > K(settings.edge_tolerance) * absolute(s.nearest);
    }
#if LANES > 1
    // Mostly there is none in a whole segment. Not on a GPU, whose work-items would wait for the one that has an edge.
    if (!any_of(across))
        return s;
#endif
    s.inverse_depth = across ? s.nearest : s.inverse_depth;
    s.x = across ? (down ? below.nearest_x : (up ? above.nearest_x : centre.nearest_x)) : s.x;
    s.y = across ? (down ? SPLAT(1.0) : (up ? SPLAT(-1.0) : SPLAT(0.0))) : s.y;
    s.u = across ? (down ? below.u : (up ? above.u : centre.u)) : s.u;
    s.v = across ? (down ? below.v : (up ? above.v : centre.v)) : s.v;
    return s;
}

// The current sample: the pixel's own, or the one that the current filter rebuilds at the pixel's centre from the 3x3.
// A filter with negative lobes is held inside the extremes.
STAGE colour current_sample(row_t above, row_t centre, row_t below, statistics near, frame_t frame)
{
    if (CURRENT_FILTER == CURRENT_FILTER_NONE)
        return centre.centre;
    colour v = weigh_line(
        centre.across_step, centre.across, below.across_step, K(frame.above_weight), K(frame.below_weight));
    if (CURRENT_FILTER == CURRENT_FILTER_LANCZOS) {
        const boxed b = to_box_space(v);
        const boxed over = { limit(b.a, near.low.a, near.high.a) - b.a, limit(b.b, near.low.b, near.high.b) - b.b,
            limit(b.c, near.low.c, near.high.c) - b.c };
        const colour change = from_box_space(over);
        v.r += change.r, v.g += change.g, v.b += change.b;
    }
    return v;
}
