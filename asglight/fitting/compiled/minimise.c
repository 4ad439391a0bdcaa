/* SPDX-License-Identifier: Apache-2.0
 *
 * newton.minimise: Levenberg-Marquardt steps on all lobes of a frame at once, frames side by side.
 */
#include "steps.h"

#include <stdlib.h>
#include <string.h>

enum { UNKNOWNS = 8 };

/* newton._State of one frame: lobe_images.Images, objective.LossTerms, and J with the temporal
 * terms. */
typedef struct {
    float *axes, *sharpness, *amplitude, *values, *gaussian, *scale;
    float *radiance, *parts, *texels, *views, *seen;
    float value;
} State;

/* All that is needed in a step, and not after it. */
typedef struct {
    float *slope, *env_weight, *view_weight, *of_scale;
    double *curvature, *temporal_slope, *step;
} Work;

/* What a frame has for itself. */
typedef struct {
    State now, tried;
    State kept, spare; /* their memory; the first `now` has that of the caller */
    double *hessian, *gradient, *damping;
    int known; /* whether hessian and gradient are of `now` */
    int ended; /* whether no further step is asked for */
    Work work;
    Adaptive adaptive;
    Target target;
} Frame;

typedef struct {
    int64_t lobes, cells, adaptive, texels, views, parts;
} Counts;

/* What the frames have in common. */
typedef struct {
    Frame *frames;
    const Steps *given;
    Counts counts;
} Call;

/* Memory that stays for the next call, or that is of this call alone: who is called after a step may
 * take steps. */
static float *room(int which, int64_t count, int alone) {
    if (!alone) return scratch(which, count);
    float *found = malloc(count * sizeof(float));
    if (!found) abort();
    return found;
}

static float *take(float **from, int64_t count) {
    float *found = *from;
    *from += (count + LANE - 1) / LANE * LANE;
    return found;
}

static double *take_doubles(double **from, int64_t count) {
    double *found = *from;
    *from += count;
    return found;
}

static int64_t images_size(Counts counts) { return counts.lobes * counts.adaptive; }

/* Where the lobes of a frame and their images lie in tensors of all frames. */
static State at_frame(Lit lit, Counts counts, int64_t frame) {
    int64_t first = frame * counts.lobes;
    State found = {0};
    found.axes = lit.axes + 9 * first, found.sharpness = lit.sharpness + 2 * first;
    found.amplitude = lit.amplitude + 3 * first, found.scale = lit.scale + first;
    found.values = lit.values + frame * images_size(counts);
    found.gaussian = lit.gaussian + frame * images_size(counts);
    return found;
}

static void copy_lit(const State *from, const State *to, Counts counts) {
    memcpy(to->axes, from->axes, 9 * counts.lobes * sizeof(float));
    memcpy(to->sharpness, from->sharpness, 2 * counts.lobes * sizeof(float));
    memcpy(to->amplitude, from->amplitude, 3 * counts.lobes * sizeof(float));
    memcpy(to->scale, from->scale, counts.lobes * sizeof(float));
    memcpy(to->values, from->values, images_size(counts) * sizeof(float));
    memcpy(to->gaussian, from->gaussian, images_size(counts) * sizeof(float));
}

/* The temporal term of a frame towards one neighbour; curvature and slope in `work`. */
static float temporal_term(const State *state, const Prior *prior, float corner, int64_t lobes,
                           int64_t frame, const Work *work) {
    int64_t first = frame * lobes;
    float value;
    asglight_temporal(1, lobes, state->axes, state->sharpness, state->amplitude,
                      prior->axes + 9 * first, prior->sharpness + 2 * first,
                      prior->amplitude + 3 * first, prior->share + first,
                      prior->scale + UNKNOWNS * first, &corner, &value, work->curvature,
                      work->temporal_slope);
    return value;
}

/* newton._judged, of lobes whose images are known. */
static void judge(State *state, const Frame *own, const Steps *given, Counts counts,
                  int64_t frame) {
    add_up(counts.lobes, counts.adaptive, state->amplitude, state->values, state->scale,
           state->radiance);
    asglight_loss_terms(1, &own->adaptive, &own->target, given->probes, state->radiance,
                        &state->value,
                   state->parts, state->texels, state->views, state->seen);
    for (int64_t k = 0; k < given->prior_count; k++)
        state->value += temporal_term(state, given->priors + k, given->temporal_corner,
                                      counts.lobes, frame, &own->work);
}

/* newton._equations. */
static void set_up(const Frame *own, const Steps *given, Counts counts, int64_t frame) {
    const State *now = &own->now;
    Work work = own->work;
    int64_t size = UNKNOWNS * counts.lobes;
    asglight_loss_gradient(1, &own->adaptive, &own->target, given->probes, now->radiance,
                           now->parts,
                    now->texels, now->views, now->seen, work.slope, work.env_weight,
                    work.view_weight);
    asglight_slopes(1, counts.lobes, now->axes, now->sharpness, now->amplitude, now->scale,
                    &own->adaptive, work.slope, work.of_scale, own->gradient);
    asglight_matrix(1, counts.lobes, now->axes, now->sharpness, now->amplitude, now->scale,
                    work.of_scale, &own->adaptive, given->cell_probes, given->cell_places,
                    given->cell_share, work.env_weight, work.view_weight, own->hessian);
    for (int64_t k = 0; k < given->prior_count; k++) {
        temporal_term(now, given->priors + k, given->temporal_corner, counts.lobes, frame, &work);
        for (int64_t i = 0; i < size; i++) {
            own->hessian[i * size + i] += work.curvature[i];
            own->gradient[i] += work.temporal_slope[i];
        }
    }
}

/* newton._tried: into `tried`. */
static void try_step(Frame *own, const Steps *given, Counts counts, int64_t frame) {
    State *now = &own->now, *tried = &own->tried;
    int64_t first = frame * counts.lobes;
    asglight_solve(1, counts.lobes, own->hessian, own->gradient, now->sharpness, now->amplitude,
                   own->damping, given->still ? given->still + first : 0, given->bounds + 3,
                   own->work.step);
    asglight_advance(counts.lobes, now->axes, now->sharpness, now->amplitude, own->work.step,
                     given->bounds, tried->axes, tried->sharpness, tried->amplitude);
    asglight_images(1, counts.lobes, tried->axes, tried->sharpness, &own->adaptive, tried->values,
                    tried->gaussian, tried->scale);
    judge(tried, own, given, counts, frame);
}

static void take_step(Frame *own) {
    own->now = own->tried;
    own->tried = own->now.axes == own->kept.axes ? own->spare : own->kept;
    own->known = 0;
}

/* Put what was found where the caller looks for it. */
static void hand_over(const Frame *own, Counts counts) {
    if (own->now.axes != own->kept.axes) copy_lit(&own->now, &own->kept, counts);
}

static void lay_sizes(State *state, Counts counts, float **memory) {
    state->radiance = take(memory, 3 * counts.adaptive);
    state->parts = take(memory, counts.parts * counts.cells);
    state->texels = take(memory, counts.texels);
    state->views = take(memory, 3 * counts.views);
    state->seen = take(memory, counts.views);
}

static void lay_images(State *state, Counts counts, float **memory) {
    state->axes = take(memory, 9 * counts.lobes);
    state->sharpness = take(memory, 2 * counts.lobes);
    state->amplitude = take(memory, 3 * counts.lobes);
    state->scale = take(memory, counts.lobes);
    state->values = take(memory, images_size(counts));
    state->gaussian = take(memory, images_size(counts));
}

/* Floats that `lay_sizes`, `lay_images` and `Work` take, at most. */
static int64_t sizes_size(Counts counts) {
    return 3 * counts.adaptive + counts.parts * counts.cells + counts.texels + 4 * counts.views +
           5 * LANE;
}

static int64_t state_size(Counts counts) {
    return 2 * sizes_size(counts) + 15 * counts.lobes + 2 * images_size(counts) + 6 * LANE;
}

static int64_t work_size(Counts counts) {
    return 4 * counts.adaptive + counts.views + 5 * counts.lobes + 4 * LANE;
}

static void lay_work(Work *work, Counts counts, float **memory, double **doubles) {
    int64_t size = UNKNOWNS * counts.lobes;
    work->slope = take(memory, 3 * counts.adaptive);
    work->env_weight = take(memory, counts.adaptive);
    work->view_weight = take(memory, counts.views);
    work->of_scale = take(memory, 5 * counts.lobes);
    work->curvature = take_doubles(doubles, size);
    work->temporal_slope = take_doubles(doubles, size);
    work->step = take_doubles(doubles, size);
}

static void begin_frame(void *context, int frame) {
    const Call *call = context;
    Frame *own = call->frames + frame;
    judge(&own->now, own, call->given, call->counts, frame);
}

static void step_frame(void *context, int frame) {
    const Call *call = context;
    const Steps *given = call->given;
    Frame *own = call->frames + frame;
    if (!own->known) set_up(own, given, call->counts, frame);
    own->known = 1;
    try_step(own, given, call->counts, frame);
    float before = own->now.value, after = own->tried.value;
    int better = after < before;
    if (better) take_step(own);
    *own->damping = better ? fmax(given->damping_down * *own->damping, given->damping_min)
                           : fmin(given->damping_up * *own->damping, given->damping_max);
    int finished = better && before - after < given->tolerance * before;
    own->ended = finished || *own->damping >= given->damping_max;
}

/* newton.minimise: `given` lobes [F][N] and their images, damping [F] and `found` as `given`, value
 * [F]. `damping` is overwritten. `report`, if any, is called after each step with `found` as it is
 * then, and ends the steps by returning other than 0. */
API void asglight_minimise(int64_t frames, int64_t lobes, int64_t steps, const Steps *given,
                           const Lit *start, const Lit *found, double *damping, float *value,
                           int (*report)(void)) {
    const Adaptive *adaptive = given->adaptive;
    Counts counts = {lobes, cells_of(adaptive), 0, texels_of(adaptive), given->probes->views,
                     given->target->part_count};
    counts.adaptive = counts.cells + counts.texels;
    int64_t size = UNKNOWNS * lobes;
    int64_t frame_size = (sizeof(Frame) + sizeof(float) - 1) / sizeof(float) + LANE;
    int64_t memory_size = frames * (state_size(counts) + work_size(counts) + frame_size);
    int64_t doubles_size = 2 * frames * size * (size + 4);
    float *whole = room(STATES, memory_size, !!report), *memory = whole;
    float *equations = room(EQUATIONS, doubles_size, !!report);
    double *doubles = (double *)equations;
    Frame *all = (Frame *)take(&memory, frames * frame_size);
    Call call = {all, given, counts};
    for (int64_t f = 0; f < frames; f++) {
        Frame *own = all + f;
        *own = (Frame){.adaptive = adaptive_of(adaptive, f), .target = target_of(given->target, f)};
        own->kept = at_frame(*found, counts, f);
        lay_sizes(&own->kept, counts, &memory);
        lay_images(&own->spare, counts, &memory);
        lay_sizes(&own->spare, counts, &memory);
        lay_work(&own->work, counts, &memory, &doubles);
        own->hessian = take_doubles(&doubles, size * size);
        own->gradient = take_doubles(&doubles, size);
        own->damping = damping + f;
        State lit = at_frame(*start, counts, f);
        own->now = own->spare;
        own->now.axes = lit.axes, own->now.sharpness = lit.sharpness;
        own->now.amplitude = lit.amplitude, own->now.scale = lit.scale;
        own->now.values = lit.values, own->now.gaussian = lit.gaussian;
        own->tried = own->kept;
    }
    side_by_side(frames, begin_frame, &call);
    for (int64_t step = 0; step < steps; step++) {
        int ended = 1;
        side_by_side(frames, step_frame, &call);
        for (int64_t f = 0; f < frames; f++) ended &= all[f].ended;
        if (report) {
            for (int64_t f = 0; f < frames; f++) hand_over(all + f, counts);
            ended |= report();
        }
        if (ended) break;
    }
    for (int64_t f = 0; f < frames; f++) {
        hand_over(all + f, counts);
        value[f] = all[f].now.value;
    }
    if (report) free(whole), free(equations);
}
