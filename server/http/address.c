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

bool srv_address_is_loopback(const struct sockaddr *address) {
    const struct in6_addr *v6 = &((const struct sockaddr_in6 *)address)->sin6_addr;
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
    } else {
        snprintf(text, SRV_ADDRESS_TEXT, "unknown");
    }
}

void srv_address_to_host(const struct sockaddr *address, char text[SRV_ADDRESS_HOST]) {
    const struct in6_addr *v6 = &((const struct sockaddr_in6 *)address)->sin6_addr;
    const uint8_t *bytes = v6->s6_addr;
    size_t size = IN6_IS_ADDR_V4MAPPED(v6) ? sizeof *v6 : sizeof *v6 / 2, at = 1;
    if (address->sa_family == AF_INET) {
        bytes = (const uint8_t *)&((const struct sockaddr_in *)address)->sin_addr;
        size = sizeof(struct in_addr);
    }
    snprintf(text, SRV_ADDRESS_HOST, "@");
    for (size_t i = 0; i < size; i++, at += 2)
        snprintf(text + at, SRV_ADDRESS_HOST - at, "%02x", bytes[i]);
}

bool srv_address_same_host(const struct sockaddr *a, const struct sockaddr *b) {
    if (a->sa_family != b->sa_family)
        return false;
    if (a->sa_family == AF_INET)
        return ((const struct sockaddr_in *)a)->sin_addr.s_addr ==
               ((const struct sockaddr_in *)b)->sin_addr.s_addr;
    if (a->sa_family != AF_INET6)
        return false;
    const struct in6_addr *a6 = &((const struct sockaddr_in6 *)a)->sin6_addr;
    const struct in6_addr *b6 = &((const struct sockaddr_in6 *)b)->sin6_addr;
    bool is_v4 = IN6_IS_ADDR_V4MAPPED(a6) || IN6_IS_ADDR_V4MAPPED(b6);
    return memcmp(a6, b6, is_v4 ? sizeof *a6 : sizeof *a6 / 2) == 0;
}
