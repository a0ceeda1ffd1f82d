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

// The texel of the history nearest to the footprint, or one i columns right of it and j rows below.
STAGE colour nearest_texel(history_in p, footprint f, int i, int j, size_t plane, int stride)
{
    if (f.lanes == LANES_ON_TEXELS)
        return load_history_colour(p + (f.at + (uint)(j * stride + i)), plane);
    const whole dx = TO_WHOLE(floor_of(f.fx + K(0.5))) + i, dy = TO_WHOLE(floor_of(f.fy + K(0.5))) + j;
#if LANES > 1
    p += f.own;
    const colour v = { gather(p, f.dx + dx, f.dy + dy, stride), gather(p + plane, f.dx + dx, f.dy + dy, stride),
        gather(p + 2 * plane, f.dx + dx, f.dy + dy, stride) };
    return v;
#else
    return load_history_colour(p + (f.at + (uint)(dy * stride + dx)), plane);
#endif
}

// Student's t of nine differences: their mean over its standard error, a third of their deviation. `least` is added to
// the deviation, so that a difference that nobody sees is none in a flat place either.
STAGE real paired_t(moments above, moments centre, moments below, real least)
{
    const moments m = window_moments(above, centre, below);
    return quotient(K(3.0) * absolute(m.shift + m.offset), square_root(m.spread * K(TWO_27THS)) + least);
}

// What the history's count is divided by: t over change_t, of the channel that changed most; 1 up to there.
STAGE real change_of_light(
    plane_in current, history_in history, footprint f, int x, int y, frame_t frame, settings_t settings)
{
    moments a[3], b[3], c[3];
    real level = SPLAT(0.0);
    for (int j = -1; j <= 1; ++j) {
        boxed d[3];
        for (int i = -1; i <= 1; ++i) {
            const boxed now = to_box_space(usable_colour(current, plane_size(frame), x + i, y + j, frame));
            const colour texel = nearest_texel(history, f, i, j, history_plane_size(frame), row_stride(frame));
            const boxed past = to_box_space(history_in_range(texel, frame));
            d[i + 1] = (boxed) { now.a - past.a, now.b - past.b, now.c - past.c };
            level += absolute(now.a);
        }
        a[j + 1] = row_moments(d[0].a, d[1].a, d[2].a);
        b[j + 1] = row_moments(d[0].b, d[1].b, d[2].b);
        c[j + 1] = row_moments(d[0].c, d[1].c, d[2].c);
    }
    const real least = K(settings.change_floor) * (level * K(ONE_THIRD)) + K(TINY);
    const real chroma = greater(paired_t(b[0], b[1], b[2], least), paired_t(c[0], c[1], c[2], least));
    const real t = greater(paired_t(a[0], a[1], a[2], least), chroma);
    return greater(quotient(t, SPLAT(settings.change_t)), SPLAT(1.0));
}
