// Images: planes of floats with a halo of PAD_X columns left and right and PAD_Y rows above and below, one stride for
// all. The halo repeats the edge, so that no window or filter clamps coordinates, and every device reads the same
// layout.
//
// A large image may be resolved in bands: input and output planes then hold band_rows rows from first_row on (and the
// rows around them), while the history is whole. Coordinates are always those of the image.
#include "platform/real.h"

// Clamps v to 0 ... last.
STAGE int limit_index(int v, int last) { return v < 0 ? 0 : (v > last ? last : v); }

STAGE int band_rows(frame_t frame) { return frame.band_rows > 0 ? frame.band_rows : frame.height; }

// Texels from one row to the next: a constant where the kernels are built for one size, or one width of bands.
STAGE int row_stride(frame_t frame) { return STRIDE > 0 ? STRIDE : frame.stride; }

// Texels from one plane to the next: a constant where the kernels are built for one size, which is no band then.
STAGE size_t plane_size(frame_t frame)
{
    return PLANE > 0 ? (size_t)PLANE : (size_t)row_stride(frame) * (size_t)(band_rows(frame) + 2 * PAD_Y);
}

// Offset of a texel in its plane. In 32 bits, since a GPU has no wider integers; a plane has less than 2^31 texels.
STAGE uint texel_offset(frame_t frame, int x, int y)
{
    return (uint)(y - frame.first_row + PAD_Y) * (uint)row_stride(frame) + (uint)(x + PAD_X);
}

STAGE size_t history_plane_size(frame_t frame)
{
    return PLANE > 0 ? (size_t)PLANE : (size_t)row_stride(frame) * (size_t)(frame.height + 2 * PAD_Y);
}

STAGE uint history_offset(frame_t frame, int x, int y)
{
    return (uint)(y + PAD_Y) * (uint)row_stride(frame) + (uint)(x + PAD_X);
}

// Points to the texel of plane p that lies `rows` rows below the one at `at`. With a constant stride a load takes the
// step for free; else it is computed in 32 bits, since a GPU has no wider integers.
#define ROW_BELOW(p, at, rows, stride)                                                                                 \
    (STRIDE > 0 ? (p) + (at) + (ptrdiff_t)(rows) * STRIDE : (p) + ((at) + (uint)((rows) * (stride))))
