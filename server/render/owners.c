/* SPDX-License-Identifier: Apache-2.0 */
#include "render/owners.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* `count` if it has none: it has had no more than others. */
static unsigned find(const struct srv_owners *owners, const char *name) {
    unsigned i = 0;
    while (i < owners->count && strcmp(owners->list[i].name, name) != 0)
        i++;
    return i;
}

double srv_owners_start(const struct srv_owners *owners, const char *name) {
    unsigned i = find(owners, name);
    return i < owners->count ? srv_share_start(&owners->list[i].share, owners->clock_ms)
                             : owners->clock_ms;
}

void srv_owners_take(struct srv_owners *owners, const char *name) {
    owners->clock_ms = srv_owners_start(owners, name);
    for (unsigned i = 0; i < owners->count;)
        if (owners->list[i].share.end_ms <= owners->clock_ms)
            owners->list[i] = owners->list[--owners->count];
        else
            i++;
}

static unsigned least(const struct srv_owners *owners) {
    unsigned found = 0;
    for (unsigned i = 1; i < owners->count; i++)
        if (owners->list[i].share.end_ms < owners->list[found].share.end_ms)
            found = i;
    return found;
}

void srv_owners_spend(struct srv_owners *owners, const char *name, double ms) {
    unsigned i = find(owners, name);
    if (i == owners->count) {
        i = owners->count < SRV_OWNERS_MAX ? owners->count++ : least(owners);
        snprintf(owners->list[i].name, sizeof owners->list[i].name, "%s", name);
        owners->list[i].share = (struct srv_share){ 0 };
    }
    srv_share_take(&owners->list[i].share, owners->clock_ms, ms);
}

void srv_owners_forget(struct srv_owners *owners) {
    *owners = (struct srv_owners){ .count = 0 };
}
