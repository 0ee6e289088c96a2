/* SPDX-License-Identifier: Apache-2.0
 *
 * A stream without memory: joining, and each update of the view.
 */
#include "unit/server/oom.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "support/compare.h"
#include "support/fake_memory.h"

static struct oom_client stream = { .fd = -1 };

enum message { ENDED, TEXT, FRAME };

static void send_text(const char *text) {
    uint8_t frame[1024] = { 0x81 };
    size_t size = strlen(text), head = size < 126 ? 2 : 4;
    assert_compare(size + 8, <, sizeof frame);
    frame[1] = (uint8_t)(0x80 | (size < 126 ? size : 126));
    if (head == 4) {
        frame[2] = (uint8_t)(size >> 8);
        frame[3] = (uint8_t)size;
    }
    memcpy(frame + head + 4, text, size); /* the mask is 0 */
    oom_send(&stream, frame, head + 4 + size);
}

/* Returns the next message of the stream; *payload lives until the next call. */
static enum message next_message(const uint8_t **payload, size_t *size) {
    static uint8_t message[sizeof stream.bytes];
    for (;;) {
        const uint8_t *bytes = (const uint8_t *)stream.bytes;
        size_t head = stream.have < 2 ? 2 : (bytes[1] & 127) == 126 ? 4 : 2;
        *size = head == 4 && stream.have >= 4 ? (size_t)(bytes[2] << 8 | bytes[3])
                                              : (size_t)(bytes[1] & 127);
        if (stream.have < head || stream.have < head + *size) {
            if (!oom_receive(&stream))
                return ENDED;
            continue;
        }
        int kind = bytes[0] & 15;
        memcpy(message, bytes + head, *size);
        message[*size] = 0;
        stream.have -= head + *size;
        memmove(stream.bytes, stream.bytes + head + *size, stream.have);
        *payload = message;
        if (kind == 1 || kind == 2)
            return kind == 1 ? TEXT : FRAME;
        if (kind == 8)
            return ENDED;
    }
}

/* Joins the session. True if the stream opened. */
static bool join(void) {
    char text[512];
    snprintf(text, sizeof text,
             "GET /api/v1/sessions/%s/stream?token=%s HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\n"
             "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
             "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n",
             oom_session, oom_token);
    oom_connect(&stream);
    oom_send(&stream, text, strlen(text));
    stream.bytes[0] = 0;
    const char *end;
    while (!(end = strstr(stream.bytes, "\r\n\r\n")))
        if (!oom_receive(&stream))
            return false;
    int status = atoi(stream.bytes + 9);
    assert_true(status == 101 || status == 503 || status == 500);
    size_t used = (size_t)(end + 4 - stream.bytes);
    stream.have -= used;
    memmove(stream.bytes, stream.bytes + used, stream.have);
    return status == 101;
}

/* Reads until the final frame of update `seq` or the error in its place has arrived. False: the
 * stream ended. */
static bool see(uint32_t seq, bool *failed) {
    const uint8_t *bytes;
    size_t size;
    *failed = false;
    for (;;) {
        switch (next_message(&bytes, &size)) {
        case ENDED:
            return false;
        case TEXT:
            if (strstr((const char *)bytes, "render.error") ||
                strstr((const char *)bytes, "\"error\""))
                *failed = true;
            if (*failed)
                return true;
            break;
        case FRAME: {
            uint32_t number, shown;
            char ack[96];
            memcpy(&number, bytes + 8, 4);
            memcpy(&shown, bytes + 12, 4);
            snprintf(ack, sizeof ack,
                     "{\"jsonrpc\":\"2.0\",\"method\":\"stream.ack\",\"params\":{\"frame\":%u}}",
                     number);
            send_text(ack);
            if (shown == seq && bytes[5] & 2)
                return true;
        }
        }
    }
}

static void update(uint32_t seq, long n) {
    char text[256];
    snprintf(text, sizeof text,
             "{\"jsonrpc\":\"2.0\",\"id\":%u,\"method\":\"view.update\",\"params\":{\"seq\":%u,"
             "\"patch\":{\"background\":[0,0.%ld,0,1]}}}",
             seq, seq, n);
    send_text(text);
}

void oom_streams(void **state) {
    (void)state;
    char path[96];
    long n = 0;
    bool failed;
    memory_forget_places();
    for (bool refused = true; refused; n++) { /* joins and waits for the first frame */
        memory_fail_at_place();
        bool ok = join() && see(0, &failed) && !failed;
        refused = memory_restore();
        assert_true(ok || refused);
        oom_hang_up(&stream);
        if (!ok) { /* a view that failed is rendered again when it changes */
            assert_true(join());
            update(1, n);
            assert_true(see(1, &failed));
            assert_false(failed);
            oom_hang_up(&stream);
        }
    }
    snprintf(path, sizeof path, "sessions/%s/stream", oom_session);
    oom_cover("GET", path);
    print_message("joining: %ld allocations\n", n - 1);
    assert_true(join());
    assert_true(see(0, &failed));
    assert_false(failed);
    uint32_t seq = 0;
    n = 0;
    memory_forget_places();
    for (bool refused = true; refused; n++) {
        memory_fail_at_place();
        update(++seq, 2 * n);
        bool is_open = see(seq, &failed);
        refused = memory_restore();
        if (!refused) {
            assert_true(is_open);
            assert_false(failed);
        }
        if (!is_open) {
            oom_hang_up(&stream);
            assert_true(join());
        }
        update(++seq, 2 * n + 1);
        is_open = see(seq, &failed);
        if (refused &&
            (!is_open || failed)) { /* the acknowledgement failed, which shows only now */
            if (!is_open) {
                oom_hang_up(&stream);
                assert_true(join());
            }
            update(++seq, 500000 + n);
            is_open = see(seq, &failed);
        }
        assert_true(is_open);
        assert_false(failed);
    }
    print_message("an update: %ld allocations\n", n - 1);
    oom_hang_up(&stream);
}
