/* SPDX-License-Identifier: Apache-2.0
 *
 * The shells that a backend caches, by volume, transfer function and thresholds. A new one replaces
 * the least recently used one. An edit of the thresholds or of the transfer function updates the
 * newest shell of the volume; the time depends on the size of the change. If a view clips, the
 * clipped shell is cached beside the whole one.
 */
#ifndef SP_SHELL_CACHE_H
#define SP_SHELL_CACHE_H

#include "data/volume/slots.h"
#include "draw/layers/shell/extract.h"

enum { SP_SHELL_SLOTS = 4 };

struct sp_shell_cache {
    struct sp_shell_slot {
        struct sp_slot base;
        struct sp_transfer transfer;
        double low, high;
        struct sp_shell_masks masks;
        struct sp_voxel_list list;
        struct sp_voxel_list clipped; /* `list` after clipping; no list = not made */
        struct sp_clip clip;          /* of `clipped` */
        uint32_t repeats;             /* successive uses without a change */
    } slots[SP_SHELL_SLOTS];
    uint64_t clock;
};

struct sp_shell_job {
    struct sp_volume *volume;
    const struct sp_transfer_function *tf;
    double low, high; /* as in struct sp_layer */
    const struct sp_clip *clip;
    uint64_t bytes_max; /* of the cache */
    struct sp_pool *pool;
    struct sp_interrupt interrupt;
};

/* Returns the shell. It belongs to the cache and is valid until the next call. NULL with *err set:
 * SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED. */
const struct sp_voxel_list *sp_shell_cache_get(struct sp_shell_cache *cache,
                                               const struct sp_shell_job *job,
                                               struct sp_error *err);

/* Evict the cached data of the volume, or return its bytes; NULL = of all volumes. */
void sp_shell_evict(struct sp_shell_cache *cache, const struct sp_volume *volume);
uint64_t sp_shell_bytes(const struct sp_shell_cache *cache, const struct sp_volume *volume);

#endif
