/* SPDX-License-Identifier: Apache-2.0 */
#include "render/frame_cache.h"

#include <string.h>

enum { BLOB_BYTES_MAX = 4 << 20 };
#define FRAME_BYTES_MAX ((size_t)64 << 20)

void srv_frame_cache_init(struct srv_frame_cache *cache) {
    memset(cache, 0, sizeof *cache);
    pthread_mutex_init(&cache->mutex, NULL);
}

void srv_frame_cache_finish(struct srv_frame_cache *cache) {
    srv_frame_cache_clear(cache);
    pthread_mutex_destroy(&cache->mutex);
}

/* With the mutex held. */
static void clear_bytes(struct srv_frame_cache *cache) {
    for (unsigned i = 0; i < SRV_FRAME_CACHE_ENCODINGS; i++)
        srv_blob_unref(&cache->encodings[i].blob);
}

/* With the mutex held. */
static void clear(struct srv_frame_cache *cache) {
    sp_frame_unref(&cache->frame);
    clear_bytes(cache);
}

void srv_frame_cache_clear(struct srv_frame_cache *cache) {
    pthread_mutex_lock(&cache->mutex);
    clear(cache);
    pthread_mutex_unlock(&cache->mutex);
}

void srv_frame_cache_clear_bytes(struct srv_frame_cache *cache) {
    pthread_mutex_lock(&cache->mutex);
    clear_bytes(cache);
    pthread_mutex_unlock(&cache->mutex);
}

void srv_frame_cache_put(struct srv_frame_cache *cache, struct sp_frame *frame,
                         const struct srv_fingerprint *content, const struct sp_view *view,
                         bool wants_depth) {
    const size_t row = frame->stride_bytes + 2 * frame->depth_stride_bytes;
    if (row * frame->height > FRAME_BYTES_MAX)
        return;
    pthread_mutex_lock(&cache->mutex);
    clear(cache);
    cache->frame = sp_frame_ref(frame);
    cache->wants_depth = wants_depth;
    cache->content = *content;
    cache->view = *view;
    pthread_mutex_unlock(&cache->mutex);
}

struct sp_frame *srv_frame_cache_find(struct srv_frame_cache *cache,
                                      const struct srv_fingerprint *content,
                                      const struct sp_view *view, bool wants_depth) {
    pthread_mutex_lock(&cache->mutex);
    bool is_same = cache->frame && cache->wants_depth >= wants_depth &&
                   srv_fingerprint_equal(&cache->content, content) &&
                   sp_view_equal(&cache->view, view);
    struct sp_frame *frame = is_same ? sp_frame_ref(cache->frame) : NULL;
    pthread_mutex_unlock(&cache->mutex);
    return frame;
}

struct srv_blob *srv_frame_cache_find_bytes(struct srv_frame_cache *cache,
                                            const struct sp_frame *frame,
                                            const struct srv_encode_params *params) {
    struct srv_blob *found = NULL;
    pthread_mutex_lock(&cache->mutex);
    for (unsigned i = 0; !found && frame == cache->frame && i < SRV_FRAME_CACHE_ENCODINGS; i++)
        if (cache->encodings[i].blob &&
            srv_encode_params_equal(&cache->encodings[i].params, params))
            found = srv_blob_ref(cache->encodings[i].blob);
    pthread_mutex_unlock(&cache->mutex);
    return found;
}

void srv_frame_cache_put_bytes(struct srv_frame_cache *cache, const struct sp_frame *frame,
                               const struct srv_encode_params *params, struct srv_blob *blob) {
    pthread_mutex_lock(&cache->mutex);
    if (frame == cache->frame && blob->size <= BLOB_BYTES_MAX) {
        unsigned i = cache->next++ % SRV_FRAME_CACHE_ENCODINGS;
        srv_blob_unref(&cache->encodings[i].blob);
        cache->encodings[i].blob = srv_blob_ref(blob);
        cache->encodings[i].params = *params;
    }
    pthread_mutex_unlock(&cache->mutex);
}
