/* SPDX-License-Identifier: Apache-2.0
 *
 * The parts of the daemon that render, without HTTP: a catalog, a render pool whose workers use the
 * null backend, and a hub. A failure of any of them fails the test.
 */
#ifndef TESTS_SUPPORT_RENDER_FIXTURE_H
#define TESTS_SUPPORT_RENDER_FIXTURE_H

#include "ops/metrics.h"
#include "render/render_pool.h"
#include "session/participant.h"

struct render_fixture {
    struct srv_metrics *metrics; /* of the render pool */
    struct srv_catalog *catalog;
    struct srv_render_pool *render_pool;
    struct srv_hub *hub;
    struct srv_schedule *schedule;
    void (*volume)(const char *id, enum srv_volume_state state);
};

struct render_fixture_options {
    unsigned queue_max;      /* snapshots that may wait */
    unsigned encode_threads; /* in the foreground; 0 = one */
    double rest_ms;          /* a view is at rest when it has not changed for this long */
    uint64_t memory_bytes;   /* budget for voxels; 0 = 1 MiB */
    bool is_empty;           /* loads no volume */
    /* Called by the catalog with the state of a volume, on its threads. NULL = never. */
    void (*volume)(const char *id, enum srv_volume_state state);
};

/* Loads demo:phantom with 8 voxels per side unless is_empty, and starts the render pool. The hub
 * allows two sessions of two participants each. `fixture` must not move. */
void render_fixture_begin(struct render_fixture *fixture,
                          const struct render_fixture_options *options);
/* Loads a volume and waits until it is ready. */
void render_fixture_load(struct render_fixture *fixture, const char *source);
/* Queues the load of a volume with this id (NULL = the default one). try() waits for the end and
 * returns the state. */
void render_fixture_queue(struct render_fixture *fixture, const char *id, const char *source);
enum srv_volume_state render_fixture_try(struct render_fixture *fixture, const char *id,
                                         const char *source);
/* Creates a session with the default view of the first volume. */
void render_fixture_session(struct render_fixture *fixture, char id[SRV_SESSION_ID_BYTES]);
struct srv_participant *render_fixture_join(struct render_fixture *fixture, const char *id,
                                            enum srv_role role);
void render_fixture_stop(struct render_fixture *fixture); /* ends the threads */
void render_fixture_end(
    struct render_fixture *fixture); /* stopped or not; after all participants have left */

#endif
