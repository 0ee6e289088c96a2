/* SPDX-License-Identifier: Apache-2.0
 *
 * The store of a brick file: store.c finds and reads windows, open.c opens and closes.
 */
#ifndef SP_BRICKS_STORE_PRIVATE_H
#define SP_BRICKS_STORE_PRIVATE_H

#include <pthread.h>
#include <stdatomic.h>

#include "bricks/store.h"
#include "sp/bricks.h"

enum {
    BRICK_WINDOWS_MAX = 8,
    BRICK_QUEUE_MAX = 4 /* needs that wait; the one that was asked for longest ago is dropped */
};

struct sp_brick_store_window {
    struct sp_brick_need need; /* owned */
    struct sp_volume *volume;  /* a reference; NULL = the slot is empty */
    uint8_t *lost;
    uint64_t lost_count, used, bytes;
};

/* A need that waits for the thread, or that it reads. */
struct sp_brick_request {
    struct sp_brick_need need; /* owned; wanted NULL = the slot is empty */
    uint64_t asked;
    bool has_failed; /* for `why`: until it is asked for again */
    struct sp_error why;
};

struct sp_brick_store {
    struct sp_brick_file *file;
    struct sp_volume *base; /* owns the store, which has no reference to it */
    unsigned base_level;
    struct sp_brick_need base_need; /* all of its level */
    uint8_t *base_lost;
    uint64_t budget; /* bytes of the samples of windows */
    struct sp_pool *pool;
    pthread_t thread;
    atomic_bool stop;
    pthread_mutex_t mutex; /* guards what follows */
    pthread_cond_t asked, done;
    struct sp_brick_store_window windows[BRICK_WINDOWS_MAX];
    struct sp_brick_request queue[BRICK_QUEUE_MAX];
    uint64_t clock;
    uint8_t *damaged; /* by brick of all levels, the finest first: 1 = it could not be read */
    struct sp_bricks_damage damage;
};

/* Notes the bricks of a need that could not be read, `lost` by brick of its box; `why` is the error
 * of one of them. With the mutex held. (damage.c) */
void sp_brick_store_note(struct sp_brick_store *store, const struct sp_brick_need *need,
                         const uint8_t *lost, const struct sp_error *why);
/* Voxels of the whole volume that a brick covers: the first one, and the one past the last. */
void sp_brick_store_box(const struct sp_brick_store *store, unsigned level, uint64_t number,
                        uint32_t box[2][3]);

void sp_brick_window_clear(struct sp_brick_store_window *window);
void sp_brick_request_clear(struct sp_brick_request *request);

/* The grid of the samples of a need. */
struct sp_grid sp_brick_store_grid(const struct sp_brick_store *store,
                                   const struct sp_brick_need *need);

/* Memory for samples, which sp_brick_store_unmap() releases; NULL with *err set. */
void *sp_brick_store_map(size_t bytes, struct sp_error *err);
void sp_brick_store_unmap(void *samples, size_t bytes);

/* The thread that reads what is asked for, until `stop`. */
void *sp_brick_store_read(void *store);

#endif
