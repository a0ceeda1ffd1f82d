// Repeats the edge of PLANES planes into their halo, so that filters may read past the image. One work-item a halo
// texel: first the PAD_Y rows above and below, over the whole stride, then PAD_X columns left and right of each row.
#include "real.h"
#include "image.h"

// Texels are copied as they are; halves as bits, since a device may lack arithmetic on them.
#if STORAGE_HALF
typedef __global ushort* texels;
#else
typedef __global float* texels;
#endif

STAGE int limit_index(int v, int last) { return v < 0 ? 0 : (v > last ? last : v); }

__kernel void extend_edges_kernel(history_out image, const frame_t frame, const int planes)
{
    const int i = (int)get_global_id(0), row = (int)get_global_id(1), plane = (int)get_global_id(2);
    const int y = row - PAD_Y;
    const int inside_rows = y >= 0 && y < frame.height;
    // Rows inside the image have their halo columns only; the others their whole stride.
    const int columns = inside_rows ? frame.stride - frame.width : frame.stride;
    if (row >= frame.height + 2 * PAD_Y || plane >= planes || i >= columns)
        return;
    const int x = inside_rows ? (i < PAD_X ? i - PAD_X : frame.width + (i - PAD_X)) : i - PAD_X;
    texels p = (texels)image + (size_t)plane * plane_size(frame);
    const size_t from = texel_offset(frame, limit_index(x, frame.width - 1), limit_index(y, frame.height - 1));
    p[texel_offset(frame, x, y)] = p[from];
}
