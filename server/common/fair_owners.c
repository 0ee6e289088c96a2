/* SPDX-License-Identifier: Apache-2.0 */
#include "common/fair_owners.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Returns the index of the owner; `count` if it has no account, because it is not ahead of others.
 */
static unsigned find_owner(const struct srv_fair_owners *owners, const char *name) {
    unsigned i = 0;
    while (i < owners->count && strcmp(owners->list[i].name, name) != 0)
        i++;
    return i;
}

double srv_fair_owners_start(const struct srv_fair_owners *owners, const char *name) {
    unsigned i = find_owner(owners, name);
    return i < owners->count ? srv_fair_start(&owners->list[i].account, owners->clock_ms)
                             : owners->clock_ms;
}

void srv_fair_owners_begin(struct srv_fair_owners *owners, const char *name) {
    owners->clock_ms = srv_fair_owners_start(owners, name);
    for (unsigned i = 0; i < owners->count;)
        if (owners->list[i].account.end_ms <= owners->clock_ms)
            owners->list[i] = owners->list[--owners->count];
        else
            i++;
}

/* Returns the index of the owner that has received the least. */
static unsigned least(const struct srv_fair_owners *owners) {
    unsigned found = 0;
    for (unsigned i = 1; i < owners->count; i++)
        if (owners->list[i].account.end_ms < owners->list[found].account.end_ms)
            found = i;
    return found;
}

void srv_fair_owners_charge(struct srv_fair_owners *owners, const char *name, double ms) {
    unsigned i = find_owner(owners, name);
    if (i == owners->count) {
        i = owners->count < SRV_FAIR_OWNERS_MAX ? owners->count++ : least(owners);
        snprintf(owners->list[i].name, sizeof owners->list[i].name, "%s", name);
        owners->list[i].account = (struct srv_fair_account){ 0 };
    }
    srv_fair_charge(&owners->list[i].account, owners->clock_ms, ms);
}

void srv_fair_owners_reset(struct srv_fair_owners *owners) {
    *owners = (struct srv_fair_owners){ .count = 0 };
}
