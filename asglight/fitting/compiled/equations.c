/* SPDX-License-Identifier: Apache-2.0
 *
 * The Gauss-Newton matrix of J for one frame: equations.normal_equations without the gradient.
 *
 * Columns lie [place][6][width], a lane a lobe: all lobes are drawn at once at each place, and a
 * Gram matrix is a sum of outer products of rows. It is symmetric: half of it is summed.
 */
#include "steps.h"

#include <string.h>

enum { COLUMNS = 6, UNKNOWNS = 8, BLOCK = 64 };

#define HALF (LANE / 2)

typedef float half __attribute__((vector_size(4 * HALF), aligned(4), may_alias));

static inline half load_half(const float *from) { return *(const half *)from; }
static inline void store_half(float *to, half value) { *(half *)to = value; }
static inline vec twice(float x, float y) { return (vec){x, x, x, x, y, y, y, y}; }
static inline half low(vec v) { return (half){v[0], v[1], v[2], v[3]}; }
static inline half high(vec v) { return (half){v[4], v[5], v[6], v[7]}; }

/* All lobes as adaptive cells of one size see them, a lane a lobe; a HALF of them is there twice.
 * */
typedef struct {
    float axes[3][3][LANE], xx[LANE], xy[LANE], yy[LANE], log_peak[LANE];
    float side_x[LANE], side_y[LANE], speed[3][LANE], log_peak_slope[3][LANE];
} SeenLanes;

/* Lanes for so many lobes. Trials are of three or four: these fill half a vector, which then takes
 * two places at a time. */
static int width_for(int64_t lobes) {
    return lobes <= HALF ? HALF : (lobes + LANE - 1) / LANE * LANE;
}

static void gather(int64_t lobes, int width, const float *axes, const float *sharpness,
                   int64_t rows, SeenLanes *found) {
    int copies = width == HALF ? 2 : 1;
    for (int64_t lane = 0; lane < copies * width; lane++) {
        int64_t lobe = lane % width;
        if (lobe >= lobes) continue;
        SeenLanes *to = found + lane / LANE;
        int l = lane % LANE;
        Seen one = seen_by(axes + 9 * lobe, sharpness + 2 * lobe, rows);
        for (int i = 0; i < 9; i++) to->axes[i / 3][i % 3][l] = one.axes[i / 3][i % 3];
        to->xx[l] = one.xx, to->xy[l] = one.xy, to->yy[l] = one.yy;
        to->log_peak[l] = one.log_peak, to->side_x[l] = one.side_x, to->side_y[l] = one.side_y;
        for (int k = 0; k < 3; k++) {
            to->speed[k][l] = one.speed[k];
            to->log_peak_slope[k][l] = one.log_peak_slope[k];
        }
    }
}

/* lobe_images.columns of LANE lobes, each at a place of its own. */
static inline void columns_at(const SeenLanes *seen, vec x, vec y, vec z, vec found[COLUMNS]) {
    vec at[3];
    for (int k = 0; k < 3; k++)
        at[k] = load(seen->axes[k][0]) * x + load(seen->axes[k][1]) * y + load(seen->axes[k][2]) * z;
    vec along_x = at[0] * load(seen->xx) + at[1] * load(seen->xy);
    vec along_y = at[0] * load(seen->xy) + at[1] * load(seen->yy);
    vec power = load(seen->log_peak) - (at[0] * along_x + at[1] * along_y);
    power = choose(power > -30.0f, power, splat(-30.0f)); /* as in lobes.c */
    vec gaussian = choose(at[2] > 0.0f, exp_vec(power), splat(0.0f)), value = at[2] * gaussian;
    vec side_x = along_x * load(seen->side_x), side_y = along_y * load(seen->side_y);
    vec bend = 2.0f * at[2] * at[2];
    vec shape[3] = {side_x * side_x, side_y * side_y, side_x * side_y};
    found[0] = value;
    found[1] = gaussian * (along_x * bend + at[0]);
    found[2] = gaussian * (along_y * bend + at[1]);
    for (int k = 0; k < 3; k++)
        found[3 + k] = value * (shape[k] * load(seen->speed[k]) + load(seen->log_peak_slope[k]));
}

/* The columns of all lobes at places [3][count], [place][6][width]. */
static void draw(int64_t lobes, const float *axes, const float *sharpness, int64_t rows, int width,
                 const float *places, int64_t count, SeenLanes *seen, float *columns) {
    const float *x = places, *y = x + count, *z = y + count;
    vec found[COLUMNS];
    memset(seen, 0, (width + LANE - 1) / LANE * sizeof(SeenLanes));
    gather(lobes, width, axes, sharpness, rows, seen);
    if (width == HALF)
        for (int64_t p = 0; p < count; p += 2) { /* a multiple of LANE (compiled.looks) */
            float *own = columns + p * COLUMNS * width, *next = own + COLUMNS * width;
            columns_at(seen, twice(x[p], x[p + 1]), twice(y[p], y[p + 1]), twice(z[p], z[p + 1]),
                       found);
            for (int k = 0; k < COLUMNS; k++) {
                store_half(own + k * width, low(found[k]));
                store_half(next + k * width, high(found[k]));
            }
        }
    else
        for (int64_t p = 0; p < count; p++)
            for (int l = 0; l < width; l += LANE) {
                columns_at(seen + l / LANE, splat(x[p]), splat(y[p]), splat(z[p]), found);
                for (int k = 0; k < COLUMNS; k++)
                    store(columns + (p * COLUMNS + k) * width + l, found[k]);
            }
}

/* Multiply columns by a scale that depends on the lobe: lobe_images._scaled. */
static void rescale(int width, int64_t count, const float *scale, const float *of_scale,
                    float *columns) {
    for (int64_t p = 0; p < count; p++)
        for (int l = 0; l < width; l += HALF) {
            float *own = columns + p * COLUMNS * width + l;
            half value = load_half(own), factor = load_half(scale + l);
            store_half(own, value * factor);
            for (int k = 1; k < COLUMNS; k++) {
                half slope = load_half(of_scale + (k - 1) * width + l);
                half scaled = (load_half(own + k * width) + slope * value) * factor;
                store_half(own + k * width, scaled);
            }
        }
}

/* gram += columns^T W columns. */
static void weighted_gram(int64_t count, int wide, const float *weight, const float *columns,
                          float *weighted, float *gram) {
    for (int64_t first = 0; first < count; first += BLOCK) {
        int own = count - first < BLOCK ? count - first : BLOCK;
        const float *block = columns + first * wide;
        for (int p = 0; p < own; p++)
            for (int l = 0; l < wide; l += LANE)
                store(weighted + p * wide + l, load(block + p * wide + l) * weight[first + p]);
        gram_add(own, wide, weighted, block, gram);
    }
}

/* lobe_images.grid_columns: columns over all cells of a grid, at the scale of the lobes there. */
static void grid_columns(int64_t lobes, const float *sharpness, int width, int64_t count,
                         const float *share, float *columns, float *scales) {
    int wide = COLUMNS * width;
    float *mean = scales, *scale = mean + wide, *of_scale = scale + width;
    memset(scales, 0, 2L * wide * sizeof(float));
    for (int64_t p = 0; p < count; p++)
        for (int l = 0; l < wide; l += LANE)
            store(mean + l, load(mean + l) + load(columns + p * wide + l) * share[p]);
    int any = 0;
    for (int64_t lobe = 0; lobe < lobes; lobe++) {
        double change[5];
        float slopes[5];
        for (int k = 0; k < 5; k++)
            change[k] = mean[(k + 1) * width + lobe] / fmax(mean[lobe], 1e-38);
        scale[lobe] = scale_of(sharpness + 2 * lobe, mean[lobe]);
        scale_slopes(sharpness + 2 * lobe, scale[lobe], change, slopes);
        for (int k = 0; k < 5; k++) of_scale[k * width + lobe] = slopes[k];
        any |= is_narrow(sharpness + 2 * lobe);
    }
    if (any) rescale(width, count, scale, of_scale, columns);
}

/* equations._chain: from columns to unknowns; a shape unknown moves each channel by the amplitude. */
static void chain(int64_t lobes, int width, const float *amplitude, const float *gram,
                  double *hessian) {
    int64_t size = UNKNOWNS * lobes;
    int wide = COLUMNS * width;
    memset(hessian, 0, size * size * sizeof(double));
    for (int64_t i = 0; i < lobes; i++)
        for (int64_t j = 0; j < lobes; j++) {
            const float *a = amplitude + 3 * i, *b = amplitude + 3 * j;
            double both = (double)a[0] * b[0] + (double)a[1] * b[1] + (double)a[2] * b[2];
            double *block = hessian + UNKNOWNS * i * size + UNKNOWNS * j;
            for (int k = 0; k < COLUMNS; k++)
                for (int m = 0; m < COLUMNS; m++) {
                    int64_t row = k * width + i, column = m * width + j;
                    double own = row <= column ? gram[row * wide + column] : gram[column * wide + row];
                    if (k && m) block[(k - 1) * size + m - 1] = own * both;
                    for (int c = 0; c < 3; c++) {
                        if (k && !m) block[(k - 1) * size + 5 + c] = own * a[c];
                        if (!k && m) block[(5 + c) * size + m - 1] = own * b[c];
                        if (!k && !m) block[(5 + c) * size + 5 + c] = own;
                    }
                }
        }
}

static void sum_cells(const float *fine, int64_t fine_rows, int64_t rows, float *found) {
    int64_t factor = fine_rows / rows;
    memset(found, 0, 2 * rows * rows * sizeof(float));
    for (int64_t row = 0; row < fine_rows; row++)
        for (int64_t column = 0; column < 2 * fine_rows; column++)
            found[row / factor * 2 * rows + column / factor] += fine[row * 2 * fine_rows + column];
}

static void matrix(int64_t lobes, const float *axes, const float *sharpness,
                   const float *amplitude, const float *scale, const float *of_scale,
                   const Adaptive *adaptive, const Probes *probes, const float *cell_places,
                   const float *cell_share, const float *env_weight, const float *view_weight,
                   double *hessian) {
    int width = width_for(lobes), wide = COLUMNS * width;
    int64_t rows = probes->rows, cells = 2 * rows * rows;
    int64_t fine = cells_of(adaptive), texels = texels_of(adaptive);
    int64_t most = cells > texels ? cells : texels;
    long seen_size = (width + LANE - 1) / LANE * sizeof(SeenLanes) / sizeof(float);
    long gram_size = (long)wide * wide, block_size = (long)BLOCK * wide;
    float *gram = scratch(GRAMS, gram_size + block_size + 2L * wide + cells + seen_size);
    float *weighted = gram + gram_size, *scales = weighted + block_size;
    float *weight = scales + 2L * wide;
    SeenLanes *seen = (SeenLanes *)(weight + cells);
    float *columns = scratch(COLUMN_IMAGES, most * wide);
    memset(gram, 0, gram_size * sizeof(float));
    if (texels) {
        draw(lobes, axes, sharpness, adaptive->fine_rows, width, adaptive->texel_places, texels,
             seen,
             columns);
        float *of_lanes = scales + width;
        memset(scales, 0, 2L * wide * sizeof(float));
        for (int64_t lobe = 0; lobe < lobes; lobe++) {
            scales[lobe] = scale[lobe];
            for (int k = 0; k < 5; k++) of_lanes[k * width + lobe] = of_scale[5 * lobe + k];
        }
        rescale(width, texels, scales, of_lanes, columns);
        weighted_gram(texels, wide, env_weight + fine, columns, weighted, gram);
    }
    draw(lobes, axes, sharpness, rows, width, cell_places, cells, seen, columns);
    grid_columns(lobes, sharpness, width, cells, cell_share, columns, scales);
    sum_cells(env_weight, adaptive->rows, rows, weight);
    weighted_gram(cells, wide, weight, columns, weighted, gram);
    float *rings = scratch(RINGS_OF_COLUMNS, rings_size(probes, wide));
    probe_rings(probes, wide, columns, rings);
    for (int source = 0; source < probes->sources; source++) {
        int64_t count = probes->counts[source];
        for (int ring = 0; ring < probes->rings[source]; ring++) {
            probe_ring(probes, source, ring, wide, rings, columns);
            weighted_gram(count, wide, view_weight, columns, weighted, gram);
            view_weight += count;
        }
        rings += probes->rings[source] * probes->own_waves[source] * 2 * wide;
    }
    chain(lobes, width, amplitude, gram, hessian);
}

/* H [F][8 N][8 N] on the cells of a coarser grid, with its probes, and on the refined texels.
 *
 * axes [F][N][3][3], sharpness [F][N][2], amplitude [F][N][3], scale [F][N] and of_scale [F][N][5]
 * on the adaptive cells, env_weight [F][P], view_weight [F][D]; cell_places [3][C'] and
 * cell_share [C'] of
 * the coarser grid. */
API void asglight_matrix(int64_t frames, int64_t lobes, const float *axes, const float *sharpness,
                         const float *amplitude, const float *scale, const float *of_scale,
                         const Adaptive *adaptive, const Probes *probes, const float *cell_places,
                         const float *cell_share, const float *env_weight,
                         const float *view_weight, double *hessian) {
    int64_t adaptive_count = cells_of(adaptive) + texels_of(adaptive);
    int64_t size = UNKNOWNS * UNKNOWNS * lobes * lobes;
    for (int64_t f = 0; f < frames; f++) {
        Adaptive own = adaptive_of(adaptive, f);
        int64_t first = f * lobes;
        matrix(lobes, axes + 9 * first, sharpness + 2 * first, amplitude + 3 * first, scale + first,
               of_scale + 5 * first, &own, probes, cell_places, cell_share,
               env_weight + f * adaptive_count, view_weight + f * probes->views,
                       hessian + f * size);
    }
}
