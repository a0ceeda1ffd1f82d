// Rectification: history that the current neighbourhood makes implausible is moved into its box.
#if !defined(RECTIFY) || !defined(BOX)
#error "rectify.h needs RECTIFY and BOX from the prelude"
#endif

// The box: centre and half extents a channel, extents floored at box_floor of the box's largest coordinate, because a
// box that is flat in one channel makes the line clip throw the whole history away for a rounding error in that
// channel.
typedef struct
{
    boxed centre, extent;
} box_t;

STAGE real half_width(real low, real high) { return K(0.5) * (high - low); }

// Intersection of mean +- gamma deviation with the extremes; never empty, since the mean lies between the extremes.
STAGE void narrow(real* low, real* high, real mean, real width)
{
    *low = greater(mean - width, *low);
    *high = lesser(mean + width, *high);
}

STAGE box_t neighbourhood_box(statistics s, real gamma, settings_t settings)
{
    box_t box;
    if (BOX == BOX_VARIANCE) {
        box.centre = s.mean;
        box.extent = (boxed) { gamma * s.deviation.a, gamma * s.deviation.b, gamma * s.deviation.c };
    } else {
        if (BOX == BOX_BOTH) {
            narrow(&s.low.a, &s.high.a, s.mean.a, gamma * s.deviation.a);
            narrow(&s.low.b, &s.high.b, s.mean.b, gamma * s.deviation.b);
            narrow(&s.low.c, &s.high.c, s.mean.c, gamma * s.deviation.c);
        }
        box.extent
            = (boxed) { half_width(s.low.a, s.high.a), half_width(s.low.b, s.high.b), half_width(s.low.c, s.high.c) };
        box.centre = (boxed) { s.low.a + box.extent.a, s.low.b + box.extent.b, s.low.c + box.extent.c };
    }
    if ((RECTIFY == RECTIFY_CLIP) | (RECTIFY == RECTIFY_ELLIPSOID)) {
        const real size = greater(absolute(box.centre.a), greater(absolute(box.centre.b), absolute(box.centre.c)));
        const real least = K(settings.box_floor) * size + K(TINY);
        box.extent.a = greater(box.extent.a, least);
        box.extent.b = greater(box.extent.b, least);
        box.extent.c = greater(box.extent.c, least);
    }
    return box;
}

// How far outside: the largest channel's distance from the centre in half extents (box), or the length of the vector of
// these (ellipsoid). At most 1 means inside.
STAGE real outsideness(boxed d, boxed extent)
{
    const real a = absolute(d.a) / extent.a, b = absolute(d.b) / extent.b, c = absolute(d.c) / extent.c;
    if (RECTIFY == RECTIFY_ELLIPSOID)
        return square_root((a * a + b * b) + c * c);
    return greater(a, greater(b, c));
}

STAGE boxed rectify_history(boxed history, box_t box)
{
    boxed out = history;
    if (RECTIFY == RECTIFY_CLAMP) {
        out.a = limit(history.a, box.centre.a - box.extent.a, box.centre.a + box.extent.a);
        out.b = limit(history.b, box.centre.b - box.extent.b, box.centre.b + box.extent.b);
        out.c = limit(history.c, box.centre.c - box.extent.c, box.centre.c + box.extent.c);
    } else if (RECTIFY != RECTIFY_NONE) {
        const boxed d = { history.a - box.centre.a, history.b - box.centre.b, history.c - box.centre.c };
        const real t = outsideness(d, box.extent);
        const mask out_of_it = t > SPLAT(1.0);
        const real safe = out_of_it ? t : SPLAT(1.0);
        out.a = out_of_it ? box.centre.a + d.a / safe : history.a;
        out.b = out_of_it ? box.centre.b + d.b / safe : history.b;
        out.c = out_of_it ? box.centre.c + d.c / safe : history.c;
    }
    return out;
}

// The change that rectification makes, in RGB. Added to the history as it is, so that history inside its box keeps its
// bits (a round trip through the box space would not).
typedef struct
{
    colour change;
    real pull; // how far the first coordinate (luminance) was moved, in half extents of the box
} rectification;

STAGE rectification rectify(colour history, statistics s, real gamma, settings_t settings)
{
    const boxed h = to_box_space(history);
    const box_t box = neighbourhood_box(s, gamma, settings);
    const boxed r = rectify_history(h, box);
    const boxed moved = { r.a - h.a, r.b - h.b, r.c - h.c };
    rectification out;
    out.change = from_box_space(moved);
    const real least = K(settings.box_floor) * absolute(box.centre.a) + K(TINY);
    out.pull = absolute(moved.a) / greater(box.extent.a, least);
    return out;
}
