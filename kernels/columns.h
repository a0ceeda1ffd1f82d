// Columns side by side. A work-item that walks along rows, COLUMNS segments at a time, keeps of each column what the
// next row needs of the two above it: in memory, a field an array, so that a compiler leaves out each that is not read.
#include "pixel.h"

#if !defined(COLUMNS)
#error "columns.h needs COLUMNS from the prelude"
#endif

// clang-format off
// X(member of row_t, its name here), all but the texels, which are read of the newest row alone.
#define MOMENTS(X, c) \
    X(c.shift, c##_shift) X(c.offset, c##_offset) X(c.spread, c##_spread) X(c.low, c##_low) X(c.high, c##_high) \
    X(c##_above.step, c##_step) X(c##_above.spreads, c##_spreads) \
    X(c##_above.low, c##_lower) X(c##_above.high, c##_higher)
#define COLOUR(X, c) X(c.r, c##_r) X(c.g, c##_g) X(c.b, c##_b)
#define SURFACE(X) \
    X(nearest, nearest) X(nearest_x, nearest_x) X(farthest, farthest) X(closeness, closeness) X(rise, rise) \
    X(u, u) X(v, v) X(centre_u, centre_u) X(centre_v, centre_v)
#define ROW_MEMBERS(X) \
    MOMENTS(X, a) MOMENTS(X, b) MOMENTS(X, c) COLOUR(X, centre) COLOUR(X, across) COLOUR(X, across_step) SURFACE(X)
// clang-format on

#define COLUMN_ARRAYS(member, name) real above_##name[COLUMNS], centre_##name[COLUMNS];
#define TAKE_COLUMN(member, name) above.member = above_##name[i], centre.member = centre_##name[i];
#define KEEP_COLUMN(member, name) above_##name[to] = centre.member, centre_##name[to] = below.member;

// The same number, of which a compiler knows nothing: one that sees a column taken and kept at one index holds all the
// addresses from the one to the other, two dozen of them, on the stack.
STAGE int another_index(int i)
{
#if defined(__x86_64__) || defined(__aarch64__)
    __asm("" : "+r"(i));
#endif
    return i;
}

// A segment that is still under way while the next one is read, TWO_UNDER_WAY. What follows its history is a long chain
// of divisions, and a CPU looks no further ahead than some hundred instructions that wait. So the chain is done in
// three parts, each among what the next segment begins with.
typedef struct
{
    pixel_t p;
    history_t h;
    rectification r;
    colour past, current; // rectified history, and the sample that is blended with it
    real count; // of the history
    int x, y;
} segment_t;

// As it stands once its history is known.
STAGE segment_t rectify_segment(
    pixel_t p, history_t h, motion_t m, plane_in alpha, int x, int y, frame_t frame, settings_t settings)
{
    segment_t s = { p, h, rectify(h.rgb, p.filtered, p.near, m, box_gamma(m, settings), frame, settings) };
    s.past = rectified(h, s.r);
    if (ALPHA)
        s.h.alpha = past_alpha(alpha + texel_offset(frame, x, y), h.alpha, frame);
    s.x = x;
    s.y = y;
    return s;
}

STAGE void weigh_segment(segment_t* s, settings_t settings)
{
    s->count = believed_samples(s->p, s->h, s->r, settings);
    s->current = sample_beside(s->p, s->h.valid, s->count, settings);
}

STAGE void finish_segment(segment_t s, history_out output, plane_out output_count, frame_t frame, settings_t settings)
{
    const resolved out = blend_pixel(s.p, s.h, s.r, s.past, s.current, s.count, settings);
    store_resolved(output, output_count, out, s.x, s.y, frame);
}
