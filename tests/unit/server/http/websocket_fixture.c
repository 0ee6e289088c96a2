/* SPDX-License-Identifier: Apache-2.0 */
#include "unit/server/http/websocket_fixture.h"

#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "support/compare.h"
#include "unit/server/session/hub_fixture.h"

static ssize_t wire_recv(void *user, uint8_t *bytes, size_t size) {
    struct wire *wire = user;
    size_t left = wire->in_size - wire->in_at;
    errno = EAGAIN;
    if (left == 0)
        return -1;
    if (size > left)
        size = left;
    memcpy(bytes, wire->in + wire->in_at, size);
    wire->in_at += size;
    return (ssize_t)size;
}

static ssize_t wire_send(void *user, const struct iovec *parts, size_t count, bool is_more) {
    struct wire *wire = user;
    size_t left = wire->piece ? wire->piece : CAPACITY, all = 0;
    (void)is_more;
    wire->took = !wire->took;
    errno = EAGAIN;
    if (wire->is_full || (wire->piece && !wire->took))
        return -1;
    for (size_t i = 0; i < count; i++) {
        size_t size = parts[i].iov_len < left ? parts[i].iov_len : left;
        assert_compare(wire->out_size + size, <=, CAPACITY);
        memcpy(wire->out + wire->out_size, parts[i].iov_base, size);
        wire->out_size += size;
        left -= size;
        all += size;
    }
    return (ssize_t)all;
}

static double wire_clock_ms(void *user) {
    return ((const struct wire *)user)->clock_ms;
}

bool next_sent(const struct wire *wire, size_t *at, struct sent *sent) {
    const uint8_t *from = wire->out + *at;
    if (*at == wire->out_size)
        return false;
    assert_compare(*at + 2, <=, wire->out_size);
    size_t more = from[1] == 126 ? 2 : from[1] == 127 ? 8 : 0;
    *sent = (struct sent){ from[0], from + 2 + more, more ? 0 : from[1] };
    for (size_t i = 0; i < more; i++)
        sent->size = sent->size << 8 | from[2 + i];
    assert_true(more != 2 || sent->size >= 126); /* the length must have the shortest form */
    assert_true(more != 8 || sent->size > UINT16_MAX);
    *at += 2 + more + sent->size;
    assert_compare(*at, <=, wire->out_size);
    return true;
}

struct srv_ws *stream_join(struct stream *s, const char *session, struct wire *wire) {
    struct fixture *f = s->fixture;
    *wire = (struct wire){ .in = malloc(CAPACITY), .out = malloc(CAPACITY) };
    struct srv_ws_options options = { .hub = f->hub,
                                      .ingress = s->ingress,
                                      .token = "",
                                      .session = session,
                                      .role = SRV_ROLE_CONTROL,
                                      .user = s,
                                      .peer = "test",
                                      .message_bytes = CAPACITY,
                                      .ping_ms = 15000,
                                      .stall_ms = 20000,
                                      .transport = { wire, wire_recv, wire_send, wire_clock_ms } };
    struct srv_ws *ws = srv_ws_create(&options, 0, NULL);
    assert_non_null(wire->in);
    assert_non_null(wire->out);
    assert_non_null(ws);
    return ws;
}

int stream_set_up(void **state) {
    struct stream *s = calloc(1, sizeof *s);
    assert_non_null(s);
    assert_int_equal(hub_set_up(&s->fixture), 0);
    s->ingress = srv_ingress_create(CAPACITY);
    assert_non_null(s->ingress);
    s->ws = stream_join(s, ((struct fixture *)s->fixture)->id, &s->wire);
    *state = s;
    return 0;
}

int stream_tear_down(void **state) {
    struct stream *s = *state;
    srv_ws_destroy(&s->ws, 0);
    int failed = hub_tear_down(&s->fixture);
    srv_ingress_destroy(&s->ingress);
    free(s->wire.in);
    free(s->wire.out);
    free(s);
    return failed;
}

void send_text(struct wire *wire, const char *text, size_t size) {
    uint8_t *at = wire->in + wire->in_size;
    size_t more = size < 126 ? 0 : size <= UINT16_MAX ? 2 : 8, head = 2 + more;
    assert_compare(wire->in_size + head + 4 + size, <=, CAPACITY);
    at[0] = 0x81;
    at[1] = (uint8_t)(0x80 | (more == 0 ? size : more == 2 ? 126 : 127));
    for (size_t i = 0; i < more; i++)
        at[2 + i] = (uint8_t)((uint64_t)size >> (8 * (more - 1 - i)));
    memset(at + head, 0, 4);
    memcpy(at + head + 4, text, size);
    wire->in_size += head + 4 + size;
}

void send_pings(struct wire *wire, unsigned count) {
    for (unsigned i = 0; i < count; i++) {
        char text[64];
        int size =
            snprintf(text, sizeof text, "{\"jsonrpc\":\"2.0\",\"id\":%u,\"method\":\"ping\"}", i);
        send_text(wire, text, (size_t)size);
    }
}

unsigned answers(const struct wire *wire) {
    static const char answer[] = "\"result\":{}";
    unsigned count = 0;
    for (size_t at = 0; at + sizeof answer <= wire->out_size; at++)
        count += memcmp(wire->out + at, answer, sizeof answer - 1) == 0;
    return count;
}

void stream_tick(struct stream *s, double now_ms) {
    srv_ingress_tick(s->ingress);
    srv_ws_tick(s->ws, now_ms);
}

void stream_run(struct stream *s, double now_ms) {
    for (int i = 0; i < 1000; i++) {
        if (srv_ws_wants_read(s->ws))
            srv_ws_read(s->ws, now_ms);
        srv_ws_write(s->ws, now_ms);
    }
}

unsigned close_code(const struct wire *wire) {
    struct sent sent;
    unsigned code = 0;
    for (size_t at = 0; next_sent(wire, &at, &sent);) {
        assert_int_equal(code, 0);
        if (sent.first == 0x88)
            code = sent.bytes[0] * 256u + sent.bytes[1];
    }
    return code;
}

struct srv_blob *deliver(struct stream *s, size_t size, double now_ms) {
    struct fixture *f = s->fixture;
    static struct srv_render_job job;
    double wait_ms;
    struct proto_frame_header header = { .codec = PROTO_CODEC_JPEG, .width = 300, .height = 200 };
    struct srv_render_result result = { .width = 300, .height = 200, .render_ms = 1 };
    uint8_t *bytes = malloc(size);
    for (size_t i = 0; i < size; i++)
        bytes[i] = (uint8_t)(i * 7 + i / 251);
    struct srv_blob *blob = srv_blob_create(NULL, NULL, bytes, size, NULL);
    free(bytes);
    assert_non_null(blob);
    assert_true(srv_schedule_next(f->schedule, now_ms, &job, &wait_ms));
    const struct srv_drawn_frame frame = srv_render_job_frame(&job);
    srv_hub_deliver(f->hub, &frame, &job.targets[0], &header, blob);
    srv_schedule_done(f->schedule, &job, &result);
    return blob;
}
