/* SPDX-License-Identifier: Apache-2.0
 *
 * Steps of the fast fit and their dear parts, compiled: what asglight/fitting does on the processor
 * in float32 for lobes of the form asg. Names are those of the Python functions, which say what is
 * computed and why, and which the tests hold these against.
 *
 * Images on adaptive cells are [channel][adaptive cell] as in Python. Inside, whatever a filter
 * or a Gram matrix
 * reads is [place][lane]: lanes are channels or columns, as many as fill whole vectors.
 *
 * Letters: F frames, N lobes, C cells, R refined cells, Q their texels, P = C + Q adaptive cells,
 * D views.
 */
#ifndef ASGLIGHT_STEPS_H
#define ASGLIGHT_STEPS_H

#include <math.h>
#include <stdint.h>

#if defined(_WIN32)
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

#define LANE 8 /* floats in a vector */

typedef float vec __attribute__((vector_size(4 * LANE), aligned(4), may_alias));
typedef double quad __attribute__((vector_size(32), aligned(8), may_alias));
typedef int32_t ivec __attribute__((vector_size(4 * LANE), aligned(4), may_alias));

static inline vec splat(float x) { return (vec){x, x, x, x, x, x, x, x}; }
static inline vec load(const float *from) { return *(const vec *)from; }
static inline void store(float *to, vec value) { *(vec *)to = value; }
static inline vec choose(ivec mask, vec one, vec other) {
    return (vec)((mask & (ivec)one) | (~mask & (ivec)other));
}
static inline int any(ivec mask) {
    int found = 0;
    for (int l = 0; l < LANE; l++) found |= mask[l];
    return found != 0;
}
static inline float sum(vec v) {
    return ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7]));
}

/* exp for arguments from -87 to 87, to 2e-7 of the result: 2^n times a polynomial of degree 6. */
static inline vec exp_vec(vec x) {
    const float log2e = 1.44269504f, ln2_high = 0.693359375f, ln2_low = -2.12194440e-4f;
    const vec magic = splat(12582912.0f); /* 1.5 * 2^23: adding it rounds to a whole number */
    vec n = (x * log2e + magic) - magic;
    vec r = (x - n * ln2_high) - n * ln2_low;
    vec p = splat(1.0f / 720) * r + 1.0f / 120;
    p = p * r + 1.0f / 24;
    p = p * r + 1.0f / 6;
    p = p * r + 0.5f;
    p = p * r + 1.0f;
    p = p * r + 1.0f;
    ivec power = (__builtin_convertvector(n, ivec) + 127) << 23;
    return p * (vec)power;
}

/* How adaptive cells of one size see a lobe (fitting/loss/footprints.py), in the lobe's frame. */
typedef struct {
    float axes[3][3];                  /* rows x, y, z */
    float xx, xy, yy, log_peak;        /* S', log c */
    float side_x, side_y;              /* 1 / sx, 1 / sy */
    float speed[3], log_peak_slope[3]; /* along two widths and the turn */
} Seen;

/* The adaptive cells of frames. What a frame has for itself lies `..._next` further on for the
 * next one, 0
 * where frames share it. */
typedef struct {
    int64_t rows, fine_rows, refined_count;
    const float *cell_places;  /* [3][C] */
    const float *grid_share;   /* [C], of all cells */
    const float *splatting;    /* [Q / R][25] */
    const float *texel_places; /* [3][Q] */
    const float *cell_share;   /* [C] */
    const float *texel_share;  /* [Q] */
    const int64_t *refined;    /* [R] */
    const int64_t *around;     /* [25 R] */
    int64_t texel_places_next, cell_share_next, texel_share_next, refined_next, around_next;
} Adaptive;

static inline int64_t cells_of(const Adaptive *adaptive) { return 2 * adaptive->rows * adaptive->rows; }

static inline int64_t texels_per_cell(const Adaptive *adaptive) {
    int64_t factor = adaptive->fine_rows / adaptive->rows;
    return factor * factor;
}

static inline int64_t texels_of(const Adaptive *adaptive) {
    return adaptive->refined_count * texels_per_cell(adaptive);
}

static inline Adaptive adaptive_of(const Adaptive *all, int64_t frame) {
    Adaptive own = *all;
    own.texel_places += frame * all->texel_places_next;
    own.cell_share += frame * all->cell_share_next;
    own.texel_share += frame * all->texel_share_next;
    own.refined += frame * all->refined_next;
    own.around += frame * all->around_next;
    return own;
}

#define SOURCES_MAX 8

/* The probes on a grid (fitting/loss/probes.py). Frequencies that a probe does not let through
 * are left out: `waves` of them count. */
typedef struct {
    int64_t rows, sources, waves, views;
    const float *cosine; /* [waves][rows + 1], of the first half of a row */
    const float *sine;
    int64_t rings[SOURCES_MAX], counts[SOURCES_MAX], own_waves[SOURCES_MAX];
    const float *filter[SOURCES_MAX]; /* [own waves][sum, difference][rings / 2][rows / 2] */
    const float *view_cosine[SOURCES_MAX]; /* [counts / 2 + 1][own waves] */
    const float *view_sine[SOURCES_MAX];
} Probes;

/* J of frames (fitting/loss/objective.py), laid out as `Adaptive cells`. */
typedef struct {
    const float *radiance;     /* [3][P] */
    const float *parts;        /* [K][3][C] */
    const float *env_scale;    /* [1] */
    const float *probe_scale;  /* [sources] */
    const float *view_weight;  /* [D] */
    const float *probe_corner; /* [sources], of the scale */
    int64_t radiance_next, parts_next, env_scale_next, probe_scale_next, view_weight_next;
    int64_t part_count;
    float env_corner, env_weight; /* the corner of the scale */
} Target;

static inline Target target_of(const Target *all, int64_t frame) {
    Target own = *all;
    own.radiance += frame * all->radiance_next;
    own.parts += frame * all->parts_next;
    own.env_scale += frame * all->env_scale_next;
    own.probe_scale += frame * all->probe_scale_next;
    own.view_weight += frame * all->view_weight_next;
    return own;
}

/* temporal.Prior of frames: lobes [F][N], share [F][N], scale [F][N][8]. */
typedef struct {
    const float *axes, *sharpness, *amplitude, *share, *scale;
} Prior;

/* Lobes of frames on their adaptive cells (fitting/loss/lobe_images.py): axes [F][N][3][3], sharpness
 * [F][N][2], amplitude [F][N][3]; values and gaussian [F][N][P], scale [F][N]. */
typedef struct {
    float *axes, *sharpness, *amplitude, *values, *gaussian, *scale;
} Lit;

#define PRIORS_MAX 2

/* What the steps of one call have in common (newton.Setting): the matrix is summed on `cell_...`,
 * a coarser grid. */
typedef struct {
    const Adaptive *adaptive;
    const Target *target;
    const Probes *probes, *cell_probes;
    const float *cell_places, *cell_share;
    const uint8_t *still; /* [F][N], or null */
    float bounds[5];      /* of asglight_advance */
    Prior priors[PRIORS_MAX];
    int64_t prior_count;
    double damping_up, damping_down, damping_min, damping_max;
    float tolerance, temporal_corner;
} Steps;

/* thread_pool.c */
typedef void (*Task)(void *context, int part);
void side_by_side(int parts, Task work, void *context);
API uint32_t asglight_begin(int64_t threads_most);
API void asglight_end(uint32_t before);

/* product.c */
void product(int m, int n, int k, const float *a, long row, long column, const float *b, long ldb,
             float *c, long ldc, int add);
void gram_add(int count, int width, const float *weighted, const float *columns, float *gram);
float *scratch(int which, long floats);

/* Which piece of memory `scratch` gives: no two that are in use at the same time are one. */
enum {
    SAMPLES, SPECTRUM, RINGS, MIRRORED, FILTERED, LAID_VIEWS, /* probes.c */
    LAID, SEEN,                                   /* images and views, a lane a channel */
    GRAMS, COLUMN_IMAGES, RINGS_OF_COLUMNS,       /* equations.c */
    SYSTEM,                                       /* steps.c */
    STATES, EQUATIONS,                            /* minimise.c */
    ROOTED, LAID_LOBES, OF_FRAME,                 /* light.c */
    MIXED,                                        /* mixture.c */
    ARENAS
};

/* lobes.c */
Seen seen_by(const float *axes, const float *sharpness, int64_t rows);
int is_narrow(const float *sharpness);
float scale_of(const float *sharpness, double mean);
void scale_slopes(const float *sharpness, float scale, const double change[5], float slopes[5]);

API void asglight_images(int64_t frames, int64_t lobes, const float *axes, const float *sharpness,
                         const Adaptive *adaptive, float *values, float *gaussian, float *scale);
void add_up(int64_t lobes, int64_t adaptive_count, const float *amplitude, const float *values,
            const float *scale, float *radiance);
API void asglight_slopes(int64_t frames, int64_t lobes, const float *axes, const float *sharpness,
                         const float *amplitude, const float *scale, const Adaptive *adaptive,
                         const float *slope, float *of_scale, double *found);

/* objective.c */
void lobes_to_cells(const Adaptive *adaptive, int64_t lobes, const float *scale,
                    const float *images,
                    float *cells, int lanes);
API void asglight_loss_terms(int64_t frames, const Adaptive *adaptive, const Target *target,
                        const Probes *probes, const float *radiance, float *value, float *parts,
                        float *texels, float *views, float *seen);
API void asglight_loss_gradient(int64_t frames, const Adaptive *adaptive, const Target *target,
                         const Probes *probes, const float *radiance, const float *parts,
                         const float *texels, const float *views, const float *seen, float *slope,
                         float *env_weight, float *view_weight);

/* equations.c */
API void asglight_matrix(int64_t frames, int64_t lobes, const float *axes, const float *sharpness,
                         const float *amplitude, const float *scale, const float *of_scale,
                         const Adaptive *adaptive, const Probes *probes, const float *cell_places,
                         const float *cell_share, const float *env_weight,
                         const float *view_weight, double *hessian);

/* steps.c */
API void asglight_solve(int64_t frames, int64_t lobes, const double *hessian,
                        const double *gradient, const float *sharpness, const float *amplitude,
                        const double *damping, const uint8_t *still, const float *least,
                        double *step);
API void asglight_advance(int64_t lobes, const float *axes, const float *sharpness,
                          const float *amplitude, const double *step, const float *bounds,
                          float *new_axes, float *new_sharpness, float *new_amplitude);
API void asglight_temporal(int64_t frames, int64_t lobes, const float *axes,
                           const float *sharpness, const float *amplitude,
                           const float *before_axes, const float *before_sharpness,
                           const float *before_amplitude, const float *share, const float *scale,
                           const float *corner, float *value, double *curvature, double *slope);

/* probes.c */
long rings_size(const Probes *probes, int lanes);
void probe_lanes(const Probes *probes, int lanes, const float *images, float *views);
void probe_ring(const Probes *probes, int source, int ring, int lanes, const float *rings,
                float *views);
void probe_rings(const Probes *probes, int lanes, const float *images, float *rings);
void probe_few(const Probes *probes, const float *images, float *views);
void pull_few(const Probes *probes, const float *views, float *images);

#endif
