/* SPDX-License-Identifier: Apache-2.0
 *
 * A hub with one session and no sockets, renderer or clock.
 */
#ifndef TESTS_UNIT_SERVER_HUB_FIXTURE_H
#define TESTS_UNIT_SERVER_HUB_FIXTURE_H

#include "schedule/quality.h"
#include "schedule/schedule.h"
#include "session/participant.h"
#include "sp/volume.h"

struct fixture {
    struct srv_hub *hub;
    struct srv_schedule *schedule;
    struct srv_metrics *metrics;
    struct sp_volume_info info;
    struct sp_view view; /* the default view of all volumes */
    int uses;
    unsigned interrupts, yields; /* yields: because something moves; not among the interrupts */
    enum srv_interrupt why;      /* of the last interrupt */
    uint64_t of;
    char id[SRV_SESSION_ID_BYTES];
    struct srv_quota *quota; /* of the token ann; NULL = there is none */
    unsigned rights;         /* of it */
};

/* For cmocka; *state is a struct fixture. The tear-down fails when a use of a volume was not given
 * back. */
int hub_set_up(void **state);
int hub_tear_down(void **state);

struct srv_participant *hub_join(struct fixture *f, enum srv_role role, double now_ms);

#endif
