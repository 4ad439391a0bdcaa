/* SPDX-License-Identifier: Apache-2.0
 *
 * Small matrix products. Those of a step are too small, and their strides too odd, for a library
 * to come near its speed: a batch of 33 products of 180 x 32 x 49 takes four times as long there.
 */
#include "steps.h"

#include <stdlib.h>
#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

#define TILE_ROWS 6
#define NARROW_ROWS 12

/* c [rows][vectors * LANE] (+)= a b, everything in registers; rows and vectors are constants. */
static inline __attribute__((always_inline)) void tile(const int rows, const int vectors, int k,
                                                       const float *a, long row, long column,
                                                       const float *b, long ldb, float *c,
                                                       long ldc, int add) {
    vec total[NARROW_ROWS][2];
#pragma GCC unroll 12
    for (int i = 0; i < rows; i++)
#pragma GCC unroll 2
        for (int j = 0; j < vectors; j++) total[i][j] = splat(0.0f);
    for (int step = 0; step < k; step++) {
        vec right[2];
#pragma GCC unroll 2
        for (int j = 0; j < vectors; j++) right[j] = load(b + step * ldb + LANE * j);
#pragma GCC unroll 12
        for (int i = 0; i < rows; i++) {
            vec left = splat(a[i * row + step * column]);
#pragma GCC unroll 2
            for (int j = 0; j < vectors; j++) total[i][j] += left * right[j];
        }
    }
#pragma GCC unroll 12
    for (int i = 0; i < rows; i++)
#pragma GCC unroll 2
        for (int j = 0; j < vectors; j++) {
            float *to = c + i * ldc + LANE * j;
            if (add) total[i][j] += load(to);
            store(to, total[i][j]);
        }
}

#define CASE(count, vectors)                                          \
    case count:                                                       \
        tile(count, vectors, k, a, row, column, b, ldb, c, ldc, add); \
        break;

static void wide_tile(int rows, int k, const float *a, long row, long column, const float *b,
                      long ldb, float *c, long ldc, int add) {
    switch (rows) {
        CASE(1, 2) CASE(2, 2) CASE(3, 2) CASE(4, 2) CASE(5, 2) CASE(6, 2)
    }
}

static void narrow_tile(int rows, int k, const float *a, long row, long column, const float *b,
                        long ldb, float *c, long ldc, int add) {
    switch (rows) {
        CASE(1, 1) CASE(2, 1) CASE(3, 1) CASE(4, 1) CASE(5, 1) CASE(6, 1)
        CASE(7, 1) CASE(8, 1) CASE(9, 1) CASE(10, 1) CASE(11, 1) CASE(12, 1)
    }
}

/* c [m][n] (+)= a [m][k] b [k][n]; n is a multiple of LANE, a's elements lie `row` and `column`
 * apart. */
void product(int m, int n, int k, const float *a, long row, long column, const float *b, long ldb,
             float *c, long ldc, int add) {
    int j = 0;
    for (; j + 2 * LANE <= n; j += 2 * LANE)
        for (int i = 0; i < m; i += TILE_ROWS) {
            int rows = m - i < TILE_ROWS ? m - i : TILE_ROWS;
            wide_tile(rows, k, a + i * row, row, column, b + j, ldb, c + i * ldc + j, ldc, add);
        }
    for (; j < n; j += LANE)
        for (int i = 0; i < m; i += NARROW_ROWS) {
            int rows = m - i < NARROW_ROWS ? m - i : NARROW_ROWS;
            narrow_tile(rows, k, a + i * row, row, column, b + j, ldb, c + i * ldc + j, ldc, add);
        }
}

/* gram [width][width] += weighted^T columns, both [count][width], where column >= row at least. */
void gram_add(int count, int width, const float *weighted, const float *columns, float *gram) {
    for (int i = 0; i < width; i += TILE_ROWS) {
        int rows = width - i < TILE_ROWS ? width - i : TILE_ROWS;
        int j = i / (2 * LANE) * (2 * LANE);
        product(rows, width - j, count, weighted + i, 1, width, columns + j, width,
                gram + (long)i * width + j, width, 1);
    }
}

/* Memory of this thread that stays for the next call: fresh pages cost more than what is computed
 * in them. */
float *scratch(int which, long floats) {
    static _Thread_local float *arena[ARENAS];
    static _Thread_local long size[ARENAS];
    if (size[which] < floats) {
        free(arena[which]);
        arena[which] = malloc(floats * sizeof(float));
        size[which] = arena[which] ? floats : 0;
        if (!arena[which]) abort();
    }
    return arena[which];
}

/* From here on, numbers of this thread below the smallest normal one are 0: tails of lobes are full
 * of them, and some processors (Intel's) take a hundred cycles for each. Returns what
 * `asglight_restore` takes. */
API uint32_t asglight_flush(void) {
#if defined(__SSE2__)
    uint32_t before = _mm_getcsr();
    _mm_setcsr(before | 0x8040); /* results (bit 15) and what is read (bit 6) */
    return before;
#else
    return 0;
#endif
}

API void asglight_restore(uint32_t before) {
#if defined(__SSE2__)
    _mm_setcsr(before);
#else
    (void)before;
#endif
}

/* What tells the sources of this library from others (library.py). */
API const char *asglight_sources(void) { return SOURCES; }
