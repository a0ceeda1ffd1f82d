// Rows of the history that a work-item keeps while it slides down. Where a segment moves as the one above it did, by
// the same fraction of a texel and as many whole ones, three of the four rows of taps around it have been weighed along
// x already. Its place, fractions and weights are known too, before the motion that says the same has been worked out,
// so that a CPU need not wait for it.
#include "taa/illumination.h"

#if !defined(CAMERA_MOTION) || !defined(OWN_MOTION)
#error "row_cache.h needs CAMERA_MOTION and OWN_MOTION from the prelude"
#endif

// Where nothing moves there is no filter to keep rows for.
#define ROW_CACHE                                                                                                      \
    ((CAMERA_MOTION | OWN_MOTION) & (HISTORY_RANGE == HISTORY_RANGE_LINEAR)                                            \
        & (HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM))

// A plane's rows, weighed along y as far as they are known, in the order of `weigh`: what the next pixel and the one
// below it have of theirs, and the last row. Kept as rows they would move from register to register.
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
    // On a GPU.
    column_sums plane[3];
    real count; // between two texels of the upper row of the next pixel
    // On a CPU.
    real u, v; // what these come from, where it is the same whole texels for all lanes
    scalar_whole dx, dy; // whose
    int filled; // whether there is what follows: only from the second segment on that moves alike
    real count_limit; // samples that history at this fraction may stand for
    real row[3][4]; // of each plane that of row y at y & 3
} row_cache;

STAGE row_cache empty_row_cache(void)
{
    row_cache cache;
    cache.fx = cache.fy = SPLAT(-1.0); // no fraction
    cache.at = cache.illumination.nearest = 0;
    cache.u = cache.v = SPLAT(DOMAIN_LIMIT); // nothing moves as far
    cache.filled = 0;
    return cache;
}

// Whether a segment moves as the one above it to the last bit, so that its footprint need not be worked out.
STAGE int same_motion_as_above(const row_cache* cache, real u, real v)
{
    return !any_of((u != cache->u) | (v != cache->v));
}

// The footprint of a segment that moves as the one above it.
STAGE footprint footprint_below(const row_cache* cache, uint own, int stride)
{
    const whole none = (whole)(0), dx = (whole)(cache->dx), dy = (whole)(cache->dy);
    const footprint f = { dx, dy, cache->fx, cache->fy, none, none, own, cache->at + (uint)stride, LANES_ALIKE };
    return f;
}

// Whether the segment of footprint f, which u and v give, moves as the one above it. If not, it is what the next one is
// compared with.
STAGE int continues_row_cache(row_cache* cache, footprint f, real u, real v, int stride)
{
    const uint next = cache->at + (uint)stride;
    cache->at = f.at;
    cache->u = f.lanes == LANES_ALIKE ? u : SPLAT(DOMAIN_LIMIT);
    cache->v = v;
    cache->dx = first_lane(f.dx);
    cache->dy = first_lane(f.dy);
    if (f.lanes == LANES_ALIKE && f.at == next && !any_of((f.fx != cache->fx) | (f.fy != cache->fy)))
        return 1;
    cache->fx = f.fx;
    cache->fy = f.fy;
    cache->filled = 0;
    return 0;
}

STAGE void fill_row_cache(row_cache* cache, history_in p, size_t plane, int y, int stride, settings_t settings)
{
    cache->filled = 1;
    cache->wx = history_weights(cache->fx);
    cache->wy = history_weights(cache->fy);
    cache->count_limit = count_limit_of(cache->fx, cache->fy, settings);
    NO_UNROLL
    for (int i = 0; i < 9; ++i)
        cache->row[i / 3][(y + i % 3 - 1) & 3]
            = row_alike(p + (size_t)(i / 3) * plane + (i % 3 - 1) * (ptrdiff_t)stride, cache->wx).middle;
}

// One plane of a segment whose rows y - 1 to y + 1 are kept; p points at its tap 1.
STAGE real sample_cached(real* row, history_in p, weights wx, weights wy, int y, int stride)
{
    const real zero = SPLAT(0.0), last = row_alike(p + 2 * (ptrdiff_t)stride, wx).middle;
    row[(y + 2) & 3] = last;
    return weigh(zero, row[(y - 1) & 3], row[y & 3], row[(y + 1) & 3], last, zero, wy).middle;
}

STAGE colour sample_cached_colour(row_cache* cache, history_in p, size_t plane, int y, int stride, settings_t settings)
{
    if (!cache->filled)
        fill_row_cache(cache, p, plane, y, stride, settings);
    const weights wx = cache->wx, wy = cache->wy;
    const colour v = { sample_cached(cache->row[0], p, wx, wy, y, stride),
        sample_cached(cache->row[1], p + plane, wx, wy, y, stride),
        sample_cached(cache->row[2], p + 2 * plane, wx, wy, y, stride) };
    return v;
}

// A GPU asks for the row that every pixel needs before the branch, past which its compiler moves no load.
typedef struct
{
    real p0, p1, p2, p3;
} taps;

STAGE taps load_taps(history_in p)
{
    const taps t = { load_history(p - 1), load_history(p), load_history(p + 1), load_history(p + 2) };
    return t;
}

STAGE column_sums fill_plane(history_in p, uint at, weights wx, weights wy, int stride)
{
    const real r0 = row_alike(ROW_BELOW(p, at, -1, stride), wx).middle,
               r1 = row_alike(ROW_BELOW(p, at, 0, stride), wx).middle,
               r2 = row_alike(ROW_BELOW(p, at, 1, stride), wx).middle;
    const column_sums s = { (r1 + wy.w0 * (r1 - r0)) + wy.w2 * (r2 - r1), r2 + wy.w0 * (r2 - r1), r2 };
    return s;
}

STAGE real slide_plane(column_sums* s, taps t, weights wx, weights wy)
{
    const real zero = SPLAT(0.0), last = weigh(zero, t.p0, t.p1, t.p2, t.p3, zero, wx).middle;
    const real step = last - s->last, v = s->next + wy.w3 * step;
    s->next = s->second + wy.w2 * step;
    s->second = last + wy.w0 * step;
    s->last = last;
    return v;
}

// A row of the count between two texels, as `sample_count` has it.
STAGE real count_between(real left, real right, real fx) { return left + fx * (right - left); }

// Colour and count at a footprint.
STAGE colour slide_history(
    row_cache* cache, history_in p, plane_in counts, footprint f, size_t plane, int stride, real* count)
{
    plane_in upper = counts + f.at, lower = ROW_BELOW(counts, f.at, 1, stride);
    const real lower_left = load(lower), lower_right = load(lower + 1);
    const taps r = load_taps(ROW_BELOW(p, f.at, 2, stride)), g = load_taps(ROW_BELOW(p + plane, f.at, 2, stride)),
               b = load_taps(ROW_BELOW(p + 2 * plane, f.at, 2, stride));
    if ((f.at != cache->at) | any_of((f.fx != cache->fx) | (f.fy != cache->fy))) {
        cache->fx = f.fx, cache->fy = f.fy;
        cache->wx = history_weights(f.fx), cache->wy = history_weights(f.fy);
        cache->plane[0] = fill_plane(p, f.at, cache->wx, cache->wy, stride);
        cache->plane[1] = fill_plane(p + plane, f.at, cache->wx, cache->wy, stride);
        cache->plane[2] = fill_plane(p + 2 * plane, f.at, cache->wx, cache->wy, stride);
        cache->count = count_between(load(upper), load(upper + 1), f.fx);
    }
    const real below = count_between(lower_left, lower_right, f.fx);
    *count = cache->count + f.fy * (below - cache->count);
    cache->count = below;
    cache->at = f.at + (uint)stride;
    const colour v = { slide_plane(&cache->plane[0], r, cache->wx, cache->wy),
        slide_plane(&cache->plane[1], g, cache->wx, cache->wy),
        slide_plane(&cache->plane[2], b, cache->wx, cache->wy) };
    return v;
}
