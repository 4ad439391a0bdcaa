/* SPDX-License-Identifier: Apache-2.0
 *
 * What a step does to the lobes: equations.solve, coordinates.advance and temporal.py, for lobes of
 * the form asg. In double, for there is little of it.
 */
#include "steps.h"

#include <string.h>

enum { UNKNOWNS = 8 };

static const double BROAD = 0.5, ROUND_RATIO = 2.6, SEEN_SHARE = 1e-12;

enum { STRIP = 4 };

/* Of a row and each of some others side by side, products of what lies before the others' diagonals,
 * summed by place modulo 4: one chain of sums after the other would wait for each addition. */
static void strip_products(const double *row, const double *others, long n, int count, long before,
                           quad parts[STRIP]) {
    quad zero = {0}, all[STRIP] = {zero, zero, zero, zero};
    const double *other[STRIP];
    for (int s = 0; s < STRIP; s++) other[s] = others + (s < count ? s : 0) * n;
    for (long k = 0; k < before; k += STRIP)
        for (int s = 0; s < STRIP; s++)
            all[s] += *(const quad *)(row + k) * *(const quad *)(other[s] + k);
    for (int s = 0; s < STRIP; s++) parts[s] = all[s];
}

/* Solve a x = b, a [n][n] positive definite with a lower triangle that is overwritten, b with x.
 * Return 0 if it is not definite. */
static int solve_definite(int n, double *a, double *b) {
    for (int i = 0; i < n; i++) {
        double *row = a + (long)i * n;
        quad parts[STRIP];
        for (int j = 0; j <= i; j++) {
            const double *other = a + (long)j * n;
            int first = j / STRIP * STRIP;
            if (j == first) strip_products(row, other, n, i + 1 - j, j, parts);
            double part[4], total = row[j];
            for (int l = 0; l < 4; l++) part[l] = parts[j - first][l];
            for (int k = first; k < j; k++) part[0] += row[k] * other[k];
            total -= (part[0] + part[2]) + (part[1] + part[3]);
            if (j < i)
                row[j] = total / other[j];
            else if (total > 0)
                row[i] = sqrt(total);
            else
                return 0;
        }
        double total = b[i];
        for (int k = 0; k < i; k++) total -= row[k] * b[k];
        b[i] = total / row[i];
    }
    for (int i = n - 1; i >= 0; i--) {
        b[i] /= a[(long)i * n + i];
        for (int k = 0; k < i; k++) b[k] -= a[(long)i * n + k] * b[i];
    }
    return 1;
}

/* equations.solve: hessian [F][8 N][8 N], gradient [F][8 N], damping [F], still [F][N] or null; step
 * [F][N][8]. Of lobes as broad as they may be, `least`, and of black ones, what would go further
 * stays. */
API void asglight_solve(int64_t frames, int64_t lobes, const double *hessian,
                        const double *gradient, const float *sharpness, const float *amplitude,
                        const double *damping, const uint8_t *still, const float *least,
                        double *step) {
    int64_t n = UNKNOWNS * lobes;
    double *system = (double *)scratch(SYSTEM, 2 * (n * n + n)), *scale = system + n * n;
    for (int64_t f = 0; f < frames; f++) {
        const double *h = hessian + f * n * n, *ahead = gradient + f * n;
        double *found = step + f * n, largest = 1e-300;
        for (int64_t i = 0; i < n; i++) largest = fmax(largest, h[i * n + i]);
        for (int64_t i = 0; i < n; i++) {
            int64_t lobe = f * lobes + i / UNKNOWNS, k = i % UNKNOWNS;
            int held = still && still[lobe];
            if (k == 2 || k == 3) held |= sharpness[2 * lobe + k - 2] <= *least && ahead[i] > 0;
            if (k >= 5) held |= amplitude[3 * lobe + k - 5] <= 0 && ahead[i] > 0;
            double own = h[i * n + i];
            /* unknowns that nothing in the map sees get unit curvature */
            double curvature = own > SEEN_SHARE * largest ? own : largest;
            scale[i] = held ? 0 : 1 / sqrt(fmax(own + damping[f] * curvature, 1e-300));
            found[i] = -ahead[i] * scale[i];
        }
        for (int64_t i = 0; i < n; i++) {
            for (int64_t j = 0; j < i; j++) system[i * n + j] = h[i * n + j] * (scale[i] * scale[j]);
            system[i * n + i] = 1;
        }
        int definite = solve_definite(n, system, found);
        for (int64_t i = 0; i < n; i++) found[i] = definite ? found[i] * scale[i] : 0;
    }
}

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void normalise(double *v) {
    double size = fmax(sqrt(dot(v, v)), 1e-12);
    for (int k = 0; k < 3; k++) v[k] /= size;
}

static int is_round(double a, double b) { return fmax(a, b) < ROUND_RATIO * fmin(a, b); }

/* coordinates._shear: s + 1/2 as a matrix D^1/2 exp(E) D^1/2; its eigenvalues, the angle of x. */
static double shear(const double shifted[2], const double shape[3], double found[2]) {
    double p = (shape[0] + shape[1]) / 2, d = (shape[0] - shape[1]) / 2, r = shape[2];
    double q = fmax(sqrt(d * d + r * r), 1e-12);
    double even = exp(p) * cosh(q), odd = exp(p) * sinh(q) / q;
    double a = shifted[0] * (even + odd * d), c = shifted[1] * (even - odd * d);
    double b = sqrt(shifted[0] * shifted[1]) * odd * r, half = (a - c) / 2;
    double radius = sqrt(half * half + b * b) * (half < 0 ? -1 : 1);
    found[0] = (a + c) / 2 + radius, found[1] = (a + c) / 2 - radius;
    return 0.5 * atan(b / (half == 0 ? 1e-300 : half));
}

/* coordinates.advance of one lobe; bounds: TILT_MAX_WIDTHS, TILT_MAX, SHAPE_MAX, SHARPNESS_MIN and
 * the largest sharpness allowed. */
static void advance(const float *axes, const float *sharpness, const float *amplitude,
                    const double *step, const float *bounds, float *new_axes,
                    float *new_sharpness, float *new_amplitude) {
    double shape[3] = {step[2], step[3], step[4]}, largest = bounds[2], axis[3], x[3];
    double tilt[2], shifted[2], widths[2], angle;
    for (int k = 0; k < 2; k++) {
        /* of the form asg, sigma^2 = 1 / (2 s) */
        double bound = fmin(bounds[0] / sqrt(fmax(2.0 * sharpness[k], 1e-6)), bounds[1]);
        tilt[k] = fmax(fmin(step[k], bound), -bound);
        shifted[k] = sharpness[k] + BROAD;
    }
    for (int k = 0; k < 3; k++) largest = fmax(largest, fabs(shape[k]));
    for (int k = 0; k < 3; k++) {
        shape[k] *= bounds[2] / largest;
        axis[k] = axes[6 + k] + tilt[0] * axes[k] + tilt[1] * axes[3 + k];
    }
    normalise(axis);
    if (is_round(shifted[0], shifted[1])) {
        angle = shear(shifted, shape, widths);
    } else {
        angle = shape[2];
        for (int k = 0; k < 2; k++) widths[k] = shifted[k] * exp(shape[k]);
    }
    double concentration = 1;
    for (int k = 0; k < 2; k++) {
        new_sharpness[k] = fmin(fmax(widths[k] - BROAD, bounds[3]), bounds[4]);
        concentration *= (new_sharpness[k] + BROAD) / shifted[k];
    }
    for (int c = 0; c < 3; c++)
        new_amplitude[c] = fmax(amplitude[c] + step[5 + c], 0) * sqrt(concentration);
    for (int k = 0; k < 3; k++) x[k] = cos(angle) * axes[k] + sin(angle) * axes[3 + k];
    double along = dot(x, axis);
    for (int k = 0; k < 3; k++) x[k] -= along * axis[k];
    normalise(x);
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        new_axes[k] = x[k], new_axes[6 + k] = axis[k];
        new_axes[3 + k] = axis[a] * x[b] - axis[b] * x[a];
    }
}

/* coordinates.advance of [lobes]. */
API void asglight_advance(int64_t lobes, const float *axes, const float *sharpness,
                          const float *amplitude, const double *step, const float *bounds,
                          float *new_axes, float *new_sharpness, float *new_amplitude) {
    for (int64_t i = 0; i < lobes; i++)
        advance(axes + 9 * i, sharpness + 2 * i, amplitude + 3 * i, step + UNKNOWNS * i, bounds,
                new_axes + 9 * i, new_sharpness + 2 * i, new_amplitude + 3 * i);
}

/* temporal.value and slopes: lobes and `before` [F][N], share [F][N], scale [F][N][8], corner [1];
 * value [F], curvature and slope [F][8 N]. */
API void asglight_temporal(int64_t frames, int64_t lobes, const float *axes,
                           const float *sharpness, const float *amplitude,
                           const float *before_axes, const float *before_sharpness,
                           const float *before_amplitude, const float *share, const float *scale,
                           const float *corner, float *value, double *curvature, double *slope) {
    for (int64_t f = 0; f < frames; f++) {
        double total = 0;
        for (int64_t i = f * lobes; i < (f + 1) * lobes; i++) {
            const float *z = axes + 9 * i + 6, *own = sharpness + 2 * i, *unit = scale + UNKNOWNS * i;
            const float *was = before_axes + 9 * i, *then = before_sharpness + 2 * i;
            double delta[UNKNOWNS] = {0}, units[UNKNOWNS], square = (double)*corner * *corner;
            double wider = 1; /* concentration at the width before */
            for (int k = 0; k < 3; k++) {
                delta[0] += (double)z[k] * was[k], delta[1] += (double)z[k] * was[3 + k];
                delta[4] += (double)axes[9 * i + k] * was[3 + k];
            }
            for (int k = 0; k < 2; k++) {
                delta[2 + k] = log((own[k] + BROAD) / (then[k] + BROAD));
                wider *= (then[k] + BROAD) / (own[k] + BROAD);
            }
            wider = sqrt(wider);
            for (int c = 0; c < 3; c++)
                delta[5 + c] = amplitude[3 * i + c] * wider - before_amplitude[3 * i + c];
            for (int k = 0; k < UNKNOWNS; k++) {
                units[k] = k < 5 ? unit[k] : unit[k] / wider;
                delta[k] /= unit[k];
                square += delta[k] * delta[k];
            }
            total += share[i] * sqrt(square);
            double weight = share[i] / sqrt(square);
            for (int k = 0; k < UNKNOWNS; k++) {
                curvature[UNKNOWNS * i + k] = weight / (units[k] * units[k]);
                slope[UNKNOWNS * i + k] = weight * delta[k] / units[k];
            }
        }
        value[f] = total;
    }
}
