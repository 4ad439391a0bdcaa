/* SPDX-License-Identifier: Apache-2.0
 *
 * The linear part of the fit, fitting/steps/light.py: what is asked of the light of lobes whose
 * shapes are held.
 */
#include "steps.h"

#include <string.h>

enum { BLOCK = 256 };

/* gram [N][N] += A W A^T: A images [N][P], each times its scale, if any; W of weight [P]. In double:
 * lobes that coincide keep equal rows, whatever the order of sums. */
static void weighted_gram(int64_t lobes, int64_t adaptive_count, const float *scale,
                          const float *images, const float *weight, double *gram) {
    double *rooted = (double *)scratch(ROOTED, 2 * (lobes + 1) * BLOCK), *root = rooted + lobes * BLOCK;
    for (int64_t first = 0; first < adaptive_count; first += BLOCK) {
        int64_t count = adaptive_count - first < BLOCK ? adaptive_count - first : BLOCK;
        memset(root, 0, BLOCK * sizeof(double));
        for (int64_t p = 0; p < count; p++) root[p] = sqrt(weight[first + p]);
        for (int64_t i = 0; i < lobes; i++) {
            const float *own = images + i * adaptive_count + first,
                    factor = scale ? scale[i] : 1.0f;
            double *one = rooted + i * BLOCK;
            for (int64_t p = 0; p < BLOCK; p++) one[p] = p < count ? (factor * own[p]) * root[p] : 0;
            for (int64_t j = 0; j <= i; j++) {
                const double *other = rooted + j * BLOCK;
                double part[8] = {0};
                for (int64_t p = 0; p < BLOCK; p += 8)
                    for (int l = 0; l < 8; l++) part[l] += one[p + l] * other[p + l];
                for (int l = 1; l < 8; l++) part[0] += part[l];
                gram[i * lobes + j] += part[0];
                if (j < i) gram[j * lobes + i] += part[0];
            }
        }
    }
}

/* light._normal_equations of one frame: gram [N][N], slope of J along the amplitudes [N][3]. */
static void equations(int64_t lobes, const Adaptive *adaptive, const Target *target,
                      const Probes *probes, const float *amplitude, const float *values,
                      const float *scale, double *gram, double *along) {
    int64_t cells = cells_of(adaptive), texels = texels_of(adaptive), count = cells + texels;
    int64_t views = probes->views, parts = target->part_count * cells;
    int lanes = (lobes + LANE - 1) / LANE * LANE;
    float *radiance = scratch(OF_FRAME, 7 * count + parts + texels + 5 * views + 3 * LANE);
    float *slope = radiance + 3 * count, *weight = slope + 3 * count, *size = weight + count;
    float *of_texels = size + parts, *seen = of_texels + texels, *own = seen + views;
    float *view_weight = own + 3 * views, value;
    float *laid = scratch(LAID_LOBES, (cells + views) * lanes + lobes * views + LANE);
    float *shown = laid + cells * lanes, *by_lobe = shown + views * lanes;
    add_up(lobes, count, amplitude, values, scale, radiance);
    asglight_loss_terms(1, adaptive, target, probes, radiance, &value, size, of_texels, own, seen);
    asglight_loss_gradient(1, adaptive, target, probes, radiance, size, of_texels, own, seen,
                           slope, weight,
                    view_weight);
    lobes_to_cells(adaptive, lobes, scale, values, laid, lanes);
    probe_lanes(probes, lanes, laid, shown);
    for (int64_t i = 0; i < lobes; i++)
        for (int64_t d = 0; d < views; d++) by_lobe[i * views + d] = shown[d * lanes + i];
    memset(gram, 0, lobes * lobes * sizeof(double));
    weighted_gram(lobes, count, scale, values, weight, gram);
    weighted_gram(lobes, views, 0, by_lobe, view_weight, gram);
    for (int64_t i = 0; i < lobes; i++)
        for (int c = 0; c < 3; c++) {
            const float *one = values + i * count, *other = slope + c * count;
            double total = 0;
            for (int64_t first = 0; first < count; first += BLOCK) {
                int64_t end = first + BLOCK < count ? first + BLOCK : count;
                vec part = splat(0.0f);
                for (int64_t p = first; p < end; p += LANE) part += load(one + p) * load(other + p);
                total += sum(part);
            }
            along[3 * i + c] = total * scale[i];
        }
}

/* light._normal_equations: amplitude [F][N][3], values [F][N][P], scale [F][N]; gram [F][N][N] and
 * along [F][N][3]. */
API void asglight_light(int64_t frames, int64_t lobes, const Adaptive *adaptive,
                        const Target *target,
                        const Probes *probes, const float *amplitude, const float *values,
                        const float *scale, double *gram, double *along) {
    int64_t size = lobes * (cells_of(adaptive) + texels_of(adaptive));
    for (int64_t f = 0; f < frames; f++) {
        Adaptive places = adaptive_of(adaptive, f);
        Target own = target_of(target, f);
        int64_t first = f * lobes;
        equations(lobes, &places, &own, probes, amplitude + 3 * first, values + f * size,
                  scale + first, gram + first * lobes, along + 3 * first);
    }
}
