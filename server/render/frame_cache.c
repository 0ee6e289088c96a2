/* SPDX-License-Identifier: Apache-2.0
 *
 * The last sharp picture of a stream, for whoever wants the same: another session with this view,
 * or a still.
 */
#include <string.h>

#include "render/render_pool_private.h"

enum { BLOB_BYTES_MAX = 4 << 20 };

void srv_frame_cache_set(struct srv_render_pool *s, struct sp_frame *frame,
                         const struct srv_volume *volume, const struct sp_view *view) {
    pthread_mutex_lock(&s->mutex);
    sp_frame_unref(&s->kept.frame);
    for (unsigned i = 0; i < SRV_FRAME_CACHE_ENCODINGS; i++)
        srv_blob_unref(&s->kept.encoded[i].blob);
    if (frame) {
        s->kept.frame = sp_frame_ref(frame);
        s->kept.of = *srv_volume_fingerprint(volume);
        s->kept.view = *view;
    }
    pthread_mutex_unlock(&s->mutex);
}

struct sp_frame *srv_frame_cache_find(struct srv_render_pool *s, const struct srv_volume *volume,
                                      const struct sp_view *view) {
    pthread_mutex_lock(&s->mutex);
    bool same = s->kept.frame &&
                srv_fingerprint_equal(&s->kept.of, srv_volume_fingerprint(volume)) &&
                memcmp(&s->kept.view, view, sizeof *view) == 0;
    struct sp_frame *frame = same ? sp_frame_ref(s->kept.frame) : NULL;
    pthread_mutex_unlock(&s->mutex);
    return frame;
}

struct srv_blob *srv_frame_cache_bytes(struct srv_render_pool *s, const struct sp_frame *frame,
                                       const struct srv_encode_params *form) {
    struct srv_blob *found = NULL;
    pthread_mutex_lock(&s->mutex);
    for (unsigned i = 0; !found && frame == s->kept.frame && i < SRV_FRAME_CACHE_ENCODINGS; i++)
        if (s->kept.encoded[i].blob && srv_encode_params_equal(&s->kept.encoded[i].form, form))
            found = srv_blob_ref(s->kept.encoded[i].blob);
    pthread_mutex_unlock(&s->mutex);
    return found;
}

void srv_frame_cache_set_bytes(struct srv_render_pool *s, const struct sp_frame *frame,
                               const struct srv_encode_params *form, struct srv_blob *blob) {
    pthread_mutex_lock(&s->mutex);
    if (frame == s->kept.frame && blob->size <= BLOB_BYTES_MAX) {
        unsigned i = s->kept.next++ % SRV_FRAME_CACHE_ENCODINGS;
        srv_blob_unref(&s->kept.encoded[i].blob);
        s->kept.encoded[i].blob = srv_blob_ref(blob);
        s->kept.encoded[i].form = *form;
    }
    pthread_mutex_unlock(&s->mutex);
}
