// Converts between planes and a program's arrays: [H, W, C] in any order of their axes in memory, floats or halves.
#include "platform/image.h"
#include "platform/storage.h"

#define AS_IT_IS 0
#define PERSPECTIVE 1

// Converts a number of an array: unchanged, or from planar distance to inverse depth (cltaa/camera.py), where values up
// to `below` become `at`.
STAGE float converted(float v, int kind, float below, float at)
{
    if (kind == AS_IT_IS)
        return v;
    if (kind != PERSPECTIVE)
        return fabs(v) < INFINITY ? -v : -0x1p50f;
    const float inverse = 1.0f / v, usable = inverse >= 0.0f && inverse < INFINITY ? inverse : 0.0f;
    return usable <= below ? at : usable;
}

STAGE float element(__global const float* array, size_t at, int halves)
{
    return halves ? vload_half(at, (__global const half*)array) : array[at];
}

// Fills planes and their halo from an array that holds `height` rows from row `top` of the planes on. The work-items of
// a row take its texels in turn; on a CPU one takes all.
__kernel void unpack_kernel(__global const float* restrict source, __global float* restrict target, const int width,
    const int height, const int stride, const int rows, const int top, const int planes, const int first,
    const int row_step, const int column_step, const int plane_step, const int halves, const int kind,
    const float below, const float at)
{
    const int row = (int)get_global_id(1);
    if (row >= rows)
        return;
    const size_t begin = (size_t)first + (size_t)limit_index(row - top, height - 1) * (size_t)row_step;
    for (int plane = 0; plane < planes; ++plane) {
        const size_t from = begin + (size_t)plane * (size_t)plane_step;
        __global float* restrict to = target + ((size_t)plane * (size_t)rows + (size_t)row) * (size_t)stride;
        if (LANES == 1) {
            for (int x = (int)get_global_id(0); x < stride; x += (int)get_global_size(0))
                to[x] = converted(
                    element(source, from + (size_t)limit_index(x - PAD_X, width - 1) * (size_t)column_step, halves),
                    kind, below, at);
            continue;
        }
        // One loop for each case, so that it is vectorised.
        if (halves)
            for (int x = 0; x < width; ++x)
                to[PAD_X + x] = converted(element(source, from + (size_t)x * (size_t)column_step, 1), kind, below, at);
        else if (column_step == 1 && kind == AS_IT_IS)
            for (int x = 0; x < width; ++x)
                to[PAD_X + x] = source[from + (size_t)x];
        else if (column_step == 1 && kind == PERSPECTIVE)
            for (int x = 0; x < width; ++x)
                to[PAD_X + x] = converted(source[from + (size_t)x], PERSPECTIVE, below, at);
        else if (column_step == 3 && kind == AS_IT_IS)
            for (int x = 0; x < width; ++x)
                to[PAD_X + x] = source[from + (size_t)x * 3];
        else
            for (int x = 0; x < width; ++x)
                to[PAD_X + x] = converted(source[from + (size_t)x * (size_t)column_step], kind, below, at);
        for (int x = 0; x < PAD_X; ++x)
            to[x] = to[PAD_X];
        for (int x = PAD_X + width; x < stride; ++x)
            to[x] = to[PAD_X + width - 1];
    }
}

// Doubles a value from the largest half on, so that it exceeds all halves.
STAGE float beyond_half(float v) { return fabs(v) >= (float)HALF_LIMIT ? v + v : v; }

STAGE floats beyond_halves(floats v)
{
    const floats most = (floats)((float)HALF_LIMIT);
    return ((v >= most) | (v <= -most)) ? v + v : v;
}

// Writes the result to an array. Halves are rounded to nearest; from the largest half on they become infinite, so that
// the host finds such values and limits them (cltaa/pipeline/output.py).
__kernel void pack_kernel(history_in image, __global float* restrict target, const int width, const int height,
    const int stride, const int rows, const int planes, const int first, const int row_step, const int column_step,
    const int plane_step, const int halves)
{
    const int row = (int)get_global_id(1);
    if (row >= height)
        return;
    const size_t plane = (size_t)rows * (size_t)stride, from = (size_t)(row + PAD_Y) * (size_t)stride + PAD_X;
    const size_t begin = (size_t)first + (size_t)row * (size_t)row_step;
    int x = (int)get_global_id(0);
    if (LANES > 1 && column_step == 1) {
        for (int p = 0; p < planes; ++p) {
            const size_t to = begin + (size_t)p * (size_t)plane_step;
            for (x = 0; x + LANES <= width; x += LANES) {
                const floats v = TO_FLOATS(load_history(image + p * plane + from + x));
                if (halves)
                    store_halves((__global half*)target + to + x, beyond_halves(v));
                else
                    store_floats(target + to + x, v);
            }
        }
#if !STORAGE_HALF
    } else if (LANES > 1 && planes == 3 && column_step == 3 && plane_step == 1 && !halves) {
        history_in r = image + from, g = r + plane, b = g + plane;
        __global float* restrict to = target + begin;
        for (; x < width; ++x) {
            to[3 * x] = (float)r[x];
            to[3 * x + 1] = (float)g[x];
            to[3 * x + 2] = (float)b[x];
        }
#endif
    }
    for (; x < width; x += (int)get_global_size(0))
        for (int p = 0; p < planes; ++p) {
            const float v = load_one(image + p * plane + from + x);
            const size_t to = begin + (size_t)p * (size_t)plane_step + (size_t)x * (size_t)column_step;
            if (halves)
                vstore_half_rte(beyond_half(v), to, (__global half*)target);
            else
                target[to] = v;
        }
}
