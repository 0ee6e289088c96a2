/* SPDX-License-Identifier: Apache-2.0 */
#include "http/owned.h"

#include <stdio.h>
#include <string.h>

#include "http/routes.h"
#include "store/store.h"

/* Names have no characters that JSON would escape. */
void srv_owned_beginning(const struct srv_request *request, char text[SRV_OWNED_BYTES]) {
    snprintf(text, SRV_OWNED_BYTES, "{\"owner\":\"%s\",", request->grant.name);
}

bool srv_owned_add(const struct srv_request *request, enum srv_kind kind, const char *id,
                   const char *text, size_t size, unsigned most, struct sp_error *err) {
    char beginning[SRV_OWNED_BYTES];
    const struct srv_store_owner owner = { .beginning = beginning,
                                           .name = request->grant.name,
                                           .most = most,
                                           .is_limited = request->grant.quota.is_limited };
    srv_owned_beginning(request, beginning);
    return srv_store_add(request->app->store, kind, id, text, size, &owner, err);
}

bool srv_owned_may_change(const struct srv_request *request, const char *record) {
    char beginning[SRV_OWNED_BYTES];
    srv_owned_beginning(request, beginning);
    return request->grant.rights & SRV_RIGHT_ADMIN ||
           strncmp(record, beginning, strlen(beginning)) == 0;
}
