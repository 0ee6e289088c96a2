/* SPDX-License-Identifier: Apache-2.0
 *
 * splat-fetch: fetches objects of a remote hierarchy over HTTP for splat-import (remote.h). It
 * reaches allowed hosts only, and answers one request after the other, until the socket closes.
 */
#include <arpa/inet.h>
#include <ctype.h>
#include <curl/curl.h>
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "data/import/address.h"
#include "data/import/child.h"
#include "data/import/remote.h"
#include "data/import/sandbox.h"

enum {
    REDIRECTS_MAX = 5,
    TRIES = 3,
    CONNECT_S = 10,
    REQUEST_S = 60,
    SLOW_BYTES = 1024, /* per second, for SLOW_S: the host has stopped sending */
    SLOW_S = 20,
};

struct fetch {
    const char *base, *allowed;
    struct sp_address address; /* of the current request or redirection */
    CURL *curl;
    char *memory;
    /* Of the current request. */
    uint64_t want, got; /* bytes to take */
    uint64_t total;     /* of the object, by Content-Range; UINT64_MAX = unknown */
    bool is_full;       /* more came than is wanted */
    bool is_private;    /* the host has a private IP address, which is not allowed */
    char why[CURL_ERROR_SIZE];
};

static size_t receive_body(char *bytes, size_t one, size_t count, void *user) {
    struct fetch *f = user;
    const uint64_t size = (uint64_t)one * count;
    const uint64_t chunk = size < f->want - f->got ? size : f->want - f->got;
    memcpy(f->memory + f->got, bytes, (size_t)chunk);
    f->got += chunk;
    f->is_full = chunk < size;
    return f->is_full ? 0 : one * count; /* 0 ends the transfer */
}

/* "Content-Range: bytes 0-99/1234", or "bytes STAR/1234" when nothing is there. */
static size_t parse_header(char *line, size_t one, size_t count, void *user) {
    static const char name[] = "content-range: bytes ";
    struct fetch *f = user;
    char text[96] = "";
    memcpy(text, line, count < sizeof text ? count : sizeof text - 1);
    const char *slash = strncasecmp(text, name, sizeof name - 1) == 0 ? strchr(text, '/') : NULL;
    if (slash && isdigit((unsigned char)slash[1]))
        f->total = strtoull(slash + 1, NULL, 10);
    return one * count;
}

/* A host that is allowed by a pattern may not lie in a private network. */
static curl_socket_t open_socket(void *user, curlsocktype purpose, struct curl_sockaddr *to) {
    struct fetch *f = user;
    uint8_t bytes[16];
    unsigned size = 0;
    (void)purpose;
    if (to->family == AF_INET) {
        struct sockaddr_in own;
        memcpy(&own, &to->addr, sizeof own);
        size = 4;
        memcpy(bytes, &own.sin_addr, size);
    } else if (to->family == AF_INET6) {
        struct sockaddr_in6 own;
        memcpy(&own, &to->addr, sizeof own);
        size = 16;
        memcpy(bytes, &own.sin6_addr, size);
    }
    if (sp_address_is_private(bytes, size) &&
        sp_address_allowed(&f->address, f->allowed) != SP_ALLOWED_ANY) {
        f->is_private = true;
        return CURL_SOCKET_BAD;
    }
    return socket(to->family, to->socktype | SOCK_CLOEXEC, to->protocol);
}

/* The address of a key; false if the key is no path below the base. */
static bool make_address(const struct fetch *f, const char *key, char out[SP_ADDRESS_BYTES * 4]) {
    size_t length = strlen(f->base);
    while (length && f->base[length - 1] == '/')
        length--;
    size_t used = (size_t)snprintf(out, SP_ADDRESS_BYTES, "%.*s/", (int)length, f->base);
    if (!*key || *key == '/' || strstr(key, ".."))
        return false;
    for (const char *c = key; *c && used + 4 < (size_t)SP_ADDRESS_BYTES * 4; c++)
        if (isalnum((unsigned char)*c) || strchr("._-~/", *c))
            out[used++] = *c;
        else
            used += (size_t)snprintf(out + used, 4, "%%%02X", (unsigned)(unsigned char)*c);
    out[used] = 0;
    return true;
}

static void fail(struct remote_reply *reply, enum sp_code code, const char *text) {
    reply->found = REMOTE_FAILED;
    reply->code = code;
    snprintf(reply->text, sizeof reply->text, "%s", text);
}

static bool refuse_redirect(struct remote_reply *reply, const struct sp_address *to,
                            const char *why) {
    char text[SP_ERROR_TEXT];
    snprintf(text, sizeof text, "the host redirects to %s://%.200s:%u, %s",
             to->is_secure ? "https" : "http", to->host, to->port, why);
    fail(reply, SP_ERR_DENIED, text);
    return false;
}

/* Where an answer redirects to: only to the same host, not from https to http, and only to a port
 * that the list allows. The IP address is checked again when it connects. */
static bool follow(struct fetch *f, char address[SP_ADDRESS_BYTES * 4],
                   struct remote_reply *reply) {
    struct sp_address to;
    char *location = NULL;
    curl_easy_getinfo(f->curl, CURLINFO_REDIRECT_URL, &location);
    if (!location || !sp_address_parse(location, &to, NULL)) {
        fail(reply, SP_ERR_IO, "the host redirects to an address that is not supported");
        return false;
    }
    if (strcasecmp(to.host, f->address.host) != 0)
        return refuse_redirect(reply, &to, "another host, which is refused; load it from there");
    if (f->address.is_secure && !to.is_secure)
        return refuse_redirect(reply, &to, "without encryption, which is refused");
    if (sp_address_allowed(&to, f->allowed) == SP_NOT_ALLOWED)
        return refuse_redirect(reply, &to, "a port that --allow-host does not list");
    f->address = to;
    snprintf(address, SP_ADDRESS_BYTES * 4, "%s", location);
    return true;
}

/* Explains an error of the transfer in the reply. */
static void explain(const struct fetch *f, CURLcode code, struct remote_reply *reply) {
    char text[SP_ERROR_TEXT];
    const char *host = f->address.host, *detail = f->why[0] ? f->why : curl_easy_strerror(code);
    if (f->is_private)
        snprintf(
            text, sizeof text,
            "%.200s has a private IP address, which only --allow-host with its full name allows",
            host);
    else if (code == CURLE_COULDNT_RESOLVE_HOST)
        snprintf(text, sizeof text, "the host %.200s is not known", host);
    else if (code == CURLE_PEER_FAILED_VERIFICATION)
        snprintf(text, sizeof text, "the certificate of %.120s is not trusted: %.200s", host,
                 detail);
    else if (code == CURLE_OPERATION_TIMEDOUT)
        snprintf(text, sizeof text, "%.120s did not answer in time: %.200s", host, detail);
    else if (code == CURLE_COULDNT_CONNECT)
        snprintf(text, sizeof text, "cannot connect to %.120s: %.200s", host, detail);
    else
        snprintf(text, sizeof text, "cannot fetch it from %.120s: %.200s", host, detail);
    fail(reply, f->is_private ? SP_ERR_DENIED : SP_ERR_IO, text);
}

static bool may_help_again(CURLcode code, long status) {
    return code == CURLE_GOT_NOTHING || code == CURLE_RECV_ERROR || code == CURLE_PARTIAL_FILE ||
           code == CURLE_SEND_ERROR || status == 429 || status == 502 || status == 503;
}

/* Fills the reply from an answer of the host. True if the answer redirects. */
static bool judge(struct fetch *f, const struct remote_request *request, long status,
                  struct remote_reply *reply) {
    curl_off_t length = -1;
    char text[SP_ERROR_TEXT];
    reply->status = (uint32_t)status;
    reply->found = REMOTE_FOUND;
    reply->got = f->got;
    if (status == 206 && f->total != UINT64_MAX) {
        reply->total = f->total;
    } else if (status == 200) { /* the host ignores ranges */
        curl_easy_getinfo(f->curl, CURLINFO_CONTENT_LENGTH_DOWNLOAD_T, &length);
        reply->total = length >= 0 ? (uint64_t)length : request->offset + f->got;
        if (length < 0 && f->is_full)
            fail(reply, SP_ERR_IO,
                 "the host neither states the size of the object nor sends parts of it");
    } else if (status == 416) { /* nothing at that offset */
        reply->got = 0;
        reply->total = f->total != UINT64_MAX ? f->total : request->offset;
    } else if (status == 404 || status == 410 || status == 403) {
        reply->found = REMOTE_MISSING; /* without the right to list, hosts of S3 say 403 for it */
    } else if (status >= 301 && status <= 308 && status != 304) {
        return true;
    } else {
        snprintf(text, sizeof text, "%.200s answered with the status %ld", f->address.host, status);
        fail(reply, status == 401 ? SP_ERR_DENIED : SP_ERR_IO, text);
    }
    return false;
}

/* One request of HTTP, tried again if that may help. */
static CURLcode perform(struct fetch *f, const struct remote_request *request, const char *address,
                        long *status) {
    char range[64];
    CURLcode code = CURLE_OK;
    snprintf(range, sizeof range, "%" PRIu64 "-%" PRIu64, request->offset,
             request->offset + request->size - 1);
    curl_easy_setopt(f->curl, CURLOPT_URL, address);
    curl_easy_setopt(f->curl, CURLOPT_RANGE, range);
    for (int i = 0; i < TRIES; i++) {
        const struct timespec pause = { .tv_nsec = 100000000L * (i ? i : 0) };
        nanosleep(&pause, NULL);
        f->got = 0;
        f->want = request->size;
        f->total = UINT64_MAX;
        f->is_full = f->is_private = false;
        f->why[0] = 0;
        *status = 0;
        code = curl_easy_perform(f->curl);
        curl_easy_getinfo(f->curl, CURLINFO_RESPONSE_CODE, status);
        if (!may_help_again(code, *status))
            break;
    }
    return code == CURLE_WRITE_ERROR && f->is_full ? CURLE_OK : code;
}

static void serve(struct fetch *f, const struct remote_request *request,
                  struct remote_reply *reply) {
    char address[SP_ADDRESS_BYTES * 4];
    long status;
    if (!sp_address_parse(f->base, &f->address, NULL) || !make_address(f, request->key, address) ||
        !request->size || request->size > REMOTE_BUFFER || request->offset > INT64_MAX / 2) {
        reply->found = REMOTE_MISSING;
        return;
    }
    for (int hops = 0; hops <= REDIRECTS_MAX; hops++) {
        const CURLcode code = perform(f, request, address, &status);
        if (code != CURLE_OK) {
            explain(f, code, reply);
            return;
        }
        if (status == 200 && request->offset > 0) {
            fail(reply, SP_ERR_IO,
                 "the host cannot send parts of an object, and it is too large "
                 "to be fetched at once");
            return;
        }
        if (!judge(f, request, status, reply) || !follow(f, address, reply))
            return;
    }
    fail(reply, SP_ERR_IO, "the host redirects too often");
}

static bool set_up(struct fetch *f) {
    const char *certificates = getenv("SSL_CERT_FILE");
    f->curl = curl_easy_init();
    if (!f->curl)
        return false;
#if LIBCURL_VERSION_NUM >= 0x075500
    curl_easy_setopt(f->curl, CURLOPT_PROTOCOLS_STR, "http,https");
#else
    curl_easy_setopt(f->curl, CURLOPT_PROTOCOLS, (long)(CURLPROTO_HTTP | CURLPROTO_HTTPS));
#endif
    curl_easy_setopt(f->curl, CURLOPT_FOLLOWLOCATION, 0L);
    curl_easy_setopt(f->curl, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(f->curl, CURLOPT_PROXY, "");
    curl_easy_setopt(f->curl, CURLOPT_NETRC, (long)CURL_NETRC_IGNORED);
    curl_easy_setopt(f->curl, CURLOPT_CONNECTTIMEOUT, (long)CONNECT_S);
    curl_easy_setopt(f->curl, CURLOPT_TIMEOUT, (long)REQUEST_S);
    curl_easy_setopt(f->curl, CURLOPT_LOW_SPEED_LIMIT, (long)SLOW_BYTES);
    curl_easy_setopt(f->curl, CURLOPT_LOW_SPEED_TIME, (long)SLOW_S);
    curl_easy_setopt(f->curl, CURLOPT_USERAGENT, "splatd");
    curl_easy_setopt(f->curl, CURLOPT_ERRORBUFFER, f->why);
    curl_easy_setopt(f->curl, CURLOPT_WRITEFUNCTION, receive_body);
    curl_easy_setopt(f->curl, CURLOPT_WRITEDATA, f);
    curl_easy_setopt(f->curl, CURLOPT_HEADERFUNCTION, parse_header);
    curl_easy_setopt(f->curl, CURLOPT_HEADERDATA, f);
    curl_easy_setopt(f->curl, CURLOPT_OPENSOCKETFUNCTION, open_socket);
    curl_easy_setopt(f->curl, CURLOPT_OPENSOCKETDATA, f);
    if (certificates)
        curl_easy_setopt(f->curl, CURLOPT_CAINFO, certificates);
    f->memory = mmap(NULL, REMOTE_BUFFER, PROT_READ | PROT_WRITE, MAP_SHARED, SP_IMPORT_MEMORY, 0);
    return f->memory != MAP_FAILED;
}

/* Name resolution and TLS read their configuration, certificates and modules; nothing is written.
 */
static bool confine(const char *title) {
    const char *certificates = getenv("SSL_CERT_FILE");
    const char *const readable[] = { "/etc",       "/usr",       "/lib",
                                     "/lib64",     "/nix/store", "/run/systemd/resolve",
                                     certificates, NULL };
    const struct import_sandbox sandbox = { .first_fd = SP_IMPORT_FILE,
                                            .readable = readable,
                                            .has_network = true };
    return import_sandbox_enter(&sandbox, title, NULL);
}

int main(int argc, char **argv) {
    struct fetch f = { .base = argc == 3 ? argv[1] : "", .allowed = argc == 3 ? argv[2] : "" };
    struct remote_request request;
    if (argc != 3 || !sp_address_parse(f.base, &f.address, NULL)) {
        fprintf(stderr, "splat-fetch is started by splatd; it has no use on its own\n");
        return 2;
    }
    if (sp_address_allowed(&f.address, f.allowed) == SP_NOT_ALLOWED || !confine(f.base) ||
        !set_up(&f))
        return 1;
    for (;;) {
        const ssize_t n = recv(SP_IMPORT_SOCKET, &request, sizeof request, 0);
        if (n < 0 && errno == EINTR)
            continue;
        if (n != (ssize_t)sizeof request || request.magic != REMOTE_MAGIC)
            return 0;
        struct remote_reply reply = { .magic = REMOTE_MAGIC };
        request.key[sizeof request.key - 1] = 0;
        serve(&f, &request, &reply);
        if (send(SP_IMPORT_SOCKET, &reply, sizeof reply, MSG_NOSIGNAL) < 0)
            return 0;
    }
}
