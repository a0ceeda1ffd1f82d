// Footprint: where the pixels of a segment lie in the previous frame, and how its lanes load the texels around them.
// What is read is the same however they lie; the filters of taa/sampling.h make of it a sample of the history.
#include "taa/reprojection.h"
#include "taa/sampling.h"

// Where the lanes of a segment lie in the previous frame: all on texels, with one integer displacement (ON_TEXELS),
// between texels with one integer part (UNIFORM), with integer parts that differ by at most 1 an axis (ADJACENT), or
// anywhere (SCATTERED). The values read are the same in each case, only the loads differ. A pixel without motion lies
// on texels.
#define LANES_ON_TEXELS 0
#define LANES_UNIFORM 1
#define LANES_ADJACENT 2
#define LANES_SCATTERED 3

typedef struct
{
    whole dx, dy; // integer part of the displacement, by lane
    real fx, fy; // fraction in [0, 1)
    whole step_x, step_y; // lane's integer part minus the segment's: 0 or 1, where ADJACENT
    uint own, at; // offsets in a plane: the segment's own, and displaced by its integer part
    int lanes;
} footprint;

// Sets how the footprint's lanes lie, from their integer parts, and its offset from its own texel.
STAGE footprint classify_lanes(footprint f, int stride)
{
    scalar_whole x = first_lane(f.dx), y = first_lane(f.dy);
    f.lanes = LANES_UNIFORM;
    f.step_x = f.step_y = (whole)(0);
    if (LANES > 1 && any_of((f.dx ^ x) | (f.dy ^ y))) {
        x -= any_of(f.dx < x) ? 1 : 0;
        y -= any_of(f.dy < y) ? 1 : 0;
        f.step_x = f.dx - x;
        f.step_y = f.dy - y;
        f.lanes = any_of((f.step_x | f.step_y) & ~(whole)(1)) ? LANES_SCATTERED : LANES_ADJACENT;
    }
    f.at = f.own + (uint)((int)y * stride + (int)x);
    return f;
}

STAGE footprint footprint_of(motion_t m, mask valid, uint at, frame_t frame)
{
    footprint f;
    const real u = valid ? m.u : SPLAT(0.0), v = valid ? m.v : SPLAT(0.0), left = floor_of(u), top = floor_of(v);
    f.dx = TO_WHOLE(left), f.dy = TO_WHOLE(top);
    f.fx = u - left, f.fy = v - top;
    f.own = at;
    f = classify_lanes(f, row_stride(frame));
    // Not on a GPU: it waits for each load behind a branch, but issues those before the first branch all at once.
    if (LANES > 1 && f.lanes == LANES_UNIFORM && !any_of((f.fx != SPLAT(0.0)) | (f.fy != SPLAT(0.0))))
        f.lanes = LANES_ON_TEXELS;
    return f;
}

// The footprint without motion. Explicit, since not every compiler sees through the conversions of footprint_of.
STAGE footprint footprint_at_rest(uint at)
{
    const whole no = (whole)(0);
    return (footprint) { no, no, SPLAT(0.0), SPLAT(0.0), no, no, at, at, LANES_ON_TEXELS };
}

// Filters one row of taps around p along x. p points at tap 1 of the segment.
STAGE row_taps row_uniform(history_in p, weights w)
{
    real first = SPLAT(0.0), last = SPLAT(0.0);
    if (CROSS) {
        first = load_history(p - 2);
        last = load_history(p + 3);
    }
    return filter_taps(first, load_history(p - 1), load_history(p), load_history(p + 1), load_history(p + 2), last, w);
}

STAGE row_taps row_adjacent(history_in p, weights w, whole step)
{
    const mask right = step != 0;
    const real a = load_history(p - 1), b = load_history(p), c = load_history(p + 1), d = load_history(p + 2),
               e = load_history(p + 3);
    real first = SPLAT(0.0), last = SPLAT(0.0);
    if (CROSS) {
        first = right ? a : load_history(p - 2);
        last = right ? load_history(p + 4) : e;
    }
    return filter_taps(first, right ? b : a, right ? c : b, right ? d : c, right ? e : d, last, w);
}

// Filters row j of six; p points at the segment's own texel in it. The loads take so long that rolled loops cost
// nothing; unrolled, they were half of what a compiler had to work through.
STAGE row_taps row_scattered(history_in p, weights w, whole offsets, int j)
{
    real tap[6];
    for (int i = 0; i < 6; ++i)
        tap[i] = SPLAT(0.0);
    const int pair = CROSS & ((j < 2) | (j > 3)); // the cross reads only taps 1 and 2 of such a row
    const int from = pair ? 2 : CROSS ? 0 : 1, to = pair ? 4 : CROSS ? 6 : 5;
    NO_UNROLL
    for (int i = from; i < to; ++i)
        tap[i] = load_history_lanes(p + (i - 2), offsets);
    return filter_taps(tap[0], tap[1], tap[2], tap[3], tap[4], tap[5], w);
}

STAGE row_taps choose_row(mask m, row_taps a, row_taps b)
{
    return (row_taps) { m ? a.middle : b.middle, m ? a.right : b.right, m ? a.sides : b.sides };
}

// Samples a history plane at the footprint. Stored values are finite and never -0, so taps without weight add nothing;
// where all lanes lie on texels they are not read.
STAGE real sample_plane(history_in p, footprint f, weights wx, weights wy, int stride)
{
    history_in q = p + f.at;
    const uint line = (uint)stride;
    row_taps first = { 0 }, last = { 0 };
    if (f.lanes == LANES_ON_TEXELS)
        return load_history(q);
    if (LANES > 1 && f.lanes == LANES_ADJACENT) {
        const mask down = f.step_y != 0;
        const row_taps a = row_adjacent(q - line, wx, f.step_x), b = row_adjacent(q, wx, f.step_x),
                       c = row_adjacent(q + line, wx, f.step_x), d = row_adjacent(q + 2 * line, wx, f.step_x),
                       e = row_adjacent(q + 3 * line, wx, f.step_x);
        if (CROSS) {
            first = choose_row(down, a, row_adjacent(q - 2 * line, wx, f.step_x));
            last = choose_row(down, row_adjacent(q + 4 * line, wx, f.step_x), e);
        }
        return filter_rows(first, choose_row(down, b, a), choose_row(down, c, b), choose_row(down, d, c),
            choose_row(down, e, d), last, wx, wy);
    }
    if (LANES > 1 && f.lanes == LANES_SCATTERED) {
        const whole offsets = lane_offsets(f.dx, f.dy, stride);
        row_taps row[6];
        row[0] = row[5] = first;
        NO_UNROLL
        for (int i = CROSS ? 0 : 1; i < (CROSS ? 6 : 5); ++i)
            row[i] = row_scattered(p + f.own + (i - 2) * (ptrdiff_t)stride, wx, offsets, i);
        return filter_rows(row[0], row[1], row[2], row[3], row[4], row[5], wx, wy);
    }
    if (CROSS) {
        first = row_uniform(ROW_BELOW(p, f.at, -2, stride), wx);
        last = row_uniform(ROW_BELOW(p, f.at, 3, stride), wx);
    }
    return filter_rows(first, row_uniform(ROW_BELOW(p, f.at, -1, stride), wx), row_uniform(q, wx),
        row_uniform(ROW_BELOW(p, f.at, 1, stride), wx), row_uniform(ROW_BELOW(p, f.at, 2, stride), wx), last, wx, wy);
}

// The four texels around the footprint in a plane of floats: count and inverse depth of the previous frame.
typedef struct
{
    real p00, p10, p01, p11;
} quad;

STAGE quad sample_quad(plane_in p, footprint f, int stride)
{
    plane_in q = p + f.at;
    if (LANES > 1 && f.lanes == LANES_ADJACENT) {
        const mask right = f.step_x != 0, down = f.step_y != 0;
        real a = load(q), b = load(q + 1), c = load(q + 2);
        const real a0 = right ? b : a, b0 = right ? c : b;
        a = load(q + stride), b = load(q + stride + 1), c = load(q + stride + 2);
        const real a1 = right ? b : a, b1 = right ? c : b;
        q += 2 * (ptrdiff_t)stride;
        a = load(q), b = load(q + 1), c = load(q + 2);
        const real a2 = right ? b : a, b2 = right ? c : b;
        return (quad) { down ? a1 : a0, down ? b1 : b0, down ? a2 : a1, down ? b2 : b1 };
    }
    if (LANES > 1 && f.lanes == LANES_SCATTERED) {
        const whole offsets = lane_offsets(f.dx, f.dy, stride);
        real texel[4];
        NO_UNROLL
        for (int i = 0; i < 4; ++i)
            texel[i] = load_lanes(p + f.own + (i & 1) + (i >> 1) * (ptrdiff_t)stride, offsets);
        return (quad) { texel[0], texel[1], texel[2], texel[3] };
    }
    return (quad) { load(q), load(q + 1), load(q + stride), load(q + stride + 1) };
}

// Loads the texel at the footprint's integer position.
STAGE real texel_at(plane_in p, footprint f, int stride)
{
    plane_in q = p + f.at;
    if (LANES > 1 && f.lanes == LANES_ADJACENT) {
        const mask right = f.step_x != 0, down = f.step_y != 0;
        const real a = right ? load(q + 1) : load(q), b = right ? load(q + stride + 1) : load(q + stride);
        return down ? b : a;
    }
    if (LANES > 1 && f.lanes == LANES_SCATTERED)
        return load_lanes(p + f.own, lane_offsets(f.dx, f.dy, stride));
    return load(q);
}

// Loads the corners of the 4x4 around the footprint. A feature in the 4x4 that is at least two texels wide covers a
// corner or one of the four middle texels.
STAGE quad sample_corners(plane_in p, footprint f, int stride)
{
    plane_in above = p - stride, below = p + 2 * (ptrdiff_t)stride;
    return (quad) { texel_at(above - 1, f, stride), texel_at(above + 2, f, stride), texel_at(below - 1, f, stride),
        texel_at(below + 2, f, stride) };
}

STAGE real bilinear(quad t, footprint f)
{
    if (f.lanes == LANES_ON_TEXELS)
        return t.p00;
    const real top = t.p00 + f.fx * (t.p10 - t.p00), bottom = t.p01 + f.fx * (t.p11 - t.p01);
    return top + f.fy * (bottom - top);
}
