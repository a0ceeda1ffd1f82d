// Mixes the windows of a pixel's past that gather_windows.cl resolved, each weighted by its error in the texels around.
#include "gather/drift.h"
#include "schedule/window.h"

// storable_colour lets light be negative only as far as a sample is: here, as the darkest window.
STAGE colour darker(colour a, colour b) { return (colour) { lesser(a.r, b.r), lesser(a.g, b.g), lesser(a.b, b.b) }; }

#define ROWS_AT_ONCE (ROWS < 3 * SIDE ? ROWS : 3 * SIDE) // rows whose windows are compared one after the other

// The pixel of row `row` of those `around`, from its windows.
STAGE resolved mixed_windows(const surroundings (*around)[ROWS_AT_ONCE], const window_drift* lag, int row,
    plane_in current, plane_in alpha, plane_in windows, int x, int y, int frames, int static_frames, float lag_ratio,
    float drift_share, frame_t frame, settings_t settings)
{
    const size_t plane = plane_size(frame);
    real error[WINDOWS], least = SPLAT(0.0);
    UNROLL
    for (int window = 0; window < WINDOWS; ++window) {
        error[window] = repeats_previous(window, frames, static_frames) ? error[window - 1] : around[window][row].error;
        if (window != RECURSIVE)
            least = window == 0 ? error[window] : lesser(least, error[window]);
    }

    // Sums of differences from the shortest window, so that windows that agree keep their bits.
    plane_in p = windows + texel_offset(frame, x, y);
    const colour first = load_colour(p, plane);
    const real zero = SPLAT(0.0), opacity = ALPHA ? load(p + 5 * plane) : SPLAT(1.0), count = load(p + 4 * plane);
    real weight = window_weight(error[0], least), alpha_sum = zero, count_sum = zero;
    colour sum = { 0 }, darkest = first;
    window_drift drift = { 0 }, latest = { 0 }, trend = { 0 };
    real followed = weight; // by windows that hold earlier frames
    plane_in q = p;
    UNROLL
    for (int window = 1; window < RIVALS; ++window) {
        const real w = K(times_counted(window, frames)) * window_weight(error[window], least);
        if (!repeats_previous(window, frames, static_frames))
            q = window_plane(p, window, 0, frame);
        if (has_drift(window, frames, static_frames))
            drift = around[window][row].drift;
        if (window == 1)
            latest = drift;
        if (window == PRESENT)
            drift = (window_drift) { 0 };
        else
            followed += w;
        const colour v = load_colour(q, plane);
        sum = plus_scaled(sum, w, minus(plus(v, drift.light), first));
        darkest = darker(darkest, v);
        count_sum += w * (load(q + 4 * plane) - count);
        if (ALPHA)
            alpha_sum += w * ((load(q + 5 * plane) + drift.alpha) - opacity);
        weight += w;
    }
    resolved out;
    const real follows = quotient(followed, weight);
    if (lag_ratio > 0.0f)
        trend = trend_within(latest, lag[row], lag_ratio);
    out.rgb = plus_scaled(plus(first, quotients(sum, weight)), follows, trend.light);
    out.alpha = (opacity + quotient(alpha_sum, weight)) + follows * trend.alpha;
    const real may_go = follows * K(drift_share);
    latest = (window_drift) { scaled(latest.light, may_go), may_go * latest.alpha };
    if (goes_on(latest)) {
        const window_drift further = further_into_range(latest, out, current, alpha, x, y, frame);
        out.rgb = plus(out.rgb, further.light);
        out.alpha += further.alpha;
    }
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
    const int static_frames, const float lag_ratio, const float drift_share, history_out output, plane_out output_count,
    const frame_t frame, const settings_t settings)
{
    const column_t column = own_column(frame);
    if (is_empty(column, frame))
        return;
    const int x = column.x;
    surroundings around[WINDOWS][ROWS_AT_ONCE];
    window_drift lag[ROWS_AT_ONCE];
    for (int first = column.first; first < column.end; first += ROWS_AT_ONCE) {
        const int end = first + ROWS_AT_ONCE < column.end ? first + ROWS_AT_ONCE : column.end;
        NO_UNROLL
        for (int window = 0; window < WINDOWS; ++window) {
            const int drifts = has_drift(window, frames, static_frames);
            if (!repeats_previous(window, frames, static_frames))
                compare_window(around[window], windows, window, drifts, x, first, end, frame, settings);
        }
        if (lag_ratio > 0.0f)
            compare_samples(lag, current, alpha, windows, x, first, end, frame, settings);
        for (int y = first; y < end; ++y) {
            const resolved out = mixed_windows(around, lag, y - first, current, alpha, windows, x, y, frames,
                static_frames, lag_ratio, drift_share, frame, settings);
            store_resolved(output, output_count, out, x, y, frame);
        }
    }
}
