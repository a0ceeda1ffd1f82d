// Fireflies: isolated samples far brighter than their neighbours and their history, as noisy path tracing leaves them.
#include "taa/accumulate.h"

// Four times the luminance of a texel in the box space.
STAGE real boxed_luminance_4(boxed v) { return BOX_SPACE == BOX_SPACE_YCOCG ? v.a : (v.a + v.c) + K(2.0) * v.b; }

// The three greatest luminances seen so far.
typedef struct
{
    real first, second, third;
} greatest_t;

STAGE void add_luminance(greatest_t* g, boxed v)
{
    const real y = boxed_luminance_4(v);
    g->third = greater(g->third, lesser(g->second, y));
    g->second = greater(g->second, lesser(g->first, y));
    g->first = greater(g->first, y);
}

// Replaces the sample `v` where its luminance exceeds firefly_threshold times `reference` (4 Y): by the
// history, so that the sample adds nothing, or without history by itself dimmed to `reference`.
STAGE colour clamp_firefly(colour v, real reference, history_t h, settings_t settings)
{
    const real y = luminance_4(v);
    const mask is_firefly = y > K(settings.firefly_threshold) * reference;
    return choose_colour(is_firefly & h.valid, h.rgb, scaled(v, is_firefly ? quotient(reference, y) : SPLAT(1.0)));
}

// Removes a firefly from the pixel. Its sample is compared with the greatest of three: the second greatest of the eight
// texels around it, so that two fireflies side by side do not confirm each other; its history, which holds a highlight
// of several frames; and firefly_floor. The filtered sample may hold two fireflies, and is compared with the third
// greatest of the nine.
STAGE pixel_t without_firefly(
    pixel_t p, boxed_row above, boxed_row own, boxed_row below, history_t h, settings_t settings)
{
    if (FIREFLIES == FIREFLIES_KEEP)
        return p;
    greatest_t around = { SPLAT(0.0), SPLAT(0.0), SPLAT(0.0) };
    add_luminance(&around, above.left);
    add_luminance(&around, above.own);
    add_luminance(&around, above.right);
    add_luminance(&around, own.left);
    add_luminance(&around, own.right);
    add_luminance(&around, below.left);
    add_luminance(&around, below.own);
    add_luminance(&around, below.right);
    const real past = h.valid ? luminance_4(h.rgb) : SPLAT(0.0);
    const real least = greater(past, K(4.0) * SPLAT(settings.firefly_floor));
    const real third = greater(around.third, lesser(around.second, boxed_luminance_4(own.own)));
    p.own = clamp_firefly(p.own, greater(around.second, least), h, settings);
    p.filtered = clamp_firefly(p.filtered, greater(third, least), h, settings);
    p.luminance = luminance_4(p.filtered);
    return p;
}
