/* SPDX-License-Identifier: Apache-2.0
 *
 * A pool of threads for work in parts that do not depend on each other. What a part computes does
 * not depend on the thread, so neither do results on how many there are.
 *
 * The caller takes parts as its helpers do, and needs none of them. A part is a step of one frame,
 * about a millisecond, and the next step begins some microseconds after the last part of this one:
 * a helper without work looks for it a little while before it sleeps, for to wake it takes longer.
 */
#include "steps.h"

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#if defined(__linux__)
#include <sys/prctl.h>
#endif
#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

enum { THREADS_MAX = 4, LOOKS = 2000 }; /* trials of a frame are about so many; a look: 30 ns */

/* Work in parts; it lies with its caller, who waits until none of them is left. */
typedef struct Job {
    Task work;
    void *context;
    int parts, next, room; /* next: the first part that nobody has; room: for so many helpers */
    atomic_int left;       /* parts that have not ended */
    struct Job *after;
} Job;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t more = PTHREAD_COND_INITIALIZER;
static Job *jobs; /* those with parts that nobody has */
static int helpers, asleep;
static atomic_uint calls; /* of `side_by_side`, so far */

static _Thread_local int threads = 1;

static void look_again(void) {
#if defined(__SSE2__)
    __builtin_ia32_pause();
#endif
}

/* The next part of a job, -1 if somebody has each; `lock` is held. */
static int taken(Job *job) {
    if (job->next == job->parts) return -1;
    int part = job->next++;
    if (job->next == job->parts) {
        Job **at = &jobs;
        while (*at != job) at = &(*at)->after;
        *at = job->after;
    }
    return part;
}

static void *help(void *none) {
    uint32_t seen = 0;
#if defined(__linux__)
    prctl(PR_SET_NAME, "asglight-step");
#endif
    asglight_begin(1);
    pthread_mutex_lock(&lock);
    for (;;) {
        Job *job = jobs;
        while (job && !job->room) job = job->after;
        if (job) {
            int part = taken(job);
            job->room--;
            pthread_mutex_unlock(&lock);
            job->work(job->context, part);
            pthread_mutex_lock(&lock);
            job->room++;
            atomic_fetch_sub(&job->left, 1); /* from here on the job may be gone */
        } else if (seen != atomic_load(&calls)) {
            seen = atomic_load(&calls);
            pthread_mutex_unlock(&lock);
            for (int i = 0; i < LOOKS && seen == atomic_load(&calls); i++) look_again();
            pthread_mutex_lock(&lock);
        } else {
            asleep++;
            pthread_cond_wait(&more, &lock);
            asleep--;
        }
    }
    return none;
}

/* A process that was forked has its own thread alone. */
static void forget(void) {
    pthread_mutex_init(&lock, 0);
    pthread_cond_init(&more, 0);
    jobs = 0, helpers = asleep = 0;
}

/* Start a helper if there may be one more; `lock` is held. */
static void start_helper(void) {
    pthread_t thread;
    static int told;
    if (!told) told = !pthread_atfork(0, 0, forget);
    if (!pthread_create(&thread, 0, help, 0)) helpers++, pthread_detach(thread);
}

/* Call work(context, part) for each part, on as many threads as `asglight_begin` allows. */
void side_by_side(int parts, Task work, void *context) {
    if (threads < 2 || parts < 2) {
        for (int part = 0; part < parts; part++) work(context, part);
        return;
    }
    Job own = {work, context, parts, 0, threads - 1, parts, 0};
    pthread_mutex_lock(&lock);
    if (helpers < threads - 1) start_helper();
    own.after = jobs, jobs = &own;
    atomic_fetch_add(&calls, 1);
    if (asleep) pthread_cond_broadcast(&more);
    for (int part; (part = taken(&own)) >= 0; pthread_mutex_lock(&lock)) {
        pthread_mutex_unlock(&lock);
        work(context, part);
        atomic_fetch_sub(&own.left, 1);
    }
    pthread_mutex_unlock(&lock);
    for (int i = 0; atomic_load(&own.left); i++) i < LOOKS ? look_again() : (void)sched_yield();
}

/* Begin to compute, on so many threads at most; returns what `asglight_end` takes.
 *
 * From here on, numbers of this thread below the smallest normal one are 0: tails of lobes are full
 * of them, and Intel's processors are slow with them. */
API uint32_t asglight_begin(int64_t threads_most) {
    threads = threads_most < THREADS_MAX ? threads_most : THREADS_MAX;
#if defined(__SSE2__)
    uint32_t before = _mm_getcsr();
    _mm_setcsr(before | 0x8040); /* results (bit 15) and what is read (bit 6) */
    return before;
#else
    return 0;
#endif
}

API void asglight_end(uint32_t before) {
    threads = 1;
#if defined(__SSE2__)
    _mm_setcsr(before);
#else
    (void)before;
#endif
}
