// From the spans of a pixel's past to its colour: each weighed by its error around the pixel, and moved by what the
// latest samples say of the light there.
#include "taa/blend.h"
#include "platform/image.h"

#if !defined(ALPHA) || !defined(SPANS) || !defined(SPAN_REACH) || !defined(SHORT_SPAN) || !defined(SHARED_NOISE)
#error "span_weights.h needs ALPHA, SPANS, SPAN_REACH, SHORT_SPAN and SHARED_NOISE from the prelude"
#endif

#define SPAN_PLANES (5 + ALPHA)
#define UNMOVED (SPANS - 1)
#define SPAN_TEXELS ((2 * SPAN_REACH + 1) * (2 * SPAN_REACH + 1))

STAGE plane_in span_plane(plane_in spans, int span, int plane, frame_t frame)
{
    return spans + ((size_t)span * SPAN_PLANES + (size_t)plane) * plane_size(frame);
}

// From a texel to the k-th of those around it, row by row.
STAGE ptrdiff_t span_step(int k, frame_t frame)
{
    const int side = 2 * SPAN_REACH + 1;
    return (k / side - SPAN_REACH) * (ptrdiff_t)row_stride(frame) + (k % side - SPAN_REACH);
}

STAGE real sum_around(plane_in p, frame_t frame)
{
    real sum = SPLAT(0.0);
    for (int k = 0; k < SPAN_TEXELS; ++k)
        sum += load(p + span_step(k, frame));
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

// How much of a drift to spans that leave `error` is left to the span without motion: nothing where samples of the same
// places differ by far less than those spans err.
STAGE real unsettled(real repeated, real error)
{
    const real ratio = quotient(lesser(K(SURELY_STANDS) * repeated, error) + K(TINY), error + K(TINY));
    const real second = ratio * ratio;
    return second * second;
}

// How far light has moved since a span in one channel, around the pixel: the mean difference, the variance of that mean
// and what the texels show.
typedef struct
{
    real mean, variance, level;
} drift_t;

typedef struct
{
    drift_t r, g, b;
} drifts;

// What lies `share` of the way from the shortest span to the middle one.
STAGE real between_spans(plane_in shortest, plane_in middle, real share)
{
    const real first = load(shortest);
    return first + share * (load(middle) - first);
}

// How much each texel around counts for a drift: as its light does in a mean of samples, then and now. A highlight that
// comes or goes is no change of the light around it.
STAGE void weigh_texels(
    real* weights, plane_in span, plane_in shortest, plane_in middle, real share, frame_t frame, settings_t settings)
{
    const size_t plane = plane_size(frame);
    for (int k = 0; k < SPAN_TEXELS; ++k) {
        const ptrdiff_t step = span_step(k, frame);
        const colour now = { between_spans(shortest + step, middle + step, share),
            between_spans(shortest + step + plane, middle + step + plane, share),
            between_spans(shortest + step + 2 * plane, middle + step + 2 * plane, share) };
        weights[k] = sample_share(load_colour(span + step, plane), settings) * sample_share(now, settings);
    }
}

// By what lies `share` of the way from the shortest span to the middle one. Twice over the texels: beside a highlight
// their squares less the square of their mean would leave its rounding.
STAGE drift_t drift_of(
    plane_in span, plane_in shortest, plane_in middle, real share, const real* weights, frame_t frame)
{
    real sum = SPLAT(0.0), squares = sum, level = sum, weight = sum;
    for (int k = 0; k < SPAN_TEXELS; ++k) {
        const ptrdiff_t step = span_step(k, frame);
        const real v = load(span + step);
        sum += weights[k] * (between_spans(shortest + step, middle + step, share) - v);
        level += weights[k] * absolute(v);
        weight += weights[k];
    }
    const real mean = quotient(sum, weight);
    for (int k = 0; k < SPAN_TEXELS; ++k) {
        const ptrdiff_t step = span_step(k, frame);
        const real off = (between_spans(shortest + step, middle + step, share) - load(span + step)) - mean;
        squares += weights[k] * (off * off);
    }
    const drift_t drift = { mean, quotient(squares, weight * SPLAT(SPAN_TEXELS - 1)), quotient(level, weight) };
    return drift;
}

STAGE drifts drifts_of(
    plane_in span, plane_in shortest, plane_in middle, real share, size_t plane, frame_t frame, settings_t settings)
{
    real weights[SPAN_TEXELS];
    weigh_texels(weights, span, shortest, middle, share, frame, settings);
    const drifts d = { drift_of(span, shortest, middle, share, weights, frame),
        drift_of(span + plane, shortest + plane, middle + plane, share, weights, frame),
        drift_of(span + 2 * plane, shortest + 2 * plane, middle + 2 * plane, share, weights, frame) };
    return d;
}

// Student's t of a drift. The texels' variance grows by `noise`, which their mean does not lessen, and their deviation
// by `least` of what they show, so that what nobody sees is nothing.
STAGE real t_of(drift_t drift, real noise, real least)
{
    return quotient(absolute(drift.mean), square_root(drift.variance + noise) + (least * drift.level + K(TINY)));
}

// As much of a drift as is not chance: 1 - (enough / t)^2 (James and Stein), of the channel that drifted most.
STAGE colour believed(drifts d, real noise, real least, real enough)
{
    const real t
        = greater(greater(t_of(d.r, noise, least), greater(t_of(d.g, noise, least), t_of(d.b, noise, least))), enough);
    const real chance = quotient(enough, t), sure = SPLAT(1.0) - chance * chance;
    const colour moved = { sure * d.r.mean, sure * d.g.mean, sure * d.b.mean };
    return moved;
}

// What the mean of the latest samples is off by chance, its variance in a channel, as far as all texels around share it
// (they have one jitter): of the errors summed up over them that the shortest span leaves.
STAGE real shared_noise(real error)
{
    return error * K(SHARED_NOISE / (3.0 * SPAN_TEXELS * (SHORT_SPAN + 1) * (SHORT_SPAN + 1)));
}
