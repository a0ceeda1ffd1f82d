// Software prefetch, by the instructions that the device has for it.
#include "platform/image.h"

#if !defined(COLUMNS_AHEAD) || !defined(FAR_FIRST)
#error "prefetch.h needs COLUMNS_AHEAD and FAR_FIRST from the prelude"
#endif

// Starts to bring the texels right of the LANES from p on into the cache. On a CPU, where a work-item walks down, those
// are what the work-items after this one will find there; nothing foresees a step of a whole row. OpenCL's own prefetch
// does nothing on some CPU drivers, and the compiler's takes no pointer into a GPU's memory.
#if LANES > 1 && __has_builtin(__builtin_prefetch) && (defined(__x86_64__) || defined(__aarch64__))
#define FETCH_NEXT(p) __builtin_prefetch((const void*)(size_t)((p) + LANES))
// The LANES from `far` on into the second cache, or with FAR_FIRST into the first, which leaves them to the second;
// those from `near` on, and the ones after them, into the first.
#define FETCH_FAR(far) __builtin_prefetch((const void*)(size_t)(far), 0, FAR_FIRST ? 3 : 2)
#define FETCH_TWICE(far, near) (FETCH_FAR(far), __builtin_prefetch((const void*)(size_t)(near), 0, 3), FETCH_NEXT(near))
#endif
// On a GPU the work-items beside this one read those at the same time, so p itself is fetched.
#if NVIDIA
#define FETCH_NEXT(p) __asm volatile("prefetch.global.L1 [%0];" ::"l"(p))
#endif
#ifndef FETCH_NEXT
#define FETCH_NEXT(p) (void)(p)
#endif
#ifndef FETCH_FAR
#define FETCH_FAR(far) (void)(far)
#endif
#ifndef FETCH_TWICE
#define FETCH_TWICE(far, near) (void)(far)
#endif

#define ROWS_NEAR (FAR_FIRST ? 1 : 2) // fewer rows below, of what comes from the second cache

// The texel of plane p that lies `rows` rows below the one at `at`. Where a row's length is a constant the step is part
// of NVIDIA's instruction, so that it takes the address that the loads around it have.
#if NVIDIA && STRIDE > 0
#define FETCH_BELOW(p, at, rows, stride)                                                                               \
    __asm volatile("prefetch.global.L1 [%0+%1];" ::"l"((p) + (at)), "n"((rows) * STRIDE * (int)sizeof(*(p))))
#elif COLUMNS_AHEAD
#define FETCH_BELOW(p, at, rows, stride)                                                                               \
    FETCH_TWICE(ROW_BELOW(p, at, rows, stride) + COLUMNS_AHEAD * LANES, ROW_BELOW(p, at, rows - ROWS_NEAR, stride))
#else
#define FETCH_BELOW(p, at, rows, stride) FETCH_NEXT(ROW_BELOW(p, at, rows, stride))
#endif
