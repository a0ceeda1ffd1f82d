// Error and drift of each window around a pixel: sums over the texels, which weight the windows and shift the longer
// ones to the shortest.
#include "gather/window.h"

#define SIDE (2 * WINDOW_REACH + 1)

STAGE plane_in window_plane(plane_in windows, int window, int plane, frame_t frame)
{
    return windows + ((size_t)window * WINDOW_PLANES + (size_t)plane) * plane_size(frame);
}

// Texels of a window against those of the shortest: the mean of their differences, the squared deviations from it, and
// the window's light, a sum. Each has the luminance weights of both texels: a highlight that comes or goes is no change
// of the light around it.
typedef struct
{
    colour mean, squares, level;
    real alpha_mean, alpha_squares, weight;
} drift_sums;

// A row of the shortest window around a pixel.
typedef struct
{
    colour now[SIDE];
    real share[SIDE], alpha[SIDE];
} shortest_row;

STAGE shortest_row row_of_shortest(plane_in p, frame_t frame, settings_t settings)
{
    const size_t plane = plane_size(frame);
    shortest_row row;
    UNROLL
    for (int i = 0; i < SIDE; ++i) {
        row.now[i] = load_colour(p + i - WINDOW_REACH, plane);
        row.share[i] = luminance_weight(row.now[i], settings);
        row.alpha[i] = ALPHA ? load(p + 5 * plane + i - WINDOW_REACH) : SPLAT(1.0);
    }
    return row;
}

STAGE drift_sums drift_of_row(plane_in window, const shortest_row* row, frame_t frame, settings_t settings)
{
    const size_t plane = plane_size(frame);
    drift_sums s = { 0 };
    real w[SIDE], alpha[SIDE];
    colour d[SIDE];
    UNROLL
    for (int i = 0; i < SIDE; ++i) {
        plane_in p = window + i - WINDOW_REACH;
        const colour was = load_colour(p, plane), now = row->now[i];
        d[i] = minus(now, was);
        w[i] = luminance_weight(was, settings) * row->share[i];
        s.mean.r += w[i] * d[i].r, s.level.r += w[i] * absolute(was.r);
        s.mean.g += w[i] * d[i].g, s.level.g += w[i] * absolute(was.g);
        s.mean.b += w[i] * d[i].b, s.level.b += w[i] * absolute(was.b);
        if (ALPHA) {
            alpha[i] = row->alpha[i] - load(p + 5 * plane);
            s.alpha_mean += w[i] * alpha[i];
        }
        s.weight += w[i];
    }
    s.mean = quotients(s.mean, s.weight);
    if (ALPHA)
        s.alpha_mean = quotient(s.alpha_mean, s.weight);
    UNROLL
    for (int i = 0; i < SIDE; ++i) {
        const colour off = minus(d[i], s.mean);
        s.squares.r += w[i] * (off.r * off.r);
        s.squares.g += w[i] * (off.g * off.g);
        s.squares.b += w[i] * (off.b * off.b);
        if (ALPHA)
            s.alpha_squares += w[i] * ((alpha[i] - s.alpha_mean) * (alpha[i] - s.alpha_mean));
    }
    return s;
}

// Current samples against the shortest window, with the luminance weights of both.
typedef struct
{
    colour sum;
    real alpha_sum, weight;
} lag_sums;

STAGE lag_sums lag_of_row(plane_in current, plane_in alpha, const shortest_row* row, frame_t frame, settings_t settings)
{
    const size_t plane = plane_size(frame);
    lag_sums s = { 0 };
    UNROLL
    for (int i = 0; i < SIDE; ++i) {
        const ptrdiff_t beside = i - WINDOW_REACH;
        const texel_t sample = load_texel(current + beside, alpha + beside, plane);
        const mask missing = outside_domain_of(sample);
        const colour now = choose_colour(missing, row->now[i], sample.rgb);
        const real w = missing ? SPLAT(0.0) : luminance_weight(now, settings) * row->share[i];
        s.sum = plus_scaled(s.sum, w, minus(now, row->now[i]));
        if (ALPHA) {
            const real alpha_now = missing ? row->alpha[i] : limit(sample.alpha, SPLAT(0.0), SPLAT(1.0));
            s.alpha_sum += w * (alpha_now - row->alpha[i]);
        }
        s.weight += w;
    }
    return s;
}

STAGE real error_of_row(plane_in window, frame_t frame)
{
    real sum = SPLAT(0.0);
    for (int i = -WINDOW_REACH; i <= WINDOW_REACH; ++i)
        sum += load(window + 3 * plane_size(frame) + i);
    return sum;
}

// 1 if a window's drift of light is computed. The window of the current frame has no past, and one with no more frames
// of the ring than the one before has the same drift, or nearly, where a recursive history has replaced it.
STAGE int has_drift(int window, int frames, int static_frames)
{
    if (window == UNMOVED)
        return !repeats_previous(window, frames, static_frames);
    return window > 0 && window < UNMOVED && has_more_frames(window, frames);
}

// Error and drift of a row of texels around a pixel.
typedef struct
{
    real error;
    drift_sums drift;
} row_sums;

// Slot of the row that lies `turn` rows below the first of its round of SIDE rows.
STAGE int row_slot(int turn) { return (turn + WINDOW_REACH + SIDE) % SIDE; }

STAGE row_sums sum_row(plane_in shortest, plane_in window, int drifts, frame_t frame, settings_t settings)
{
    row_sums sums = { 0 };
    prefetch_planes(window, WINDOW_PLANES, 0, frame);
    sums.error = error_of_row(window, frame);
    if (drifts) {
        const shortest_row row = row_of_shortest(shortest, frame, settings);
        sums.drift = drift_of_row(window, &row, frame, settings);
    }
    return sums;
}

STAGE real error_around(const row_sums* rows, int turn)
{
    real sum = SPLAT(0.0);
    UNROLL
    for (int j = -WINDOW_REACH; j <= WINDOW_REACH; ++j)
        sum += rows[row_slot(turn + j)].error;
    return sum;
}

// Joins all rows around a pixel. A sum of squares minus the square of a mean would leave only rounding errors where
// light drifts evenly; instead each row sums squares about its own mean, and the squared distance of that mean from the
// mean of all is added (Chan, Golub and LeVeque).
STAGE drift_sums drift_around(const row_sums* rows, int turn)
{
    drift_sums all = { 0 };
    UNROLL
    for (int j = -WINDOW_REACH; j <= WINDOW_REACH; ++j) {
        const drift_sums* row = &rows[row_slot(turn + j)].drift;
        all.mean.r += row->weight * row->mean.r, all.level.r += row->level.r;
        all.mean.g += row->weight * row->mean.g, all.level.g += row->level.g;
        all.mean.b += row->weight * row->mean.b, all.level.b += row->level.b;
        if (ALPHA)
            all.alpha_mean += row->weight * row->alpha_mean;
        all.weight += row->weight;
    }
    all.mean = quotients(all.mean, all.weight);
    if (ALPHA)
        all.alpha_mean = quotient(all.alpha_mean, all.weight);
    UNROLL
    for (int j = -WINDOW_REACH; j <= WINDOW_REACH; ++j) {
        const drift_sums* row = &rows[row_slot(turn + j)].drift;
        const colour off = minus(row->mean, all.mean);
        all.squares.r += row->squares.r + row->weight * (off.r * off.r);
        all.squares.g += row->squares.g + row->weight * (off.g * off.g);
        all.squares.b += row->squares.b + row->weight * (off.b * off.b);
        if (ALPHA) {
            const real off_alpha = row->alpha_mean - all.alpha_mean;
            all.alpha_squares += row->alpha_squares + row->weight * (off_alpha * off_alpha);
        }
    }
    return all;
}

// Weight of a window relative to that of the least error: the ratio of errors to the 16th power. The exponent of a
// likelihood would be half the number of recent samples, 50, but those of neighbouring texels err alike. Centred
// windows do not lag, and a mean of more of them errs less: the 8th power.
STAGE real window_weight(real error, real least)
{
    const real ratio = greater(quotient(least + K(TINY), error + K(TINY)), SPLAT(LEAST_ERROR_RATIO));
    const real second = ratio * ratio, fourth = second * second, eighth = fourth * fourth;
    return CENTRED ? eighth : eighth * eighth;
}

// How often a window counts. One that repeats another counts again, UNMOVED too. Beside frames ahead trends of light
// cancel, so that of all ring frames, which has the most samples, counts once more, and one of the ring that repeats
// another not at all.
STAGE int times_counted(int window, int frames)
{
    if (!LOOK_AHEAD | (window > ALL_FRAMES))
        return 1;
    return has_more_frames(window, frames) + (window == ALL_FRAMES);
}

// Share of the recursive result in its mean with the other windows: by the samples of both, less where it errs more
// than the best of them.
STAGE real recursive_share(real count, real others, real error, real least)
{
    const real one = SPLAT(1.0), ratio = lesser(quotient(least + K(TINY), error + K(TINY)), one);
    const real second = ratio * ratio;
    return quotient(count, greater(count + others, one)) * (second * second);
}

// Student's t of a mean difference. DRIFT_FLOOR of the light's mean is added to the standard error, so that an
// invisible difference counts for little.
STAGE real students_t_of_drift(real mean, real squares, real level, real weight)
{
    const real variance = quotient(squares, weight * SPLAT(SIDE * SIDE - 1));
    const real error = square_root(variance) + (SPLAT(DRIFT_FLOOR) * level + K(TINY));
    return quotient(absolute(mean), error);
}

// Drift of light and alpha.
typedef struct
{
    colour light;
    real alpha;
} window_drift;

// Share of a drift that is not chance, by Student's t: 1 - (drift_t / t)^2 (James and Stein).
STAGE real sure_share(real t, settings_t settings)
{
    const real chance = quotient(SPLAT(settings.drift_t), greater(t, SPLAT(settings.drift_t)));
    return SPLAT(1.0) - chance * chance;
}

// Drift from a window to the shortest: the mean difference of the texels around, as far as it is not chance, for light
// by the channel that drifted most; for alpha, whose level is 1, by its own t.
STAGE window_drift drift_to_shortest(drift_sums s, settings_t settings)
{
    const colour level = quotients(s.level, s.weight);
    const real r = students_t_of_drift(s.mean.r, s.squares.r, level.r, s.weight),
               g = students_t_of_drift(s.mean.g, s.squares.g, level.g, s.weight),
               b = students_t_of_drift(s.mean.b, s.squares.b, level.b, s.weight);
    window_drift drift = { scaled(s.mean, sure_share(greater(r, greater(g, b)), settings)), SPLAT(0.0) };
    if (ALPHA) {
        const real t = students_t_of_drift(s.alpha_mean, s.alpha_squares, SPLAT(1.0), s.weight);
        drift.alpha = sure_share(t, settings) * s.alpha_mean;
    }
    return drift;
}

// A change in the direction of `most`, and no more than that.
STAGE real up_to(real change, real most)
{
    const real zero = SPLAT(0.0);
    return limit(change, lesser(most, zero), greater(most, zero));
}

// How far the shortest window lags behind the light of now. Light that goes on changing as it did since the second
// window (`drift`) moves it on by `ratio`, its distance in time from the current frame over that from the second. The
// lag of the samples around bounds that: light may stop or turn.
STAGE real trend_of(real drift, real lag, float ratio) { return up_to(drift * K(ratio), lag); }

// Mean distance of the current samples around a pixel from the shortest window.
STAGE window_drift lag_around(const lag_sums* rows, int turn)
{
    lag_sums all = { 0 };
    UNROLL
    for (int j = -WINDOW_REACH; j <= WINDOW_REACH; ++j) {
        const lag_sums row = rows[row_slot(turn + j)];
        all.sum = plus(all.sum, row.sum);
        all.alpha_sum += row.alpha_sum;
        all.weight += row.weight;
    }
    const real weight = greater(all.weight, K(TINY));
    return (window_drift) { quotients(all.sum, weight), ALPHA ? quotient(all.alpha_sum, weight) : SPLAT(0.0) };
}

STAGE window_drift trend_within(window_drift drift, window_drift lag, float ratio)
{
    const colour light = drift.light;
    return (window_drift) { { trend_of(light.r, lag.light.r, ratio), trend_of(light.g, lag.light.g, ratio),
                                trend_of(light.b, lag.light.b, ratio) },
        ALPHA ? trend_of(drift.alpha, lag.alpha, ratio) : SPLAT(0.0) };
}

// 1 if some pixel has a drift.
STAGE int goes_on(window_drift by)
{
    const real zero = SPLAT(0.0);
    const mask moves = (by.light.r != zero) | (by.light.g != zero) | (by.light.b != zero) | (by.alpha != zero);
    return any_of(moves);
}

// How much further than the trend a pixel at `out` goes: by the drift since the second window, `drift`, until it meets
// the range of the current 3x3. Trends are means of the texels around, but an edge leaves these one after the other.
// Missing samples stop it.
STAGE window_drift further_into_range(
    window_drift drift, resolved out, plane_in current, plane_in alpha, int x, int y, frame_t frame)
{
    for (int k = 0; k < 9; ++k) {
        const uint at = texel_offset(frame, x + k % 3 - 1, y + k / 3 - 1);
        const texel_t sample = load_texel(current + at, alpha + at, plane_size(frame));
        const mask missing = outside_domain_of(sample);
        const colour off = minus(choose_colour(missing, out.rgb, sample.rgb), out.rgb);
        drift.light.r = up_to(off.r, drift.light.r);
        drift.light.g = up_to(off.g, drift.light.g);
        drift.light.b = up_to(off.b, drift.light.b);
        if (ALPHA) {
            const real share = missing ? out.alpha : limit(sample.alpha, SPLAT(0.0), SPLAT(1.0));
            drift.alpha = up_to(share - out.alpha, drift.alpha);
        }
    }
    return drift;
}

// What the texels around a pixel say of a window.
typedef struct
{
    real error;
    window_drift drift;
} surroundings;

// Compares a window with the shortest around the pixels of a column, rows y to `end` - 1, at most ROWS_AT_ONCE. In
// rounds of SIDE rows, so that a GPU knows the slot of each: a new row takes that of the row it slides out.
STAGE void compare_window(surroundings* around, plane_in windows, int window, int drifts, int x, int y, int end,
    frame_t frame, settings_t settings)
{
    plane_in shortest = windows, planes = window_plane(windows, window, 0, frame);
    row_sums rows[SIDE];
    UNROLL
    for (int j = -WINDOW_REACH; j < WINDOW_REACH; ++j) {
        const uint at = texel_offset(frame, x, y + j);
        rows[row_slot(j)] = sum_row(shortest + at, planes + at, drifts, frame, settings);
    }
    for (int first = 0; y + first < end; first += SIDE) {
        UNROLL
        for (int turn = 0; turn < SIDE; ++turn) {
            if (y + first + turn >= end)
                break;
            const uint at = texel_offset(frame, x, y + first + turn + WINDOW_REACH);
            rows[row_slot(turn + WINDOW_REACH)] = sum_row(shortest + at, planes + at, drifts, frame, settings);
            surroundings* pixel = &around[first + turn];
            pixel->error = error_around(rows, turn);
            if (drifts)
                pixel->drift = drift_to_shortest(drift_around(rows, turn), settings);
        }
    }
}

// The same of the current samples.
STAGE void compare_samples(window_drift* lag, plane_in current, plane_in alpha, plane_in shortest, int x, int y,
    int end, frame_t frame, settings_t settings)
{
    lag_sums rows[SIDE];
    UNROLL
    for (int j = -WINDOW_REACH; j < WINDOW_REACH; ++j) {
        const uint at = texel_offset(frame, x, y + j);
        const shortest_row row = row_of_shortest(shortest + at, frame, settings);
        rows[row_slot(j)] = lag_of_row(current + at, alpha + at, &row, frame, settings);
    }
    for (int first = 0; y + first < end; first += SIDE) {
        UNROLL
        for (int turn = 0; turn < SIDE; ++turn) {
            if (y + first + turn >= end)
                break;
            const uint at = texel_offset(frame, x, y + first + turn + WINDOW_REACH);
            const shortest_row row = row_of_shortest(shortest + at, frame, settings);
            rows[row_slot(turn + WINDOW_REACH)] = lag_of_row(current + at, alpha + at, &row, frame, settings);
            lag[first + turn] = lag_around(rows, turn);
        }
    }
}
