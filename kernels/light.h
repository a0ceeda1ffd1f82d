// Light that changes where nothing moves. Nine samples of now are paired with what the history holds at their places:
// where light stands, the nine differences are the jitter's, of either sign; where it changes, they agree.
#include "neighbourhood.h"
#include "sampling.h"

#if !defined(EXPOSURE)
#error "light.h needs EXPOSURE from the prelude"
#endif

STAGE colour load_history_colour(history_in p, size_t plane)
{
    const colour v = { load_history(p), load_history(p + plane), load_history(p + 2 * plane) };
    return v;
}

// History as the current exposure would show it, in the range that everything is compared in.
STAGE colour history_in_range(colour v, frame_t frame)
{
    if (EXPOSURE) {
        v.r *= K(frame.exposure_ratio);
        v.g *= K(frame.exposure_ratio);
        v.b *= K(frame.exposure_ratio);
    }
    return to_range(v);
}

// The texels of the history nearest to the footprint: their whole displacement, a lane, and where the first lane's is.
typedef struct
{
    whole dx, dy;
    uint own, at;
    int alike; // whether the lanes' lie side by side
} nearest_t;

STAGE nearest_t nearest_texels(footprint f, int stride)
{
    nearest_t n;
    n.dx = f.dx + TO_WHOLE(floor_of(f.fx + K(0.5)));
    n.dy = f.dy + TO_WHOLE(floor_of(f.fy + K(0.5)));
    const scalar_whole x = first_lane(n.dx), y = first_lane(n.dy);
    n.own = f.own;
    n.at = f.own + (uint)((int)y * stride + (int)x);
    n.alike = LANES == 1 || !any_of((n.dx ^ x) | (n.dy ^ y));
    return n;
}

// One of them, or the texel i columns right of it and j rows below.
STAGE colour nearest_texel(history_in p, nearest_t n, int i, int j, size_t plane, int stride)
{
#if LANES > 1
    if (!n.alike) {
        const whole steps = steps_apart(n.dx, n.dy, stride);
        history_in q = p + n.own + i + j * (ptrdiff_t)stride;
        const colour v
            = { history_apart(q, steps), history_apart(q + plane, steps), history_apart(q + 2 * plane, steps) };
        return v;
    }
#endif
    return load_history_colour(ROW_BELOW(p, n.at, j, stride) + i, plane);
}

// The count at the nearest texel, whose sign says which way light went in the frame before.
STAGE real nearest_count(plane_in count, nearest_t n, int stride)
{
#if LANES > 1
    if (!n.alike)
        return texels_apart(count + n.own, steps_apart(n.dx, n.dy, stride));
#endif
    return load(count + n.at);
}

// Student's t of nine differences: their mean over its standard error, a third of their deviation; its sign is that of
// the mean. `least` is added to the deviation, so that a difference that nobody sees is none in a flat place either.
STAGE real paired_t(moments above, moments centre, moments below, real da, real db, real least)
{
    const moments m = window_moments(above, centre, below, da, db);
    return quotient(K(3.0) * (m.shift + m.offset), square_root(m.spread * K(TWO_27THS)) + least);
}

// What a row of three says: the moments of its differences, the steps of their means from the row above, and how bright
// its samples are in all.
typedef struct
{
    moments a, b, c;
    boxed step;
    real level;
} light_row;

// What a work-item of a GPU keeps while it slides down: the rows above and at the next pixel, and the texel of the
// history that is nearest to where it comes from if it moves as the one above.
typedef struct
{
    light_row above, centre;
    uint nearest;
} kept_light;

STAGE boxed light_difference(boxed now, colour past, frame_t frame)
{
    const boxed was = to_box_space(history_in_range(past, frame));
    return (boxed) { now.a - was.a, now.b - was.b, now.c - was.c };
}

// The row of `now`, j below that of the nearest texels.
STAGE light_row light_of_row(boxed_row now, history_in history, nearest_t n, int j, frame_t frame)
{
    const size_t plane = history_plane_size(frame);
    boxed d[3];
    for (int i = -1; i <= 1; ++i) {
        const colour past = nearest_texel(history, n, i, j, plane, row_stride(frame));
        d[i + 1] = light_difference(i < 0 ? now.left : (i > 0 ? now.right : now.own), past, frame);
    }
    light_row row;
    row.a = row_moments(d[0].a, d[1].a, d[2].a);
    row.b = row_moments(d[0].b, d[1].b, d[2].b);
    row.c = row_moments(d[0].c, d[1].c, d[2].c);
    row.step = (boxed) { SPLAT(0.0), SPLAT(0.0), SPLAT(0.0) };
    row.level = (absolute(now.left.a) + absolute(now.own.a)) + absolute(now.right.a);
    return row;
}

// A row below another.
STAGE light_row light_below(light_row above, light_row row)
{
    row.step = (boxed) { mean_step(above.a, row.a), mean_step(above.b, row.b), mean_step(above.c, row.c) };
    return row;
}

// What the history's count is divided by: t over change_t, of the channel that changed most; 1 up to there. Its sign is
// negative where the first channel, luminance, falls. The jitter moves all nine differences one way in one frame and
// another way in the next, light that changes goes on: what has not the sign of the frame before divides by 1. `next`
// is the row below the pixel's.
STAGE real change_of_light(plane_in current, boxed_row next, history_in history, plane_in count, footprint f, int x,
    int y, frame_t frame, settings_t settings, kept_light* kept)
{
    const nearest_t n = nearest_texels(f, row_stride(frame));
#if LANES == 1
    if (n.at != kept->nearest) {
        kept->above = light_of_row(read_boxed(current, x, y - 1, frame), history, n, -1, frame);
        kept->centre = light_below(kept->above, light_of_row(read_boxed(current, x, y, frame), history, n, 0, frame));
    }
    const light_row above = kept->above, centre = kept->centre;
#else
    const light_row above = light_of_row(read_boxed(current, x, y - 1, frame), history, n, -1, frame),
                    centre = light_below(above, light_of_row(read_boxed(current, x, y, frame), history, n, 0, frame));
#endif
    const light_row below = light_below(centre, light_of_row(next, history, n, 1, frame));
#if LANES == 1
    kept->above = centre;
    kept->centre = below;
    kept->nearest = n.at + (uint)row_stride(frame);
#endif
    const real level = (above.level + centre.level) + below.level;
    const real least = K(settings.change_floor) * (level * K(ONE_THIRD)) + K(TINY);
    const boxed up = centre.step, down = below.step; // the step to the row above is -up, to the bit
    const real ta = paired_t(above.a, centre.a, below.a, -up.a, down.a, least),
               tb = paired_t(above.b, centre.b, below.b, -up.b, down.b, least),
               tc = paired_t(above.c, centre.c, below.c, -up.c, down.c, least);
    const real t = greater(absolute(ta), greater(absolute(tb), absolute(tc)));
    const real sign = ta < SPLAT(0.0) ? SPLAT(-1.0) : SPLAT(1.0);
    const mask goes_on = sign * nearest_count(count, n, row_stride(frame)) > SPLAT(0.0);
    const real change = greater(quotient(t, SPLAT(settings.change_t)), SPLAT(1.0));
    return goes_on ? sign * change : sign;
}
