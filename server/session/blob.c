/* SPDX-License-Identifier: Apache-2.0 */
#include "session/blob.h"

#include <assert.h>
#include <inttypes.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "common/fair_share.h"

struct srv_blob_account { /* of an owner that has blobs */
    struct srv_blob_account *next;
    uint64_t bytes, guests; /* guests: the part of `bytes` that only guests get */
    char owner[SRV_TOKEN_NAME_BYTES];
};

struct srv_blob_pool {
    struct srv_blob_pool_options options;
    uint64_t most;
    pthread_mutex_t mutex; /* guards what follows */
    uint64_t used;
    struct srv_blob_account *accounts; /* few: owners that watch now */
};

struct srv_blob_pool *srv_blob_pool_create(const struct srv_blob_pool_options *options,
                                           struct sp_error *err) {
    struct srv_blob_pool *pool = calloc(1, sizeof *pool);
    if (!pool) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the pool of encoded frames");
        return NULL;
    }
    pool->options = *options;
    pool->most = sp_budget_limit(options->budget) / SRV_BLOB_DIVISOR;
    pthread_mutex_init(&pool->mutex, NULL);
    return pool;
}

void srv_blob_pool_destroy(struct srv_blob_pool **pool_pointer) {
    struct srv_blob_pool *pool = *pool_pointer;
    *pool_pointer = NULL;
    if (!pool)
        return;
    assert(!pool->accounts && pool->used == 0);
    pthread_mutex_destroy(&pool->mutex);
    free(pool);
}

/* With the mutex held. NULL: out of memory. */
static struct srv_blob_account *find_or_add(struct srv_blob_pool *pool, const char *owner) {
    struct srv_blob_account *account = pool->accounts;
    while (account && strcmp(account->owner, owner) != 0)
        account = account->next;
    if (account || !(account = calloc(1, sizeof *account)))
        return account;
    memcpy(account->owner, owner, strlen(owner) + 1);
    account->next = pool->accounts;
    pool->accounts = account;
    return account;
}

/* With the mutex held. */
static void remove_if_empty(struct srv_blob_pool *pool, struct srv_blob_account *account) {
    struct srv_blob_account **link = &pool->accounts;
    if (account->bytes > 0)
        return;
    while (*link != account)
        link = &(*link)->next;
    *link = account->next;
    free(account);
}

/* With the mutex held. */
static uint64_t left_for(const struct srv_blob_pool *pool, const struct srv_blob_account *account,
                         const struct srv_blob_owner *owner) {
    const struct srv_pool all = { pool->most, pool->used, account->bytes };
    const uint64_t left = srv_fair_left(&all, owner->is_limited);
    const struct srv_pool owners = { account->bytes + left, account->bytes, account->guests };
    return owner->is_guests ? srv_fair_left(&owners, true) : left;
}

/* With the mutex held. */
static enum sp_code acquire_bytes(struct srv_blob_pool *pool, struct srv_blob_account *account,
                                  const struct srv_blob_owner *owner, uint64_t bytes,
                                  struct sp_error *err) {
    struct sp_budget *budget = pool->options.budget;
    const uint64_t left = left_for(pool, account, owner);
    const uint64_t own = owner->is_guests ? account->guests : account->bytes;
    if (bytes > left)
        sp_fail(err, SP_ERR_FRAME_BUDGET, "/size",
                "the encoded frame needs %" PRIu64
                " bytes; the %s of this session's owner have %" PRIu64
                " bytes that were not read, and may have %" PRIu64
                "; read faster, or ask for smaller images",
                bytes, owner->is_guests ? "guests" : "clients", own, own + left);
    else if (!sp_budget_acquire(budget, SP_BUDGET_ANSWERS, bytes))
        sp_budget_fail(budget, "encoded image", bytes, err);
    else {
        pool->used += bytes;
        account->bytes += bytes;
        account->guests += owner->is_guests ? bytes : 0;
        return SP_OK;
    }
    return SP_ERR_FRAME_BUDGET;
}

static enum sp_code reserve(struct srv_blob_pool *pool, const struct srv_blob_owner *owner,
                            uint64_t bytes, struct srv_blob_account **account,
                            struct sp_error *err) {
    enum sp_code code = SP_ERR_MEMORY;
    pthread_mutex_lock(&pool->mutex);
    *account = find_or_add(pool, owner->name);
    if (*account) {
        code = acquire_bytes(pool, *account, owner, bytes, err);
        remove_if_empty(pool, *account);
    } else {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the owner of an encoded frame");
    }
    pthread_mutex_unlock(&pool->mutex);
    return code;
}

static void give(struct srv_blob_pool *pool, struct srv_blob_account *account, bool is_guests,
                 uint64_t bytes) {
    if (!pool)
        return;
    pthread_mutex_lock(&pool->mutex);
    sp_budget_release(pool->options.budget, SP_BUDGET_ANSWERS, bytes);
    pool->used -= bytes;
    account->bytes -= bytes;
    account->guests -= is_guests ? bytes : 0;
    remove_if_empty(pool, account);
    pthread_mutex_unlock(&pool->mutex);
}

static uint64_t bytes_of(size_t size) {
    return sizeof(struct srv_blob) + size;
}

static struct srv_blob *allocate(struct srv_blob_pool *pool, const struct srv_blob_owner *owner,
                                 size_t size, struct sp_error *err) {
    struct srv_blob_account *account = NULL;
    if (pool) {
        enum sp_code code = reserve(pool, owner, bytes_of(size), &account, err);
        if (code == SP_ERR_FRAME_BUDGET && pool->options.reclaim) {
            pool->options.reclaim(pool->options.user);
            code = reserve(pool, owner, bytes_of(size), &account, err);
        }
        if (code != SP_OK)
            return NULL;
    }
    struct srv_blob *blob = malloc(sizeof *blob + size);
    if (!blob) {
        give(pool, account, pool && owner->is_guests, bytes_of(size));
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for an encoded frame of %zu bytes", size);
        return NULL;
    }
    atomic_init(&blob->references, 1);
    blob->pool = pool;
    blob->account = account;
    blob->is_guests = pool && owner->is_guests;
    blob->size = size;
    return blob;
}

struct srv_blob *srv_blob_create_with(struct srv_blob_pool *pool,
                                      const struct srv_blob_owner *owner,
                                      const struct srv_bytes *before, const uint8_t *bytes,
                                      size_t size, struct sp_error *err) {
    struct srv_blob *blob = allocate(pool, owner, before->size + size, err);
    if (!blob)
        return NULL;
    if (before->size > 0)
        memcpy(blob->bytes, before->bytes, before->size);
    memcpy(blob->bytes + before->size, bytes, size);
    blob->image_at = before->size;
    return blob;
}

struct srv_blob *srv_blob_create(struct srv_blob_pool *pool, const struct srv_blob_owner *owner,
                                 const uint8_t *bytes, size_t size, struct sp_error *err) {
    return srv_blob_create_with(pool, owner, &(struct srv_bytes){ .size = 0 }, bytes, size, err);
}

struct srv_blob *srv_blob_ref(struct srv_blob *blob) {
    atomic_fetch_add_explicit(&blob->references, 1, memory_order_relaxed);
    return blob;
}

void srv_blob_unref(struct srv_blob **blob_pointer) {
    struct srv_blob *blob = *blob_pointer;
    *blob_pointer = NULL;
    if (!blob || atomic_fetch_sub_explicit(&blob->references, 1, memory_order_acq_rel) != 1)
        return;
    struct srv_blob_pool *pool = blob->pool;
    struct srv_blob_account *account = blob->account;
    const bool is_guests = blob->is_guests;
    const uint64_t bytes = bytes_of(blob->size);
    free(blob);
    give(pool, account, is_guests, bytes);
}
