/* SPDX-License-Identifier: Apache-2.0 */
#include "cli/http.h"

#include <curl/curl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "protocol/limits.h"

static const size_t response_max = (size_t)2 << 30; /* bytes; the largest EXR image has half */
enum { CONNECT_TIMEOUT_S = 10 };

struct http {
    CURL *curl;
    char *base;  /* scheme, host, port and prefix, without a trailing slash */
    char *token; /* NULL = none */
    unsigned timeout_s;
    bool is_loopback;         /* then no proxy is used */
    bool (*stop)(void *user); /* NULL = never */
    void *user;
};

/* Returns the value of `token` in a query, allocated; NULL if there is none. */
static char *token_of_query(const char *query) {
    for (const char *at = query; at; at = strchr(at, '&') ? strchr(at, '&') + 1 : NULL)
        if (strncmp(at, "token=", 6) == 0) {
            int size = 0;
            char *plain = curl_easy_unescape(NULL, at + 6, (int)strcspn(at + 6, "&"), &size);
            char *copy = plain ? strdup(plain) : NULL;
            curl_free(plain);
            return copy;
        }
    return NULL;
}

static bool split_url(struct http *http, const char *url, struct sp_error *err) {
    CURLU *parts = curl_url();
    char *query = NULL, *base = NULL, *host = NULL;
    CURLUcode code = parts ? curl_url_set(parts, CURLUPART_URL, url, 0) : CURLUE_OUT_OF_MEMORY;
    if (code == CURLUE_OK && curl_url_get(parts, CURLUPART_QUERY, &query, 0) == CURLUE_OK)
        http->token = token_of_query(query);
    if (code == CURLUE_OK && curl_url_get(parts, CURLUPART_HOST, &host, 0) == CURLUE_OK)
        http->is_loopback = strncmp(host, "127.", 4) == 0 || strcmp(host, "localhost") == 0 ||
                            strcmp(host, "[::1]") == 0;
    if (code == CURLUE_OK) {
        curl_url_set(parts, CURLUPART_QUERY, NULL, 0);
        curl_url_set(parts, CURLUPART_FRAGMENT, NULL, 0);
        code = curl_url_get(parts, CURLUPART_URL, &base, 0);
    }
    if (code == CURLUE_OK && strncmp(base, "http://", 7) != 0 && strncmp(base, "https://", 8) != 0)
        code = CURLUE_UNSUPPORTED_SCHEME;
    if (code == CURLUE_OK && (http->base = strdup(base)))
        for (size_t n = strlen(http->base); n > 0 && http->base[n - 1] == '/';)
            http->base[--n] = 0;
    curl_free(base);
    curl_free(query);
    curl_free(host);
    curl_url_cleanup(parts);
    if (http->base)
        return true;
    return sp_fail(err, SP_ERR_INVALID, url, "is not an address like http://HOST:PORT/: %s",
                   curl_url_strerror(code));
}

/* Checks that a token fits into a header line. */
static bool check_token(const char *token, struct sp_error *err) {
    size_t n = strlen(token);
    for (const char *c = token; *c; c++)
        if (*c < 0x21 || *c > 0x7e)
            n = SIZE_MAX;
    return n <= 512 ||
           sp_fail(err, SP_ERR_INVALID, "--token", "must be at most 512 visible ASCII characters");
}

struct http *http_create(const char *url, const char *token, unsigned timeout_s,
                         struct sp_error *err) {
    if (!url)
        url = getenv("SPLATD_URL");
    if (!url || !*url)
        url = "http://127.0.0.1:8080";
    struct http *http = calloc(1, sizeof *http);
    if (http)
        http->curl = curl_easy_init();
    if (!http || !http->curl) {
        sp_fail(err, SP_ERR_MEMORY, "", "cannot set up HTTP");
        http_destroy(&http);
        return NULL;
    }
    http->timeout_s = timeout_s;
    if (!split_url(http, url, err)) {
        http_destroy(&http);
        return NULL;
    }
    if (!token && !http->token)
        token = getenv("SPLATD_TOKEN");
    if (token) {
        free(http->token);
        http->token = strdup(token);
    }
    if (http->token && !check_token(http->token, err))
        http_destroy(&http);
    return http;
}

void http_destroy(struct http **http) {
    struct http *h = *http;
    if (!h)
        return;
    curl_easy_cleanup(h->curl);
    free(h->base);
    free(h->token);
    free(h);
    *http = NULL;
}

void http_set_stop(struct http *http, bool (*stop)(void *user), void *user) {
    http->stop = stop;
    http->user = user;
}

const char *http_base(const struct http *http) {
    return http->base;
}

/* libcurl calls this about once per second and while bytes arrive. Nonzero ends the request. */
static int should_stop(void *user, curl_off_t all, curl_off_t now, curl_off_t up_all,
                       curl_off_t up_now) {
    const struct http *http = user;
    (void)all, (void)now, (void)up_all, (void)up_now;
    return http->stop(http->user);
}

struct receiving {
    CURL *curl;
    struct http_response *response;
    bool (*add)(void *user, const void *bytes, size_t size); /* NULL = append to the response */
    void *user;
};

static size_t receive_body(char *bytes, size_t one, size_t size, void *user) {
    const struct receiving *receiving = user;
    struct http_response *response = receiving->response;
    long status = 0;
    (void)one;
    curl_easy_getinfo(receiving->curl, CURLINFO_RESPONSE_CODE, &status);
    if (receiving->add && status < 400)
        return receiving->add(receiving->user, bytes, size) ? size : 0;
    if (size > response_max - response->size)
        return 0;
    if (response->capacity - response->size <= size) {
        size_t capacity = (response->size + size + 1) * 2;
        char *grown = realloc(response->body, capacity);
        if (!grown)
            return 0;
        response->body = grown;
        response->capacity = capacity;
    }
    memcpy(response->body + response->size, bytes, size);
    response->size += size;
    response->body[response->size] = 0;
    return size;
}

/* Copies the value of the header `name` from a header line. */
static void keep_header(const char *line, size_t size, const char *name, char *out,
                        size_t capacity) {
    size_t n = strlen(name);
    if (size <= n || strncasecmp(line, name, n) != 0 || line[n] != ':')
        return;
    for (n++; n < size && line[n] == ' ';)
        n++;
    size_t length = 0;
    while (n < size && line[n] != '\r' && line[n] != '\n' && line[n] != ';' &&
           length + 1 < capacity)
        out[length++] = line[n++];
    out[length] = 0;
}

static size_t receive_header(char *line, size_t one, size_t size, void *user) {
    struct http_response *response = user;
    (void)one;
    keep_header(line, size, "Content-Type", response->type, sizeof response->type);
    keep_header(line, size, "X-Backend", response->backend, sizeof response->backend);
    keep_header(line, size, "X-Complete", response->complete, sizeof response->complete);
    keep_header(line, size, "X-Level", response->level, sizeof response->level);
    keep_header(line, size, "X-Level-Asked", response->asked, sizeof response->asked);
    keep_header(line, size, "X-Bricks-Lost", response->lost, sizeof response->lost);
    keep_header(line, size, "Retry-After", response->retry_after, sizeof response->retry_after);
    keep_header(line, size, "X-Render-Time", response->render_time, sizeof response->render_time);
    keep_header(line, size, "X-Splats", response->splats, sizeof response->splats);
    return size;
}

static struct curl_slist *make_headers(const struct http *http, const char *accept, bool body) {
    struct curl_slist *headers = NULL;
    char line[1024];
    if (http->token) {
        snprintf(line, sizeof line, "Authorization: Bearer %s", http->token);
        headers = curl_slist_append(headers, line);
    }
    snprintf(line, sizeof line, "Accept: %s", accept);
    headers = curl_slist_append(headers, line);
    if (body)
        headers = curl_slist_append(headers, "Content-Type: application/json");
    return curl_slist_append(headers, "Expect:");
}

/* Converts the problem document of an answer to an error. */
static bool refuse_status(struct http_response *response, const char *method, const char *path,
                          struct sp_error *err) {
    char place[SP_ERROR_PLACE];
    snprintf(place, sizeof place, "%s %s", method, path);
    proto_json *problem =
        strstr(response->type, "json") && response->body
            ? proto_json_parse(response->body, strnlen(response->body, PROTO_BODY_MAX), NULL)
            : NULL;
    const char *detail = proto_json_string(proto_json_get(problem, "detail"));
    const char *title = proto_json_string(proto_json_get(problem, "title"));
    const char *pointer = proto_json_string(proto_json_get(problem, "pointer"));
    snprintf(response->pointer, sizeof response->pointer, "%s", pointer ? pointer : "");
    if (!detail)
        detail = title;
    const char *hint =
        response->status == 401 ? "; pass the daemon's token by --token or in the URL" : "";
    if (detail)
        sp_fail(err, SP_ERR_INVALID, response->pointer[0] ? pointer : place, "%s (HTTP %ld)%s",
                detail, response->status, hint);
    else
        sp_fail(err, SP_ERR_INVALID, place, "HTTP status %ld%s", response->status, hint);
    proto_json_free(&problem);
    return false;
}

static size_t ignore_body(char *bytes, size_t one, size_t size, void *user) {
    (void)bytes, (void)one, (void)user;
    return size;
}

/* True if the server of an https address answers plain HTTP. The request has no token. */
static bool answers_without_tls(const struct http *http) {
    char *url = NULL;
    long status = 0;
    CURL *curl = curl_easy_init();
    if (curl && asprintf(&url, "http%s/", http->base + strlen("https")) >= 0) {
        curl_easy_setopt(curl, CURLOPT_URL, url);
        curl_easy_setopt(curl, CURLOPT_NOBODY, 1L);
        curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
        curl_easy_setopt(curl, CURLOPT_TIMEOUT, (long)CONNECT_TIMEOUT_S);
        curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, ignore_body);
        if (http->is_loopback)
            curl_easy_setopt(curl, CURLOPT_PROXY, "");
        if (curl_easy_perform(curl) == CURLE_OK)
            curl_easy_getinfo(curl, CURLINFO_RESPONSE_CODE, &status);
    }
    curl_easy_cleanup(curl);
    free(url);
    return status > 0;
}

/* Says why there is no answer. `why` is libcurl's text. */
static bool refuse_transfer(const struct http *http, CURLcode code, const char *why,
                            struct sp_error *err) {
    if (code == CURLE_ABORTED_BY_CALLBACK)
        return sp_fail(err, SP_ERR_CANCELLED, http->base, "interrupted");
    if (code == CURLE_WRITE_ERROR)
        return sp_fail(err, SP_ERR_MEMORY, http->base,
                       "out of memory for the answer, or over 2 GiB");
    if (code == CURLE_SSL_CONNECT_ERROR && answers_without_tls(http))
        return sp_fail(err, SP_ERR_INVALID, http->base,
                       "this server speaks HTTP without TLS; use http%s",
                       http->base + strlen("https"));
    return sp_fail(err, SP_ERR_IO, http->base, "%s", *why ? why : curl_easy_strerror(code));
}

/* The body of a request, which curl reads piece by piece. */
struct sent_body {
    int64_t offset, size;
    size_t (*read)(void *user, void *bytes, size_t size);
    void *user;
    bool is_short; /* read() had no more */
};

static size_t send_body(char *bytes, size_t one, size_t count, void *user) {
    struct sent_body *sent = user;
    size_t size = sent->read(sent->user, bytes, one * count);
    sent->is_short = size == 0;
    return sent->is_short ? CURL_READFUNC_ABORT : size;
}

static struct curl_slist *set_sent_body(CURL *curl, struct curl_slist *headers,
                                        struct sent_body *sent) {
    char line[64];
    curl_easy_setopt(curl, CURLOPT_UPLOAD, 1L);
    curl_easy_setopt(curl, CURLOPT_READFUNCTION, send_body);
    curl_easy_setopt(curl, CURLOPT_READDATA, sent);
    curl_easy_setopt(curl, CURLOPT_INFILESIZE_LARGE, (curl_off_t)sent->size);
    snprintf(line, sizeof line, "Upload-Offset: %lld", (long long)sent->offset);
    headers = curl_slist_append(headers, line);
    return curl_slist_append(headers, "Content-Type: application/offset+octet-stream");
}

static bool perform(struct http *http, const char *method, const char *path, const char *accept,
                    const char *body, struct sent_body *sent, struct receiving *receiving,
                    struct sp_error *err) {
    struct http_response *response = receiving->response;
    *response = (struct http_response){ 0 };
    size_t capacity = strlen(http->base) + strlen(path) + 16;
    char *url = malloc(capacity);
    if (!url)
        return sp_fail(err, SP_ERR_MEMORY, path, "out of memory");
    snprintf(url, capacity, "%s/api/v1%s", http->base, path);
    struct curl_slist *headers = make_headers(http, accept, body != NULL);
    char why[CURL_ERROR_SIZE] = "";
    CURL *curl = http->curl;
    curl_easy_reset(curl);
    curl_easy_setopt(curl, CURLOPT_URL, url);
    curl_easy_setopt(curl, CURLOPT_PROTOCOLS_STR, "http,https");
    if (sent)
        headers = set_sent_body(curl, headers, sent);
    curl_easy_setopt(curl, CURLOPT_CUSTOMREQUEST, method);
    curl_easy_setopt(curl, CURLOPT_HTTPHEADER, headers);
    curl_easy_setopt(curl, CURLOPT_USERAGENT, "splatctl/" SPLATD_VERSION);
    curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(curl, CURLOPT_CONNECTTIMEOUT, (long)CONNECT_TIMEOUT_S);
    /* Limits the time without a byte, not the whole answer. */
    curl_easy_setopt(curl, CURLOPT_LOW_SPEED_LIMIT, 1L);
    curl_easy_setopt(curl, CURLOPT_LOW_SPEED_TIME, (long)http->timeout_s);
    if (http->stop) {
        curl_easy_setopt(curl, CURLOPT_NOPROGRESS, 0L);
        curl_easy_setopt(curl, CURLOPT_XFERINFOFUNCTION, should_stop);
        curl_easy_setopt(curl, CURLOPT_XFERINFODATA, http);
    }
    curl_easy_setopt(curl, CURLOPT_ERRORBUFFER, why);
    curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, receive_body);
    receiving->curl = curl;
    curl_easy_setopt(curl, CURLOPT_WRITEDATA, receiving);
    curl_easy_setopt(curl, CURLOPT_HEADERFUNCTION, receive_header);
    curl_easy_setopt(curl, CURLOPT_HEADERDATA, response);
    if (http->is_loopback)
        curl_easy_setopt(curl, CURLOPT_PROXY, "");
    if (body) {
        curl_easy_setopt(curl, CURLOPT_POSTFIELDS, body);
        curl_easy_setopt(curl, CURLOPT_POSTFIELDSIZE_LARGE, (curl_off_t)strlen(body));
    }
    CURLcode code = headers ? curl_easy_perform(curl) : CURLE_OUT_OF_MEMORY;
    curl_easy_getinfo(curl, CURLINFO_RESPONSE_CODE, &response->status);
    curl_slist_free_all(headers);
    free(url);
    if (sent && sent->is_short)
        return sp_fail(err, SP_ERR_INVALID, path, "the file became shorter while it was sent");
    if (code != CURLE_OK)
        return refuse_transfer(http, code, why, err);
    return response->status < 400 || refuse_status(response, method, path, err);
}

bool http_request(struct http *http, const char *method, const char *path, const char *accept,
                  const char *body, struct http_response *response, struct sp_error *err) {
    struct receiving receiving = { .response = response };
    return perform(http, method, path, accept, body, NULL, &receiving, err);
}

bool http_fetch(struct http *http, const char *path, const char *accept,
                bool (*add)(void *user, const void *bytes, size_t size), void *user,
                struct http_response *response, struct sp_error *err) {
    struct receiving receiving = { .response = response, .add = add, .user = user };
    return perform(http, "GET", path, accept, NULL, NULL, &receiving, err);
}

void http_response_finish(struct http_response *response) {
    free(response->body);
    *response = (struct http_response){ 0 };
}

bool http_send(struct http *http, const char *path, int64_t offset, int64_t size,
               size_t (*read)(void *user, void *bytes, size_t size), void *user,
               struct http_response *response, struct sp_error *err) {
    struct receiving receiving = { .response = response };
    struct sent_body sent = { .offset = offset, .size = size, .read = read, .user = user };
    return perform(http, "PATCH", path, "application/json", NULL, &sent, &receiving, err);
}

/* Requests JSON. The caller finishes the response. */
static proto_json *request_json(struct http *http, const char *method, const char *path,
                                const char *body, struct http_response *response,
                                struct sp_error *err) {
    if (!http_request(http, method, path, "application/json", body, response, err))
        return NULL;
    proto_json *json = proto_json_parse(response->body ? response->body : "", response->size, err);
    if (!json && err)
        snprintf(err->place, sizeof err->place, "%s %s", method, path);
    return json;
}

proto_json *http_json(struct http *http, const char *method, const char *path, const char *body,
                      struct sp_error *err) {
    struct http_response response;
    proto_json *json = request_json(http, method, path, body, &response, err);
    http_response_finish(&response);
    return json;
}

proto_json *http_post(struct http *http, const char *path, proto_json *body, const char *member,
                      const char *name, struct sp_error *err) {
    struct http_response response = { 0 };
    char *text = proto_json_to_text(body, NULL);
    proto_json *answer = text ? request_json(http, "POST", path, text, &response, err) : NULL;
    if (!text)
        sp_fail(err, SP_ERR_MEMORY, path, "out of memory");
    else if (!answer && member && strcmp(response.pointer, member) == 0)
        snprintf(err->place, sizeof err->place, "%s", name);
    http_response_finish(&response);
    proto_json_free(&body);
    free(text);
    return answer;
}

char *http_escape(struct http *http, const char *text) {
    char *escaped = curl_easy_escape(http->curl, text, 0);
    char *copy = escaped ? strdup(escaped) : NULL;
    curl_free(escaped);
    return copy;
}
