// real: the number that every stage computes with. One float (or double) a work-item on GPUs, a vector of LANES
// neighbouring pixels on CPUs. The same source serves both: comparisons give masks, masks are combined with & and |,
// and values are chosen with `mask ? a : b`, which selects lane by lane on vectors.
//
// No max, min, clamp or mix on reals: they are undefined or inexact for NaN in OpenCL C, and calls on some CPU drivers.
#if !defined(LANES) || !defined(REAL_DOUBLE) || !defined(STORAGE_HALF) || !defined(STORAGE_DOUBLE)
#error "real.h needs LANES, REAL_DOUBLE, STORAGE_HALF and STORAGE_DOUBLE from the prelude"
#endif
#if !defined(STRICT) || !defined(RELAXED)
#error "real.h needs STRICT and RELAXED from the prelude"
#endif
#if (defined(__FAST_RELAXED_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)) && !RELAXED
#error "finite-math flags remove the guards against NaN: build without -cl-fast-relaxed-math"
#endif
#if STRICT
#pragma OPENCL FP_CONTRACT OFF
#else
#pragma OPENCL FP_CONTRACT ON
#endif

#if defined(__has_warning) && LANES > 1
#if __has_warning("-Wpsabi")
// Vectors wider than the CPU's registers are passed in memory; every function here is inlined, so no ABI is at stake.
#pragma clang diagnostic ignored "-Wpsabi"
#endif
#endif

// One float a work-item, and no need of the strict build's roundings: the device's own maximum and minimum.
#define NATIVE (LANES == 1 && !REAL_DOUBLE && !STRICT)
// What the instruction set of NVIDIA's GPUs has and OpenCL C has not: docs/performance.md, A GPU.
#if LANES == 1 && defined(cl_nv_pragma_unroll)
#define NVIDIA 1
#else
#define NVIDIA 0
#endif

// Every stage function is inlined: a call would pass whole rows of vectors through memory.
#define STAGE static inline __attribute__((always_inline))

// Before a loop that stays one on a CPU, around what is rare or long: written out it is what a compiler takes its time
// over. A GPU keeps in registers only what it has written out.
#if LANES > 1 && defined(__clang__)
#define ROLLED _Pragma("clang loop unroll(disable)")
#else
#define ROLLED
#endif

#define PASTE_(a, b) a##b
#define PASTE(a, b) PASTE_(a, b)
#if LANES == 1
#define LANED(type) type
#else
#define LANED(type) PASTE(type, LANES)
#endif

#if REAL_DOUBLE || STORAGE_DOUBLE
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#endif
#if REAL_DOUBLE
typedef double scalar;
typedef long scalar_whole;
typedef LANED(double) real;
typedef LANED(long) whole;
#define AS_WHOLE PASTE(as_, LANED(long))
#define TO_WHOLE PASTE(PASTE(convert_, LANED(long)), _rtz)
#define TO_REAL PASTE(convert_, LANED(double))
#define MAGNITUDE_BITS 0x7fffffffffffffffL
#else
typedef float scalar;
typedef int scalar_whole;
typedef LANED(float) real;
typedef LANED(int) whole;
#define AS_WHOLE PASTE(as_, LANED(int))
#define TO_WHOLE PASTE(PASTE(convert_, LANED(int)), _rtz)
#define TO_REAL PASTE(convert_, LANED(float))
#define MAGNITUDE_BITS 0x7fffffff
#endif
typedef whole mask;

// Literals: the formula's coefficient in the precision of real.
#define K(value) ((scalar)(value))
#define SPLAT(value) ((real)(K(value)))

// Planes hold floats; only the history may be stored in half or double.
typedef __global const float* restrict plane_in;
typedef __global float* restrict plane_out;
#if STORAGE_HALF
typedef __global const half* restrict history_in;
typedef __global half* restrict history_out;
#elif STORAGE_DOUBLE
typedef __global const double* restrict history_in;
typedef __global double* restrict history_out;
#else
typedef __global const float* restrict history_in;
typedef __global float* restrict history_out;
#endif

// Starts to bring the texels right of the LANES from p on into the cache. On a CPU, where a work-item walks down, those
// are what the work-items after this one will find there; nothing foresees a step of a whole row. OpenCL's own prefetch
// does nothing on some CPU drivers, and the compiler's takes no pointer into a GPU's memory.
#if LANES > 1 && defined(__has_builtin) && (defined(__x86_64__) || defined(__aarch64__))
#if __has_builtin(__builtin_prefetch)
#define FETCH_NEXT(p) __builtin_prefetch((const void*)(size_t)((p) + LANES))
#endif
#endif
// On a GPU the work-items beside this one read those at the same time, so p itself is fetched.
#if NVIDIA
#define FETCH_NEXT(p) __asm volatile("prefetch.global.L1 [%0];" ::"l"(p))
#endif
#ifndef FETCH_NEXT
#define FETCH_NEXT(p) (void)(p)
#endif

// Results that fill a line of the cache go past it: the line need not be fetched to be overwritten, and the stores
// behind it do not wait for that. Segments begin on a multiple of 64 bytes: so do rows (ROW_ALIGNMENT, PAD_X), and
// buffers on 128, the size of the largest type of OpenCL.
#define STORES_LINES 0
#if LANES == 16 && defined(__has_builtin)
#if __has_builtin(__builtin_nontemporal_store)
#undef STORES_LINES
#define STORES_LINES 1
#endif
#endif

// What a CPU has an instruction for, and not every compiler a name.
#define REDUCES 0
#define ELEMENTWISE 0
#if defined(__has_builtin) && LANES > 1
#if __has_builtin(__builtin_reduce_or)
#undef REDUCES
#define REDUCES 1
#endif
#if __has_builtin(__builtin_elementwise_floor) && __has_builtin(__builtin_elementwise_abs)
#undef ELEMENTWISE
#define ELEMENTWISE 1
#endif
#endif

// Sixteen floats from anywhere by one instruction. Where it was measured it takes half of the time of sixteen loads.
#define GATHERS 0
#if LANES == 16 && !REAL_DOUBLE && defined(__AVX512F__) && defined(__has_builtin)
#if __has_builtin(__builtin_ia32_gathersiv16sf)
#undef GATHERS
#define GATHERS 1
#endif
#endif

#if LANES == 1
STAGE real load(plane_in p) { return *p; }
STAGE void store(plane_out p, real v) { *p = (float)v; }
STAGE int any_of(mask m) { return m != 0; }
STAGE scalar_whole first_lane(whole v) { return v; }
#define LANE_INDEX ((real)(0))
#else
#if REAL_DOUBLE
STAGE real load(plane_in p) { return PASTE(convert_, LANED(double))(PASTE(vload, LANES)(0, p)); }
STAGE void store(plane_out p, real v) { PASTE(vstore, LANES)(PASTE(convert_, LANED(float))(v), 0, p); }
#else
// A vector at any float's address; vloadn and vstoren are calls on some CPU drivers.
typedef real loose_real __attribute__((aligned(4)));
STAGE real load(plane_in p) { return *(__global const loose_real*)p; }
#if STORES_LINES
STAGE void store(plane_out p, real v) { __builtin_nontemporal_store(v, (__global real*)p); }
#else
STAGE void store(plane_out p, real v) { *(__global loose_real*)p = v; }
#endif
#endif
#if LANES == 16
#define HALVES(m) ((m).lo.lo | (m).lo.hi | (m).hi.lo | (m).hi.hi)
#define LANE_NUMBERS 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15
#elif LANES == 8
#define HALVES(m) ((m).lo | (m).hi)
#define LANE_NUMBERS 0, 1, 2, 3, 4, 5, 6, 7
#elif LANES == 4
#define HALVES(m) (m)
#define LANE_NUMBERS 0, 1, 2, 3
#else
#error "LANES is 1, 4, 8 or 16"
#endif
#define LANE_INDEX ((real)(LANE_NUMBERS))
#if REDUCES
// Straight from the register of masks, where there is one.
STAGE int any_of(mask m) { return __builtin_reduce_or(m != 0) != 0; }
#else
STAGE int any_of(mask m) { return (HALVES(m).x | HALVES(m).y | HALVES(m).z | HALVES(m).w) != 0; }
#endif
STAGE scalar_whole first_lane(whole v) { return v.s0; }
#endif

#if LANES == 1
// A GPU's instructions take the magnitude of an operand for nothing.
STAGE real absolute(real v) { return fabs(v); }
#else
STAGE real absolute(real v)
{
#if REAL_DOUBLE
    return PASTE(as_, LANED(double))(AS_WHOLE(v) & MAGNITUDE_BITS);
#else
    return PASTE(as_, LANED(float))(AS_WHOLE(v) & MAGNITUDE_BITS);
#endif
}
#endif

// Greater and lesser of two reals; where b is no number, a GPU's instruction gives a.
#if NATIVE
STAGE real greater(real a, real b) { return fmax(a, b); }
STAGE real lesser(real a, real b) { return fmin(a, b); }
#else
STAGE real greater(real a, real b) { return a > b ? a : b; }
STAGE real lesser(real a, real b) { return a < b ? a : b; }
#endif
// The same, and b where that is no number.
STAGE real greater_or_nan(real a, real b) { return a > b ? a : b; }
// v limited to [lo, hi]; the caller makes sure that lo <= hi.
STAGE real limit(real v, real lo, real hi) { return lesser(greater(v, lo), hi); }

// A lane's root. The compiler's own is one instruction; the library's is a call on some CPU drivers.
#if NATIVE && NVIDIA
// The errors of these instructions are stated, and less than OpenCL allows a root and a division. Those of native_sqrt
// and native_recip it leaves open, so that other GPUs take root and division. What is nearly 0 counts as 0.
STAGE float SCALAR_ROOT(float v)
{
    float root;
    __asm("sqrt.approx.ftz.f32 %0, %1;" : "=f"(root) : "f"(v));
    return root;
}
STAGE float scalar_reciprocal(float v)
{
    float one_over;
    __asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(one_over) : "f"(v));
    return one_over;
}
#elif defined(__clang__) && LANES > 1
#if REAL_DOUBLE
#define SCALAR_ROOT __builtin_sqrt
#else
#define SCALAR_ROOT __builtin_sqrtf
#endif
#else
#define SCALAR_ROOT sqrt
#endif

// Correctly rounded in a strict build (IEEE 754 square root), within 3 ulp otherwise. Written out lane by lane, not as
// a loop, the roots of a vector become one instruction and never leave the registers.
#define ROOTS_4(v) SCALAR_ROOT((v).s0), SCALAR_ROOT((v).s1), SCALAR_ROOT((v).s2), SCALAR_ROOT((v).s3)
#define ROOTS_8(v) ROOTS_4((v).lo), ROOTS_4((v).hi)
#define ROOTS_16(v) ROOTS_8((v).lo), ROOTS_8((v).hi)
STAGE real square_root(real v)
{
#if LANES == 1
    return SCALAR_ROOT(v);
#else
    return (real)(PASTE(ROOTS_, LANES)(v));
#endif
}

// a / b: correctly rounded in a strict build, within 2.5 ulp otherwise, where 2^-126 <= |b| <= 2^126.
#if NATIVE && NVIDIA
STAGE real quotient(real a, real b) { return a * scalar_reciprocal(b); }
#else
STAGE real quotient(real a, real b) { return a / b; }
#endif
STAGE real reciprocal(real v) { return quotient(SPLAT(1.0), v); }

// Several quotients by one b: `over(a, divisor(b))` is what quotient(a, b) promises, for one division in all.
#if STRICT
STAGE real divisor(real b) { return b; }
STAGE real over(real a, real by) { return a / by; }
#else
STAGE real divisor(real b) { return reciprocal(b); }
STAGE real over(real a, real by) { return a * by; }
#endif

// Largest whole number not above v; |v| < 2^22, which the caller has tested.
#if LANES == 1
STAGE real floor_of(real v) { return floor(v); }
#elif ELEMENTWISE
STAGE real floor_of(real v) { return __builtin_elementwise_floor(v); }
#else
STAGE real floor_of(real v)
{
    const real cut = TO_REAL(TO_WHOLE(v));
    return cut > v ? cut - K(1.0) : (cut < v ? cut : v); // v itself where it is whole: -0 is
}
#endif

// floor_of(v) and the same as a whole number. NVIDIA's adder rounds downwards where asked to: 1.5 x 2^23 + v has no
// digits below 1. Two additions instead of two conversions, which every load of the history waits for.
#if NATIVE && NVIDIA
STAGE float floor_and_whole(float v, int* cut)
{
    float sum;
    __asm("add.rm.f32 %0, %1, 0f4b400000;" : "=f"(sum) : "f"(v));
    *cut = as_int(sum) - 0x4b400000;
    return sum - as_float(0x4b400000);
}
#else
STAGE real floor_and_whole(real v, whole* cut)
{
    const real low = floor_of(v);
    *cut = TO_WHOLE(low);
    return low;
}
#endif

// Usable input: finite and |v| <= DOMAIN_LIMIT. Tested on the bits where that costs nothing, so that no compiler flag
// can remove it; a GPU compares in one instruction.
STAGE mask outside_domain(real v)
{
#if LANES == 1 && !RELAXED
    return !(fabs(v) <= K(DOMAIN_LIMIT));
#elif REAL_DOUBLE
    return (AS_WHOLE(v) & MAGNITUDE_BITS) > as_long(DOMAIN_LIMIT);
#else
    return (AS_WHOLE(v) & MAGNITUDE_BITS) > as_int(DOMAIN_LIMIT);
#endif
}

// v, or what stands for it outside the domain. Compared as a number where no flag removes that: among numbers that were
// chosen by their bits a CPU's compiler sees no maximum, and a comparison and a choice take longer.
STAGE real usable_or(real v, real otherwise)
{
#if ELEMENTWISE && !RELAXED
    return !(__builtin_elementwise_abs(v) <= K(DOMAIN_LIMIT)) ? otherwise : v;
#else
    return outside_domain(v) ? otherwise : v;
#endif
}
