/* SPDX-License-Identifier: Apache-2.0
 *
 * Bytes of a client's WebSocket connection: framing, JSON-RPC, and the effect of the messages on a
 * session, over a transport in memory. The input arrives in pieces whose lengths are taken from it.
 * What the daemon sends is discarded.
 */
#include <errno.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "http/websocket.h"
#include "schedule/schedule.h"
#include "sp/log.h"
#include "sp/volume.h"

struct input {
    const uint8_t *bytes;
    size_t size, at;
    struct sp_volume_info info;
};

static struct srv_volume *acquire(void *user, const char *id, struct sp_error *err) {
    if (!id || !*id || strcmp(id, "v") == 0)
        return user;
    sp_fail(err, SP_ERR_VOLUME_UNKNOWN, "/volume", "there is no volume '%s'", id);
    return NULL;
}

static struct srv_volume *add_use(void *user, struct srv_volume *volume) {
    (void)user;
    return volume;
}

static void release(void *user, struct srv_volume *volume) {
    (void)user;
    (void)volume;
}

static bool pick(void *user, struct srv_volume *volume, const struct sp_view *view,
                 const uint32_t size[2], const double at[2], struct sp_pick *found,
                 struct sp_error *err) {
    (void)err;
    (void)user;
    (void)volume;
    (void)view;
    *found = (struct sp_pick){ .opacity = 1, .is_hit = at[0] < size[0] };
    return true;
}

static void default_view(void *user, struct srv_volume *volume, struct sp_view *view) {
    (void)volume;
    sp_view_init(view, &((struct input *)user)->info, "v");
}

static void ignore(void *user) {
    (void)user;
}

static void ignore_session(void *user, uint64_t session, enum srv_interrupt why) {
    (void)user;
    (void)session;
    (void)why;
}

static ssize_t input_recv(void *user, uint8_t *bytes, size_t size) {
    struct input *input = user;
    size_t left = input->size - input->at;
    if (left == 0)
        return 0;
    size_t piece = 1 + input->bytes[input->at] % 61u;
    if (piece > left)
        piece = left;
    if (piece > size)
        piece = size;
    memcpy(bytes, input->bytes + input->at, piece);
    input->at += piece;
    return (ssize_t)piece;
}

static double input_clock_ms(void *user) {
    (void)user;
    return 0; /* no time passes while bytes are read */
}

static ssize_t output_send(void *user, const struct iovec *parts, size_t count, bool is_more) {
    size_t size = 0;
    (void)user;
    (void)is_more;
    for (size_t i = 0; i < count; i++)
        size += parts[i].iov_len;
    return (ssize_t)size;
}

static void no_log(void *user, enum sp_log_level level, const char *kind,
                   const struct sp_log_field *fields, const char *line) {
    (void)kind;
    (void)fields;
    (void)user;
    (void)level;
    (void)line;
}

/* Delivers a frame for each request of the session, so that there are frames to acknowledge. */
static void serve(struct srv_schedule *schedule, double now_ms) {
    static struct srv_render_job job;
    double wait_ms;
    if (!srv_schedule_next(schedule, now_ms, &job, &wait_ms))
        return;
    struct proto_frame_header header = { .codec = PROTO_CODEC_JPEG, .width = 1, .height = 1 };
    struct srv_render_result result = { .width = 1, .height = 1, .render_ms = 1 };
    struct srv_blob *blob = srv_blob_create(NULL, NULL, (const uint8_t *)"x", 1, NULL);
    const struct srv_drawn_frame frame = srv_render_job_frame(&job);
    for (uint32_t i = 0; blob && i < job.target_count; i++)
        srv_hub_deliver(srv_schedule_hub(schedule), &frame, &job.targets[i], &header, blob);
    srv_blob_unref(&blob);
    srv_schedule_done(schedule, &job, &result);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct input input = { .bytes = data, .size = size };
    input.info = (struct sp_volume_info){ .type = SP_UINT8, .components = 1, .range = { 0, 255 } };
    for (int i = 0; i < 3; i++) {
        input.info.grid.dims[i] = 8;
        input.info.grid.spacing[i] = input.info.grid.direction[i][i] = 1;
    }
    sp_log_init(no_log, NULL, SP_LOG_ERROR);
    struct srv_hub_options options = { .volumes = { .user = &input,
                                                    .acquire = acquire,
                                                    .ref = add_use,
                                                    .release = release,
                                                    .default_view = default_view,
                                                    .pick = pick },
                                       .sessions_max = 1,
                                       .participants_max = 1,
                                       .session_idle_ms = 1000,
                                       .control_ms = 500,
                                       .rest_ms = 5,
                                       .stream_bytes = 1000,
                                       .user = &input,
                                       .ready = ignore };
    char id[SRV_SESSION_ID_BYTES];
    struct srv_hub *hub = srv_hub_create(&options, NULL);
    const struct srv_schedule_options work = { .wake = ignore, .interrupt = ignore_session };
    struct srv_schedule *schedule = hub ? srv_schedule_create(hub, &work, NULL) : NULL;
    proto_json *json =
        schedule ? srv_hub_session_create(hub, NULL, &(const struct srv_owner){ .name = "" }, false,
                                          0, id, NULL)
                 : NULL;
    if (!json)
        abort();
    proto_json_free(&json);
    struct srv_ingress *ingress = srv_ingress_create(4096);
    if (!ingress)
        abort();
    struct srv_ws_options ws_options = { .hub = hub,
                                         .ingress = ingress,
                                         .token = "",
                                         .session = id,
                                         .role = SRV_ROLE_CONTROL,
                                         .user = &input,
                                         .peer = "fuzz",
                                         .message_bytes = 4096,
                                         .ping_ms = 1000,
                                         .stall_ms = 1000,
                                         .transport = { &input, input_recv, output_send,
                                                        input_clock_ms } };
    double now_ms = 1;
    struct srv_ws *ws = srv_ws_create(&ws_options, now_ms, NULL);
    for (int turn = 0; ws && turn < 10000 && !srv_ws_is_over(ws); turn++) {
        now_ms += 1;
        srv_ws_read(ws, now_ms);
        serve(schedule, now_ms);
        srv_ws_write(ws, now_ms);
        srv_ingress_tick(ingress);
        srv_ws_tick(ws, now_ms);
    }
    if (!ws || !srv_ws_is_over(ws))
        abort(); /* the end of the input ends the connection */
    srv_ws_destroy(&ws, now_ms);
    srv_ingress_destroy(&ingress);
    srv_hub_destroy(&hub);
    srv_schedule_destroy(&schedule);
    return 0;
}
