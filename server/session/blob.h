/* SPDX-License-Identifier: Apache-2.0
 *
 * Encoded frames of sessions. Clients that see the same image share its bytes, and so does the
 * frame cache. A client that does not read keeps two frames in memory: one in its outbox, one at
 * its socket. Therefore a pool bounds the bytes of all frames. The pool is a part of the memory of
 * frames. Each owner has a share of the pool (common/fair_share.h), and the guests of the owner's
 * sessions have a share of the owner's share.
 *
 *   create ──► takes the bytes ──► outboxes, sockets, frame cache ──► last unref gives them back
 *
 * All functions are thread-safe. The pool's lock is taken last.
 */
#ifndef SRV_SESSION_BLOB_H
#define SRV_SESSION_BLOB_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "config/token_file.h"
#include "sp/budget.h"

struct srv_blob_pool; /* opaque */

enum { SRV_BLOB_DIVISOR = 4 }; /* the pool has 1 / SRV_BLOB_DIVISOR of the budget's limit */

struct srv_blob_pool_options {
    /* budget for the bytes, as SP_BUDGET_ANSWERS; NULL = no limit. Outlives the pool */
    struct sp_budget *budget;
    /* Releases blobs that no client waits for. Called once when a blob does not fit, on the thread
     * and with the locks of srv_blob_create()'s caller. NULL = there are none. */
    void (*reclaim)(void *user);
    void *user;
};

/* NULL with *err set: SP_ERR_MEMORY. */
struct srv_blob_pool *srv_blob_pool_create(const struct srv_blob_pool_options *options,
                                           struct sp_error *err);
/* All blobs must have been released. Accepts a NULL pool and nulls *pool. */
void srv_blob_pool_destroy(struct srv_blob_pool **pool);

struct srv_blob_owner {              /* the owner of the session that a frame is encoded for */
    char name[SRV_TOKEN_NAME_BYTES]; /* "" = no owner */
    bool is_limited; /* true = the owner has a share; false = it may take the whole pool */
    bool is_guests;  /* only guests receive the frame: they have a share of the owner's share */
};

struct srv_blob { /* reference-counted bytes, immutable once shared */
    atomic_uint references;
    struct srv_blob_pool *pool;       /* NULL = not counted */
    struct srv_blob_account *account; /* of the owner; NULL = not counted */
    bool is_guests;                   /* counts for the owner's guests */
    size_t image_at; /* bytes before the image: its depth (render/frame_depth.h); 0 = none */
    size_t size;
    uint8_t bytes[];
};

/* Copies the bytes, which count for `owner`. A NULL pool has no limit and needs no owner. NULL with
 * *err set: SP_ERR_FRAME_BUDGET (both numbers are in the text), SP_ERR_MEMORY. */
struct srv_blob *srv_blob_create(struct srv_blob_pool *pool, const struct srv_blob_owner *owner,
                                 const uint8_t *bytes, size_t size, struct sp_error *err);
struct srv_bytes {
    uint8_t *bytes; /* NULL if size is 0 */
    size_t size;
};
/* The same for an image with bytes before it. */
struct srv_blob *srv_blob_create_with(struct srv_blob_pool *pool,
                                      const struct srv_blob_owner *owner,
                                      const struct srv_bytes *before, const uint8_t *bytes,
                                      size_t size, struct sp_error *err);
struct srv_blob *srv_blob_ref(struct srv_blob *blob);
void srv_blob_unref(struct srv_blob **blob); /* accepts NULL and nulls *blob */

#endif
