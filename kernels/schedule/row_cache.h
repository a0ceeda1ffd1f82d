// Row cache: filtered rows of the history that a work-item keeps while it slides down. Where a segment moves as the one
// above it, by the same fraction of a texel and as many whole ones, three of the four rows of taps around it are
// already filtered along x. Its position, fractions and weights are known too, before its motion is computed, so that a
// CPU need not wait for it.
#include "taa/illumination.h"

// Filtered rows are kept for Catmull-Rom's 16 taps alone, as in `fast`: the default's cross of 20 is read anew for each
// pixel. Without motion there is no filter to keep rows for. The illumination test keeps its row for any filter.
#define ROW_CACHE                                                                                                      \
    ((CAMERA_MOTION | OWN_MOTION) & (HISTORY_RANGE == HISTORY_RANGE_LINEAR)                                            \
        & (HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM))

// Partial sums of a plane's rows along y, in the order of `filter_taps`: those of the next pixel and of the one below
// it, and the last row. Rows themselves would move from register to register.
typedef struct
{
    real next, second, last;
} column_sums;

typedef struct
{
    real fx, fy; // of the segment above
    uint at;
    illumination_cache illumination;
    weights wx, wy;
    column_sums plane[3];
    // On a GPU.
    real count; // interpolated along x in the upper row of the next pixel
    // On a CPU.
    real u, v; // the motion that gives them, if all lanes have one integer displacement
    scalar_whole dx, dy; // that displacement
    int filled; // 1 if there are sums: from the second segment on that moves alike
    real count_limit; // upper limit of the sample count at this fraction
} row_cache;

STAGE row_cache empty_row_cache(void)
{
    row_cache cache;
    cache.fx = cache.fy = SPLAT(-1.0); // no fraction
    cache.at = cache.illumination.nearest = 0;
    cache.u = cache.v = SPLAT(DOMAIN_LIMIT); // no motion is as large
    cache.filled = 0;
    return cache;
}

// 1 if a segment moves as the one above it, to the last bit, so that its footprint need not be computed.
STAGE int same_motion_as_above(const row_cache* cache, real u, real v)
{
    return !any_of((u != cache->u) | (v != cache->v));
}

// The footprint of a segment that moves as the one above it.
STAGE footprint footprint_below(const row_cache* cache, uint own, int stride)
{
    const whole none = (whole)(0), dx = (whole)(cache->dx), dy = (whole)(cache->dy);
    return (footprint) { dx, dy, cache->fx, cache->fy, none, none, own, cache->at + (uint)stride, LANES_UNIFORM };
}

// 1 if the segment of footprint f and motion (u, v) moves as the one above it. The next one is compared with it.
STAGE int continues_row_cache(row_cache* cache, footprint f, real u, real v, int stride)
{
    const uint next = cache->at + (uint)stride;
    cache->at = f.at;
    cache->u = f.lanes == LANES_UNIFORM ? u : SPLAT(DOMAIN_LIMIT);
    cache->v = v;
    cache->dx = first_lane(f.dx);
    cache->dy = first_lane(f.dy);
    if (f.lanes == LANES_UNIFORM && f.at == next && !any_of((f.fx != cache->fx) | (f.fy != cache->fy)))
        return 1;
    cache->fx = f.fx;
    cache->fy = f.fy;
    cache->filled = 0;
    return 0;
}

// The texels of one row of a plane that a filter reads.
typedef struct
{
    real p0, p1, p2, p3;
} taps;

STAGE taps load_taps(history_in p)
{
    return (taps) { load_history(p - 1), load_history(p), load_history(p + 1), load_history(p + 2) };
}

STAGE column_sums fill_plane(history_in p, uint at, weights wx, weights wy, int stride)
{
    const real r0 = row_uniform(ROW_BELOW(p, at, -1, stride), wx).middle,
               r1 = row_uniform(ROW_BELOW(p, at, 0, stride), wx).middle,
               r2 = row_uniform(ROW_BELOW(p, at, 1, stride), wx).middle;
    return (column_sums) { (r1 + wy.w0 * (r1 - r0)) + wy.w2 * (r2 - r1), r2 + wy.w0 * (r2 - r1), r2 };
}

STAGE real slide_plane(column_sums* s, taps t, weights wx, weights wy)
{
    const real zero = SPLAT(0.0), last = filter_taps(zero, t.p0, t.p1, t.p2, t.p3, zero, wx).middle;
    const real step = last - s->last, v = s->next + wy.w3 * step;
    s->next = s->second + wy.w2 * step;
    s->second = last + wy.w0 * step;
    s->last = last;
    return v;
}

STAGE void fill_columns(row_cache* cache, history_in p, uint at, size_t plane, int stride)
{
    cache->wx = history_weights(cache->fx), cache->wy = history_weights(cache->fy);
    NO_UNROLL
    for (int i = 0; i < 3; ++i)
        cache->plane[i] = fill_plane(p + i * plane, at, cache->wx, cache->wy, stride);
}

STAGE colour slide_columns(row_cache* cache, taps r, taps g, taps b)
{
    const weights wx = cache->wx, wy = cache->wy;
    return (colour) { slide_plane(&cache->plane[0], r, wx, wy), slide_plane(&cache->plane[1], g, wx, wy),
        slide_plane(&cache->plane[2], b, wx, wy) };
}

// Samples colour and count at a footprint. The row that every pixel needs is loaded before the branch: a GPU's compiler
// moves no load past it.
STAGE colour slide_history(
    row_cache* cache, history_in p, plane_in counts, footprint f, size_t plane, int stride, real* count)
{
    plane_in upper = counts + f.at, lower = ROW_BELOW(counts, f.at, 1, stride);
    const real lower_left = load(lower), lower_right = load(lower + 1);
    const taps r = load_taps(ROW_BELOW(p, f.at, 2, stride)), g = load_taps(ROW_BELOW(p + plane, f.at, 2, stride)),
               b = load_taps(ROW_BELOW(p + 2 * plane, f.at, 2, stride));
    if ((f.at != cache->at) | any_of((f.fx != cache->fx) | (f.fy != cache->fy))) {
        cache->fx = f.fx, cache->fy = f.fy;
        fill_columns(cache, p, f.at, plane, stride);
        cache->count = lerp(load(upper), load(upper + 1), f.fx);
    }
    const real below = lerp(lower_left, lower_right, f.fx);
    *count = cache->count + f.fy * (below - cache->count);
    cache->count = below;
    cache->at = f.at + (uint)stride;
    return slide_columns(cache, r, g, b);
}

// Samples colour at the footprint of a CPU's segment that moves as the one above it.
STAGE colour sample_cached_colour(
    row_cache* cache, history_in p, uint at, size_t plane, int stride, settings_t settings)
{
    if (!cache->filled) {
        cache->filled = 1;
        fill_columns(cache, p, at, plane, stride);
        cache->count_limit = count_limit_of(cache->fx, cache->fy, settings);
    }
    history_in q = p + at + 2 * (ptrdiff_t)stride;
    return slide_columns(cache, load_taps(q), load_taps(q + plane), load_taps(q + 2 * plane));
}
