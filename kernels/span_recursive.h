// What the recursive resolve of the same frame adds to what the spans of the past came to: an estimate of another kind,
// whose errors are in part independent.
#include "taa/pixel.h"

// The share of a recursive result of `recursive` samples beside spans of `count` ones. A history that was forgotten
// just now follows light that the spans still lag behind, and costs little where they have few samples themselves. One
// that has lasted counts by its samples, but where the spans have few: there it may lag. Between the two they know
// better.
// `latest` are the samples of the shortest span: where the latest frames did not show the surface, a history that the
// recursive result has all the same is of what stood before it.
STAGE real recursive_share(real recursive, real count, real latest)
{
    const real zero = SPLAT(0.0), one = SPLAT(1.0);
    const real begun
        = greater(limit(SPLAT(BEGUN_ANEW) - recursive, zero, one), limit(SPLAT(FEW_GATHERED) - count, zero, one));
    const real most = lesser(
        SPLAT(BESIDE_MOST), lesser(quotient(SPLAT(BESIDE_FEW), count), quotient(SPLAT(BESIDE_MANY), count * count)));
    const real lasted = limit((recursive - SPLAT(LASTED)) * K(LASTED_STEP), zero, one)
        * limit((count - SPLAT(GATHERED)) * K(GATHERED_STEP), zero, one);
    const real part = quotient(recursive, recursive + count);
    const real seen = limit(latest - SPLAT(HARDLY_SEEN), zero, one);
    return seen * (begun * most + lasted * (part * part));
}

// What the spans came to, drawn towards the recursive result at a texel, planes as of a history, that counts `count`.
STAGE resolved beside_recursive(resolved spans, history_in recursive, real count, real latest, frame_t frame)
{
    const size_t plane = plane_size(frame);
    const colour c = load_history_colour(recursive, plane);
    const real share = recursive_share(absolute(count), spans.count, latest);
    resolved out = spans;
    out.rgb = drawn_towards(spans.rgb, c, share);
    if (ALPHA)
        out.alpha = spans.alpha + share * (load_history(recursive + 3 * plane) - spans.alpha);
    return out;
}
