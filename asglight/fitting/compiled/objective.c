/* SPDX-License-Identifier: Apache-2.0
 *
 * J of one frame, and how it changes: fitting/loss/objective.py.
 */
#include "steps.h"

static vec root(vec x) {
    for (int l = 0; l < LANE; l++) x[l] = sqrtf(x[l]);
    return x;
}

enum { AROUND = 25 }; /* cells that a texel's light reaches (splatting.py) */

/* adaptive_cells.to_cells of `count` images [count][P], each times a scale, into [C] places
 * `next` floats
 * apart; lanes beyond `count` become 0. */
static inline __attribute__((always_inline)) void to_cells(const Adaptive *adaptive,
                                                           const int count,
                                                           const float *scale, const float *images,
                                                           float *cells, const long next) {
    int64_t cell_count = cells_of(adaptive), adaptive_count = cell_count + texels_of(adaptive);
    int64_t inside = texels_per_cell(adaptive);
    for (int64_t p = 0; p < cell_count; p++) {
        vec all = splat(0.0f);
        for (int c = 0; c < count; c++) all[c] = images[c * adaptive_count + p];
        store(cells + next * p, all * load(scale));
    }
    if (adaptive_count == cell_count) return;
    for (int64_t r = 0; r < adaptive->refined_count; r++)
        store(cells + next * adaptive->refined[r], splat(0.0f));
    for (int64_t r = 0; r < adaptive->refined_count; r++) {
        vec brought[AROUND];
        for (int k = 0; k < AROUND; k++) brought[k] = splat(0.0f);
        for (int64_t t = 0; t < inside; t++) {
            int64_t texel = r * inside + t;
            vec all = splat(0.0f);
            for (int c = 0; c < count; c++) all[c] = images[c * adaptive_count + cell_count
                    + texel];
            vec flux = all * load(scale) * adaptive->texel_share[texel];
            for (int k = 0; k < AROUND; k++) brought[k] += flux * adaptive->splatting[t * AROUND + k];
        }
        for (int k = 0; k < AROUND; k++) {
            int64_t cell = adaptive->around[r * AROUND + k];
            float *to = cells + next * cell;
            store(to, load(to) + brought[k] / adaptive->grid_share[cell]);
        }
    }
}

static const float ONES[LANE] = {1, 1, 1, 1, 1, 1, 1, 1};

void lobes_to_cells(const Adaptive *adaptive, int64_t lobes, const float *scale,
                    const float *images,
                    float *cells, int lanes) {
    int64_t adaptive_count = cells_of(adaptive) + texels_of(adaptive);
    for (int first = 0; first < lobes; first += LANE) {
        int count = lobes - first < LANE ? lobes - first : LANE;
        float own[LANE] = {0};
        for (int l = 0; l < count; l++) own[l] = scale[first + l];
        if (count == LANE)
            to_cells(adaptive, LANE, own, images + first * adaptive_count, cells + first, lanes);
        else
            to_cells(adaptive, count, own, images + first * adaptive_count, cells + first, lanes);
    }
}

/* adaptive_cells.from_cells: adds slopes on cells [C][LANE] to those on adaptive cells [3][P]. */
static void add_from_cells(const Adaptive *adaptive, float *cells, float *slopes) {
    int64_t count = cells_of(adaptive), adaptive_count = count + texels_of(adaptive);
    int64_t inside = texels_per_cell(adaptive);
    if (adaptive_count > count)
        for (int64_t r = 0; r < adaptive->refined_count; r++) {
            vec around[AROUND];
            for (int k = 0; k < AROUND; k++) {
                int64_t cell = adaptive->around[r * AROUND + k];
                around[k] = load(cells + LANE * cell) / adaptive->grid_share[cell];
            }
            for (int64_t t = 0; t < inside; t++) {
                int64_t texel = r * inside + t;
                vec slope = splat(0.0f);
                for (int k = 0; k < AROUND; k++)
                    slope += around[k] * adaptive->splatting[t * AROUND + k];
                for (int c = 0; c < 3; c++)
                    slopes[c * adaptive_count + count
                            + texel] += slope[c] * adaptive->texel_share[texel];
            }
        }
    if (adaptive_count > count)
        for (int64_t r = 0; r < adaptive->refined_count; r++)
            store(cells + LANE * adaptive->refined[r], splat(0.0f));
    for (int64_t p = 0; p < count; p++)
        for (int c = 0; c < 3; c++) slopes[c * adaptive_count + p] += cells[LANE * p + c];
}

static void loss_terms(const Adaptive *adaptive, const Target *target, const Probes *probes,
                  const float *radiance, float *value, float *parts, float *texels, float *views,
                  float *seen) {
    int64_t count = cells_of(adaptive), fine = texels_of(adaptive), adaptive_count = count + fine;
    float corner = target->env_corner * *target->env_scale, corner2 = corner * corner;
    float *residual = scratch(LAID, 3 * adaptive_count + LANE * count),
            *cells = residual + 3 * adaptive_count;
    for (int64_t i = 0; i < 3 * adaptive_count; i += LANE)
        store(residual + i, load(radiance + i) - load(target->radiance + i));
    double error = 0;
    for (int64_t k = 0; k < target->part_count; k++) {
        const float *wanted = target->parts + 3 * k * count;
        vec total = splat(0.0f);
        for (int64_t p = 0; p < count; p += LANE) {
            vec square = splat(corner2);
            for (int c = 0; c < 3; c++) {
                vec missed = load(radiance + c * adaptive_count + p) - load(wanted + c * count + p);
                square += missed * missed;
            }
            vec size = root(square);
            store(parts + k * count + p, size);
            total += size * load(adaptive->cell_share + p);
        }
        error += sum(total) / target->part_count;
    }
    vec total = splat(0.0f);
    for (int64_t q = 0; q < fine; q += LANE) {
        vec square = splat(corner2);
        for (int c = 0; c < 3; c++) {
            vec missed = load(residual + c * adaptive_count + count + q);
            square += missed * missed;
        }
        vec size = root(square);
        store(texels + q, size);
        total += size * load(adaptive->texel_share + q);
    }
    error += sum(total);
    to_cells(adaptive, 3, ONES, residual, cells, LANE);
    float *shown = scratch(SEEN, LANE * probes->views);
    probe_few(probes, cells, shown);
    double wrong = 0;
    int64_t first = 0;
    for (int source = 0; source < probes->sources; source++) {
        int64_t own = probes->rings[source] * probes->counts[source];
        float eps = target->probe_corner[source] * target->probe_scale[source];
        for (int64_t d = first; d < first + own; d++) {
            const float *at = shown + LANE * d;
            seen[d] = sqrtf(at[0] * at[0] + at[1] * at[1] + at[2] * at[2] + eps * eps);
            wrong += target->view_weight[d] * (seen[d] - eps);
            for (int c = 0; c < 3; c++) views[c * probes->views + d] = at[c];
        }
        first += own;
    }
    *value = target->env_weight * (error / *target->env_scale - target->env_corner) + wrong;
}

/* objective.loss_terms: radiance [F][3][P]; value [F], parts [F][K][C], texels [F][Q], views
 * [F][3][D],
 * seen [F][D]. */
API void asglight_loss_terms(int64_t frames, const Adaptive *adaptive, const Target *target,
                        const Probes *probes, const float *radiance, float *value, float *parts,
                        float *texels, float *views, float *seen) {
    int64_t count = cells_of(adaptive), fine = texels_of(adaptive);
    for (int64_t f = 0; f < frames; f++) {
        Adaptive places = adaptive_of(adaptive, f);
        Target own = target_of(target, f);
        loss_terms(&places, &own, probes, radiance + 3 * f * (count + fine), value + f,
              parts + f * own.part_count * count, texels + f * fine, views + 3 * f * probes->views,
              seen + f * probes->views);
    }
}

static void loss_gradient(const Adaptive *adaptive, const Target *target, const Probes *probes,
                   const float *radiance, const float *parts, const float *texels,
                   const float *views, const float *seen, float *slope, float *env_weight,
                   float *view_weight) {
    int64_t count = cells_of(adaptive), fine = texels_of(adaptive), adaptive_count = count + fine;
    float unit = target->env_weight / *target->env_scale;
    for (int64_t p = 0; p < count; p += LANE) {
        vec share = load(adaptive->cell_share + p) * (unit / target->part_count);
        vec all = splat(0.0f), by[3] = {all, all, all};
        for (int64_t k = 0; k < target->part_count; k++) {
            vec weight = share / load(parts + k * count + p);
            all += weight;
            for (int c = 0; c < 3; c++) {
                const float *wanted = target->parts + (3 * k + c) * count;
                by[c] += (load(radiance + c * adaptive_count + p) - load(wanted + p)) * weight;
            }
        }
        store(env_weight + p, all);
        for (int c = 0; c < 3; c++) store(slope + c * adaptive_count + p, by[c]);
    }
    for (int64_t q = 0; q < fine; q += LANE) {
        vec weight = load(adaptive->texel_share + q) * unit / load(texels + q);
        store(env_weight + count + q, weight);
        for (int c = 0; c < 3; c++) {
            int64_t at = c * adaptive_count + count + q;
            store(slope + at, (load(radiance + at) - load(target->radiance + at)) * weight);
        }
    }
    float *cells = scratch(LAID, LANE * count), *pulled = scratch(SEEN, LANE * probes->views);
    for (int64_t d = 0; d < probes->views; d++) {
        vec all = splat(0.0f);
        view_weight[d] = target->view_weight[d] / seen[d];
        for (int c = 0; c < 3; c++) all[c] = views[c * probes->views + d] * view_weight[d];
        store(pulled + LANE * d, all);
    }
    pull_few(probes, pulled, cells);
    add_from_cells(adaptive, cells, slope);
}

/* objective.loss_gradient, of the sizes that were found: slope [F][3][P], env_weight [F][P],
 * view_weight
 * [F][D]. */
API void asglight_loss_gradient(int64_t frames, const Adaptive *adaptive, const Target *target,
                         const Probes *probes, const float *radiance, const float *parts,
                         const float *texels, const float *views, const float *seen, float *slope,
                         float *env_weight, float *view_weight) {
    int64_t count = cells_of(adaptive), fine = texels_of(adaptive), all = count + fine;
    for (int64_t f = 0; f < frames; f++) {
        Adaptive places = adaptive_of(adaptive, f);
        Target own = target_of(target, f);
        int64_t view = f * probes->views;
        loss_gradient(&places, &own, probes, radiance + 3 * f * all,
                      parts + f * own.part_count * count,
               texels + f * fine, views + 3 * view, seen + view, slope + 3 * f * all,
               env_weight + f * all, view_weight + view);
    }
}
