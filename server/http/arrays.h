/* SPDX-License-Identifier: Apache-2.0
 *
 * Arrays in shared memory that clients have passed (UNIX.md), until a request makes volumes of
 * them.
 *
 *   add ─► waits ─► open, remove ─► the volume has it
 *            └────► expired
 *
 * An array belongs to the token that passed it; for other tokens it does not exist. Its id is
 * random. All functions are thread-safe.
 */
#ifndef SRV_HTTP_ARRAYS_H
#define SRV_HTTP_ARRAYS_H

#include <stdbool.h>
#include <stdint.h>

#include "config/token_file.h"
#include "sp/status.h"

struct srv_arrays;

enum {
    SRV_ARRAY_ID_BYTES = 33,
    SRV_ARRAYS_MAX = 64,      /* that wait */
    SRV_ARRAYS_OWNER_MAX = 16 /* of one token */
};
#define SRV_ARRAY_WAIT_MS 60000.0

struct srv_arrays *srv_arrays_create(struct sp_error *err); /* SP_ERR_MEMORY */
void srv_arrays_destroy(struct srv_arrays **arrays);        /* accepts NULL */

/* Adds memory of `bytes` bytes, which sp_shared_memory_check() has accepted, and writes its id.
 * Owns the descriptor on success. SP_ERR_QUOTA: too many arrays wait. SP_ERR_IO. */
bool srv_arrays_add(struct srv_arrays *arrays, int fd, uint64_t bytes, const char *owner,
                    double now_ms, char id[SRV_ARRAY_ID_BYTES], struct sp_error *err);
/* Returns another descriptor of the memory, the caller's; −1: SP_ERR_NOT_FOUND, SP_ERR_IO. */
int srv_arrays_open(struct srv_arrays *arrays, const char *id, const char *owner, uint64_t *bytes,
                    struct sp_error *err);
/* Removes an array, if it is still there. */
void srv_arrays_remove(struct srv_arrays *arrays, const char *id);
/* Removes arrays that have waited for SRV_ARRAY_WAIT_MS. */
void srv_arrays_tick(struct srv_arrays *arrays, double now_ms);

#endif
