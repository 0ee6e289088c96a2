/* SPDX-License-Identifier: Apache-2.0
 *
 * A hub whose sessions are saved in memory, for tests of persistence and hibernation. The hub has a
 * single volume, "v", and the test passes the time.
 */
#ifndef TESTS_UNIT_SERVER_SESSION_PERSISTENCE_FIXTURE_H
#define TESTS_UNIT_SERVER_SESSION_PERSISTENCE_FIXTURE_H

#include "config/tokens.h"
#include "session/participant.h"
#include "support/fake_volumes.h"

enum { PERSIST_RECORDS = 8 };

struct persistence_fixture {
    struct srv_hub *hub;
    struct fake_volumes volumes;
    int saves, changes, ends; /* numbers of calls of the callbacks */
    bool is_refused;          /* the backend cannot show any view */
    bool refuses_save;
    char ended[32];                /* id of the session that ended last */
    char id[SRV_SESSION_ID_BYTES]; /* of the session that was created last */
    char text[8192];               /* record of this session, written by persist_save() */
    size_t size;
    unsigned sessions_max;   /* 0 = 2 */
    struct srv_quota *quota; /* of the token ann; NULL = there is no such token */
    double ran_ms;           /* run time of the daemons before this one */
    struct {
        char id[SRV_SESSION_ID_BYTES], *text;
    } records[PERSIST_RECORDS]; /* written by persist_save_each() */
};
extern struct persistence_fixture persist;

extern long persist_allocations; /* allocations of JSON that still succeed; < 0 = all */
extern bool persist_deletes;     /* the next allocation of JSON deletes the session */

/* For cmocka: a hub with one session. */
int persist_set_up(void **state);
int persist_tear_down(void **state);
void persist_create_hub(void);
/* Replaces the hub by a new one that restores the session; its volume is still loading. */
void persist_restart(void);

/* For srv_hub_save(): saves the one session; persist_save_each() saves up to PERSIST_RECORDS. */
bool persist_save(void *user, const char *id, const char *text, size_t size);
bool persist_save_each(void *user, const char *id, const char *text, size_t size);

/* Creates another session of this owner; its id replaces persist.id. */
bool persist_create(const struct srv_owner *owner, bool is_guest, double now_ms,
                    struct sp_error *err);
void persist_patch(const char *text);
struct srv_hub_numbers persist_numbers(void);
/* Returns the session as JSON, which makes it active. The caller frees it. */
char *persist_text(void);
char *persist_text_at(double now_ms);
/* Asserts that the session cannot become active, and that the error says why. */
void persist_is_hibernated_because(const char *why);

#endif
