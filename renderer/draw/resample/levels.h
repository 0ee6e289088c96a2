/* SPDX-License-Identifier: Apache-2.0
 *
 * The samples that frames are drawn from: the volume, and mip levels of averaged samples, each with
 * the range of values in every region. Made when a frame first needs them, then cached.
 *
 *   level n + 1, sample i  =  mean of samples 2i and 2i + 1 of level n, per axis
 *   coordinate on level n  =  (coordinate on level 0 + ½)/2ⁿ − ½
 *
 * At an odd end sample i is that of 2i alone. Samples that are not finite do not count. Of labels
 * a sample is the most frequent one in place of the mean. Maxima and
 * minima of projections have levels of their own: the largest or the smallest sample in place of
 * the mean.
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
        /* Level 0 is that of the means for all kinds. */
        struct sp_samples levels[SAMPLES_KINDS][SAMPLES_LEVELS];
    } slots[SAMPLES_SLOTS];
    uint64_t clock, begun; /* slots that were used after `begun` stay */
};

struct sp_samples_job {
    struct sp_volume *volume;
    unsigned level;
    enum sp_samples_kind kind; /* of the levels above 0 */
    unsigned axis; /* of the slices that frames show; for axis 0 `turned` makes reading faster */
    const struct sp_transfer_function *tf;
    uint64_t bytes_max;                   /* of the cache */
    sp_ranges_compute_fn *compute_ranges; /* of an instruction set; NULL = the reference */
    bool keeps_layout;                    /* `turned` is not made */
    struct sp_pool *pool;
    struct sp_interrupt interrupt;
};

/* Begins a frame of at most SAMPLES_SLOTS volumes: what it gets is valid until the next one begins.
 */
void sp_samples_begin(struct sp_samples_cache *cache);

/* Returns the samples of a level, [0, SAMPLES_LEVELS), and sets *class to their class, which is
 * valid until SAMPLES_CLASSES others of these samples were asked for. NULL with *err set:
 * SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
const struct sp_samples *sp_samples_get(struct sp_samples_cache *cache,
                                        const struct sp_samples_job *job,
                                        const struct sp_samples_class **class,
                                        struct sp_error *err);

/* Drops what is cached of the volume; NULL = of all volumes. */
void sp_samples_evict(struct sp_samples_cache *cache, const struct sp_volume *volume);
uint64_t sp_samples_bytes(const struct sp_samples_cache *cache, const struct sp_volume *volume);

#endif
