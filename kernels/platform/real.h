// real: the number that every stage computes with. One float (or double) a work-item on GPUs, a vector of LANES
// neighbouring pixels on CPUs. The same source serves both: comparisons give masks, masks are combined with & and |,
// and values are chosen with `mask ? a : b`, which selects lane by lane on vectors.
//
// No max, min, clamp or mix on reals: they are undefined or inexact for NaN in OpenCL C, and calls on some CPU drivers.
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
#include "platform/lanes.h"

// One float a work-item, without the strict build's roundings: the device's own maximum, minimum and root.
#define NATIVE ((LANES == 1) & !REAL_DOUBLE & !STRICT)

STAGE whole magnitude_bits(real v) { return AS_WHOLE(v) & MAGNITUDE_BITS; }

#if LANES == 1
// A GPU's instructions take the magnitude of an operand for free.
STAGE real absolute(real v) { return fabs(v); }
#else
STAGE real absolute(real v) { return AS_REAL(magnitude_bits(v)); }
#endif

// Greater and lesser of two reals; where b is NaN, a GPU's instruction gives a.
#if NATIVE
STAGE real greater(real a, real b) { return fmax(a, b); }
STAGE real lesser(real a, real b) { return fmin(a, b); }
#else
STAGE real greater(real a, real b) { return a > b ? a : b; }
STAGE real lesser(real a, real b) { return a < b ? a : b; }
#endif
// Clamps v to [lo, hi]; the caller ensures that lo <= hi.
STAGE real limit(real v, real lo, real hi) { return lesser(greater(v, lo), hi); }

// Square root of one lane. The compiler's builtin is one instruction; the library's is a call on some CPU drivers.
#if NATIVE && NVIDIA
// NVIDIA states the errors of these instructions: less than OpenCL allows a root and a division. OpenCL leaves those of
// native_sqrt and native_recip open, so other GPUs take root and division. Denormals are flushed to 0.
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

// Several quotients by one b: `over(a, divisor(b))` keeps the bounds of quotient(a, b), with one division in all.
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
    return cut > v ? cut - K(1.0) : (cut < v ? cut : v); // v itself where it is an integer: keeps -0
}
#endif

// True where input is unusable: not finite, or |v| > DOMAIN_LIMIT. Tests the bits where that costs nothing, so that no
// compiler flag can remove it; a GPU compares in one instruction.
STAGE mask outside_domain(real v)
{
#if LANES == 1 && !RELAXED
    return !(fabs(v) <= K(DOMAIN_LIMIT));
#else
    return magnitude_bits(v) > DOMAIN_BITS;
#endif
}

// v, or `otherwise` where v is outside the domain. Compares numbers where no flag removes that: if bits select the
// number, a CPU's compiler no longer recognises a maximum, and emits a slower comparison and selection.
STAGE real in_domain_or(real v, real otherwise)
{
#if ELEMENTWISE && !RELAXED
    return !(__builtin_elementwise_abs(v) <= K(DOMAIN_LIMIT)) ? otherwise : v;
#else
    return outside_domain(v) ? otherwise : v;
#endif
}
