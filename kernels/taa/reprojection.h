// Reprojection: where a surface was in the previous frame.
#include "taa/dilation.h"

// Displacement to the previous frame in pixels, x right, y down; visible = 0 where the previous frame did not see the
// point; previous inverse depth = inverse depth * scale + shift (shift is 0 for a perspective camera).
typedef struct
{
    real u, v, scale, shift;
    mask visible;
} motion_t;

// Camera motion. With p = (px, py, inverse depth, 1), px and py in pixels from the image centre, the previous position
// is (p_xy + D_xy p) / (1 + D_w p), so the displacement is (D_xy p - p_xy (D_w p)) / (1 + D_w p). The host builds D in
// float64 and rounds it once; it is exactly 0 for a still camera, and so is the displacement. docs/conventions.md,
// Matrices.
STAGE motion_t motion_from_depth(surface s, real x, real y, frame_t frame)
{
    motion_t m = { SPLAT(0.0), SPLAT(0.0), SPLAT(1.0), SPLAT(0.0), (mask)(-1) };
    if (!CAMERA_MOTION)
        return m;
    const real px = (x + s.x) + K(frame.origin_x), py = (y + s.y) + K(frame.origin_y), q = s.inverse_depth;
    const real dx = ((K(frame.xx) * px + K(frame.xy) * py) + K(frame.xq) * q) + K(frame.x1);
    const real dy = ((K(frame.yx) * px + K(frame.yy) * py) + K(frame.yq) * q) + K(frame.y1);
    const real dw = ((K(frame.wx) * px + K(frame.wy) * py) + K(frame.wq) * q) + K(frame.w1);
    const real w = SPLAT(1.0) + dw;
    // Behind the previous camera, or so near its plane that the division means nothing: it cannot have been seen.
    m.visible = w > SPLAT(LEAST_W);
    const real safe_w = m.visible ? w : SPLAT(1.0);
    const real by = divisor(safe_w);
    m.u = over(dx - px * dw, by);
    m.v = over(dy - py * dw, by);
    if (ORTHOGRAPHIC) {
        m.scale = SPLAT(1.0) + K(frame.zq);
        m.shift = (K(frame.zx) * px + K(frame.zy) * py) + K(frame.z1);
    } else {
        m.scale = over(SPLAT(1.0), by);
    }
    return m;
}

// The surface's motion: its own where the motion channel holds a vector, the camera's elsewhere.
STAGE motion_t surface_motion(surface s, real x, real y, frame_t frame)
{
    motion_t m = motion_from_depth(s, x, y, frame);
    if (OWN_MOTION) {
        const mask camera_only = outside_domain(s.u) | outside_domain(s.v);
        m.u = camera_only ? m.u : s.u;
        m.v = camera_only ? m.v : s.v;
        m.scale = camera_only ? m.scale : SPLAT(1.0);
        m.shift = camera_only ? m.shift : SPLAT(0.0);
        m.visible = m.visible | !camera_only;
    }
    if (DILATION == DILATION_BESIDE) {
        const mask beyond = (x + s.x < SPLAT(0.0)) | (y + s.y < SPLAT(0.0));
        m.u = beyond ? SPLAT(0.0) : m.u;
        m.v = beyond ? SPLAT(0.0) : m.v;
    }
    return m;
}

// Shortens a displacement that ends outside [0, last] of its axis so that it ends on the edge; others keep their bits.
STAGE real to_edge(real position, real by, real last)
{
    const real there = position + by, shortened = there > last ? last - position : by;
    return there < SPLAT(0.0) ? -position : shortened;
}

// Clamps the reprojected position to the previous image, if the preset reads history at the edge there.
STAGE motion_t motion_to_edge(motion_t m, real x, real y, frame_t frame)
{
    if (OFF_SCREEN == OFF_SCREEN_FRESH)
        return m;
    const mask near = (absolute(m.u) < SPLAT(MOTION_LIMIT)) & (absolute(m.v) < SPLAT(MOTION_LIMIT));
    m.u = near ? to_edge(x, m.u, SPLAT(frame.width) - K(1.0)) : m.u;
    m.v = near ? to_edge(y, m.v, SPLAT(frame.height) - K(1.0)) : m.v;
    return m;
}
