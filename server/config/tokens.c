/* SPDX-License-Identifier: Apache-2.0 */
#include "config/tokens.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

struct srv_token_use {
    unsigned holders; /* references: the list and the grants */
    unsigned snapshots;
    double used_ms; /* the fps quota is used up until this time */
};

struct entry {
    struct srv_token token;
    struct srv_token_use *use;
};

struct srv_tokens {
    pthread_mutex_t mutex;
    struct entry *list;
    size_t count;
};

struct srv_tokens *srv_tokens_create(struct sp_error *err) {
    struct srv_tokens *tokens = calloc(1, sizeof *tokens);
    if (!tokens)
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while storing the tokens");
    else
        pthread_mutex_init(&tokens->mutex, NULL);
    return tokens;
}

static void drop(struct srv_token_use *use) {
    if (use && --use->holders == 0)
        free(use);
}

static void free_list(struct entry *list, size_t count) {
    for (size_t i = 0; i < count; i++)
        drop(list[i].use);
    if (list)
        explicit_bzero(list, count * sizeof *list);
    free(list);
}

void srv_tokens_destroy(struct srv_tokens **pointer) {
    struct srv_tokens *tokens = *pointer;
    *pointer = NULL;
    if (!tokens)
        return;
    free_list(tokens->list, tokens->count);
    pthread_mutex_destroy(&tokens->mutex);
    free(tokens);
}

/* NULL = no such name. The caller holds the mutex. */
static const struct entry *find_name(const struct srv_tokens *tokens, const char *name) {
    for (size_t i = 0; i < tokens->count; i++)
        if (strcmp(tokens->list[i].token.name, name) == 0)
            return &tokens->list[i];
    return NULL;
}

/* Returns a reference to the counters of this name: the counters of the current list, or new ones.
 * The caller holds the mutex. */
static struct srv_token_use *use_of(struct srv_tokens *tokens, const char *name) {
    const struct entry *found = find_name(tokens, name);
    struct srv_token_use *use = found ? found->use : calloc(1, sizeof *use);
    if (use)
        use->holders++;
    return use;
}

/* A token that may create something shares the pools, unless it is the only one. */
static bool is_sharing(const struct srv_token *token) {
    return token->rights & (SRV_RIGHT_RENDER | SRV_RIGHT_CONTROL | SRV_RIGHT_ADMIN);
}

static void set_limits(struct srv_token *list, size_t count) {
    size_t sharing = 0;
    for (size_t i = 0; i < count; i++)
        sharing += is_sharing(&list[i]);
    for (size_t i = 0; i < count; i++)
        list[i].quota.is_limited = sharing > 1 && !(list[i].rights & SRV_RIGHT_ADMIN);
}

bool srv_tokens_set(struct srv_tokens *tokens, struct srv_token *list, size_t count,
                    struct sp_error *err) {
    struct entry *fresh = calloc(count, sizeof *fresh);
    bool ok = fresh != NULL;
    set_limits(list, count);
    pthread_mutex_lock(&tokens->mutex);
    for (size_t i = 0; ok && i < count; i++) {
        fresh[i].token = list[i];
        ok = (fresh[i].use = use_of(tokens, list[i].name)) != NULL;
    }
    struct entry *old = ok ? tokens->list : fresh;
    size_t old_count = ok ? tokens->count : count;
    if (ok) {
        tokens->list = fresh;
        tokens->count = count;
    }
    if (old)
        free_list(old, old_count);
    pthread_mutex_unlock(&tokens->mutex);
    explicit_bzero(list, count * sizeof *list);
    free(list);
    return ok || sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while storing the tokens");
}

void srv_tokens_acquire(struct srv_tokens *tokens, const char *given, struct srv_grant *grant) {
    *grant = (struct srv_grant){ .rights = 0 };
    pthread_mutex_lock(&tokens->mutex);
    struct entry *found = NULL;
    for (size_t i = 0; i < tokens->count; i++) /* no early exit: constant time */
        if (srv_secret_equal(tokens->list[i].token.text, given))
            found = &tokens->list[i];
    if (found) {
        grant->rights = found->token.rights;
        grant->quota = found->token.quota;
        memcpy(grant->name, found->token.name, sizeof grant->name);
        grant->use = found->use;
        found->use->holders++;
    }
    pthread_mutex_unlock(&tokens->mutex);
}

void srv_tokens_release(struct srv_tokens *tokens, struct srv_grant *grant) {
    pthread_mutex_lock(&tokens->mutex);
    drop(grant->use);
    pthread_mutex_unlock(&tokens->mutex);
    grant->use = NULL;
}

bool srv_tokens_of_name(struct srv_tokens *tokens, const char *name, unsigned *rights,
                        struct srv_quota *quota) {
    pthread_mutex_lock(&tokens->mutex);
    const struct entry *found = find_name(tokens, name);
    if (found && rights)
        *rights = found->token.rights;
    if (found)
        *quota = found->token.quota;
    pthread_mutex_unlock(&tokens->mutex);
    return found != NULL;
}

bool srv_tokens_charge_to(struct srv_tokens *tokens, const char *name, struct srv_grant *grant) {
    pthread_mutex_lock(&tokens->mutex);
    const struct entry *found = find_name(tokens, name);
    if (found) {
        drop(grant->use);
        *grant = (struct srv_grant){ .quota = found->token.quota, .use = found->use };
        memcpy(grant->name, found->token.name, sizeof grant->name);
        found->use->holders++;
    }
    pthread_mutex_unlock(&tokens->mutex);
    return found != NULL;
}

/* Checks the quotas and charges one snapshot to the fps quota. Up to one second of unused quota
 * accumulates. */
static bool charge(struct srv_token_use *use, const struct srv_quota *quota, const char *name,
                   double now_ms, struct sp_error *err) {
    if (quota->snapshots && use->snapshots >= quota->snapshots)
        return sp_fail(err, SP_ERR_QUOTA, NULL,
                       "%s has %u snapshots in progress and its token allows %u; try again later",
                       name, use->snapshots, quota->snapshots);
    if (!quota->fps)
        return true;
    double from_ms = use->used_ms > now_ms - 1000 ? use->used_ms : now_ms - 1000;
    double until_ms = from_ms + 1000.0 / quota->fps;
    if (until_ms > now_ms + 1e-6)
        return sp_fail(err, SP_ERR_QUOTA, NULL,
                       "%s has used the %u snapshots per second that its token allows", name,
                       quota->fps);
    use->used_ms = until_ms;
    return true;
}

bool srv_tokens_begin_snapshot(struct srv_tokens *tokens, const struct srv_grant *grant,
                               double now_ms, struct sp_error *err) {
    pthread_mutex_lock(&tokens->mutex);
    bool ok = charge(grant->use, &grant->quota, grant->name, now_ms, err);
    grant->use->snapshots += ok;
    pthread_mutex_unlock(&tokens->mutex);
    return ok;
}

void srv_tokens_cancel_snapshot(struct srv_tokens *tokens, const struct srv_grant *grant) {
    pthread_mutex_lock(&tokens->mutex);
    grant->use->snapshots--;
    if (grant->quota.fps)
        grant->use->used_ms -= 1000.0 / grant->quota.fps;
    pthread_mutex_unlock(&tokens->mutex);
}

void srv_tokens_end_snapshot(struct srv_tokens *tokens, const struct srv_grant *grant) {
    pthread_mutex_lock(&tokens->mutex);
    grant->use->snapshots--;
    pthread_mutex_unlock(&tokens->mutex);
}
