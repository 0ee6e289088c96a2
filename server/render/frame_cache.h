/* SPDX-License-Identifier: Apache-2.0
 *
 * The frame cache: the last final frame that was rendered for a session (full size, all voxels),
 * and its bytes in the encodings that clients received last. A session or a snapshot that wants the
 * same view of the same volume uses the frame instead of rendering it, and the bytes instead of
 * encoding it. All functions are thread-safe.
 */
#ifndef SRV_RENDER_FRAME_CACHE_H
#define SRV_RENDER_FRAME_CACHE_H

#include <pthread.h>
#include <stdbool.h>

#include "render/catalog.h"
#include "render/fingerprint.h"
#include "session/blob.h"
#include "session/encode_params.h"
#include "sp/frame.h"

enum { SRV_FRAME_CACHE_ENCODINGS = 4 };

struct srv_frame_cache {
    pthread_mutex_t mutex;          /* guards what follows */
    struct sp_frame *frame;         /* a reference; NULL = the cache is empty */
    bool wants_depth;               /* it was drawn with depth, if its view has one */
    struct srv_fingerprint content; /* of the volumes that the view shows */
    struct sp_view view;
    struct {
        struct srv_encode_params params;
        struct srv_blob *blob; /* a reference; NULL = unused */
    } encodings[SRV_FRAME_CACHE_ENCODINGS];
    unsigned next; /* the encoding to replace next, modulo their number */
};

/* The memory of the frame and the encodings counts for the pools that they come from. */
void srv_frame_cache_init(struct srv_frame_cache *cache);
void srv_frame_cache_finish(struct srv_frame_cache *cache);

/* Replaces the cached frame; `content` is srv_catalog_fingerprint(). Takes a reference of its own.
 * wants_depth: the frame was drawn with this option. Frames over 64 MiB are not cached. */
void srv_frame_cache_put(struct srv_frame_cache *cache, struct sp_frame *frame,
                         const struct srv_fingerprint *content, const struct sp_view *view,
                         bool wants_depth);
void srv_frame_cache_clear(struct srv_frame_cache *cache);
/* Releases the encodings and keeps the frame. */
void srv_frame_cache_clear_bytes(struct srv_frame_cache *cache);
/* Returns a reference that the caller owns, or NULL if the cached frame shows something else or was
 * drawn without the depth that is wanted. */
struct sp_frame *srv_frame_cache_find(struct srv_frame_cache *cache,
                                      const struct srv_fingerprint *content,
                                      const struct sp_view *view, bool wants_depth);

/* Returns the bytes of the frame with these parameters: a reference that the caller owns. NULL if
 * they are not cached. */
struct srv_blob *srv_frame_cache_find_bytes(struct srv_frame_cache *cache,
                                            const struct sp_frame *frame,
                                            const struct srv_encode_params *params);
/* Caches the bytes if `frame` is the cached frame and they are at most 4 MiB. Takes a reference of
 * its own. */
void srv_frame_cache_put_bytes(struct srv_frame_cache *cache, const struct sp_frame *frame,
                               const struct srv_encode_params *params, struct srv_blob *blob);

#endif
