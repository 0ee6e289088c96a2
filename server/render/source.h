/* SPDX-License-Identifier: Apache-2.0
 *
 * The source of a volume: a path or "demo:…". Resolves it to the key by which the catalog knows the
 * volume, and derives an id from it.
 */
#ifndef SRV_RENDER_SOURCE_H
#define SRV_RENDER_SOURCE_H

#include <stdbool.h>

#include "sp/status.h"
#include "sp/view.h"

#define SRV_SOURCE_UPLOAD "upload:" /* before the id of an upload */
#define SRV_SOURCE_MEMORY "memory:" /* before the id of an array in shared memory; equally long */

bool srv_source_is_demo(const char *source);
bool srv_source_is_upload(const char *source);
bool srv_source_is_memory(const char *source);
/* Gets the id of the upload that a source names, without a field. False: it names no upload. */
bool srv_source_upload_id(const char *source, char id[SP_NAME_BYTES]);

/* Returns the key of a source, malloc'ed: the real path, or the demo's text. Of a path with a '*'
 * in its name, which is a time series (sp_volume_load()), the folder is resolved. A confined source
 * has a `pointer`, the place of its errors (a JSON pointer), and a path must lie below `data`, a
 * resolved folder (NULL = none). pointer NULL = a path that the operator gave. NULL with *err set:
 * SP_ERR_INVALID, SP_ERR_DENIED (no data folder), SP_ERR_NOT_FOUND, SP_ERR_MEMORY, or what
 * sp_demo_check() returns. */
char *srv_source_resolve(const char *source, const char *pointer, const char *data,
                         struct sp_error *err);

/* True for 1 to SP_NAME_BYTES - 1 characters of [A-Za-z0-9._-], except "." and "..". */
bool srv_source_is_id(const char *id);
/* The id of a volume without a given one: the file's name without its extensions, or the demo's
 * name. European letters lose their accents or become two ("groesse" for "größe"); a run of other
 * characters becomes '-'. Leaves 7 bytes for a suffix. */
void srv_source_default_id(const char *source, char id[SP_NAME_BYTES]);
/* The name that people see: the same part of the source with its letters as they are. */
void srv_source_default_name(const char *source, char name[SP_NAME_BYTES]);

#endif
