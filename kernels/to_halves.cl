// The result in halves, as a file holds them: each channel rounded to the nearest. From the largest half on it becomes
// infinite, by which the host finds what is cut and limits it (halves.py). A work-item takes every so many segments of
// its row as there are work-items to the row: on a CPU all of them.
#include "platform/image.h"
#include "platform/storage.h"

// Twice as much from the largest half on, which is beyond all of them.
STAGE floats beyond_halves(floats v)
{
    const floats most = (floats)((float)HALF_LIMIT);
    return ((v >= most) | (v <= -most)) ? v + v : v;
}

__kernel void to_halves_kernel(history_in image, __global half* restrict halves, const frame_t frame, const int planes)
{
    const int row = (int)get_global_id(1), first = (int)get_global_id(0) * LANES;
    if (row >= band_rows(frame))
        return;
    for (int plane = 0; plane < planes; ++plane)
        for (int x = first; x < frame.width; x += (int)get_global_size(0) * LANES) {
            const size_t at = (size_t)plane * plane_size(frame) + texel_offset(frame, x, frame.first_row + row);
            store_halves(halves + at, beyond_halves(TO_FLOATS(load_history(image + at))));
        }
}
