/* SPDX-License-Identifier: Apache-2.0 */
#include "ops/log_ring.h"

#include <errno.h>
#include <poll.h>
#include <string.h>
#include <unistd.h>

#include "common/clock.h"

struct record {
    size_t size;
    unsigned lines; /* counted if this line is lost */
};

/* The caller of these holds the mutex, except for write_out(). */

static void append(struct srv_log_ring *ring, const void *from, size_t size) {
    size_t at = (ring->start + ring->used) % SRV_LOG_RING;
    size_t first = size < SRV_LOG_RING - at ? size : SRV_LOG_RING - at;
    memcpy(ring->bytes + at, from, first);
    memcpy(ring->bytes, (const char *)from + first, size - first);
    ring->used += size;
}

static void pop(struct srv_log_ring *ring, void *to, size_t size) {
    size_t first = size < SRV_LOG_RING - ring->start ? size : SRV_LOG_RING - ring->start;
    memcpy(to, ring->bytes + ring->start, first);
    memcpy((char *)to + first, ring->bytes, size - first);
    ring->start = (ring->start + size) % SRV_LOG_RING;
    ring->used -= size;
}

static bool is_done(const struct srv_log_ring *ring) {
    return ring->used == 0 && !ring->is_writing;
}

/* Writes a line with one write(), so that lines of several programs do not mix. May block for ever.
 */
static bool write_out(int fd, const char *line, size_t size) {
    while (size > 0) {
        ssize_t count = write(fd, line, size);
        if (count < 0 && errno == EAGAIN)
            poll(&(struct pollfd){ .fd = fd, .events = POLLOUT }, 1, -1);
        else if (count < 0 && errno != EINTR)
            return false;
        line += count > 0 ? count : 0;
        size -= count > 0 ? (size_t)count : 0;
    }
    return true;
}

static void *write_lines(void *user) {
    struct srv_log_ring *ring = user;
    pthread_mutex_lock(&ring->mutex);
    for (;;) {
        while (ring->used == 0 && !ring->is_ending)
            pthread_cond_wait(&ring->filled, &ring->mutex);
        if (ring->used == 0)
            break;
        struct record record;
        char line[SRV_LOG_LINE];
        pop(ring, &record, sizeof record);
        pop(ring, line, record.size);
        ring->is_writing = true;
        pthread_mutex_unlock(&ring->mutex);
        bool ok = write_out(ring->fd, line, record.size);
        pthread_mutex_lock(&ring->mutex);
        ring->is_writing = false;
        ring->lost += ok ? 0 : record.lines;
        pthread_cond_signal(&ring->written);
    }
    pthread_mutex_unlock(&ring->mutex);
    return NULL;
}

bool srv_log_ring_start(struct srv_log_ring *ring, int fd, struct sp_error *err) {
    ring->fd = fd;
    ring->is_writing = ring->is_ending = false;
    ring->lost = 0;
    ring->start = ring->used = 0;
    pthread_mutex_init(&ring->mutex, NULL);
    srv_clock_cond_init(&ring->filled);
    srv_clock_cond_init(&ring->written);
    return pthread_create(&ring->thread, NULL, write_lines, ring) == 0 ||
           sp_fail(err, SP_ERR_MEMORY, NULL, "cannot start the log thread: out of memory");
}

void srv_log_ring_put(struct srv_log_ring *ring, const char *line, size_t size, unsigned lines) {
    const struct record record = { size, lines };
    pthread_mutex_lock(&ring->mutex);
    if (ring->lost > 0 || ring->used + sizeof record + size > SRV_LOG_RING) {
        ring->lost += lines;
    } else {
        append(ring, &record, sizeof record);
        append(ring, line, size);
        pthread_cond_signal(&ring->filled);
    }
    pthread_mutex_unlock(&ring->mutex);
}

unsigned srv_log_ring_consume_lost(struct srv_log_ring *ring) {
    pthread_mutex_lock(&ring->mutex);
    unsigned lost = ring->used <= SRV_LOG_RING / 2 ? ring->lost : 0;
    ring->lost -= lost;
    pthread_mutex_unlock(&ring->mutex);
    return lost;
}

bool srv_log_ring_end(struct srv_log_ring *ring, double wait_ms) {
    struct timespec until = srv_clock_at(srv_clock_ms() + wait_ms);
    pthread_mutex_lock(&ring->mutex);
    ring->is_ending = true;
    pthread_cond_signal(&ring->filled);
    while (!is_done(ring) &&
           pthread_cond_timedwait(&ring->written, &ring->mutex, &until) != ETIMEDOUT)
        ;
    bool done = is_done(ring);
    pthread_mutex_unlock(&ring->mutex);
    if (done)
        pthread_join(ring->thread, NULL);
    else
        pthread_detach(ring->thread);
    return done;
}
