/* SPDX-License-Identifier: Apache-2.0
 *
 * Bytes → persisted session → active session. An accepted session can be persisted again, unless
 * its view is refused.
 */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "session/participant.h"
#include "sp/log.h"
#include "support/fake_volumes.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

struct input {
    const char *text;
    size_t size;
};

static char *recall(void *user, const char *id, size_t *size, struct sp_error *err) {
    const struct input *input = user;
    char *text = malloc(input->size + 1);
    (void)id;
    if (!text) {
        sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory");
        return NULL;
    }
    memcpy(text, input->text, input->size);
    text[input->size] = 0;
    *size = input->size;
    return text;
}

static void ignore_line(void *user, enum sp_log_level level, const char *kind,
                        const struct sp_log_field *fields, const char *line) {
    (void)kind;
    (void)fields;
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
    struct fake_volumes volumes = { .uses = 0 };
    struct input input = { (const char *)data, size };
    struct srv_hub_options options = { .volumes = fake_volume_source(&volumes),
                                       .sessions_max = 1,
                                       .participants_max = 1,
                                       .user = &input,
                                       .ready = fake_ignore,
                                       .recall = recall };
    struct sp_error err;
    sp_log_init(ignore_line, NULL, SP_LOG_ERROR);
    struct srv_hub *hub = srv_hub_create(&options, &err);
    if (!hub)
        abort();
    const bool is_sound = srv_hub_restore(hub, id, input.text, input.size, 0, &err);
    if (!is_sound && !err.text[0])
        abort();
    /* A session with a damaged view also exists, but without JSON. It is not saved: the store would
     * refuse its record. */
    proto_json *json = srv_hub_session_get(hub, id, true, 0, &err);
    if (json && !srv_hub_save(hub, 0, drop, NULL))
        abort();
    proto_json_free(&json);
    srv_hub_destroy(&hub);
    if (volumes.uses != 0)
        abort();
    return 0;
}
