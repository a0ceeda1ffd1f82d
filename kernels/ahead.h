// Reading ahead. Work-items walk down their columns, and nothing in a CPU foresees steps of a whole row: without this,
// half of the time would pass in waiting for memory. In each row a work-item starts to fetch what lies right of its own
// texels ROWS_AHEAD rows below. Its own filters read some of that, and the next work-item all of it. An address beyond
// the image is harmless: nothing is read, nothing fails. On a GPU it is the next row that the work-item itself has not
// read yet.
#include "image.h"

#define ROWS_AHEAD (LANES > 1 ? 4 : 2)

STAGE void fetch_frame(plane_in current, plane_in closeness, plane_in motion, int x, int y, frame_t frame)
{
    const size_t plane = plane_size(frame);
    // From the row that is read next: a GPU has worked out where that is.
    const uint at = texel_offset(frame, x, y + 1);
    const int rows = ROWS_AHEAD - 1, stride = row_stride(frame);
    FETCH_NEXT(ROW_BELOW(current, at, rows, stride));
    FETCH_NEXT(ROW_BELOW(current + plane, at, rows, stride));
    FETCH_NEXT(ROW_BELOW(current + 2 * plane, at, rows, stride));
    FETCH_NEXT(ROW_BELOW(closeness, at, rows, stride));
    if (OWN_MOTION) {
        FETCH_NEXT(ROW_BELOW(motion, at, rows, stride));
        FETCH_NEXT(ROW_BELOW(motion + plane, at, rows, stride));
    }
}

// Below the texel at `at`: the pixel's own on a CPU, as if nothing moved, for what moves was fetched that many rows
// earlier or later, still ahead of its use as a rule; on a GPU the one that the pixel came from.
STAGE void fetch_history(history_in history, plane_in count, plane_in previous_closeness, uint at, frame_t frame)
{
    const size_t plane = history_plane_size(frame);
    const int rows = ROWS_AHEAD + 1, stride = row_stride(frame);
    FETCH_NEXT(ROW_BELOW(history, at, rows, stride));
    FETCH_NEXT(ROW_BELOW(history + plane, at, rows, stride));
    FETCH_NEXT(ROW_BELOW(history + 2 * plane, at, rows, stride));
    FETCH_NEXT(ROW_BELOW(count, at, rows, stride));
    if (REJECT == REJECT_DEPTH)
        FETCH_NEXT(ROW_BELOW(previous_closeness, at, rows, stride));
}
