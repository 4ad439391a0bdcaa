/* SPDX-License-Identifier: Apache-2.0
 *
 * What materials show of images: fitting/loss/probes.py, on images [row][column][lane].
 *
 * Everything is symmetric: a cosine is even and a sine odd about the middle of a row, and about a
 * quarter of it one or the other by the parity of its frequency; a filter is the same seen from the
 * other pole. So a row is folded twice, a map once, and a product is a quarter or half as large.
 */
#include "steps.h"

static void combine(int lanes, const float *one, const float *other, float *plus, float *minus) {
    for (int l = 0; l < lanes; l += LANE) {
        vec a = load(one + l), b = load(other + l);
        store(plus + l, a + b);
        store(minus + l, a - b);
    }
}

static void copy(int lanes, const float *from, float *to) {
    for (int l = 0; l < lanes; l += LANE) store(to + l, load(from + l));
}

static void clear(long count, float *to) {
    for (long i = 0; i < count; i += LANE) store(to + i, splat(0.0f));
}

/* plus[j] = x[j] + x[last - j] and minus[j] = x[j] - x[last - j]; a middle one counts once, and
 * wherever it is not odd. Elements lie `next` floats apart. */
static void fold(int last, int lanes, const float *x, long next, float *plus, float *minus) {
    int j = 0;
    for (; 2 * j < last; j++)
        combine(lanes, x + j * next, x + (last - j) * next, plus + j * lanes, minus + j * lanes);
    if (2 * j == last) {
        copy(lanes, x + j * next, plus + j * lanes);
        clear(lanes, minus + j * lanes);
    }
}

/* The transpose: x[j] = plus[j] + minus[j], x[last - j] = plus[j] - minus[j]. */
static void unfold(int last, int lanes, const float *plus, const float *minus, float *x, long next) {
    int j = 0;
    for (; 2 * j < last; j++)
        combine(lanes, plus + j * lanes, minus + j * lanes, x + j * next, x + (last - j) * next);
    if (2 * j == last) copy(lanes, plus + j * lanes, x + j * next);
}

/* Cosines and sines over places; which is the faster index depends on what is made of which. */
typedef struct {
    const float *cosine, *sine;
    long wave, place;
} Waves;

/* Scratch of a row of n samples folded once, even and odd, and each of these folded again. */
typedef struct {
    float *once[2], *twice[2][2];
} Folds;

static Folds folds(int n, int lanes) {
    long half = (long)(n / 2 + 1) * lanes, quarter = (long)(n / 4 + 1) * lanes;
    float *at = scratch(SAMPLES, 2 * half + 4 * quarter);
    Folds found;
    for (int odd = 0; odd < 2; odd++) {
        found.once[odd] = at + odd * half;
        for (int minus = 0; minus < 2; minus++)
            found.twice[odd][minus] = at + 2 * half + (2 * odd + minus) * quarter;
    }
    return found;
}

/* The waves in n samples [place][lane]: found [wave][cosine, sine][lane], `next` floats apart. */
static void analyse(int n, int count, int lanes, Waves waves, const float *samples, float *found,
                    long next) {
    Folds folded = folds(n, lanes);
    const float *tables[2] = {waves.cosine, waves.sine};
    /* place 0 has no partner: it is even, and sines are 0 there */
    copy(lanes, samples, folded.once[0]);
    clear(lanes, folded.once[1]);
    fold(n - 2, lanes, samples + lanes, lanes, folded.once[0] + lanes, folded.once[1] + lanes);
    for (int odd = 0; odd < 2; odd++) {
        float *to = found + odd * lanes;
        if (n % 4) {
            product(count, lanes, n / 2 + 1, tables[odd], waves.wave, waves.place,
                    folded.once[odd], lanes, to, next, 0);
            continue;
        }
        fold(n / 2, lanes, folded.once[odd], lanes, folded.twice[odd][0], folded.twice[odd][1]);
        for (int parity = 0; parity < 2; parity++) /* of the frequency */
            product((count + 1 - parity) / 2, lanes, n / 4 + 1, tables[odd] + parity * waves.wave,
                    2 * waves.wave, waves.place, folded.twice[odd][parity ^ odd], lanes,
                    to + parity * next, 2 * next, 0);
    }
}

/* The transpose: n samples from waves. */
static void synthesise(int n, int count, int lanes, Waves waves, const float *given, long next,
                       float *samples) {
    Folds folded = folds(n, lanes);
    const float *tables[2] = {waves.cosine, waves.sine};
    for (int odd = 0; odd < 2; odd++) {
        const float *from = given + odd * lanes;
        if (n % 4) {
            product(n / 2 + 1, lanes, count, tables[odd], waves.place, waves.wave, from, next,
                    folded.once[odd], lanes, 0);
            continue;
        }
        for (int parity = 0; parity < 2; parity++)
            product(n / 4 + 1, lanes, (count + 1 - parity) / 2, tables[odd] + parity * waves.wave,
                    waves.place, 2 * waves.wave, from + parity * next, 2 * next,
                    folded.twice[odd][parity ^ odd], lanes, 0);
        unfold(n / 2, lanes, folded.twice[odd][0], folded.twice[odd][1], folded.once[odd], lanes);
    }
    copy(lanes, folded.once[0], samples);
    unfold(n - 2, lanes, folded.once[0] + lanes, folded.once[1] + lanes, samples + lanes, lanes);
}

static Waves of_rows(const Probes *probes) {
    return (Waves){probes->cosine, probes->sine, probes->rows + 1, 1};
}

static Waves of_rings(const Probes *probes, int source) {
    return (Waves){probes->view_cosine[source], probes->view_sine[source], 1,
                   probes->own_waves[source]};
}

static int half_of(int count) { return (count + 1) / 2; }

/* Of a source and a wave: [2][half of the rings][half of the rows], of sums and of differences. */
static const float *filter_of(const Probes *probes, int source, int wave, int minus) {
    long size = (long)half_of(probes->rings[source]) * half_of(probes->rows);
    return probes->filter[source] + (2L * wave + minus) * size;
}

/* Spectra lie [sum, difference of mirrored rows][wave][half of the rows][cosine, sine][lane]. */
static long spectrum_size(const Probes *probes, int lanes) {
    return probes->waves * half_of(probes->rows) * 2 * lanes;
}

long rings_size(const Probes *probes, int lanes) {
    long total = 0;
    for (int source = 0; source < probes->sources; source++)
        total += probes->rings[source] * probes->own_waves[source] * 2 * lanes;
    return total;
}

/* Images [row][column][lane] to what the filters show, source by source
 * [ring][own wave][cosine, sine][lane]. */
void probe_rings(const Probes *probes, int lanes, const float *images, float *rings) {
    int rows = probes->rows, half = half_of(rows), wide = 2 * lanes;
    long row_size = 2L * rows * lanes, size = spectrum_size(probes, lanes);
    float *spectra = scratch(SPECTRUM, 2 * size), *mirrored = scratch(MIRRORED, 2 * row_size);
    for (int row = 0; row < half; row++) {
        const float *own = images + row * row_size;
        /* a fold of two rows, or of the middle one alone */
        fold(row < rows - 1 - row, row_size, own, (rows - 1 - 2 * row) * row_size, mirrored,
             mirrored + row_size);
        for (int minus = 0; minus < 2; minus++)
            analyse(2 * rows, probes->waves, lanes, of_rows(probes), mirrored + minus * row_size,
                    spectra + minus * size + (long)row * wide, (long)half * wide);
    }
    for (int source = 0; source < probes->sources; source++) {
        int own = probes->own_waves[source], count = probes->rings[source], some = half_of(count);
        float *filtered = scratch(FILTERED, 2L * some * wide);
        for (int wave = 0; wave < own; wave++) {
            for (int minus = 0; minus < 2; minus++)
                product(some, wide, half, filter_of(probes, source, wave, minus), half, 1,
                        spectra + minus * size + (long)wave * half * wide, wide,
                        filtered + (long)minus * some * wide, wide, 0);
            unfold(count - 1, wide, filtered, filtered + (long)some * wide,
                   rings + (long)wave * wide, (long)own * wide);
        }
        rings += (long)count * own * wide;
    }
}

/* One ring of `probe_rings` to its views [view][lane]. */
void probe_ring(const Probes *probes, int source, int ring, int lanes, const float *rings,
                float *views) {
    int own = probes->own_waves[source], wide = 2 * lanes;
    synthesise(probes->counts[source], own, lanes, of_rings(probes, source),
               rings + (long)ring * own * wide, wide, views);
}

/* probes.probe: images [row][column][lane], views [view][lane]. */
void probe_lanes(const Probes *probes, int lanes, const float *images, float *views) {
    float *rings = scratch(RINGS, rings_size(probes, lanes));
    probe_rings(probes, lanes, images, rings);
    for (int source = 0; source < probes->sources; source++) {
        for (int ring = 0; ring < probes->rings[source]; ring++) {
            probe_ring(probes, source, ring, lanes, rings, views);
            views += probes->counts[source] * lanes;
        }
        rings += probes->rings[source] * probes->own_waves[source] * 2 * lanes;
    }
}

/* Images of one map have three channels, and the mean radiance one: they fill less than half of a
 * vector. So two rows lie side by side in one, the sum and the difference of mirrored ones, and then
 * two mirrored rings. Each lane sums in the order of `probe_lanes`. */
enum { HALF = LANE / 2 };

/* Of two vectors the first half each, and the second. */
static inline vec firsts(vec a, vec b) { return (vec){a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]}; }
static inline vec seconds(vec a, vec b) { return (vec){a[4], a[5], a[6], a[7], b[4], b[5], b[6], b[7]}; }

/* both[i] = one's and other's first half side by side; no other where it is the one. */
static void join(long count, const float *one, const float *other, float *both) {
    for (long i = 0; i < count; i++)
        store(both + i * LANE, firsts(load(one + i * LANE),
                                      other == one ? splat(0.0f) : load(other + i * LANE)));
}

/* The transpose. */
static void part(long count, const float *both, float *one, float *other) {
    for (long i = 0; i < count; i++) {
        vec each = load(both + i * LANE);
        if (other != one) store(other + i * LANE, seconds(each, splat(0.0f)));
        store(one + i * LANE, firsts(each, splat(0.0f)));
    }
}

/* Side by side: the sum and the difference of two, or back; of a middle one that is alone. */
static void exchange(long count, int alone, float *both) {
    for (long i = 0; !alone && i < count; i++) {
        vec each = load(both + i * LANE), other = seconds(each, each);
        each = firsts(each, each);
        store(both + i * LANE, firsts(each + other, each - other));
    }
}

/* Waves of two, [wave][cosine, sine][one, other], to those of each, [wave][cosine, sine], of which
 * the next wave lies `next` floats further on. */
static void part_waves(int count, const float *both, float *one, float *other, long next) {
    for (int wave = 0; wave < count; wave++) {
        vec cosine = load(both + 2 * wave * LANE), sine = load(both + (2 * wave + 1) * LANE);
        store(one + wave * next, firsts(cosine, sine));
        store(other + wave * next, seconds(cosine, sine));
    }
}

/* The transpose. */
static void join_waves(int count, const float *one, const float *other, long next, float *both) {
    for (int wave = 0; wave < count; wave++) {
        vec a = load(one + wave * next), b = load(other + wave * next);
        store(both + 2 * wave * LANE, firsts(a, b));
        store(both + (2 * wave + 1) * LANE, seconds(a, b));
    }
}

/* Memory for two rows side by side, their waves, and the waves of all rows: of sums, of differences. */
typedef struct {
    float *row, *waves, *spectra[2];
} Pairs;

static Pairs pairs(const Probes *probes) {
    long size = (long)probes->waves * half_of(probes->rows) * LANE;
    long row = 2L * probes->rows * LANE;
    float *at = scratch(MIRRORED, row + 2L * probes->waves * LANE);
    float *spectra = scratch(SPECTRUM, 2 * size);
    return (Pairs){at, at + row, {spectra, spectra + size}};
}

/* A probe's rings, the mirrored ones side by side, and memory for them. */
typedef struct {
    int count, all, some, waves; /* views of a ring, rings, their first half, waves of a ring */
    long ring_size, view_size;   /* floats of two mirrored rings' waves, and of a ring's views */
    float *rings, *both, *filtered, *less; /* waves; views; of one wave, sums and differences */
} Ringed;

static Ringed ringed(const Probes *probes, int source) {
    int all = probes->rings[source], some = half_of(all), waves = probes->own_waves[source];
    long ring_size = 2L * waves * LANE, view_size = (long)probes->counts[source] * LANE;
    float *filtered = scratch(FILTERED, 2L * some * LANE);
    return (Ringed){probes->counts[source], all, some, waves, ring_size, view_size,
                    scratch(RINGS, some * ring_size), scratch(LAID_VIEWS, view_size),
                    filtered, filtered + some * LANE};
}

/* Whether a ring mirrors itself. */
static inline int is_middle(int ring, const Ringed *of) { return 2 * ring == of->all - 1; }

/* The sum and the difference; of a middle ring, which is alone, itself and nothing. */
static inline void sum_and_difference(vec a, vec b, int alone, vec *plus, vec *minus) {
    *plus = a, *minus = splat(0.0f);
    if (!alone) *plus = a + b, *minus = a - b;
}

/* `probe_lanes` of images of which a HALF of the lanes counts. */
void probe_few(const Probes *probes, const float *images, float *views) {
    int rows = probes->rows, half = half_of(rows);
    Pairs own = pairs(probes);
    for (int row = 0; row < half; row++) {
        const float *one = images + 2L * rows * LANE * row;
        const float *other = images + 2L * rows * LANE * (rows - 1 - row);
        join(2 * rows, one, other, own.row);
        exchange(2 * rows, one == other, own.row);
        analyse(2 * rows, probes->waves, LANE, of_rows(probes), own.row, own.waves, 2 * LANE);
        part_waves(probes->waves, own.waves, own.spectra[0] + (long)row * LANE,
                   own.spectra[1] + (long)row * LANE, (long)half * LANE);
    }
    for (int source = 0; source < probes->sources; source++) {
        Ringed of = ringed(probes, source);
        for (int wave = 0; wave < of.waves; wave++) {
            for (int minus = 0; minus < 2; minus++)
                product(of.some, LANE, half, filter_of(probes, source, wave, minus), half, 1,
                        own.spectra[minus] + (long)wave * half * LANE, LANE,
                        minus ? of.less : of.filtered, LANE, 0);
            for (int ring = 0; ring < of.some; ring++) {
                vec a = load(of.filtered + ring * LANE), b = load(of.less + ring * LANE);
                vec plus, minus;
                sum_and_difference(a, b, is_middle(ring, &of), &plus, &minus);
                float *to = of.rings + ring * of.ring_size + 2L * wave * LANE;
                store(to, firsts(plus, minus));
                store(to + LANE, seconds(plus, minus));
            }
        }
        for (int ring = 0; ring < of.some; ring++) {
            synthesise(of.count, of.waves, LANE, of_rings(probes, source),
                       of.rings + ring * of.ring_size, 2 * LANE, of.both);
            part(of.count, of.both, views + ring * of.view_size,
                 views + (of.all - 1 - ring) * of.view_size);
        }
        views += of.all * of.view_size;
    }
}

/* probes.pull: views [view][lane], images [row][column][lane]; a HALF of the lanes counts. */
void pull_few(const Probes *probes, const float *views, float *images) {
    int rows = probes->rows, half = half_of(rows);
    Pairs own = pairs(probes);
    clear(2L * probes->waves * half * LANE, own.spectra[0]);
    for (int source = 0; source < probes->sources; source++) {
        Ringed of = ringed(probes, source);
        for (int ring = 0; ring < of.some; ring++) {
            join(of.count, views + ring * of.view_size,
                 views + (of.all - 1 - ring) * of.view_size, of.both);
            analyse(of.count, of.waves, LANE, of_rings(probes, source), of.both,
                    of.rings + ring * of.ring_size, 2 * LANE);
        }
        for (int wave = 0; wave < of.waves; wave++) {
            for (int ring = 0; ring < of.some; ring++) {
                const float *from = of.rings + ring * of.ring_size + 2L * wave * LANE;
                vec cosine = load(from), sine = load(from + LANE);
                vec a = firsts(cosine, sine), b = seconds(cosine, sine);
                vec plus, minus;
                sum_and_difference(a, b, is_middle(ring, &of), &plus, &minus);
                store(of.filtered + ring * LANE, plus);
                store(of.less + ring * LANE, minus);
            }
            for (int minus = 0; minus < 2; minus++)
                product(half, LANE, of.some, filter_of(probes, source, wave, minus), 1, half,
                        minus ? of.less : of.filtered, LANE,
                        own.spectra[minus] + (long)wave * half * LANE, LANE, 1);
        }
        views += of.all * of.view_size;
    }
    for (int row = 0; row < half; row++) {
        float *one = images + 2L * rows * LANE * row;
        float *other = images + 2L * rows * LANE * (rows - 1 - row);
        join_waves(probes->waves, own.spectra[0] + (long)row * LANE,
                   own.spectra[1] + (long)row * LANE, (long)half * LANE, own.waves);
        synthesise(2 * rows, probes->waves, LANE, of_rows(probes), own.waves, 2 * LANE, own.row);
        exchange(2 * rows, one == other, own.row);
        part(2 * rows, own.row, one, other);
    }
}

/* probes.probe of images [count][row][column]: views [count][D]. */
API void asglight_probe(int64_t count, const Probes *probes, const float *images, float *views) {
    int64_t cells = 2 * probes->rows * probes->rows;
    int lanes = (count + LANE - 1) / LANE * LANE;
    float *laid = scratch(LAID, cells * lanes), *seen = scratch(SEEN, probes->views * lanes);
    for (int64_t p = 0; p < cells; p++)
        for (int l = 0; l < lanes; l++) laid[p * lanes + l] = l < count ? images[l * cells + p] : 0;
    if (count <= HALF)
        probe_few(probes, laid, seen);
    else
        probe_lanes(probes, lanes, laid, seen);
    for (int64_t l = 0; l < count; l++)
        for (int64_t d = 0; d < probes->views; d++)
            views[l * probes->views + d] = seen[d * lanes + l];
}
