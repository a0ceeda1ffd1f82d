// The samples that a frame of the ring holds in and around a pixel.
#include "taa/pixel.h"
#include "gather_fit.h"
#include "gather_sides.h"
#include "gather_track.h"

#if !defined(ALPHA) || !defined(EXPOSURE)
#error "gather_sample.h needs ALPHA and EXPOSURE from the prelude"
#endif

STAGE colour colour_at(plane_in p, footprint f, size_t plane, int stride)
{
    const colour v = { texel_at(p, f, stride), texel_at(p + plane, f, stride), texel_at(p + 2 * plane, f, stride) };
    return v;
}

// A frame of the ring as a pixel sees it: its planes, the way there, the texel whose sample lies nearest to the pixel's
// centre, and where its samples lie.
typedef struct
{
    plane_in planes;
    motion_t m;
    mask seen;
    footprint f;
    real column, row; // of that texel
    places_t places;
    real reach; // where they no longer count
    int recent; // 1: its samples are summed on their own too
} view_t;

// How much counts of the sample `right` and `down` texels beside the nearest one, and where it lies; nothing for most
// of the eight, which is told before all else. The halo of an image holds none. A mean takes the nearest one alone.
STAGE real weight_beside(view_t v, int right, int down, real* dx, real* dy, frame_t frame)
{
    const real zero = SPLAT(0.0), reach = v.reach;
    *dx = v.places.x + (v.places.xx * K(right) + v.places.xy * K(down));
    *dy = v.places.y + (v.places.yx * K(right) + v.places.yy * K(down));
    if (GATHER_FIT == GATHER_FIT_MEAN)
        return v.seen ? SPLAT(1.0) : zero;
    const mask near = v.seen & v.places.visible & (absolute(*dx) < reach) & (absolute(*dy) < reach);
    if (!any_of(near))
        return zero;
    const real column = v.column + K(right), row = v.row + K(down), low = SPLAT(-0.5);
    const mask inside
        = (column > low) & (row > low) & (column < SPLAT(frame.width) - K(0.5)) & (row < SPLAT(frame.height) - K(0.5));
    const real share = window(*dx, reach) * window(*dy, reach);
    return near & inside ? share : zero;
}

// One sample of a frame of the ring. It counts if it shows one of the pixel's surfaces; with `far_only` true, if it
// shows the farther one.
STAGE void gather_sample(gathered* g, view_t v, int right, int down, pixel_t now, surface s, layers_t l, int far_only,
    frame_t then, frame_t frame, settings_t settings)
{
    const size_t plane = plane_size(frame);
    const int stride = row_stride(frame);
    const real zero = SPLAT(0.0);
    real dx, dy;
    const real share = weight_beside(v, right, down, &dx, &dy, frame);
    mask good = share > zero;
    if (!any_of(good))
        return;
    plane_in p = v.planes + down * (ptrdiff_t)stride + right;
    colour c = colour_at(p, v.f, plane, stride);
    good = good & !colour_outside_domain(c);
    const real q = inverse_depth_or_sky(texel_at(p + RING_INVERSE_DEPTH * plane, v.f, stride), then);
    good = good & matches_surface(q, s, v.m, settings);
    mask near = (s.x == s.x);
    if (GATHER_FIT != GATHER_FIT_MEAN) {
        near = !l.edge | (q > l.cut * v.m.scale + v.m.shift);
        good = far_only ? good & !near : good;
    }
    if (EXPOSURE)
        c = scaled(c, SPLAT(then.exposure_ratio));
    c = choose_colour(good, to_range(c), now.own);
    const colour d = { c.r - now.own.r, c.g - now.own.g, c.b - now.own.b };
    real counted = good ? share : zero;
    if (REACTIVE & (ILLUMINATION == ILLUMINATION_WINDOW)) {
        const real alike = as_reactive(share_in_domain(texel_at(p + RING_REACTIVE * plane, v.f, stride), zero), now);
        g->unlike += v.recent ? counted * (SPLAT(1.0) - alike) : zero;
        counted *= alike;
    }
    add_sample(g, d, counted * sample_share(c, settings), good ? dx : zero, good ? dy : zero, far_only ? !near : near);
    g->count += counted;
    if (v.recent)
        add_recent(g, share_difference(c, now.own, settings), counted);
    if (ALPHA) {
        const real a = share_in_domain(texel_at(p + RING_ALPHA * plane, v.f, stride), SPLAT(1.0));
        g->alpha += counted * (a - now.alpha);
    }
}
