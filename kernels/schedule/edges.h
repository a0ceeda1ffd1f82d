// Edges: repeats the edge of a stored image into its halo, so that filters may read past the image. On a CPU each
// work-item, at its end, repeats the edge that it has stored itself: starting a kernel for that takes longer than the
// work. On a GPU the groups at the edges would end last; there extend_edges_kernel of store.cl does it.
#include "platform/storage.h"

// The block that a work-item has stored: columns x to `end` - 1, rows y to `below` - 1.
typedef struct
{
    int x, end, y, below;
} block_t;

// Loads a segment of a plane in the history's format, or of one of floats.
STAGE real load_stored(history_out halves, plane_out floats, int is_float, uint at)
{
    return is_float ? load(floats + at) : load_history(halves + at);
}

// Stores such a segment back, to the same bits.
STAGE void store_stored(history_out halves, plane_out floats, int is_float, uint at, real v)
{
    if (is_float)
        store(floats + at, v);
    else
        store_again(halves + at, v);
}

// Repeats in a plane the edges that a work-item has stored: left and right of its rows, then above and below, to the
// corners.
STAGE void extend_plane(history_out halves, plane_out floats, int is_float, block_t b, frame_t frame)
{
    const int stride = row_stride(frame), end = stride - PAD_X;
    const int first_column = b.x == 0, last_column = b.end >= frame.width;
    if (first_column) {
        NO_UNROLL
        for (int y = b.y; y < b.below; ++y) {
            const uint row = texel_offset(frame, 0, y);
            const real first = first_lanes(load_stored(halves, floats, is_float, row));
            for (int i = LANES; i <= PAD_X; i += LANES)
                store_stored(halves, floats, is_float, row - (uint)i, first);
        }
    }
    if (last_column) {
        const int x = (frame.width - 1) / LANES * LANES, lane = frame.width - 1 - x;
        NO_UNROLL
        for (int y = b.y; y < b.below; ++y) {
            const uint row = texel_offset(frame, 0, y);
            const real v = load_stored(halves, floats, is_float, row + (uint)x);
            const real last = (real)(((const scalar*)&v)[lane]);
            if (lane < LANES - 1) // its other lanes have stored values beyond the image
                store_stored(halves, floats, is_float, row + (uint)x, (whole)(LANE_NUMBERS) > (whole)(lane) ? last : v);
            NO_UNROLL
            for (int i = x + LANES; i < end; i += LANES)
                store_stored(halves, floats, is_float, row + (uint)i, last);
        }
    }
    NO_UNROLL
    for (int is_last = 0; is_last < 2; ++is_last) {
        const int y = is_last ? frame.height - 1 : 0;
        if ((y < b.y) | (y >= b.below))
            continue;
        NO_UNROLL
        for (int x = first_column ? -PAD_X : b.x; x < (last_column ? end : b.end); x += LANES) {
            const real v = load_stored(halves, floats, is_float, texel_offset(frame, x, y));
            for (int k = 1; k <= PAD_Y; ++k)
                store_stored(halves, floats, is_float, texel_offset(frame, x, is_last ? y + k : y - k), v);
        }
    }
}

// Repeats the image's edges that a CPU's work-item has stored, in `planes` planes of the history's format and in `more`
// planes of floats.
STAGE void extend_stored(history_out halves, int planes, plane_out floats, int more, block_t b, frame_t frame)
{
    if (LANES == 1 || ((b.x > 0) & (b.end < frame.width) & (b.y > 0) & (b.below < frame.height)))
        return;
    NO_UNROLL
    for (int i = 0; i < planes; ++i)
        extend_plane(halves + i * plane_size(frame), 0, 0, b, frame);
    NO_UNROLL
    for (int i = 0; i < more; ++i)
        extend_plane(0, floats + i * plane_size(frame), 1, b, frame);
}
