// How a work-item walks: it slides a segment of LANES pixels down ROWS rows and carries the 3x3 around it along, so
// that each row of the frame is read and converted once.
#include "schedule/ahead.h"
#include "schedule/edges.h"
#include "taa/neighbourhood.h"

// The pixels of a work-item: the segment at x in rows `first` to `end` - 1; none where they lie beyond the image.
typedef struct
{
    int x, first, end;
} column_t;

STAGE column_t own_column(frame_t frame)
{
    const int first = frame.first_row + (int)get_global_id(1) * ROWS;
    const int below_band = frame.first_row + band_rows(frame);
    const int end = below_band < frame.height ? below_band : frame.height;
    return (column_t) { (int)get_global_id(0) * LANES, first, first + ROWS < end ? first + ROWS : end };
}

STAGE int is_empty(column_t c, frame_t frame) { return (c.x >= frame.width) | (c.first >= c.end); }

// The block that a work-item has stored at the end of its column.
STAGE block_t stored_block(column_t c) { return (block_t) { c.x, c.x + LANES, c.first, c.end }; }

// Three rows of the frame: `centre` is the pixel's own.
typedef struct
{
    row_t above, centre, below;
} window_t;

// Moves the window down to row y.
STAGE void slide_window(
    window_t* w, plane_in current, plane_in alpha, plane_in inverse_depth, plane_in motion, int x, int y, frame_t frame)
{
    prefetch_frame(current, inverse_depth, motion, x, y, frame);
    w->above = w->centre;
    w->centre = w->below;
    w->below = read_next_row(w->centre, current, alpha, inverse_depth, motion, x, y + 1, frame);
}

// The window above the first pixel of a column: it holds that pixel's row and the one above, and sliding it down once
// reads the row below.
STAGE window_t open_window(
    plane_in current, plane_in alpha, plane_in inverse_depth, plane_in motion, column_t c, frame_t frame)
{
    window_t w = { 0 };
    NO_UNROLL
    for (int y = c.first - 1; y <= c.first; ++y) {
        w.centre = w.below;
        w.below = read_next_row(w.centre, current, alpha, inverse_depth, motion, c.x, y, frame);
    }
    return w;
}
