// Gathers the samples that other frames rendered inside a pixel, each read at its own texel. Nothing is ever read
// between texels, so nothing blurs, however far and however long things move.
#include "gather/fit.h"
#include "gather/track.h"
#include "schedule/ahead.h"

// Jacobian of the motion to another frame: the derivative of motion_from_depth on a plane whose inverse depth changes
// by (slope_x, slope_y) a pixel. Samples rendered from farther away cover several current pixels, and lie that much
// farther apart. `parallax` is how far a unit of inverse depth moves the sample, along the axis where that is more.
typedef struct
{
    real xx, xy, yx, yy, parallax;
} jacobian_t;

STAGE jacobian_t jacobian_of(surface s, real slope_x, real slope_y, motion_t m, real x, real y, frame_t then)
{
    jacobian_t t = { 0 };
    if (!CAMERA_MOTION)
        return t;
    const real px = (x + s.x) + K(then.origin_x), py = (y + s.y) + K(then.origin_y), q = s.inverse_depth;
    const real dw = ((K(then.wx) * px + K(then.wy) * py) + K(then.wq) * q) + K(then.w1);
    const real w = m.visible ? SPLAT(1.0) + dw : SPLAT(1.0);
    const real wx = K(then.wx) + K(then.wq) * slope_x, wy = K(then.wy) + K(then.wq) * slope_y;
    const real by = divisor(w);
    t.xx = over((K(then.xx) + K(then.xq) * slope_x) - dw - (px + m.u) * wx, by);
    t.xy = over((K(then.xy) + K(then.xq) * slope_y) - (px + m.u) * wy, by);
    t.yx = over((K(then.yx) + K(then.yq) * slope_x) - (py + m.v) * wx, by);
    t.yy = over((K(then.yy) + K(then.yq) * slope_y) - dw - (py + m.v) * wy, by);
    const real across = K(then.xq) - (px + m.u) * K(then.wq), down = K(then.yq) - (py + m.v) * K(then.wq);
    t.parallax = over(greater(absolute(across), absolute(down)), by);
    return t;
}

// Positions of another frame's samples, seen from the current one: the one nearest to the pixel's centre, and the steps
// from it to the next to the right (xx, yx) and below (xy, yy). `visible` is false where that frame saw the surface
// edge on, or from behind.
typedef struct
{
    real x, y, xx, xy, yx, yy;
    mask visible;
} sample_grid_t;

STAGE sample_grid_t sample_grid(real dx, real dy, jacobian_t t)
{
    const real one = SPLAT(1.0), xx = one + t.xx, yy = one + t.yy, det = xx * yy - t.xy * t.yx;
    sample_grid_t p;
    p.visible = det > SPLAT(LEAST_W);
    const real share = reciprocal(p.visible ? det : one);
    p.xx = yy * share, p.xy = -t.xy * share, p.yx = -t.yx * share, p.yy = xx * share;
    p.x = p.xx * dx + p.xy * dy;
    p.y = p.yx * dx + p.yy * dy;
    return p;
}

// Distance from the pixel's centre along an axis from which samples of n frames have no weight: half a pixel, and the
// side of the square of 1 / n pixel that each represents; at most fit_reach, which limits it for few frames.
STAGE real reach_of(int n, settings_t settings)
{
    const real side = reciprocal(square_root(SPLAT(n)));
    return lesser(SPLAT(settings.fit_reach), SPLAT(0.5) + side);
}

// The weight of a sample `off` the centre along an axis: 1 in the middle, 0 from `reach` on, and 1/2 on the pixel's
// border, where half of the sample's area belongs to another pixel. Samples a pixel apart add up to the weight of one,
// wherever they lie.
STAGE real trapezoid(real off, real reach)
{
    const real zero = SPLAT(0.0), one = SPLAT(1.0);
    return limit((reach - absolute(off)) * reciprocal((reach + reach) - one), zero, one);
}

STAGE colour colour_at(plane_in p, footprint f, size_t plane, int stride)
{
    return (colour) { texel_at(p, f, stride), texel_at(p + plane, f, stride), texel_at(p + 2 * plane, f, stride) };
}

// A frame of the ring seen from a pixel: its planes, the motion to it, the texel whose sample lies nearest to the
// pixel's centre, and the positions of its samples.
typedef struct
{
    plane_in planes;
    motion_t m;
    mask seen;
    footprint f;
    real column, row; // of that texel
    sample_grid_t grid;
    real inverse_depth; // of the surface at the pixel's centre, now
    real parallax; // in pixels, of a unit of inverse depth
    real reach; // distance from which samples have no weight
    int recent; // 1: its samples are also summed separately
    mask static_ahead; // the surface has no own motion, and the frame is a later one
} view_t;

// Returns the weight of the sample `right` and `down` texels from the nearest one, and its offset. Most of the eight
// have weight 0, which is tested first. The halo of an image has no samples.
STAGE real neighbour_weight(view_t v, int right, int down, real* dx, real* dy, frame_t frame)
{
    const real zero = SPLAT(0.0), reach = v.reach;
    *dx = v.grid.x + (v.grid.xx * K(right) + v.grid.xy * K(down));
    *dy = v.grid.y + (v.grid.yx * K(right) + v.grid.yy * K(down));
    const mask near = v.seen & v.grid.visible & (absolute(*dx) < reach) & (absolute(*dy) < reach);
    if (!any_of(near))
        return zero;
    const real column = v.column + K(right), row = v.row + K(down), low = SPLAT(-0.5);
    const mask inside
        = (column > low) & (row > low) & (column < SPLAT(frame.width) - K(0.5)) & (row < SPLAT(frame.height) - K(0.5));
    const real share = trapezoid(*dx, reach) * trapezoid(*dy, reach);
    return near & inside ? share : zero;
}

// The columns and rows around the nearest sample outside of which none lies within reach: at most two each, or three
// where the surface recedes, so that its samples lie closer together now than then.
typedef struct
{
    int left, right, top, bottom;
} neighbours_t;

STAGE neighbours_t neighbours_within(view_t v)
{
    const sample_grid_t p = v.grid;
    const real beyond = v.reach + SPLAT(1.0 / 1024); // an offset of a few pixels is rounded by 2^-21
    const real by_x = p.xx - absolute(p.xy), by_y = p.yy - absolute(p.yx);
    const mask seen = v.seen & p.visible;
    const int left = any_of(seen & !(p.x - by_x <= -beyond)), right = any_of(seen & !(p.x + by_x >= beyond)),
              top = any_of(seen & !(p.y - by_y <= -beyond)), bottom = any_of(seen & !(p.y + by_y >= beyond));
    return (neighbours_t) { -left, right, -top, bottom };
}

// True where a sample of the sky holds a part of something: it is more opaque than the pixel, and beside a sample that
// has depth. A renderer that averages samples over each pixel leaves such a rim around all that it draws.
STAGE mask holds_rim(plane_in p, footprint f, real q, real alpha, pixel_t now, frame_t then, frame_t frame)
{
    const int stride = row_stride(frame);
    const real sky = SPLAT(then.sky_inverse_depth);
    const mask more = (q <= sky) & (alpha > now.alpha);
    mask beside = (mask)(0);
    if (!any_of(more))
        return beside;
    plane_in depth = p + RING_INVERSE_DEPTH * plane_size(frame);
    for (int k = 0; k < 9; ++k) {
        const ptrdiff_t by = (k / 3 - 1) * (ptrdiff_t)stride + (k % 3 - 1);
        beside = beside | (inverse_depth_or_sky(texel_at(depth + by, f, stride), then) > sky);
    }
    return more & beside;
}

// True where a sample of inverse depth `q`, `dx` and `dy` off the centre now, belongs to the followed surface: by the
// parallax of its own depth it lies at most LARGEST_PARALLAX from where the plane of the surface puts it. Leaves behind
// leaves lie within the range of the 3x3, but have slid along each other since an old frame.
STAGE mask keeps_to_surface(real q, real dx, real dy, view_t v, layers_t l)
{
    const real plane = (v.inverse_depth + (l.slope_x * dx + l.slope_y * dy)) * v.m.scale + v.m.shift;
    return absolute(q - plane) * v.parallax <= K(LARGEST_PARALLAX) * v.m.scale;
}

// Adds one sample of a frame of the ring, if it shows one of the pixel's surfaces; with `far_only`, if it shows the
// farther one.
STAGE void gather_sample(sample_sums* g, view_t v, int right, int down, pixel_t now, surface s, layers_t l,
    int far_only, frame_t then, frame_t frame, settings_t settings)
{
    const size_t plane = plane_size(frame);
    const int stride = row_stride(frame);
    const real zero = SPLAT(0.0);
    real dx, dy;
    const real share = neighbour_weight(v, right, down, &dx, &dy, frame);
    mask good = share > zero;
    if (!any_of(good))
        return;
    plane_in p = v.planes + down * (ptrdiff_t)stride + right;
    colour c = colour_at(p, v.f, plane, stride);
    const real opacity = ALPHA ? texel_at(p + RING_ALPHA * plane, v.f, stride) : SPLAT(1.0);
    good = good & !outside_domain_of((texel_t) { c, opacity });
    const real q = inverse_depth_or_sky(texel_at(p + RING_INVERSE_DEPTH * plane, v.f, stride), then);
    good = good & matches_surface(q, s, v.m, settings);
    real alpha = zero;
    if (ALPHA) {
        alpha = share_in_domain(opacity, SPLAT(1.0));
        good = good & !holds_rim(p, v.f, q, alpha, now, then, frame);
        alpha -= now.alpha;
    }
    if (OWN_MOTION & LOOK_AHEAD) {
        // The object there has set out since, or occludes the surface.
        plane_in moved = p + RING_MOTION * plane;
        const mask moves = !no_motion_vector(texel_at(moved, v.f, stride), texel_at(moved + plane, v.f, stride));
        good = good & !(v.static_ahead & moves);
    }
    const mask near = !l.edge | (q > l.cut * v.m.scale + v.m.shift);
    good = far_only ? good & !near : good;
    if (CAMERA_MOTION & (REJECT != REJECT_NONE)) // farther samples tell what the nearer surface leaves uncovered
        good = good & (keeps_to_surface(q, dx, dy, v, l) | (far_only ? near : !near));
    if (EXPOSURE)
        c = scaled(c, SPLAT(then.exposure_ratio));
    c = choose_colour(good, to_range(c), now.own);
    const colour d = minus(c, now.own);
    real counted = good ? share : zero;
    if (REACTIVE & (ILLUMINATION == ILLUMINATION_WINDOW)) {
        const real weight
            = reactivity_weight(share_in_domain(texel_at(p + RING_REACTIVE * plane, v.f, stride), zero), now);
        g->unlike += v.recent ? counted * (SPLAT(1.0) - weight) : zero;
        counted *= weight;
    }
    const real w = counted * luminance_weight(c, settings);
    add_sample(g, d, w, good ? dx : zero, good ? dy : zero, far_only ? !near : near);
    g->count += counted;
    g->alpha += w * alpha;
    if (v.recent)
        add_recent(g, weighted_difference(c, now.own, settings), alpha, counted);
}

// Returns the motion of the pixel's centre to a frame of the ring, by the sample that gives the depth or by the track,
// and its Jacobian.
STAGE motion_t motion_to_frame(
    jacobian_t* jacobian, track_t t, surface s, layers_t l, real px, real py, frame_t frame, frame_t then)
{
    const real zero = SPLAT(0.0);
    motion_t m = motion_from_depth(s, px, py, then);
    *jacobian = jacobian_of(s, l.slope_x, l.slope_y, m, px, py, then);
    const real ox = s.x + K(frame.jitter_x), oy = s.y + K(frame.jitter_y);
    m.u -= jacobian->xx * ox + jacobian->xy * oy;
    m.v -= jacobian->yx * ox + jacobian->yy * oy;
    if (OWN_MOTION) {
        m.u = t.own ? t.u : m.u;
        m.v = t.own ? t.v : m.v;
        m.scale = t.own ? SPLAT(1.0) : m.scale;
        m.shift = t.own ? t.shift : m.shift;
        m.visible = m.visible | t.own;
        jacobian->xx = t.own ? zero : jacobian->xx, jacobian->xy = t.own ? zero : jacobian->xy;
        jacobian->yx = t.own ? zero : jacobian->yx, jacobian->yy = t.own ? zero : jacobian->yy;
        jacobian->parallax = t.own ? zero : jacobian->parallax;
    }
    return m;
}

// Sums of a layer before it is followed. The nearer layer holds the current sample whatever that shows, the farther one
// only if it shows the farther side; neither holds a missing sample.
STAGE sample_sums begin_layer(surface s, layers_t l, int far, pixel_t p, frame_t frame, settings_t settings)
{
    const mask front = !l.edge | (s.centre > l.cut);
    const real w = luminance_weight(p.own, settings);
    if (far)
        return first_sample(w, !front & !p.missing, !front, frame);
    return first_sample(w, !p.missing, front, frame);
}

// Adds the mean of a side's texels in the current 3x3 as one sample: a disoccluded side has hardly another.
STAGE void add_side(sample_sums* g, side_t side, colour current, settings_t settings)
{
    const real zero = SPLAT(0.0);
    const mask any = side.count > zero;
    add_sample(g, minus(side.mean, current), any ? luminance_weight(side.mean, settings) : zero, zero, zero, any);
}

#define NEARER 0
#define FARTHER 1

// The nearer or the farther surface of a pixel while it is followed through the ring: the surface now, its tracks by
// own motion back and ahead, and the sums of its samples.
typedef struct
{
    side_t side;
    track_t track, ahead;
    sample_sums sums;
    int far; // NEARER or FARTHER
} path_t;

STAGE path_t begin_path(surface s, layers_t l, int far, pixel_t p, plane_in current, plane_in alpha,
    plane_in inverse_depth, plane_in motion, int x, int y, frame_t frame, settings_t settings)
{
    path_t path = { { s, l }, begin_track(s), begin_track_ahead(s), begin_layer(s, l, far, p, frame, settings), far };
    if (!any_of(l.edge))
        return path;
    path.side = side_of(s, l, far, p.own, current, alpha, inverse_depth, motion, x, y, frame, settings);
    path.track = begin_track(path.side.s);
    path.ahead = begin_track_ahead(path.side.s);
    if (far)
        add_side(&path.sums, path.side, p.own, settings);
    return path;
}

// Follows a surface of the pixel `now` through the frames in the ring `from` to `to` - 1, the latest being 0, and adds
// their samples; those of the first `recent` frames are also summed separately. past[k] holds the matrix from this
// frame to the k-th, its jitter, and its slot in `ring`. The pixel's centre, reprojected to frame k, falls into the
// area of exactly one sample there: the one whose position rounds to it. That sample and the eight around it are
// weighted by their positions in the current frame.
STAGE void gather_samples(path_t* path, plane_in ring, frame_records past, int from, int to, int recent, pixel_t now,
    int x, int y, frame_t frame, settings_t settings)
{
    const surface s = path->side.s;
    const layers_t l = path->side.l;
    const size_t plane = plane_size(frame);
    const uint at = texel_offset(frame, x, y);
    const real px = LANE_INDEX + K(x), py = SPLAT(y), reach = reach_of(to + 1, settings);
    const surface followed = range_of_side(s, l, path->far);
    const real inverse_depth
        = s.inverse_depth - ((s.x + K(frame.jitter_x)) * l.slope_x + (s.y + K(frame.jitter_y)) * l.slope_y);
    for (int k = from; k < to; ++k) {
        const frame_t then = past[k];
        const int ahead = LOOK_AHEAD ? then.ahead > 0 : 0;
        jacobian_t jacobian;
        view_t v;
        v.planes = ring + (size_t)then.slot * RING_PLANES * plane;
        track_t t = ahead ? path->ahead : path->track;
        if (OWN_MOTION & (ahead > 0)) {
            step_ahead(&t, followed, v.planes, px, py, at, plane, then, frame, settings);
            path->ahead = t;
        }
        v.m = motion_to_frame(&jacobian, t, s, l, px, py, frame, then);
        v.seen = on_screen(v.m, px, py, frame) & !t.lost;
        motion_t nearest = v.m;
        nearest.u = v.m.u + (K(0.5) - K(then.jitter_x));
        nearest.v = v.m.v + (K(0.5) - K(then.jitter_y));
        v.f = footprint_of(nearest, v.seen, at, frame);
        v.column = (px + nearest.u) - v.f.fx;
        v.row = (py + nearest.v) - v.f.fy;
        v.grid = sample_grid(SPLAT(0.5) - v.f.fx, SPLAT(0.5) - v.f.fy, jacobian);
        v.inverse_depth = inverse_depth;
        v.parallax = jacobian.parallax;
        v.reach = reach;
        v.recent = k < recent;
        v.static_ahead = ahead ? !t.own : (mask)(0);
        prefetch_planes(v.planes, RING_PLANES, v.f.at, frame);
        const neighbours_t near = neighbours_within(v);
        for (int down = near.top; down <= near.bottom; ++down)
            for (int right = near.left; right <= near.right; ++right)
                gather_sample(&path->sums, v, right, down, now, s, l, path->far, then, frame, settings);
        if (OWN_MOTION & (ahead == 0)) {
            motion_t place = nearest;
            place.u += s.x;
            place.v += s.y;
            step_back(&path->track, followed, v.m, v.planes, footprint_of(place, v.seen, at, frame), v.seen, plane,
                then, settings);
        }
    }
}
