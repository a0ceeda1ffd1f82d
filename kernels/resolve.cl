// The temporal resolve, fused. One work-item slides a segment of LANES pixels down ROWS rows, so that each row of the
// neighbourhood is read and converted once; or COLUMNS of them, row by row, so that memory is read along rows.
#include "pixel.h"
#include "ahead.h"
#include "columns.h"
#include "edges.h"

// Resolves the segment at (x, y), whose row is `centre`. TWO_UNDER_WAY: it is left in `under_way`, and what was left
// there before is finished meanwhile.
STAGE void resolve_segment(row_t above, row_t centre, row_t below, plane_in current, plane_in alpha, plane_in reactive,
    history_in history, plane_in history_count, plane_in previous_closeness, history_out output, plane_out output_count,
    int x, int y, frame_t frame, settings_t settings, kept_rows* kept, segment_t* under_way)
{
    const surface s = nearest_surface(above, centre, below, settings);
    if (TWO_UNDER_WAY)
        weigh_segment(under_way, settings);
    const motion_t m = surface_motion(s, LANE_INDEX + K(x), SPLAT(y), frame);
#if LANES > 1 && COLUMNS <= 1
    // Not beside the frame's: more would be asked for at a time than can be under way.
    fetch_history(history, history_count, previous_closeness, history_offset(frame, x, y), frame);
#endif
    const pixel_t p = current_pixel(above, centre, below, alpha, reactive, x, y, frame);
    const history_t h = sample_history(
        current, below.texels, history, history_count, previous_closeness, m, s, x, y, frame, settings, kept);
    if (TWO_UNDER_WAY)
        finish_segment(*under_way, output, output_count, frame, settings);
    *under_way = rectify_segment(p, h, m, alpha, x, y, frame, settings);
    if (!TWO_UNDER_WAY) {
        weigh_segment(under_way, settings);
        finish_segment(*under_way, output, output_count, frame, settings);
    }
}

// Whether three rows take turns as the one above, the centre and the one below, the loop written out for each: a row
// moved from place to place goes through the stack, as all its registers are taken. Where little is carried down (no
// nearest surface), and with eight lanes, nothing is gained; where changing light is tested the compiler takes too long
// over it.
#define ROWS_IN_TURN (LANES >= 16 && DILATION != DILATION_NONE && LIGHT_CHANGE == LIGHT_CHANGE_IGNORE)

// Reads the row `below` and resolves that of `centre`.
#define RESOLVE_ROW(above, centre, below)                                                                              \
    fetch_frame(current, closeness, motion, x, y, frame);                                                              \
    below = read_next_row(centre, current, closeness, motion, x, y + 1, frame);                                        \
    resolve_segment(above, centre, below, current, alpha, reactive, history, history_count, previous_closeness,        \
        output, output_count, x, y, frame, settings, &kept, &under_way);

__kernel void resolve_kernel(plane_in current, plane_in closeness, plane_in motion, plane_in alpha, plane_in reactive,
    history_in history, plane_in history_count, plane_in previous_closeness, history_out output, plane_out output_count,
    const frame_t frame, const settings_t settings)
{
    const int first = frame.first_row + (int)get_global_id(1) * ROWS;
    const int below_band = frame.first_row + band_rows(frame);
    const int end = below_band < frame.height ? below_band : frame.height;
    const int last = first + ROWS < end ? first + ROWS : end;
#if COLUMNS > 1
    // As many segments as fall to a work-item, COLUMNS at most.
    const int segments = (frame.width + LANES - 1) / LANES, item = (int)get_global_id(0),
              items = (int)get_global_size(0);
    const int begin = segments * item / items, count = segments * (item + 1) / items - begin;
    if (count == 0 || first >= end)
        return;
    ROW_MEMBERS(COLUMN_ARRAYS)
    kept_rows kept[COLUMNS];
    ROLLED
    for (int i = 0; i < count; ++i) {
        const int x = (begin + i) * LANES, to = i;
        const row_t none = { 0 };
        const row_t centre = read_next_row(none, current, closeness, motion, x, first - 1, frame);
        const row_t below = read_next_row(centre, current, closeness, motion, x, first, frame);
        ROW_MEMBERS(KEEP_COLUMN)
        kept[i] = nothing_kept();
    }
    // Nothing yet: what it stores is stored again.
    segment_t under_way = { .x = begin * LANES, .y = first };
    for (int y = first; y < last; ++y) {
        ROLLED
        for (int i = 0; i < count; ++i) {
            row_t above = { 0 }, centre = { 0 };
            ROW_MEMBERS(TAKE_COLUMN)
            const int x = (begin + i) * LANES;
            fetch_frame(current, closeness, motion, x, y, frame);
            const row_t below = read_next_row(centre, current, closeness, motion, x, y + 1, frame);
            const int to = another_index(i);
            // Before the segment is resolved: a compiler that keeps it afterwards has it on the stack until then.
            ROW_MEMBERS(KEEP_COLUMN)
            resolve_segment(above, centre, below, current, alpha, reactive, history, history_count, previous_closeness,
                output, output_count, x, y, frame, settings, &kept[i], &under_way);
        }
    }
    const block_t stored = { begin * LANES, (begin + count) * LANES, first, last };
#else
    const int x = (int)get_global_id(0) * LANES;
    if (x >= frame.width || first >= end)
        return;
    if ((LANES == 1) & (CAMERA_MOTION | OWN_MOTION))
        fetch_first(current, closeness, motion, history, history_count, previous_closeness, x, first, frame);
    row_t above = { 0 }, centre = { 0 };
    ROLLED
    for (int y = first - 1; y <= first; ++y) {
        above = centre;
        centre = read_next_row(above, current, closeness, motion, x, y, frame);
    }
    kept_rows kept = nothing_kept();
    segment_t under_way = { .x = x, .y = first }; // nothing yet
#if ROWS_IN_TURN
    row_t below;
    ROLLED
    for (int y = first;;) {
        RESOLVE_ROW(above, centre, below)
        if (++y == last)
            break;
        RESOLVE_ROW(centre, below, above)
        if (++y == last)
            break;
        RESOLVE_ROW(below, above, centre)
        if (++y == last)
            break;
    }
#else
    for (int y = first; y < last; ++y) {
        row_t below;
        RESOLVE_ROW(above, centre, below)
        above = centre;
        centre = below;
    }
#endif
    const block_t stored = { x, x + LANES, first, last };
#endif
    if (TWO_UNDER_WAY) {
        weigh_segment(&under_way, settings);
        finish_segment(under_way, output, output_count, frame, settings);
    }
    extend_stored(output, 3 + ALPHA, output_count, 1, stored, frame);
}
