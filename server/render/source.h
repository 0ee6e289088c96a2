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

bool srv_source_is_demo(const char *source);

/* Returns the key of a source, malloc'ed: the real path, or the demo's text. A confined path must
 * lie below `data`, a resolved folder (NULL = none). NULL with *err set: SP_ERR_INVALID,
 * SP_ERR_DENIED (no data folder), SP_ERR_NOT_FOUND, SP_ERR_MEMORY, or what sp_demo_check() returns.
 * The place of a confined source's error is a JSON pointer. */
char *srv_source_resolve(const char *source, bool confined, const char *data, struct sp_error *err);

/* True for 1 to SP_NAME_BYTES - 1 characters of [A-Za-z0-9._-], except "." and "..". */
bool srv_source_is_id(const char *id);
/* The id of a volume without a given one: the file's name without its extension, or the demo's
 * name. Other characters than an id allows become '-'. Leaves 7 bytes for a suffix. */
void srv_source_default_id(const char *source, char id[SP_NAME_BYTES]);

#endif
