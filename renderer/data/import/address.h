/* SPDX-License-Identifier: Apache-2.0
 *
 * Addresses of remote volumes, "https://host/path.zarr", and which hosts are allowed. Only a simple
 * form is accepted, which every parser reads in the same way.
 */
#ifndef SP_IMPORT_ADDRESS_H
#define SP_IMPORT_ADDRESS_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/status.h"

enum { SP_HOST_BYTES = 256, SP_ADDRESS_BYTES = 2048 };

struct sp_address {
    bool is_secure; /* https */
    char host[SP_HOST_BYTES];
    unsigned port; /* the default of the scheme if the address has none */
};

/* True if the source begins with "http://" or "https://". */
bool sp_address_is_remote(const char *source);

/* Splits an address: a host of letters, digits, '.' and '-', an optional port, and a path without
 * user, query, fragment, spaces, ".." and control characters. SP_ERR_INVALID at `address`. */
bool sp_address_parse(const char *address, struct sp_address *parts, struct sp_error *err);

enum sp_allowed {
    SP_NOT_ALLOWED,
    SP_ALLOWED_PUBLIC, /* by a pattern: only at public IP addresses */
    SP_ALLOWED_ANY,    /* by its name: also at private IP addresses */
};

/* Looks a host up in a list, "HOST,HOST:PORT,*.DOMAIN", NULL = none. Without a port, 80 and 443 are
 * allowed. */
enum sp_allowed sp_address_allowed(const struct sp_address *parts, const char *list);

/* Checks an entry of such a list: SP_ERR_INVALID. */
bool sp_address_check_list(const char *list, const char *place, struct sp_error *err);

/* True for an IPv4 address (4 bytes) or an IPv6 address (16 bytes) that is not public: loopback,
 * private, link-local, shared, multicast, reserved. */
bool sp_address_is_private(const uint8_t *bytes, unsigned size);

#endif
