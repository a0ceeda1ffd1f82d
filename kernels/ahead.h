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
    const uint at = texel_offset(frame, x, y + ROWS_AHEAD);
    FETCH_NEXT(current + at);
    FETCH_NEXT(current + plane + at);
    FETCH_NEXT(current + 2 * plane + at);
    FETCH_NEXT(closeness + at);
    if (OWN_MOTION) {
        FETCH_NEXT(motion + at);
        FETCH_NEXT(motion + plane + at);
    }
}

// As if nothing moved: what moves was fetched that many rows earlier or later, still ahead of its use as a rule.
STAGE void fetch_history(history_in history, plane_in count, plane_in previous_closeness, int x, int y, frame_t frame)
{
    const size_t plane = history_plane_size(frame);
    const uint at = history_offset(frame, x, y + ROWS_AHEAD + 1);
    FETCH_NEXT(history + at);
    FETCH_NEXT(history + plane + at);
    FETCH_NEXT(history + 2 * plane + at);
    FETCH_NEXT(count + at);
    if (REJECT == REJECT_DEPTH)
        FETCH_NEXT(previous_closeness + at);
}
