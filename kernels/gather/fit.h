// Fit: from the samples in a pixel to its colour. A supersampler places its samples evenly; here jitter and motion
// place them, and the fit corrects for that.
#include "gather/sides.h"
#include "taa/accumulate.h"

// Sums over the samples of a pixel, of differences from the current one, so that equal samples keep its bits. along and
// down are weighted by the offset from the pixel's centre too. x to yy sum the weights times offsets and their
// products; near, near_x and near_y are the weights of the nearer of two surfaces' samples, and those times offsets.
// `weight` includes the current sample; `count`, the sum of the others' shares of the pixel, does not.
typedef struct
{
    colour sum, along, down;
    real alpha, weight, count, x, y, xx, xy, yy, near, near_x, near_y;
    // Of the latest frames alone, whichever side their samples show; only where light may change. `unlike` is the
    // weight that they lose because they were rendered with another reactivity.
    colour recent;
    real recent_alpha, recent_squares, recent_count, unlike;
} sample_sums;

// Adds a recent sample that differs by d, and by `alpha`, from the current one, with weight `counted`.
STAGE void add_recent(sample_sums* g, colour d, real alpha, real counted)
{
    g->recent = plus_scaled(g->recent, counted, d);
    g->recent_squares += counted * inner(d, d);
    if (ACCUMULATES_ALPHA) {
        g->recent_alpha += counted * alpha;
        g->recent_squares += counted * (alpha * alpha);
    }
    g->recent_count += counted;
}

// Adds a sample that differs by d from the current one and lies at (dx, dy), in pixels from the centre. A sample of the
// farther surface adds its position only.
STAGE void add_sample(sample_sums* g, colour d, real w, real dx, real dy, mask near)
{
    const real n = near ? w : SPLAT(0.0), wx = w * dx, wy = w * dy, nx = n * dx, ny = n * dy;
    g->sum = plus_scaled(g->sum, n, d);
    g->weight += w;
    g->x += wx;
    g->y += wy;
    g->xx += wx * dx;
    g->xy += wx * dy;
    g->yy += wy * dy;
    g->along = plus_scaled(g->along, nx, d);
    g->down = plus_scaled(g->down, ny, d);
    g->near += n;
    g->near_x += nx;
    g->near_y += ny;
}

// Sums of the current sample alone, where it is `counted`.
STAGE sample_sums first_sample(real w, mask counted, mask near, frame_t frame)
{
    sample_sums g = { 0 };
    const colour same = { 0 };
    add_sample(&g, same, counted ? w : SPLAT(0.0), SPLAT(frame.jitter_x), SPLAT(frame.jitter_y), near);
    return g;
}

// Weighted least squares of the plane value = a + b dx + c dy, as factors of the sums: a = one * sum - x * along - y *
// down. The mean of unevenly placed samples errs by slope times mean offset; this does not. The slope is damped as by
// fit_ridge evenly placed samples, so that few samples give nearly their mean.
typedef struct
{
    real one, x, y;
} fit_t;

STAGE fit_t fit_at_centre(sample_sums g, real samples, settings_t settings)
{
    const real mean = SPLAT(1.0) / g.weight, mx = g.x * mean, my = g.y * mean;
    const real ridge = K(settings.fit_ridge) * (g.weight / samples);
    const real xx = (g.xx - g.x * mx) + ridge, xy = g.xy - g.x * my, yy = (g.yy - g.y * my) + ridge;
    const real det = xx * yy - xy * xy;
    fit_t f;
    f.x = (yy * mx - xy * my) / det;
    f.y = (xx * my - xy * mx) / det;
    f.one = mean + (f.x * mx + f.y * my);
    return f;
}

STAGE real fitted(fit_t f, real sum, real along, real down) { return f.one * sum - (f.x * along + f.y * down); }

// Colour of a pixel's samples minus the current one. At a depth edge the nearer surface's coverage and colour are
// fitted to the samples along its track; behind it lies the mean of the samples along the farther surface's own track.
STAGE colour gathered_change(sample_sums g, sample_sums far, layers_t l, real samples, settings_t settings)
{
    const fit_t f = fit_at_centre(g, samples, settings);
    const colour v = { fitted(f, g.sum.r, g.along.r, g.down.r), fitted(f, g.sum.g, g.along.g, g.down.g),
        fitted(f, g.sum.b, g.along.b, g.down.b) };
    const real zero = SPLAT(0.0), one = SPLAT(1.0);
    const real seen = one - limit(fitted(f, g.near, g.near_x, g.near_y), zero, one);
    const mask any = far.weight > zero;
    // Without a sample of the farther surface the nearer one replaces it.
    const real mean = (l.edge ? seen : zero) / (any ? far.weight : (g.near > zero ? g.near : one));
    return plus_scaled(v, mean, choose_colour(any, far.sum, g.sum));
}

// Samples of a pixel in the current frame: one, or none.
STAGE real own_samples(pixel_t p) { return p.missing ? SPLAT(0.0) : SPLAT(1.0); }

// Share of its samples that a reactive pixel gives up for the current one. The latest samples already judge each
// temporal window, so there a pixel of medium reactivity gives up little.
STAGE real reactive_loss(real reactivity)
{
    const real square = reactivity * reactivity;
    return ILLUMINATION == ILLUMINATION_WINDOW ? square * square : reactivity;
}

// True where the alpha of other samples counts: where alpha is blended, and where the pixel has none of its own.
STAGE mask takes_alpha_of_others(pixel_t p) { return ALPHA_FROM == ALPHA_FROM_BLEND ? (mask)(-1) : p.missing; }

// Resolves the pixel from its samples and the current one. Where that is missing the others alone count, and where
// there are none the pixel is filled, with count 0.
STAGE resolved resolve_gathered(sample_sums g, sample_sums far, layers_t l, pixel_t p, motion_t m, plane_in image,
    plane_in alpha, int x, int y, frame_t frame, settings_t settings)
{
    const colour current = p.own;
    const real zero = SPLAT(0.0), one = SPLAT(1.0), samples = g.count + own_samples(p);
    const mask any = g.count > zero;
    const real weight = any ? g.weight : one;
    const colour past = plus(current, gathered_change(g, far, l, samples, settings));
    const rectification r = rectify(past, current, p.stats, m, box_scale_of(m, settings), frame, settings);
    const real share = REACTIVE ? one - reactive_loss(p.reactivity) : one;
    const colour mixed = plus_scaled(current, share, plus(minus(past, current), r.change));
    colour chosen = choose_colour(any, mixed, disoccluded_colour(current, p.stats.mean, settings));
    if ((FILTER_USE == FILTER_USE_FEW_SAMPLES) & (CURRENT_FILTER != CURRENT_FILTER_NONE)) {
        const real of_filter = fading_share(one / (g.count + one), settings);
        chosen = lerp_colour(chosen, p.filtered, filtered_share(of_filter, p.filtered, settings));
    }
    chosen = choose_colour(p.missing, past, chosen);
    const real opacity_of_all = p.alpha + (p.missing ? one : share) * (g.alpha / weight);
    real opacity = takes_alpha_of_others(p) ? opacity_of_all : p.alpha;
    const mask nothing = p.missing & !any;
    if (any_of(nothing)) {
        const texel_t filled = filled_texels(image, alpha, x, y, frame);
        chosen = choose_colour(nothing, filled.rgb, chosen);
        opacity = nothing ? filled.alpha : opacity;
    }
    resolved out;
    out.rgb = storable_colour(from_range(chosen), current);
    out.alpha = limit(opacity, zero, one);
    out.count = samples;
    return out;
}
