// Repeats the edge of PLANES planes into their halo, so that filters may read past the image. On a CPU one work-item a
// row and plane. On a GPU one a halo texel and plane: first the PAD_Y rows above and below, over the whole stride, then
// the columns left and right of each row inside.
#include "image.h"

// Texels are copied as they are; halves as bits, since a device may lack arithmetic on them.
#if STORAGE_HALF
typedef __global ushort* texels;
#elif STORAGE_DOUBLE
typedef __global double* texels;
#else
typedef __global float* texels;
#endif

STAGE int limit_index(int v, int last) { return v < 0 ? 0 : (v > last ? last : v); }

#if LANES > 1
__kernel void extend_edges_kernel(history_out image, const frame_t frame, const int planes)
{
    const int y = (int)get_global_id(0) - PAD_Y, plane = (int)get_global_id(1);
    if (y >= frame.height + PAD_Y || plane >= planes)
        return;
    texels p = (texels)image + (size_t)plane * plane_size(frame);
    texels from = p + texel_offset(frame, 0, limit_index(y, frame.height - 1)), to = p + texel_offset(frame, 0, y);
    if (from != to)
        for (int x = 0; x < frame.width; ++x)
            to[x] = from[x];
    for (int x = -PAD_X; x < 0; ++x)
        to[x] = from[0];
    for (int x = frame.width; x < row_stride(frame) - PAD_X; ++x)
        to[x] = from[frame.width - 1];
}
#else
__kernel void extend_edges_kernel(history_out image, const frame_t frame, const int planes)
{
    const int i = (int)get_global_id(0), plane = (int)get_global_id(1);
    const int whole_rows = 2 * PAD_Y * frame.stride, columns = frame.stride - frame.width;
    const int rest = i - whole_rows;
    if (rest >= frame.height * columns || plane >= planes)
        return;
    int x, y;
    if (rest < 0) {
        const int row = i / frame.stride;
        x = i - row * frame.stride - PAD_X;
        y = row < PAD_Y ? row - PAD_Y : frame.height + (row - PAD_Y);
    } else {
        y = rest / columns;
        const int column = rest - y * columns;
        x = column < PAD_X ? column - PAD_X : frame.width + (column - PAD_X);
    }
    texels p = (texels)image + (size_t)plane * plane_size(frame);
    const uint from = texel_offset(frame, limit_index(x, frame.width - 1), limit_index(y, frame.height - 1));
    p[texel_offset(frame, x, y)] = p[from];
}
#endif
