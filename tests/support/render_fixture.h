/* SPDX-License-Identifier: Apache-2.0
 *
 * The daemon's parts that draw, without HTTP: a catalog, a scheduler whose lanes have the null
 * backend, and a hub. What goes wrong fails the test.
 */
#ifndef TESTS_SUPPORT_RENDER_FIXTURE_H
#define TESTS_SUPPORT_RENDER_FIXTURE_H

#include "ops/metrics.h"
#include "render/render_pool.h"

struct render_fixture {
    struct srv_metrics *metrics; /* of the scheduler */
    struct srv_catalog *catalog;
    struct srv_render_pool *render_pool;
    struct srv_hub *hub;
    void (*volume)(const char *id, enum srv_volume_state state);
};

struct render_fixture_options {
    unsigned queue_max;      /* stills that may wait */
    unsigned encode_threads; /* 0 = one */
    double rest_ms;          /* after which a view is at rest */
    uint64_t memory_bytes;   /* of voxels; 0 = a mebibyte */
    bool is_empty;           /* no volume is loaded */
    /* What the catalog tells of volumes, from its threads. NULL = nothing. */
    void (*volume)(const char *id, enum srv_volume_state state);
};

/* demo:phantom, 8 voxels a side, is loaded if nothing else is wanted, and the scheduler runs. Two
 * sessions may be, of two participants each. `lanes` stays where it is. */
void render_fixture_begin(struct render_fixture *fixture,
                          const struct render_fixture_options *options);
/* Loads it, and waits until it is ready. */
void render_fixture_load(struct render_fixture *fixture, const char *source);
/* Begins to load it under this id, NULL = its own; and tells how that ends. */
void render_fixture_queue(struct render_fixture *fixture, const char *id, const char *source);
enum srv_volume_state render_fixture_try(struct render_fixture *fixture, const char *id,
                                         const char *source);
/* Makes a session of the first volume's default view. */
void render_fixture_session(struct render_fixture *fixture, char id[SRV_SESSION_ID_BYTES]);
struct srv_participant *render_fixture_join(struct render_fixture *fixture, const char *id,
                                            enum srv_role role);
void render_fixture_stop(struct render_fixture *fixture); /* no thread runs */
void render_fixture_end(struct render_fixture *fixture);  /* stopped or not; all have left */

#endif
