// From the samples that lie in a pixel to its colour. What a supersampler gets by placing its samples evenly has to be
// made good here, since they lie wherever jitter and motion have put them.
#include "taa/reprojection.h"

#if !defined(GATHER_FIT) || !defined(CAMERA_MOTION)
#error "gather_fit.h needs GATHER_FIT and CAMERA_MOTION from the prelude"
#endif

// Sums over the samples of a pixel, of differences from the current one, so that equal samples leave it as it is, to
// the bit: along and down are weighted by the offset from the pixel's centre too. x to yy are sums of the weights times
// offsets and their products; near, near_x and near_y are those of the samples of the nearer of two surfaces.
typedef struct
{
    colour sum, along, down;
    real alpha, weight, count, x, y, xx, xy, yy, near, near_x, near_y;
    // Of the latest frames alone, whichever side their samples show; only where light may change. What does not count
    // of them, since it was drawn with another reactivity, is unlike.
    colour recent;
    real recent_squares, recent_count, unlike;
} gathered;

STAGE gathered no_samples(void)
{
    const real o = SPLAT(0.0);
    gathered g = { { o, o, o }, { o, o, o }, { o, o, o }, o, o, o, o, o, o, o, o, o, o, o, { o, o, o }, o, o, o };
    return g;
}

// A recent sample that differs by d from the current one, of which `counted` counts.
STAGE void add_recent(gathered* g, colour d, real counted)
{
    g->recent.r += counted * d.r;
    g->recent.g += counted * d.g;
    g->recent.b += counted * d.b;
    g->recent_squares += counted * ((d.r * d.r + d.g * d.g) + d.b * d.b);
    g->recent_count += counted;
}

// One sample that differs by d from the current one and lies at (dx, dy), in pixels from the centre. Of a sample of the
// farther surface only the place counts here.
STAGE void add_sample(gathered* g, colour d, real w, real dx, real dy, mask near)
{
    const real n = GATHER_FIT == GATHER_FIT_LAYERS ? (near ? w : SPLAT(0.0)) : w;
    g->sum.r += n * d.r;
    g->sum.g += n * d.g;
    g->sum.b += n * d.b;
    g->weight += w;
    if (GATHER_FIT != GATHER_FIT_MEAN) {
        const real wx = w * dx, wy = w * dy, nx = n * dx, ny = n * dy;
        g->x += wx;
        g->y += wy;
        g->xx += wx * dx;
        g->xy += wx * dy;
        g->yy += wy * dy;
        g->along.r += nx * d.r;
        g->along.g += nx * d.g;
        g->along.b += nx * d.b;
        g->down.r += ny * d.r;
        g->down.g += ny * d.g;
        g->down.b += ny * d.b;
        g->near += n;
        g->near_x += nx;
        g->near_y += ny;
    }
}

// The sums with the current sample alone, where it is `counted`. A mean of the others has its own place for it.
STAGE gathered first_sample(real w, mask counted, mask near, frame_t frame)
{
    gathered g = no_samples();
    const real o = SPLAT(0.0);
    const colour same = { o, o, o };
    if (GATHER_FIT != GATHER_FIT_MEAN)
        add_sample(&g, same, counted ? w : o, SPLAT(frame.jitter_x), SPLAT(frame.jitter_y), near);
    return g;
}

// Weighted least squares of the plane value = a + b dx + c dy, as what a takes of the sums: a = one * sum - x * along
// - y * down. The mean of unevenly placed samples errs by slope times mean offset; this does not. The slope is held
// back by fit_ridge samples' worth of evenly placed ones, so that few samples give nearly their mean.
typedef struct
{
    real one, x, y;
} fit_t;

STAGE fit_t fit_at_centre(gathered g, real samples, settings_t settings)
{
    const real mean = SPLAT(1.0) / g.weight, mx = g.x * mean, my = g.y * mean;
    const real ridge = K(settings.fit_ridge) * (g.weight / samples);
    const real xx = (g.xx - g.x * mx) + ridge, xy = g.xy - g.x * my, yy = (g.yy - g.y * my) + ridge;
    const real det = xx * yy - xy * xy;
    fit_t f;
    f.x = (yy * mx - xy * my) / det;
    f.y = (xx * my - xy * mx) / det;
    f.one = mean + (f.x * mx + f.y * my);
    return f;
}

STAGE real fitted(fit_t f, real sum, real along, real down) { return f.one * sum - (f.x * along + f.y * down); }

// How one pixel step here is seen in an earlier frame, less the step itself: the derivative of motion_from_depth on a
// plane whose inverse depth changes by (slope_x, slope_y) a pixel. Samples drawn from farther off cover several pixels
// of now, and lie that much farther apart.
typedef struct
{
    real xx, xy, yx, yy;
} stretch_t;

STAGE stretch_t stretch_of(surface s, real slope_x, real slope_y, motion_t m, real x, real y, frame_t then)
{
    const real zero = SPLAT(0.0);
    stretch_t t = { zero, zero, zero, zero };
    if (!CAMERA_MOTION)
        return t;
    const real px = (x + s.x) + K(then.origin_x), py = (y + s.y) + K(then.origin_y), q = s.inverse_depth;
    const real dw = ((K(then.wx) * px + K(then.wy) * py) + K(then.wq) * q) + K(then.w1);
    const real w = m.visible ? SPLAT(1.0) + dw : SPLAT(1.0);
    const real wx = K(then.wx) + K(then.wq) * slope_x, wy = K(then.wy) + K(then.wq) * slope_y;
    t.xx = ((K(then.xx) + K(then.xq) * slope_x) - dw - (px + m.u) * wx) / w;
    t.xy = ((K(then.xy) + K(then.xq) * slope_y) - (px + m.u) * wy) / w;
    t.yx = ((K(then.yx) + K(then.yq) * slope_x) - (py + m.v) * wx) / w;
    t.yy = ((K(then.yy) + K(then.yq) * slope_y) - dw - (py + m.v) * wy) / w;
    return t;
}

// Where the samples of an earlier frame lie, seen from now: the one nearest to the pixel's centre, and the steps from
// it to the next to the right (xx, yx) and below (xy, yy). `visible` false where the surface was seen edge on, or from
// behind.
typedef struct
{
    real x, y, xx, xy, yx, yy;
    mask visible;
} places_t;

STAGE places_t places_now(real dx, real dy, stretch_t t)
{
    const real one = SPLAT(1.0), xx = one + t.xx, yy = one + t.yy, det = xx * yy - t.xy * t.yx;
    places_t p;
    p.visible = det > SPLAT(LEAST_W);
    const real share = reciprocal(p.visible ? det : one);
    p.xx = yy * share, p.xy = -t.xy * share, p.yx = -t.yx * share, p.yy = xx * share;
    p.x = p.xx * dx + p.xy * dy;
    p.y = p.yx * dx + p.yy * dy;
    return p;
}

// Where the samples of n frames no longer count, from the pixel's centre along an axis. One of n samples stands for a
// square of 1 / n of the pixel, of whose side this is the border's distance; few reach as far as fit_reach.
STAGE real reach_of(int n, settings_t settings)
{
    const real side = reciprocal(square_root(SPLAT(n)));
    return lesser(SPLAT(settings.fit_reach), SPLAT(0.5) + side);
}

// What counts of a sample that lies `off` the centre along an axis: all in the middle, nothing from `reach` on, and
// half on the pixel's border. Of what a sample stands for there a part is another pixel's; of samples a pixel apart as
// much counts as of one, wherever they lie.
STAGE real window(real off, real reach)
{
    const real zero = SPLAT(0.0), one = SPLAT(1.0);
    return limit((reach - absolute(off)) * reciprocal((reach + reach) - one), zero, one);
}
