// Keeps a surface's own motion alone: where depth and camera explain a motion vector, kernels that follow a surface
// from frame to frame take the camera's motion, which adds up no error, instead of a chain of vectors.
#include "taa/reprojection.h"

// True where the vector (u, v) is the camera's motion of a point `by` pixels beside the sample, at the sample's depth.
STAGE mask is_camera_motion(real u, real v, real inverse_depth, real x, real y, real by_x, real by_y, frame_t frame)
{
    surface s;
    s.x = by_x, s.y = by_y;
    s.inverse_depth = inverse_depth;
    const motion_t m = motion_from_depth(s, x, y, frame);
    const real off = greater(absolute(u - m.u), absolute(v - m.v)), length = greater(absolute(u), absolute(v));
    return m.visible & (off <= K(CAMERA_TOLERANCE) + K(CAMERA_SHARE) * length);
}

// Tools write the vector of the sample, or of the pixel's centre.
__kernel void own_motion_kernel(plane_in inverse_depth, plane_in motion, plane_out own, const frame_t frame)
{
    const int x = (int)get_global_id(0) * LANES, y = (int)get_global_id(1);
    if (x >= frame.width || y >= frame.height)
        return;
    const size_t plane = plane_size(frame);
    const uint at = texel_offset(frame, x, y);
    const real u = load(motion + at), v = load(motion + plane + at), column = LANE_INDEX + K(x), row = SPLAT(y);
    const real q = inverse_depth_or_sky(load(inverse_depth + at), frame), zero = SPLAT(0.0);
    const mask camera = is_camera_motion(u, v, q, column, row, zero, zero, frame)
        | is_camera_motion(u, v, q, column, row, SPLAT(-frame.jitter_x), SPLAT(-frame.jitter_y), frame);
    const mask dropped = camera & !(outside_domain(u) | outside_domain(v));
    store(own + at, dropped ? SPLAT(INFINITY) : u);
    store(own + plane + at, dropped ? SPLAT(INFINITY) : v);
}
