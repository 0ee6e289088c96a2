/* SPDX-License-Identifier: Apache-2.0
 *
 * The daemon's parts that draw, without HTTP: a catalog, a scheduler whose lanes have the null
 * backend, and a hub. What goes wrong fails the test.
 */
#ifndef TESTS_SUPPORT_LANES_H
#define TESTS_SUPPORT_LANES_H

#include "ops/metrics.h"
#include "render/scheduler.h"

struct lanes {
    struct srv_metrics *metrics; /* of the scheduler */
    struct srv_catalog *catalog;
    struct srv_scheduler *scheduler;
    struct srv_hub *hub;
    void (*volume)(const char *id, const char *state);
};

struct lanes_options {
    unsigned queue_max;      /* stills that may wait */
    unsigned encode_threads; /* 0 = one */
    double rest_ms;          /* after which a view is at rest */
    uint64_t memory_bytes;   /* of voxels; 0 = a mebibyte */
    bool is_empty;           /* no volume is loaded */
    /* What the catalog tells of volumes, from its threads. NULL = nothing. */
    void (*volume)(const char *id, const char *state);
};

/* demo:phantom, 8 voxels a side, is loaded if nothing else is wanted, and the scheduler runs. Two
 * sessions may be, of two participants each. `lanes` stays where it is. */
void lanes_begin(struct lanes *lanes, const struct lanes_options *options);
/* Loads it, and waits until it is ready. */
void lanes_load(struct lanes *lanes, const char *source);
/* Begins to load it under this id, NULL = its own; and tells how that ends. */
void lanes_queue(struct lanes *lanes, const char *id, const char *source);
enum srv_volume_state lanes_try(struct lanes *lanes, const char *id, const char *source);
/* Makes a session of the first volume's default view. */
void lanes_session(struct lanes *lanes, char id[SRV_SESSION_ID_BYTES]);
struct srv_participant *lanes_join(struct lanes *lanes, const char *id, enum srv_role role);
void lanes_stop(struct lanes *lanes); /* no thread runs */
void lanes_end(struct lanes *lanes);  /* stopped or not; all have left */

#endif
