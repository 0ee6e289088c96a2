/* SPDX-License-Identifier: Apache-2.0
 *
 * The memory of pictures that were asked for by HTTP, from the request until its client has read
 * the answer: a picture takes its pixels' bytes while it waits, is drawn and encoded, and those of
 * the answer afterwards. Thread-safe.
 */
#ifndef SRV_HTTP_SNAPSHOT_MEMORY_H
#define SRV_HTTP_SNAPSHOT_MEMORY_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/encode.h"
#include "sp/status.h"

struct srv_snapshot_memory;

struct srv_snapshot_memory *srv_snapshot_memory_create(uint64_t bytes_max, struct sp_error *err);
void srv_snapshot_memory_destroy(
    struct srv_snapshot_memory **memory); /* after everything was given back */

/* Of a picture that is drawn for this format. */
uint64_t srv_snapshot_memory_of(const uint32_t size[2], enum sp_image_format format);

/* SP_ERR_BUDGET if all together would have more than the bound. One alone is never refused: no
 * picture is larger than --frame-size. */
bool srv_snapshot_memory_reserve(struct srv_snapshot_memory *memory, uint64_t bytes,
                                 struct sp_error *err);
/* One that has taken *bytes needs `now` bytes from here on; 0 gives it back. */
void srv_snapshot_memory_change(struct srv_snapshot_memory *memory, uint64_t *bytes, uint64_t now);

#endif
