/* SPDX-License-Identifier: Apache-2.0
 *
 * The memory that the subvolumes of several stores share.
 */
#include <stdlib.h>

#include "base/clock.h"
#include "data/bricks/store_private.h"

/* How long after its last frame a store keeps its share. */
static const double active_ms = 30000;

struct sp_brick_memory *sp_brick_memory_create(uint64_t bytes, struct sp_error *err) {
    struct sp_brick_memory *memory = calloc(1, sizeof *memory);
    if (!memory || pthread_mutex_init(&memory->mutex, NULL) != 0) {
        free(memory);
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the subvolumes of brick files");
        return NULL;
    }
    memory->references = 1;
    memory->bytes = bytes;
    return memory;
}

struct sp_brick_memory *sp_brick_memory_ref(struct sp_brick_memory *memory) {
    pthread_mutex_lock(&memory->mutex);
    memory->references++;
    pthread_mutex_unlock(&memory->mutex);
    return memory;
}

void sp_brick_memory_unref(struct sp_brick_memory **pointer) {
    struct sp_brick_memory *memory = *pointer;
    *pointer = NULL;
    if (!memory)
        return;
    pthread_mutex_lock(&memory->mutex);
    const bool is_last = --memory->references == 0;
    pthread_mutex_unlock(&memory->mutex);
    if (!is_last)
        return;
    pthread_mutex_destroy(&memory->mutex);
    free(memory);
}

void sp_brick_memory_add(struct sp_brick_memory *memory, struct sp_brick_store *store) {
    pthread_mutex_lock(&memory->mutex);
    store->next = memory->stores;
    memory->stores = store;
    pthread_mutex_unlock(&memory->mutex);
}

void sp_brick_memory_remove(struct sp_brick_memory *memory, struct sp_brick_store *store) {
    pthread_mutex_lock(&memory->mutex);
    struct sp_brick_store **link = &memory->stores;
    while (*link && *link != store)
        link = &(*link)->next;
    if (*link)
        *link = store->next;
    pthread_mutex_unlock(&memory->mutex);
}

/* Returns the least recently used of `oldest`, which may be NULL, and the subvolumes of a store.
 * Counts the subvolumes of the store and adds their bytes. With the mutex held. */
static struct sp_brick_store_subvolume *find_oldest(struct sp_brick_store *store, unsigned *count,
                                                    uint64_t *bytes,
                                                    struct sp_brick_store_subvolume *oldest) {
    *count = 0;
    for (int i = 0; i < BRICK_SUBVOLUMES_MAX; i++) {
        struct sp_brick_store_subvolume *w = &store->subvolumes[i];
        if (!w->volume)
            continue;
        (*count)++;
        *bytes += w->bytes;
        oldest = !oldest || w->used < oldest->used ? w : oldest;
    }
    return oldest;
}

void sp_brick_memory_make_space(struct sp_brick_memory *memory, struct sp_brick_store *store,
                                uint64_t bytes) {
    for (;;) {
        struct sp_brick_store_subvolume *oldest = NULL, *own = NULL;
        uint64_t total = bytes + memory->reading, own_bytes = 0;
        unsigned count = 0, ignored;
        for (struct sp_brick_store *s = memory->stores; s; s = s->next)
            oldest = find_oldest(s, &ignored, &total, oldest);
        if (store)
            own = find_oldest(store, &count, &own_bytes, NULL);
        if (oldest && total > memory->bytes)
            sp_brick_subvolume_clear(oldest);
        else if (count == BRICK_SUBVOLUMES_MAX)
            sp_brick_subvolume_clear(own);
        else
            return;
    }
}

static bool is_active(const struct sp_brick_store *store, double now_ms) {
    return store->cost && now_ms - store->asked_ms < active_ms;
}

bool sp_brick_memory_is_alone(struct sp_brick_memory *memory, const struct sp_brick_store *store) {
    const double now_ms = sp_clock_ms();
    bool is_alone = true;
    pthread_mutex_lock(&memory->mutex);
    for (const struct sp_brick_store *s = memory->stores; s; s = s->next)
        is_alone = is_alone && (s == store || !is_active(s, now_ms));
    pthread_mutex_unlock(&memory->mutex);
    return is_alone;
}

uint64_t sp_brick_memory_subvolume_max(struct sp_brick_memory *memory,
                                       const struct sp_brick_store *store) {
    const double now_ms = sp_clock_ms();
    uint64_t count = 1, others = 0;
    pthread_mutex_lock(&memory->mutex);
    for (const struct sp_brick_store *s = memory->stores; s; s = s->next)
        count += s != store && is_active(s, now_ms);
    const uint64_t share = memory->bytes / count;
    for (const struct sp_brick_store *s = memory->stores; s; s = s->next)
        if (s != store && is_active(s, now_ms))
            others += s->cost < share ? s->cost : share;
    const uint64_t own = memory->bytes - others;
    pthread_mutex_unlock(&memory->mutex);
    return own / 4 * 3; /* the rest is for what it replaces, until that is copied */
}

void sp_brick_memory_set(struct sp_brick_memory *memory, uint64_t bytes) {
    pthread_mutex_lock(&memory->mutex);
    memory->bytes = bytes;
    sp_brick_memory_make_space(memory, NULL, 0);
    pthread_mutex_unlock(&memory->mutex);
}

void sp_brick_memory_usage(struct sp_brick_memory *memory, struct sp_brick_usage *usage) {
    *usage = (struct sp_brick_usage){ .files = 0 };
    pthread_mutex_lock(&memory->mutex);
    usage->bytes_max = memory->bytes;
    for (struct sp_brick_store *s = memory->stores; s; s = s->next) {
        unsigned count;
        usage->files++;
        find_oldest(s, &count, &usage->bytes, NULL);
    }
    pthread_mutex_unlock(&memory->mutex);
}
