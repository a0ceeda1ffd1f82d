// Columns side by side. A work-item that walks along rows, COLUMNS segments at a time, keeps of each column what the
// next row needs of the two above it: in memory, a field an array, so that a compiler leaves out each that is not read.
#include "history.h"

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
