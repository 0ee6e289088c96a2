/* SPDX-License-Identifier: Apache-2.0
 *
 * Which intervals between slices the transfer function may show. A surface is thinner than a
 * region, so most of its regions have intervals that show nothing. Regions that show nothing at
 * all, and regions that show everything, need only their own range.
 */
#include "draw/resample/visible.h"

#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "base/minmax.h"
#include "data/volume/sample.h"
#include "draw/resample/ranges.h"

enum {
    PLANES = SAMPLES_REGION + 3, /* slices of a region, and one more at both ends */
    ROW = 8,                     /* PLANES, rounded up */
    ALL = (1 << SAMPLES_REGION) - 1
};

struct plane_range {
    float own[2], wide[2]; /* of the region's samples; of those up to one farther */
};

/* Where the samples of a region and those next to it lie: in the array of all samples, in a block,
 * or copied from several blocks. */
struct place {
    const void *samples;
    enum sp_type type;
    uint32_t origin[3]; /* of the sample that is there first */
    size_t stride[3];
};

/* Memory for a copy. */
struct copy {
    _Alignas(64) double samples[ROW * PLANES * PLANES]; /* of any type */
};

/* Sample i, from 0 to PLANES − 1, of the region. Those at the border of the volume repeat beyond
 * it. */
static uint32_t sample_at(const struct sp_samples *s, const uint32_t region[3], unsigned axis,
                          uint32_t i) {
    const uint32_t k = region[axis] * SAMPLES_REGION + i, last = s->dims[axis] - 1;
    const uint32_t at = k > 0 ? k - 1 : 0;
    return at < last ? at : last;
}

static void set_place(const struct sp_samples *s, const uint32_t region[3], struct copy *copy,
                      struct place *place) {
    *place = (struct place){
        s->voxels, s->type, { 0, 0, 0 }, { 1, s->dims[0], (size_t)s->dims[0] * s->dims[1] }
    };
    if (!s->blocks)
        return;
    uint32_t end[3]; /* past the last sample */
    bool is_one = true;
    for (unsigned a = 0; a < 3; a++) {
        place->origin[a] = sample_at(s, region, a, 0);
        end[a] = place->origin[a] + (a ? PLANES : ROW);
        is_one = is_one && place->origin[a] >> SP_BLOCK_BITS == (end[a] - 1) >> SP_BLOCK_BITS;
        end[a] = end[a] < s->dims[a] ? end[a] : s->dims[a];
    }
    const struct sp_block *block = sp_blocks_at(s->blocks, place->origin);
    if (is_one && block->samples && !block->is_constant) {
        const size_t side = SP_BLOCK_SIDE;
        *place = (struct place){ block->samples, s->type, { 0, 0, 0 }, { 1, side, side * side } };
        for (int a = 0; a < 3; a++)
            place->origin[a] = sample_at(s, region, (unsigned)a, 0) & ~(uint32_t)(side - 1);
        return;
    }
    char *to = (char *)copy->samples;
    const size_t size = sp_type_size(s->type);
    for (uint32_t z = place->origin[2]; z < end[2]; z++)
        for (uint32_t y = place->origin[1]; y < end[1]; y++) {
            const size_t row = (z - place->origin[2]) * PLANES + (y - place->origin[1]);
            sp_blocks_read(s->blocks, 0, (const uint32_t[3]){ place->origin[0], y, z },
                           end[0] - place->origin[0], to + row * ROW * size);
        }
    place->samples = copy->samples;
    place->stride[1] = ROW;
    place->stride[2] = (size_t)ROW * PLANES;
}

#define READ(type)                                                                                 \
    for (int i = 0; i < PLANES; i++)                                                               \
    row[i] = (float)((const type *)from->samples)[line + at[i]]

/* Reads a row of samples. Samples that are not finite become NaN. */
static void read_row(const struct place *from, size_t line, const size_t at[PLANES],
                     float row[ROW]) {
    switch (from->type) {
        SP_SHORT_CASES(READ)
    default:
        for (int i = 0; i < PLANES; i++) {
            float value = (float)sp_sample(from->samples, from->type, line + at[i]);
            row[i] = fabsf(value) < INFINITY ? value : NAN;
        }
    }
    row[PLANES] = NAN;
}

/* Lane by lane; NaN changes nothing. */
static void add_row(const float row[ROW], float low[ROW], float high[ROW]) {
    for (int i = 0; i < ROW; i++) {
        low[i] = row[i] < low[i] ? row[i] : low[i];
        high[i] = row[i] > high[i] ? row[i] : high[i];
    }
}

static void reduce(const float low[ROW], const float high[ROW], int first, int last, float out[2]) {
    out[0] = INFINITY;
    out[1] = -INFINITY;
    for (int i = first; i <= last; i++) {
        out[0] = low[i] < out[0] ? low[i] : out[0];
        out[1] = high[i] > out[1] ? high[i] : out[1];
    }
}

/* The ranges of the slices of a region. */
static void measure_planes(const struct sp_samples *s, unsigned slices, const uint32_t region[3],
                           struct plane_range planes[PLANES]) {
    struct copy copy;
    struct place place;
    set_place(s, region, &copy, &place);
    const unsigned axis[3] = { slices == 0 ? 1 : 0, slices == 2 ? 1 : 2, slices };
    size_t at[3][PLANES];
    for (int a = 0; a < 3; a++)
        for (uint32_t i = 0; i < PLANES; i++)
            at[a][i] =
                (sample_at(s, region, axis[a], i) - place.origin[axis[a]]) * place.stride[axis[a]];
    for (int p = 0; p < PLANES; p++) {
        float row[ROW], own[2][ROW], wide[2][ROW];
        for (int i = 0; i < ROW; i++) {
            own[0][i] = wide[0][i] = INFINITY;
            own[1][i] = wide[1][i] = -INFINITY;
        }
        for (int j = 0; j < PLANES; j++) {
            read_row(&place, at[2][p] + at[1][j], at[0], row);
            add_row(row, wide[0], wide[1]);
            if (j >= 1 && j < PLANES - 1)
                add_row(row, own[0], own[1]);
        }
        reduce(own[0], own[1], 1, PLANES - 2, planes[p].own);
        reduce(wide[0], wide[1], 0, PLANES - 1, planes[p].wide);
    }
}

typedef uint8_t bytes __attribute__((vector_size(16)));

/* Lane by lane. */
static inline bytes least_of(bytes a, bytes b) {
    bytes is_less = (bytes)(a < b);
    return (a & is_less) | (b & ~is_less);
}

/* The range of eight samples of one byte: the samples, and their complements, whose minimum is the
 * complement of the maximum. Flipping makes signed samples rise like unsigned ones. */
static inline bytes read_bytes(const uint8_t *from, uint64_t flip) {
    uint64_t x;
    memcpy(&x, from, sizeof x);
    x ^= flip;
    const uint64_t both[2] = { x, ~x };
    bytes out;
    memcpy(&out, both, sizeof out);
    return out;
}

/* The ranges of the lanes of `keep`, in lanes 0 and 8. */
static inline bytes reduce_bytes(bytes all, bytes keep) {
    all |= ~keep;
    all = least_of(all, __builtin_shufflevector(all, all, 4, 5, 6, 7, 0, 1, 2, 3, 12, 13, 14, 15, 8,
                                                9, 10, 11));
    all = least_of(all, __builtin_shufflevector(all, all, 2, 3, 0, 1, 6, 7, 4, 5, 10, 11, 8, 9, 14,
                                                15, 12, 13));
    return least_of(all, __builtin_shufflevector(all, all, 1, 0, 3, 2, 5, 4, 7, 6, 9, 8, 11, 10, 13,
                                                 12, 15, 14));
}

static void write_range(const struct sp_samples *s, bytes range, int lane, float out[2]) {
    uint8_t low = range[lane], high = (uint8_t)~range[8 + lane];
    bool is_signed = s->type == SP_INT8;
    out[0] = is_signed ? (float)(low - 128) : (float)low;
    out[1] = is_signed ? (float)(high - 128) : (float)high;
}

/* measure_planes() for samples of one byte, of regions that have eight samples along the first axis
 * from the one before them on. */
static void measure_planes_of_bytes(const struct sp_samples *s, unsigned slices,
                                    const uint32_t region[3], struct plane_range planes[PLANES]) {
    const bytes own = { 0, 255, 255, 255, 255, 255, 0, 0, 0, 255, 255, 255, 255, 255, 0, 0 };
    const bytes wide = {
        255, 255, 255, 255, 255, 255, 255, 0, 255, 255, 255, 255, 255, 255, 255, 0
    };
    const uint64_t flip = s->type == SP_INT8 ? UINT64_C(0x8080808080808080) : 0;
    const uint8_t *lines[PLANES][PLANES]; /* plane (slices 0: z), line of it */
    struct copy copy;
    struct place place;
    set_place(s, region, &copy, &place);
    for (uint32_t k = 0; k < PLANES; k++)
        for (uint32_t j = 0; j < PLANES; j++) {
            const uint32_t at[3] = { region[0] * SAMPLES_REGION - 1,
                                     sample_at(s, region, 1, slices == 1 ? k : j),
                                     sample_at(s, region, 2, slices == 1 ? j : k) };
            size_t line = 0;
            for (int a = 0; a < 3; a++)
                line += (at[a] - place.origin[a]) * place.stride[a];
            lines[k][j] = (const uint8_t *)place.samples + line;
        }
    bytes all[2];
    memset(all, 255, sizeof all);
    for (int k = 0; k < PLANES; k++) {
        if (slices > 0)
            memset(all, 255, sizeof all);
        bool is_inner = slices > 0 || (k >= 1 && k < PLANES - 1);
        for (int j = 0; j < PLANES; j++) {
            bytes line = read_bytes(lines[k][j], flip);
            all[1] = least_of(all[1], line);
            if (is_inner && j >= 1 && j < PLANES - 1)
                all[0] = least_of(all[0], line);
        }
        if (slices > 0) {
            write_range(s, reduce_bytes(all[0], own), 0, planes[k].own);
            write_range(s, reduce_bytes(all[1], wide), 0, planes[k].wide);
        }
    }
    for (int k = 0; slices == 0 && k < PLANES; k++) {
        write_range(s, all[0], k, planes[k].own);
        write_range(s, all[1], k, planes[k].wide);
    }
}

/* True if measure_planes_of_bytes() can read the region. */
static bool has_bytes(const struct sp_samples *s, const uint32_t region[3]) {
    return sp_type_size(s->type) == 1 && region[0] > 0 &&
           region[0] * SAMPLES_REGION + ROW - 1 <= s->dims[0];
}

static unsigned mark_intervals(const struct sp_samples *s, const struct sp_samples_class *class,
                               const uint32_t region[3]) {
    struct plane_range planes[PLANES];
    unsigned visible = 0;
    if (has_bytes(s, region))
        measure_planes_of_bytes(s, class->axis, region, planes);
    else
        measure_planes(s, class->axis, region, planes);
    for (int k = 0; k < SAMPLES_REGION; k++) {
        float own[2], wide[2] = { INFINITY, -INFINITY }, range[2];
        own[0] = sp_minf(planes[k + 1].own[0], planes[k + 2].own[0]);
        own[1] = sp_maxf(planes[k + 1].own[1], planes[k + 2].own[1]);
        for (int p = k; p < k + 4; p++) {
            wide[0] = sp_minf(wide[0], planes[p].wide[0]);
            wide[1] = sp_maxf(wide[1], planes[p].wide[1]);
        }
        sp_ranges_widen(own, wide, range);
        if (sp_curve_shows(&class->tf, (double)range[0], (double)range[1]))
            visible |= 1u << k;
    }
    return visible;
}

struct search {
    const struct sp_samples *samples;
    double first, last; /* only values above and below them, respectively, may be visible */
    struct sp_samples_class *class;
    const struct sp_interrupt *interrupt;
    _Atomic uint64_t visible_count;
};

static void compute_ends(const struct sp_transfer_function *tf, struct search *search) {
    uint32_t first = 0, end = tf->point_count;
    while (first < end && !(tf->points[first].opacity > 0))
        first++;
    while (end > first && !(tf->points[end - 1].opacity > 0))
        end--;
    search->first = first > 0 ? tf->points[first - 1].value : -INFINITY;
    search->last = end < tf->point_count ? tf->points[end].value : INFINITY;
}

static unsigned mark_region(const struct search *search, const uint32_t region[3]) {
    const struct sp_samples *s = search->samples;
    const struct sp_samples_class *class = search->class;
    size_t at = ((size_t)region[2] * s->regions[1] + region[1]) * s->regions[0] + region[0];
    double low = (double)s->range[at][0], high = (double)s->range[at][1];
    if (!(high > search->first && low < search->last) || !sp_curve_shows(&class->tf, low, high))
        return 0;
    /* Planes are read as floats, which do not hold every value of the larger types. */
    bool is_rounded = s->type == SP_INT32 || s->type == SP_FLOAT64;
    if (is_rounded || !isfinite(low) || !isfinite(high) ||
        sp_curve_shows_all(&class->tf, low, high))
        return ALL;
    return mark_intervals(s, class, region);
}

static void mark_rows(void *user, size_t begin, size_t end, unsigned worker) {
    struct search *search = user;
    const struct sp_samples *s = search->samples;
    uint64_t count = 0;
    (void)worker;
    for (size_t i = begin; i < end && !sp_interrupt_is_cancelled(search->interrupt); i++)
        for (uint32_t x = 0; x < s->regions[0]; x++) {
            const uint32_t region[3] = { x, (uint32_t)(i % s->regions[1]),
                                         (uint32_t)(i / s->regions[1]) };
            unsigned visible = mark_region(search, region);
            search->class->visible[i * s->regions[0] + x] = (uint8_t)visible;
            count += visible != 0;
        }
    atomic_fetch_add(&search->visible_count, count);
}

bool sp_samples_mark_visible(const struct sp_samples *samples, struct sp_samples_class *class,
                             struct sp_pool *pool, const struct sp_interrupt *interrupt) {
    struct search search = { .samples = samples, .class = class, .interrupt = interrupt };
    compute_ends(&class->tf, &search);
    sp_parallel_for(pool, (size_t)samples->regions[1] * samples->regions[2], 8, mark_rows, &search);
    class->visible_count = atomic_load(&search.visible_count);
    return !sp_interrupt_is_cancelled(interrupt);
}
