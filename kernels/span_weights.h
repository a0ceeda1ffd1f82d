// From the spans of a pixel's past to its colour: each weighed by its error around the pixel, and all but the shortest
// moved by what the shortest says of the light there.
#include "blend.h"
#include "image.h"

#if !defined(ALPHA) || !defined(SPANS) || !defined(SPAN_REACH)
#error "span_weights.h needs ALPHA, SPANS and SPAN_REACH from the prelude"
#endif

#define SPAN_PLANES (5 + ALPHA)
#define SPAN_TEXELS ((2 * SPAN_REACH + 1) * (2 * SPAN_REACH + 1))

STAGE plane_in span_plane(plane_in spans, int span, int plane, frame_t frame)
{
    return spans + ((size_t)span * SPAN_PLANES + (size_t)plane) * plane_size(frame);
}

STAGE real sum_around(plane_in p, frame_t frame)
{
    real sum = SPLAT(0.0);
    for (int j = -SPAN_REACH; j <= SPAN_REACH; ++j)
        for (int i = -SPAN_REACH; i <= SPAN_REACH; ++i)
            sum += load(p + j * (ptrdiff_t)row_stride(frame) + i);
    return sum;
}

// How much a span is believed beside that of the least error: a ratio of errors to the 16th, for as many recent samples
// as tell it (a likelihood goes with half their number).
STAGE real trust(real error, real least)
{
    const real ratio = greater(quotient(least + K(TINY), error + K(TINY)), SPLAT(LEAST_TRUST));
    const real second = ratio * ratio, fourth = second * second, eighth = fourth * fourth;
    return eighth * eighth;
}

// How far light has moved since a span, by the shortest one, in one channel: the mean difference around the pixel, and
// Student's t of it. The texels' deviation grows by change_floor of what they show, so that what nobody sees is
// nothing.
typedef struct
{
    real mean, t;
} drift_t;

STAGE drift_t drift_of(plane_in span, plane_in shortest, frame_t frame, settings_t settings)
{
    const real own = load(shortest) - load(span);
    real sum = SPLAT(0.0), squares = sum, level = sum;
    for (int j = -SPAN_REACH; j <= SPAN_REACH; ++j)
        for (int i = -SPAN_REACH; i <= SPAN_REACH; ++i) {
            const ptrdiff_t step = j * (ptrdiff_t)row_stride(frame) + i;
            const real v = load(span + step), d = (load(shortest + step) - v) - own;
            sum += d;
            squares += d * d;
            level += absolute(v);
        }
    const real texels = SPLAT(SPAN_TEXELS), offset = quotient(sum, texels);
    const real variance = quotient(greater(squares - sum * offset, SPLAT(0.0)), texels * (texels - K(1.0)));
    const real error = square_root(variance) + (K(settings.change_floor) * quotient(level, texels) + K(TINY));
    const drift_t drift = { own + offset, quotient(absolute(own + offset), error) };
    return drift;
}

// A span's colour, moved by as much of the drift as is not chance: 1 - (change_t / t)^2 (James and Stein).
STAGE colour caught_up(plane_in spans, int span, size_t plane, frame_t frame, settings_t settings)
{
    plane_in p = span_plane(spans, span, 0, frame);
    const colour v = { load(p), load(p + plane), load(p + 2 * plane) };
    const drift_t r = drift_of(p, spans, frame, settings), g = drift_of(p + plane, spans + plane, frame, settings),
                  b = drift_of(p + 2 * plane, spans + 2 * plane, frame, settings);
    const real t = greater(greater(r.t, greater(g.t, b.t)), SPLAT(settings.change_t));
    const real chance = quotient(SPLAT(settings.change_t), t), sure = SPLAT(1.0) - chance * chance;
    const colour moved = { v.r + sure * r.mean, v.g + sure * g.mean, v.b + sure * b.mean };
    return moved;
}
