/* SPDX-License-Identifier: Apache-2.0
 *
 * A thread for slow work, one piece after the other, so that the HTTP threads and the stream thread
 * never wait for such work. The daemon has six: one for work that waits for a disk (writing
 * uploads, removing files, listing folders), one that measures parts of volumes, one that reads
 * samples for other measurements, one that picks, one that waits for the importer to list series,
 * one that searches the data folder.
 */
#ifndef SRV_COMMON_WORK_QUEUE_H
#define SRV_COMMON_WORK_QUEUE_H

#include <stdbool.h>

#include "common/fair_owners.h"
#include "sp/status.h"

struct srv_work_queue;

struct srv_work { /* the first member of the caller's struct, valid until run() begins */
    /* Runs on the thread of the queue, without a lock, and may free the work or add it again. */
    void (*run)(struct srv_work *work);
    /* owner whose account is charged; "" = no owner, or a guest */
    char owner[SRV_FAIR_OWNER_BYTES];
    struct srv_work *next; /* the queue's */
};

/* `name`: of the thread in the log, a constant; niceness: of common/background.h, 0 = the daemon's
 * own. NULL with *err set: SP_ERR_MEMORY, SP_ERR_IO. */
struct srv_work_queue *srv_work_queue_create(const char *name, int niceness, struct sp_error *err);
/* Returns how many more works of the owner may wait or run, if all owners together may have `most`
 * (common/fair_share.h). */
unsigned srv_work_queue_left(struct srv_work_queue *queue, const char *owner, bool is_limited,
                             unsigned most);
/* Adds work. The work of one owner is done in the order of adding. The next owner is the one whose
 * work took the least time (common/fair_owners.h). Any thread. The caller may hold a lock only if
 * run() does not take it. */
void srv_work_queue_add(struct srv_work_queue *queue, struct srv_work *work);
/* Runs all added work, then ends the thread; accepts NULL. Work that is added later runs at once,
 * on the thread that adds it. One thread at a time. */
void srv_work_queue_stop(struct srv_work_queue *queue);
/* Stops first. Accepts NULL; nulls. */
void srv_work_queue_destroy(struct srv_work_queue **queue);

#endif
