/* SPDX-License-Identifier: Apache-2.0
 *
 * Fair sharing between the owners of snapshots: each owner receives the same time for rendering and
 * encoding (fair_queue.h), however many snapshots it has in the queue. An owner without an account
 * starts at the clock, so idle owners save up no time. When the queue is empty, all accounts
 * are reset. Pure: no clock, no lock.
 */
#ifndef SRV_COMMON_FAIR_OWNERS_H
#define SRV_COMMON_FAIR_OWNERS_H

#include "common/fair_queue.h"

enum {
    SRV_FAIR_OWNER_BYTES = 40, /* bytes of a name, with its NUL */
    SRV_FAIR_OWNERS_MAX =
        64 /* accounts; when all are in use, the owner that received least loses its account */
};

struct srv_fair_owners { /* zero-initialised = no owner has received anything */
    struct {
        char name[SRV_FAIR_OWNER_BYTES];
        struct srv_fair_account account;
    } list[SRV_FAIR_OWNERS_MAX];
    unsigned count;
    double clock_ms; /* virtual start of the newest snapshot */
};

/* Returns the virtual start of the owner's next snapshot. The owner with the smallest start is
 * next. */
double srv_fair_owners_start(const struct srv_fair_owners *owners, const char *name);
/* Starts a snapshot of this owner: the clock advances to its start. */
void srv_fair_owners_begin(struct srv_fair_owners *owners, const char *name);
/* Charges the owner for time that a snapshot took, ms. */
void srv_fair_owners_charge(struct srv_fair_owners *owners, const char *name, double ms);
void srv_fair_owners_reset(struct srv_fair_owners *owners);

#endif
