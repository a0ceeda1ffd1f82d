// lanes: how many pixels a work-item computes at once. One on GPUs, a vector of LANES neighbouring pixels on CPUs; and
// the loads, stores and tests across lanes for each case.
#if !defined(LANES) || !defined(REAL_DOUBLE) || !defined(STORAGE_HALF) || !defined(STORAGE_DOUBLE)
#error "lanes.h needs LANES, REAL_DOUBLE, STORAGE_HALF and STORAGE_DOUBLE from the prelude"
#endif

// Only Clang has these tests.
#ifndef __has_builtin
#define __has_builtin(name) 0
#endif
#ifndef __has_warning
#define __has_warning(name) 0
#endif

#if LANES > 1 && __has_warning("-Wpsabi")
// Vectors wider than the CPU's registers are passed in memory; every function here is inlined, so no ABI is at stake.
#pragma clang diagnostic ignored "-Wpsabi"
#endif

// Instructions of NVIDIA's GPUs that OpenCL C has no name for: docs/performance.md, A GPU.
#if LANES == 1 && defined(cl_nv_pragma_unroll)
#define NVIDIA 1
#else
#define NVIDIA 0
#endif

// Every stage function is inlined: a call would pass whole rows of vectors through memory. Tests that build without
// optimisation define it as static, which compiles in half the time.
#ifndef STAGE
#define STAGE static inline __attribute__((always_inline))
#endif

// Before a loop that stays rolled on a CPU, where its body is rare or long: unrolled it takes most of the compile time.
// A GPU keeps in registers only what is unrolled.
#if LANES > 1 && defined(__clang__)
#define NO_UNROLL _Pragma("clang loop unroll(disable)")
#else
#define NO_UNROLL
#endif

// Before a loop that a GPU has to unroll: it keeps an array in registers only where every index is a constant.
#if LANES == 1
#define UNROLL _Pragma("unroll")
#else
#define UNROLL
#endif

// Before a loop over single texels that is rare and long: neither unrolled nor vectorised.
#ifdef __clang__
#define ONE_BY_ONE _Pragma("clang loop unroll(disable) vectorize(disable)")
#else
#define ONE_BY_ONE
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
#define AS_REAL PASTE(as_, LANED(double))
#define TO_WHOLE PASTE(PASTE(convert_, LANED(long)), _rtz)
#define TO_REAL PASTE(convert_, LANED(double))
#define MAGNITUDE_BITS 0x7fffffffffffffffL
#define DOMAIN_BITS as_long(DOMAIN_LIMIT)
#else
typedef float scalar;
typedef int scalar_whole;
typedef LANED(float) real;
typedef LANED(int) whole;
#define AS_WHOLE PASTE(as_, LANED(int))
#define AS_REAL PASTE(as_, LANED(float))
#define TO_WHOLE PASTE(PASTE(convert_, LANED(int)), _rtz)
#define TO_REAL PASTE(convert_, LANED(float))
#define MAGNITUDE_BITS 0x7fffffff
#define DOMAIN_BITS as_int(DOMAIN_LIMIT)
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

// Results that fill a cache line bypass the cache: the line need not be fetched to be overwritten, and later stores do
// not wait for it. Segments begin on a multiple of 64 bytes: so do rows (ROW_ALIGNMENT, PAD_X), and buffers on 128, the
// size of the largest type of OpenCL.
#if LANES == 16 && __has_builtin(__builtin_nontemporal_store)
#define STORES_LINES 1
#else
#define STORES_LINES 0
#endif

// CPU instructions that not every compiler has a name for. Rusticl (Mesa 22.3), whose Clang does not tell its target,
// aborts the process at a reduction, which its path through SPIR-V cannot express.
#if LANES > 1 && __has_builtin(__builtin_reduce_or)                                                                    \
    && (defined(__x86_64__) || defined(__aarch64__) || defined(__SPIR__))
#define REDUCES 1
#else
#define REDUCES 0
#endif
#if LANES > 1 && __has_builtin(__builtin_elementwise_floor) && __has_builtin(__builtin_elementwise_abs)
#define ELEMENTWISE 1
#else
#define ELEMENTWISE 0
#endif

// Gathers sixteen floats or words by one instruction: half of the time of sixteen loads, where measured.
#if LANES == 16 && !REAL_DOUBLE && defined(__AVX512F__) && __has_builtin(__builtin_ia32_gathersiv16sf)                 \
    && __has_builtin(__builtin_ia32_gathersiv16si)
#define GATHERS 1
#else
#define GATHERS 0
#endif

// Converts a vector of halves to floats and back by one instruction each. OpenCL's vload_half and vstore_half are calls
// on some CPU drivers, and spill every register.
#if LANES == 16 && !REAL_DOUBLE && defined(__AVX512F__) && __has_builtin(__builtin_ia32_vcvtph2ps512_mask)             \
    && __has_builtin(__builtin_ia32_vcvtps2ph512_mask)
#define CONVERTS_HALVES 1
#define FROM_HALVES_BUILTIN(v) __builtin_ia32_vcvtph2ps512_mask(v, SPLAT(0.0), (ushort)0xffff, CURRENT_ROUNDING)
#define VECTOR_REGISTER "v"
#define TO_HALVES(v) __builtin_ia32_vcvtps2ph512_mask(v, NEAREST_EVEN, (short16)(0), (ushort)0xffff)
#elif LANES == 8 && !REAL_DOUBLE && defined(__F16C__) && __has_builtin(__builtin_ia32_vcvtph2ps256)                    \
    && __has_builtin(__builtin_ia32_vcvtps2ph256)
#define CONVERTS_HALVES 1
#define FROM_HALVES_BUILTIN(v) __builtin_ia32_vcvtph2ps256(v)
#define VECTOR_REGISTER "x"
#define TO_HALVES(v) __builtin_ia32_vcvtps2ph256(v, NEAREST_EVEN)
#else
#define CONVERTS_HALVES 0
#endif

#if LANES == 1
STAGE real load(plane_in p) { return *p; }
STAGE void store(plane_out p, real v) { *p = (float)v; }
STAGE int any_of(mask m) { return m != 0; }
STAGE scalar_whole first_lane(whole v) { return v; }
#define LANE_NUMBERS 0
#define LANE_INDEX ((real)(0))
STAGE real first_lanes(real v) { return v; }
#else
#if REAL_DOUBLE
STAGE real load(plane_in p) { return PASTE(convert_, LANED(double))(PASTE(vload, LANES)(0, p)); }
STAGE void store(plane_out p, real v) { PASTE(vstore, LANES)(PASTE(convert_, LANED(float))(v), 0, p); }
#else
// A vector at any float's address: vloadn and vstoren are calls on some CPU drivers.
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
// Reads the mask register directly, where there is one.
STAGE int any_of(mask m) { return __builtin_reduce_or(m != 0) != 0; }
#else
STAGE int any_of(mask m) { return (HALVES(m).x | HALVES(m).y | HALVES(m).z | HALVES(m).w) != 0; }
#endif
STAGE scalar_whole first_lane(whole v) { return v.s0; }
// Broadcasts the first lane.
STAGE real first_lanes(real v) { return (real)(v.s0); }
#endif

// Offset from the segment's own texel to each lane's; a plane has less than 2^31 texels.
STAGE whole lane_offsets(whole dx, whole dy, int stride) { return dy * stride + dx + (whole)(LANE_NUMBERS); }

// Loads the texels of a plane of floats at p + offsets, lane by lane.
STAGE real load_lanes(plane_in p, whole offsets)
{
#if GATHERS
    return __builtin_ia32_gathersiv16sf(SPLAT(0.0), (const void*)(size_t)p, offsets, (ushort)0xffff, sizeof(float));
#else
    real v;
    for (int lane = 0; lane < LANES; ++lane)
        ((scalar*)&v)[lane] = p[((const scalar_whole*)&offsets)[lane]];
    return v;
#endif
}
