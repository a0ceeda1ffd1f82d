// Mixes the windows of a pixel's past that gather_windows.cl resolved, each weighted by its error in the texels around.
#include "gather/drift.h"
#include "schedule/window.h"

// storable_colour lets light be negative only as far as a sample is: here, as the darkest window.
STAGE colour darker(colour a, colour b) { return (colour) { lesser(a.r, b.r), lesser(a.g, b.g), lesser(a.b, b.b) }; }

// The pixel of row `turn` of a round, from its windows; `rows` holds the sums of the rows around it.
STAGE resolved mixed_windows(const row_sums* rows, int turn, plane_in windows, int x, int y, int frames,
    int static_frames, float lag_ratio, frame_t frame, settings_t settings)
{
    const size_t plane = plane_size(frame);
    real error[WINDOWS], least = SPLAT(0.0);
    UNROLL
    for (int window = 0; window < WINDOWS; ++window) {
        error[window]
            = repeats_previous(window, frames, static_frames) ? error[window - 1] : error_around(rows, window, turn);
        if (window != RECURSIVE)
            least = window == 0 ? error[window] : lesser(least, error[window]);
    }

    // Sums of differences from the shortest window, so that windows that agree keep their bits.
    plane_in p = windows + texel_offset(frame, x, y);
    const colour first = load_colour(p, plane);
    const real zero = SPLAT(0.0), alpha = ALPHA ? load(p + 5 * plane) : SPLAT(1.0), count = load(p + 4 * plane);
    real weight = window_weight(error[0], least), alpha_sum = zero, count_sum = zero;
    colour sum = { 0 }, darkest = first;
    window_drift drift = { 0 }, trend = { 0 };
    real followed = weight; // by windows that hold earlier frames
    plane_in q = p;
    UNROLL
    for (int window = 1; window < RIVALS; ++window) {
        const real w = window_weight(error[window], least);
        if (!repeats_previous(window, frames, static_frames))
            q = window_plane(p, window, 0, frame);
        if (has_drift(window, frames, static_frames))
            drift = drift_to_shortest(drift_around(rows, window, turn), settings);
        if ((window == 1) & (lag_ratio > 0.0f))
            trend = trend_around(rows, drift, turn, lag_ratio);
        if (window == PRESENT)
            drift = (window_drift) { 0 };
        else
            followed += w;
        const colour v = load_colour(q, plane);
        sum = plus_scaled(sum, w, minus(plus(v, drift.light), first));
        darkest = darker(darkest, v);
        count_sum += w * (load(q + 4 * plane) - count);
        if (ALPHA)
            alpha_sum += w * ((load(q + 5 * plane) + drift.alpha) - alpha);
        weight += w;
    }
    resolved out;
    const real follows = quotient(followed, weight);
    out.rgb = plus_scaled(plus(first, quotients(sum, weight)), follows, trend.light);
    out.alpha = (alpha + quotient(alpha_sum, weight)) + follows * trend.alpha;
    out.count = count + quotient(count_sum, weight);
    if (RECURSION == RECURSION_STANDING) {
        q = window_plane(p, RECURSIVE, 0, frame);
        const colour v = load_colour(q, plane);
        const real held = load(q + 4 * plane), share = recursive_share(held, out.count, error[RECURSIVE], least);
        out.rgb = plus_scaled(out.rgb, share, minus(v, out.rgb));
        darkest = darker(darkest, v);
        out.count += share * (held - out.count);
        if (ALPHA)
            out.alpha += share * (load(q + 5 * plane) - out.alpha);
    }
    out.rgb = storable_colour(out.rgb, darkest);
    out.alpha = limit(out.alpha, zero, SPLAT(1.0));
    return out;
}

__kernel void mix_windows_kernel(plane_in current, plane_in alpha, plane_in windows, const int frames,
    const int static_frames, const float lag_ratio, history_out output, plane_out output_count, const frame_t frame,
    const settings_t settings)
{
    const column_t column = own_column(frame);
    if (is_empty(column, frame))
        return;
    const int x = column.x, reach = WINDOW_REACH, lags = lag_ratio > 0.0f;
    row_sums rows[SIDE];
    UNROLL
    for (int j = -reach; j < reach; ++j)
        sum_row(&rows[row_slot(j)], current, alpha, windows, x, column.first + j, frames, static_frames, lags, frame,
            settings);
    // In rounds of SIDE rows, so that a GPU knows the slot of each: a new row takes that of the row it slides out.
    for (int first = column.first; first < column.end; first += SIDE) {
        UNROLL
        for (int turn = 0; turn < SIDE; ++turn) {
            const int y = first + turn;
            if (y >= column.end)
                break;
            sum_row(&rows[row_slot(turn + reach)], current, alpha, windows, x, y + reach, frames, static_frames, lags,
                frame, settings);
            const resolved out
                = mixed_windows(rows, turn, windows, x, y, frames, static_frames, lag_ratio, frame, settings);
            store_resolved(output, output_count, out, x, y, frame);
        }
    }
}
