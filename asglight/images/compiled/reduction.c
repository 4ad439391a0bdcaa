/* SPDX-License-Identifier: Apache-2.0
 *
 * Rows of an image, repaired and averaged: what asglight/images/decoding/reduction.py does in numpy,
 * which says what is computed and why, and which the tests hold this against.
 *
 * The body is compiled twice on x86, for every processor and for those with AVX2 and FMA, and the
 * one that runs is chosen by the processor at hand. Halves are widened by whole numbers, which needs
 * no F16C.
 */
#include <math.h>
#include <stdint.h>
#include <string.h>

#if defined(_WIN32)
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

#define BODY static inline __attribute__((always_inline))

/* Values as they lie in a file, anywhere. */
typedef uint16_t Half __attribute__((aligned(1), may_alias));
typedef float Float __attribute__((aligned(1), may_alias));

/* Rows of one strip: three planes, each row of which lies `stride` bytes after the one before. */
typedef struct {
    int64_t rows, width, is_half, stride[3];
    const void *planes[3];
} Strip;

/* From rows of the file to those of the result. */
typedef struct {
    const double *matrix;   /* [3][3] from the file's primaries; NULL where they are the result's */
    const double *areas;    /* [rows] solid angle of a texel */
    const float *shares;    /* [rows][2] of a row in the result's row at hand and in the next one */
    const uint8_t *is_last; /* [rows] the result's row at hand ends with it */
    int64_t columns, most;  /* of the result; texels of the file that one of them touches at most */
    const int64_t *first;   /* [columns] the first of them */
    const float *parts;     /* [columns][most] their shares */
} Grid;

/* What goes from strip to strip, and what comes out. */
typedef struct {
    float *sums;     /* [2][3][width] of the result's row at hand and of the next one */
    float *row;      /* [3][width] room for a row */
    float *result;   /* [rows of the result that end in the strip][columns][3] */
    double below;    /* flux of negative values, taken positive: grows */
    int64_t negative; /* texels: grows */
} State;

/* The float of a finite half; exact, and without the subnormal floats that some processors are slow
 * with: a subnormal half is got as (2^-14 + h) - 2^-14. */
BODY float widened(uint16_t half) {
    const uint32_t magnitude = (uint32_t)(half & 0x7fff) << 13;
    const uint32_t small_bits = magnitude + (113u << 23), base_bits = 113u << 23;
    const uint32_t normal_bits = magnitude + (112u << 23);
    float small, base, normal;
    memcpy(&small, &small_bits, 4);
    memcpy(&base, &base_bits, 4);
    memcpy(&normal, &normal_bits, 4);
    const float value = magnitude < (1u << 23) ? small - base : normal;
    return half & 0x8000 ? -value : value;
}

/* Widen a row. Returns 2 where a value is not finite, 1 where one may be negative, else 0. */
BODY int widen_halves(const Half *from, int64_t width, float *to) {
    uint16_t largest = 0, signs = 0;
    for (int64_t k = 0; k < width; k++) {
        const uint16_t magnitude = from[k] & 0x7fff;
        largest = magnitude > largest ? magnitude : largest;
        signs |= from[k];
    }
    if (largest >= 0x7c00) return 2;
    for (int64_t k = 0; k < width; k++) to[k] = widened(from[k]);
    return signs >> 15;
}

/* The same of floats. */
BODY int copy_floats(const Float *from, int64_t width, float *to) {
    uint32_t largest = 0, signs = 0;
    for (int64_t k = 0; k < width; k++) {
        uint32_t bits;
        to[k] = from[k];
        memcpy(&bits, to + k, 4);
        const uint32_t magnitude = bits & 0x7fffffff;
        largest = magnitude > largest ? magnitude : largest;
        signs |= bits;
    }
    return largest >= 0x7f800000 ? 2 : (int)(signs >> 31);
}

/* Convert a row's primaries in float64, in place. Returns as above. */
BODY int convert(const double *matrix, int64_t width, float *row) {
    uint32_t largest = 0, signs = 0;
    float *red = row, *green = row + width, *blue = row + 2 * width;
    for (int64_t k = 0; k < width; k++) {
        const double r = red[k], g = green[k], b = blue[k];
        red[k] = (float)(matrix[0] * r + matrix[1] * g + matrix[2] * b);
        green[k] = (float)(matrix[3] * r + matrix[4] * g + matrix[5] * b);
        blue[k] = (float)(matrix[6] * r + matrix[7] * g + matrix[8] * b);
    }
    for (int64_t k = 0; k < 3 * width; k++) {
        uint32_t bits;
        memcpy(&bits, row + k, 4);
        const uint32_t magnitude = bits & 0x7fffffff;
        largest = magnitude > largest ? magnitude : largest;
        signs |= bits;
    }
    return largest >= 0x7f800000 ? 2 : (int)(signs >> 31);
}

/* Set a row's negative values to 0 and count them. */
BODY void lift(int64_t width, double area, float *row, State *state) {
    double below = 0;
    int64_t negative = 0;
    for (int64_t k = 0; k < width; k++) {
        int is_negative = 0;
        for (int channel = 0; channel < 3; channel++) {
            float *value = row + channel * width + k;
            is_negative |= *value < 0;
            below += *value < 0 ? (double)*value : 0.0;
            *value = *value < 0 ? 0.0f : *value;
        }
        negative += is_negative;
    }
    state->below -= area * below;
    state->negative += negative;
}

/* The texels of a row of the result, from the sums over rows. */
BODY void average(const Grid *grid, int64_t width, const float *sums, float *result) {
    for (int64_t column = 0; column < grid->columns; column++) {
        const float *parts = grid->parts + column * grid->most;
        const float *from = sums + grid->first[column];
        float red = 0, green = 0, blue = 0;
        for (int64_t k = 0; k < grid->most; k++) {
            red += parts[k] * from[k];
            green += parts[k] * from[width + k];
            blue += parts[k] * from[2 * width + k];
        }
        result[3 * column] = red;
        result[3 * column + 1] = green;
        result[3 * column + 2] = blue;
    }
}

BODY int64_t reduce(const Strip *strip, const Grid *grid, State *state) {
    const int64_t width = strip->width, count = 3 * width;
    float *row = state->row, *sums = state->sums, *next = sums + count, *result = state->result;
    for (int64_t k = 0; k < strip->rows; k++) {
        int found = 0;
        for (int channel = 0; channel < 3; channel++) {
            const char *from = (const char *)strip->planes[channel] + k * strip->stride[channel];
            float *to = row + channel * width;
            const int one = strip->is_half ? widen_halves((const Half *)from, width, to)
                                           : copy_floats((const Float *)from, width, to);
            found = one > found ? one : found;
        }
        if (found < 2 && grid->matrix) found = convert(grid->matrix, width, row);
        if (found == 2) return k;
        if (found == 1) lift(width, grid->areas[k], row, state);
        const float share = grid->shares[2 * k], after = grid->shares[2 * k + 1];
        for (int64_t i = 0; i < count; i++) sums[i] += share * row[i];
        if (after != 0) {
            for (int64_t i = 0; i < count; i++) next[i] += after * row[i];
        }
        if (grid->is_last[k]) {
            average(grid, width, sums, result);
            result += 3 * grid->columns;
            memcpy(sums, next, count * sizeof *sums);
            memset(next, 0, count * sizeof *sums);
        }
    }
    return strip->rows;
}

#if defined(__x86_64__) || defined(__i386__)
__attribute__((target("avx2,fma"))) static int64_t reduce_avx2(
    const Strip *strip, const Grid *grid, State *state) {
    return reduce(strip, grid, state);
}
#endif

/* Take the rows of a strip in; stop before one with a value that is not finite. Returns how many
 * were taken. `state->result` gets the rows of the result that end with them. */
API int64_t asglight_reduce(const Strip *strip, const Grid *grid, State *state) {
#if defined(__x86_64__) || defined(__i386__)
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        return reduce_avx2(strip, grid, state);
    }
#endif
    return reduce(strip, grid, state);
}

/* What tells the sources that this was compiled from. */
API const char *asglight_sources(void) { return SOURCES; }
