/* SPDX-License-Identifier: Apache-2.0
 *
 * Measurements: computed on request for a volume or for the volume that a session shows, and the
 * list of a session as JSON or CSV. The HTTP thread computes them: up to 0.2 s for the largest
 * region.
 */
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "http/routes.h"
#include "protocol/measure.h"

/* Reads "samples": how many values a profile has; 0 = the default. */
static bool read_samples(const proto_json *body, const struct sp_measure *measure,
                         uint32_t *samples, struct sp_error *err) {
    const proto_json *given = proto_json_get(body, "samples");
    int64_t count = 0;
    *samples = 0;
    if (!given)
        return true;
    if (!proto_json_integer(given, &count) || count < 2 || count > SP_MEASURE_PROFILE_SAMPLES)
        return sp_fail(err, SP_ERR_INVALID, "/samples", "must be a whole number in [2, %d]",
                       SP_MEASURE_PROFILE_SAMPLES);
    if (measure->kind != SP_MEASURE_PROFILE)
        return sp_fail(err, SP_ERR_INVALID, "/samples", "only a profile has it");
    *samples = (uint32_t)count;
    return true;
}

static proto_json *measure_volume(const struct sp_volume *volume, const char *id,
                                  const struct sp_measure *measure, uint32_t samples,
                                  struct sp_error *err) {
    struct proto_measure_value value;
    double *profile = NULL;
    if (!sp_measure_compute(volume, measure, &value.result, err))
        return NULL;
    memcpy(value.world_unit, sp_volume_info(volume)->unit, sizeof value.world_unit);
    if (measure->kind == SP_MEASURE_PROFILE) {
        samples = samples ? samples : sp_measure_profile_count(volume, measure);
        profile = malloc(samples * sizeof *profile);
        if (!profile) {
            sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the profile");
            return NULL;
        }
        sp_measure_profile(volume, measure, samples, profile);
    }
    proto_json *json = proto_measure_answer(id, measure, &value, profile, samples);
    if (!json)
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the measurement");
    free(profile);
    return json;
}

/* Answers with a measurement in the volume `id`; `at` is the place of errors about the volume. */
static void reply_measure(struct srv_request *request, const proto_json *body, const char *id,
                          struct srv_reply *reply) {
    struct sp_error err;
    struct sp_measure measure;
    uint32_t samples;
    if (!proto_measure_decode(body, &measure, &err) ||
        !read_samples(body, &measure, &samples, &err)) {
        srv_reply_error(reply, &err);
        return;
    }
    void *volume = srv_catalog_acquire(request->app->catalog, id, &err);
    proto_json *json =
        volume ? measure_volume(srv_volume_voxels(volume), id, &measure, samples, &err) : NULL;
    if (volume)
        srv_catalog_release(request->app->catalog, volume);
    if (json)
        srv_reply_json(reply, 200, json);
    else
        srv_reply_view_error(reply, "", &err);
}

void srv_post_measure(struct srv_request *request, struct srv_reply *reply) {
    static const char *const known[] = { "volume", "kind", "points", "samples", NULL };
    struct sp_error err;
    proto_json *body = srv_request_json(request, reply);
    const char *id = proto_json_string(proto_json_get(body, "volume"));
    if (body && !proto_json_only(body, known, &err))
        srv_reply_error(reply, &err);
    else if (body && (!id || !*id))
        srv_reply_problem(reply, 422, "/volume", "must be the id of a volume");
    else if (body)
        reply_measure(request, body, id, reply);
    proto_json_free(&body);
}

static void reply_session_measure(struct srv_request *request, const char *id,
                                  const proto_json *view, struct srv_reply *reply) {
    (void)view;
    static const char *const known[] = { "kind", "points", "samples", NULL };
    struct sp_error err;
    proto_json *body = srv_request_json(request, reply);
    if (body && !proto_json_only(body, known, &err))
        srv_reply_error(reply, &err);
    else if (body)
        reply_measure(request, body, id, reply);
    proto_json_free(&body);
}

void srv_post_session_measure(struct srv_request *request, struct srv_reply *reply) {
    srv_reply_for_session(request, reply_session_measure, reply);
}

/* The list of a session. */

static void reply_csv(const struct srv_measures *measures, struct srv_reply *reply) {
    size_t size;
    struct proto_measure *items = malloc((measures->count + 1) * sizeof *items);
    for (size_t i = 0; items && i < measures->count; i++)
        items[i] = measures->items[i].measure;
    char *text = items ? proto_measures_to_csv(items, measures->count, &size) : NULL;
    free(items);
    if (!text) {
        srv_reply_problem(reply, 503, NULL, "out of memory for the measurements");
        return;
    }
    srv_reply_text(reply, 200, "text/csv; charset=utf-8; header=present", text, size);
}

static void reply_list(const struct srv_measures *measures, struct srv_reply *reply) {
    proto_json *json = proto_json_object();
    if (!proto_json_set(json, "measures", srv_measures_encode(measures)))
        proto_json_free(&json);
    srv_reply_json(reply, 200, json);
}

void srv_get_session_measures(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    struct srv_measures measures;
    const char *format = srv_request_query(request, "format");
    const bool is_csv = format && strcmp(format, "csv") == 0;
    if (format && !is_csv && strcmp(format, "json") != 0) {
        srv_reply_problem(reply, 400, NULL, "?format=%.40s: must be json or csv", format);
    } else if (!srv_hub_measures(request->app->hub, request->param, srv_clock_ms(), &measures,
                                 &err)) {
        srv_reply_error(reply, &err);
    } else {
        if (is_csv)
            reply_csv(&measures, reply);
        else
            reply_list(&measures, reply);
        if (reply->status == 200)
            srv_reply_header(reply, "Content-Disposition", "attachment; filename=\"measures.%s\"",
                             is_csv ? "csv" : "json");
        srv_measures_finish(&measures);
    }
}

/* Changes of the list. */

/* The id is in the path, so no pointer into the body names it. */
static void reply_change_error(struct sp_error *err, struct srv_reply *reply) {
    if (strcmp(err->place, "/id") == 0)
        err->place[0] = 0;
    srv_reply_error(reply, err);
}

/* Puts the measurement of the body into the session `session`; `id` NULL = a new one. */
static void put(struct srv_request *request, const char *session, const char *id,
                enum srv_measure_change change, struct srv_reply *reply) {
    static const char *const known[] = { "kind", "points", "text", "color", "hidden", NULL };
    const bool is_patch = change == SRV_MEASURE_CHANGE; /* the kind cannot change */
    struct sp_error err;
    struct srv_measure_answer answer;
    char *text = NULL;
    proto_json *body = srv_request_json(request, reply);
    if (!body)
        return;
    if (proto_json_only(body, known + is_patch, &err)) {
        const struct srv_measure_request wanted = { id, change, body, request->grant.name };
        text =
            srv_hub_measure_put(request->app->hub, session, &wanted, srv_clock_ms(), &answer, &err);
    }
    if (!text) {
        reply_change_error(&err, reply);
    } else {
        if (answer.is_new)
            srv_reply_header(reply, "Location", "%s%s", id ? "" : "measures/", answer.id);
        srv_reply_text(reply, answer.is_new ? 201 : 200, "application/json", text, answer.size);
    }
    proto_json_free(&body);
}

/* Splits the parameters of the path, "SESSION/ID"; returns the id. */
static char *split(struct srv_request *request) {
    char *slash = strchr(request->param, '/');
    *slash = 0;
    return slash + 1;
}

void srv_post_session_measures(struct srv_request *request, struct srv_reply *reply) {
    put(request, request->param, NULL, SRV_MEASURE_REPLACE, reply);
}

void srv_put_session_measure(struct srv_request *request, struct srv_reply *reply) {
    const char *id = split(request);
    put(request, request->param, id, SRV_MEASURE_REPLACE, reply);
}

void srv_patch_session_measure(struct srv_request *request, struct srv_reply *reply) {
    const char *id = split(request);
    put(request, request->param, id, SRV_MEASURE_CHANGE, reply);
}

void srv_delete_session_measure(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    const char *id = split(request);
    if (srv_hub_measure_remove(request->app->hub, request->param, id, srv_clock_ms(), &err))
        reply->status = 204;
    else
        reply_change_error(&err, reply);
}
