/* SPDX-License-Identifier: Apache-2.0
 *
 * A camera path: keyframes of a view, and the view of every frame between them.
 *
 *   view ──patch──► key ──patch──► key ──► …        each patch is merged into what is there so far
 *   frame f ─► of each track the keys before and after f ─► blended (blend.h) ─► checked
 *
 * The members of a view are the tracks: "camera", "transfer_function", "filter", … A keyframe is a
 * key of the tracks that its patch names, and of no others: between them a track goes its own way.
 * The view itself is every track's key at frame 0; behind its last key a track holds still. Volume
 * and size are the same in all frames.
 *
 * Plain data, no threads: a path is constant once it was read.
 */
#ifndef SRV_PATHS_KEYFRAMES_H
#define SRV_PATHS_KEYFRAMES_H

#include <stdbool.h>
#include <stdint.h>

#include "protocol/json.h"
#include "sp/encode.h"
#include "sp/status.h"
#include "sp/view.h"

enum { SRV_KEYFRAMES_MAX = 256 };
#define SRV_PATH_FPS_MAX 240.0

struct srv_path_output {
    uint32_t frames;             /* [1, frames_max] */
    double fps;                  /* [1, SRV_PATH_FPS_MAX] */
    bool is_movie;               /* WebM (VP9); else a picture a frame */
    enum sp_image_format format; /* of pictures */
    int quality;                 /* [1, 100] */
};

struct srv_keyframes;

/* Reads {"frames", "fps"?, "format"?, "quality"?, "keyframes"}; other members are not looked at.
 * `view` is the path's view with its size, `defaults` what a null in a keyframe goes back to. NULL
 * with *err set: SP_ERR_INVALID with the JSON pointer of what is wrong, SP_ERR_MEMORY. */
struct srv_keyframes *srv_keyframes_read(const proto_json *json, const struct sp_view *view,
                                         const struct sp_view *defaults, uint32_t frames_max,
                                         struct sp_error *err);
void srv_keyframes_free(struct srv_keyframes **keyframes);

/* Lives as long as the path. */
const struct srv_path_output *srv_keyframes_output(const struct srv_keyframes *keyframes);
/* "png", "jpeg", "webp", "exr", "webm". */
const char *srv_path_format_name(const struct srv_path_output *output);
/* Key i with all that holds then, from 0 (the path's view); NULL past the end. */
const struct sp_view *srv_keyframes_key(const struct srv_keyframes *keyframes, unsigned i);

/* The view of one frame in [0, frames). False with *err set if what lies between two valid keys is
 * no valid view (SP_ERR_INVALID with the pointer into the view): an adaptive threshold against a
 * field of view that both move, coordinates near the largest double. */
bool srv_keyframes_view(const struct srv_keyframes *keyframes, uint32_t frame, struct sp_view *view,
                        struct sp_error *err);

#endif
