/* SPDX-License-Identifier: Apache-2.0
 *
 * Where first frames start: expectation-maximisation of isotropic densities, in double
 * (first_frame/seeding.expectation_maximisation). A cell's share of all lobes is added to their
 * moments as soon as it is known, so a step goes over the cells once.
 */
#include "steps.h"

enum { WIDE = 4 }; /* doubles in a quad: so many cells are taken at a time */

typedef int64_t whole __attribute__((vector_size(8 * WIDE), aligned(8), may_alias));

static const double PI = 3.14159265358979323846;
static const double SHARE_MIN = 1e-9, MEAN_MIN = 1e-6, SHARPNESS_MIN = 1e-3, SHARPNESS_MAX = 1e7;
static const double REACHED = 1e-250; /* cells of less density go to the nearest lobe */

/* Of a cell: unit direction, weight, and mean of direction and of its products. */
enum { X, Y, Z, WEIGHT, MEAN, XX = MEAN + 3, XY, XZ, YY, YZ, ZZ, ROWS };
enum { MOMENTS = ROWS - WEIGHT }; /* those of a lobe: of weight, mean and products */

typedef struct {
    double z[3], sharpness, share; /* of the flux */
} Part;

static inline quad fill(double x) { return (quad){x, x, x, x}; }
static inline quad pick(whole mask, quad one, quad other) {
    return (quad)((mask & (whole)one) | (~mask & (whole)other));
}

/* exp for arguments up to 0, to 3e-16 of the result; 0 below -700. */
static inline quad exp_quad(quad x) {
    const double log2e = 1.4426950408889634, ln2_high = 0.693147180369123816490;
    const double ln2_low = 1.90821492927058770002e-10;
    const quad magic = fill(6755399441055744.0); /* 1.5 * 2^52: adding it rounds to a whole number */
    whole reached = x > fill(-700.0);
    x = pick(reached, x, fill(0.0));
    quad shifted = x * log2e + magic, n = shifted - magic;
    quad r = (x - n * ln2_high) - n * ln2_low;
    quad p = fill(1.0 / 479001600); /* 1 / 12!, and so on */
    p = p * r + 1.0 / 39916800;
    p = p * r + 1.0 / 3628800;
    p = p * r + 1.0 / 362880;
    p = p * r + 1.0 / 40320;
    p = p * r + 1.0 / 5040;
    p = p * r + 1.0 / 720;
    p = p * r + 1.0 / 120;
    p = p * r + 1.0 / 24;
    p = p * r + 1.0 / 6;
    p = p * r + 0.5;
    p = p * r + 1.0;
    p = p * r + 1.0;
    whole power = ((whole)shifted + 1023) << 52; /* the lowest bits of a shifted number are n */
    return pick(reached, p * (quad)power, fill(0.0));
}

/* seeding._expectation for some cells. */
static void expect(int64_t lobes, const Part *parts, const double *peak, int64_t cells,
                   const double *cell, double *taken) {
    quad x = *(const quad *)(cell + X * cells), y = *(const quad *)(cell + Y * cells);
    quad z = *(const quad *)(cell + Z * cells), total = fill(0.0);
    for (int64_t n = 0; n < lobes; n++) {
        quad dx = x - parts[n].z[0], dy = y - parts[n].z[1], dz = z - parts[n].z[2];
        quad density = exp_quad((dx * dx + dy * dy + dz * dz) * (-0.5 * parts[n].sharpness));
        density *= peak[n];
        *(quad *)(taken + n * cells) = density;
        total += density;
    }
    for (int64_t n = 0; n < lobes; n++) *(quad *)(taken + n * cells) /= total;
    for (int l = 0; l < WIDE; l++) {
        if (total[l] >= REACHED) continue;
        int64_t nearest = 0;
        double most = -2;
        for (int64_t n = 0; n < lobes; n++) {
            const double *axis = parts[n].z;
            double cosine = x[l] * axis[0] + y[l] * axis[1] + z[l] * axis[2];
            if (cosine > most) most = cosine, nearest = n;
            taken[n * cells + l] = 0;
        }
        taken[nearest * cells + l] = 1;
    }
}

static void add_moments(int64_t lobes, int64_t cells, const double *cell, const double *taken,
                        quad *moments) {
    quad weight = *(const quad *)(cell + WEIGHT * cells);
    for (int64_t n = 0; n < lobes; n++) {
        quad own = weight * *(const quad *)(taken + n * cells), *to = moments + n * MOMENTS;
        to[0] += own;
        for (int k = 1; k < MOMENTS; k++) to[k] += own * *(const quad *)(cell + (WEIGHT + k) * cells);
    }
}

/* seeding._maximisation for the form sg. */
static void maximise(const quad *moments, double variance_min, Part *part) {
    double sums[MOMENTS];
    for (int k = 0; k < MOMENTS; k++)
        sums[k] = (moments[k][0] + moments[k][2]) + (moments[k][1] + moments[k][3]);
    double safe = fmax(sums[0], SHARE_MIN), *mean = sums + MEAN - WEIGHT, *s = sums + XX - WEIGHT;
    for (int k = 1; k < MOMENTS; k++) sums[k] /= safe;
    double size = sqrt(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]);
    part->share = sums[0];
    if (sums[0] <= SHARE_MIN || size <= MEAN_MIN) return; /* it stays as it was */
    for (int k = 0; k < 3; k++) part->z[k] = mean[k] / size;
    double x = part->z[0], y = part->z[1], z = part->z[2];
    double along = s[0] * x * x + s[3] * y * y + s[5] * z * z;
    along += 2 * (s[1] * x * y + s[2] * x * z + s[4] * y * z);
    double variance = fmax((s[0] + s[3] + s[5] - along) / 2, variance_min);
    part->sharpness = fmin(fmax(1 / variance - 1, SHARPNESS_MIN), SHARPNESS_MAX);
}

/* seeding.expectation_maximisation: source [ROWS][C], taken [N][C] at first and in the end, axis_z
 * [N][3], sharpness [N]. */
API void asglight_mixture(int64_t cells, int64_t lobes, int64_t steps, const double *source,
                          const double *variance_min, double *taken, double *axis_z,
                          double *sharpness) {
    int64_t own = sizeof(Part) + sizeof(double) + MOMENTS * sizeof(quad);
    quad *moments = (quad *)scratch(MIXED, lobes * own / sizeof(float));
    Part *parts = (Part *)(moments + lobes * MOMENTS);
    double *peak = (double *)(parts + lobes);
    for (int64_t n = 0; n < lobes; n++) parts[n] = (Part){{0, 1, 0}, 1, 0};
    for (int64_t step = 0; step <= steps; step++) {
        for (int64_t n = 0; n < lobes; n++) {
            double s = parts[n].sharpness, integral = -2 * PI * expm1(-2 * s) / s;
            peak[n] = fmax(parts[n].share, 2.2250738585072014e-308) / integral;
        }
        for (int64_t k = 0; k < lobes * MOMENTS; k++) moments[k] = fill(0.0);
        for (int64_t c = 0; c < cells; c += WIDE) {
            if (step) expect(lobes, parts, peak, cells, source + c, taken + c);
            add_moments(lobes, cells, source + c, taken + c, moments);
        }
        for (int64_t n = 0; n < lobes; n++)
            maximise(moments + n * MOMENTS, *variance_min, parts + n);
    }
    for (int64_t n = 0; n < lobes; n++) {
        for (int k = 0; k < 3; k++) axis_z[3 * n + k] = parts[n].z[k];
        sharpness[n] = parts[n].sharpness;
    }
}
