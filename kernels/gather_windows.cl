// As gather.cl, but where light may change: resolves the pixel from several windows of its past (gather/window.h), with
// the error of each. mix_windows.cl mixes the windows.
#include "gather/subpixel.h"
#include "gather/window.h"
#include "schedule/window.h"

__kernel void gather_windows_kernel(plane_in current, plane_in inverse_depth, plane_in motion, plane_in alpha,
    plane_in reactive, plane_in ring, frame_records past, const int frames, const int static_frames,
    history_in recursive, plane_in recursive_count, plane_out windows, const frame_t frame, const settings_t settings)
{
    const column_t column = own_column(frame);
    if (is_empty(column, frame))
        return;
    const int x = column.x;
    window_t rows = open_window(current, alpha, inverse_depth, motion, column, frame);
    const int before = frames_before(past, static_frames);
    for (int y = column.first; y < column.end; ++y) {
        // Read: the 3x3 around the pixel, its statistics, and the pixel's own sample.
        slide_window(&rows, current, alpha, inverse_depth, motion, x, y, frame);
        pixel_t p = current_pixel(rows.above, rows.centre, rows.below, reactive, x, y, frame);
        p.missing = sample_is_missing(current, alpha, x, y, frame);

        // Reproject: the nearest surface of the 3x3, and at a depth edge the one behind it.
        surface s = nearest_surface(rows.above, rows.centre, rows.below, settings);
        const motion_t m = surface_motion(s, LANE_INDEX + K(x), SPLAT(y), frame);
        layers_t l = layers_of(rows.above, rows.centre, rows.below, s, settings);
        find_subpixel_feature(&s, &l, ring, past, frames, x, y, frame, settings);
        path_t near = begin_path(s, l, NEARER, p, current, alpha, inverse_depth, motion, x, y, frame, settings);
        path_t far = begin_path(s, l, FARTHER, p, current, alpha, inverse_depth, motion, x, y, frame, settings);
        resolved held = { 0 };
        if (RECURSION == RECURSION_STANDING)
            held = recursive_result(recursive, recursive_count, x, y, frame);

        // Sample the history window by window: each adds older frames to the samples of the one before.
        resolved out;
        real error = SPLAT(0.0);
        for (int window = 0, from = 0; window <= ALL_FRAMES; ++window) {
            const int to = window_end(window, frames);
            if (has_more_frames(window, frames)) {
                gather_samples(&near, ring, past, from, to, SHORT_WINDOW, p, x, y, frame, settings);
                if (any_of(l.edge))
                    gather_samples(&far, ring, past, from, to, 0, p, x, y, frame, settings);
                out = resolve_gathered(near.sums, far.sums, l, p, m, current, alpha, x, y, frame, settings);
                error = window_error(near.sums, p, out, settings);
            }
            if (RECURSION == RECURSION_STANDING && window == ALL_FRAMES) {
                // A recursive history does not weight samples by their reactivity, as gathering does.
                out = longer_history(out, p.most_reactive <= SPLAT(0.0), held);
                error = window_error(near.sums, p, out, settings);
            }
            if (!repeats_previous(window, frames, static_frames))
                store_window(windows, window, out, error, x, y, frame);
            from = to;
        }
        if (REACTIVE)
            replace_unlike_windows(windows, near.sums, out, error, x, y, frame);

        // The window without motion. It is valid where enough of the latest samples can contradict it. Where the
        // surface is at rest, a longer recursive history replaces it.
        if (!repeats_previous(UNMOVED, frames, static_frames)) {
            sample_sums unmoved_sums;
            resolved unmoved = resolve_unmoved(&unmoved_sums, ring, past, static_frames, p, x, y, frame, settings);
            if (RECURSION == RECURSION_STANDING)
                unmoved = longer_history(unmoved, at_rest(m), held);
            const mask valid = unmoved_sums.recent_count >= SPLAT(SHORT_WINDOW);
            out.rgb = choose_colour(valid, unmoved.rgb, out.rgb);
            out.alpha = valid ? unmoved.alpha : out.alpha;
            out.count = valid ? unmoved.count : out.count;
            error = valid ? window_error(unmoved_sums, p, unmoved, settings) : error;
            store_window(windows, UNMOVED, out, error, x, y, frame);
        }

        // The window of this frame alone, where history is refuted; elsewhere a copy of the window before, with an
        // error that gives it no weight. Then the recursive result.
        if (RECURSION == RECURSION_STANDING) {
            const mask refuted = history_is_refuted(m, p, held, before, settings);
            out.rgb = choose_colour(refuted, storable_colour(from_range(p.filtered), p.own), out.rgb);
            out.alpha = refuted ? p.alpha : out.alpha;
            out.count = refuted ? SPLAT(1.0) : out.count;
            store_window(windows, PRESENT, out, present_error(near.sums, p, refuted, frame, settings), x, y, frame);
            // It lags behind later frames, so beside them it has no share.
            held.count = LOOK_AHEAD ? SPLAT(0.0) : held.count;
            store_window(windows, RECURSIVE, held, recursive_error(near.sums, p, m, held, settings), x, y, frame);
        }
    }
    extend_stored(0, 0, windows, WINDOWS * WINDOW_PLANES, stored_block(column), frame);
}
