// Illumination-change test: light that changes without motion. Pairs the nine current samples of the 3x3 with the
// history at their positions. Under constant light the nine differences come from jitter and have mixed signs; under
// changing light they agree. Alpha is a fourth channel of the test: where black lies over a transparent ground, nothing
// else changes.
#include "schedule/footprint.h"
#include "taa/neighbourhood.h"

STAGE colour load_history_colour(history_in p, size_t plane)
{
    return (colour) { load_history(p), load_history(p + plane), load_history(p + 2 * plane) };
}

// Scales history to the current exposure and tonemaps it to the range of comparison.
STAGE colour history_in_range(colour v, frame_t frame)
{
    return to_range(EXPOSURE ? scaled(v, SPLAT(frame.exposure_ratio)) : v);
}

// Moves the footprint's integer position to the nearest texel.
STAGE footprint nearest_texels(footprint f, int stride)
{
    const mask right = f.fx >= SPLAT(0.5), down = f.fy >= SPLAT(0.5);
    if (LANES == 1) { // from f.at, so that a GPU need not hold dx and dy until here
        f.at += (any_of(right) ? 1u : 0u) + (any_of(down) ? (uint)stride : 0u);
        return f;
    }
    f.dx += right ? (whole)(1) : (whole)(0);
    f.dy += down ? (whole)(1) : (whole)(0);
    return classify_lanes(f, stride);
}

// Channels that the test compares.
#define TESTED (3 + ACCUMULATES_ALPHA)

// Three texels of the history side by side; alpha where it is tested.
typedef struct
{
    colour left, own, right;
    real alpha[3];
} texel_row;

// v holds the tested channels of each texel in turn.
STAGE texel_row texels_of(const real v[3 * TESTED])
{
    const int own = TESTED, right = 2 * TESTED;
    texel_row row
        = { { v[0], v[1], v[2] }, { v[own], v[own + 1], v[own + 2] }, { v[right], v[right + 1], v[right + 2] } };
    for (int i = 0; ACCUMULATES_ALPHA && i < 3; ++i)
        row.alpha[i] = v[TESTED * i + 3];
    return row;
}

// Loads the row j below the nearest texels n, with left and right neighbours.
STAGE texel_row nearest_row(history_in p, footprint n, int j, size_t plane, int stride)
{
    if (LANES > 1 && n.lanes == LANES_ADJACENT) {
        const mask right = n.step_x != 0, down = n.step_y != 0;
        real line[3 * TESTED];
        NO_UNROLL
        for (int i = 0; i < TESTED; ++i) {
            history_in q = p + n.at + (size_t)i * plane + j * (ptrdiff_t)stride - 1;
            const real a0 = load_history(q), b0 = load_history(q + 1), c0 = load_history(q + 2),
                       d0 = load_history(q + 3);
            q += stride;
            const real a = down ? load_history(q) : a0, b = down ? load_history(q + 1) : b0,
                       c = down ? load_history(q + 2) : c0, d = down ? load_history(q + 3) : d0;
            line[i] = right ? b : a;
            line[i + TESTED] = right ? c : b;
            line[i + 2 * TESTED] = right ? d : c;
        }
        return texels_of(line);
    }
    if (LANES > 1 && n.lanes == LANES_SCATTERED) {
        const whole offsets = lane_offsets(n.dx, n.dy, stride);
        history_in q = p + n.own + j * (ptrdiff_t)stride;
        real line[3 * TESTED];
        NO_UNROLL
        for (int i = 0; i < 3 * TESTED; ++i)
            line[i] = load_history_lanes(q + (size_t)(i % TESTED) * plane + (i / TESTED - 1), offsets);
        return texels_of(line);
    }
    history_in q = ROW_BELOW(p, n.at, j, stride);
    texel_row row
        = { load_history_colour(q - 1, plane), load_history_colour(q, plane), load_history_colour(q + 1, plane) };
    for (int i = 0; ACCUMULATES_ALPHA && i < 3; ++i)
        row.alpha[i] = load_history(q + 3 * plane + (i - 1));
    return row;
}

// 1 if the test runs. The count's buffer then has a second plane, which holds the illumination change.
#define TESTS_LIGHT (ILLUMINATION != ILLUMINATION_STATIC)

// Clamps the stored illumination change to +-MOST_CHANGE, so that it decays within some frames, and flushes denormals.
STAGE real stored_change(real change)
{
    const real limited = limit(change, SPLAT(-MOST_CHANGE), SPLAT(MOST_CHANGE));
    return absolute(limited) < SPLAT(TINY) ? SPLAT(0.0) : limited;
}

// Mean and spread of three differences. Unlike the moments of colours they have no separate shift: under constant light
// the differences are near 0, and under changing light their last digits do not matter.
typedef struct
{
    real mean, spread;
    real spreads; // sum of its own and that of the row above
} difference_moments;

STAGE difference_moments difference_row(real left, real centre, real right)
{
    const real dl = left - centre, dr = right - centre;
    return (difference_moments) { centre + (dl + dr) * K(ONE_THIRD), spread_of_three(dl, dr), SPLAT(0.0) };
}

// A third of Student's t of nine differences: mean over deviation, with the sign of the mean. `least` is added to the
// deviation, so that an invisible difference counts for little in a flat area too.
STAGE real third_of_students_t(difference_moments centre, difference_moments below, real da, real db, real least)
{
    const real mean = centre.mean + (da + db) * K(ONE_THIRD),
               spread = (centre.spreads + below.spread) + K(3.0) * spread_of_three(da, db);
    return quotient(mean, square_root(spread * K(TWO_27THS)) + least);
}

// A row of three: its differences, the steps of their means from the row above, and the sums of its samples' levels, of
// luminance and alpha.
typedef struct
{
    difference_moments a, b, c, alpha;
    boxed step;
    real alpha_step;
    real level, levels, alpha_level, alpha_levels; // of this row, and summed with that of the row above
} illumination_row;

// The state that a work-item carries down its column: the row for the next segment, and the history texel nearest to
// that segment's reprojection if it moves as the one above; 0, a texel of the halo, if its lanes share no such texel.
typedef struct
{
    illumination_row row;
    uint nearest;
} illumination_cache;

// Current minus history in the box space. For YCoCg it subtracts the terms of to_box_space one by one: fewer
// operations.
STAGE boxed illumination_difference(boxed now, colour past, frame_t frame)
{
    const colour was = history_in_range(past, frame);
    if (BOX_SPACE != BOX_SPACE_YCOCG)
        return (boxed) { now.a - was.r, now.b - was.g, now.c - was.b };
    const real rb = was.r + was.b;
    return (boxed) { (now.a - rb) - K(2.0) * was.g, now.b - (was.r - was.b), (now.c + rb) - K(2.0) * was.g };
}

// Pairs the row `now` with the history j rows below the nearest texels.
STAGE illumination_row illumination_of_row(boxed_row now, history_in history, footprint n, int j, frame_t frame)
{
    const size_t plane = history_plane_size(frame);
    illumination_row row;
    const texel_row past = nearest_row(history, n, j, plane, row_stride(frame));
    const boxed left = illumination_difference(now.left, past.left, frame),
                own = illumination_difference(now.own, past.own, frame),
                right = illumination_difference(now.right, past.right, frame);
    row.a = difference_row(left.a, own.a, right.a);
    row.b = difference_row(left.b, own.b, right.b);
    row.c = difference_row(left.c, own.c, right.c);
    row.step = (boxed) { 0 };
    row.alpha_step = row.alpha_levels = SPLAT(0.0);
    if (ACCUMULATES_ALPHA) {
        const real l = now.alpha[0], c = now.alpha[1], r = now.alpha[2];
        row.alpha = difference_row(l - past.alpha[0], c - past.alpha[1], r - past.alpha[2]);
        row.alpha_level = (l + c) + r;
    }
    row.level = (absolute(now.left.a) + absolute(now.own.a)) + absolute(now.right.a);
    row.levels = SPLAT(0.0);
    return row;
}

// Joins a row to the one above it.
STAGE illumination_row illumination_below(illumination_row above, illumination_row row)
{
    row.step = (boxed) { row.a.mean - above.a.mean, row.b.mean - above.b.mean, row.c.mean - above.c.mean };
    row.a.spreads = above.a.spread + row.a.spread;
    row.b.spreads = above.b.spread + row.b.spread;
    row.c.spreads = above.c.spread + row.c.spread;
    if (ACCUMULATES_ALPHA) {
        row.alpha_step = row.alpha.mean - above.alpha.mean;
        row.alpha.spreads = above.alpha.spread + row.alpha.spread;
        row.alpha_levels = above.alpha_level + row.alpha_level;
    }
    row.levels = above.level + row.level;
    return row;
}

// Returns the pixel's own row, joined to the one above it.
STAGE illumination_row illumination_above(
    plane_in current, plane_in alpha, history_in history, footprint n, int x, int y, frame_t frame)
{
    if (LANES == 1) {
        const illumination_row above
            = illumination_of_row(read_boxed(current, alpha, x, y - 1, frame), history, n, -1, frame);
        return illumination_below(
            above, illumination_of_row(read_boxed(current, alpha, x, y, frame), history, n, 0, frame));
    }
    illumination_row row = { 0 };
    NO_UNROLL
    for (int j = -1; j <= 0; ++j)
        row = illumination_below(
            row, illumination_of_row(read_boxed(current, alpha, x, y + j, frame), history, n, j, frame));
    return row;
}

// What is added to the deviation of a channel whose nine samples have this sum of levels.
STAGE real least_deviation(real level, real tiny, settings_t settings)
{
    return K(settings.illumination_floor) * (level * K(ONE_THIRD)) + tiny;
}

// Result of the test: the reduced sample count, and the illumination change.
typedef struct
{
    real count, change;
} illumination_result;

// Divides the history's `held` samples by max(1, |change| / threshold)^2. Squared, since history that is off by k
// standard deviations errs as much as the mean of 1 / k^2 samples. `change` is Student's t of the channel that changed
// most, with the sign of luminance, or of alpha where that changed most, plus illumination_decay times the stored
// change of the previous frame. Jitter moves all nine differences one way in one frame and another way in the next, a
// light change goes on, so jitter stays small in the sum. Where light falls, falling_t times the threshold counts: nine
// dim samples of noise agree, nine with a bright one do not. `next` is the row below the pixel's.
STAGE illumination_result illumination_test(real held, real threshold, plane_in current, plane_in alpha, boxed_row next,
    history_in history, plane_in count, footprint f, int x, int y, frame_t frame, settings_t settings,
    illumination_cache* cache)
{
    const footprint n = nearest_texels(f, row_stride(frame));
    const int uniform_lanes = (LANES == 1) | (n.lanes == LANES_UNIFORM);
    if (!uniform_lanes | (n.at != cache->nearest))
        cache->row = illumination_above(current, alpha, history, n, x, y, frame);
    const illumination_row centre = cache->row;
    const illumination_row below = illumination_below(centre, illumination_of_row(next, history, n, 1, frame));
    cache->row = below;
    cache->nearest = uniform_lanes ? n.at + (uint)row_stride(frame) : 0;
    const real least = least_deviation(centre.levels + below.level, SPLAT(BOX_A * TINY), settings);
    const boxed up = centre.step, down = below.step; // the step to the row above is -up, to the bit
    const real ta = third_of_students_t(centre.a, below.a, -up.a, down.a, least),
               tb = third_of_students_t(centre.b, below.b, -up.b, down.b, K(BOX_B / BOX_A) * least),
               tc = third_of_students_t(centre.c, below.c, -up.c, down.c, least);
    real largest = greater(absolute(ta), greater(absolute(tb), absolute(tc)));
    real signed_t = ta;
    if (ACCUMULATES_ALPHA) {
        const real of_alpha = third_of_students_t(centre.alpha, below.alpha, -centre.alpha_step, below.alpha_step,
            least_deviation(centre.alpha_levels + below.alpha_level, SPLAT(TINY), settings));
        signed_t = absolute(of_alpha) > largest ? of_alpha : ta;
        largest = greater(largest, absolute(of_alpha));
    }
    largest = K(3.0) * largest;
    const real most = SPLAT(settings.largest_t);
    const real t = lesser(largest, most); // `most` where `largest` is NaN
    const real before = texel_at(count + history_plane_size(frame), n, row_stride(frame));
    const real change = (signed_t < SPLAT(0.0) ? -t : t) + K(settings.illumination_decay) * before;
    const real from = change < SPLAT(0.0) ? SPLAT(settings.falling_t) * threshold : threshold;
    const real by = greater(quotient(absolute(change), from), SPLAT(1.0));
    return (illumination_result) { quotient(held, by * by), stored_change(change) };
}

// Corrects the result where a pixel's own sample is missing. Repaired texels say nothing about light: unless at least
// five of the nine were rendered, the count stays as before the test and the change is 0.
STAGE illumination_result illumination_without_missing(
    illumination_result l, real held, plane_in current, plane_in alpha, int x, int y, frame_t frame)
{
    real rendered = SPLAT(0.0);
    NO_UNROLL
    for (int k = 0; k < 9; ++k)
        rendered += sample_is_missing(current, alpha, x + k % 3 - 1, y + k / 3 - 1, frame) ? SPLAT(0.0) : SPLAT(1.0);
    const mask untested = sample_is_missing(current, alpha, x, y, frame) & (rendered < SPLAT(5.0));
    return (illumination_result) { untested ? held : l.count, untested ? SPLAT(0.0) : l.change };
}
