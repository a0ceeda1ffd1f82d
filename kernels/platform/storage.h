// Storage formats of the history: floats, halves rounded to nearest, or halves rounded stochastically; and halves in
// files.
#include "platform/real.h"

#if !defined(STORAGE_HALF) || !defined(STORAGE_STOCHASTIC) || !defined(ILLUMINATION)
#error "storage.h needs STORAGE_HALF, STORAGE_STOCHASTIC and ILLUMINATION from the prelude"
#endif

// Store floats at any address, unchanged, or as halves rounded to nearest even; 65520 or more becomes infinite.
#if LANES == 1
STAGE void store_floats(__global float* p, real v) { *p = v; }
STAGE void store_halves(__global half* p, real v) { vstore_half_rte(v, 0, p); }
#else
STAGE void store_floats(__global float* p, real v) { PASTE(vstore, LANES)(v, 0, p); }
#if CONVERTS_HALVES
// Rounding modes of these instructions. The current mode has no effect on halves to floats, which is exact.
enum { NEAREST_EVEN = 0, CURRENT_ROUNDING = 4 };
typedef LANED(short) loose_halves __attribute__((aligned(2)));
STAGE void store_halves(__global half* p, real v) { *(__global loose_halves*)p = TO_HALVES(v); }
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
STAGE void store_halves(__global half* p, real v) { PASTE(PASTE(vstore_half, LANES), _rte)(v, 0, p); }
#endif
#endif

#if STORAGE_HALF
typedef LANED(uint) words;
#define TO_WORDS PASTE(convert_, LANED(uint))

// Clamps to the range of halves; what would round to -0 becomes +0.
STAGE real half_storable(real v)
{
    const real most = SPLAT(HALF_LIMIT), tiny = SPLAT(HALF_TINY);
    const real limited = v > most ? most : (v < -most ? -most : v);
    return ((limited <= tiny) & (limited >= -tiny)) ? SPLAT(0.0) : limited;
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
STAGE real storage_dither(int x, int y, frame_t frame)
{
    const words row = hash_bits((words)((uint)y) + hash_bits((words)((uint)frame.number)));
    const words bits = hash_bits((TO_WORDS(LANE_INDEX) + (words)((uint)x)) ^ row);
    return TO_REAL(bits >> 8) * SPLAT(DITHER_STEP);
}

// One of the two halves around v, the upper one with the probability of v's fraction between them, so that the mean
// over many dithers is v. Their distance is 2^-10 of the power of two below |v|, that of the least normal half at
// least; scaling by a power of two is exact.
STAGE real stochastic_half(real v, real dither)
{
    const real power = AS_REAL(AS_WHOLE(v) & 0x7f800000), least = SPLAT(HALF_NORMAL);
    const real step = (power > least ? power : least) * SPLAT(HALF_STEP);
    // The bits of 1 / 2^e: the biased exponents of a power of two and its reciprocal add up to 254.
    const real scaled = v * AS_REAL((whole)(0x7f000000) - AS_WHOLE(step));
    const whole cut = TO_WHOLE(scaled);
    const real low = TO_REAL(cut - (TO_REAL(cut) > scaled ? (whole)(1) : (whole)(0)));
    return (scaled - low > dither ? low + SPLAT(1.0) : low) * step;
}

STAGE real stored_half(real v, int x, int y, frame_t frame)
{
    const real rounded = half_storable(v);
    return STORAGE_STOCHASTIC ? stochastic_half(rounded, storage_dither(x, y, frame)) : rounded;
}
#endif

#if !STORAGE_HALF
STAGE real load_history(history_in p) { return load(p); }
STAGE void store_again(history_out p, real v) { store(p, v); }
#else
#if LANES == 1
STAGE real load_history(history_in p) { return vload_half(0, p); }
#elif CONVERTS_HALVES
STAGE real load_history(history_in p) { return from_halves(*(__global const loose_halves*)p); }
#else
STAGE real load_history(history_in p) { return PASTE(vload_half, LANES)(0, p); }
#endif
STAGE void store_again(history_out p, real v) { store_halves(p, v); }
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
    return *p;
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
#if STORAGE_HALF
    real v;
    for (int lane = 0; lane < LANES; ++lane)
        ((scalar*)&v)[lane] = load_one(p + ((const scalar_whole*)&offsets)[lane]);
    return v;
#else
    return load_lanes(p, offsets);
#endif
}
#endif
