/* SPDX-License-Identifier: Apache-2.0
 *
 * Counters and histograms for /metrics. Counters only rise; durations go into histograms. Counting
 * is one to three relaxed atomic additions and may be done under any lock. All functions accept a
 * NULL `metrics`, which counts nothing, and are thread-safe.
 */
#ifndef SRV_OPS_METRICS_H
#define SRV_OPS_METRICS_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

struct srv_metrics;

/* The stages of a frame or a snapshot. */
enum srv_timing {
    SRV_TIME_QUEUE,    /* from the newest change of the view, or the request, until rendering */
    SRV_TIME_RENDER,   /* rendering, including readback */
    SRV_TIME_READBACK, /* resolving to pixels in main memory */
    SRV_TIME_ENCODE,
    SRV_TIME_SEND,       /* until the socket took the whole frame */
    SRV_TIME_ROUND_TRIP, /* from the start of sending to the acknowledgement */
    SRV_TIMINGS
};

enum srv_counter {
    SRV_COUNT_FRAMES,    /* sent to streams */
    SRV_COUNT_SNAPSHOTS, /* rendered for requests */
    /* Frames that were started and not sent, except for those that a shutdown cancels: */
    SRV_COUNT_DROP_REPLACED, /* a newer frame was ready before the socket was free */
    SRV_COUNT_DROP_LATE,     /* a newer frame had already been delivered */
    SRV_COUNT_DROP_OUTDATED, /* cancelled for a newer view, while rendering or before encoding */
    SRV_COUNT_DROP_FAILED,   /* rendering or encoding failed */
    SRV_COUNT_DROP_LEFT,     /* the client left */
    /* Streams: */
    SRV_COUNT_JOINED,
    SRV_COUNT_END_CLOSED,   /* by either side, with close code 1000 or 1001 */
    SRV_COUNT_END_STALLED,  /* --stall-time */
    SRV_COUNT_END_SILENT,   /* --ping-time */
    SRV_COUNT_END_PROTOCOL, /* a violation of RFC 6455, or of a limit */
    SRV_COUNT_END_LOST,     /* the connection ended without a close frame */
    SRV_COUNT_BYTES_IN,
    SRV_COUNT_BYTES_OUT,
    /* HTTP requests by the first digit of their status, and the bytes of bodies: */
    SRV_COUNT_HTTP_1XX,
    SRV_COUNT_HTTP_2XX,
    SRV_COUNT_HTTP_3XX,
    SRV_COUNT_HTTP_4XX,
    SRV_COUNT_HTTP_5XX,
    SRV_COUNT_HTTP_BYTES_IN,
    SRV_COUNT_HTTP_BYTES_OUT,
    SRV_COUNT_PATH_FRAMES, /* rendered for camera paths */
    /* Frames of camera paths that were postponed, counted each time, by what is missing: */
    SRV_COUNT_PATH_WAIT_VOLUME,  /* the volume is loading, failed to load, or is unknown */
    SRV_COUNT_PATH_WAIT_DISK,    /* writing to the disk failed */
    SRV_COUNT_PATH_WAIT_LIMIT,   /* --path-bytes, a token's quota, --render-queue, … */
    SRV_COUNT_PATH_WAIT_MEMORY,  /* memory of the process */
    SRV_COUNT_PATH_WAIT_BACKEND, /* the backend failed */
    SRV_COUNT_PATH_FAILED,       /* camera paths that failed for good */
    /* Uploads: */
    SRV_COUNT_UPLOAD_BYTES, /* received */
    SRV_COUNT_UPLOAD_COMPLETE,
    SRV_COUNT_UPLOAD_EXPIRED, /* --upload-time */
    SRV_COUNT_UPLOAD_REMOVED, /* by a client */
    /* Refused connections (http/connection_limits.h): */
    SRV_COUNT_REFUSED_FULL,
    SRV_COUNT_REFUSED_ADDRESS,
    SRV_COUNT_REFUSED_OWNER,
    SRV_COUNT_REFUSED_HANDSHAKE,
    SRV_COUNT_REFUSED_TLS,
    SRV_COUNTERS
};

struct srv_metrics *srv_metrics_create(void); /* NULL when out of memory */
void srv_metrics_destroy(struct srv_metrics **metrics);

void srv_metrics_add(struct srv_metrics *metrics, enum srv_counter counter, uint64_t amount);
void srv_metrics_time(struct srv_metrics *metrics, enum srv_timing timing, double ms);

/* Prints all counters and histograms in the Prometheus text format 0.0.4. That format is a few
 * lines of text; the Prometheus client libraries for C bring their own HTTP server. */
void srv_metrics_print(const struct srv_metrics *metrics, FILE *out);
/* Prints the "# HELP" and "# TYPE" lines of a family. */
void srv_metrics_family(FILE *out, const char *name, const char *type, const char *help);
/* Prints the value of a label, quoted and escaped. */
void srv_metrics_label(FILE *out, const char *value);

#endif
