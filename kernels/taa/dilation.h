// Dilation beyond the 3x3, as in two engines: Bevy looks at the corners of a 5x5, and Godot reads the motion one texel
// left of and above the nearest depth.
#include "taa/neighbourhood.h"

// `where` true, gives `s` the offset, depth and own motion of the texel (dx, dy) from the pixel at `at`.
STAGE surface take_texel(
    surface s, mask where, plane_in inverse_depth, plane_in motion, int dx, int dy, uint at, frame_t frame)
{
    const ptrdiff_t by = (ptrdiff_t)at + dy * (ptrdiff_t)row_stride(frame) + dx;
    s.inverse_depth = where ? inverse_depth_or_sky(load(inverse_depth + by), frame) : s.inverse_depth;
    s.x = where ? SPLAT(dx) : s.x;
    s.y = where ? SPLAT(dy) : s.y;
    if (OWN_MOTION) {
        s.u = where ? load(motion + by) : s.u;
        s.v = where ? load(motion + by + plane_size(frame)) : s.v;
    }
    return s;
}

STAGE real inverse_depth_at(plane_in inverse_depth, int dx, int dy, uint at, frame_t frame)
{
    return inverse_depth_or_sky(load(inverse_depth + (ptrdiff_t)at + dy * (ptrdiff_t)row_stride(frame) + dx), frame);
}

// Returns the surface of the pixel itself, `s`, or of the texel whose motion it borrows.
STAGE surface borrowed_surface(surface s, plane_in inverse_depth, plane_in motion, int x, int y, frame_t frame)
{
    const uint at = texel_offset(frame, x, y);
    if (DILATION == DILATION_CORNERS) {
        real nearest = s.centre;
        for (int k = 0; k < 4; ++k) {
            const int dx = k & 1 ? 2 : -2, dy = k < 2 ? 2 : -2;
            const real q = inverse_depth_at(inverse_depth, dx, dy, at, frame);
            const mask nearer = q > nearest;
            nearest = nearer ? q : nearest;
            s = take_texel(s, nearer, inverse_depth, motion, dx, dy, at, frame);
        }
        // A texel beyond the image repeats its edge, and moves as the edge does.
        const real px = LANE_INDEX + K(x), py = SPLAT(y);
        s.x = limit(px + s.x, SPLAT(0.0), SPLAT(frame.width) - K(1.0)) - px;
        s.y = limit(py + s.y, SPLAT(0.0), SPLAT(frame.height) - K(1.0)) - py;
    }
    if (DILATION == DILATION_BESIDE) {
        real nearest = SPLAT(frame.sky_inverse_depth);
        s = take_texel(s, (mask)(-1), inverse_depth, motion, -1, -1, at, frame);
        for (int k = 0; k < 9; ++k) {
            const int dx = k % 3 - 1, dy = k / 3 - 1;
            const real q = inverse_depth_at(inverse_depth, dx, dy, at, frame);
            const mask nearer = q > nearest;
            nearest = nearer ? q : nearest;
            s = take_texel(s, nearer, inverse_depth, motion, dx - 1, dy - 1, at, frame);
        }
    }
    return s;
}
