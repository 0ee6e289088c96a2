/* SPDX-License-Identifier: Apache-2.0 */
#include "paths/keyframes.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "paths/blend.h"
#include "protocol/pointer.h"
#include "protocol/view.h"

enum track {
    TRACK_BACKGROUND,
    TRACK_CAMERA,
    TRACK_TRANSFER_FUNCTION,
    TRACK_FILTER,
    TRACK_COMPOSITING,
    TRACK_SHADING,
    TRACK_LAYERS,
    TRACK_CLIP,
    TRACK_EDITS,
    TRACK_QUALITY,
    TRACK_SLICES,
    TRACK_TIME,
    TRACKS
};
static const char *const track_names[TRACKS] = {
    "background", "camera", "transfer_function", "filter", "compositing", "shading", "layers",
    "clip",       "edits",  "quality",           "slices", "time",
};

/* How a track approaches a key. */
enum ease { EASE_LINEAR, EASE_SMOOTH, EASE_STEP, EASES };
static const char *const ease_names[EASES] = { "linear", "smooth", "step" };

struct key {
    double at;       /* position, in frames */
    unsigned tracks; /* bit set of enum track */
    enum ease ease;
    struct sp_view view; /* the complete view at this key */
};

struct srv_keyframes {
    struct srv_path_output output;
    unsigned count;
    struct key keys[]; /* keys[0] is the path's view: all tracks, at frame 0 */
};

#define FPS_DEFAULT 30.0
enum { QUALITY_DEFAULT = 90 };

static bool refuse_type(const char *place, const char *wanted, const proto_json *json,
                        struct sp_error *err) {
    return sp_fail(err, SP_ERR_INVALID, place, "must be %s, not %s", wanted,
                   proto_json_type_name(proto_json_type(json)));
}

static bool read_integer(const proto_json *json, const char *name, int64_t low, int64_t high,
                         int64_t *out, struct sp_error *err) {
    const proto_json *value = proto_json_get(json, name);
    char place[64];
    snprintf(place, sizeof place, "/%s", name);
    if (!value)
        return true;
    if (!proto_json_integer(value, out))
        return refuse_type(place, "a whole number", value, err);
    return (*out >= low && *out <= high) ||
           sp_fail(err, SP_ERR_INVALID, place, "%lld is outside [%lld, %lld]", (long long)*out,
                   (long long)low, (long long)high);
}

static bool read_format(const proto_json *json, struct srv_path_output *output,
                        struct sp_error *err) {
    const proto_json *value = proto_json_get(json, "format");
    const char *name = value ? proto_json_string(value) : "png";
    if (!name)
        return refuse_type("/format", "a string", value, err);
    output->is_movie = strcmp(name, "webm") == 0;
    for (int f = 0; f < SP_IMAGE_FORMAT_COUNT; f++) {
        output->format = (enum sp_image_format)f;
        if (output->is_movie || strcmp(name, sp_image_format_info(output->format)->name) == 0)
            return true;
    }
    return sp_fail(err, SP_ERR_INVALID, "/format",
                   "'%.32s' is not among the formats: png, jpeg, webp, exr, webm", name);
}

static bool read_output(const proto_json *json, uint32_t frames_max, struct srv_path_output *output,
                        struct sp_error *err) {
    int64_t frames = 0, quality = QUALITY_DEFAULT;
    const proto_json *fps = proto_json_get(json, "fps");
    output->fps = FPS_DEFAULT;
    if (!proto_json_get(json, "frames"))
        return sp_fail(err, SP_ERR_INVALID, "/frames", "is required");
    if (!read_integer(json, "frames", 1, frames_max, &frames, err) ||
        !read_integer(json, "quality", 1, 100, &quality, err))
        return false;
    if (fps && !proto_json_number(fps, &output->fps))
        return refuse_type("/fps", "a number", fps, err);
    if (!(output->fps >= 1 && output->fps <= SRV_PATH_FPS_MAX))
        return sp_fail(err, SP_ERR_INVALID, "/fps", "%g is outside [1, %g]", output->fps,
                       SRV_PATH_FPS_MAX);
    output->frames = (uint32_t)frames;
    output->quality = (int)quality;
    return read_format(json, output, err);
}

/* Reads one member of a keyframe other than its view. `place` is the pointer to the member. */
static bool read_member(const char *name, const proto_json *value, const char *place,
                        const struct srv_path_output *output, struct key *key,
                        struct sp_error *err) {
    bool is_time = strcmp(name, "time") == 0;
    if (is_time || strcmp(name, "frame") == 0) {
        double number, scale = is_time ? output->fps : 1;
        if (!proto_json_number(value, &number))
            return refuse_type(place, "a number", value, err);
        if (!(number >= 0 && number * scale <= output->frames))
            return sp_fail(err, SP_ERR_INVALID, place,
                           "%g is outside [0, %g], the length of the path", number,
                           output->frames / scale);
        if (key->at >= 0)
            return sp_fail(err, SP_ERR_INVALID, place, "give either time or frame, not both");
        key->at = number * scale;
        return true;
    }
    if (strcmp(name, "ease") != 0)
        return sp_fail(err, SP_ERR_INVALID, place,
                       "unknown member; a keyframe has time, frame, ease and view");
    const char *given = proto_json_string(value);
    for (int e = 0; e < EASES; e++)
        if (given && strcmp(given, ease_names[e]) == 0) {
            key->ease = (enum ease)e;
            return true;
        }
    return sp_fail(err, SP_ERR_INVALID, place, "must be one of linear, smooth, step");
}

/* Merges the patch of a keyframe into its view, which is a copy of the view before it. */
static bool read_view(const proto_json *patch, const char *place, const struct sp_view *defaults,
                      struct key *key, struct sp_error *err) {
    void *at = NULL;
    const char *name;
    const proto_json *value;
    while (proto_json_next(patch, &at, &name, &value)) {
        for (int t = 0; t < TRACKS; t++)
            if (strcmp(name, track_names[t]) == 0)
                key->tracks |= 1u << t;
        if (strcmp(name, "primitive") == 0) /* resets the layers */
            key->tracks |= 1u << TRACK_LAYERS;
        if (strcmp(name, "volume") == 0 || strcmp(name, "size") == 0) {
            char where[SP_ERROR_PLACE];
            snprintf(where, sizeof where, "%.200s/%s", place, name);
            return sp_fail(err, SP_ERR_INVALID, where, "is the same in all frames of a path");
        }
    }
    struct sp_error why;
    if (proto_view_apply(patch, defaults, &key->view, &why))
        return true;
    if (err) {
        *err = why;
        snprintf(err->place, sizeof err->place, "%.100s%.120s", place, why.place);
    }
    return false;
}

static bool read_key(const proto_json *json, unsigned i, const struct sp_view *defaults,
                     const struct srv_path_output *output, struct key *key, struct sp_error *err) {
    char place[SP_ERROR_PLACE];
    struct proto_pointer at = { .length = 0 };
    proto_pointer_push(&at, "keyframes", strlen("keyframes"));
    proto_pointer_push_index(&at, i);
    if (proto_json_type(json) != PROTO_JSON_OBJECT)
        return refuse_type(at.text, "an object", json, err);
    void *walk = NULL;
    const char *name;
    const proto_json *value;
    key->at = -1;
    while (proto_json_next(json, &walk, &name, &value)) {
        size_t length = at.length;
        proto_pointer_push(&at, name, strlen(name));
        if (strcmp(name, "view") != 0 && !read_member(name, value, at.text, output, key, err))
            return false;
        proto_pointer_pop(&at, length);
    }
    if (key->at < 0)
        return sp_fail(err, SP_ERR_INVALID, at.text, "needs either time or frame");
    if (key->at <= key[-1].at && i > 0)
        return sp_fail(err, SP_ERR_INVALID, at.text,
                       "is at frame %g, which is not after the previous keyframe (%g)", key->at,
                       key[-1].at);
    if (!proto_json_get(json, "view"))
        return sp_fail(err, SP_ERR_INVALID, at.text, "needs a view");
    snprintf(place, sizeof place, "%.200s/view", at.text);
    return read_view(proto_json_get(json, "view"), place, defaults, key, err);
}

/* Returns the last key of a track at or before a frame; *next is the one after it, NULL = none. */
static const struct key *find_key(const struct srv_keyframes *keyframes, enum track track,
                                  double frame, const struct key **next) {
    const struct key *last = &keyframes->keys[0];
    *next = NULL;
    for (unsigned i = 1; i < keyframes->count && !*next; i++) {
        const struct key *key = &keyframes->keys[i];
        if (!(key->tracks >> track & 1))
            continue;
        if (key->at <= frame)
            last = key;
        else
            *next = key;
    }
    return last;
}

/* Checks that every pair of neighbouring transfer functions can be blended. */
static bool check_points(const struct srv_keyframes *keyframes, struct sp_error *err) {
    for (unsigned i = 1; i < keyframes->count; i++) {
        const struct key *next, *key;
        unsigned points, gradient;
        key = find_key(keyframes, TRACK_TRANSFER_FUNCTION, keyframes->keys[i - 1].at, &next);
        if (next != &keyframes->keys[i] || next->ease == EASE_STEP)
            continue;
        srv_blend_count(&key->view.transfer_function, &next->view.transfer_function, &points,
                        &gradient);
        bool is_gradient = points <= SP_TF_POINTS_MAX;
        if (is_gradient && gradient <= SP_GRADIENT_POINTS_MAX)
            continue;
        char place[96];
        snprintf(place, sizeof place, "/keyframes/%u/view/transfer_function/%s", i - 1,
                 is_gradient ? "gradient" : "points");
        return sp_fail(
            err, SP_ERR_INVALID, place,
            "blending with the previous key needs %u points, and at most %d are possible; "
            "let the keys share some points, or use \"ease\": \"step\"",
            is_gradient ? gradient : points,
            is_gradient ? SP_GRADIENT_POINTS_MAX : SP_TF_POINTS_MAX);
    }
    return true;
}

static bool read_keys(const proto_json *list, const struct sp_view *defaults,
                      struct srv_keyframes *keyframes, struct sp_error *err) {
    for (unsigned i = 0; i < proto_json_size(list); i++) {
        struct key *key = &keyframes->keys[keyframes->count];
        key->view = key[-1].view;
        if (!read_key(proto_json_at(list, i), i, defaults, &keyframes->output, key, err))
            return false;
        keyframes->count++;
    }
    return check_points(keyframes, err);
}

struct srv_keyframes *srv_keyframes_read(const proto_json *json, const struct sp_view *view,
                                         const struct sp_view *defaults, uint32_t frames_max,
                                         struct sp_error *err) {
    struct srv_path_output output = { .frames = 0 };
    const proto_json *list = proto_json_get(json, "keyframes");
    size_t count = proto_json_size(list);
    if (!read_output(json, frames_max, &output, err))
        return NULL;
    if (proto_json_type(list) != PROTO_JSON_ARRAY) {
        refuse_type("/keyframes", "an array", list, err);
        return NULL;
    }
    if (count < 1 || count > SRV_KEYFRAMES_MAX) {
        sp_fail(err, SP_ERR_INVALID, "/keyframes", "%zu keyframes are outside [1, %d]", count,
                SRV_KEYFRAMES_MAX);
        return NULL;
    }
    struct srv_keyframes *keyframes =
        calloc(1, sizeof *keyframes + (count + 1) * sizeof keyframes->keys[0]);
    if (!keyframes) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while reading a camera path");
        return NULL;
    }
    keyframes->output = output;
    keyframes->count = 1;
    keyframes->keys[0].tracks = ~0u;
    keyframes->keys[0].view = *view;
    if (!read_keys(list, defaults, keyframes, err))
        srv_keyframes_free(&keyframes);
    return keyframes;
}

void srv_keyframes_free(struct srv_keyframes **keyframes) {
    free(*keyframes);
    *keyframes = NULL;
}

const struct srv_path_output *srv_keyframes_output(const struct srv_keyframes *keyframes) {
    return &keyframes->output;
}

const char *srv_path_format_name(const struct srv_path_output *output) {
    return output->is_movie ? "webm" : sp_image_format_info(output->format)->name;
}

const struct sp_view *srv_keyframes_key(const struct srv_keyframes *keyframes, unsigned i) {
    return i < keyframes->count ? &keyframes->keys[i].view : NULL;
}

/* Interpolation. */

static double eased(enum ease ease, double u) {
    return ease == EASE_STEP ? 0 : ease == EASE_SMOOTH ? u * u * (3 - 2 * u) : u;
}

static void blend(enum track track, const struct sp_view *a, const struct sp_view *b, double u,
                  struct sp_view *out) {
    switch (track) {
    case TRACK_BACKGROUND:
        srv_blend_background(a->background, b->background, u, out->background);
        break;
    case TRACK_CAMERA:
        srv_blend_camera(&a->camera, &b->camera, u, &out->camera);
        break;
    case TRACK_TRANSFER_FUNCTION:
        srv_blend_transfer_function(&a->transfer_function, &b->transfer_function, u,
                                    &out->transfer_function);
        break;
    case TRACK_FILTER:
        srv_blend_filter(&a->filter, &b->filter, u, &out->filter);
        break;
    case TRACK_COMPOSITING:
        srv_blend_compositing(&a->compositing, &b->compositing, u, &out->compositing);
        break;
    case TRACK_SHADING:
        srv_blend_shading(&a->shading, &b->shading, u, &out->shading);
        break;
    case TRACK_LAYERS:
        srv_blend_layers(a, b, u, out);
        break;
    case TRACK_CLIP:
        srv_blend_clip(&a->clip, &b->clip, u, &out->clip);
        break;
    case TRACK_EDITS:
        memcpy(out->edits, a->edits, sizeof out->edits);
        out->edit_count = a->edit_count;
        break;
    case TRACK_QUALITY:
        out->level_of_detail = a->level_of_detail;
        break;
    case TRACK_SLICES:
        srv_blend_slices(&a->slices, &b->slices, u, &out->slices);
        break;
    case TRACK_TIME:
        srv_blend_time(&a->time, &b->time, u, &out->time);
        break;
    case TRACKS:
        break;
    }
}

bool srv_keyframes_view(const struct srv_keyframes *keyframes, uint32_t frame, struct sp_view *view,
                        struct sp_error *err) {
    memcpy(view, &keyframes->keys[0].view, sizeof *view);
    for (int t = 0; t < TRACKS; t++) {
        const struct key *b, *a = find_key(keyframes, (enum track)t, frame, &b);
        double u = b ? eased(b->ease, (frame - a->at) / (b->at - a->at)) : 0;
        blend((enum track)t, &a->view, b ? &b->view : &a->view, u, view);
    }
    return sp_view_validate(view, err);
}
