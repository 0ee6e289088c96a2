/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <zlib.h>

#include "http/address.h"
#include "http/connection_limits.h"
#include "http/cors.h"
#include "http/gzip.h"
#include "http/headers.h"
#include "http/listener_private.h"
#include "http/reply.h"
#include "http/router.h"
#include "http/smuggling.h"
#include "support/compare.h"

static void handle_nothing(struct srv_request *request, struct srv_reply *reply) {
    (void)request;
    (void)reply;
}

static const struct srv_route routes[] = {
    { SRV_GET, "/a", SRV_RIGHT_NONE, handle_nothing, { "after", "limit" } },
    { SRV_POST, "/a", SRV_RIGHT_NONE, handle_nothing, { NULL } },
    { SRV_GET, "/a/{}", SRV_RIGHT_NONE, handle_nothing, { NULL } },
    { SRV_DELETE, "/a/{}", SRV_RIGHT_NONE, handle_nothing, { NULL } },
    { SRV_GET, "/a/{}/view", SRV_RIGHT_NONE, handle_nothing, { NULL } },
    { SRV_GET, "/a/{}/b/{}", SRV_RIGHT_NONE, handle_nothing, { NULL } },
};

static void routing(void **state) {
    (void)state;
    char param[SRV_PARAM_BYTES];
    unsigned allowed;
    static const struct {
        const char *method, *path;
        int route; /* -1 = none */
        const char *param;
        unsigned allowed;
    } cases[] = {
        { "GET", "/a", 0, "", 0 },
        { "HEAD", "/a", 0, "", 0 },
        { "POST", "/a", 1, "", 0 },
        { "PUT", "/a", -1, NULL, SRV_GET | SRV_POST },
        { "get", "/a", -1, NULL, SRV_GET | SRV_POST },
        { "GET", "/a/x", 2, "x", 0 },
        { "DELETE", "/a/x.y-z", 3, "x.y-z", 0 },
        { "POST", "/a/x", -1, NULL, SRV_GET | SRV_DELETE },
        { "GET", "/a/x/view", 4, "x", 0 },
        { "GET", "/a/", -1, NULL, 0 },
        { "GET", "/a//view", -1, NULL, 0 },
        { "GET", "/a/x/views", -1, NULL, 0 },
        { "GET", "/a/x/y/view", -1, NULL, 0 },
        { "GET", "", -1, NULL, 0 },
        { "GET", "/b", -1, NULL, 0 },
        { "GET", "/a/x/b/y", 5, "x/y", 0 },
        { "POST", "/a/x/b/y", -1, NULL, SRV_GET },
        { "GET", "/a/x/b/", -1, NULL, 0 },
        { "GET", "/a/x/b/y/", -1, NULL, 0 },
        { "GET", "/a//b/y", -1, NULL, 0 },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const struct srv_route *route =
            srv_route_find(routes, 6, cases[i].method, cases[i].path, param, &allowed);
        assert_ptr_equal(route, cases[i].route < 0 ? NULL : &routes[cases[i].route]);
        if (route)
            assert_string_equal(param, cases[i].param);
        else
            assert_int_equal(allowed, cases[i].allowed);
    }
    char path[SRV_PARAM_BYTES + 8] = "/a/";
    memset(path + 3, 'x', SRV_PARAM_BYTES);
    path[3 + SRV_PARAM_BYTES] = 0;
    assert_null(srv_route_find(routes, 6, "GET", path, param, &allowed));
    path[3 + SRV_PARAM_BYTES - 1] = 0;
    assert_non_null(srv_route_find(routes, 6, "GET", path, param, &allowed));
    memcpy(path + SRV_PARAM_BYTES, "/b/yy", sizeof "/b/yy"); /* one byte too long with the "/" */
    assert_null(srv_route_find(routes, 6, "GET", path, param, &allowed));
    path[SRV_PARAM_BYTES + 4] = 0;
    assert_non_null(srv_route_find(routes, 6, "GET", path, param, &allowed));
    char text[64];
    srv_methods_to_text(SRV_GET | SRV_DELETE, text);
    assert_string_equal(text, "GET, HEAD, DELETE");
}

static void routes_accept_their_query_parameters_and_the_token(void **state) {
    (void)state;
    assert_true(srv_route_accepts(&routes[0], "after"));
    assert_true(srv_route_accepts(&routes[0], "limit"));
    assert_true(srv_route_accepts(&routes[0], "token"));
    assert_false(srv_route_accepts(&routes[0], "Limit"));
    assert_false(srv_route_accepts(&routes[0], ""));
    assert_true(srv_route_accepts(&routes[1], "token"));
    assert_false(srv_route_accepts(&routes[1], "limit"));
}

static void origins(void **state) {
    (void)state;
    static const struct {
        const char *origin, *host;
        bool allowed;
    } cases[] = {
        { NULL, "a:1", true },
        { NULL, NULL, true },
        { "http://a:1", "a:1", true },
        { "https://a:1", "a:1", true },
        { "http://A.Example:1", "a.example:1", true },
        { "http://a", "a", true },
        { "http://a", "a:80", true },
        { "http://a:80", "a", true },
        { "https://a", "a:443", true },
        { "http://[::1]:80", "[::1]", true },
        { "https://a", "a:80", false },
        { "http://a:2", "a:1", false },
        { "http://b:1", "a:1", false },
        { "http://a:1.evil", "a:1", false },
        { "http://a:1/", "a:1", false },
        { "http://evil/a:1", "a:1", false },
        { "http://", "", false },
        { "null", "null", false },
        { "", "a:1", false },
        { "ws://a:1", "a:1", false },
        { "http://a:1", NULL, false },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        assert_int_equal(srv_cors_is_same_origin(cases[i].origin, cases[i].host), cases[i].allowed);
}

static void allowed_origins(void **state) {
    (void)state;
    struct sp_error err;
    static const char *const good[] = { NULL, "http://a", "https://a.b-c:8443,http://[::1]:80" };
    static const char *const bad[] = { "",           "*",
                                       "null",       "a.b",
                                       "ftp://a",    "http://",
                                       "https://a/", "http://a,",
                                       ",http://a",  "http://a, http://b",
                                       "http://a b", "http://user@a" };
    for (size_t i = 0; i < sizeof good / sizeof *good; i++)
        assert_true(srv_cors_check_origins(good[i], &err));
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_false(srv_cors_check_origins(bad[i], &err));
        assert_string_equal(err.place, "--allow-origin");
    }
    static const char list[] = "https://a.b-c:8443,http://x";
    assert_true(srv_cors_allows(list, "https://a.b-c:8443"));
    assert_true(srv_cors_allows(list, "HTTP://X"));
    assert_false(srv_cors_allows(list, "http://x:80"));
    assert_false(srv_cors_allows(list, "https://x"));
    assert_false(srv_cors_allows(list, "http://x.evil"));
    assert_false(srv_cors_allows(list, "http://"));
    assert_false(srv_cors_allows(list, list));
    assert_false(srv_cors_allows(list, ""));
    assert_false(srv_cors_allows(list, NULL));
    assert_false(srv_cors_allows(NULL, "http://x"));
}

static void compression(void **state) {
    (void)state;
    char text[5000], back[5000];
    size_t size;
    for (size_t i = 0; i < sizeof text; i++)
        text[i] = "splat "[i * i % 6];
    assert_true(srv_gzip_is_for("application/json", sizeof text));
    assert_true(srv_gzip_is_for("text/html; charset=utf-8", sizeof text));
    assert_false(srv_gzip_is_for("application/json", 100));
    assert_false(srv_gzip_is_for("image/png", sizeof text));
    assert_false(srv_gzip_is_for(NULL, sizeof text));
    void *gzip = srv_gzip(text, sizeof text, SRV_GZIP_FAST, &size);
    assert_non_null(gzip);
    assert_compare(size, <, sizeof text / 4);
    z_stream z = { .next_in = gzip, .avail_in = (uInt)size };
    z.next_out = (Bytef *)back;
    z.avail_out = sizeof back;
    assert_int_equal(inflateInit2(&z, 15 + 16), Z_OK);
    assert_int_equal(inflate(&z, Z_FINISH), Z_STREAM_END);
    assert_int_equal(z.total_out, sizeof text);
    inflateEnd(&z);
    assert_memory_equal(back, text, sizeof text);
    free(gzip);
    unsigned seed = 1;
    for (size_t i = 0; i < sizeof text; i++)
        text[i] = (char)((seed = seed * 1103515245u + 12345u) >> 16);
    assert_null(
        srv_gzip(text, sizeof text, SRV_GZIP_FAST, &size)); /* compressed noise would be longer */
}

static void accepting(void **state) {
    (void)state;
    assert_float_equal(srv_header_accept_quality(NULL, "image/png"), 1, 0);
    assert_float_equal(srv_header_accept_quality("*/*", "image/png"), 1, 0);
    assert_float_equal(srv_header_accept_quality("text/html", "image/png"), 0, 0);
    assert_float_equal(srv_header_accept_quality("image/*;q=0.5, */*;q=0.1", "image/png"), 0.5,
                       1e-9);
    assert_float_equal(srv_header_accept_quality("image/*, image/png;q=0", "image/png"), 0, 0);
    assert_float_equal(srv_header_accept_quality("image/png;q=0, image/*", "image/png"), 0, 0);
    assert_float_equal(srv_header_accept_quality("IMAGE/PNG ; level=1 ; q=0.25", "image/png"), 0.25,
                       1e-9);
    assert_float_equal(srv_header_accept_quality("image/png;q=2", "image/png"), 0, 0);
    assert_float_equal(srv_header_accept_quality("image/pngx", "image/png"), 0, 0);
    assert_float_equal(srv_header_accept_quality("", "image/png"), 0, 0);
    assert_float_equal(srv_header_accept_quality(",,;q=1,;", "image/png"), 0, 0);
}

static void tokens_and_types(void **state) {
    (void)state;
    assert_true(srv_header_has_token("keep-alive, Upgrade", "upgrade"));
    assert_true(srv_header_has_token(" websocket ", "websocket"));
    assert_false(srv_header_has_token("websocketx", "websocket"));
    assert_false(srv_header_has_token("web socket", "websocket"));
    assert_false(srv_header_has_token(NULL, "websocket"));
    assert_true(srv_header_has_etag("\"a\"", "\"a\""));
    assert_true(srv_header_has_etag("\"b\", W/\"a\"", "\"a\""));
    assert_true(srv_header_has_etag("*", "\"a\""));
    assert_false(srv_header_has_etag("\"ab\"", "\"a\""));
    assert_false(srv_header_has_etag(NULL, "\"a\""));
    assert_string_equal(srv_header_bearer_token("Bearer xyz"), "xyz");
    assert_string_equal(srv_header_bearer_token("bearer  xyz"), "xyz");
    assert_null(srv_header_bearer_token("Basic xyz"));
    assert_null(srv_header_bearer_token(NULL));
    assert_true(srv_header_is_json(NULL));
    assert_true(srv_header_is_json("application/json; charset=utf-8"));
    assert_true(srv_header_is_json("Application/Merge-Patch+JSON"));
    assert_false(srv_header_is_json("application/jsonx"));
    assert_false(srv_header_is_json("text/plain"));
}

static void connections_from_one_host(void **state) {
    (void)state;
    static const struct {
        const char *host;
        int64_t connections, per_address;
        unsigned from;
    } cases[] = {
        { "10.0.0.1:1", 256, 0, 64 },  { "127.0.0.1:1", 256, 0, 256 },
        { "[::1]:1", 256, 0, 256 },    { "10.0.0.1:1", 1, 0, 1 },
        { "10.0.0.1:1", 256, 20, 20 }, { "127.0.0.1:1", 256, 20, 20 },
        { "10.0.0.1:1", 10, 200, 10 },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct srv_address host;
        struct srv_config config = { .connections_per_address = cases[i].per_address };
        struct srv_http http = { .options.config = &config, .connections = cases[i].connections };
        assert_true(srv_address_parse(cases[i].host, &host, NULL));
        assert_int_equal(srv_http_connections_from(&http, (struct sockaddr *)&host.storage),
                         cases[i].from);
    }
}

static unsigned taken(struct srv_host_rate *rate, const char *host, unsigned tries, double now_ms) {
    struct srv_address address;
    unsigned count = 0;
    assert_true(srv_address_parse(host, &address, NULL));
    for (unsigned i = 0; i < tries; i++)
        count += srv_host_rate_spend(rate, &address.storage, now_ms);
    return count;
}

static void rate_per_host(void **state) {
    (void)state;
    struct srv_host_rate rate = { .per_second = 10 }, any = { .per_second = 0 };
    assert_int_equal(taken(&any, "10.0.0.1:1", 100000, 0), 100000);
    /* A burst of 16 seconds, then 10 per second; the port does not matter. */
    assert_int_equal(taken(&rate, "10.0.0.1:1", 1000, 5000), 160);
    assert_int_equal(taken(&rate, "10.0.0.1:2", 1000, 5050), 0);
    assert_int_equal(taken(&rate, "10.0.0.1:3", 1000, 6000), 10);
    for (unsigned i = 1; i <= 20; i++)
        assert_int_equal(taken(&rate, "10.0.0.1:1", 7, 6000 + i * 1000), 7);
    assert_int_equal(taken(&rate, "10.0.0.1:1", 1000, 1e6), 160);
    /* Other hosts have a quota of their own. */
    assert_int_equal(taken(&rate, "10.0.0.2:1", 1000, 1e6), 160);
    assert_int_equal(taken(&rate, "[2001:db8::1]:1", 90, 1e6), 90);
    assert_int_equal(taken(&rate, "[2001:db8::ffff]:1", 90, 1e6),
                     70); /* the same /64 counts as one host */
    /* More hosts than the table holds do not evict the most active one. */
    for (unsigned i = 0; i < 2 * SRV_RATE_HOSTS; i++) {
        char host[32];
        snprintf(host, sizeof host, "10.1.%u.%u:1", i / 256, i % 256);
        assert_int_equal(taken(&rate, host, 1, 1e6), 1);
    }
    assert_int_equal(taken(&rate, "10.0.0.1:1", 1, 1e6), 0);
    assert_int_equal(taken(&rate, "10.0.0.1:1", 1, 1e6 + 101), 1);
}

static void values(void **state) {
    (void)state;
    static const char *const none[] = {
        "", "0", "-1", "+1", "1.0", "1e1", " 1", "1 ", "0x1", "101", "18446744073709551617"
    };
    static const char *const sizes[] = { "",    "1",    "1,",   ",1",   "1,2,",     "1,2,3",
                                         "1x2", " 1,2", "1, 2", "-1,2", "123456,1", "1,123456" };
    unsigned number = 7;
    uint32_t size[2] = { 7, 7 };
    for (size_t i = 0; i < sizeof none / sizeof *none; i++)
        assert_false(srv_query_number(none[i], 100, &number));
    assert_int_equal(number, 7);
    assert_true(srv_query_number("1", 100, &number));
    assert_int_equal(number, 1);
    assert_true(srv_query_number("0100", 100, &number));
    assert_int_equal(number, 100);
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
        assert_false(srv_query_size(sizes[i], size));
    assert_int_equal(size[0], 7);
    assert_int_equal(size[1], 7);
    assert_true(srv_query_size("640,00480", size));
    assert_int_equal(size[0], 640);
    assert_int_equal(size[1], 480);
}

static void ranges(void **state) {
    (void)state;
    static const struct {
        const char *range;
        enum srv_range is;
        uint64_t from, count;
    } cases_of_ten_bytes[] = {
        { NULL, SRV_RANGE_WHOLE, 0, 10 },
        { "bytes=0-0", SRV_RANGE_PARTIAL, 0, 1 },
        { "bytes=3-", SRV_RANGE_PARTIAL, 3, 7 },
        { "bytes=3-99", SRV_RANGE_PARTIAL, 3, 7 },
        { "bytes=9-18446744073709551616", SRV_RANGE_PARTIAL, 9, 1 },
        { "bytes=-3", SRV_RANGE_PARTIAL, 7, 3 },
        { "bytes=-11", SRV_RANGE_PARTIAL, 0, 10 },
        { "bytes=-18446744073709551616", SRV_RANGE_PARTIAL, 0, 10 },
        { "bytes=10-", SRV_RANGE_NONE, 0, 10 },
        { "bytes=18446744073709551616-", SRV_RANGE_NONE, 0, 10 },
        { "bytes=-0", SRV_RANGE_NONE, 0, 10 },
        { "bytes=18446744073709551616-5", SRV_RANGE_WHOLE, 0, 10 },
        { "bytes=5-4", SRV_RANGE_WHOLE, 0, 10 },
        { "bytes=-", SRV_RANGE_WHOLE, 0, 10 },
        { "bytes=", SRV_RANGE_WHOLE, 0, 10 },
        { "bytes=1-2,4-5", SRV_RANGE_WHOLE, 0, 10 },
        { "bytes= 1-2", SRV_RANGE_WHOLE, 0, 10 },
        { "lines=1-2", SRV_RANGE_WHOLE, 0, 10 },
    };
    uint64_t from, count;
    for (size_t i = 0; i < sizeof cases_of_ten_bytes / sizeof *cases_of_ten_bytes; i++) {
        assert_int_equal(
            srv_header_range(cases_of_ten_bytes[i].range, NULL, "\"e\"", 10, &from, &count),
            cases_of_ten_bytes[i].is);
        assert_int_equal(from, cases_of_ten_bytes[i].from);
        assert_int_equal(count, cases_of_ten_bytes[i].count);
    }
    assert_int_equal(srv_header_range("bytes=1-2", "\"e\"", "\"e\"", 10, &from, &count),
                     SRV_RANGE_PARTIAL);
    assert_int_equal(srv_header_range("bytes=1-2", "\"f\"", "\"e\"", 10, &from, &count),
                     SRV_RANGE_WHOLE);
    assert_int_equal(srv_header_range("bytes=0-", NULL, "\"e\"", 0, &from, &count), SRV_RANGE_NONE);
}

/* The first key is from RFC 6455, 1.3, the second from `printf KEY258EAFA5-… | openssl sha1 -binary
 * | base64`. */
static void handshake(void **state) {
    (void)state;
    char accept[SRV_WEBSOCKET_ACCEPT_BYTES];
    assert_true(srv_header_websocket_accept("dGhlIHNhbXBsZSBub25jZQ==", accept));
    assert_string_equal(accept, "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=");
    assert_true(srv_header_websocket_accept("x3JJHMbDL1EzLkh9GBhXDw==", accept));
    assert_string_equal(accept, "HSmrc0sMlYUkAGmm5OPpG2HaGWk=");
}

static void problems(void **state) {
    (void)state;
    struct srv_reply reply = { .status = 0 };
    struct sp_error err;
    sp_fail(&err, SP_ERR_INVALID, "/camera/up", "say \"no\"\n");
    srv_reply_error(&reply, &err);
    assert_int_equal(reply.status, 422);
    assert_string_equal(reply.mime, "application/problem+json");
    assert_int_equal(reply.size, strlen(reply.body));
    assert_non_null(strstr(reply.body, "\"pointer\":\"/camera/up\""));
    assert_non_null(strstr(reply.body, "say \\\"no\\\"\\"));
    srv_reply_finish(&reply);
    sp_fail(&err, SP_ERR_BUDGET, NULL, "full");
    srv_reply_error(&reply, &err);
    assert_int_equal(reply.status, 503);
    assert_string_equal(reply.headers[0].name, "Retry-After");
    srv_reply_finish(&reply);
    srv_reply_header(&reply, "X", "a\r\nY: b");
    assert_string_equal(reply.headers[0].value, "a??Y: b");
    srv_reply_finish(&reply);
}

static void targets(void **state) {
    (void)state;
    char fine[] = "/a&b%20c?x=1&y=%41&&z", nul[] = "/a?token=x%00y", many[256] = "/&?",
         most[256] = "/?";
    assert_int_equal(srv_smuggling_check_target(fine, 22).status, 0);
    assert_string_equal(fine, "/a&b%20c?x=1&y=%41&&z");
    assert_int_equal(srv_smuggling_check_target(nul, 100).status, 400);
    for (int i = 0; i < SRV_QUERY_AMPERSANDS_MAX; i++) {
        strcat(most, "a&");
        strcat(many, "a&");
    }
    assert_int_equal(srv_smuggling_check_target(most, 255).status, 0);
    strcat(many, "b&");
    assert_int_equal(srv_smuggling_check_target(many, 255).status, 414);
    assert_string_equal(many, "/&?");
    assert_int_equal(srv_smuggling_check_target(most, strlen(most) - 1).status, 414);
    assert_string_equal(most, "/?");
}

static void smuggling(void **state) {
    (void)state;
    static const struct {
        unsigned status;
        const char *version, *headers[7]; /* name, value … */
    } cases[] = {
        { 0, "HTTP/1.1", { "Host", "x" } },
        { 0, "HTTP/1.1", { "host", "x", "content-length", "5" } },
        { 0, "HTTP/1.1", { "Host", "x", "Transfer-Encoding", "Chunked" } },
        { 0, "HTTP/1.0", { "Accept", "x" } },
        { 400, "HTTP/1.1", { "Accept", "x" } },
        { 400, "HTTP/1.0", { "Host", "x", "Host", "x" } },
        { 400, "HTTP/1.1", { "Host", "x", "Content-Length", "5", "Content-Length", "5" } },
        { 400, "HTTP/1.1", { "Host", "x", "Content-Length", "5, 5" } },
        { 400, "HTTP/1.1", { "Host", "x", "Content-Length", "+5" } },
        { 400, "HTTP/1.1", { "Host", "x", "Content-Length", "5 " } }, /* not so for the library */
        { 400, "HTTP/1.1", { "Host", "x", "Transfer-Encoding", "chunked " } },
        { 400, "HTTP/1.1", { "Host", "x", "Content-Length", "" } },
        { 400, "HTTP/1.1", { "Host", "x", "Content-Length", "10000000000000000000" } },
        { 400, "HTTP/1.1", { "Host", "x", "Content-Length", "5", "Transfer-Encoding", "chunked" } },
        { 400, "HTTP/1.1", { "Host", "x", "Transfer-Encoding", "gzip, chunked" } },
        { 400, "HTTP/1.1", { "Host", "x", "Transfer-Encoding", "identity" } },
        { 400,
          "HTTP/1.1",
          { "Host", "x", "Transfer-Encoding", "chunked", "Transfer-Encoding", "chunked" } },
        { 400, "HTTP/1.0", { "Host", "x", "Transfer-Encoding", "chunked" } },
        { 400, "HTTP/1.1", { "Host", "x", "Content-Length ", "5" } },
        { 0, "HTTP/1.1", { "Host", "x", "Accept", "a\tb \xc3\xa9" } },
        { 400, "HTTP/1.1", { "Host", "x", "Accept", "a\x01" } },
        { 400, "HTTP/1.1", { "Host", "x", "Accept", "a\x7f" } },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct srv_smuggling seen = { .hosts = 0 };
        for (int h = 0; cases[i].headers[h]; h += 2)
            srv_smuggling_add_header(&seen, cases[i].headers[h], cases[i].headers[h + 1]);
        struct srv_rejection refusal = srv_smuggling_check_headers(&seen, cases[i].version);
        if (refusal.status != cases[i].status)
            fail_msg("case %zu: %u %s", i, refusal.status, refusal.detail);
        assert_int_equal(!refusal.detail, !refusal.status);
    }
}

static void number_of_headers(void **state) {
    (void)state;
    struct srv_smuggling seen = { .hosts = 0 };
    srv_smuggling_add_header(&seen, "Host", "x");
    for (int i = 1; i < SRV_HEADERS_MAX; i++)
        srv_smuggling_add_header(&seen, "A", NULL);
    assert_int_equal(srv_smuggling_check_headers(&seen, "HTTP/1.1").status, 0);
    srv_smuggling_add_header(&seen, "A", "");
    assert_int_equal(srv_smuggling_check_headers(&seen, "HTTP/1.1").status, 431);
}

static void gaps_in_the_request_line(void **state) {
    (void)state;
    static const struct {
        bool is_torn;
        size_t target_size, version; /* up to the first NUL; the offset */
        const char *line;
    } cases[] = {
        { false, 2, 7, "GET\0/a\0HTTP/1.1" },   { false, 4, 9, "GET\0/a b\0HTTP/1.1" },
        { true, 2, 9, "GET\0/a\0b\0HTTP/1.1" }, { true, 2, 8, "GET\0/a\0\0HTTP/1.1" },
        { true, 2, 8, "GE\0T\0/a\0HTTP/1.1" },  { true, 2, 8, "GET\0 /a\0HTTP/1.1" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct srv_smuggling seen = { .hosts = 1 };
        srv_smuggling_begin(&seen, cases[i].line, cases[i].target_size,
                            cases[i].line + cases[i].version);
        if (seen.is_torn != cases[i].is_torn)
            fail_msg("case %zu", i);
    }
}

/* Heads as the HTTP library cuts them: NUL over CR, LF, blanks and colons. */
static void gaps_between_headers(void **state) {
    (void)state;
    static const struct {
        bool is_torn;
        size_t size, names[3], values[3]; /* offsets; 0 = no more */
        const char *head;
    } cases[] = {
        { false, 25, { 10, 0 }, { 17, 0 }, "HTTP/1.1\0\0Host\0  xy z\0\0\0\0" },
        { false, 26, { 10, 18, 0 }, { 15, 21, 0 }, "HTTP/1.1\0\0Host\0x\0\0A\0 b\0\0\0\0" },
        { false, 12, { 0 }, { 0 }, "HTTP/1.1\0\0\0\0" },
        { true, 12, { 10, 0 }, { 15, 0 }, "HTTP/1.1\0\0Host\0x\0\0\0\0" },    /* the end */
        { true, 22, { 10, 0 }, { 15, 0 }, "HTTP/1.1\0\0Host\0x\0y\0\0\0\0" }, /* NUL */
        { true, 21, { 10, 0 }, { 15, 0 }, "HTTP/1.1\0\0Host\0x\0\0\0\0\0" },
        { true, 25, { 10, 17, 0 }, { 15, 20, 0 }, "HTTP/1.1\0\0Host\0x\0A\0 b\0\0\0\0" }, /* LF */
        { true, 19, { 9, 0 }, { 14, 0 }, "HTTP/1.1\0Host\0x\0\0\0\0" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct srv_smuggling seen = { .hosts = 1 };
        char text[64] = "GET\0/a?b"; /* and a blank that became a NUL */
        char *head = text + sizeof "GET /a?b";
        memcpy(head, cases[i].head, cases[i].size);
        srv_smuggling_begin(&seen, text, strlen("/a?b"), head);
        for (int h = 0; h < 3 && cases[i].names[h]; h++)
            srv_smuggling_add_header(&seen, head + cases[i].names[h], head + cases[i].values[h]);
        srv_smuggling_end(&seen, head + cases[i].size);
        if (seen.is_torn != cases[i].is_torn)
            fail_msg("case %zu", i);
    }
    char value[] = " a b\t \t";
    srv_header_trim(value);
    assert_string_equal(value, " a b");
    char blank[] = " ";
    srv_header_trim(blank);
    assert_string_equal(blank, "");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(routing),
        cmocka_unit_test(routes_accept_their_query_parameters_and_the_token),
        cmocka_unit_test(origins),
        cmocka_unit_test(allowed_origins),
        cmocka_unit_test(compression),
        cmocka_unit_test(accepting),
        cmocka_unit_test(tokens_and_types),
        cmocka_unit_test(values),
        cmocka_unit_test(ranges),
        cmocka_unit_test(handshake),
        cmocka_unit_test(problems),
        cmocka_unit_test(targets),
        cmocka_unit_test(smuggling),
        cmocka_unit_test(gaps_in_the_request_line),
        cmocka_unit_test(connections_from_one_host),
        cmocka_unit_test(rate_per_host),
        cmocka_unit_test(number_of_headers),
        cmocka_unit_test(gaps_between_headers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
