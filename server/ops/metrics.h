/* SPDX-License-Identifier: Apache-2.0
 *
 * What the daemon counts: for /metrics. Counters only rise; times go into histograms. Counting is
 * one or three relaxed atomic additions: it may be done anywhere, under any lock. All functions
 * accept NULL, which counts nothing, and are thread-safe.
 */
#ifndef SRV_METRICS_H
#define SRV_METRICS_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

struct srv_metrics;

/* What a frame or a picture spends its time with. */
enum srv_timing {
    SRV_TIME_QUEUE,    /* from the newest change of its view, or its request, to rendering */
    SRV_TIME_RENDER,   /* all of it, with the next one */
    SRV_TIME_READBACK, /* resolving to pixels in memory */
    SRV_TIME_ENCODE,
    SRV_TIME_SEND,       /* until the socket took all of it */
    SRV_TIME_ROUND_TRIP, /* from the begin of sending to its acknowledgement */
    SRV_TIMINGS
};

enum srv_counter {
    SRV_COUNT_FRAMES,    /* to streams */
    SRV_COUNT_SNAPSHOTS, /* to requests */
    /* Frames that were begun and not sent, but for what the end of the daemon takes away: */
    SRV_COUNT_DROP_REPLACED, /* a newer one came before the socket was free */
    SRV_COUNT_DROP_LATE,     /* a newer one was there already */
    SRV_COUNT_DROP_OUTDATED, /* given up while rendering or before encoding, for a newer view */
    SRV_COUNT_DROP_FAILED,
    SRV_COUNT_DROP_LEFT, /* who asked for it has left */
    /* Streams: */
    SRV_COUNT_JOINED,
    SRV_COUNT_END_CLOSED,   /* by either side, with 1000 or 1001 */
    SRV_COUNT_END_STALLED,  /* --stall-time */
    SRV_COUNT_END_SILENT,   /* --ping-time */
    SRV_COUNT_END_PROTOCOL, /* against RFC 6455, or over a limit */
    SRV_COUNT_END_LOST,     /* without a close */
    SRV_COUNT_BYTES_IN,     /* of streams */
    SRV_COUNT_BYTES_OUT,
    /* Requests by the first digit of their status, and the bytes of their bodies: */
    SRV_COUNT_HTTP_1XX,
    SRV_COUNT_HTTP_2XX,
    SRV_COUNT_HTTP_3XX,
    SRV_COUNT_HTTP_4XX,
    SRV_COUNT_HTTP_5XX,
    SRV_COUNT_HTTP_BYTES_IN,
    SRV_COUNT_HTTP_BYTES_OUT,
    SRV_COUNT_PATH_FRAMES, /* drawn for camera paths */
    /* Frames of camera paths that were put off, each time, by what is waited for: */
    SRV_COUNT_PATH_WAIT_VOLUME, /* loads, could not be loaded, is not there */
    SRV_COUNT_PATH_WAIT_DISK,   /* does not take it */
    SRV_COUNT_PATH_WAIT_LIMIT,  /* --path-bytes or a token's, --render-queue, --video-memory, … */
    SRV_COUNT_PATH_WAIT_MEMORY, /* of the process */
    SRV_COUNT_PATH_WAIT_BACKEND, /* failed */
    SRV_COUNT_PATH_FAILED,       /* paths, for good */
    /* Connections that were refused (http/refusals.h): */
    SRV_COUNT_REFUSED_FULL,
    SRV_COUNT_REFUSED_ADDRESS,
    SRV_COUNT_REFUSED_HANDSHAKE,
    SRV_COUNT_REFUSED_TLS,
    SRV_COUNTERS
};

struct srv_metrics *srv_metrics_create(void); /* NULL when out of memory */
void srv_metrics_destroy(struct srv_metrics **metrics);

void srv_metrics_add(struct srv_metrics *metrics, enum srv_counter counter, uint64_t amount);
void srv_metrics_time(struct srv_metrics *metrics, enum srv_timing timing, double ms);

/* In the Prometheus text format 0.0.4, a family after the other. */
void srv_metrics_print(const struct srv_metrics *metrics, FILE *out);
/* "# HELP" and "# TYPE" of a family. */
void srv_metrics_family(FILE *out, const char *name, const char *type, const char *help);
/* The value of a label, escaped. */
void srv_metrics_label(FILE *out, const char *value);

#endif
