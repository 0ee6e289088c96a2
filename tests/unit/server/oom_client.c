/* SPDX-License-Identifier: Apache-2.0 */
#include "unit/server/oom.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <arpa/inet.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "server/daemon.h"
#include "support/compare.h"
#include "support/fake_memory.h"

/* The daemon. */

static struct fixture {
    struct srv_config config;
    struct srv_log log;
    struct srv_daemon *daemon;
    char folder[32], token_file[48];
    uint16_t port;
} f;

/* Creates a folder in memory if possible, because these tests do not need a disk. */
static bool make_folder(void) {
    static const char *const places[] = { "/dev/shm", "/tmp" };
    for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
        snprintf(f.folder, sizeof f.folder, "%s/splatd-oom-XXXXXX", places[i]);
        if (mkdtemp(f.folder))
            return true;
    }
    return false;
}

static bool write_tokens(void) {
    snprintf(f.token_file, sizeof f.token_file, "%s/tokens", f.folder);
    FILE *file = fopen(f.token_file, "wx");
    if (!file || fchmod(fileno(file), 0600) != 0)
        return false;
    fprintf(file, "%s name=admin\n%s name=gallery role=render\n", OOM_ADMIN, OOM_GALLERY);
    return fclose(file) == 0;
}

int oom_set_up(void **state) {
    (void)state;
    char url[256];
    if (TEST_TSAN)
        print_message("with ThreadSanitizer: a sample of the allocations\n");
    if (!make_folder() || !write_tokens())
        return -1;
    char *argv[] = { (char *)"splatd",
                     (char *)"--listen",
                     (char *)"127.0.0.1:0",
                     (char *)"--backend",
                     (char *)"null",
                     (char *)"--volume",
                     (char *)"demo:engine?size=8",
                     (char *)"--state",
                     f.folder,
                     (char *)"--data",
                     f.folder,
                     (char *)"--token-file",
                     f.token_file,
                     (char *)"--uploads",
                     (char *)"1000",
                     (char *)"--views",
                     (char *)"1000000",
                     (char *)"--sessions",
                     (char *)"100",
                     (char *)"--rest-time",
                     (char *)"0.001",
                     (char *)"--threads",
                     (char *)"1",
                     NULL };
    if (!srv_config_init(&f.config, NULL) ||
        !srv_config_parse(&f.config, (int)(sizeof argv / sizeof *argv) - 1, argv, NULL))
        return -1;
    if (!srv_log_start(&f.log, SP_LOG_ERROR, SRV_LOG_TEXT, NULL))
        return -1;
    f.daemon = srv_daemon_start(&f.config, &f.log, NULL);
    if (!f.daemon)
        return -1;
    srv_daemon_url(f.daemon, 0, url, sizeof url);
    unsigned port;
    if (sscanf(url, "http://127.0.0.1:%u/", &port) != 1)
        return -1;
    f.port = (uint16_t)port;
    return 0;
}

int oom_tear_down(void **state) {
    (void)state;
    char command[64];
    srv_daemon_stop(&f.daemon);
    srv_log_end(&f.log);
    srv_config_finish(&f.config);
    snprintf(command, sizeof command, "rm -rf '%s'", f.folder);
    return system(command);
}

/* The client. */

struct oom_client oom_http;
const char *oom_token = OOM_ADMIN, *oom_type = OOM_JSON;
char oom_session[64], oom_saved_view[64];

void oom_connect(struct oom_client *client) {
    struct sockaddr_in to = { .sin_family = AF_INET, .sin_port = htons(f.port) };
    struct timeval limit = { .tv_sec = 120 }; /* so that a missing answer fails the test */
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    client->have = 0;
    client->fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_compare(client->fd, >=, 0);
    setsockopt(client->fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    assert_int_equal(connect(client->fd, (struct sockaddr *)&to, sizeof to), 0);
}

void oom_hang_up(struct oom_client *client) {
    if (client->fd >= 0)
        close(client->fd);
    client->fd = -1;
}

void oom_send(struct oom_client *client, const void *bytes, size_t size) {
    if (send(client->fd, bytes, size, MSG_NOSIGNAL) != (ssize_t)size && errno != EPIPE &&
        errno != ECONNRESET)
        fail_msg("cannot send: %s", strerror(errno));
}

bool oom_receive(struct oom_client *client) {
    assert_compare(client->have + 1, <, sizeof client->bytes);
    ssize_t got;
    do
        got = recv(client->fd, client->bytes + client->have,
                   sizeof client->bytes - 1 - client->have, 0);
    while (got < 0 && errno == EINTR); /* SIGCONT interrupts a call that has a time limit */
    if (got < 0 && (errno == EAGAIN || errno == EWOULDBLOCK))
        fail_msg("the daemon does not answer");
    if (got < 0)
        print_message("the connection ended: %s\n", strerror(errno));
    if (got <= 0)
        return false;
    client->have += (size_t)got;
    client->bytes[client->have] = 0;
    return true;
}

void oom_request(const char *method, const char *path, const char *body) {
    char text[2048];
    int size = snprintf(text, sizeof text,
                        "%s %s%s HTTP/1.1\r\nHost: x\r\nConnection: close\r\n"
                        "Authorization: Bearer %s\r\nContent-Type: %s\r\n"
                        "Content-Length: %zu\r\n\r\n%s",
                        method, path[0] == '/' ? "" : "/api/v1/", path, oom_token, oom_type,
                        strlen(body), body);
    assert_compare(size, <, (int)sizeof text);
    oom_connect(&oom_http);
    oom_send(&oom_http, text, (size_t)size);
}

/* True if the answer is complete. */
static bool is_whole(void) {
    const char *body = strstr(oom_http.bytes, "\r\n\r\n");
    const char *length = strstr(oom_http.bytes, "Content-Length: ");
    const char *chunked = strstr(oom_http.bytes, "Transfer-Encoding: chunked");
    if (!body)
        return false;
    size_t size = oom_http.have - (size_t)(body + 4 - oom_http.bytes);
    if (chunked && chunked < body)
        return size >= 5 && memcmp(oom_http.bytes + oom_http.have - 5, "0\r\n\r\n", 5) == 0;
    return !length || length > body || strtoul(length + 16, NULL, 10) == size;
}

int oom_ask(const char *method, const char *path, const char *body) {
    int status = 0;
    oom_request(method, path, body);
    while (oom_receive(&oom_http)) {
    }
    oom_http.bytes[oom_http.have] = 0;
    oom_hang_up(&oom_http);
    if (!is_whole())
        return 0;
    if (sscanf(oom_http.bytes, "HTTP/1.1 %d", &status) != 1)
        fail_msg("no answer: %.200s", oom_http.bytes);
    if (status >= 400 && !strstr(oom_http.bytes, "application/problem+json"))
        fail_msg("no problem document: %.400s", oom_http.bytes);
    return status;
}

void oom_must(const char *method, const char *path, const char *body, int expected) {
    int status = oom_ask(method, path, body);
    if (status != expected)
        fail_msg("%s %s: %d, not %d: %.600s", method, path, status, expected, oom_http.bytes);
}

void oom_member(const char *key, char value[64]) {
    char pattern[32];
    snprintf(pattern, sizeof pattern, "\"%s\":\"", key);
    const char *at = strstr(oom_http.bytes, pattern);
    assert_non_null(at);
    at += strlen(pattern);
    snprintf(value, 64, "%.*s", (int)strcspn(at, "\""), at);
}

/* Checks of every answer. */

bool oom_is_no_memory(int status) {
    return status == 0 || status == 500 || status == 503;
}

bool oom_try(const char *method, const char *path, const char *body, int expected, int *status) {
    memory_fail_at_place();
    *status = oom_ask(method, path, body);
    bool refused = memory_restore();
    if (*status != expected && !(refused && oom_is_no_memory(*status)))
        fail_msg("%s %s while an allocation fails: %d: %.600s", method, path, *status,
                 oom_http.bytes);
    return refused;
}

/* Returns the last answer with each number replaced by #, malloc'ed. */
static char *shape(void) {
    char *text = strdup(oom_http.bytes), *out = text;
    assert_non_null(text);
    for (const char *in = text; *in;) {
        size_t number = strspn(in, "0123456789+-.e");
        bool is_number = number > 0 && strcspn(in, "0123456789") < number;
        if (is_number)
            *out++ = '#';
        else
            *out++ = *in;
        in += is_number ? number : 1;
    }
    *out = 0;
    return text;
}

/* Fails unless the last answer has the shape `whole`. */
static void check_shape(const char *path, const char *whole) {
    char *text = shape();
    if (strcmp(text, whole) != 0)
        fail_msg("the answer of %s is\n%.2000s\ninstead of\n%.2000s", path, text, whole);
    free(text);
}

static long count(const char *pattern) {
    long n = 0;
    for (const char *at = oom_http.bytes; (at = strstr(at, pattern)); at++)
        n++;
    return n;
}

/* Returns the number of objects of the kind that the POST creates; -1: the request creates none. */
static long count_objects(const char *method, const char *path) {
    static const char views[] = "splatd_stored_records{kind=\"view\"} ";
    if (strcmp(method, "POST") != 0)
        return -1;
    if (strcmp(path, "sessions") == 0 || strcmp(path, "paths") == 0) {
        oom_must("GET", path, "", 200);
        return count("\"id\":\"");
    }
    if (strcmp(path, "views") != 0)
        return -1;
    oom_must("GET", "/metrics", "", 200);
    const char *at = strstr(oom_http.bytes, views);
    assert_non_null(at);
    return atol(at + strlen(views));
}

/* Deletes the session or the path that the request has created. */
static void delete_created(const char *method, const char *path) {
    char id[64], created[128];
    if (strcmp(method, "POST") != 0 ||
        (strcmp(path, "sessions") != 0 && strcmp(path, "paths") != 0))
        return;
    oom_member("id", id);
    snprintf(created, sizeof created, "%s/%s", path, id);
    oom_must("DELETE", created, "", 204);
}

void oom_each_allocation(const char *method, const char *path, const char *body, int expected) {
    const char *token = oom_token;
    char text[512], *whole = NULL;
    long n = 0;
    if (strcmp(method, "GET") == 0) {
        oom_must(method, path, "", expected);
        whole = shape();
    }
    memory_forget_places();
    for (bool refused = true; refused; n++) {
        int status;
        snprintf(text, sizeof text, body, n);
        oom_token = OOM_ADMIN;
        long before = count_objects(method, path);
        oom_token = token;
        refused = oom_try(method, path, text, expected, &status);
        if (whole && status == expected)
            check_shape(path, whole);
        if (status >= 500) {
            oom_token = OOM_ADMIN;
            assert_int_equal(count_objects(method, path), before);
            oom_token = token;
        }
        if (status != expected)
            oom_must(method, path, text, expected);
        oom_token = OOM_ADMIN;
        delete_created(method, path);
        oom_token = token;
    }
    free(whole);
    print_message("%s %s: %ld allocations\n", method, path, n - 1);
    assert_compare(n, >, 1);
    oom_cover(method, path);
}

/* Coverage. */

static struct covered { char method[8], path[120]; } covered[96];
static size_t covered_count;

void oom_cover(const char *method, const char *path) {
    struct covered *c = &covered[covered_count++];
    assert_compare(covered_count, <=, sizeof covered / sizeof *covered);
    snprintf(c->method, sizeof c->method, "%s", method);
    snprintf(c->path, sizeof c->path, "%s%.*s", path[0] == '/' ? "" : "/api/v1/",
             (int)strcspn(path, "?"), path);
}

/* True if the path matches the pattern, in which "{…}" stands for one segment. */
static bool matches(const char *pattern, const char *path) {
    while (*pattern && *path) {
        if (*pattern == '{') {
            pattern += strcspn(pattern, "}") + 1;
            path += strcspn(path, "/");
        } else if (*pattern++ != *path++) {
            return false;
        }
    }
    return *pattern == *path;
}

static bool is_covered(const char *method, const char *pattern) {
    for (size_t i = 0; i < covered_count; i++)
        if (strcasecmp(covered[i].method, method) == 0 && matches(pattern, covered[i].path))
            return true;
    return false;
}

/* In openapi.yaml, paths are indented by two blanks, their methods by four. */
void oom_all_is_covered(void **state) {
    (void)state;
    char pattern[128] = "", method[16];
    int operations = 0, missing = 0;
    oom_must("GET", "openapi.yaml", "", 200);
    char *line = strstr(oom_http.bytes, "\npaths:\n");
    assert_non_null(line);
    for (line = strtok(line + 8, "\n"); line && line[0] == ' '; line = strtok(NULL, "\n")) {
        if (sscanf(line, "  /%126[^:]:", pattern + 1) == 1 && line[2] == '/')
            pattern[0] = '/';
        if (strncmp(line, "    ", 4) != 0 ||
            sscanf(line + 4, "%15[a-z]:%n", method, &(int){ 0 }) != 1 || line[4] == ' ' ||
            line[4 + strlen(method)] != ':' || strcmp(method, "parameters") == 0)
            continue;
        operations++;
        if (!is_covered(method, pattern)) {
            missing++;
            print_error("no test of %s %s without memory\n", method, pattern);
        }
    }
    print_message("%d operations of openapi.yaml\n", operations);
    assert_compare(operations, >, 30);
    assert_int_equal(missing, 0);
}
