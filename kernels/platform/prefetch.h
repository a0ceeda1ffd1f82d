// Software prefetch, by the instructions that the device has for it.
#include "platform/image.h"

#if !defined(COLUMNS_AHEAD) || !defined(FAR_FIRST)
#error "prefetch.h needs COLUMNS_AHEAD and FAR_FIRST from the prelude"
#endif

// Prefetches the texels right of the LANES from p on. On a CPU, where a work-item walks down, the work-items after this
// one read those; no hardware predicts a step of a whole row. OpenCL's own prefetch does nothing on some CPU drivers,
// and the compiler's takes no pointer into a GPU's memory.
#if LANES > 1 && __has_builtin(__builtin_prefetch) && (defined(__x86_64__) || defined(__aarch64__))
#define PREFETCH_NEXT(p) __builtin_prefetch((const void*)(size_t)((p) + LANES))
// Prefetches the LANES from `far` on into the second-level cache, or with FAR_FIRST into the first, which evicts them
// to the second; those from `near` on, and the ones after them, into the first.
#define PREFETCH_FAR(far) __builtin_prefetch((const void*)(size_t)(far), 0, FAR_FIRST ? 3 : 2)
#define PREFETCH_TWICE(far, near)                                                                                      \
    (PREFETCH_FAR(far), __builtin_prefetch((const void*)(size_t)(near), 0, 3), PREFETCH_NEXT(near))
#endif
// On a GPU neighbouring work-items read those at the same time, so p itself is prefetched.
#if NVIDIA
#define PREFETCH_NEXT(p) __asm volatile("prefetch.global.L1 [%0];" ::"l"(p))
#endif
#ifndef PREFETCH_NEXT
#define PREFETCH_NEXT(p) (void)(p)
#endif
#ifndef PREFETCH_FAR
#define PREFETCH_FAR(far) (void)(far)
#endif
#ifndef PREFETCH_TWICE
#define PREFETCH_TWICE(far, near) (void)(far)
#endif

#define ROWS_NEAR (FAR_FIRST ? 1 : 2) // rows by which `near`, from the second-level cache, lies less far below

// Prefetches the texel of plane p that lies `rows` rows below the one at `at`. With a constant stride the step is part
// of NVIDIA's instruction, which then shares the address of the loads around it.
#if NVIDIA && STRIDE > 0
#define PREFETCH_BELOW(p, at, rows, stride)                                                                            \
    __asm volatile("prefetch.global.L1 [%0+%1];" ::"l"((p) + (at)), "n"((rows) * STRIDE * (int)sizeof(*(p))))
#elif COLUMNS_AHEAD
#define PREFETCH_BELOW(p, at, rows, stride)                                                                            \
    PREFETCH_TWICE(ROW_BELOW(p, at, rows, stride) + COLUMNS_AHEAD * LANES, ROW_BELOW(p, at, rows - ROWS_NEAR, stride))
#else
#define PREFETCH_BELOW(p, at, rows, stride) PREFETCH_NEXT(ROW_BELOW(p, at, rows, stride))
#endif
