// Rows of the history that a work-item keeps while it slides down. Where a segment moves as the one above it did, by
// the same fraction of a texel and as many whole ones, three of the four rows of taps around it have been weighed along
// x already. Its place, fractions and weights are known too, before the motion that says the same has been worked out,
// so that a CPU need not wait for it.
#include "light.h"

#if !defined(CAMERA_MOTION) || !defined(OWN_MOTION)
#error "kept_rows.h needs CAMERA_MOTION and OWN_MOTION from the prelude"
#endif

// Where nothing moves there is no filter to keep rows for.
#define KEEPS_ROWS                                                                                                     \
    ((CAMERA_MOTION || OWN_MOTION)                                                                                     \
        && (HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM || HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM_9))

typedef struct
{
    real fx, fy; // of the segment above
    uint at;
    kept_light light; // used on a GPU alone
#if KEEPS_ROWS && LANES == 1
    weights wx, wy;
    real row[3][3]; // of each plane those above, at and below tap 1 of the next pixel
#elif KEEPS_ROWS
    int filled; // whether there is what follows: only from the second segment on that moves alike
    weights wx, wy;
    real row[3][4]; // of each plane that of row y at y & 3
#endif
} kept_rows;

STAGE kept_rows nothing_kept(void)
{
    kept_rows kept;
    kept.fx = kept.fy = SPLAT(-1.0); // no fraction
    kept.at = kept.light.nearest = 0;
#if KEEPS_ROWS && LANES > 1
    kept.filled = 0;
#endif
    return kept;
}

#if KEEPS_ROWS && LANES > 1
// Whether the segment of footprint f moves as the one above it. If not, it is what the next one is compared with.
STAGE int moves_alike(kept_rows* kept, footprint f, int stride)
{
    const uint next = kept->at + (uint)stride;
    if (f.lanes == LANES_ALIKE && f.at == next && !any_of((f.fx != kept->fx) | (f.fy != kept->fy))) {
        kept->at = next;
        return 1;
    }
    kept->at = f.at;
    kept->fx = f.fx;
    kept->fy = f.fy;
    kept->filled = 0;
    return 0;
}

STAGE void fill_rows(kept_rows* kept, history_in p, size_t plane, int y, int stride)
{
    kept->filled = 1;
    kept->wx = history_weights(kept->fx);
    kept->wy = history_weights(kept->fy);
    ROLLED
    for (int i = 0; i < 9; ++i)
        kept->row[i / 3][(y + i % 3 - 1) & 3]
            = row_alike(p + (size_t)(i / 3) * plane + (i % 3 - 1) * (ptrdiff_t)stride, kept->wx).middle;
}

// One plane of a segment whose rows y - 1 to y + 1 are kept; p points at its tap 1.
STAGE real sample_kept(real* row, history_in p, weights wx, weights wy, int y, int stride)
{
    const real zero = SPLAT(0.0), last = row_alike(p + 2 * (ptrdiff_t)stride, wx).middle;
    row[(y + 2) & 3] = last;
    return weigh(zero, row[(y - 1) & 3], row[y & 3], row[(y + 1) & 3], last, zero, wy).middle;
}

STAGE colour sample_kept_colour(kept_rows* kept, history_in p, size_t plane, int y, int stride)
{
    if (!kept->filled)
        fill_rows(kept, p, plane, y, stride);
    const weights wx = kept->wx, wy = kept->wy;
    const colour v
        = { sample_kept(kept->row[0], p, wx, wy, y, stride), sample_kept(kept->row[1], p + plane, wx, wy, y, stride),
              sample_kept(kept->row[2], p + 2 * plane, wx, wy, y, stride) };
    return v;
}
#endif

#if KEEPS_ROWS && LANES == 1
// A GPU asks for the row that every pixel needs before the branch, past which its compiler moves no load, and moves
// rows from register to register: it cannot count registers.
typedef struct
{
    real p0, p1, p2, p3;
} taps;

STAGE taps load_taps(history_in p)
{
    const taps t = { load_history(p - 1), load_history(p), load_history(p + 1), load_history(p + 2) };
    return t;
}

STAGE void fill_plane(real* row, history_in p, uint at, weights wx, int stride)
{
    row[0] = row_alike(ROW_BELOW(p, at, -1, stride), wx).middle;
    row[1] = row_alike(ROW_BELOW(p, at, 0, stride), wx).middle;
    row[2] = row_alike(ROW_BELOW(p, at, 1, stride), wx).middle;
}

STAGE real slide_plane(real* row, taps t, weights wx, weights wy)
{
    const real zero = SPLAT(0.0), last = weigh(zero, t.p0, t.p1, t.p2, t.p3, zero, wx).middle;
    const real v = weigh(zero, row[0], row[1], row[2], last, zero, wy).middle;
    row[0] = row[1];
    row[1] = row[2];
    row[2] = last;
    return v;
}

STAGE colour slide_colour(kept_rows* kept, history_in p, footprint f, size_t plane, int stride)
{
    const taps r = load_taps(ROW_BELOW(p, f.at, 2, stride)), g = load_taps(ROW_BELOW(p + plane, f.at, 2, stride)),
               b = load_taps(ROW_BELOW(p + 2 * plane, f.at, 2, stride));
    if ((f.at != kept->at) | (f.fx != kept->fx) | (f.fy != kept->fy)) {
        kept->fx = f.fx, kept->fy = f.fy;
        kept->wx = history_weights(f.fx), kept->wy = history_weights(f.fy);
        fill_plane(kept->row[0], p, f.at, kept->wx, stride);
        fill_plane(kept->row[1], p + plane, f.at, kept->wx, stride);
        fill_plane(kept->row[2], p + 2 * plane, f.at, kept->wx, stride);
    }
    kept->at = f.at + (uint)stride;
    const colour v = { slide_plane(kept->row[0], r, kept->wx, kept->wy),
        slide_plane(kept->row[1], g, kept->wx, kept->wy), slide_plane(kept->row[2], b, kept->wx, kept->wy) };
    return v;
}
#endif
