/* SPDX-License-Identifier: Apache-2.0
 *
 * Measurements: computed on request for a volume or for the volume that a session shows, and the
 * list of a session as JSON or CSV. What reads samples takes up to 0.2 s, parts and paths seconds:
 * the sampling thread and the measuring thread compute those.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "common/work_queue.h"
#include "http/routes.h"
#include "protocol/measure.h"
#include "protocol/view.h"
#include "sp/bricks.h"
#include "sp/edit.h"

static bool wait_for_turn(struct srv_request *request, enum srv_measure_effort effort,
                          struct srv_work *work) {
    if (effort == SRV_MEASURE_LONG)
        return srv_request_queue(request, request->app->measuring, work, SRV_MEASURING_MAX,
                                 "measurements of parts");
    return srv_request_queue(request, request->app->sampling, work, SRV_SAMPLING_MAX,
                             "measurements");
}

/* True if the daemon does not stop; else the reply says that it does. */
static bool may_begin(struct srv_request *request) {
    if (!srv_hub_is_draining(request->app->hub))
        return true;
    srv_reply_problem(&request->reply, 503, NULL, "the daemon stops");
    return false;
}

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

/* `level`: of the samples, proto_measure_value.level. */
static proto_json *measure_volume(const struct sp_volume *volume, unsigned level, const char *id,
                                  const struct sp_measure *measure, uint32_t samples,
                                  struct sp_error *err) {
    const bool is_path = measure->kind == SP_MEASURE_PATH;
    struct proto_measure_value value = { .level = level };
    struct sp_part_path *path = is_path ? malloc(sizeof *path) : NULL;
    double *profile = NULL;
    bool has_memory = !is_path || path;
    if (has_memory && !(is_path ? sp_measure_path(volume, measure, &value.result, path, err)
                                : sp_measure_compute(volume, measure, &value.result, err))) {
        free(path);
        return NULL;
    }
    if (measure->kind == SP_MEASURE_PROFILE) {
        samples = samples ? samples : sp_measure_profile_count(volume, measure);
        has_memory = (profile = malloc(samples * sizeof *profile));
        if (has_memory)
            sp_measure_profile(volume, measure, samples, profile);
    }
    proto_measure_set_units(&value, sp_volume_info(volume));
    const struct proto_measure_line line = { profile, samples, path };
    proto_json *json = has_memory ? proto_measure_answer(id, measure, &value, &line) : NULL;
    if (!json)
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the measurement");
    free(path);
    free(profile);
    return json;
}

/* A measurement that waits. */
struct measure_request {
    struct srv_work work; /* first: it is this struct */
    struct srv_request *request;
    struct srv_volume *volume; /* a use of it */
    struct sp_measure measure;
    uint32_t samples;    /* of a profile; 0 = the default */
    struct sp_view view; /* whose edits count for a part or a path */
    char id[SP_NAME_BYTES];
};

/* Returns the samples that the measurement reads, and their level; a reference. */
static struct sp_volume *samples_of(const struct measure_request *waiting, unsigned *level,
                                    struct sp_error *err) {
    struct sp_volume *volume = srv_volume_voxels(waiting->volume);
    if (!sp_measure_has_range(waiting->measure.kind))
        return srv_measured_samples(volume, &waiting->measure, level, err);
    *level = sp_bricks_base(volume);
    return sp_edit_volume(volume, &waiting->view, err);
}

static void compute(struct measure_request *waiting, struct srv_reply *reply) {
    struct sp_error err;
    unsigned level;
    struct sp_volume *volume = samples_of(waiting, &level, &err);
    proto_json *json = volume ? measure_volume(volume, level, waiting->id, &waiting->measure,
                                               waiting->samples, &err)
                              : NULL;
    sp_volume_unref(&volume);
    if (json)
        srv_reply_json(reply, 200, json);
    else
        srv_reply_view_error(reply, "", &err);
}

static void release(struct measure_request *waiting) {
    srv_catalog_release(waiting->request->app->catalog, waiting->volume);
    free(waiting);
}

static void run_measure(struct srv_work *work) {
    struct measure_request *waiting = (struct measure_request *)work;
    struct srv_request *request = waiting->request;
    if (may_begin(request))
        compute(waiting, &request->reply);
    release(waiting);
    srv_request_complete(request);
}

/* Acquires the time step that a session shows, or else the step that the volume was opened with. */
static struct srv_volume *acquire(struct srv_catalog *catalog, const char *id,
                                  const proto_json *session_view, struct sp_error *err) {
    struct srv_volume *volume = srv_catalog_acquire(catalog, id, err);
    int64_t step;
    if (!volume ||
        !proto_json_integer(proto_json_get(proto_json_get(session_view, "time"), "step"), &step))
        return volume;
    return srv_catalog_ready_step(catalog, volume, (uint32_t)step, err);
}

/* Fills what the measurement needs of the volume `id`; session_view: of the session that shows it,
 * or NULL. */
static bool prepare(struct measure_request *waiting, const char *id, const proto_json *session_view,
                    struct sp_error *err) {
    struct srv_catalog *catalog = waiting->request->app->catalog;
    struct sp_view defaults;
    waiting->work.run = run_measure;
    snprintf(waiting->id, sizeof waiting->id, "%s", id);
    if (!(waiting->volume = acquire(catalog, id, session_view, err)))
        return false;
    srv_catalog_default_view(catalog, waiting->volume, &defaults);
    waiting->view = defaults;
    if (!session_view || proto_view_apply(session_view, &defaults, &waiting->view, err))
        return true;
    srv_catalog_release(catalog, waiting->volume);
    return false;
}

/* Answers with a measurement in the volume `id`, now or later. */
static void reply_measure(struct srv_request *request, const proto_json *body, const char *id,
                          const proto_json *session_view, struct srv_reply *reply) {
    struct sp_error err;
    struct measure_request *waiting = calloc(1, sizeof *waiting);
    if (!waiting) {
        srv_reply_problem(reply, 503, NULL, "out of memory for the measurement");
        return;
    }
    waiting->request = request;
    if (!proto_measure_decode(body, &waiting->measure, &err) ||
        !read_samples(body, &waiting->measure, &waiting->samples, &err)) {
        srv_reply_error(reply, &err);
        free(waiting);
    } else if (!prepare(waiting, id, session_view, &err)) {
        srv_reply_view_error(reply, "", &err);
        free(waiting);
    } else if (srv_measure_effort_of(waiting->measure.kind) == SRV_MEASURE_AT_ONCE) {
        compute(waiting, reply);
        release(waiting);
    } else if (!wait_for_turn(request, srv_measure_effort_of(waiting->measure.kind),
                              &waiting->work)) {
        release(waiting);
    }
}

void srv_post_measure(struct srv_request *request, struct srv_reply *reply) {
    static const char *const known[] = { "volume", "kind", "points", "range", "samples", NULL };
    struct sp_error err;
    proto_json *body = srv_request_json(request, reply);
    const char *id = proto_json_string(proto_json_get(body, "volume"));
    if (body && !proto_json_only(body, known, &err))
        srv_reply_error(reply, &err);
    else if (body && (!id || !*id))
        srv_reply_problem(reply, 422, "/volume", "must be the id of a volume");
    else if (body)
        reply_measure(request, body, id, NULL, reply);
    proto_json_free(&body);
}

static void reply_session_measure(struct srv_request *request, const char *id,
                                  const proto_json *view, struct srv_reply *reply) {
    static const char *const known[] = { "kind", "points", "range", "samples", NULL };
    struct sp_error err;
    proto_json *body = srv_request_json(request, reply);
    if (body && !proto_json_only(body, known, &err))
        srv_reply_error(reply, &err);
    else if (body)
        reply_measure(request, body, id, view, reply);
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
    proto_json_set(&json, "measures", srv_measures_encode(measures));
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

/* Puts the measurement of the body into the session `session`; `id` NULL = a new one. Fills the
 * reply. */
static void put(struct srv_request *request, const char *session, const char *id,
                enum srv_measure_change change, struct srv_reply *reply) {
    static const char *const known[] = {
        "kind", "points", "range", "text", "color", "hidden", NULL
    };
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
        srv_reply_error(reply, &err);
    } else {
        if (answer.is_new)
            srv_reply_header(reply, "Location", "%s%s", id ? "" : "measures/", answer.id);
        srv_reply_text(reply, answer.is_new ? 201 : 200, "application/json", text, answer.size);
    }
    proto_json_free(&body);
}

/* A change that waits. */
struct put_request {
    struct srv_work work; /* first: it is this struct */
    struct srv_request *request;
    const char *session, *id; /* in the request */
    enum srv_measure_change change;
};

static void run_put(struct srv_work *work) {
    struct put_request *waiting = (struct put_request *)work;
    struct srv_request *request = waiting->request;
    if (may_begin(request))
        put(request, waiting->session, waiting->id, waiting->change, &request->reply);
    free(waiting);
    if (request->reply.status < 300)
        srv_request_reply_when_durable(request);
    else
        srv_request_complete(request);
}

/* What the change may take: only the session knows the kind of a measurement that exists. */
static enum srv_measure_effort effort_of(struct srv_request *request) {
    enum srv_measure_effort effort = SRV_MEASURE_AT_ONCE;
    struct srv_reply unused = { 0 };
    struct sp_error err;
    struct sp_measure measure;
    proto_json *body = srv_request_json(request, &unused);
    if (!proto_json_get(body, "kind"))
        effort = proto_json_get(body, "points") || proto_json_get(body, "range")
                     ? SRV_MEASURE_LONG
                     : SRV_MEASURE_AT_ONCE;
    else if (proto_measure_decode(body, &measure, &err))
        effort = srv_measure_effort_of(measure.kind);
    proto_json_free(&body);
    srv_reply_finish(&unused);
    return effort;
}

/* As put(), on another thread if it takes time. */
static void put_on_worker(struct srv_request *request, const char *session, const char *id,
                          enum srv_measure_change change, struct srv_reply *reply) {
    const enum srv_measure_effort effort = effort_of(request);
    if (effort == SRV_MEASURE_AT_ONCE) {
        put(request, session, id, change, reply);
        if (reply->status < 300)
            srv_request_reply_when_durable(request);
        return;
    }
    struct put_request *waiting = malloc(sizeof *waiting);
    if (!waiting) {
        srv_reply_problem(reply, 503, NULL, "out of memory for the measurement");
        return;
    }
    *waiting = (struct put_request){ { .run = run_put }, request, session, id, change };
    if (!wait_for_turn(request, effort, &waiting->work))
        free(waiting);
}

/* Splits the parameters of the path, "SESSION/ID"; returns the id. */
static char *split(struct srv_request *request) {
    char *slash = strchr(request->param, '/');
    *slash = 0;
    return slash + 1;
}

void srv_post_session_measures(struct srv_request *request, struct srv_reply *reply) {
    put_on_worker(request, request->param, NULL, SRV_MEASURE_REPLACE, reply);
}

void srv_put_session_measure(struct srv_request *request, struct srv_reply *reply) {
    const char *id = split(request);
    put_on_worker(request, request->param, id, SRV_MEASURE_REPLACE, reply);
}

void srv_patch_session_measure(struct srv_request *request, struct srv_reply *reply) {
    const char *id = split(request);
    put_on_worker(request, request->param, id, SRV_MEASURE_CHANGE, reply);
}

void srv_delete_session_measure(struct srv_request *request, struct srv_reply *reply) {
    struct sp_error err;
    const char *id = split(request);
    const bool ok =
        srv_hub_measure_remove(request->app->hub, request->param, id, srv_clock_ms(), &err);
    (void)reply;
    srv_request_reply_changed(request, ok, &err);
}
