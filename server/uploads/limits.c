/* SPDX-License-Identifier: Apache-2.0
 *
 * Limits: of all uploads together, of each token, and of the disk. The quota of a token comes from
 * the token file. Without one, where several tokens may upload, each may have three quarters of the
 * daemon's limits, so that no token can keep the others out.
 */
#include <inttypes.h>
#include <string.h>

#include "uploads/uploads_private.h"

void srv_uploads_share_of(const struct srv_uploads *uploads, const char *owner,
                          struct srv_uploads_share *share) {
    const struct srv_uploads_options *o = &uploads->options;
    struct srv_quota quota = { .sessions = 0 };
    bool is_shared = false;
    if (o->tokens) {
        srv_tokens_of_name(o->tokens, owner, NULL, &quota);
        is_shared = srv_tokens_count(o->tokens, SRV_RIGHT_CONTROL) > 1;
    }
    share->is_quota = quota.upload_bytes > 0;
    share->bytes = is_shared ? o->bytes_max - o->bytes_max / 4 : o->bytes_max;
    share->count = is_shared ? o->count_max - o->count_max / 4 : o->count_max;
    if (quota.upload_bytes)
        share->bytes = quota.upload_bytes < o->bytes_max ? quota.upload_bytes : o->bytes_max;
    if (quota.uploads)
        share->count = quota.uploads < o->count_max ? quota.uploads : o->count_max;
}

/* What one token has declared, with the mutex held. */
static uint64_t declared_by(const struct srv_uploads *uploads, const char *owner, unsigned *count) {
    uint64_t bytes = 0;
    *count = 0;
    for (const struct srv_upload *u = uploads->first; u; u = u->next)
        if (strcmp(u->owner, owner) == 0) {
            bytes += u->bytes;
            ++*count;
        }
    return bytes;
}

static uint64_t minus(uint64_t most, uint64_t used) {
    return most > used ? most - used : 0;
}

static bool fits_the_token(const struct srv_uploads *uploads, const char *owner,
                           const struct srv_uploads_share *share, uint64_t bytes,
                           struct sp_error *err) {
    unsigned count;
    uint64_t own = declared_by(uploads, owner, &count), left = minus(share->bytes, own);
    bool has_bytes = share->bytes < uploads->options.bytes_max; /* else fits_all() says it */
    bool has_count = share->count < uploads->options.count_max;
    const char *whose = share->is_quota ? "its quota upload-bytes" : "its share of --upload-bytes";
    if (has_bytes && bytes > share->bytes)
        return sp_fail(err, SP_ERR_TOO_LARGE, "/bytes",
                       "the file has %" PRIu64 " bytes and the token %s may upload %" PRIu64
                       " in all (%s)",
                       bytes, owner, share->bytes, whose);
    if (has_bytes && bytes > left)
        return sp_fail(err, SP_ERR_QUOTA, NULL,
                       "the file has %" PRIu64 " bytes; the token %s has uploads of %" PRIu64
                       " and may have %" PRIu64 " (%s), so %" PRIu64
                       " are free; close volumes that it uploaded or cancel uploads",
                       bytes, owner, own, share->bytes, whose, left);
    if (has_count && count >= share->count)
        return sp_fail(err, SP_ERR_QUOTA, NULL,
                       "the token %s has %u uploads and may have %u; close volumes that it "
                       "uploaded or cancel uploads",
                       owner, count, share->count);
    return true;
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
                         const struct srv_uploads_share *share, uint64_t bytes,
                         struct sp_error *err) {
    if (bytes > uploads->options.bytes_max)
        return sp_fail(err, SP_ERR_TOO_LARGE, "/bytes",
                       "the file has %" PRIu64 " bytes and --upload-bytes allows %" PRIu64, bytes,
                       uploads->options.bytes_max);
    return fits_the_token(uploads, owner, share, bytes, err) && fits_all(uploads, bytes, err);
}

void srv_uploads_numbers(struct srv_uploads *uploads, const char *owner,
                         struct srv_uploads_numbers *numbers) {
    const struct srv_uploads_options *o = &uploads->options;
    struct srv_uploads_share share;
    srv_uploads_share_of(uploads, owner, &share);
    pthread_mutex_lock(&uploads->mutex);
    *numbers = (struct srv_uploads_numbers){ .count = uploads->count,
                                             .declared_bytes = uploads->declared_bytes,
                                             .bytes_max = o->bytes_max,
                                             .own_count_max = share.count,
                                             .own_bytes_max = share.bytes };
    numbers->own_bytes = declared_by(uploads, owner, &numbers->own_count);
    for (const struct srv_upload *u = uploads->first; u; u = u->next)
        numbers->received_bytes += u->offset;
    pthread_mutex_unlock(&uploads->mutex);
    uint64_t own = minus(share.bytes, numbers->own_bytes);
    uint64_t all = minus(o->bytes_max, numbers->declared_bytes);
    uint64_t disk = srv_upload_files_free(uploads);
    numbers->free_bytes = own < all ? own : all;
    if (disk < numbers->free_bytes)
        numbers->free_bytes = disk;
    unsigned own_left = (unsigned)minus(share.count, numbers->own_count);
    unsigned all_left = (unsigned)minus(o->count_max, numbers->count);
    numbers->free_count = own_left < all_left ? own_left : all_left;
}
