/* SPDX-License-Identifier: Apache-2.0
 *
 * Accounts for the memory of snapshots, the images requested over HTTP. A snapshot counts from its
 * request until the client has read the answer: first with the bytes of its pixels, while it waits,
 * is rendered and encoded, and then with the bytes of the answer. Thread-safe.
 */
#ifndef SRV_HTTP_SNAPSHOT_MEMORY_H
#define SRV_HTTP_SNAPSHOT_MEMORY_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/encode.h"
#include "sp/status.h"
#include "sp/view.h"

struct srv_snapshot_memory;

struct srv_snapshot_memory *srv_snapshot_memory_create(uint64_t bytes_max, struct sp_error *err);
void srv_snapshot_memory_destroy(
    struct srv_snapshot_memory **memory); /* all bytes must be returned */

/* Returns the bytes that a snapshot of this view and format takes while it is rendered: slices in
 * the image need two more frames in floating point. */
uint64_t srv_snapshot_memory_of(const struct sp_view *view, enum sp_image_format format);

/* Fails with SP_ERR_BUDGET if all snapshots together would exceed the limit. A single snapshot is
 * never refused, because --frame-size limits it. */
bool srv_snapshot_memory_reserve(struct srv_snapshot_memory *memory, uint64_t bytes,
                                 struct sp_error *err);
/* Changes the reservation of a snapshot from *bytes to `now`; 0 returns it. */
void srv_snapshot_memory_change(struct srv_snapshot_memory *memory, uint64_t *bytes, uint64_t now);

#endif
