/* SPDX-License-Identifier: Apache-2.0
 *
 * Lobes on adaptive cells: fitting/loss/footprints.py and lobe_images.py for the form asg.
 *
 * An adaptive cell's direction is taken apart along the lobe's axes before it is squared: a lobe
 * of sharpness
 * 40,000 keeps 1e-5 of its value so, where monomials of direction, as a matrix product needs
 * them, keep 2e-3.
 */
#include "steps.h"

static const float EXPONENT_MIN = -30.0f, SCALE_MIN = 0.5f, SCALE_MAX = 3.0f;
static const double BROAD = 0.5, ROUND_RATIO = 2.6, NARROW_SHARPNESS = 50.0, LONG_SHARPNESS = 8.0;
static const double PI = 3.14159265358979323846;

static double turn_speed(double sx, double sy) {
    double a = sx + BROAD, b = sy + BROAD;
    return fmax(a, b) < ROUND_RATIO * fmin(a, b) ? sqrt(a * b) : sx - sy;
}

Seen seen_by(const float *axes, const float *sharpness, int64_t rows) {
    Seen seen;
    for (int i = 0; i < 9; i++) seen.axes[i / 3][i % 3] = axes[i];
    double side = PI / rows * (PI / rows) / 12;
    double up_x = axes[1], up_y = axes[4], up_z = axes[7]; /* of the axes, towards the pole */
    double sin2 = up_z * up_z, cos2 = fmax(1 - sin2, 3 * side);
    double shorter = sin2 / cos2, trace = shorter * (1 - sin2);
    double xx = side * (1 - shorter * up_y * up_y), yy = side * (1 - shorter * up_x * up_x);
    double xy = side * shorter * up_x * up_y;
    double sx = sharpness[0], sy = sharpness[1], width_x = 1 / sx, width_y = 1 / sy;
    double whole = width_x * width_y;
    double determinant = whole + 2 * (width_x * yy + width_y * xx);
    determinant += 4 * side * side * fmax(1 - trace, 0.0);
    double sxx = (width_y + 2 * yy) / determinant, sxy = -2 * xy / determinant;
    double syy = (width_x + 2 * xx) / determinant;
    double speed[3] = {-(sx + BROAD), -(sy + BROAD), -2 * turn_speed(sx, sy)};
    /* d log c = -tr(T (I + 2 S T)^-1 dS), and a width changes at constant flux */
    double of_xx = (xx * sxx + xy * sxy) * width_x, of_yy = (xy * sxy + yy * syy) * width_y;
    double of_xy = (xx * sxy + xy * syy) * width_y;
    seen.xx = sxx, seen.xy = sxy, seen.yy = syy, seen.log_peak = log(whole / determinant) / 2;
    seen.side_x = width_x, seen.side_y = width_y;
    for (int k = 0; k < 3; k++) seen.speed[k] = speed[k];
    seen.log_peak_slope[0] = speed[0] * of_xx + 0.5;
    seen.log_peak_slope[1] = speed[1] * of_yy + 0.5;
    seen.log_peak_slope[2] = speed[2] * of_xy;
    return seen;
}

int is_narrow(const float *sharpness) {
    double most = fmax(sharpness[0], sharpness[1]), least = fmin(sharpness[0], sharpness[1]);
    return most > NARROW_SHARPNESS && least > LONG_SHARPNESS;
}

/* What makes the mean over the sphere of a narrow lobe exact, pi / sqrt(sx sy) / (4 pi). */
float scale_of(const float *sharpness, double mean) {
    if (!is_narrow(sharpness)) return 1.0f;
    double exact = 1 / (4 * sqrt((double)sharpness[0] * sharpness[1]));
    return fmin(fmax(exact / fmax(mean, 1e-38), SCALE_MIN), SCALE_MAX);
}

/* d log scale along the five coordinates, given d log mean. */
void scale_slopes(const float *sharpness, float scale, const double change[5], float slopes[5]) {
    int held = !is_narrow(sharpness) || scale <= SCALE_MIN || scale >= SCALE_MAX;
    for (int k = 0; k < 5; k++) {
        double exact = k == 2 || k == 3 ? -BROAD / (2 * sharpness[k - 2]) : 0.0;
        slopes[k] = held ? 0.0f : exact - change[k];
    }
}

typedef struct {
    vec x, y, z, along_x, along_y, gaussian;
} Looked;

/* Along the axis of a lobe: nothing of it is seen where this is not above 0, half of the sphere. */
static inline vec ahead(const Seen *seen, vec x, vec y, vec z) {
    return x * seen->axes[2][0] + y * seen->axes[2][1] + z * seen->axes[2][2];
}

static inline Looked look(const Seen *seen, vec x, vec y, vec z) {
    Looked at;
    at.x = x * seen->axes[0][0] + y * seen->axes[0][1] + z * seen->axes[0][2];
    at.y = x * seen->axes[1][0] + y * seen->axes[1][1] + z * seen->axes[1][2];
    at.z = ahead(seen, x, y, z);
    at.along_x = at.x * seen->xx + at.y * seen->xy;
    at.along_y = at.x * seen->xy + at.y * seen->yy;
    vec power = seen->log_peak - (at.x * at.along_x + at.y * at.along_y);
    power = choose(power > EXPONENT_MIN, power, splat(EXPONENT_MIN));
    at.gaussian = choose(at.z > 0.0f, exp_vec(power), splat(0.0f));
    return at;
}

/* Adaptive cells of one size: count a multiple of LANE. */
typedef struct {
    const float *places, *share;
    int64_t count, rows, first;
} Level;

static int levels_of(const Adaptive *adaptive, Level levels[2]) {
    int64_t cells = cells_of(adaptive), texels = texels_of(adaptive);
    levels[0] = (Level){adaptive->cell_places, adaptive->cell_share, cells, adaptive->rows, 0};
    levels[1] = (Level){adaptive->texel_places, adaptive->texel_share, texels,
            adaptive->fine_rows, cells};
    return texels ? 2 : 1;
}

static void images(int64_t lobes, const float *axes, const float *sharpness,
                   const Adaptive *adaptive,
                   float *values, float *gaussian, float *scale) {
    Level levels[2];
    int count = levels_of(adaptive, levels);
    int64_t adaptive_count = levels[count - 1].first + levels[count - 1].count;
    for (int64_t lobe = 0; lobe < lobes; lobe++) {
        double mean = 0;
        for (int index = 0; index < count; index++) {
            Level own = levels[index];
            Seen seen = seen_by(axes + 9 * lobe, sharpness + 2 * lobe, own.rows);
            float *value = values + lobe * adaptive_count + own.first;
            float *over_z = gaussian + lobe * adaptive_count + own.first;
            const float *x = own.places, *y = x + own.count, *z = y + own.count;
            vec total = splat(0.0f);
            for (int64_t p = 0; p < own.count; p += LANE) {
                if (!any(ahead(&seen, load(x + p), load(y + p), load(z + p)) > 0.0f)) {
                    store(value + p, splat(0.0f));
                    store(over_z + p, splat(0.0f));
                    continue;
                }
                Looked at = look(&seen, load(x + p), load(y + p), load(z + p));
                vec shown = at.z * at.gaussian;
                store(value + p, shown);
                store(over_z + p, at.gaussian);
                total += shown * load(own.share + p);
            }
            mean += sum(total);
        }
        scale[lobe] = scale_of(sharpness + 2 * lobe, mean);
    }
}

/* lobe_images.images: axes [F][N][3][3], sharpness [F][N][2]; values and gaussian [F][N][P], scale
 * [F][N]. */
API void asglight_images(int64_t frames, int64_t lobes, const float *axes, const float *sharpness,
                         const Adaptive *adaptive, float *values, float *gaussian, float *scale) {
    int64_t size = lobes * (cells_of(adaptive) + texels_of(adaptive));
    for (int64_t f = 0; f < frames; f++) {
        Adaptive own = adaptive_of(adaptive, f);
        images(lobes, axes + 9 * f * lobes, sharpness + 2 * f * lobes, &own, values + f * size,
               gaussian + f * size, scale + f * lobes);
    }
}

/* Images.radiance of one frame: what all lobes send together, [3][P]. */
void add_up(int64_t lobes, int64_t adaptive_count, const float *amplitude, const float *values,
            const float *scale, float *radiance) {
    for (int64_t p = 0; p < adaptive_count; p += LANE) {
        vec total[3] = {splat(0.0f), splat(0.0f), splat(0.0f)};
        for (int64_t i = 0; i < lobes; i++) {
            vec own = load(values + i * adaptive_count + p);
            for (int c = 0; c < 3; c++) total[c] += own * (amplitude[3 * i + c] * scale[i]);
        }
        for (int c = 0; c < 3; c++) store(radiance + c * adaptive_count + p, total[c]);
    }
}

static void slopes(int64_t lobes, const float *axes, const float *sharpness,
                   const float *amplitude, const float *scale, const Adaptive *adaptive,
                   const float *slope, float *of_scale, double *found) {
    Level levels[2];
    int count = levels_of(adaptive, levels);
    int64_t adaptive_count = levels[count - 1].first + levels[count - 1].count;
    for (int64_t lobe = 0; lobe < lobes; lobe++) {
        const float *light = amplitude + 3 * lobe;
        float sent[3] = {light[0] * scale[lobe], light[1] * scale[lobe], light[2] * scale[lobe]};
        double shape[5] = {0}, of_light[3] = {0}, of_mean[5] = {0}, mean = 0;
        for (int index = 0; index < count; index++) {
            Level own = levels[index];
            Seen seen = seen_by(axes + 9 * lobe, sharpness + 2 * lobe, own.rows);
            const float *x = own.places, *y = x + own.count, *z = y + own.count;
            const float *red = slope + own.first, *green = red + adaptive_count;
            const float *blue = green + adaptive_count;
            vec sums[14];
            for (int k = 0; k < 14; k++) sums[k] = splat(0.0f);
            for (int64_t p = 0; p < own.count; p += LANE) {
                if (!any(ahead(&seen, load(x + p), load(y + p), load(z + p)) > 0.0f)) continue;
                Looked at = look(&seen, load(x + p), load(y + p), load(z + p));
                vec value = at.z * at.gaussian, side_x = at.along_x * seen.side_x;
                vec side_y = at.along_y * seen.side_y, share = load(own.share + p);
                vec by[3] = {load(red + p), load(green + p), load(blue + p)};
                vec along = by[0] * sent[0] + by[1] * sent[1] + by[2] * sent[2];
                vec over[5] = {
                    at.gaussian * (2.0f * at.along_x * at.z * at.z + at.x),
                    at.gaussian * (2.0f * at.along_y * at.z * at.z + at.y),
                    value * (side_x * side_x * seen.speed[0] + seen.log_peak_slope[0]),
                    value * (side_y * side_y * seen.speed[1] + seen.log_peak_slope[1]),
                    value * (side_x * side_y * seen.speed[2] + seen.log_peak_slope[2]),
                };
                for (int k = 0; k < 5; k++) sums[k] += over[k] * along;
                for (int k = 0; k < 5; k++) sums[5 + k] += over[k] * share;
                for (int c = 0; c < 3; c++) sums[10 + c] += value * by[c];
                sums[13] += value * share;
            }
            for (int k = 0; k < 5; k++) shape[k] += sum(sums[k]), of_mean[k] += sum(sums[5 + k]);
            for (int c = 0; c < 3; c++) of_light[c] += sum(sums[10 + c]);
            mean += sum(sums[13]);
        }
        double change[5], brighter = 0;
        for (int k = 0; k < 5; k++) change[k] = of_mean[k] / fmax(mean, 1e-38);
        scale_slopes(sharpness + 2 * lobe, scale[lobe], change, of_scale + 5 * lobe);
        for (int c = 0; c < 3; c++) {
            of_light[c] *= scale[lobe];
            brighter += of_light[c] * light[c];
            found[8 * lobe + 5 + c] = of_light[c];
        }
        for (int k = 0; k < 5; k++)
            found[8 * lobe + k] = shape[k] + of_scale[5 * lobe + k] * brighter;
    }
}

/* lobe_images.scale_slopes and slopes: amplitude [F][N][3], scale [F][N], slope [F][3][P]; of_scale
 * [F][N][5], found [F][N][8]. */
API void asglight_slopes(int64_t frames, int64_t lobes, const float *axes, const float *sharpness,
                         const float *amplitude, const float *scale, const Adaptive *adaptive,
                         const float *slope, float *of_scale, double *found) {
    int64_t size = 3 * (cells_of(adaptive) + texels_of(adaptive));
    for (int64_t f = 0; f < frames; f++) {
        Adaptive own = adaptive_of(adaptive, f);
        int64_t first = f * lobes;
        slopes(lobes, axes + 9 * first, sharpness + 2 * first, amplitude + 3 * first, scale + first,
               &own, slope + f * size, of_scale + 5 * first, found + 8 * first);
    }
}
