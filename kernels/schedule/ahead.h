// Software prefetch. Work-items walk down their columns, and no CPU predicts steps of a whole row: without this, half
// of the time would be spent waiting for memory. In each row a work-item prefetches what lies right of its own texels
// ROWS_AHEAD rows below. Its own filters read some of that, and the next work-item all of it. An address beyond the
// image is harmless: nothing is read, nothing fails. A GPU prefetches the next row that the work-item itself has not
// read yet.
//
// COLUMNS_AHEAD: a core has few slots for lines in flight to its first-level cache, a line from memory keeps its slot
// for long, and a load from the second level needs one too. So a CPU's work-item prefetches texels COLUMNS_AHEAD
// work-items right of it into the second level alone, and its own next texels and those right of them from there into
// the first. FAR_FIRST: the far ones into the first as well. On a Zen 5, texels prefetched into the second level alone
// arrived too late once a walk had fallen behind, and it did not catch up.
#include "platform/prefetch.h"

#define ROWS_AHEAD (LANES > 1 ? (FAR_FIRST ? 3 : 4) : 2)

STAGE void prefetch_frame(plane_in current, plane_in inverse_depth, plane_in motion, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame);
    // From the row that is read next, whose address a GPU has already computed.
    const uint at = texel_offset(frame, x, y + 1);
    enum { ROWS_BELOW = ROWS_AHEAD - 1 };
    const int stride = row_stride(frame);
    PREFETCH_BELOW(current, at, ROWS_BELOW, stride);
    PREFETCH_BELOW(current + plane, at, ROWS_BELOW, stride);
    PREFETCH_BELOW(current + 2 * plane, at, ROWS_BELOW, stride);
    PREFETCH_BELOW(inverse_depth, at, ROWS_BELOW, stride);
    if (OWN_MOTION) {
        PREFETCH_BELOW(motion, at, ROWS_BELOW, stride);
        PREFETCH_BELOW(motion + plane, at, ROWS_BELOW, stride);
    }
}

// Prefetches below the texel at `at`: on a GPU the reprojected one, on a CPU the pixel's own, as if nothing moved: with
// motion a line arrives some rows earlier or later, as a rule still ahead of its use.
STAGE void prefetch_history(history_in history, plane_in count, plane_in previous_inverse_depth, uint at, frame_t frame)
{
    const size_t plane = history_plane_size(frame);
    enum { ROWS_BELOW = ROWS_AHEAD + 1 };
    const int stride = row_stride(frame);
    PREFETCH_BELOW(history, at, ROWS_BELOW, stride);
    PREFETCH_BELOW(history + plane, at, ROWS_BELOW, stride);
    PREFETCH_BELOW(history + 2 * plane, at, ROWS_BELOW, stride);
    PREFETCH_BELOW(count, at, ROWS_BELOW, stride);
    if (REJECT == REJECT_DEPTH)
        PREFETCH_BELOW(previous_inverse_depth, at, ROWS_BELOW, stride);
}

// Prefetches below the texel at `at` in each of `count` planes: what the next row will read of frames in the ring,
// unless motion varies wildly, and of temporal windows.
STAGE void prefetch_planes(plane_in first, int count, uint at, frame_t frame)
{
    enum { ROWS_BELOW = 2 };
    for (int i = 0; i < count; ++i)
        PREFETCH_BELOW(first + i * plane_size(frame), at, ROWS_BELOW, row_stride(frame));
}
