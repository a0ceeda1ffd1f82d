// Rectification: moves implausible history into the box of the current neighbourhood (a colour AABB). The neighbourhood
// clamp of many resolves is RECTIFY_CLAMP with BOX_EXTREMES, variance clipping (Salvi 2016) RECTIFY_CLIP with
// BOX_VARIANCE.
#include "taa/reprojection.h"

// Box scale, gamma: factor of the deviations (BOX_VARIANCE, BOX_BOTH) or of the extremes (BOX_EXTREMES). Wide without
// motion, narrow from motion_px pixels a frame on.
STAGE real box_scale_of(motion_t m, settings_t settings)
{
    if (!BOX_SCALE_BY_MOTION)
        return SPLAT(settings.box_scale_moving);
    const real speed = over(greater(absolute(m.u), absolute(m.v)), divisor(SPLAT(settings.motion_px)));
    const real still = greater(SPLAT(1.0) - speed, SPLAT(0.0));
    return SPLAT(settings.box_scale_moving) + still * (K(settings.box_scale_static) - K(settings.box_scale_moving));
}

// The box: centre, half extents and ends of each channel. Clip and ellipsoid divide by the extents, which are therefore
// floored at box_floor of the box's largest coordinate: a box that is flat in one channel would make the line clip
// throw the whole history away for a rounding error in that channel. The ends are not computed from centre and extent:
// unscaled, they are the neighbourhood's extremes to the bit, so that no rounding moves history that equals one.
typedef struct
{
    boxed centre, extent, low, high;
} box_t;

STAGE real extent_between(real low, real high) { return K(0.5) * (high - low); }

// Intersection of mean +- gamma deviation with the extremes; never empty, since the mean lies between the extremes.
STAGE void intersect(real* low, real* high, real mean, real width)
{
    *low = greater(mean - width, *low);
    *high = lesser(mean + width, *high);
}

// Moves the ends outwards (inwards where `more` is negative) by `more` half extents. A half extent is half of the
// range: halving `more` instead gives the same number, and a GPU does so once for three channels.
STAGE void widen(real* low, real* high, real* extent, real more)
{
    const real share = K(0.5) * more, range = *high - *low;
    *low -= share * range;
    *high += share * range;
    *extent += share * range;
}

STAGE box_t neighbourhood_box(statistics s, real gamma, settings_t settings)
{
    box_t box;
    if (BOX == BOX_VARIANCE) {
        box.centre = s.mean;
        box.extent = (boxed) { gamma * s.deviation.a, gamma * s.deviation.b, gamma * s.deviation.c };
        if (LUMA_SCALE)
            box.extent.a *= K(settings.luma_scale);
        s.low = (boxed) { s.mean.a - box.extent.a, s.mean.b - box.extent.b, s.mean.c - box.extent.c };
        s.high = (boxed) { s.mean.a + box.extent.a, s.mean.b + box.extent.b, s.mean.c + box.extent.c };
    } else {
        if (BOX == BOX_BOTH) {
            intersect(&s.low.a, &s.high.a, s.mean.a, gamma * s.deviation.a);
            intersect(&s.low.b, &s.high.b, s.mean.b, gamma * s.deviation.b);
            intersect(&s.low.c, &s.high.c, s.mean.c, gamma * s.deviation.c);
        }
        if (BOX == BOX_UNIT) {
            const real zero = SPLAT(0.0), one = SPLAT(BOX_A);
            s.low = (boxed) { lesser(s.low.a, one), lesser(s.low.b, SPLAT(BOX_B)), lesser(s.low.c, one) };
            s.high = (boxed) { greater(s.high.a, zero), greater(s.high.b, zero), greater(s.high.c, zero) };
        }
        box.extent = (boxed) { extent_between(s.low.a, s.high.a), extent_between(s.low.b, s.high.b),
            extent_between(s.low.c, s.high.c) };
        box.centre = (boxed) { s.low.a + box.extent.a, s.low.b + box.extent.b, s.low.c + box.extent.c };
        if (BOX == BOX_EXTREMES) {
            // A gamma of 1 adds exactly nothing.
            const real more = gamma - SPLAT(1.0);
            widen(&s.low.a, &s.high.a, &box.extent.a, more);
            widen(&s.low.b, &s.high.b, &box.extent.b, more);
            widen(&s.low.c, &s.high.c, &box.extent.c, more);
        }
    }
    box.low = s.low;
    box.high = s.high;
    if ((RECTIFY == RECTIFY_CLIP) | (RECTIFY == RECTIFY_ELLIPSOID)) {
        const real size = greater(
            absolute(box.centre.a), greater(K(BOX_A / BOX_B) * absolute(box.centre.b), absolute(box.centre.c)));
        const real least = K(settings.box_floor) * size + K(BOX_A * TINY);
        box.extent.a = greater(box.extent.a, least);
        box.extent.b = greater(box.extent.b, K(BOX_B / BOX_A) * least);
        box.extent.c = greater(box.extent.c, least);
    }
    if (RECTIFY == RECTIFY_CLIP_UNGUARDED) {
        box.extent.a += SPLAT(BOX_A * ADDED_EXTENT);
        box.extent.b += SPLAT(BOX_B * ADDED_EXTENT);
        box.extent.c += SPLAT(BOX_A * ADDED_EXTENT);
    }
    return box;
}

// Distance from the centre in half extents: of the largest channel (box), or the length of the vector (ellipsoid). At
// most 1 means inside.
STAGE real distance_in_extents(boxed d, boxed extent)
{
    const real a = quotient(absolute(d.a), extent.a), b = quotient(absolute(d.b), extent.b),
               c = quotient(absolute(d.c), extent.c);
    if (RECTIFY == RECTIFY_ELLIPSOID)
        return square_root((a * a + b * b) + c * c);
    return greater(a, greater(b, c));
}

// True where history lies beyond an end of the box. Always true for a variance box: its ends are centre -+ extent,
// which distance_in_extents has already compared with.
STAGE mask outside_ends(boxed v, box_t box)
{
    if (BOX == BOX_VARIANCE)
        return (mask)(-1);
    return (v.a < box.low.a) | (v.a > box.high.a) | (v.b < box.low.b) | (v.b > box.high.b) | (v.c < box.low.c)
        | (v.c > box.high.c);
}

// Share of the way from h to a target inside the box at which one coordinate enters the box; 0 inside.
STAGE real entry(real h, real direction, real low, real high)
{
    const mask parallel = direction == SPLAT(0.0);
    const real safe = parallel ? SPLAT(1.0) : direction;
    const real to_low = (low - h) / safe, to_high = (high - h) / safe;
    return parallel ? SPLAT(0.0) : lesser(to_low, to_high);
}

STAGE boxed clamp_to_box(boxed v, box_t box)
{
    return (boxed) { limit(v.a, box.low.a, box.high.a), limit(v.b, box.low.b, box.high.b),
        limit(v.c, box.low.c, box.high.c) };
}

STAGE boxed clip_towards(boxed history, boxed target, box_t box)
{
    const boxed direction = { target.a - history.a, target.b - history.b, target.c - history.c };
    const real first = greater(
        entry(history.a, direction.a, box.low.a, box.high.a), entry(history.b, direction.b, box.low.b, box.high.b));
    const real t = limit(greater(first, entry(history.c, direction.c, box.low.c, box.high.c)), SPLAT(0.0), SPLAT(1.0));
    return (boxed) { history.a + t * direction.a, history.b + t * direction.b, history.c + t * direction.c };
}

STAGE boxed rectify_history(boxed history, boxed current, box_t box)
{
    boxed out = history;
    if (RECTIFY == RECTIFY_CLAMP) {
        out = clamp_to_box(history, box);
    } else if (RECTIFY == RECTIFY_CLIP_CURRENT) {
        out = clip_towards(history, clamp_to_box(current, box), box);
    } else if (RECTIFY != RECTIFY_NONE) {
        const boxed d = { history.a - box.centre.a, history.b - box.centre.b, history.c - box.centre.c };
        const real t = distance_in_extents(d, box.extent);
        const mask out_of_it = (t > SPLAT(1.0)) & (RECTIFY == RECTIFY_CLIP ? outside_ends(history, box) : (mask)(-1));
        const real by = divisor(out_of_it ? t : SPLAT(1.0));
        out.a = out_of_it ? box.centre.a + over(d.a, by) : history.a;
        out.b = out_of_it ? box.centre.b + over(d.b, by) : history.b;
        out.c = out_of_it ? box.centre.c + over(d.c, by) : history.c;
    }
    return out;
}

// The change that rectification makes, in RGB. It is added, so that history inside its box keeps its bits (a round trip
// through the box space would not).
typedef struct
{
    colour change;
    real blend_boost; // 0 to 1: the larger of motion and the distance that the history moved (adaptive,
                      // capped); 1 in motion (standing)
    real anti_flicker_factor; // factor of the current sample's weight (clamp-distance)
    real alpha; // of the history, rectified (rectified_alpha)
} rectification;

// True where a pixel moves less than STATIC_MOTION pixels along each axis: too little to be seen.
STAGE mask is_static(motion_t m) { return (absolute(m.u) < K(STATIC_MOTION)) & (absolute(m.v) < K(STATIC_MOTION)); }

// The larger of two shares, 1 at most: motion in screens a frame times motion_rate, and the distance moved in the box
// space times clip_rate.
STAGE real blend_boost_of(motion_t m, boxed moved, frame_t frame, settings_t settings)
{
    const real across = m.u / SPLAT(frame.width), down = m.v / SPLAT(frame.height);
    const real speed = square_root(across * across + down * down);
    const real distance = square_root((moved.a * moved.a + moved.b * moved.b) + moved.c * moved.c);
    const real by_motion = K(settings.motion_rate) * speed, by_distance = K(settings.clip_rate) * distance;
    return lesser(greater(by_motion, by_distance), SPLAT(1.0));
}

// d / (d + range) with d the distance of the history's first coordinate from the nearer end of the box: history that
// lies on an end of a wide box flickers between the ends (Karis 2014).
STAGE real anti_flicker_factor_of(real history, real centre, real extent)
{
    const real d = lesser(absolute(history - (centre - extent)), absolute(history - (centre + extent)));
    return d / ((d + (extent + extent)) + SPLAT(BOX_A * TINY));
}

STAGE rectification rectify(
    colour history, colour current, statistics s, motion_t m, real gamma, frame_t frame, settings_t settings)
{
    if ((RECTIFY == RECTIFY_NONE) & (ACCUMULATE != ACCUMULATE_ADAPTIVE) & (ACCUMULATE != ACCUMULATE_STANDING)
        & (ACCUMULATE != ACCUMULATE_CAPPED) & (ANTI_FLICKER != ANTI_FLICKER_CLAMP_DISTANCE)) {
        // The code below gives the same, but no compiler may assume that h - h is 0.
        return (rectification) { { SPLAT(0.0), SPLAT(0.0), SPLAT(0.0) }, SPLAT(0.0), SPLAT(1.0) };
    }
    const boxed h = to_box_space(history);
    const box_t box = neighbourhood_box(s, gamma, settings);
    const boxed r = rectify_history(h, to_box_space(current), box);
    const boxed moved = { r.a - h.a, r.b - h.b, r.c - h.c };
    rectification out;
    out.change = from_box_space(moved);
    out.blend_boost = SPLAT(0.0);
    if ((ACCUMULATE == ACCUMULATE_ADAPTIVE) | (ACCUMULATE == ACCUMULATE_CAPPED))
        out.blend_boost = blend_boost_of(m, in_units(moved), frame, settings);
    if (ACCUMULATE == ACCUMULATE_STANDING)
        out.blend_boost = is_static(m) ? SPLAT(0.0) : SPLAT(1.0);
    out.anti_flicker_factor = ANTI_FLICKER == ANTI_FLICKER_CLAMP_DISTANCE
        ? anti_flicker_factor_of(h.a, box.centre.a, box.extent.a)
        : SPLAT(1.0);
    return out;
}
