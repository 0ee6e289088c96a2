/* SPDX-License-Identifier: Apache-2.0
 *
 * Memory runs out while a client is served: the whole daemon in this process, a client on a socket,
 * and an allocator that refuses once, at the n-th time, for every n until nothing is refused. Each
 * time the answer is right, or a problem document of status 500 or 503, or the connection ends; and
 * the next request is answered as ever. What the HTTP, TLS and image libraries allocate themselves
 * is not refused. The leak checker of the ASan build looks on.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <arpa/inet.h>
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "daemon.h"
#include "support/played_memory.h"
#include "support/sanitized.h"

/* The JSON library's own hook; its header belongs to protocol/json.c. */
void json_set_alloc_funcs(void *(*allocate)(size_t), void (*release)(void *));

/* The daemon. */

static struct fixture {
    struct srv_config config;
    struct srv_log log;
    struct srv_daemon *daemon;
    char folder[32], token[80];
    uint16_t port;
} f;

static int set_up(void **state) {
    (void)state;
    char url[256];
    strcpy(f.folder, "/tmp/splatd-oom-XXXXXX");
    char *argv[] = { (char *)"splatd",
                     (char *)"--listen",
                     (char *)"127.0.0.1:0",
                     (char *)"--backend",
                     (char *)"null",
                     (char *)"--volume",
                     (char *)"demo:engine?size=8",
                     (char *)"--state",
                     f.folder,
                     (char *)"--views",
                     (char *)"1000000",
                     (char *)"--sessions",
                     (char *)"100",
                     (char *)"--rest-time",
                     (char *)"0.001",
                     (char *)"--threads",
                     (char *)"1",
                     NULL };
    if (!mkdtemp(f.folder) || !srv_config_init(&f.config, NULL) ||
        !srv_config_parse(&f.config, (int)(sizeof argv / sizeof *argv) - 1, argv, NULL))
        return -1;
    if (!srv_log_start(&f.log, SP_LOG_ERROR, SRV_LOG_TEXT, NULL))
        return -1;
    f.daemon = srv_daemon_start(&f.config, &f.log, NULL);
    if (!f.daemon)
        return -1;
    srv_daemon_url(f.daemon, url, sizeof url);
    unsigned port;
    if (sscanf(url, "http://127.0.0.1:%u/?token=%79s", &port, f.token) != 2)
        return -1;
    f.port = (uint16_t)port;
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    char command[64];
    srv_daemon_stop(&f.daemon);
    srv_log_end(&f.log);
    srv_config_finish(&f.config);
    snprintf(command, sizeof command, "rm -rf '%s'", f.folder);
    return system(command);
}

/* The client. */

struct client {
    int fd;
    size_t have;
    char bytes[1 << 16]; /* that came and were not used, with a NUL behind them */
};
static struct client http, stream = { .fd = -1 };

static void dial(struct client *client) {
    struct sockaddr_in to = { .sin_family = AF_INET, .sin_port = htons(f.port) };
    struct timeval limit = { .tv_sec = 120 }; /* for an answer that never comes */
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    client->have = 0;
    client->fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_true(client->fd >= 0);
    setsockopt(client->fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    assert_int_equal(connect(client->fd, (struct sockaddr *)&to, sizeof to), 0);
}

static void hang_up(struct client *client) {
    if (client->fd >= 0)
        close(client->fd);
    client->fd = -1;
}

static void tell(struct client *client, const void *bytes, size_t size) {
    if (send(client->fd, bytes, size, MSG_NOSIGNAL) != (ssize_t)size && errno != EPIPE &&
        errno != ECONNRESET)
        fail_msg("cannot send: %s", strerror(errno));
}

/* False: the other side has closed. */
static bool hear(struct client *client) {
    assert_true(client->have + 1 < sizeof client->bytes);
    ssize_t got =
        recv(client->fd, client->bytes + client->have, sizeof client->bytes - 1 - client->have, 0);
    if (got < 0 && (errno == EAGAIN || errno == EWOULDBLOCK))
        fail_msg("it hangs");
    if (got <= 0)
        return false;
    client->have += (size_t)got;
    client->bytes[client->have] = 0;
    return true;
}

/* Sends a request whose answer is the last one. */
static void request(const char *method, const char *path, const char *body) {
    char text[2048];
    int size = snprintf(text, sizeof text,
                        "%s /api/v1/%s HTTP/1.1\r\nHost: x\r\nConnection: close\r\n"
                        "Authorization: Bearer %s\r\nContent-Type: application/json\r\n"
                        "Content-Length: %zu\r\n\r\n%s",
                        method, path, f.token, strlen(body), body);
    assert_true(size < (int)sizeof text);
    dial(&http);
    tell(&http, text, (size_t)size);
}

/* Did all of the answer come? */
static bool is_whole(void) {
    const char *body = strstr(http.bytes, "\r\n\r\n");
    const char *length = strstr(http.bytes, "Content-Length: ");
    const char *chunked = strstr(http.bytes, "Transfer-Encoding: chunked");
    if (!body)
        return false;
    size_t size = http.have - (size_t)(body + 4 - http.bytes);
    if (chunked && chunked < body)
        return size >= 5 && memcmp(http.bytes + http.have - 5, "0\r\n\r\n", 5) == 0;
    return !length || length > body || strtoul(length + 16, NULL, 10) == size;
}

/* The status of the answer, which is in http.bytes then; 0 = the connection ended before it did. */
static int ask(const char *method, const char *path, const char *body) {
    int status = 0;
    request(method, path, body);
    while (hear(&http)) {
    }
    http.bytes[http.have] = 0;
    hang_up(&http);
    if (!is_whole())
        return 0;
    if (sscanf(http.bytes, "HTTP/1.1 %d", &status) != 1)
        fail_msg("no answer: %.200s", http.bytes);
    if (status >= 400 && !strstr(http.bytes, "application/problem+json"))
        fail_msg("no problem document: %.400s", http.bytes);
    return status;
}

static void must(const char *method, const char *path, const char *body, int expected) {
    int status = ask(method, path, body);
    if (status != expected)
        fail_msg("%s %s: %d, not %d: %.600s", method, path, status, expected, http.bytes);
}

/* The text behind the first `"key":"` of the last answer. */
static void member(const char *key, char value[64]) {
    char pattern[32];
    snprintf(pattern, sizeof pattern, "\"%s\":\"", key);
    const char *at = strstr(http.bytes, pattern);
    assert_non_null(at);
    at += strlen(pattern);
    snprintf(value, 64, "%.*s", (int)strcspn(at, "\""), at);
}

/* Requests. */

static char session[64], kept[64];

static void wait_for_volume(void) {
    do
        must("GET", "volumes/engine", "", 200);
    while (strstr(http.bytes, "\"loading\""));
    must("POST", "sessions", "{\"view\":{\"size\":[8,8]}}", 201);
    member("id", session);
    must("POST", "views", "{\"size\":[9,9]}", 201);
    member("id", kept);
}

/* Ends what a session or a path costs that was made just now. */
static void forget(const char *method, const char *path) {
    char id[64], made[128];
    if (strcmp(method, "POST") != 0 ||
        (strcmp(path, "sessions") != 0 && strcmp(path, "paths") != 0))
        return;
    member("id", id);
    snprintf(made, sizeof made, "%s/%s", path, id);
    must("DELETE", made, "", 204);
}

/* Is that what is answered when there was no memory? */
static bool is_told(int status) {
    return status == 0 || status == 500 || status == 503 ||
           (status == 400 && strstr(http.bytes, "not valid JSON")); /* see see() */
}

/* `body` has one %ld, so that nothing is there already. */
static void each_allocation(const char *method, const char *path, const char *body, int expected) {
    char text[512];
    long n = 0;
    for (bool refused = true; refused; n++) {
        snprintf(text, sizeof text, body, n);
        memory_run_out(n, MEMORY_FAILS_ONCE);
        int status = ask(method, path, text);
        refused = memory_come_back();
        if (status != expected && !(refused && is_told(status)))
            fail_msg("%s %s with allocation %ld refused: %d: %.600s", method, path, n, status,
                     http.bytes);
        if (status != expected)
            must(method, path, text, expected); /* nothing is broken, and nothing half done */
        forget(method, path);
    }
    print_message("%s %s: %ld allocations\n", method, path, n - 1);
    assert_true(n > 3);
}

static void requests(void **state) {
    (void)state;
    char path[96];
    wait_for_volume();
    each_allocation("GET", "volumes/engine", "", 200);
    each_allocation("GET", "volumes", "", 200);
    each_allocation("GET", "presets", "", 200);
    each_allocation("GET", "sessions", "", 200);
    each_allocation("GET", "views", "", 200);
    each_allocation("POST", "render?format=jpeg", "{\"size\":[8,8],\"camera\":{\"fov_y\":20.%ld}}",
                    200);
    snprintf(path, sizeof path, "render/%s?size=8,8", kept);
    each_allocation("GET", path, "", 200);
    each_allocation("POST", "views", "{\"background\":[0.%ld,0,0,1]}", 201);
    each_allocation("POST", "sessions", "{\"view\":{\"background\":[0.%ld,0,0,1]}}", 201);
    snprintf(path, sizeof path, "sessions/%s", session);
    each_allocation("PATCH", path, "{\"view\":{\"background\":[0.%ld,0,0,1]}}", 200);
    each_allocation("GET", path, "", 200);
}

/* Camera paths. */

#define PATH(format)                                                                               \
    "{\"frames\":1,\"size\":[8,8],\"format\":\"" format "\",\"keyframes\":[{\"frame\":0,"          \
    "\"view\":{\"background\":[0.%ld,0,0,1]}}]}"

static void make_path(const char *body, char id[64]) {
    must("POST", "paths", body, 202);
    member("id", id);
}

/* Follows the events of a path until it is done, or waits for memory, or they end. */
static bool is_done(const char *id) {
    char path[96];
    snprintf(path, sizeof path, "paths/%s/events", id);
    http.bytes[0] = 0;
    request("GET", path, "");
    while (!strstr(http.bytes, "event: done") && !strstr(http.bytes, "\"reason\""))
        if (!hear(&http))
            break;
    hang_up(&http);
    if (strstr(http.bytes, "event: failed"))
        fail_msg("it is given up: %.600s", http.bytes);
    return strstr(http.bytes, "event: done");
}

/* Whenever a path is deleted the others are tried again. */
static void wait_until_done(const char *id) {
    char text[512], other[64], path[96];
    while (!is_done(id)) {
        snprintf(text, sizeof text, PATH("jpeg"), 1L);
        make_path(text, other);
        snprintf(path, sizeof path, "paths/%s", other);
        must("DELETE", path, "", 204);
    }
}

/* Each allocation from the request to the last file: what is missing then is waited for. */
static void each_allocation_of_drawing(void) {
    char text[512], id[64], path[128];
    size_t whole = 0;
    long n = 0;
    const long step = TEST_SANITIZED ? 7 : 1;
    for (bool refused = true; refused; n += step) {
        snprintf(text, sizeof text, PATH("webm"), 5L);
        memory_run_out(n, MEMORY_FAILS_ONCE);
        int status = ask("POST", "paths", text);
        if (status == 202) {
            member("id", id);
            is_done(id);
        }
        refused = memory_come_back();
        assert_true(status == 202 || (refused && is_told(status)));
        if (status != 202)
            make_path(text, id);
        wait_until_done(id);
        snprintf(path, sizeof path, "paths/%s/movie", id);
        must("GET", path, "", 200);
        whole = whole ? whole : http.have;
        assert_int_equal(http.have, whole);
        snprintf(path, sizeof path, "paths/%s", id);
        must("DELETE", path, "", 204);
    }
    print_message("drawing: %ld allocations, one in %ld tried\n", n - step, step);
}

static void each_allocation_of_deleting(void) {
    char text[512], id[64], path[96];
    long n = 0;
    for (bool refused = true; refused; n++) {
        snprintf(text, sizeof text, PATH("png"), n);
        make_path(text, id);
        wait_until_done(id);
        snprintf(path, sizeof path, "paths/%s", id);
        memory_run_out(n, MEMORY_FAILS_ONCE);
        int status = ask("DELETE", path, "");
        refused = memory_come_back();
        assert_true(status == 204 || (refused && is_told(status)));
        int again = ask("DELETE", path, "");
        assert_true(again == 404 || (status != 204 && again == 204));
    }
    print_message("DELETE paths: %ld allocations\n", n - 1);
    assert_true(n > 3);
}

static void paths(void **state) {
    (void)state;
    static const char *const of_frames[] = { "", "/frames/0", "/archive", "/events" };
    char text[512], id[64], movie[64], path[128];
    snprintf(text, sizeof text, PATH("png"), 5L);
    make_path(text, id);
    snprintf(text, sizeof text, PATH("webm"), 5L);
    make_path(text, movie);
    wait_until_done(id);
    wait_until_done(movie);
    each_allocation("POST", "paths", PATH("png"), 202);
    each_allocation("GET", "paths", "", 200);
    for (size_t i = 0; i < sizeof of_frames / sizeof *of_frames; i++) {
        snprintf(path, sizeof path, "paths/%s%s", id, of_frames[i]);
        each_allocation("GET", path, "", 200);
    }
    snprintf(path, sizeof path, "paths/%s/movie", movie);
    each_allocation("GET", path, "", 200);
    each_allocation_of_deleting();
    each_allocation_of_drawing(); /* of a movie, which has all that pictures have but an image */
}

/* A stream. */

enum message { ENDED, TEXT, FRAME };

static void send_text(const char *text) {
    uint8_t frame[1024] = { 0x81 };
    size_t size = strlen(text), head = size < 126 ? 2 : 4;
    assert_true(size + 8 < sizeof frame);
    frame[1] = (uint8_t)(0x80 | (size < 126 ? size : 126));
    if (head == 4) {
        frame[2] = (uint8_t)(size >> 8);
        frame[3] = (uint8_t)size;
    }
    memcpy(frame + head + 4, text, size); /* the mask is 0 */
    tell(&stream, frame, head + 4 + size);
}

/* The next message of the stream: *payload lives until the next call. */
static enum message next_message(const uint8_t **payload, size_t *size) {
    static uint8_t message[sizeof stream.bytes];
    for (;;) {
        const uint8_t *bytes = (const uint8_t *)stream.bytes;
        size_t head = stream.have < 2 ? 2 : (bytes[1] & 127) == 126 ? 4 : 2;
        *size = head == 4 && stream.have >= 4 ? (size_t)(bytes[2] << 8 | bytes[3])
                                              : (size_t)(bytes[1] & 127);
        if (stream.have < head || stream.have < head + *size) {
            if (!hear(&stream))
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

/* Did the stream open? */
static bool join(void) {
    char text[512];
    snprintf(text, sizeof text,
             "GET /api/v1/sessions/%s/stream?token=%s HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\n"
             "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
             "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n",
             session, f.token);
    dial(&stream);
    tell(&stream, text, strlen(text));
    stream.bytes[0] = 0;
    const char *end;
    while (!(end = strstr(stream.bytes, "\r\n\r\n")))
        if (!hear(&stream))
            return false;
    int status = atoi(stream.bytes + 9);
    assert_true(status == 101 || status == 503 || status == 500);
    size_t used = (size_t)(end + 4 - stream.bytes);
    stream.have -= used;
    memmove(stream.bytes, stream.bytes + used, stream.have);
    return status == 101;
}

/* Reads until the final picture of update `seq` came, or the client was told that there is none;
 * false: the stream ended. Without memory the JSON library may take a right message for a wrong
 * one (proto_json_parse()), which is lost then: a client that cannot have that starts anew. */
static bool see(uint32_t seq, bool *failed) {
    const uint8_t *bytes;
    size_t size;
    *failed = false;
    for (;;) {
        switch (next_message(&bytes, &size)) {
        case ENDED:
            return false;
        case TEXT:
            if (strstr((const char *)bytes, "\"id\":null,\"error\":{\"code\":-32700"))
                return false;
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

static void streams(void **state) {
    (void)state;
    long n = 0;
    bool failed;
    for (bool refused = true; refused; n++) { /* to join and see the first picture */
        memory_run_out(n, MEMORY_FAILS_ONCE);
        bool ok = join() && see(0, &failed) && !failed;
        refused = memory_come_back();
        assert_true(ok || refused);
        hang_up(&stream);
        if (!ok) { /* a view that failed is drawn again when it changes */
            assert_true(join());
            update(1, n);
            assert_true(see(1, &failed) && !failed);
            hang_up(&stream);
        }
    }
    print_message("joining: %ld allocations\n", n - 1);
    assert_true(join() && see(0, &failed) && !failed);
    uint32_t seq = 0;
    n = 0;
    for (bool refused = true; refused; n++) {
        memory_run_out(n, MEMORY_FAILS_ONCE);
        update(++seq, 2 * n);
        bool is_open = see(seq, &failed);
        refused = memory_come_back();
        assert_true((is_open && !failed) || refused);
        if (!is_open) {
            hang_up(&stream);
            assert_true(join());
        }
        update(++seq, 2 * n + 1);
        is_open = see(seq, &failed);
        if (refused && (!is_open || failed)) { /* it was the acknowledgement's: told only here */
            if (!is_open) {
                hang_up(&stream);
                assert_true(join());
            }
            update(++seq, 500000 + n);
            is_open = see(seq, &failed);
        }
        assert_true(is_open && !failed);
    }
    print_message("an update: %ld allocations\n", n - 1);
    hang_up(&stream);
}

/* Strangers. */

/* The status for a body of a MiB, all but blanks, and the largest allocation that it brought. */
static int send_much(const char *method, const char *path, const char *token, size_t *largest) {
    enum { BYTES = 1000000 };
    char head[512], *blanks = malloc(BYTES);
    int status = 0;
    assert_non_null(blanks);
    memset(blanks, ' ', BYTES);
    int size = snprintf(head, sizeof head,
                        "%s /api/v1/%s HTTP/1.1\r\nHost: x\r\nConnection: close\r\n%s%s"
                        "Content-Type: application/json\r\nContent-Length: %d\r\n\r\n",
                        method, path, token, token[0] ? "\r\n" : "", BYTES);
    dial(&http);
    memory_take_largest();
    tell(&http, head, (size_t)size);
    tell(&http, blanks, BYTES);
    while (hear(&http)) {
    }
    *largest = memory_take_largest();
    hang_up(&http);
    free(blanks);
    assert_int_equal(sscanf(http.bytes, "HTTP/1.1 %d", &status), 1);
    return status;
}

static void of_who_has_no_token_no_body_is_kept(void **state) {
    (void)state;
    static const char *const strangers[] = { "", "Authorization: Bearer nonsense-nonsense" };
    char known[128], target[96];
    size_t largest;
    wait_for_volume();
    snprintf(target, sizeof target, "sessions/%s", session);
    for (size_t i = 0; i < sizeof strangers / sizeof *strangers; i++) {
        assert_int_equal(send_much("POST", "sessions", strangers[i], &largest), 401);
        assert_in_range(largest, 1, 64 * 1024);
        assert_int_equal(send_much("PATCH", target, strangers[i], &largest), 401);
        assert_in_range(largest, 1, 64 * 1024);
        assert_int_equal(send_much("POST", "views", strangers[i], &largest), 401);
        assert_in_range(largest, 1, 64 * 1024);
    }
    /* And of who has one it is. */
    snprintf(known, sizeof known, "Authorization: Bearer %s", f.token);
    assert_int_equal(send_much("POST", "sessions", known, &largest), 400);
    assert_in_range(largest, 1000000, 8000000);
    must("DELETE", target, "", 204);
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(requests), cmocka_unit_test(paths),
                                        cmocka_unit_test(streams),
                                        cmocka_unit_test(of_who_has_no_token_no_body_is_kept) };
    memory_spare_thread(true);
    signal(SIGPIPE, SIG_IGN);
    memory_play_sqlite();
    json_set_alloc_funcs(malloc, free); /* this program's, which runs out */
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
