// Reading the previous frame between its texels.
#if !defined(HISTORY_FILTER) || !defined(CAMERA_MOTION) || !defined(OWN_MOTION)
#error "sampling.h needs HISTORY_FILTER, CAMERA_MOTION and OWN_MOTION from the prelude"
#endif

// How the lanes of a segment lie in the previous frame: all moved by one whole number of texels (ALIKE), by numbers
// that differ by at most 1 a axis (CLOSE), or freely (APART). The values read are the same in each case, only the loads
// differ.
#define LANES_ALIKE 0
#define LANES_CLOSE 1
#define LANES_APART 2

typedef struct
{
    whole dx, dy; // whole part of the displacement, a lane
    real fx, fy; // fraction in [0, 1)
    whole step_x, step_y; // lane's whole part minus the segment's: 0 or 1, where CLOSE
    ptrdiff_t offset; // of the segment's whole displacement
    int lanes;
} footprint;

STAGE footprint footprint_of(motion_t m, mask valid, frame_t frame)
{
    footprint f;
    const real u = valid ? m.u : SPLAT(0.0), v = valid ? m.v : SPLAT(0.0);
    f.dx = floor_whole(u);
    f.dy = floor_whole(v);
    f.fx = u - TO_REAL(f.dx);
    f.fy = v - TO_REAL(f.dy);
    scalar_whole x = first_lane(f.dx), y = first_lane(f.dy);
    f.lanes = LANES_ALIKE;
    f.step_x = f.step_y = (whole)(0);
#if LANES > 1
    if (any_of((f.dx ^ x) | (f.dy ^ y))) {
        x -= any_of(f.dx < x) ? 1 : 0;
        y -= any_of(f.dy < y) ? 1 : 0;
        f.step_x = f.dx - x;
        f.step_y = f.dy - y;
        f.lanes = any_of((f.step_x | f.step_y) & ~(whole)(1)) ? LANES_APART : LANES_CLOSE;
    }
#endif
    f.offset = (ptrdiff_t)y * frame.stride + (ptrdiff_t)x;
    return f;
}

// Weights of the Catmull-Rom spline (Catmull and Rom 1974, tension 1/2) at fraction t, without the one of tap 1: the
// filter is applied to differences from tap 1, so that equal taps give exactly their value, and t = 0 exactly tap 1.
typedef struct
{
    real w0, w2, w3;
} weights;

STAGE weights catmull_rom(real t)
{
    weights w;
    w.w0 = t * (K(-0.5) + t * (K(1.0) - K(0.5) * t));
    w.w2 = t * (K(0.5) + t * (K(2.0) - K(1.5) * t));
    w.w3 = (t * t) * (K(-0.5) + K(0.5) * t);
    return w;
}

// Bilinear as the same sum: only tap 2 has a weight.
STAGE weights linear(real t)
{
    weights w = { SPLAT(0.0), t, SPLAT(0.0) };
    return w;
}

STAGE weights nearest(real t)
{
    weights w = { SPLAT(0.0), t >= SPLAT(0.5) ? SPLAT(1.0) : SPLAT(0.0), SPLAT(0.0) };
    return w;
}

STAGE weights history_weights(real t)
{
    if (HISTORY_FILTER == HISTORY_FILTER_NEAREST)
        return nearest(t);
    if (HISTORY_FILTER == HISTORY_FILTER_BILINEAR)
        return linear(t);
    return catmull_rom(t);
}

STAGE real weigh(real p0, real p1, real p2, real p3, weights w)
{
    if (HISTORY_FILTER == HISTORY_FILTER_CATMULL_ROM)
        return p1 + ((w.w0 * (p0 - p1) + w.w2 * (p2 - p1)) + w.w3 * (p3 - p1));
    return p1 + w.w2 * (p2 - p1);
}

// One row of taps around p, weighed along x. p points at tap 1 of the segment.
STAGE real row_alike(history_in p, weights w)
{
    return weigh(load_history(p - 1), load_history(p), load_history(p + 1), load_history(p + 2), w);
}

#if LANES > 1
STAGE real row_close(history_in p, weights w, whole step)
{
    const mask right = step != 0;
    const real a = load_history(p - 1), b = load_history(p), c = load_history(p + 1), d = load_history(p + 2),
               e = load_history(p + 3);
    return weigh(right ? b : a, right ? c : b, right ? d : c, right ? e : d, w);
}

STAGE real gather(history_in p, whole dx, whole dy, int stride)
{
    real v;
    for (int lane = 0; lane < LANES; ++lane) {
        history_in q
            = p + (ptrdiff_t)((const scalar_whole*)&dy)[lane] * stride + ((const scalar_whole*)&dx)[lane] + lane;
#if STORAGE_HALF
        ((scalar*)&v)[lane] = vload_half(0, q);
#else
        ((scalar*)&v)[lane] = *q;
#endif
    }
    return v;
}

STAGE real row_apart(history_in p, weights w, footprint f, int row, int stride)
{
    const whole dy = f.dy + row;
    return weigh(gather(p, f.dx - 1, dy, stride), gather(p, f.dx, dy, stride), gather(p, f.dx + 1, dy, stride),
        gather(p, f.dx + 2, dy, stride), w);
}
#endif

// The history plane at the footprint. p points at the segment's own texel.
STAGE real sample_plane(history_in p, footprint f, weights wx, weights wy, int stride)
{
    history_in q = p + f.offset;
#if LANES > 1
    if (f.lanes == LANES_CLOSE) {
        const mask down = f.step_y != 0;
        const real a = row_close(q - stride, wx, f.step_x), b = row_close(q, wx, f.step_x),
                   c = row_close(q + stride, wx, f.step_x), d = row_close(q + 2 * (ptrdiff_t)stride, wx, f.step_x),
                   e = row_close(q + 3 * (ptrdiff_t)stride, wx, f.step_x);
        return weigh(down ? b : a, down ? c : b, down ? d : c, down ? e : d, wy);
    }
    if (f.lanes == LANES_APART)
        return weigh(row_apart(p, wx, f, -1, stride), row_apart(p, wx, f, 0, stride), row_apart(p, wx, f, 1, stride),
            row_apart(p, wx, f, 2, stride), wy);
#endif
    return weigh(row_alike(q - stride, wx), row_alike(q, wx), row_alike(q + stride, wx),
        row_alike(q + 2 * (ptrdiff_t)stride, wx), wy);
}

// The four texels around the footprint in a plane of floats: count and closeness of the previous frame.
typedef struct
{
    real p00, p10, p01, p11;
} quad;

#if LANES > 1
STAGE real texel_apart(plane_in p, footprint f, int column, int row, int stride)
{
    real v;
    for (int lane = 0; lane < LANES; ++lane)
        ((scalar*)&v)[lane] = p[((ptrdiff_t)((const scalar_whole*)&f.dy)[lane] + row) * stride
            + ((const scalar_whole*)&f.dx)[lane] + column + lane];
    return v;
}
#endif

STAGE quad sample_quad(plane_in p, footprint f, int stride)
{
    plane_in q = p + f.offset;
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
        t.p00 = texel_apart(p, f, 0, 0, stride), t.p10 = texel_apart(p, f, 1, 0, stride);
        t.p01 = texel_apart(p, f, 0, 1, stride), t.p11 = texel_apart(p, f, 1, 1, stride);
        return t;
    }
#endif
    t.p00 = load(q), t.p10 = load(q + 1);
    t.p01 = load(q + stride), t.p11 = load(q + stride + 1);
    return t;
}

STAGE real bilinear(quad t, footprint f)
{
    const real top = t.p00 + f.fx * (t.p10 - t.p00), bottom = t.p01 + f.fx * (t.p11 - t.p01);
    return top + f.fy * (bottom - top);
}
