/* SPDX-License-Identifier: Apache-2.0
 *
 * Passes log lines to a writer thread: the thread that logs puts its line into a ring and
 * continues; the writer writes it to standard error. So a reader that stops reading (a pager, a
 * terminal after Ctrl-S, a collector that hangs) blocks no thread of the daemon. Lines that do not
 * fit or cannot be written are counted as lost. After a loss the ring takes no line until it is
 * half empty and the count has been taken, so that the report stands where the lines are missing.
 */
#ifndef SRV_OPS_LOG_RING_H
#define SRV_OPS_LOG_RING_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>

#include "sp/status.h"

enum {
    SRV_LOG_LINE = 4096,
    SRV_LOG_RING = 256 * 1024
}; /* largest line and size of the ring, bytes */

struct srv_log_ring {
    pthread_mutex_t mutex;
    pthread_cond_t filled, written;
    pthread_t thread;
    int fd;
    bool is_writing, is_ending;
    unsigned lost; /* lines lost since the count was taken */
    size_t start, used;
    char bytes[SRV_LOG_RING]; /* records: struct record (log_ring.c), then the line */
};

/* Starts the thread that writes to `fd`, which the caller keeps open. False: SP_ERR_MEMORY. */
bool srv_log_ring_start(struct srv_log_ring *ring, int fd, struct sp_error *err);
/* Adds one line with its newline, at most SRV_LOG_LINE bytes. `lines` is added to the count of lost
 * lines if it is lost. Thread-safe; never waits for the writer. */
void srv_log_ring_put(struct srv_log_ring *ring, const char *line, size_t size, unsigned lines);
/* Takes the count of lost lines; 0 = none, or the ring is still too full to report them.
 * Thread-safe. */
unsigned srv_log_ring_consume_lost(struct srv_log_ring *ring);
/* Waits until all lines are written, and ends the thread. False: that took longer than wait_ms; the
 * thread continues on its own, and the ring must live as long as the program. No line may follow.
 */
bool srv_log_ring_end(struct srv_log_ring *ring, double wait_ms);

#endif
