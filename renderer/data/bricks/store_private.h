/* SPDX-License-Identifier: Apache-2.0
 *
 * The store of a brick file: store.c finds subvolumes, reading.c reads them, open.c opens and
 * closes, memory.c is the memory that stores share.
 */
#ifndef SP_BRICKS_STORE_PRIVATE_H
#define SP_BRICKS_STORE_PRIVATE_H

#include <pthread.h>
#include <stdatomic.h>

#include "data/bricks/store.h"
#include "sp/bricks.h"

enum {
    BRICK_SUBVOLUMES_MAX = 8,
    BRICK_QUEUE_MAX = 4 /* waiting needs; the least recently requested one is dropped */
};

struct sp_brick_store_subvolume {
    struct sp_brick_need need; /* owned */
    struct sp_volume *volume;  /* a reference; NULL = the slot is empty */
    uint8_t *lost;             /* owned; per brick of the need, the arrays that could not be read */
    uint64_t lost_count, used, bytes;
    double read_ms;    /* when it was read (base/clock.h) */
    unsigned coarsest; /* the coarsest level that it shows */
    bool is_partial;   /* other bricks of the need are still being read: BRICK_COARSE until then */
};

/* A need that waits for the thread, or that the thread reads. */
struct sp_brick_request {
    struct sp_brick_need need; /* owned; wanted NULL = the slot is empty */
    uint64_t asked;
    bool has_failed; /* reading failed because of `why`; reset by the next request */
    struct sp_error why;
};

struct sp_brick_store {
    struct sp_brick_file *file;
    struct sp_volume *base; /* owns the store, which has no reference to it */
    unsigned base_level;
    struct sp_brick_need base_need; /* all bricks of base_level */
    uint8_t *base_lost;             /* the lost arrays per brick of base_need */
    uint64_t
        budget; /* memory for subvolumes when it was opened: the base takes a quarter at most */
    double retry_ms;   /* chunks that could not be read are read again after this time */
    double publish_ms; /* interval until a partial subvolume is first published; it doubles each
                          time */
    struct sp_brick_memory *memory; /* a reference */
    struct sp_brick_store *next;    /* in the list of the memory */
    struct sp_pool *pool;
    pthread_t thread;
    atomic_bool stop;
    pthread_cond_t asked, done;
    /* The mutex of the memory guards what follows. */
    struct sp_brick_store_subvolume subvolumes[BRICK_SUBVOLUMES_MAX];
    struct sp_brick_request queue[BRICK_QUEUE_MAX];
    uint64_t published; /* subvolumes so far */
    uint64_t cost;      /* bytes of the subvolume that a frame requested last; 0 = no request yet */
    double asked_ms;    /* time of this request (base/clock.h) */
    uint8_t *damaged;   /* per brick of all levels, the finest level first: arrays that could not be
                           read */
    struct sp_bricks_damage damage;
};

/* Records the bricks of a need that could not be read. `lost` has a set of arrays per brick of the
 * box; `why` is the error of one brick. With the mutex held. (damage.c) */
void sp_brick_store_note(struct sp_brick_store *store, const struct sp_brick_need *need,
                         const uint8_t *lost, const struct sp_error *why);
/* Removes the record of bricks that were read successfully. With the mutex held. (damage.c) */
void sp_brick_store_heal(struct sp_brick_store *store, const struct sp_brick_need *need,
                         const uint8_t *lost);
/* Computes the voxels of the whole volume that a brick covers: the first voxel, and one past the
 * last. */
void sp_brick_store_box(const struct sp_brick_store *store, unsigned level, uint64_t number,
                        uint32_t box[2][3]);

/* The memory of subvolumes. All stores of it have one mutex, so that a subvolume of one store can
 * be dropped for a subvolume of another. A store that a frame asked in the last 30 s may have at
 * least an equal share, and what the others do not need of theirs. If subvolumes exceed the limit,
 * the least recently used ones are dropped, whichever store they belong to. */
struct sp_brick_memory {
    pthread_mutex_t mutex; /* guards what follows, and the subvolumes and requests of the stores */
    unsigned references;
    uint64_t bytes;   /* limit */
    uint64_t reading; /* of subvolumes that are being filled */
    uint64_t clock;   /* increases with each use of a subvolume */
    struct sp_brick_store *stores;
};

/* memory.c: */

/* Puts a store into the list, and removes it; removing one that is not in it has no effect. */
void sp_brick_memory_add(struct sp_brick_memory *memory, struct sp_brick_store *store);
void sp_brick_memory_remove(struct sp_brick_memory *memory, struct sp_brick_store *store);

/* Drops subvolumes until `bytes` more fit, and until `store`, which may be NULL, has space for one
 * more subvolume. With the mutex held. */
void sp_brick_memory_make_space(struct sp_brick_memory *memory, struct sp_brick_store *store,
                                uint64_t bytes);

/* Returns the most bytes that one subvolume of the store may cost now. */
uint64_t sp_brick_memory_subvolume_max(struct sp_brick_memory *memory,
                                       const struct sp_brick_store *store);

/* True if no other store may have a share now. */
bool sp_brick_memory_is_alone(struct sp_brick_memory *memory, const struct sp_brick_store *store);

void sp_brick_subvolume_clear(struct sp_brick_store_subvolume *subvolume);
void sp_brick_request_clear(struct sp_brick_request *request);

/* Computes the grid of the samples of a need. *numbers: malloc'ed, the coordinates of rectilinear
 * axes. False if memory ran out. */
bool sp_brick_store_grid(const struct sp_brick_store *store, const struct sp_brick_need *need,
                         struct sp_grid *grid, double **numbers);
/* Returns the part of the level that the samples of a need cover. */
struct sp_whole_part sp_brick_store_part(const struct sp_brick_store *store,
                                         const struct sp_brick_need *need);
/* Returns the vectors in the memory of a need; NULL = the need has none. */
const float (*sp_brick_store_vectors(const struct sp_brick_store *store,
                                     const struct sp_brick_need *need, const void *samples))[3];

/* Puts a subvolume into a slot. Replaces the subvolumes whose bricks it has. With the mutex held.
 */
void sp_brick_store_publish(struct sp_brick_store *store,
                            struct sp_brick_store_subvolume *subvolume);

/* Reads the bricks of a need into a subvolume. Takes over the need. If the need is sparse,
 * publishes partial subvolumes meanwhile, in which `coarser` shows the missing bricks. After a
 * failure the caller clears the subvolume. Without the mutex. (reading.c) */
bool sp_brick_store_fill(struct sp_brick_store *store, struct sp_brick_need *need,
                         const struct sp_brick_subvolume *coarser,
                         struct sp_brick_store_subvolume *subvolume, struct sp_error *err);

/* The main function of the thread, which reads requested needs until `stop`. */
void *sp_brick_store_read(void *store);

#endif
