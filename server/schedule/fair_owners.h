/* SPDX-License-Identifier: Apache-2.0
 *
 * Whose still is next: owners have equal shares of the time that drawing and encoding their stills
 * takes (session/share.h), however many each has waiting. Who has had nothing for a while starts
 * where the one starts who is served; when nothing waits all is forgotten. Pure: no clock, no lock.
 */
#ifndef SRV_SCHEDULE_FAIR_OWNERS_H
#define SRV_SCHEDULE_FAIR_OWNERS_H

#include "schedule/fair_queue.h"

enum {
    SRV_FAIR_OWNER_BYTES = 40, /* of a name */
    SRV_FAIR_OWNERS_MAX =
        64 /* who have had more than others; of more the one with least is dropped */
};

struct srv_fair_owners { /* zero = nobody has had anything */
    struct {
        char name[SRV_FAIR_OWNER_BYTES];
        struct srv_fair_account share;
    } list[SRV_FAIR_OWNERS_MAX];
    unsigned count;
    double clock_ms;
};

/* Where the owner's next still starts: the least is next. */
double srv_fair_owners_start(const struct srv_fair_owners *owners, const char *name);
/* It is. */
void srv_fair_owners_begin(struct srv_fair_owners *owners, const char *name);
/* A still of the owner took so long. */
void srv_fair_owners_charge(struct srv_fair_owners *owners, const char *name, double ms);
void srv_fair_owners_reset(struct srv_fair_owners *owners);

#endif
