// Storage formats of the history: floats, doubles, halves rounded to nearest, or halves rounded stochastically; and
// halves in files.
#include "platform/real.h"

#if !defined(STORAGE_HALF) || !defined(STORAGE_STOCHASTIC) || !defined(STORAGE_DOUBLE) || !defined(ILLUMINATION)
#error "storage.h needs STORAGE_HALF, STORAGE_STOCHASTIC, STORAGE_DOUBLE and ILLUMINATION from the prelude"
#endif

typedef LANED(float) floats;
#define TO_FLOATS PASTE(convert_, LANED(float))

// Store floats at any address, unchanged, or as halves rounded to nearest even; 65520 or more becomes infinite.
#if LANES == 1
STAGE void store_floats(__global float* p, floats v) { *p = v; }
STAGE void store_halves(__global half* p, floats v) { vstore_half_rte(v, 0, p); }
#else
STAGE void store_floats(__global float* p, floats v) { PASTE(vstore, LANES)(v, 0, p); }
#if CONVERTS_HALVES
// Rounding modes of these instructions. The current mode has no effect on halves to floats, which is exact.
enum { NEAREST_EVEN = 0, CURRENT_ROUNDING = 4 };
typedef LANED(short) loose_halves __attribute__((aligned(2)));
STAGE void store_halves(__global half* p, floats v) { *(__global loose_halves*)p = TO_HALVES(v); }
STAGE real from_halves(LANED(short) halves)
{
#if ILLUMINATION == ILLUMINATION_STATIC
    return FROM_HALVES_BUILTIN(halves);
#else
    // The illumination test lies behind branches. LLVM 14 moves a conversion that it recognises there, away from its
    // load, and since it has no vectors of halves it then converts them one by one.
    real v;
    __asm("vcvtph2ps %1, %0" : "=" VECTOR_REGISTER(v) : VECTOR_REGISTER(halves));
    return v;
#endif
}
#else
STAGE void store_halves(__global half* p, floats v) { PASTE(PASTE(vstore_half, LANES), _rte)(v, 0, p); }
#endif
#endif

#if STORAGE_HALF
typedef LANED(int) ints;
typedef LANED(uint) words;
#define AS_INTS PASTE(as_, LANED(int))
#define AS_FLOATS PASTE(as_, LANED(float))
#define TO_INTS PASTE(PASTE(convert_, LANED(int)), _rtz)
#define TO_WORDS PASTE(convert_, LANED(uint))

// Clamps to the range of halves; what would round to -0 becomes +0.
STAGE floats half_storable(floats v)
{
    const floats most = (floats)((float)HALF_LIMIT), tiny = (floats)((float)HALF_TINY);
    const floats limited = v > most ? most : (v < -most ? -most : v);
    return ((limited <= tiny) & (limited >= -tiny)) ? (floats)(0.0f) : limited;
}

// Hashes a number to 32 bits (the integer hash "lowbias32", Wellons 2018).
STAGE words hash_bits(words v)
{
    v = (v ^ (v >> 16)) * (words)(0x7feb352du);
    v = (v ^ (v >> 15)) * (words)(0x846ca68bu);
    return v ^ (v >> 16);
}

// A pseudo-random number in [0, 1), new for every pixel and frame and the same in every run. The channels of a pixel
// share it, so that greys stay grey.
STAGE floats storage_dither(int x, int y, frame_t frame)
{
    const words row = hash_bits((words)((uint)y) + hash_bits((words)((uint)frame.number)));
    const words bits = hash_bits((TO_WORDS(LANE_INDEX) + (words)((uint)x)) ^ row);
    return TO_FLOATS(bits >> 8) * (floats)((float)DITHER_STEP);
}

// One of the two halves around v, the upper one with the probability of v's fraction between them, so that the mean
// over many dithers is v. Their distance is 2^-10 of the power of two below |v|, that of the least normal half at
// least; scaling by a power of two is exact.
STAGE floats stochastic_half(floats v, floats dither)
{
    const floats power = AS_FLOATS(AS_INTS(v) & 0x7f800000), least = (floats)((float)HALF_NORMAL);
    const floats step = (power > least ? power : least) * (floats)((float)HALF_STEP);
    // The bits of 1 / 2^e: the biased exponents of a power of two and its reciprocal add up to 254.
    const floats scaled = v * AS_FLOATS((ints)(0x7f000000) - AS_INTS(step));
    const ints cut = TO_INTS(scaled);
    const floats low = TO_FLOATS(cut - (TO_FLOATS(cut) > scaled ? (ints)(1) : (ints)(0)));
    return (scaled - low > dither ? low + (floats)(1.0f) : low) * step;
}

STAGE floats stored_half(real v, int x, int y, frame_t frame)
{
    const floats rounded = half_storable(TO_FLOATS(v));
    return STORAGE_STOCHASTIC ? stochastic_half(rounded, storage_dither(x, y, frame)) : rounded;
}
#endif

#if STORAGE_DOUBLE && LANES == 1
STAGE real load_history(history_in p) { return (real)*p; }
STAGE void store_again(history_out p, real v) { *p = (double)v; }
#elif STORAGE_DOUBLE
STAGE real load_history(history_in p) { return TO_REAL(PASTE(vload, LANES)(0, p)); }
STAGE void store_again(history_out p, real v) { PASTE(vstore, LANES)(PASTE(convert_, LANED(double))(v), 0, p); }
#elif !STORAGE_HALF
STAGE real load_history(history_in p) { return load(p); }
STAGE void store_again(history_out p, real v) { store(p, v); }
#else
#if LANES == 1
STAGE real load_history(history_in p) { return vload_half(0, p); }
#elif CONVERTS_HALVES
STAGE real load_history(history_in p) { return from_halves(*(__global const loose_halves*)p); }
#else
STAGE real load_history(history_in p) { return TO_REAL(PASTE(vload_half, LANES)(0, p)); }
#endif
STAGE void store_again(history_out p, real v) { store_halves(p, TO_FLOATS(v)); }
#endif

STAGE void store_history(history_out p, real v, int x, int y, frame_t frame)
{
#if STORAGE_HALF
    store_halves(p, stored_half(v, x, y, frame));
#else
    store_again(p, v);
#endif
}

// Loads one number of the history.
STAGE scalar load_one(history_in p)
{
#if STORAGE_HALF
    return vload_half(0, p);
#else
    return (scalar)*p;
#endif
}

// Loads the texels of the history at p + offsets, lane by lane.
#if STORAGE_HALF && CONVERTS_HALVES && LANES == 8
// Reads halves as bits and converts all by one instruction. It runs rarely, so it is a call: inlined it took registers
// from the rest.
static __attribute__((noinline)) real load_history_lanes(history_in p, whole offsets)
{
    LANED(short) halves;
    for (int lane = 0; lane < LANES; ++lane)
        ((short*)&halves)[lane] = ((__global const short*)p)[((const scalar_whole*)&offsets)[lane]];
    return from_halves(halves);
}
#elif STORAGE_HALF && CONVERTS_HALVES && GATHERS
// A gather loads 32-bit words: the lower half of each is the lane's texel, the upper half the texel right of it.
STAGE real load_history_lanes(history_in p, whole offsets)
{
    const whole words = __builtin_ia32_gathersiv16si((whole)(0), (const void*)(size_t)p, offsets, (ushort)0xffff, 2);
    return from_halves(__builtin_convertvector(words, short16));
}
#else
STAGE real load_history_lanes(history_in p, whole offsets)
{
#if STORAGE_HALF || STORAGE_DOUBLE
    real v;
    for (int lane = 0; lane < LANES; ++lane)
        ((scalar*)&v)[lane] = load_one(p + ((const scalar_whole*)&offsets)[lane]);
    return v;
#else
    return load_lanes(p, offsets);
#endif
}
#endif
