// Mixes the windows of a pixel's past that gather_windows.cl resolved, each weighted by its error in the texels around.
#include "gather/drift.h"
#include "schedule/window.h"

__kernel void mix_windows_kernel(plane_in windows, const int frames, const int static_frames, history_out output,
    plane_out output_count, const frame_t frame, const settings_t settings)
{
    const column_t column = own_column(frame);
    if (is_empty(column, frame))
        return;
    const int x = column.x;
    const size_t plane = plane_size(frame);
    row_sums rows[SIDE];
    for (int y = column.first - WINDOW_REACH; y < column.first + WINDOW_REACH; ++y)
        sum_row(rows, windows, x, y, frames, static_frames, frame, settings);
    for (int y = column.first; y < column.end; ++y) {
        // The errors of the texels around.
        sum_row(rows, windows, x, y + WINDOW_REACH, frames, static_frames, frame, settings);
        real error[WINDOWS], least = SPLAT(0.0);
        for (int window = 0; window < WINDOWS; ++window) {
            error[window]
                = repeats_previous(window, frames, static_frames) ? error[window - 1] : error_around(rows, window, y);
            least = window == 0 ? error[window] : lesser(least, error[window]);
        }

        // Sums of differences from the shortest window, so that windows that agree keep their bits.
        plane_in p = windows + texel_offset(frame, x, y);
        const colour first = load_colour(p, plane);
        const real zero = SPLAT(0.0), alpha = ALPHA ? load(p + 5 * plane) : SPLAT(1.0), count = load(p + 4 * plane);
        real weight = window_weight(error[0], least), alpha_sum = zero, count_sum = zero;
        colour sum = { 0 }, darkest = first;
        window_drift drift = { 0 };
        plane_in q = p;
        for (int window = 1; window < WINDOWS; ++window) {
            const real w = window_weight(error[window], least);
            if (!repeats_previous(window, frames, static_frames))
                q = window_plane(p, window, 0, frame);
            if (has_drift(window, frames, static_frames))
                drift = drift_to_shortest(drift_around(rows, window, y), settings);
            if (window == PRESENT)
                drift = (window_drift) { 0 };
            const colour v = load_colour(q, plane);
            sum = plus_scaled(sum, w, minus(plus(v, drift.light), first));
            darkest.r = lesser(darkest.r, v.r);
            darkest.g = lesser(darkest.g, v.g);
            darkest.b = lesser(darkest.b, v.b);
            count_sum += w * (load(q + 4 * plane) - count);
            if (ALPHA)
                alpha_sum += w * ((load(q + 5 * plane) + drift.alpha) - alpha);
            weight += w;
        }
        resolved out;
        out.rgb = storable_colour(plus(first, quotients(sum, weight)), darkest);
        out.alpha = limit(alpha + quotient(alpha_sum, weight), zero, SPLAT(1.0));
        out.count = count + quotient(count_sum, weight);
        store_resolved(output, output_count, out, x, y, frame);
    }
}
