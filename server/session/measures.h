/* SPDX-License-Identifier: Apache-2.0
 *
 * The measurements of a session, in the order in which they were made. Each belongs to a volume and
 * stays when the session shows another one.
 *
 *   measure.put ──► checked ──► computed (without the hub's mutex) ──► list ──► session.measures
 *                                                                       └────► store
 *
 * The clock of the list rises with each change, and each item has the clock of its last change. So
 * one number per participant tells which items it has not been notified of.
 */
#ifndef SRV_SESSION_MEASURES_H
#define SRV_SESSION_MEASURES_H

#include <stddef.h>
#include <stdint.h>

#include "protocol/measure.h"

enum {
    SRV_MEASURES_MAX = 100,        /* per session */
    SRV_MEASURE_SAMPLES = 1 << 20, /* of a region, most of a tenth of a second */
    SRV_MEASURES_PER_SECOND = 20,  /* changes by one participant; large regions count more */
    SRV_MEASURING_MAX = 16,        /* measurements that take seconds and wait */
    SRV_SAMPLING_MAX = 64          /* measurements that read samples and wait */
};

/* How much work a measurement takes, and which thread computes it. */
enum srv_measure_effort {
    SRV_MEASURE_AT_ONCE, /* microseconds: the calling thread */
    SRV_MEASURE_SOON, /* up to a tenth of a second, or reading from a file: the sampling thread */
    SRV_MEASURE_LONG  /* up to seconds: the measuring thread */
};

enum srv_measure_effort srv_measure_effort_of(enum sp_measure_kind kind);

/* How a measurement comes into the list. */
enum srv_measure_change {
    SRV_MEASURE_MERGE,   /* adds the measurement, or changes only the given members */
    SRV_MEASURE_REPLACE, /* adds the measurement, or replaces all members but id and author */
    SRV_MEASURE_CHANGE   /* changes the given members of an existing measurement */
};

struct srv_measure_item {
    struct proto_measure measure;
    uint64_t clock; /* of its last change */
};

struct srv_measures { /* all zero = none */
    struct srv_measure_item *items;
    size_t count, capacity;
    uint64_t clock;
};

/* Returns the item, NULL = there is none with this id. Valid until the next change. */
struct srv_measure_item *srv_measures_find(const struct srv_measures *measures, const char *id);
/* Adds a measurement, or replaces the measurement with its id. SP_ERR_QUOTA over SRV_MEASURES_MAX,
 * SP_ERR_MEMORY. */
bool srv_measures_put(struct srv_measures *measures, const struct proto_measure *measure,
                      struct sp_error *err);
/* False: there is none with this id. */
bool srv_measures_remove(struct srv_measures *measures, const char *id);
/* Copies all items into `copy`, which is empty. False when out of memory. */
bool srv_measures_copy(const struct srv_measures *measures, struct srv_measures *copy);
void srv_measures_finish(struct srv_measures *measures);

/* Returns an array of all items; NULL when out of memory. */
proto_json *srv_measures_encode(const struct srv_measures *measures);
/* Adds the items of such an array; skips what is not a measurement. False when out of memory. */
bool srv_measures_restore(struct srv_measures *measures, const proto_json *array);

#endif
