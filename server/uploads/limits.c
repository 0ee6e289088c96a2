/* SPDX-License-Identifier: Apache-2.0
 *
 * Limits: of all uploads together, of each token, and of the disk. A token has its quota, or
 * else a share of the limits of all (common/fair_share.h).
 */
#include <inttypes.h>
#include <string.h>

#include "common/fair_share.h"
#include "uploads/uploads_private.h"

struct srv_quota srv_uploads_quota_of(const struct srv_uploads *uploads, const char *owner) {
    struct srv_quota quota = { .sessions = 0 };
    if (uploads->options.tokens)
        srv_tokens_of_name(uploads->options.tokens, owner, NULL, &quota);
    return quota;
}

static uint64_t minus(uint64_t most, uint64_t used) {
    return most > used ? most - used : 0;
}

static uint64_t smaller(uint64_t a, uint64_t b) {
    return a < b ? a : b;
}

/* What one token has and may have. */
struct limits {
    uint64_t own_bytes, own_count; /* declared */
    uint64_t bytes_left, count_left;
    uint64_t bytes_max;              /* if no other token had uploads */
    const char *bytes_by, *count_by; /* what sets these limits; NULL = the limits of all */
};

/* With the mutex held. */
static struct limits limits_of(const struct srv_uploads *uploads, const char *owner,
                               const struct srv_quota *quota) {
    const struct srv_uploads_options *o = &uploads->options;
    struct limits l = { .own_count = 0 };
    for (const struct srv_upload *u = uploads->first; u; u = u->next)
        if (strcmp(u->owner, owner) == 0) {
            l.own_bytes += u->bytes;
            l.own_count++;
        }
    const struct srv_pool bytes = { o->bytes_max, uploads->declared_bytes, l.own_bytes };
    const struct srv_pool count = { o->count_max, uploads->count, l.own_count };
    const bool has_share = quota->is_limited && !quota->upload_bytes;
    l.bytes_left = srv_fair_left(&bytes, has_share);
    l.count_left = srv_fair_left(&count, quota->is_limited && !quota->uploads);
    l.bytes_max = srv_fair_left(&(struct srv_pool){ o->bytes_max, 0, 0 }, has_share);
    l.bytes_by = has_share ? "its share of --upload-bytes" : NULL;
    l.count_by = quota->is_limited && !quota->uploads ? "its share of --uploads" : NULL;
    if (quota->upload_bytes && minus(quota->upload_bytes, l.own_bytes) <= l.bytes_left) {
        l.bytes_left = minus(quota->upload_bytes, l.own_bytes);
        l.bytes_by = "its quota upload-bytes";
    }
    if (quota->upload_bytes)
        l.bytes_max = smaller(l.bytes_max, quota->upload_bytes);
    if (quota->uploads && minus(quota->uploads, l.own_count) <= l.count_left) {
        l.count_left = minus(quota->uploads, l.own_count);
        l.count_by = "its quota uploads";
    }
    return l;
}

static bool fits_the_token(const char *owner, const struct limits *l, uint64_t bytes,
                           struct sp_error *err) {
    if (l->bytes_by && bytes > l->bytes_left)
        return sp_fail(err, SP_ERR_QUOTA, NULL,
                       "the file has %" PRIu64 " bytes; the token %s has uploads of %" PRIu64
                       " and may have %" PRIu64 " (%s), so %" PRIu64
                       " are free; close volumes that it uploaded or cancel uploads",
                       bytes, owner, l->own_bytes, l->own_bytes + l->bytes_left, l->bytes_by,
                       l->bytes_left);
    return !l->count_by || l->count_left > 0 ||
           sp_fail(err, SP_ERR_QUOTA, NULL,
                   "the token %s has %" PRIu64 " uploads and may have %" PRIu64
                   " (%s); close volumes that it uploaded or cancel uploads",
                   owner, l->own_count, l->own_count, l->count_by);
}

static bool fits_all(const struct srv_uploads *uploads, uint64_t bytes, struct sp_error *err) {
    const struct srv_uploads_options *o = &uploads->options;
    uint64_t left = minus(o->bytes_max, uploads->declared_bytes);
    if (uploads->count >= o->count_max)
        return sp_fail(err, SP_ERR_BUDGET, NULL,
                       "there are %u uploads and --uploads allows %u; close uploaded volumes, "
                       "cancel uploads, or wait for others to do so",
                       uploads->count, o->count_max);
    if (bytes > left)
        return sp_fail(err, SP_ERR_BUDGET, NULL,
                       "the file has %" PRIu64 " bytes; the uploads of all have %" PRIu64
                       " and --upload-bytes allows %" PRIu64 ", so %" PRIu64
                       " are free; close uploaded volumes, cancel uploads, or wait for others to "
                       "do so",
                       bytes, uploads->declared_bytes, o->bytes_max, left);
    left = srv_upload_files_free(uploads);
    return bytes <= left ||
           sp_fail(err, SP_ERR_BUDGET, NULL,
                   "the file has %" PRIu64 " bytes and the disk for uploads has %" PRIu64
                   " free; free space on the disk of --upload-dir",
                   bytes, left);
}

bool srv_uploads_may_add(const struct srv_uploads *uploads, const char *owner,
                         const struct srv_quota *quota, uint64_t bytes, struct sp_error *err) {
    const struct limits l = limits_of(uploads, owner, quota);
    if (bytes > uploads->options.bytes_max)
        return sp_fail(err, SP_ERR_TOO_LARGE, "/bytes",
                       "the file has %" PRIu64 " bytes and --upload-bytes allows %" PRIu64, bytes,
                       uploads->options.bytes_max);
    if (bytes > l.bytes_max)
        return sp_fail(err, SP_ERR_TOO_LARGE, "/bytes",
                       "the file has %" PRIu64 " bytes and the token %s may upload %" PRIu64
                       " in all (%s)",
                       bytes, owner, l.bytes_max,
                       l.bytes_max == quota->upload_bytes ? "its quota upload-bytes"
                                                          : "its share of --upload-bytes");
    return fits_the_token(owner, &l, bytes, err) && fits_all(uploads, bytes, err);
}

void srv_uploads_numbers(struct srv_uploads *uploads, const char *owner,
                         struct srv_uploads_numbers *numbers) {
    const struct srv_uploads_options *o = &uploads->options;
    const struct srv_quota quota = srv_uploads_quota_of(uploads, owner);
    pthread_mutex_lock(&uploads->mutex);
    const struct limits l = limits_of(uploads, owner, &quota);
    *numbers = (struct srv_uploads_numbers){ .count = uploads->count,
                                             .declared_bytes = uploads->declared_bytes,
                                             .bytes_max = o->bytes_max,
                                             .own_count = (unsigned)l.own_count,
                                             .own_bytes = l.own_bytes,
                                             .own_bytes_max = l.bytes_max,
                                             .free_bytes = l.bytes_left,
                                             .free_count = (unsigned)l.count_left };
    for (const struct srv_upload *u = uploads->first; u; u = u->next)
        numbers->received_bytes += u->offset;
    pthread_mutex_unlock(&uploads->mutex);
    numbers->free_bytes = smaller(numbers->free_bytes, srv_upload_files_free(uploads));
}
