/* SPDX-License-Identifier: Apache-2.0
 *
 * The record of a path in the store: {"owner", "view", "defaults", "content", "keyframes",
 * "frames", "fps", "format", "quality", "sealed", "failed"?}, where "content" is the fingerprint of
 * the volume, and "sealed" tells that its files have seals. If the files of the path are to be
 * removed, it is {"removed": true}.
 */
#include <stdlib.h>
#include <string.h>

#include "paths/paths_private.h"
#include "protocol/view.h"
#include "session/view_check.h"
#include "sp/log.h"

struct srv_keyframes *srv_path_record_keyframes(const proto_json *record, struct sp_error *err) {
    struct sp_view view, defaults;
    return srv_view_check(proto_json_get(record, "view"), &view, err) &&
                   srv_view_check(proto_json_get(record, "defaults"), &defaults, err)
               ? srv_keyframes_read(record, &view, &defaults, UINT32_MAX, err)
               : NULL;
}

proto_json *srv_path_record_read(struct srv_paths *paths, const char *id, struct sp_error *err) {
    size_t size;
    pthread_mutex_lock(&paths->records);
    char *text = srv_store_get(paths->options.store, SRV_KIND_PATH, id, &size, err);
    pthread_mutex_unlock(&paths->records);
    proto_json *record = text ? proto_json_parse(text, size, err) : NULL;
    free(text);
    return record;
}

bool srv_path_record_put(struct srv_paths *paths, const struct srv_path *path,
                         const struct srv_keyframes *keyframes, const proto_json *body,
                         const struct sp_view *defaults, struct sp_error *err) {
    char content[SRV_FINGERPRINT_TEXT];
    const struct srv_path_output *output = &path->output;
    proto_json *record = proto_json_object();
    proto_json *keys = (proto_json *)(uintptr_t)proto_json_get(body, "keyframes");
    srv_fingerprint_encode(&path->content, content);
    proto_json_set_string(&record, "owner", path->owner);
    proto_json_set(&record, "view", proto_view_encode(srv_keyframes_key(keyframes, 0)));
    proto_json_set(&record, "defaults", proto_view_encode(defaults));
    proto_json_set_string(&record, "content", content);
    proto_json_set(&record, "keyframes", proto_json_ref(keys));
    proto_json_set_integer(&record, "frames", output->frames);
    proto_json_set_number(&record, "fps", output->fps);
    proto_json_set_string(&record, "format", srv_path_format_name(output));
    proto_json_set_integer(&record, "quality", output->quality);
    proto_json_set_bool(&record, "sealed", output->is_sealed);
    size_t size = 0;
    char *text = proto_json_to_text(record, &size);
    const bool ok =
        text ? srv_store_put(paths->options.store, SRV_KIND_PATH, path->id, text, size, err)
             : sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory while storing a camera path");
    proto_json_free(&record);
    free(text);
    return ok;
}

void srv_path_record_fail(struct srv_paths *paths, const char *id, const char *reason) {
    struct sp_error err;
    size_t size = 0;
    char *text = srv_store_get(paths->options.store, SRV_KIND_PATH, id, &size, &err);
    proto_json *json = text ? proto_json_parse(text, size, &err) : NULL;
    free(text);
    proto_json_set_string(&json, "failed", reason);
    text = proto_json_to_text(json, &size);
    if (!text || !srv_store_put(paths->options.store, SRV_KIND_PATH, id, text, size, &err))
        sp_log_with(SP_LOG_ERROR, SP_LOG_FIELDS({ "path", id }), "cannot store that path %s failed",
                    id);
    free(text);
    proto_json_free(&json);
}

bool srv_path_record_remove(struct srv_paths *paths, const char *id, struct sp_error *err) {
    static const char removed[] = "{\"removed\":true}";
    return srv_store_put(paths->options.store, SRV_KIND_PATH, id, removed, sizeof removed - 1, err);
}

bool srv_path_record_is_sealed(const proto_json *record) {
    bool is_sealed = false;
    return proto_json_bool(proto_json_get(record, "sealed"), &is_sealed) && is_sealed;
}

bool srv_path_record_is_removed(const proto_json *record) {
    bool is_removed = false;
    return proto_json_bool(proto_json_get(record, "removed"), &is_removed) && is_removed;
}
