/* SPDX-License-Identifier: Apache-2.0
 *
 * The brick cache (--cache): brick files of volumes that do not fit into --memory. A file is
 * written when its volume is loaded for the first time, and read again later. Its name is a hash of
 * the source, and of the time and size of the source's file, so that a file that changes is
 * converted again. The daemon removes no files of the folder.
 */
#ifndef SRV_RENDER_BRICK_CACHE_H
#define SRV_RENDER_BRICK_CACHE_H

#include "sp/volume.h"

/* Loads a source as a brick file. Converts it first if the folder has none: the first nine tenths
 * of the progress. The place of errors is the source. */
struct sp_volume *srv_brick_cache_load(const char *folder, const char *source,
                                       const struct sp_load_options *options, struct sp_error *err);

#endif
