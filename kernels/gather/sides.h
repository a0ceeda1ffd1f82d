// The two surfaces of a pixel that a depth edge runs through: a nearer and a farther side.
#include "taa/neighbourhood.h"

// Where an edge runs, and the slope of inverse depth on the followed surface.
typedef struct
{
    mask edge;
    real cut; // inverse depth that separates the nearer from the farther side
    real slope_x, slope_y; // of inverse depth, a pixel
} layers_t;

// At an edge the slope would be that from one surface to the other: side_of fits one for each side.
STAGE layers_t layers_of(row_t above, row_t centre, row_t below, surface s, settings_t settings)
{
    layers_t l;
    const real zero = SPLAT(0.0);
    l.edge = has_edge(s, settings);
    l.cut = K(0.5) * (s.nearest + s.farthest);
    l.slope_x = l.edge ? zero : K(0.5) * centre.rise;
    l.slope_y = l.edge ? zero : K(0.5) * (below.inverse_depth - above.inverse_depth);
    return l;
}

// One side of the edge: the surface at its sample nearest to the pixel, the slope of inverse depth there, and the mean
// colour of its `count` samples in the 3x3.
typedef struct
{
    surface s;
    layers_t l;
    colour mean;
    real count;
} side_t;

STAGE mask on_side(real inverse_depth, layers_t l, int far)
{
    return l.edge & (far ? inverse_depth <= l.cut : inverse_depth > l.cut);
}

// The surface at the side's sample nearest to the pixel. Of equally near ones the pixel's own row wins: floors, the
// most slanted of surfaces, change from row to row.
STAGE surface side_surface(
    surface s, layers_t l, int far, plane_in inverse_depth, plane_in motion, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame), at = texel_offset(frame, x, y);
    real least = SPLAT(DOMAIN_LIMIT);
    for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
            const ptrdiff_t step = (ptrdiff_t)at + dy * (ptrdiff_t)row_stride(frame) + dx;
            const real q = inverse_depth_or_sky(load(inverse_depth + step), frame),
                       away = SPLAT(2 * dx * dx + 3 * dy * dy);
            const mask here = on_side(q, l, far) & (away < least);
            least = here ? away : least;
            s.x = here ? SPLAT(dx) : s.x;
            s.y = here ? SPLAT(dy) : s.y;
            s.inverse_depth = here ? q : s.inverse_depth;
            if (OWN_MOTION) {
                s.u = here ? load(motion + step) : s.u;
                s.v = here ? load(motion + plane + step) : s.v;
            }
        }
    return s;
}

// Returns one side of each pixel that an edge runs through; elsewhere `s` and `l` unchanged. The slope is fitted by
// least squares to the side's samples, through the nearest one, and damped by fit_ridge as that of a gathered pixel.
// The mean sums differences from the pixel's `own` colour, so that equal samples have that mean, to the bit.
STAGE side_t side_of(surface s, layers_t l, int far, colour own, plane_in image, plane_in alpha, plane_in inverse_depth,
    plane_in motion, int x, int y, frame_t frame, settings_t settings)
{
    const size_t plane = plane_size(frame), at = texel_offset(frame, x, y);
    const real zero = SPLAT(0.0), one = SPLAT(1.0);
    const colour none = { 0 };
    side_t side = { side_surface(s, l, far, inverse_depth, motion, x, y, frame), l, none, zero };
    real xx = SPLAT(settings.fit_ridge), xy = zero, yy = xx, qx = zero, qy = zero;
    for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
            const ptrdiff_t step = (ptrdiff_t)at + dy * (ptrdiff_t)row_stride(frame) + dx;
            const real q = inverse_depth_or_sky(load(inverse_depth + step), frame);
            const mask here = on_side(q, l, far);
            const real rise = here ? q - side.s.inverse_depth : zero;
            const real ox = here ? SPLAT(dx) - side.s.x : zero, oy = here ? SPLAT(dy) - side.s.y : zero;
            xx += ox * ox, xy += ox * oy, yy += oy * oy;
            qx += ox * rise, qy += oy * rise;
            const texel_t c = load_texel(image + step, alpha + step, plane);
            const mask in_domain = here & !outside_domain_of(c);
            side.mean = plus(side.mean, choose_colour(in_domain, minus(to_range(c.rgb), own), none));
            side.count += in_domain ? one : zero;
        }
    const real det = xx * yy - xy * xy, among = side.count > zero ? side.count : one;
    side.l.slope_x = l.edge ? (yy * qx - xy * qy) / det : l.slope_x;
    side.l.slope_y = l.edge ? (xx * qy - xy * qx) / det : l.slope_y;
    side.mean = plus(own, (colour) { side.mean.r / among, side.mean.g / among, side.mean.b / among });
    return side;
}

// Narrows the surface's range of inverse depth to its own side.
STAGE surface range_of_side(surface s, layers_t l, int far)
{
    s.nearest = far ? (l.edge ? l.cut : s.nearest) : s.nearest;
    s.farthest = far ? s.farthest : (l.edge ? l.cut : s.farthest);
    return s;
}
