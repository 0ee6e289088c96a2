/* SPDX-License-Identifier: Apache-2.0
 *
 * The samples that frames are drawn from: the volume, and mip levels of averaged samples, each with
 * the range of values in every region. Levels are made when a frame first needs them, and then
 * cached.
 *
 *   level n + 1, sample i  =  mean of samples 2i and 2i + 1 of level n, per axis
 *   coordinate on level n  =  (coordinate on level 0 + ½)/2ⁿ − ½
 *
 * If level n has an odd number of samples, the last sample of level n + 1 is sample 2i alone.
 * Samples that are not finite do not count. A level of labels has the most frequent label in place
 * of the mean. Maximum and minimum projections have levels of their own: the largest or the
 * smallest sample in place of the mean.
 */
#ifndef SP_RESAMPLE_LEVELS_H
#define SP_RESAMPLE_LEVELS_H

#include "data/volume/slots.h"
#include "draw/resample/mip_samples.h"
#include "draw/resample/ranges.h"

enum { SAMPLES_LEVELS = 8, SAMPLES_SLOTS = 8 };

enum sp_samples_kind { SAMPLES_MEANS, SAMPLES_MAXIMA, SAMPLES_MINIMA, SAMPLES_KINDS };

struct sp_samples_cache {
    struct sp_samples_slot {
        struct sp_slot base;
        /* All kinds share level 0 of SAMPLES_MEANS. */
        struct sp_samples levels[SAMPLES_KINDS][SAMPLES_LEVELS];
    } slots[SAMPLES_SLOTS];
    uint64_t clock, begun; /* slots used after `begun` are not replaced */
};

struct sp_samples_job {
    struct sp_volume *volume;
    unsigned level;
    enum sp_samples_kind kind; /* of the levels above 0 */
    unsigned axis; /* axis of the slices that the frame shows; for axis 0 `turned` makes reading
                      faster */
    const struct sp_transfer_function *tf;
    uint64_t bytes_max;                   /* of the cache */
    sp_ranges_compute_fn *compute_ranges; /* of an instruction set; NULL = the reference */
    bool keeps_layout;                    /* `turned` is not made */
    struct sp_pool *pool;
    struct sp_interrupt interrupt;
};

/* Begins a frame of at most SAMPLES_SLOTS volumes. The samples that the frame gets are valid until
 * the next frame begins. */
void sp_samples_begin(struct sp_samples_cache *cache);

/* Returns the samples of job->level, [0, SAMPLES_LEVELS − 1], and sets *class to their class. The
 * class is valid until the caller has asked for SAMPLES_CLASSES other classes of these samples.
 * NULL with *err set: SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
const struct sp_samples *sp_samples_get(struct sp_samples_cache *cache,
                                        const struct sp_samples_job *job,
                                        const struct sp_samples_class **class,
                                        struct sp_error *err);

/* Evict the cached data of the volume, or return its bytes; NULL = of all volumes. */
void sp_samples_evict(struct sp_samples_cache *cache, const struct sp_volume *volume);
uint64_t sp_samples_bytes(const struct sp_samples_cache *cache, const struct sp_volume *volume);

#endif
