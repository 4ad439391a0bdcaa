/* SPDX-License-Identifier: Apache-2.0
 *
 * What materials show of images: asglight/fitting/probes.py, on images [row][column][lane].
 *
 * A cosine is even and a sine odd about the middle of a row, so a row is folded there first: half
 * of the products.
 */
#include "steps.h"

enum { FOLDED, SPECTRUM };

static long spectrum_size(const Probes *probes, int lanes) {
    return probes->waves * probes->rows * 2 * lanes;
}

/* even[j] = x[j] + x[n - j] and odd[j] = x[j] - x[n - j], j from 0 to half of n; where the two are
 * one and the same, it counts once. */
static void fold(int count, int lanes, const float *from, float *even, float *odd) {
    for (int j = 0; j <= count / 2; j++) {
        const float *one = from + (long)j * lanes, *other = from + (long)((count - j) % count) * lanes;
        for (int l = 0; l < lanes; l += LANE) {
            vec a = load(one + l), b = one == other ? splat(0.0f) : load(other + l);
            store(even + (long)j * lanes + l, a + b);
            store(odd + (long)j * lanes + l, a - b);
        }
    }
}

/* The transpose: x[j] = even[j] + odd[j], x[n - j] = even[j] - odd[j]. */
static void unfold(int count, int lanes, const float *even, const float *odd, float *to) {
    for (int j = 0; j <= count / 2; j++) {
        float *one = to + (long)j * lanes, *other = to + (long)((count - j) % count) * lanes;
        for (int l = 0; l < lanes; l += LANE) {
            vec a = load(even + (long)j * lanes + l), b = load(odd + (long)j * lanes + l);
            if (one != other) store(other + l, a - b);
            store(one + l, a + b);
        }
    }
}

/* Images [row][column][lane] to what the filters show, source by source
 * [ring][own wave][cosine, sine][lane]. */
void probe_rings(const Probes *probes, int lanes, const float *images, float *rings) {
    int rows = probes->rows, waves = probes->waves, half = rows + 1, wide = 2 * lanes;
    float *even = scratch(FOLDED, 2L * half * lanes), *odd = even + (long)half * lanes;
    float *spectrum = scratch(SPECTRUM, spectrum_size(probes, lanes)); /* [wave][row][2][lane] */
    for (int row = 0; row < rows; row++) {
        fold(2 * rows, lanes, images + 2L * rows * row * lanes, even, odd);
        float *to = spectrum + (long)row * wide;
        long next = (long)rows * wide;
        product(waves, lanes, half, probes->cosine, half, 1, even, lanes, to, next, 0);
        product(waves, lanes, half, probes->sine, half, 1, odd, lanes, to + lanes, next, 0);
    }
    for (int source = 0; source < probes->sources; source++) {
        int own = probes->own_waves[source], count = probes->rings[source];
        for (int wave = 0; wave < own; wave++)
            product(count, wide, rows, probes->filter[source] + (long)wave * count * rows, rows, 1,
                    spectrum + (long)wave * rows * wide, wide, rings + (long)wave * wide,
                    (long)own * wide, 0);
        rings += (long)count * own * wide;
    }
}

/* One ring of `probe_rings` to its views [view][lane]. */
void probe_ring(const Probes *probes, int source, int ring, int lanes, const float *rings,
                float *views) {
    int own = probes->own_waves[source], count = probes->counts[source], wide = 2 * lanes;
    int half = count / 2 + 1;
    const float *from = rings + (long)ring * own * wide;
    float *even = scratch(FOLDED, 2L * half * lanes), *odd = even + (long)half * lanes;
    product(half, lanes, own, probes->view_cosine[source], own, 1, from, wide, even, lanes, 0);
    product(half, lanes, own, probes->view_sine[source], own, 1, from + lanes, wide, odd, lanes, 0);
    unfold(count, lanes, even, odd, views);
}

long rings_size(const Probes *probes, int lanes) {
    long total = 0;
    for (int source = 0; source < probes->sources; source++)
        total += probes->rings[source] * probes->own_waves[source] * 2 * lanes;
    return total;
}

enum { RINGS = 2 };

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

/* probes.pull: views [view][lane], images [row][column][lane]. */
void pull_lanes(const Probes *probes, int lanes, const float *views, float *images) {
    int rows = probes->rows, waves = probes->waves, half = rows + 1, wide = 2 * lanes;
    float *even = scratch(FOLDED, 2L * half * lanes), *odd = even + (long)half * lanes;
    float *spectrum = scratch(SPECTRUM, spectrum_size(probes, lanes));
    float *rings = scratch(RINGS, rings_size(probes, lanes));
    for (long i = 0; i < spectrum_size(probes, lanes); i += LANE) store(spectrum + i, splat(0.0f));
    for (int source = 0; source < probes->sources; source++) {
        int own = probes->own_waves[source], count = probes->rings[source];
        int seen = probes->counts[source], views_half = seen / 2 + 1;
        for (int ring = 0; ring < count; ring++) {
            float *to = rings + (long)ring * own * wide;
            fold(seen, lanes, views, even, odd);
            product(own, lanes, views_half, probes->view_cosine[source], 1, own, even, lanes, to,
                    wide, 0);
            product(own, lanes, views_half, probes->view_sine[source], 1, own, odd, lanes,
                    to + lanes, wide, 0);
            views += (long)seen * lanes;
        }
        for (int wave = 0; wave < own; wave++)
            product(rows, wide, count, probes->filter[source] + (long)wave * count * rows, 1, rows,
                    rings + (long)wave * wide, (long)own * wide,
                    spectrum + (long)wave * rows * wide, wide, 1);
    }
    for (int row = 0; row < rows; row++) {
        const float *from = spectrum + (long)row * wide;
        long next = (long)rows * wide;
        product(half, lanes, waves, probes->cosine, 1, half, from, next, even, lanes, 0);
        product(half, lanes, waves, probes->sine, 1, half, from + lanes, next, odd, lanes, 0);
        unfold(2 * rows, lanes, even, odd, images + 2L * rows * row * lanes);
    }
}

/* probes.probe of images [count][row][column]: views [count][D]. */
API void asglight_probe(int64_t count, const Probes *probes, const float *images, float *views) {
    enum { LAID = 3, SEEN = 4 };
    int64_t cells = 2 * probes->rows * probes->rows;
    int lanes = (count + LANE - 1) / LANE * LANE;
    float *laid = scratch(LAID, cells * lanes), *seen = scratch(SEEN, probes->views * lanes);
    for (int64_t p = 0; p < cells; p++)
        for (int l = 0; l < lanes; l++) laid[p * lanes + l] = l < count ? images[l * cells + p] : 0;
    probe_lanes(probes, lanes, laid, seen);
    for (int64_t l = 0; l < count; l++)
        for (int64_t d = 0; d < probes->views; d++)
            views[l * probes->views + d] = seen[d * lanes + l];
}
