/* SPDX-License-Identifier: Apache-2.0
 *
 * A camera path: keyframes of a view, and the view of every frame between them.
 *
 *   view ──patch──► key ──patch──► key ──► …        each patch is merged into the view before it
 *   frame f ─► of each track the keys before and after f ─► blended (blend.h) ─► checked
 *
 * The members of a view are its tracks: "camera", "transfer_function", "filter", … A keyframe is a
 * key of the tracks that its patch names, and of no others: each track is interpolated between its
 * own keys. The view of the path is the key of every track at frame 0. After its last key a track
 * stays constant. Volume and size are the same in all frames.
 *
 * Plain data without locks: keyframes are constant once they have been read.
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
    bool is_movie;               /* true = a WebM file (VP9); false = one image per frame */
    enum sp_image_format format; /* of images */
    int quality;                 /* [1, 100] */
    bool is_sealed;              /* each file must have a seal (folder.h) */
};

struct srv_keyframes;

/* Reads {"frames", "fps"?, "format"?, "quality"?, "keyframes"} and ignores other members. `view` is
 * the path's view with its size; `defaults` has the values that a null in a keyframe restores. NULL
 * with *err set: SP_ERR_INVALID with the JSON pointer of what is wrong, SP_ERR_MEMORY. */
struct srv_keyframes *srv_keyframes_read(const proto_json *json, const struct sp_view *view,
                                         const struct sp_view *defaults, uint32_t frames_max,
                                         struct sp_error *err);
void srv_keyframes_free(struct srv_keyframes **keyframes);

/* Valid as long as the keyframes. */
const struct srv_path_output *srv_keyframes_output(const struct srv_keyframes *keyframes);
/* "png", "jpeg", "webp", "exr", "webm". */
const char *srv_path_format_name(const struct srv_path_output *output);
/* Returns the complete view at key i, from 0 (the path's view); NULL past the end. */
const struct sp_view *srv_keyframes_key(const struct srv_keyframes *keyframes, unsigned i);

/* Interpolates the view of one frame in [0, frames). False if the view between two valid keys is
 * not valid (SP_ERR_INVALID with a pointer into the view). This happens, for example, if an
 * adaptive threshold and the field of view both change, or with coordinates near the largest
 * double. */
bool srv_keyframes_view(const struct srv_keyframes *keyframes, uint32_t frame, struct sp_view *view,
                        struct sp_error *err);

#endif
