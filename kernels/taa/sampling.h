// Reading the previous frame between its texels.
#include "taa/history_filter.h"
#include "taa/reprojection.h"
#include "platform/storage.h"

#if !defined(CAMERA_MOTION) || !defined(OWN_MOTION)
#error "sampling.h needs CAMERA_MOTION and OWN_MOTION from the prelude"
#endif

// How the lanes of a segment lie in the previous frame: all on texels and moved by one whole number of them
// (ON_TEXELS), between texels of one row (ON_ROWS), between texels with one whole part (ALIKE), with whole parts that
// differ by at most 1 an axis (CLOSE), or freely (APART). The values read are the same in each case, only the loads
// differ. What stands still lies on texels.
#define LANES_ON_TEXELS 0
#define LANES_ON_ROWS 1
#define LANES_ALIKE 2
#define LANES_CLOSE 3
#define LANES_APART 4

typedef struct
{
    whole dx, dy; // whole part of the displacement, a lane
    real fx, fy; // fraction in [0, 1)
    whole step_x, step_y; // lane's whole part minus the segment's: 0 or 1, where CLOSE
    uint own, at; // texels of a plane: the segment's own, and where its whole displacement takes it
    int lanes;
} footprint;

STAGE footprint footprint_of(motion_t m, mask valid, uint at, frame_t frame)
{
    footprint f;
    const real u = valid ? m.u : SPLAT(0.0), v = valid ? m.v : SPLAT(0.0);
    f.fx = u - floor_and_whole(u, &f.dx);
    f.fy = v - floor_and_whole(v, &f.dy);
    scalar_whole x = first_lane(f.dx), y = first_lane(f.dy);
    f.lanes = LANES_ALIKE;
    f.step_x = f.step_y = (whole)(0);
#if LANES > 1
    // Not on a GPU, which waits for each load behind a branch, but reads what lies before the first all at once.
    if (!any_of(f.fy != SPLAT(0.0)))
        f.lanes = any_of(f.fx != SPLAT(0.0)) ? LANES_ON_ROWS : LANES_ON_TEXELS;
    if (any_of((f.dx ^ x) | (f.dy ^ y))) {
        x -= any_of(f.dx < x) ? 1 : 0;
        y -= any_of(f.dy < y) ? 1 : 0;
        f.step_x = f.dx - x;
        f.step_y = f.dy - y;
        f.lanes = any_of((f.step_x | f.step_y) & ~(whole)(1)) ? LANES_APART : LANES_CLOSE;
    }
#endif
    f.own = at;
    f.at = at + (uint)((int)y * row_stride(frame) + (int)x);
    return f;
}

// Where nothing moves: said outright, since not every compiler sees through the conversions of footprint_of.
STAGE footprint own_texel(uint at)
{
    const whole no = (whole)(0);
    const footprint f = { no, no, SPLAT(0.0), SPLAT(0.0), no, no, at, at, LANES_ON_TEXELS };
    return f;
}

// One row of taps around p, weighed along x. p points at tap 1 of the segment.
STAGE row_taps row_alike(history_in p, weights w)
{
    real first = SPLAT(0.0), last = SPLAT(0.0);
    if (SIX_TAPS) {
        first = load_history(p - 2);
        last = load_history(p + 3);
    }
    return weigh(first, load_history(p - 1), load_history(p), load_history(p + 1), load_history(p + 2), last, w);
}

#if LANES > 1
STAGE row_taps row_close(history_in p, weights w, whole step)
{
    const mask right = step != 0;
    const real a = load_history(p - 1), b = load_history(p), c = load_history(p + 1), d = load_history(p + 2),
               e = load_history(p + 3);
    real first = SPLAT(0.0), last = SPLAT(0.0);
    if (SIX_TAPS) {
        first = right ? a : load_history(p - 2);
        last = right ? load_history(p + 4) : e;
    }
    return weigh(first, right ? b : a, right ? c : b, right ? d : c, right ? e : d, last, w);
}

// Texels from the segment's own to each lane's; a plane has less than 2^31.
STAGE whole steps_apart(whole dx, whole dy, int stride) { return dy * stride + dx + (whole)(LANE_NUMBERS); }

// The texels of a plane of floats that lie `steps` from p.
STAGE real texels_apart(plane_in p, whole steps)
{
#if GATHERS
    return __builtin_ia32_gathersiv16sf(SPLAT(0.0), (const void*)(size_t)p, steps, (ushort)0xffff, sizeof(float));
#else
    real v;
    for (int lane = 0; lane < LANES; ++lane)
        ((scalar*)&v)[lane] = p[((const scalar_whole*)&steps)[lane]];
    return v;
#endif
}

#if STORAGE_HALF && CONVERTS_HALVES && LANES == 8
// Halves read as bits, all converted by one instruction. What is rare is called: written out it took registers from the
// rest, as long as the calls of eight conversions had not.
static __attribute__((noinline)) real history_apart(history_in p, whole steps)
{
    LANED(short) halves;
    for (int lane = 0; lane < LANES; ++lane)
        ((short*)&halves)[lane] = ((__global const short*)p)[((const scalar_whole*)&steps)[lane]];
    return from_halves(halves);
}
#elif STORAGE_HALF && CONVERTS_HALVES && GATHERS
// A gather takes words: of each the lower half is the lane's, the upper one the texel right of it.
STAGE real history_apart(history_in p, whole steps)
{
    const whole words = __builtin_ia32_gathersiv16si((whole)(0), (const void*)(size_t)p, steps, (ushort)0xffff, 2);
    return from_halves(__builtin_convertvector(words, short16));
}
#else
STAGE real history_apart(history_in p, whole steps)
{
#if STORAGE_HALF || STORAGE_DOUBLE
    real v;
    for (int lane = 0; lane < LANES; ++lane) {
        history_in q = p + ((const scalar_whole*)&steps)[lane];
#if STORAGE_HALF
        ((scalar*)&v)[lane] = vload_half(0, q);
#else
        ((scalar*)&v)[lane] = (scalar)*q;
#endif
    }
    return v;
#else
    return texels_apart(p, steps);
#endif
}
#endif

// A row of taps; p points at the segment's own. Reading them takes so long that the loops around it cost nothing, and
// written out they were half of what a compiler had to work through.
STAGE row_taps row_apart(history_in p, weights w, whole steps)
{
    real tap[6];
    tap[0] = tap[5] = SPLAT(0.0);
    NO_UNROLL
    for (int i = SIX_TAPS ? 0 : 1; i < (SIX_TAPS ? 6 : 5); ++i)
        tap[i] = history_apart(p + (i - 2), steps);
    return weigh(tap[0], tap[1], tap[2], tap[3], tap[4], tap[5], w);
}

STAGE row_taps choose_row(mask m, row_taps a, row_taps b)
{
    const row_taps v = { m ? a.middle : b.middle, m ? a.sides : b.sides };
    return v;
}
#endif

// The history plane at the footprint. What was stored is finite and never -0: taps
// without weight add nothing to it, and are not read where the whole segment does without them.
STAGE real sample_plane(history_in p, footprint f, weights wx, weights wy, int stride)
{
    history_in q = p + f.at;
    const uint line = (uint)stride;
    row_taps first = NO_TAPS, last = NO_TAPS;
    if (f.lanes == LANES_ON_TEXELS)
        return load_history(q);
    if (f.lanes == LANES_ON_ROWS) {
        const row_taps row = row_alike(q, wx);
        return row.middle + row.sides;
    }
#if LANES > 1
    if (f.lanes == LANES_CLOSE) {
        const mask down = f.step_y != 0;
        const row_taps a = row_close(q - line, wx, f.step_x), b = row_close(q, wx, f.step_x),
                       c = row_close(q + line, wx, f.step_x), d = row_close(q + 2 * line, wx, f.step_x),
                       e = row_close(q + 3 * line, wx, f.step_x);
        if (SIX_TAPS) {
            first = choose_row(down, a, row_close(q - 2 * line, wx, f.step_x));
            last = choose_row(down, row_close(q + 4 * line, wx, f.step_x), e);
        }
        return weigh_rows(first, choose_row(down, b, a), choose_row(down, c, b), choose_row(down, d, c),
            choose_row(down, e, d), last, wx, wy);
    }
    if (f.lanes == LANES_APART) {
        const whole steps = steps_apart(f.dx, f.dy, stride);
        row_taps row[6];
        row[0] = row[5] = first;
        NO_UNROLL
        for (int i = SIX_TAPS ? 0 : 1; i < (SIX_TAPS ? 6 : 5); ++i)
            row[i] = row_apart(p + f.own + (i - 2) * (ptrdiff_t)stride, wx, steps);
        return weigh_rows(row[0], row[1], row[2], row[3], row[4], row[5], wx, wy);
    }
#endif
    if (SIX_TAPS) {
        first = row_alike(ROW_BELOW(p, f.at, -2, stride), wx);
        last = row_alike(ROW_BELOW(p, f.at, 3, stride), wx);
    }
    return weigh_rows(first, row_alike(ROW_BELOW(p, f.at, -1, stride), wx), row_alike(q, wx),
        row_alike(ROW_BELOW(p, f.at, 1, stride), wx), row_alike(ROW_BELOW(p, f.at, 2, stride), wx), last, wx, wy);
}

// The four texels around the footprint in a plane of floats: count and inverse depth of the previous frame.
typedef struct
{
    real p00, p10, p01, p11;
} quad;

STAGE quad sample_quad(plane_in p, footprint f, int stride)
{
    plane_in q = p + f.at;
    quad t;
#if LANES > 1
    if (f.lanes == LANES_CLOSE) {
        const mask right = f.step_x != 0, down = f.step_y != 0;
        real a = load(q), b = load(q + 1), c = load(q + 2);
        const real a0 = right ? b : a, b0 = right ? c : b;
        a = load(q + stride), b = load(q + stride + 1), c = load(q + stride + 2);
        const real a1 = right ? b : a, b1 = right ? c : b;
        q += 2 * (ptrdiff_t)stride;
        a = load(q), b = load(q + 1), c = load(q + 2);
        const real a2 = right ? b : a, b2 = right ? c : b;
        t.p00 = down ? a1 : a0, t.p10 = down ? b1 : b0;
        t.p01 = down ? a2 : a1, t.p11 = down ? b2 : b1;
        return t;
    }
    if (f.lanes == LANES_APART) {
        const whole steps = steps_apart(f.dx, f.dy, stride);
        real texel[4];
        NO_UNROLL
        for (int i = 0; i < 4; ++i)
            texel[i] = texels_apart(p + f.own + (i & 1) + (i >> 1) * (ptrdiff_t)stride, steps);
        const quad apart = { texel[0], texel[1], texel[2], texel[3] };
        return apart;
    }
#endif
    t.p00 = load(q), t.p10 = load(q + 1);
    t.p01 = load(q + stride), t.p11 = load(q + stride + 1);
    return t;
}

STAGE real bilinear(quad t, footprint f)
{
    if (f.lanes == LANES_ON_TEXELS)
        return t.p00;
    const real top = t.p00 + f.fx * (t.p10 - t.p00), bottom = t.p01 + f.fx * (t.p11 - t.p01);
    return top + f.fy * (bottom - top);
}
