/* SPDX-License-Identifier: Apache-2.0
 *
 * Bytes → what was kept of a session → a session. What is accepted can be saved again, unless its
 * view is one that cannot be shown.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "session/hub.h"
#include "sp/log.h"
#include "sp/volume.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void *acquire(void *user, const char *id, struct sp_error *err) {
    (void)id;
    (void)err;
    return user;
}

static void *ref(void *user, void *volume) {
    (void)user;
    return volume;
}

static void release(void *user, void *volume) {
    (void)user;
    (void)volume;
}

static void default_view(void *user, void *volume, struct sp_view *view) {
    struct sp_volume_info info = { .type = SP_UINT8, .components = 1, .range = { 0, 255 } };
    (void)user;
    (void)volume;
    for (int i = 0; i < 3; i++) {
        info.grid.dims[i] = 8;
        info.grid.spacing[i] = info.grid.direction[i][i] = 1;
    }
    sp_view_init(view, &info, "v");
}

static void ignore(void *user) {
    (void)user;
}

static void ignore_line(void *user, enum sp_log_level level, const char *line) {
    (void)user;
    (void)level;
    (void)line;
}

static bool drop(void *user, const char *id, const char *text, size_t size) {
    (void)user;
    (void)id;
    return text[size] == 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const char id[] = "0123456789abcdef";
    char volume;
    struct srv_hub_options options = { .volumes = { &volume, acquire, ref, release, default_view,
                                                    NULL },
                                       .sessions_max = 1,
                                       .participants_max = 1,
                                       .work = ignore,
                                       .ready = ignore };
    struct sp_error err;
    sp_log_init(ignore_line, NULL, SP_LOG_ERROR);
    struct srv_hub *hub = srv_hub_create(&options, &err);
    if (!hub)
        abort();
    if (srv_hub_restore(hub, id, (const char *)data, size, &err)) {
        srv_hub_volume_progress(hub, "v", "ready", 1, "", 0);
        proto_json *json = srv_hub_session_get(hub, id, true, &err);
        if (json && !srv_hub_save(hub, drop, NULL))
            abort();
        proto_json_free(&json);
    }
    srv_hub_destroy(&hub);
    return 0;
}
