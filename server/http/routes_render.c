/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "http/chunked_body.h"
#include "http/deadlines.h"
#include "http/headers.h"
#include "http/routes.h"
#include "http/saved_views.h"
#include "protocol/view.h"
#include "session/encode_params.h"
#include "sp/log.h"

enum { QUALITY_DEFAULT = 90, ETAG_BYTES = 40 };

/* Returns the format of ?format=, or else of Accept, or else JPEG. SP_IMAGE_FORMAT_COUNT: the reply
 * is a problem document. */
static enum sp_image_format choose_format(struct srv_request *request, struct srv_reply *reply) {
    const char *name = srv_request_query(request, "format");
    const char *accept = srv_request_header(request, "Accept");
    enum sp_image_format best = SP_IMAGE_FORMAT_COUNT;
    double best_quality = 0;
    if (name) {
        best = sp_image_format_find(name);
    } else {
        for (int f = 0; f < SP_IMAGE_FORMAT_COUNT; f++) {
            double q = srv_header_accept_quality(
                accept, sp_image_format_info((enum sp_image_format)f)->mime);
            if (q > best_quality) {
                best = (enum sp_image_format)f;
                best_quality = q;
            }
        }
    }
    if (best == SP_IMAGE_FORMAT_COUNT)
        srv_reply_problem(reply, 406, NULL,
                          "unknown image format; choose image/jpeg, image/png, image/webp or "
                          "image/x-exr (?format=jpeg, png, webp, exr)");
    return best;
}

static bool read_quality(struct srv_request *request, int *quality, struct srv_reply *reply) {
    const char *text = srv_request_query(request, "quality");
    *quality = QUALITY_DEFAULT;
    if (!text)
        return true;
    unsigned value;
    if (srv_query_number(text, 100, &value)) {
        *quality = (int)value;
        return true;
    }
    srv_reply_problem(reply, 400, NULL, "?quality= must be a whole number in [1, 100]");
    return false;
}

static bool read_chroma(struct srv_request *request, enum sp_chroma *chroma,
                        struct srv_reply *reply) {
    const char *name = srv_request_query(request, "subsampling");
    *chroma = name ? sp_chroma_find(name) : SP_CHROMA_AUTO;
    if (*chroma != SP_CHROMA_COUNT)
        return true;
    srv_reply_problem(reply, 400, NULL, "?subsampling= must be auto, 4:4:4, 4:2:2 or 4:2:0");
    return false;
}

static struct srv_piece piece_of(const char *text) {
    return (struct srv_piece){ text, strlen(text) };
}

/* Fingerprint of all renderers, because it is not known in advance which one renders the snapshot.
 */
static struct srv_fingerprint of_renderers(struct srv_render_pool *render_pool) {
    enum { PIECES = 3 };
    struct sp_renderer_info info[SRV_RENDERERS];
    struct srv_piece pieces[SRV_RENDERERS * PIECES];
    srv_render_pool_info(render_pool, info);
    for (int l = 0; l < SRV_RENDERERS; l++) {
        if (!info[l].backend) /* not started yet; it will start like the first one */
            info[l] = info[0];
        pieces[PIECES * l] = piece_of(info[l].backend);
        pieces[PIECES * l + 1] = piece_of(info[l].isa);
        pieces[PIECES * l + 2] = piece_of(info[l].device);
    }
    return srv_fingerprint_of(pieces, SRV_RENDERERS * PIECES);
}

/* Computes the ETag from everything that determines the bytes: program, renderers, volume, view and
 * encode parameters. False when out of memory. */
static bool make_etag(const struct srv_request *request, const struct srv_snapshot *snapshot,
                      char etag[ETAG_BYTES]) {
    const struct srv_http_options *app = request->app;
    char digits[SRV_FINGERPRINT_TEXT];
    size_t size;
    proto_json *json = proto_view_encode(&snapshot->view);
    char *text = proto_json_to_canonical(json, &size);
    proto_json_free(&json);
    if (!text)
        return false;
    struct srv_encode_params like =
        srv_encode_params_from(snapshot->format, snapshot->quality, snapshot->chroma);
    int32_t params[3] = { (int32_t)like.format, like.quality, (int32_t)like.chroma };
    struct srv_fingerprint renderers = of_renderers(app->render_pool);
    const struct srv_fingerprint content =
        srv_catalog_fingerprint(app->catalog, snapshot->volume, &snapshot->view);
    const struct srv_piece pieces[] = {
        { &app->program, sizeof app->program },
        { &renderers, sizeof renderers },
        { &content, sizeof content },
        { params, sizeof params },
        { text, size },
    };
    struct srv_fingerprint all = srv_fingerprint_of(pieces, sizeof pieces / sizeof *pieces);
    free(text);
    srv_fingerprint_encode(&all, digits);
    snprintf(etag, ETAG_BYTES, "\"%s\"", digits);
    return true;
}

struct render { /* one suspended request */
    struct srv_request *request;
    enum sp_image_format format;
    char *camera; /* JSON */
    char etag[ETAG_BYTES];
    const char *caching; /* constant */
    bool is_kept;        /* the view is a saved view, or the view of a session */
};

static void free_render(struct render *render) {
    if (render)
        free(render->camera);
    free(render);
}

/* Returns the camera of the view as JSON; NULL = out of memory. The caller frees it. */
static char *camera_of(const struct sp_view *view) {
    proto_json *json = proto_view_encode(view);
    char *text = proto_json_to_text(proto_json_get(json, "camera"), NULL);
    proto_json_free(&json);
    return text;
}

/* Answers the error of a view. A request for a view that the daemon keeps does not name its
 * volumes: they must be loaded first, hence 409. */
static void reply_view_error(struct srv_reply *reply, bool is_kept, const struct sp_error *err) {
    if (is_kept && (err->code == SP_ERR_VOLUME_UNKNOWN || err->code == SP_ERR_NOT_READY ||
                    err->code == SP_ERR_VOLUME_FAILED))
        srv_reply_problem(reply, 409, NULL, "%s", err->text);
    else
        srv_reply_view_error(reply, "", err);
}

static void set_caching(struct srv_reply *reply, const char *etag, const char *caching) {
    srv_reply_header(reply, "ETag", "%s", etag);
    srv_reply_header(reply, "Cache-Control", "%s", caching);
    srv_reply_header(reply, "Vary", "Accept");
}

struct image_body { /* an image that is being sent */
    struct srv_request *request;
    size_t size, at;
    uint8_t bytes[];
};

/* Ends the snapshot with the last block, before the client has the whole image: the client may
 * request the next one at once. */
static ssize_t read_image(void *user, char *bytes, size_t size) {
    struct image_body *image = user;
    const size_t left = image->size - image->at, n = left < size ? left : size;
    memcpy(bytes, image->bytes + image->at, n);
    image->at += n;
    if (image->at == image->size)
        srv_request_end_snapshot(image->request);
    return (ssize_t)n;
}

static void reply_image(struct srv_request *request, const struct srv_snapshot_result *result) {
    struct image_body *image = malloc(sizeof *image + result->size);
    const struct srv_chunked_body body = { image, read_image, free, .has_one_deadline = true };
    if (!image) {
        srv_reply_problem(&request->reply, 503, NULL, "out of memory for an image of %zu bytes",
                          result->size);
        return;
    }
    *image = (struct image_body){ .request = request, .size = result->size };
    memcpy(image->bytes, result->bytes, result->size);
    srv_reply_chunked_body(request, &request->reply, result->size, &body);
}

/* Sets the headers about the bricks that an image shows; without bricks the counts are 0. */
static void set_bricks(struct srv_reply *reply, const struct sp_frame_bricks *bricks) {
    const bool is_complete = sp_frame_bricks_is_complete(bricks);
    srv_reply_header(reply, "X-Complete", "%s", is_complete ? "true" : "false");
    srv_reply_header(reply, "X-Level", "%u", bricks->level);
    srv_reply_header(reply, "X-Level-Asked", "%u", bricks->asked);
    srv_reply_header(reply, "X-Bricks-Lost", "%" PRIu64, bricks->lost);
}

static void on_done(void *user, const struct srv_snapshot_result *result) {
    struct render *render = user;
    struct srv_request *request = render->request;
    struct srv_reply *reply = &request->reply;
    struct sp_error err;
    if (!result->ok) {
        if (result->err.code == SP_ERR_CANCELLED)
            sp_log(SP_LOG_INFO, "snapshot for %s not rendered: %s",
                   srv_connection_peer(request->connection), result->err.text);
        /* The view exceeds the memory of the renderer or of frames: a retry does not help, but
         * another view may. Hence 422, not 503. */
        if (result->err.code == SP_ERR_BUDGET)
            srv_reply_problem(reply, 422, result->err.place, "%s", result->err.text);
        else
            reply_view_error(reply, render->is_kept, &result->err);
    } else if (srv_request_count_answer(request, result->size, &err)) {
        reply_image(request, result);
    } else {
        srv_reply_error(reply, &err);
    }
    if (reply->chunked_body) {
        reply->status = 200;
        reply->mime = sp_image_format_info(render->format)->mime;
        if (sp_frame_bricks_is_complete(&result->stats.bricks))
            set_caching(reply, render->etag, render->caching);
        else
            srv_reply_header(reply, "Cache-Control", "no-store");
        set_bricks(reply, &result->stats.bricks);
        srv_reply_header(reply, "X-Render-Time", "%.3f", result->stats.render_ms);
        srv_reply_header(reply, "X-Encode-Time", "%.3f", result->encode_ms);
        srv_reply_header(reply, "X-Backend", "%s%s%s", result->stats.backend,
                         result->stats.isa[0] ? " " : "", result->stats.isa);
        srv_reply_header(reply, "X-Camera", "%s", render->camera);
        srv_reply_header(reply, "X-Splats", "%" PRIu64, result->stats.splats);
    }
    free_render(render);
    srv_request_complete(request);
}

/* True if the client has left. The connection of a suspended request stays open until it is
 * completed. */
static bool is_gone(void *user) {
    const struct render *render = user;
    return srv_connection_is_gone(render->request->connection);
}

/* Sets the owner in the fair queue: the name of the token. Without a name, all clients share one
 * token, and the owner is the host. */
static void set_owner(const struct srv_request *request, struct srv_snapshot *snapshot) {
    struct srv_owner owner;
    srv_request_owner(request, &owner);
    snapshot->is_limited = owner.quota.is_limited || !request->grant.rights || owner.name[0] == 0;
    if (owner.name[0])
        snprintf(snapshot->owner, sizeof snapshot->owner, "%s", owner.name);
    else
        srv_address_to_host((const struct sockaddr *)srv_connection_address(request->connection),
                            snapshot->owner);
}

/* Suspends the request and queues its snapshot. Takes over the use of the volume. */
static void submit(struct srv_request *request, struct srv_snapshot *snapshot, bool is_kept,
                   const char *etag, const char *caching, struct srv_reply *reply) {
    struct sp_error err;
    struct render *render = calloc(1, sizeof *render);
    const bool is_made = render && (render->camera = camera_of(&snapshot->view));
    if (!is_made)
        sp_fail(&err, SP_ERR_MEMORY, NULL, "out of memory for a render request");
    if (!is_made || !srv_request_begin_snapshot(request, &err)) {
        srv_catalog_release(request->app->catalog, snapshot->volume);
        srv_reply_error(reply, &err);
        free_render(render);
        return;
    }
    render->request = request;
    render->format = snapshot->format;
    render->caching = caching;
    render->is_kept = is_kept;
    memcpy(render->etag, etag, sizeof render->etag);
    snapshot->done = on_done;
    snapshot->is_gone = is_gone;
    snapshot->user = render;
    set_owner(request, snapshot);
    srv_request_suspend(request);
    /* From here on the request may be answered, and gone, at any moment. */
    if (srv_snapshot_queue_submit(srv_render_pool_snapshots(request->app->render_pool), snapshot,
                                  &err))
        return;
    free_render(render);
    srv_request_cancel_snapshot(request);
    srv_reply_error(reply, &err);
    srv_request_complete(request);
}

/* Renders the view `base` with `patch` applied; `base` NULL = the default view. */
static void draw(struct srv_request *request, const proto_json *base, const proto_json *patch,
                 const char *caching, struct srv_reply *reply) {
    struct sp_error err;
    struct srv_snapshot snapshot = { .quality = 0 };
    struct srv_owner owner;
    struct srv_volume *volume = NULL;
    char etag[ETAG_BYTES];
    snapshot.format = choose_format(request, reply);
    if (snapshot.format == SP_IMAGE_FORMAT_COUNT ||
        !read_quality(request, &snapshot.quality, reply) ||
        !read_chroma(request, &snapshot.chroma, reply))
        return;
    if (!srv_hub_resolve_view(request->app->hub, base, patch, &snapshot.view, &volume, &err)) {
        if (!base)
            srv_name_volumes(request, &err);
        reply_view_error(reply, base != NULL, &err);
        return;
    }
    snapshot.volume = volume;
    srv_request_owner(request, &owner);
    if (!srv_owner_allows_size(&owner, snapshot.view.size, &err)) {
        srv_catalog_release(request->app->catalog, snapshot.volume);
        srv_reply_error(reply, &err);
    } else if (!make_etag(request, &snapshot, etag)) {
        srv_catalog_release(request->app->catalog, snapshot.volume);
        srv_reply_problem(reply, 503, NULL, "out of memory for a render request");
    } else if (srv_header_has_etag(srv_request_header(request, "If-None-Match"), etag)) {
        srv_catalog_release(request->app->catalog, snapshot.volume);
        reply->status = 304;
        set_caching(reply, etag, caching);
    } else {
        submit(request, &snapshot, base != NULL, etag, caching, reply);
    }
}

void srv_post_render(struct srv_request *request, struct srv_reply *reply) {
    proto_json *view = srv_request_json(request, reply);
    if (view)
        draw(request, NULL, view, "private, no-cache", reply);
    proto_json_free(&view);
}

/* Adds the query parameter `name`, which is JSON as in a view, to the patch. False: the reply is a
 * problem document. */
static bool read_member(struct srv_request *request, const char *name, proto_json **patch,
                        struct srv_reply *reply) {
    const char *text = srv_request_query(request, name);
    struct sp_error err;
    if (!text)
        return true;
    proto_json *member = proto_json_parse(text, strlen(text), &err);
    if (!member) {
        srv_reply_problem(reply, err.code == SP_ERR_MEMORY ? 503 : 400, NULL, "?%s=: %s", name,
                          err.text);
        return false;
    }
    proto_json_set(patch, name, member);
    if (!*patch)
        srv_reply_problem(reply, 503, NULL, "out of memory for ?%s=", name);
    return *patch != NULL;
}

/* Adds ?size=WIDTH,HEIGHT to the patch. False: the reply is a problem document. */
static bool read_size(struct srv_request *request, proto_json **patch, struct srv_reply *reply) {
    const char *text = srv_request_query(request, "size");
    uint32_t px[2];
    if (!text)
        return true;
    if (!srv_query_size(text, px)) {
        srv_reply_problem(reply, 400, NULL,
                          "?size= must be WIDTH,HEIGHT: two whole numbers of pixels");
        return false;
    }
    proto_json_set(patch, "size", proto_json_integers(px, 2));
    if (!*patch)
        srv_reply_problem(reply, 503, NULL, "out of memory for a size");
    return *patch != NULL;
}

void srv_get_render(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    proto_json *view = srv_saved_view_get(request->app->store, request->param, &err);
    proto_json *patch = proto_json_object();
    if (!view)
        srv_reply_error(reply, &err);
    else if (read_member(request, "camera", &patch, reply) && read_size(request, &patch, reply))
        /* Shared caches may store the image but must revalidate it: the daemon checks the token
         * each time, and renders nothing for a 304. */
        draw(request, view, patch, "public, no-cache", reply);
    proto_json_free(&patch);
    proto_json_free(&view);
}

/* A client with a join token has no quota of its own: its snapshots count for the token that
 * created the session. False: the reply is a problem document. */
static bool charge_owner(struct srv_request *request, struct srv_reply *reply) {
    struct srv_owner owner;
    if (request->grant.rights)
        return true;
    srv_hub_session_owner(request->app->hub, request->param, &owner);
    if (srv_tokens_charge_to(request->app->tokens, owner.name, &request->grant))
        return true;
    srv_reply_problem(reply, 403, NULL,
                      "the token that created this session is no longer valid; ask its owner");
    return false;
}

void srv_get_session_snapshot(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    proto_json *session =
        srv_hub_session_get(request->app->hub, request->param, false, srv_clock_ms(), &err);
    proto_json *patch = proto_json_object();
    if (!session)
        srv_reply_error(reply, &err);
    else if (read_member(request, "background", &patch, reply) &&
             read_size(request, &patch, reply) && charge_owner(request, reply))
        draw(request, proto_json_get(session, "view"), patch, "private, no-cache", reply);
    proto_json_free(&patch);
    proto_json_free(&session);
}
