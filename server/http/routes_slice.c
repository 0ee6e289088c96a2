/* SPDX-License-Identifier: Apache-2.0
 *
 * Slices of a volume, and of the volume that a session shows, for clients that have nothing but a
 * join token. The sampling thread makes them: up to a second for the largest, SP_SLICE_SIDE_MAX.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "http/headers.h"
#include "http/routes.h"
#include "http/slice_query.h"
#include "protocol/view.h"
#include "render/frame_memory.h"
#include "sp/bricks.h"

enum {
    JPEG_QUALITY = 90,
    ETAG_TEXT = SRV_FINGERPRINT_TEXT + 2,
    SLICES_MAX = 256 /* that wait */
};

struct slice_request {
    struct srv_slice_query query;
    struct sp_slice slice;
    struct sp_volume_info info; /* of the volume, as of the level */
    struct sp_volume *volume;   /* borrowed */
    struct sp_volume *samples;  /* the part of `volume` that the slice needs; a reference */
    unsigned level, got;        /* asked for; of the samples */
    const char *id;             /* of the volume; it needs no escapes, see srv_source_is_id() */
    const proto_json *session;  /* the view of the session; NULL = the volume's default view */
    const struct sp_transfer_function *colors; /* NULL = grey */
};

static const char *get_query(void *user, const char *name) {
    return srv_request_query(user, name);
}

/* Replies with the parameter that is wrong. */
static void reply_refused(struct srv_reply *reply, const struct sp_error *err) {
    srv_reply_problem(reply, srv_status_from(err->code), NULL, "?%.20s=: %s", err->place,
                      err->text);
}

/* The ETag covers all that determines the bytes. */
static void make_etag(const struct srv_request *request, const struct slice_request *wanted,
                      const struct srv_fingerprint *volume, char etag[ETAG_TEXT]) {
    char digits[SRV_FINGERPRINT_TEXT];
    const struct sp_slice *s = &wanted->slice;
    const int32_t format = (int32_t)wanted->query.format;
    const struct sp_transfer_function *colors = wanted->colors;
    const struct srv_piece pieces[] = {
        { &request->app->program, sizeof request->app->program },
        { volume, sizeof *volume },
        { s->size, sizeof s->size },
        { s->grid_origin, sizeof s->grid_origin },
        { s->grid_step, sizeof s->grid_step },
        { wanted->query.window, sizeof wanted->query.window },
        { &format, sizeof format },
        { colors ? colors->points : NULL,
          colors ? colors->point_count * sizeof *colors->points : 0 },
    };
    struct srv_fingerprint all = srv_fingerprint_of(pieces, sizeof pieces / sizeof *pieces);
    srv_fingerprint_encode(&all, digits);
    snprintf(etag, ETAG_TEXT, "\"%s\"", digits);
}

/* Says in JSON where the pixels lie and what they are. */
static void describe(struct srv_reply *reply, const struct slice_request *wanted) {
    const struct sp_slice *s = &wanted->slice;
    const double *right = s->step[0], *down = s->step[1], *window = wanted->query.window;
    srv_reply_header(
        reply, "X-Slice",
        "{\"volume\":\"%s\",\"shape\":[%u,%u],\"type\":\"%s\",\"endianness\":\"little\","
        "\"origin\":[%.12g,%.12g,%.12g],\"step_x\":[%.12g,%.12g,%.12g],"
        "\"step_y\":[%.12g,%.12g,%.12g],\"window\":[%.9g,%.9g]}",
        wanted->id, s->size[0], s->size[1], sp_type_name(s->type), s->origin[0], s->origin[1],
        s->origin[2], right[0], right[1], right[2], down[0], down[1], down[2], window[0],
        window[1]);
}

static void set_headers(struct srv_reply *reply, const struct slice_request *wanted,
                        const char *etag) {
    const bool is_complete = wanted->got <= wanted->level;
    if (is_complete)
        srv_reply_header(reply, "ETag", "%s", etag);
    srv_reply_header(reply, "Cache-Control", is_complete ? "private, no-cache" : "no-store");
    srv_reply_header(reply, "X-Complete", "%s", is_complete ? "true" : "false");
    srv_reply_header(reply, "X-Level", "%u", wanted->got);
    describe(reply, wanted);
}

/* Returns the memory of the answer while it is made. */
static uint64_t bytes_of(const struct slice_request *wanted) {
    const struct sp_slice *s = &wanted->slice;
    const enum srv_slice_format format = wanted->query.format;
    return format == SRV_SLICE_RAW
               ? (uint64_t)s->size[0] * s->size[1] * sp_type_size(s->type)
               : srv_frame_memory_of(format == SRV_SLICE_PNG ? SP_IMAGE_PNG : SP_IMAGE_JPEG,
                                     s->size);
}

/* Samples the values into the reply. */
static bool write_raw(const struct slice_request *wanted, struct srv_reply *reply,
                      struct sp_error *err) {
    const struct sp_slice *s = &wanted->slice;
    size_t size = (size_t)s->size[0] * s->size[1] * sp_type_size(s->type);
    void *values = malloc(size);
    if (!values)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a slice of %zu bytes", size);
    sp_slice_sample(wanted->samples, s, values);
    reply->body = reply->owned = values;
    reply->size = size;
    reply->mime = "application/octet-stream";
    return true;
}

/* Draws and encodes the slice, and copies the file into the reply. */
static bool write_image(const struct slice_request *wanted, struct srv_reply *reply,
                        struct sp_error *err) {
    const enum sp_image_format format =
        wanted->query.format == SRV_SLICE_PNG ? SP_IMAGE_PNG : SP_IMAGE_JPEG;
    const uint32_t *px = wanted->slice.size;
    const uint8_t *bytes = NULL;
    size_t size = 0;
    struct sp_frame_pool *pool = sp_frame_pool_create(0, err);
    struct sp_frame *frame = pool ? sp_frame_create(pool, px[0], px[1], SP_RGBA8, err) : NULL;
    struct sp_encoder *encoder = frame ? sp_encoder_create(err) : NULL;
    bool ok = false;
    if (encoder) {
        sp_slice_draw(wanted->samples, &wanted->slice, wanted->query.window, wanted->colors, frame);
        ok = sp_encode(encoder, frame, format, JPEG_QUALITY, &bytes, &size, err);
    }
    void *copy = ok ? malloc(size) : NULL;
    if (copy) {
        reply->body = reply->owned = memcpy(copy, bytes, size);
        reply->size = size;
        reply->mime = sp_image_format_info(format)->mime;
    } else if (ok) {
        ok = sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a slice of %zu bytes", size);
    }
    sp_encoder_destroy(&encoder);
    sp_frame_unref(&frame);
    sp_frame_pool_destroy(&pool);
    return ok;
}

/* Resolves the slice in the volume's own samples, or in the samples of the level that it asks for.
 */
static bool resolve(struct slice_request *wanted, struct sp_volume_info *info,
                    struct sp_error *err) {
    const struct srv_slice_query *query = &wanted->query;
    wanted->level = sp_bricks_base(wanted->volume);
    if (query->is_oblique && info->whole.dims[0]) {
        const double *s = info->whole.spacing;
        const double finest = fmin(s[0], fmin(s[1], s[2]));
        const double spacing = query->plane.spacing > 0 ? query->plane.spacing : finest;
        wanted->level = sp_bricks_level(wanted->volume, spacing);
    } else if (query->has_level) {
        wanted->level = query->level;
    }
    return (sp_bricks_describe(wanted->volume, wanted->level, info) ||
            sp_fail(err, SP_ERR_INVALID, "level", "the volume has no level %u", wanted->level)) &&
           srv_slice_query_resolve(query, info, &wanted->slice, err);
}

/* Gets the samples of the slice, wanted->samples, which the caller unrefs. Of a volume that is
 * larger than memory, its bricks are read. */
static bool read_samples(struct slice_request *wanted, struct sp_error *err) {
    enum { READ_MS = 10000 };
    struct sp_slice *s = &wanted->slice;
    double corners[4][3];
    for (int i = 0; i < 4; i++)
        for (int r = 0; r < 3; r++)
            corners[i][r] = s->origin[r] + (i & 1 ? s->step[0][r] * (s->size[0] - 1) : 0) +
                            (i & 2 ? s->step[1][r] * (s->size[1] - 1) : 0);
    wanted->got = wanted->level;
    wanted->samples = sp_bricks_around(wanted->volume, (const double(*)[3])corners, 4, READ_MS,
                                       &wanted->got, err);
    if (!wanted->samples)
        return false;
    if (wanted->got != wanted->level && s->type < SP_FLOAT32) /* pixels lie between samples */
        s->type = SP_FLOAT32;
    sp_slice_move(s, sp_volume_info(wanted->samples));
    return true;
}

/* Answers from a volume in use. */
static void reply_from(struct srv_request *request, struct slice_request *wanted,
                       const struct srv_fingerprint *fingerprint, struct srv_reply *reply) {
    struct sp_error err;
    char etag[ETAG_TEXT];
    struct sp_volume_info *info = &wanted->info;
    *info = *sp_volume_info(wanted->volume);
    if (info->elements.kind != SP_KIND_GRID) {
        sp_fail(&err, SP_ERR_INVALID, NULL, "slices need a grid of samples, and this volume has %s",
                sp_kind_name(info->elements.kind));
        srv_reply_error(reply, &err);
        return;
    }
    if (!resolve(wanted, info, &err)) {
        reply_refused(reply, &err);
        return;
    }
    if (!(wanted->query.window[1] > 0))
        sp_slice_default_window(info, wanted->query.window);
    make_etag(request, wanted, fingerprint, etag);
    if (srv_header_has_etag(srv_request_header(request, "If-None-Match"), etag)) {
        reply->status = 304;
        wanted->got = wanted->level;
        set_headers(reply, wanted, etag);
        return;
    }
    bool ok = read_samples(wanted, &err) &&
              srv_request_reserve_answer(request, bytes_of(wanted), &err) &&
              (wanted->query.format == SRV_SLICE_RAW ? write_raw(wanted, reply, &err)
                                                     : write_image(wanted, reply, &err));
    sp_volume_unref(&wanted->samples);
    if (!ok) {
        srv_reply_error(reply, &err);
        return;
    }
    reply->status = 200;
    set_headers(reply, wanted, etag);
}

/* Answers from a volume in use, in the colours of a view. */
static void reply_colored(struct srv_request *request, struct slice_request *wanted,
                          struct srv_volume *volume, struct srv_reply *reply) {
    struct sp_error err;
    struct sp_view defaults, view;
    srv_catalog_default_view(request->app->catalog, volume, &defaults);
    memcpy(&view, &defaults, sizeof view);
    if (wanted->session && !proto_view_apply(wanted->session, &defaults, &view, &err)) {
        srv_reply_error(reply, &err);
        return;
    }
    wanted->colors = &view.transfer_function;
    reply_from(request, wanted, srv_volume_fingerprint(volume), reply);
}

/* True if the view of a session has a layer that shows this volume as a channel. */
static bool has_channel(const proto_json *session, const char *id) {
    const proto_json *layers = proto_json_get(session, "layers");
    for (size_t i = 0; i < proto_json_size(layers); i++) {
        const proto_json *layer = proto_json_at(layers, i);
        const char *type = proto_json_string(proto_json_get(layer, "type"));
        const char *own = proto_json_string(proto_json_get(layer, "id"));
        if (type && own && strcmp(type, "channel") == 0 && strcmp(own, id) == 0)
            return true;
    }
    return false;
}

/* `session`: the view of the session. */
static void reply_slice(struct srv_request *request, const char *id, const proto_json *session,
                        struct srv_reply *reply) {
    struct sp_error err;
    struct slice_request wanted = { .session = session };
    if (!srv_slice_query_read(&wanted.query, get_query, request, &err)) {
        reply_refused(reply, &err);
        return;
    }
    const char *channel = session ? srv_request_query(request, "channel") : NULL;
    if (channel && !has_channel(session, channel)) {
        srv_reply_problem(reply, 404, NULL, "channel: the view has no channel \"%.60s\"", channel);
        return;
    }
    wanted.id = channel ? channel : id;
    struct srv_volume *volume = srv_acquire_step(request, wanted.id, session, reply);
    if (!volume)
        return;
    wanted.volume = srv_volume_voxels(volume);
    if (wanted.query.is_colored && wanted.query.format != SRV_SLICE_RAW)
        reply_colored(request, &wanted, volume, reply);
    else
        reply_from(request, &wanted, srv_volume_fingerprint(volume), reply);
    srv_catalog_release(request->app->catalog, volume);
}

static void make_slice(struct srv_request *request, struct srv_reply *reply) {
    srv_reply_for_volume(request, reply_slice, reply);
}

void srv_get_slice(struct srv_request *request, struct srv_reply *reply) {
    (void)reply;
    srv_request_handle_later(request, request->app->sampling, SLICES_MAX, "slices", make_slice);
}
