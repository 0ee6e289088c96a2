/* SPDX-License-Identifier: Apache-2.0
 *
 * The way of a line to standard error: who logs puts it into a ring and goes on, and one thread
 * writes it. So a reader of the log that stands still (a pager, a terminal after Ctrl-S, a
 * collector that hangs) stops nobody. What does not fit, or cannot be written, is counted. From the
 * first line that does not fit none is taken until half of the ring is free and somebody takes the
 * count: the line that tells it stands where the others are missing.
 */
#ifndef SRV_LOG_RING_H
#define SRV_LOG_RING_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>

#include "sp/status.h"

enum { SRV_LOG_LINE = 4096, SRV_LOG_RING = 256 * 1024 }; /* bytes of a line, at most, and of all */

struct srv_log_ring {
    pthread_mutex_t mutex;
    pthread_cond_t filled, written;
    pthread_t thread;
    int fd;
    bool is_writing, is_ending;
    unsigned lost; /* lines since the count was taken */
    size_t start, used;
    char bytes[SRV_LOG_RING]; /* of records: struct record in log_ring.c, then the line */
};

/* Starts the thread that writes to fd, which stays the caller's. False: SP_ERR_MEMORY. */
bool srv_log_ring_start(struct srv_log_ring *ring, int fd, struct sp_error *err);
/* One line with its newline, of at most SRV_LOG_LINE bytes; `lines`: for how many it counts if it
 * is lost. Thread-safe; never waits for the writer. */
void srv_log_ring_put(struct srv_log_ring *ring, const char *line, size_t size, unsigned lines);
/* Takes the count of what was lost; 0 = nothing, or there is no room yet to tell of it.
 * Thread-safe. */
unsigned srv_log_ring_take_lost(struct srv_log_ring *ring);
/* Waits until all is written, and ends the thread. False: it was not within wait_ms; the thread
 * goes on by itself, and the ring must live as long as the program. No line may follow. */
bool srv_log_ring_end(struct srv_log_ring *ring, double wait_ms);

#endif
