/* SPDX-License-Identifier: Apache-2.0
 *
 * What outlives the request that made it: kept views. A kept view is named by its content, so that
 * the same view has the same id and what an id stands for never changes.
 *
 * All functions are thread-safe and wait for no disk.
 */
#ifndef SRV_STORE_STORE_H
#define SRV_STORE_STORE_H

#include <stddef.h>

#include "sp/status.h"

struct srv_store;

struct srv_store_options {
    unsigned views_max; /* kept views */
};

struct srv_store *srv_store_create(const struct srv_store_options *options, struct sp_error *err);
void srv_store_destroy(struct srv_store **store); /* accepts NULL; nulls */

/* How a put ended: err NULL = it is kept, as safely as this store keeps things. Called once, by
 * whatever thread gets there, perhaps before the put returns. */
typedef void srv_store_done(void *user, const struct sp_error *err);

/* Keeps a copy of `text` (size bytes) as the view `id` (32 hexadecimal digits). What is there
 * already stays. SP_ERR_BUDGET when there are views_max others, SP_ERR_MEMORY. */
void srv_store_put_view(struct srv_store *store, const char *id, const char *text, size_t size,
                        srv_store_done *done, void *user);

/* The text of a view: malloc'ed, the caller's. NULL: SP_ERR_NOT_FOUND, SP_ERR_MEMORY. */
char *srv_store_get_view(struct srv_store *store, const char *id, size_t *size,
                         struct sp_error *err);

#endif
