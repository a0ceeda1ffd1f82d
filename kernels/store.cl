// After the resolve: repeat a result's edges into its halo.
#include "platform/image.h"
#include "platform/storage.h"

// Texels are copied as they are; halves as bits, since a device may lack arithmetic on them.
#if STORAGE_HALF
typedef __global ushort* texels;
#elif STORAGE_DOUBLE
typedef __global double* texels;
#else
typedef __global float* texels;
#endif

#define ROW_ITEMS (2 * PAD_X)

// Copies the texel at `from` of a plane, counted over both kinds of planes, to `to`.
STAGE void copy_texel(history_out image, plane_out floats, int plane, int planes, uint from, uint to, frame_t frame)
{
    if (plane < planes) {
        texels p = (texels)image + (size_t)plane * plane_size(frame);
        p[to] = p[from];
    } else {
        plane_out p = floats + (size_t)(plane - planes) * plane_size(frame);
        p[to] = p[from];
    }
}

// Repeats the edges of `planes` planes in the history's format and of `more` planes of floats into their halo, so that
// filters may read past the image. One launch does all, since it costs a GPU more than this work. Each plane has a
// work-item a column for the rows above, and one for those below; then ROW_ITEMS a row, which share its texels left and
// right of the image. A CPU's kernels do it themselves (edges.h).
__kernel void extend_edges_kernel(
    history_out image, plane_out floats, const frame_t frame, const int planes, const int more)
{
    const int i = (int)get_global_id(0), plane = (int)get_global_id(1);
    if (plane >= planes + more)
        return;
    const int stride = row_stride(frame), last = frame.height - 1, right = frame.width - 1;
    const int rest = i - 2 * stride, y = rest / ROW_ITEMS;
    if (rest < 0) {
        const int below = i >= stride, x = i - (below ? stride : 0) - PAD_X;
        const uint from = texel_offset(frame, limit_index(x, right), below ? last : 0);
        for (int row = 1; row <= PAD_Y; ++row)
            copy_texel(image, floats, plane, planes, from, texel_offset(frame, x, below ? last + row : -row), frame);
    } else if (y <= last)
        for (int k = rest % ROW_ITEMS; k < stride - frame.width; k += ROW_ITEMS) {
            const int x = k < PAD_X ? k - PAD_X : frame.width + (k - PAD_X);
            copy_texel(image, floats, plane, planes, texel_offset(frame, limit_index(x, right), y),
                texel_offset(frame, x, y), frame);
        }
}
