/* SPDX-License-Identifier: Apache-2.0 */
#include "render/persistence.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/clock.h"
#include "protocol/json.h"
#include "render/record_check.h"
#include "sp/log.h"

static bool restore_volume(struct srv_catalog *catalog, const char *id, const char *text,
                           size_t size, struct sp_error *err) {
    struct srv_volume_request request = { .id = id, .is_restored = true };
    char given[SP_NAME_BYTES];
    bool existed, conflict;
    proto_json *json = proto_json_parse(text, size, err);
    bool ok = json != NULL;
    request.source = proto_json_string(proto_json_get(json, "source"));
    request.name = proto_json_string(proto_json_get(json, "name"));
    request.owner = proto_json_string(proto_json_get(json, "owner"));
    proto_json_bool(proto_json_get(json, "limited"), &request.is_limited);
    if (ok &&
        (!request.source || !proto_json_bool(proto_json_get(json, "confined"), &request.confined)))
        ok = sp_fail(err, SP_ERR_FORMAT, NULL, "the record is not a volume");
    ok = ok && srv_catalog_add(catalog, &request, given, &existed, &conflict, err);
    proto_json_free(&json);
    return ok;
}

/* True if a record is at fault, and not the memory or a limit. */
static bool is_damage(enum sp_code code) {
    return code == SP_ERR_FORMAT || code == SP_ERR_INVALID;
}

/* Restores the records of a kind. Views and presets are only checked: a request reads them when it
 * needs them. */
static bool restore_kind(struct srv_store *store, enum srv_kind kind, struct srv_hub *hub,
                         struct srv_catalog *catalog, struct sp_error *err) {
    const bool is_checked = kind == SRV_KIND_VIEW || kind == SRV_KIND_PRESET;
    char *ids = srv_store_ids(store, kind);
    if (!ids)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while restoring the state");
    for (const char *id = ids; *id; id += strlen(id) + 1) {
        struct sp_error why;
        size_t size;
        char *text = srv_store_get(store, kind, id, &size, &why);
        bool ok = text && (is_checked ? srv_record_check(kind, text, size, &why)
                           : kind == SRV_KIND_SESSION
                               ? srv_hub_restore(hub, id, text, size, srv_clock_ms(), &why)
                               : restore_volume(catalog, id, text, size, &why));
        if (!ok && (is_checked || is_damage(why.code)))
            srv_store_damage(store, kind, id, &why);
        else if (!ok)
            sp_log(SP_LOG_ERROR, "cannot restore %s %s: %s%s%s",
                   kind == SRV_KIND_SESSION ? "session" : "volume", id, why.place,
                   why.place[0] ? ": " : "", why.text);
        free(text);
    }
    free(ids);
    return true;
}

bool srv_persistence_restore(struct srv_store *store, struct srv_hub *hub,
                             struct srv_catalog *catalog, struct sp_error *err) {
    return restore_kind(store, SRV_KIND_SESSION, hub, catalog, err) &&
           restore_kind(store, SRV_KIND_VOLUME, hub, catalog, err) &&
           restore_kind(store, SRV_KIND_VIEW, hub, catalog, err) &&
           restore_kind(store, SRV_KIND_PRESET, hub, catalog, err);
}

static bool put_session(void *user, const char *id, const char *text, size_t size) {
    struct sp_error err;
    if (srv_store_put(user, SRV_KIND_SESSION, id, text, size, &err))
        return true;
    sp_log(SP_LOG_ERROR, "cannot store session %s: %s", id, err.text);
    return false;
}

/* {"ran": seconds} */
static const char clock_id[] = "daemon";

double srv_persistence_ran_ms(struct srv_store *store) {
    struct sp_error err;
    size_t size;
    double ran_s = 0;
    char *text = srv_store_get(store, SRV_KIND_CLOCK, clock_id, &size, &err);
    proto_json *json = text ? proto_json_parse(text, size, &err) : NULL;
    bool ok = proto_json_number(proto_json_get(json, "ran"), &ran_s) && ran_s >= 0;
    if (text && !ok)
        srv_store_damage(store, SRV_KIND_CLOCK, clock_id,
                         &(struct sp_error){ .code = SP_ERR_FORMAT, .text = "it is no time" });
    proto_json_free(&json);
    free(text);
    return ok ? ran_s * 1000 : 0;
}

/* If this fails, the next write tries again. */
static void put_clock(struct srv_store *store, double ran_ms) {
    struct sp_error err;
    char text[64];
    int size = snprintf(text, sizeof text, "{\"ran\":%.0f}", floor(ran_ms / 1000));
    char *old = srv_store_get(store, SRV_KIND_CLOCK, clock_id, NULL, &err);
    if (!old || strcmp(old, text) != 0)
        srv_store_put(store, SRV_KIND_CLOCK, clock_id, text, (size_t)size, &err);
    free(old);
}

bool srv_persistence_save_sessions(struct srv_store *store, struct srv_hub *hub, double ran_ms) {
    put_clock(store, ran_ms);
    return srv_hub_save(hub, srv_clock_ms(), put_session, store);
}

bool srv_persistence_put_volume(struct srv_store *store, const char *id,
                                const struct srv_volume_request *request) {
    struct sp_error err;
    if (!request) {
        srv_store_remove(store, SRV_KIND_VOLUME, id);
        return true;
    }
    proto_json *json = proto_json_object();
    proto_json_set_string(&json, "source", request->source);
    proto_json_set_string(&json, "name", request->name);
    proto_json_set_bool(&json, "confined", request->confined);
    if (request->owner) {
        proto_json_set_string(&json, "owner", request->owner);
        proto_json_set_bool(&json, "limited", request->is_limited);
    }
    const char *source = proto_json_string(proto_json_get(json, "source"));
    size_t size = 0;
    char *text = proto_json_to_text(json, &size);
    bool ok = text != NULL;
    if (!text)
        sp_fail(&err, SP_ERR_MEMORY, NULL, "out of memory");
    else if (strcmp(source, request->source) != 0)
        ok = sp_fail(&err, SP_ERR_UNSUPPORTED, NULL, "its path is not UTF-8");
    ok = ok && srv_store_put(store, SRV_KIND_VOLUME, id, text, size, &err);
    if (!ok)
        sp_log(SP_LOG_WARN, "volume %s will not be loaded again after a restart: %s", id, err.text);
    free(text);
    proto_json_free(&json);
    return ok;
}
