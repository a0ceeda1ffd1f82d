// Fireflies: isolated samples far above what lies around them, now and in the history, as noisy path tracing leaves
// them.
#include "taa/accumulate.h"

// Four times the luminance of a texel in the box space.
STAGE real boxed_luminance_4(boxed v) { return BOX_SPACE == BOX_SPACE_YCOCG ? v.a : (v.a + v.c) + K(2.0) * v.b; }

// The two greatest of what has been seen.
typedef struct
{
    real first, second;
} greatest_t;

STAGE void see_luminance(greatest_t* g, boxed v)
{
    const real y = boxed_luminance_4(v);
    g->second = greater(g->second, lesser(g->first, y));
    g->first = greater(g->first, y);
}

// A sample `v`, or what stands for it where its luminance is more than firefly_threshold times `borne_out`, of four
// times which that is given: the history, so that the sample adds nothing, or without that itself, as bright as that.
STAGE colour borne_out_sample(colour v, real borne_out, history_t h, settings_t settings)
{
    const real y = luminance_4(v);
    const mask fly = y > K(settings.firefly_threshold) * borne_out;
    return choose_colour(fly & h.valid, h.rgb, scaled(v, fly ? quotient(borne_out, y) : SPLAT(1.0)));
}

// The pixel without a firefly. What bears its sample out is the second greatest of the eight texels around it, so that
// two fireflies side by side bear neither out, or its history, in which a highlight stands that is there for several
// frames; up to firefly_floor nothing needs it.
STAGE pixel_t without_firefly(
    pixel_t p, boxed_row above, boxed_row own, boxed_row below, history_t h, settings_t settings)
{
    if (FIREFLIES == FIREFLIES_KEEP)
        return p;
    greatest_t around = { SPLAT(0.0), SPLAT(0.0) };
    see_luminance(&around, above.left);
    see_luminance(&around, above.own);
    see_luminance(&around, above.right);
    see_luminance(&around, own.left);
    see_luminance(&around, own.right);
    see_luminance(&around, below.left);
    see_luminance(&around, below.own);
    see_luminance(&around, below.right);
    const real past = h.valid ? luminance_4(h.rgb) : SPLAT(0.0);
    const real borne_out = greater(greater(around.second, past), K(4.0) * SPLAT(settings.firefly_floor));
    p.own = borne_out_sample(p.own, borne_out, h, settings);
    p.filtered = borne_out_sample(p.filtered, borne_out, h, settings);
    p.luminance = luminance_4(p.filtered);
    return p;
}
