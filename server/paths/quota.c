/* SPDX-License-Identifier: Apache-2.0
 *
 * Limits on the number of paths and the bytes of their files: in total and per token, which has its
 * quota, or else a share of the total (common/fair_share.h).
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/fair_share.h"
#include "paths/paths_private.h"

static struct srv_path_owner **find_owner(struct srv_paths *paths, const char *name) {
    struct srv_path_owner **at = &paths->owners;
    while (*at && strcmp((*at)->name, name) != 0)
        at = &(*at)->next;
    return at;
}

/* Returns the quota of a token; one that was removed has none. */
static struct srv_quota quota_of(struct srv_paths *paths, const char *owner) {
    struct srv_quota quota = { .paths = 0 };
    srv_tokens_of_name(paths->options.tokens, owner, NULL, &quota);
    return quota;
}

/* Checks that one more path is allowed. The caller holds the mutex. */
static bool may_enter(struct srv_paths *paths, const struct srv_path_owner *owner,
                      const struct srv_quota *quota, bool *is_full, struct sp_error *err) {
    if (owner && quota->paths && owner->count >= quota->paths)
        return sp_fail(err, SP_ERR_QUOTA, NULL,
                       "%s has %u camera paths and its token allows %u; delete finished ones",
                       owner->name, owner->count, quota->paths);
    if (owner && quota->path_bytes && owner->bytes >= quota->path_bytes)
        return sp_fail(err, SP_ERR_QUOTA, NULL,
                       "the camera paths of %s use %llu bytes and its token allows %llu; delete "
                       "finished ones",
                       owner->name, (unsigned long long)owner->bytes,
                       (unsigned long long)quota->path_bytes);
    if (paths->count >= paths->options.paths_max)
        return sp_fail(err, SP_ERR_BUDGET, NULL,
                       "there are %u camera paths and --paths allows %u; delete finished ones",
                       paths->count, paths->options.paths_max);
    const struct srv_pool count = { paths->options.paths_max, paths->count,
                                    owner ? owner->count : 0 };
    if (srv_fair_left(&count, quota->is_limited && !quota->paths) == 0)
        return sp_fail(err, SP_ERR_QUOTA, NULL,
                       "the token has %u camera paths and all tokens %u of the %u that --paths "
                       "allows; the rest is kept for the others; delete finished ones",
                       (unsigned)count.own, paths->count, paths->options.paths_max);
    *is_full = paths->bytes >= paths->options.bytes_max;
    return !*is_full ||
           sp_fail(err, SP_ERR_BUDGET, NULL,
                   "all camera paths use %llu bytes and --path-bytes allows %llu; delete finished "
                   "ones",
                   (unsigned long long)paths->bytes, (unsigned long long)paths->options.bytes_max);
}

struct srv_path_owner *srv_path_quota_add_path(struct srv_paths *paths, const char *name,
                                               struct sp_error *err) {
    struct srv_path_owner **at = find_owner(paths, name), *owner = *at;
    if (!owner && !(owner = *at = calloc(1, sizeof *owner))) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while creating a camera path");
        return NULL;
    }
    if (owner->count++ ==
        0) { /* a new owner goes last, so that leaving and coming back gains nothing */
        snprintf(owner->name, sizeof owner->name, "%s", name);
        owner->last_served = ++paths->served;
    }
    owner->holders++;
    paths->count++;
    return owner;
}

struct srv_path_owner *srv_path_quota_request_path(struct srv_paths *paths, const char *name,
                                                   bool *is_full, struct sp_error *err) {
    struct srv_quota quota = quota_of(paths, name);
    pthread_mutex_lock(&paths->mutex);
    struct srv_path_owner *owner = NULL;
    if (may_enter(paths, *find_owner(paths, name), &quota, is_full, err))
        owner = srv_path_quota_add_path(paths, name, err);
    pthread_mutex_unlock(&paths->mutex);
    return owner;
}

void srv_path_quota_remove_path(struct srv_paths *paths, struct srv_path_owner *owner) {
    owner->count--;
    paths->count--;
}

void srv_path_quota_release_owner(struct srv_paths *paths, struct srv_path_owner *owner) {
    if (--owner->holders > 0)
        return;
    *find_owner(paths, owner->name) = owner->next;
    free(owner);
}

void srv_path_quota_add(struct srv_paths *paths, struct srv_path *path, uint64_t bytes) {
    paths->bytes += bytes;
    path->by->bytes += bytes;
    path->bytes += bytes;
}

void srv_path_quota_release(struct srv_paths *paths, struct srv_path *path, uint64_t bytes) {
    paths->bytes -= bytes;
    path->by->bytes -= bytes;
    path->bytes -= bytes;
}

/* The caller holds the mutex. */
static bool fits(const struct srv_paths *paths, const struct srv_path *path,
                 const struct srv_quota *quota, uint64_t bytes, const char *what,
                 struct sp_error *err) {
    const struct srv_path_owner *owner = path->by;
    if (quota->path_bytes && owner->bytes + bytes > quota->path_bytes)
        return sp_fail(err, SP_ERR_BUDGET, NULL,
                       "the camera paths of %s use %llu bytes, %s %llu, and its token allows %llu; "
                       "delete finished paths",
                       owner->name, (unsigned long long)owner->bytes, what,
                       (unsigned long long)bytes, (unsigned long long)quota->path_bytes);
    const struct srv_pool pool = { paths->options.bytes_max, paths->bytes, owner->bytes };
    if (paths->bytes + bytes <= paths->options.bytes_max)
        return bytes <= srv_fair_left(&pool, quota->is_limited && !quota->path_bytes) ||
               sp_fail(err, SP_ERR_BUDGET, NULL,
                       "the camera paths of %s use %llu bytes, %s %llu, and all paths %llu of the "
                       "%llu that --path-bytes allows; the rest is kept for the others; delete "
                       "finished paths",
                       owner->name, (unsigned long long)owner->bytes, what,
                       (unsigned long long)bytes, (unsigned long long)paths->bytes,
                       (unsigned long long)paths->options.bytes_max);
    return sp_fail(err, SP_ERR_BUDGET, NULL,
                   "all camera paths use %llu bytes, %s %llu, and --path-bytes allows %llu; "
                   "delete finished paths or raise it",
                   (unsigned long long)paths->bytes, what, (unsigned long long)bytes,
                   (unsigned long long)paths->options.bytes_max);
}

bool srv_path_quota_has(struct srv_paths *paths, struct srv_path *path, uint64_t bytes,
                        const char *what, struct sp_error *err) {
    struct srv_quota quota = quota_of(paths, path->owner);
    pthread_mutex_lock(&paths->mutex);
    bool ok = fits(paths, path, &quota, bytes, what, err);
    pthread_mutex_unlock(&paths->mutex);
    return ok;
}

bool srv_path_quota_acquire(struct srv_paths *paths, struct srv_path *path, uint64_t bytes,
                            const char *what, struct sp_error *err) {
    struct srv_quota quota = quota_of(paths, path->owner);
    pthread_mutex_lock(&paths->mutex);
    bool ok = fits(paths, path, &quota, bytes, what, err);
    if (ok)
        srv_path_quota_add(paths, path, bytes);
    pthread_mutex_unlock(&paths->mutex);
    return ok;
}
