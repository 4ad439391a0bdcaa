/* SPDX-License-Identifier: Apache-2.0
 *
 * Products in registers, for vectors of one width. product.c includes this with
 *   VECTOR     their type, of LANES floats
 *   TARGET     the attribute of functions that may use them
 *   WIDE_ROWS  rows of a tile of two vectors a row, NARROW_ROWS of one: as registers hold
 *   NAMED(x)   names of its own
 * Each element is summed in the order of `k`, so its bits do not depend on the width.
 */

/* c [rows][vectors * LANES] (+)= a b, everything in registers; rows and vectors are constants. */
TARGET static inline __attribute__((always_inline)) void NAMED(tile)(
    const int rows, const int vectors, int k, const float *a, long row, long column,
    const float *b, long ldb, float *c, long ldc, int add) {
    VECTOR total[12][2];
#pragma GCC unroll 12
    for (int i = 0; i < rows; i++)
#pragma GCC unroll 2
        for (int j = 0; j < vectors; j++) total[i][j] = (VECTOR){0};
    for (int step = 0; step < k; step++) {
        VECTOR right[2];
#pragma GCC unroll 2
        for (int j = 0; j < vectors; j++) right[j] = *(const VECTOR *)(b + step * ldb + LANES * j);
#pragma GCC unroll 12
        for (int i = 0; i < rows; i++) {
            float left = a[i * row + step * column];
#pragma GCC unroll 2
            for (int j = 0; j < vectors; j++) total[i][j] += left * right[j];
        }
    }
#pragma GCC unroll 12
    for (int i = 0; i < rows; i++)
#pragma GCC unroll 2
        for (int j = 0; j < vectors; j++) {
            VECTOR *to = (VECTOR *)(c + i * ldc + LANES * j);
            if (add) total[i][j] += *to;
            *to = total[i][j];
        }
}

#define CASE(count, vectors)                                                 \
    case count:                                                              \
        NAMED(tile)(count, vectors, k, a, row, column, b, ldb, c, ldc, add); \
        break;

TARGET static void NAMED(any_tile)(int rows, int vectors, int k, const float *a, long row,
                                   long column, const float *b, long ldb, float *c, long ldc,
                                   int add) {
    if (vectors == 2) switch (rows) {
            CASE(1, 2) CASE(2, 2) CASE(3, 2) CASE(4, 2) CASE(5, 2) CASE(6, 2)
#if WIDE_ROWS > 6
            CASE(7, 2) CASE(8, 2) CASE(9, 2) CASE(10, 2) CASE(11, 2) CASE(12, 2)
#endif
        }
    else switch (rows) {
            CASE(1, 1) CASE(2, 1) CASE(3, 1) CASE(4, 1) CASE(5, 1) CASE(6, 1)
            CASE(7, 1) CASE(8, 1) CASE(9, 1) CASE(10, 1) CASE(11, 1) CASE(12, 1)
        }
}

/* The first columns of `product`, as many as fill whole vectors; returns how many. */
TARGET static int NAMED(columns)(int m, int n, int k, const float *a, long row, long column,
                                 const float *b, long ldb, float *c, long ldc, int add) {
    int j = 0;
    while (n - j >= LANES) {
        int vectors = n - j >= 2 * LANES ? 2 : 1, most = vectors == 2 ? WIDE_ROWS : NARROW_ROWS;
        for (int i = 0; i < m; i += most)
            NAMED(any_tile)(m - i < most ? m - i : most, vectors, k, a + i * row, row, column,
                            b + j, ldb, c + i * ldc + j, ldc, add);
        j += vectors * LANES;
    }
    return j;
}

#undef CASE
#undef VECTOR
#undef LANES
#undef TARGET
#undef WIDE_ROWS
#undef NARROW_ROWS
#undef NAMED
