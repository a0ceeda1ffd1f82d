// The pixel from the windows of its past that gather_windows.cl found, each as far as the texels around it bear it out.
#include "gather/window.h"

__kernel void weigh_windows_kernel(plane_in windows, const int frames, history_out output, plane_out output_count,
    const frame_t frame, const settings_t settings)
{
    const int x = (int)get_global_id(0) * LANES, y = (int)get_global_id(1);
    if (x >= frame.width || y >= frame.height)
        return;
    const size_t plane = plane_size(frame);
    plane_in p = windows + texel_offset(frame, x, y);
    real error[WINDOWS], least = SPLAT(0.0);
    for (int window = 0; window < WINDOWS; ++window) {
        error[window] = sum_around(window_plane(p, window, 3, frame), frame);
        least = window == 0 ? error[window] : lesser(least, error[window]);
    }
    // Sums of differences from the shortest window, so that windows that agree keep their bits.
    const colour first = load_colour(p, plane);
    const real zero = SPLAT(0.0), alpha = ALPHA ? load(p + 5 * plane) : SPLAT(1.0), count = load(p + 4 * plane);
    real weight = trust(error[0], least), alpha_sum = zero, count_sum = zero;
    colour sum = { zero, zero, zero }, darkest = first;
    drifted moved = { sum, zero };
    for (int window = 1; window < WINDOWS; ++window) {
        const real w = trust(error[window], least);
        plane_in q = window_plane(p, window, 0, frame);
        const colour v = load_colour(q, plane);
        if (window == PRESENT)
            moved = (drifted) { { zero, zero, zero }, zero };
        else if (!repeats(window, frames))
            moved = drift_to_shortest(q, p, frame, settings);
        sum.r += w * ((v.r + moved.light.r) - first.r);
        sum.g += w * ((v.g + moved.light.g) - first.g);
        sum.b += w * ((v.b + moved.light.b) - first.b);
        darkest.r = lesser(darkest.r, v.r);
        darkest.g = lesser(darkest.g, v.g);
        darkest.b = lesser(darkest.b, v.b);
        count_sum += w * (load(q + 4 * plane) - count);
        if (ALPHA)
            alpha_sum += w * ((load(q + 5 * plane) + moved.alpha) - alpha);
        weight += w;
    }
    const colour v
        = { first.r + quotient(sum.r, weight), first.g + quotient(sum.g, weight), first.b + quotient(sum.b, weight) };
    resolved out;
    out.rgb = storable_colour(v, darkest);
    out.alpha = limit(alpha + quotient(alpha_sum, weight), zero, SPLAT(1.0));
    out.count = count + quotient(count_sum, weight);
    store_resolved(output, output_count, out, x, y, frame);
}
