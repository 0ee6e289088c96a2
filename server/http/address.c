/* SPDX-License-Identifier: Apache-2.0 */
#include "http/address.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

bool srv_address_parse(const char *text, struct srv_address *address, struct sp_error *err) {
    char host[SRV_ADDRESS_TEXT];
    const char *colon = strrchr(text, ':');
    char *end;
    long port = colon && colon[1] >= '0' && colon[1] <= '9' ? strtol(colon + 1, &end, 10) : -1;
    size_t length = colon ? (size_t)(colon - text) : 0;
    if (port < 0 || *end || port > 65535 || length == 0 || length >= sizeof host)
        return sp_fail(err, SP_ERR_INVALID, "--listen", "'%.64s' is not ADDRESS:PORT", text);
    memcpy(host, text, length);
    host[length] = 0;
    memset(address, 0, sizeof *address);
    struct sockaddr_in *v4 = (struct sockaddr_in *)&address->storage;
    struct sockaddr_in6 *v6 = (struct sockaddr_in6 *)&address->storage;
    if (host[0] == '[' && host[length - 1] == ']') {
        host[length - 1] = 0;
        v6->sin6_family = AF_INET6;
        v6->sin6_port = htons((uint16_t)port);
        address->size = sizeof *v6;
        if (inet_pton(AF_INET6, host + 1, &v6->sin6_addr) == 1)
            return true;
    } else {
        v4->sin_family = AF_INET;
        v4->sin_port = htons((uint16_t)port);
        address->size = sizeof *v4;
        const char *number = strcmp(host, "localhost") == 0 ? "127.0.0.1" : host;
        if (inet_pton(AF_INET, number, &v4->sin_addr) == 1)
            return true;
    }
    return sp_fail(err, SP_ERR_INVALID, "--listen",
                   "'%s' is not a numeric address; for IPv6 write [ADDRESS]:PORT", host);
}

/* Splits off the first entry of a list. False: it does not fit. */
static bool next_entry(const char **text, char *entry, size_t size) {
    const size_t length = strcspn(*text, ",");
    snprintf(entry, size, "%.*s", (int)(length < size ? length : size), *text);
    *text += length + ((*text)[length] == ',');
    return length < size;
}

static bool parse_path(const char *path, struct srv_listen *listen, struct sp_error *err) {
    if (!path[0] || strlen(path) >= sizeof listen->path)
        return sp_fail(err, SP_ERR_INVALID, "--listen",
                       "the path behind unix: must have 1 to %zu bytes, which is the limit of the "
                       "system; it has %zu: choose a shorter one, such as $XDG_RUNTIME_DIR/splatd",
                       sizeof listen->path - 1, strlen(path));
    snprintf(listen->path, sizeof listen->path, "%s", path);
    return true;
}

bool srv_listen_parse(const char *text, struct srv_listen *listen, struct sp_error *err) {
    char entry[4096];
    memset(listen, 0, sizeof *listen);
    do {
        const bool fits = next_entry(&text, entry, sizeof entry);
        const bool is_unix = strncmp(entry, "unix:", 5) == 0;
        if (!fits || (is_unix ? listen->path[0] != 0 : listen->has_tcp))
            return sp_fail(err, SP_ERR_INVALID, "--listen",
                           "give one ADDRESS:PORT, one unix:PATH, or both with a comma between "
                           "them; a path has no comma");
        if (is_unix ? !parse_path(entry + 5, listen, err)
                    : !srv_address_parse(entry, &listen->tcp, err))
            return false;
        listen->has_tcp = listen->has_tcp || !is_unix;
    } while (*text);
    return true;
}

socklen_t srv_address_of_user(unsigned user, struct sockaddr_un *address) {
    memset(address, 0, sizeof *address);
    address->sun_family = AF_UNIX;
    snprintf(address->sun_path, sizeof address->sun_path, "user %u", user);
    return sizeof *address;
}

/* The text that srv_address_of_user() wrote. */
static const char *user_of(const struct sockaddr *address) {
    return ((const struct sockaddr_un *)address)->sun_path;
}

bool srv_address_is_loopback(const struct sockaddr *address) {
    const struct in6_addr *v6 = &((const struct sockaddr_in6 *)address)->sin6_addr;
    if (address->sa_family == AF_UNIX)
        return true;
    if (address->sa_family == AF_INET)
        return ntohl(((const struct sockaddr_in *)address)->sin_addr.s_addr) >> 24 == 127;
    return address->sa_family == AF_INET6 &&
           (IN6_IS_ADDR_LOOPBACK(v6) || (IN6_IS_ADDR_V4MAPPED(v6) && v6->s6_addr[12] == 127));
}

void srv_address_to_text(const struct sockaddr *address, char text[SRV_ADDRESS_TEXT]) {
    char host[INET6_ADDRSTRLEN] = "?";
    if (address && address->sa_family == AF_INET) {
        const struct sockaddr_in *v4 = (const struct sockaddr_in *)address;
        inet_ntop(AF_INET, &v4->sin_addr, host, sizeof host);
        snprintf(text, SRV_ADDRESS_TEXT, "%s:%u", host, ntohs(v4->sin_port));
    } else if (address && address->sa_family == AF_INET6) {
        const struct sockaddr_in6 *v6 = (const struct sockaddr_in6 *)address;
        inet_ntop(AF_INET6, &v6->sin6_addr, host, sizeof host);
        snprintf(text, SRV_ADDRESS_TEXT, "[%s]:%u", host, ntohs(v6->sin6_port));
    } else if (address && address->sa_family == AF_UNIX) {
        snprintf(text, SRV_ADDRESS_TEXT, "%.*s", SRV_ADDRESS_TEXT - 1, user_of(address));
    } else {
        snprintf(text, SRV_ADDRESS_TEXT, "unknown");
    }
}

void srv_address_to_host(const struct sockaddr *address, char text[SRV_ADDRESS_HOST]) {
    const struct in6_addr *v6 = &((const struct sockaddr_in6 *)address)->sin6_addr;
    const uint8_t *bytes = v6->s6_addr;
    if (address->sa_family == AF_UNIX) {
        snprintf(text, SRV_ADDRESS_HOST, "@%.*s", SRV_ADDRESS_HOST - 2, user_of(address));
        return;
    }
    size_t size = IN6_IS_ADDR_V4MAPPED(v6) ? sizeof *v6 : sizeof *v6 / 2, at = 1;
    if (address->sa_family == AF_INET) {
        bytes = (const uint8_t *)&((const struct sockaddr_in *)address)->sin_addr;
        size = sizeof(struct in_addr);
    }
    snprintf(text, SRV_ADDRESS_HOST, "@");
    for (size_t i = 0; i < size; i++, at += 2)
        snprintf(text + at, SRV_ADDRESS_HOST - at, "%02x", bytes[i]);
}

size_t srv_address_size(const struct sockaddr *address) {
    return address->sa_family == AF_INET    ? sizeof(struct sockaddr_in)
           : address->sa_family == AF_INET6 ? sizeof(struct sockaddr_in6)
           : address->sa_family == AF_UNIX  ? sizeof(struct sockaddr_un)
                                            : 0;
}

bool srv_address_same_host(const struct sockaddr *a, const struct sockaddr *b) {
    if (a->sa_family != b->sa_family)
        return false;
    if (a->sa_family == AF_INET)
        return ((const struct sockaddr_in *)a)->sin_addr.s_addr ==
               ((const struct sockaddr_in *)b)->sin_addr.s_addr;
    if (a->sa_family == AF_UNIX)
        return strcmp(user_of(a), user_of(b)) == 0;
    if (a->sa_family != AF_INET6)
        return false;
    const struct in6_addr *a6 = &((const struct sockaddr_in6 *)a)->sin6_addr;
    const struct in6_addr *b6 = &((const struct sockaddr_in6 *)b)->sin6_addr;
    bool is_v4 = IN6_IS_ADDR_V4MAPPED(a6) || IN6_IS_ADDR_V4MAPPED(b6);
    return memcmp(a6, b6, is_v4 ? sizeof *a6 : sizeof *a6 / 2) == 0;
}
