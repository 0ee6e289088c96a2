/* SPDX-License-Identifier: Apache-2.0
 *
 * A volume that is shown from its chunks: processes of splat-import keep it open, and read chunks
 * when frames need them (data/bricks/chunks.h).
 *
 *   bricks ─► reader 0 … n ══ socket, memfd of one chunk ══► splat-import ─► format->read_chunk()
 *
 * If a process crashes, hangs or sends wrong messages, only the requested chunk fails. The process
 * is started again for the next chunk.
 */
#ifndef SP_IMPORT_PYRAMID_H
#define SP_IMPORT_PYRAMID_H

#include "data/import/handover.h"
#include "data/import/place.h"

struct sp_pyramid_job { /* borrowed for the call */
    const struct sp_import_place *place;
    const char *importer;
    const struct sp_source_parts *parts; /* of the source; its vectors and level do not count */
    const struct sp_load_options *options;
    int timeout_ms;
};

/* Starts the first process. Fills the source, but not its info, and the header, which describes
 * level 0. Calls options->progress(). SP_ERR_UNSUPPORTED: the volume has no chunks, or too large
 * ones. */
bool sp_pyramid_open(const struct sp_pyramid_job *job, struct sp_handover_header *header,
                     struct sp_chunk_source *source, struct sp_error *err);

#endif
