/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/resample/levels.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classify/transfer.h"
#include "data/volume/majority.h"
#include "data/volume/missing.h"
#include "data/volume/sample.h"
#include "data/volume/volume.h"
#include "draw/resample/curve.h"
#include "draw/resample/ranges.h"
#include "draw/resample/visible.h"

static uint64_t region_count(const struct sp_samples *s) {
    return (uint64_t)s->regions[0] * s->regions[1] * s->regions[2];
}

static uint64_t sample_count(const uint32_t dims[3]) {
    return (uint64_t)dims[0] * dims[1] * dims[2];
}

static uint64_t class_bytes(const struct sp_samples *s) {
    return region_count(s) + CURVE_BYTES;
}

static uint64_t samples_bytes(const struct sp_samples *s) {
    uint64_t own =
        sample_count(s->dims) * sp_type_size(s->type) * ((s->owned ? 1 : 0) + (s->turned ? 1 : 0));
    if (s->range)
        own += region_count(s) * sizeof s->range[0];
    for (int i = 0; i < SAMPLES_CLASSES; i++)
        own += s->classes[i].visible ? class_bytes(s) : 0;
    return own;
}

static void finish_class(struct sp_samples_class *class) {
    free(class->visible);
    free(class->curve.integral);
    *class = (struct sp_samples_class){ 0 };
}

static void finish_samples(struct sp_samples *s) {
    free(s->owned);
    free(s->turned);
    free(s->range);
    for (int i = 0; i < SAMPLES_CLASSES; i++)
        finish_class(&s->classes[i]);
    *s = (struct sp_samples){ 0 };
}

static void finish_slot(void *pointer) {
    struct sp_samples_slot *slot = pointer;
    for (int l = 0; l < SAMPLES_KINDS * SAMPLES_LEVELS; l++)
        finish_samples(&slot->levels[0][0] + l);
}

static uint64_t slot_bytes(const void *pointer) {
    const struct sp_samples_slot *slot = pointer;
    uint64_t bytes = 0;
    for (int l = 0; l < SAMPLES_KINDS * SAMPLES_LEVELS; l++)
        bytes += samples_bytes(&slot->levels[0][0] + l);
    return bytes;
}

static const struct sp_slots slots = { SAMPLES_SLOTS, sizeof(struct sp_samples_slot), finish_slot,
                                       slot_bytes };

void sp_samples_evict(struct sp_samples_cache *cache, const struct sp_volume *volume) {
    sp_slots_evict(&slots, cache->slots, volume);
}

uint64_t sp_samples_bytes(const struct sp_samples_cache *cache, const struct sp_volume *volume) {
    return sp_slots_bytes(&slots, cache->slots, volume);
}

/* Returns the slot of the volume; a new one takes the place of the least recently used. */
static struct sp_samples_slot *get_slot(struct sp_samples_cache *cache, struct sp_volume *volume) {
    struct sp_samples_slot *slot = sp_slots_newest(&slots, cache->slots, volume);
    if (!slot) {
        slot = sp_slots_acquire(&slots, cache->slots, UINT64_MAX, NULL);
        slot->base.volume = sp_volume_ref(volume);
    }
    slot->base.used = ++cache->clock;
    return slot;
}

void sp_samples_begin(struct sp_samples_cache *cache) {
    cache->begun = cache->clock;
}

/* Evicts volumes that this frame does not use, least recently used first, until `bytes` more fit.
 * False, and evicts nothing, if they never do. */
static bool free_memory(struct sp_samples_cache *cache, uint64_t bytes, uint64_t bytes_max) {
    uint64_t need = bytes;
    for (int i = 0; i < SAMPLES_SLOTS; i++)
        need += cache->slots[i].base.used > cache->begun ? slot_bytes(&cache->slots[i]) : 0;
    if (need > bytes_max)
        return false;
    sp_slots_trim(&slots, cache->slots, bytes_max - bytes, cache->begun, NULL);
    return true;
}

static bool fail_memory(struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the volume's mip levels");
}

static bool fail_budget(uint64_t bytes, uint64_t bytes_max, struct sp_error *err) {
    return sp_fail(err, SP_ERR_BUDGET, "",
                   "the volume's mip levels need %llu bytes more than the %llu that may be used",
                   (unsigned long long)bytes, (unsigned long long)bytes_max);
}

struct average {
    enum sp_samples_kind kind;
    bool are_labels;
    const struct sp_samples *fine;
    struct sp_samples *coarse;
    const struct sp_interrupt *interrupt;
};

static double sample_at(const struct sp_samples *s, uint32_t x, uint32_t y, uint32_t z) {
    double copy; /* memory for a sample of any type */
    if (!s->blocks)
        return sp_sample(s->voxels, s->type, ((uint64_t)z * s->dims[1] + y) * s->dims[0] + x);
    sp_blocks_read(s->blocks, 0, (const uint32_t[3]){ x, y, z }, 1, &copy);
    return sp_sample(&copy, s->type, 0);
}

/* Mean, maximum or minimum of the finite samples among the eight that sample (x, y, z) replaces, of
 * labels the most frequent one; NaN without any. */
static double average(const struct average *a, uint32_t x, uint32_t y, uint32_t z) {
    const struct sp_samples *fine = a->fine;
    const enum sp_samples_kind kind = a->kind;
    double sum = 0, values[8];
    int n = 0;
    for (uint32_t k = 0; k < 8; k++) {
        uint32_t i = 2 * x + (k & 1), j = 2 * y + (k >> 1 & 1), l = 2 * z + (k >> 2);
        if (i >= fine->dims[0] || j >= fine->dims[1] || l >= fine->dims[2])
            continue;
        double value = sample_at(fine, i, j, l);
        if (!isfinite(value))
            continue;
        if (kind == SAMPLES_MEANS)
            sum += value;
        else if (n == 0 || (kind == SAMPLES_MAXIMA ? value > sum : value < sum))
            sum = value;
        values[n++] = value;
    }
    if (n > 0 && a->are_labels && kind == SAMPLES_MEANS)
        return sp_majority(values, n);
    return n == 0 ? NAN : kind == SAMPLES_MEANS ? sum / n : sum;
}

static void average_rows(void *user, size_t begin, size_t end, unsigned worker) {
    const struct average *a = user;
    const uint32_t *dims = a->coarse->dims;
    const bool is_real = a->coarse->type == SP_FLOAT32 || a->coarse->type == SP_FLOAT64;
    (void)worker;
    for (size_t row = begin; row < end && !sp_interrupt_is_cancelled(a->interrupt); row++)
        for (uint32_t x = 0; x < dims[0]; x++) {
            const double mean = average(a, x, (uint32_t)(row % dims[1]), (uint32_t)(row / dims[1]));
            sp_sample_set(a->coarse->owned, a->coarse->type, (uint64_t)row * dims[0] + x,
                          is_real ? mean : rint(mean));
        }
}

/* Fills an empty level from the next finer one; fine NULL = from the volume. */
static bool make_samples(struct sp_samples *s, const struct sp_samples *fine,
                         const struct sp_samples_job *job, struct sp_samples_cache *cache,
                         struct sp_error *err) {
    const struct sp_volume_info *info = sp_volume_info(job->volume);
    struct sp_samples made = { .type = info->type };
    made.blocks = fine ? NULL : sp_volume_blocks(job->volume);
    made.voxels = fine || made.blocks ? NULL : sp_volume_voxels(job->volume);
    for (int a = 0; a < 3; a++) {
        made.dims[a] = fine ? (fine->dims[a] + 1) / 2 : info->grid.dims[a];
        made.regions[a] = made.dims[a] < 2 ? 1 : (made.dims[a] - 2) / SAMPLES_REGION + 1;
    }
    uint64_t voxels = sample_count(made.dims) * sp_type_size(made.type);
    uint64_t count = region_count(&made);
    uint64_t bytes = (fine ? voxels : 0) + count * sizeof made.range[0];
    if (!free_memory(cache, bytes, job->bytes_max))
        return fail_budget(bytes, job->bytes_max, err);
    made.range = malloc(count * sizeof made.range[0]);
    made.owned = fine ? malloc(voxels) : NULL;
    if (!made.range || (fine && !made.owned)) {
        finish_samples(&made);
        return fail_memory(err);
    }
    if (fine) {
        struct average average = { job->kind, info->meaning == SP_MEANING_LABELS, fine, &made,
                                   &job->interrupt };
        made.voxels = made.owned;
        sp_parallel_for(job->pool, (size_t)made.dims[1] * made.dims[2], 16, average_rows, &average);
    }
    sp_ranges_compute_fn *compute = job->compute_ranges ? job->compute_ranges : sp_ranges_compute;
    compute(&made, job->pool, &job->interrupt);
    if (sp_interrupt_is_cancelled(&job->interrupt)) {
        finish_samples(&made);
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    }
    *s = made;
    s->made = ++cache->clock;
    return true;
}

#define TURN(type)                                                                                 \
    for (size_t x = at[0]; x < to[0]; x++)                                                         \
        for (size_t y = at[1]; y < to[1]; y++)                                                     \
    ((type *)s->turned)[y + (z + x * dims[2]) * dims[1]] =                                         \
        ((const type *)s->voxels)[x + (y + z * dims[1]) * dims[0]]

typedef uint8_t byte_row __attribute__((vector_size(16)));

/* Turns 16 × 16 bytes. Each round joins rows i and i + 8 byte by byte. */
static void turn_bytes(const uint8_t *from, size_t from_step, uint8_t *to, size_t to_step) {
    byte_row rows[16], next[16];
    for (size_t i = 0; i < 16; i++)
        memcpy(&rows[i], from + i * from_step, sizeof rows[i]);
    for (int round = 0; round < 4; round++) {
        for (int i = 0; i < 8; i++) {
            byte_row a = rows[i], b = rows[i + 8];
            next[2 * i] = __builtin_shufflevector(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6,
                                                  22, 7, 23);
            next[2 * i + 1] = __builtin_shufflevector(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28,
                                                      13, 29, 14, 30, 15, 31);
        }
        memcpy(rows, next, sizeof rows);
    }
    for (size_t i = 0; i < 16; i++)
        memcpy(to + i * to_step, &rows[i], sizeof rows[i]);
}

struct turning {
    struct sp_samples *samples;
    const struct sp_interrupt *interrupt;
};

/* Turns a part of slice z, [at, to) along the first two axes. */
static void turn_square(const struct sp_samples *s, size_t z, const size_t at[2],
                        const size_t to[2]) {
    const size_t dims[3] = { s->dims[0], s->dims[1], s->dims[2] };
    switch (sp_type_size(s->type)) {
    case 1:
        TURN(uint8_t);
        break;
    case 2:
        TURN(uint16_t);
        break;
    case 4:
        TURN(uint32_t);
        break;
    default:
        TURN(uint64_t);
    }
}

/* Turns slices of samples, in squares that fit the cache. */
static void turn_slices(void *user, size_t begin, size_t end, unsigned worker) {
    const struct turning *turning = user;
    const struct sp_samples *s = turning->samples;
    const size_t dims[3] = { s->dims[0], s->dims[1], s->dims[2] };
    bool has_bytes = sp_type_size(s->type) == 1;
    const size_t side = has_bytes ? 16 : 64;
    size_t at[2], to[2];
    (void)worker;
    for (size_t z = begin; z < end && !sp_interrupt_is_cancelled(turning->interrupt); z++)
        for (at[0] = 0; at[0] < dims[0]; at[0] += side)
            for (at[1] = 0; at[1] < dims[1]; at[1] += side) {
                for (int a = 0; a < 2; a++)
                    to[a] = at[a] + side < dims[a] ? at[a] + side : dims[a];
                if (has_bytes && to[0] - at[0] == side && to[1] - at[1] == side)
                    turn_bytes((const uint8_t *)s->voxels + at[0] + (at[1] + z * dims[1]) * dims[0],
                               dims[0],
                               (uint8_t *)s->turned + at[1] + (z + at[0] * dims[2]) * dims[1],
                               dims[1] * dims[2]);
                else
                    turn_square(s, z, at, to);
            }
}

/* Without memory for it, frames read the samples as they are, which takes longer. */
static void turn(struct sp_samples *s, const struct sp_samples_job *job,
                 const struct sp_samples_cache *cache) {
    uint64_t bytes = sample_count(s->dims) * sp_type_size(s->type);
    bool fits = sp_samples_bytes(cache, NULL) + bytes <= job->bytes_max;
    s->turned = fits ? malloc(bytes) : NULL;
    if (!s->turned)
        return;
    struct turning turning = { s, &job->interrupt };
    sp_parallel_for(job->pool, s->dims[2], 1, turn_slices, &turning);
    if (sp_interrupt_is_cancelled(&job->interrupt)) {
        free(s->turned);
        s->turned = NULL;
    }
}

/* Returns the class for the job; a new one takes the place of the least recently used. */
static struct sp_samples_class *get_class(struct sp_samples *s, const struct sp_samples_job *job) {
    struct sp_samples_class *oldest = &s->classes[0];
    for (int i = 0; i < SAMPLES_CLASSES; i++) {
        struct sp_samples_class *class = &s->classes[i];
        if (class->used && class->axis == job->axis &&
            sp_transfer_function_equal(&class->tf, job->tf))
            return class;
        if (class->used < oldest->used)
            oldest = class;
    }
    oldest->used = 0;
    return oldest;
}

static bool fill_class(struct sp_samples_class *class, struct sp_samples *s,
                       const struct sp_samples_job *job, struct sp_samples_cache *cache,
                       struct sp_error *err) {
    if (!class->visible) {
        if (!free_memory(cache, class_bytes(s), job->bytes_max))
            return fail_budget(class_bytes(s), job->bytes_max, err);
        class->visible = malloc(region_count(s));
        class->curve.integral = aligned_alloc(16, CURVE_BYTES);
        if (!class->visible || !class->curve.integral) {
            finish_class(class);
            return fail_memory(err);
        }
    }
    class->tf = *job->tf;
    class->axis = job->axis;
    class->made = ++cache->clock;
    const struct sp_volume_info *info = sp_volume_info(job->volume);
    double limits[2];
    sp_missing_limits(info, limits);
    sp_curve_init(&class->curve, &class->tf, limits, class->curve.integral, job->pool);
    if (sp_missing_are_there(info))
        memcpy(class->curve.data, info->data, sizeof info->data);
    return sp_samples_mark_visible(s, class, job->pool, &job->interrupt) ||
           sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
}

const struct sp_samples *sp_samples_get(struct sp_samples_cache *cache,
                                        const struct sp_samples_job *job,
                                        const struct sp_samples_class **class,
                                        struct sp_error *err) {
    struct sp_samples_slot *slot = get_slot(cache, job->volume);
    struct sp_samples *s = NULL, *finer = NULL;
    for (unsigned l = 0; l <= job->level; l++, finer = s) {
        s = &slot->levels[l ? job->kind : SAMPLES_MEANS][l];
        if (!s->range && !make_samples(s, finer, job, cache, err))
            return NULL;
    }
    struct sp_samples_class *found = get_class(s, job);
    if (!found->used && !fill_class(found, s, job, cache, err))
        return NULL;
    found->used = ++cache->clock;
    *class = found;
    if (job->axis == 0 && !job->keeps_layout && !s->turned && !s->blocks)
        turn(s, job, cache);
    return s;
}
