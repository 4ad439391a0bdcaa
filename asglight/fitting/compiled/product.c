/* SPDX-License-Identifier: Apache-2.0
 *
 * Small matrix products. Those of a step are too small, and their strides too odd, for a library
 * to come near its speed: a batch of 33 products of 180 x 32 x 49 takes four times as long there.
 */
#include "steps.h"

#include <pthread.h>
#include <stdlib.h>

#define GRAM_ROWS 12

#define VECTOR vec
#define LANES LANE
#define TARGET
#define WIDE_ROWS 6
#define NARROW_ROWS 12
#define NAMED(name) name
#include "tiles.h"

#if defined(__x86_64__)
typedef float wide_vec __attribute__((vector_size(64), aligned(4), may_alias));

#define VECTOR wide_vec
#define LANES 16
#define TARGET __attribute__((target("avx512f")))
#define WIDE_ROWS 12
#define NARROW_ROWS 12
#define NAMED(name) wide_##name
#include "tiles.h"
#endif

/* c [m][n] (+)= a [m][k] b [k][n]; n is a multiple of LANE, a's elements lie `row` and `column`
 * apart. */
void product(int m, int n, int k, const float *a, long row, long column, const float *b, long ldb,
             float *c, long ldc, int add) {
    int j = 0;
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx512f"))
        j = wide_columns(m, n, k, a, row, column, b, ldb, c, ldc, add);
#endif
    columns(m, n - j, k, a, row, column, b + j, ldb, c + j, ldc, add);
}

/* gram [width][width] += weighted^T columns, both [count][width], where column >= row at least. */
void gram_add(int count, int width, const float *weighted, const float *columns, float *gram) {
    for (int i = 0; i < width; i += GRAM_ROWS) {
        int rows = width - i < GRAM_ROWS ? width - i : GRAM_ROWS;
        int j = i / (2 * LANE) * (2 * LANE);
        product(rows, width - j, count, weighted + i, 1, width, columns + j, width,
                gram + (long)i * width + j, width, 1);
    }
}

typedef struct {
    float *arena[ARENAS];
    long size[ARENAS];
} scratch_memory;

static pthread_key_t scratch_key;

static void let_go(void *of_thread) {
    scratch_memory *own = of_thread;
    for (int which = 0; which < ARENAS; which++) free(own->arena[which]);
    free(own);
}

static void make_scratch_key(void) {
    if (pthread_key_create(&scratch_key, let_go)) abort();
}

/* Memory of this thread that stays for the next call, until the thread ends: fresh pages cost more
 * than what is computed in them. */
float *scratch(int which, long floats) {
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    static _Thread_local scratch_memory *own;
    if (!own) {
        pthread_once(&once, make_scratch_key);
        own = calloc(1, sizeof *own);
        if (!own || pthread_setspecific(scratch_key, own)) abort();
    }
    if (own->size[which] < floats) {
        free(own->arena[which]);
        own->arena[which] = malloc(floats * sizeof(float));
        own->size[which] = own->arena[which] ? floats : 0;
        if (!own->arena[which]) abort();
    }
    return own->arena[which];
}

/* What tells the sources of this library from others (c_library.py). */
API const char *asglight_sources(void) { return SOURCES; }
