/* SPDX-License-Identifier: Apache-2.0
 *
 * The brick cache (--cache): brick files of volumes that do not fit into --memory. A file is
 * written when its volume is loaded for the first time, and read again later. Its name is a hash of
 * the source, of its time step, and of the time and size of the source's file, or of all files of
 * its folder, so that a source is converted again after a change.
 *
 * --cache-size limits the size of all files together. When they exceed it, the least recently used
 * files are removed. Files that a daemon has open stay: their locks tell (bricks/store.h).
 */
#ifndef SRV_RENDER_BRICK_CACHE_H
#define SRV_RENDER_BRICK_CACHE_H

#include "sp/volume.h"

struct srv_brick_cache;

struct srv_brick_cache_stats {
    uint64_t files, bytes, bytes_max; /* of the folder, when it was last read */
    uint64_t conversions, removals;   /* since the start */
};

/* Creates the folder unless it is there. bytes_max: the limit; 0 = none. NULL with *err set:
 * SP_ERR_IO, SP_ERR_MEMORY. */
struct srv_brick_cache *srv_brick_cache_create(const char *folder, uint64_t bytes_max,
                                               struct sp_error *err);
/* Accepts NULL; nulls *cache. The files stay. */
void srv_brick_cache_destroy(struct srv_brick_cache **cache);

/* Loads a source as a brick file. If the folder has no brick file for it, the source is converted
 * first, which is the first nine tenths of the progress. The place of errors is the source.
 * Thread-safe. */
struct sp_volume *srv_brick_cache_load(struct srv_brick_cache *cache, const char *source,
                                       const struct sp_load_options *options, struct sp_error *err);

/* Thread-safe. */
void srv_brick_cache_stats(struct srv_brick_cache *cache, struct srv_brick_cache_stats *stats);

#endif
