/* SPDX-License-Identifier: Apache-2.0
 *
 * The render threads, one a lane, and the encode threads.
 *
 *   sessions (pull) ──► stream lane: thread, sp_renderer ──┐   encode threads ─► outboxes
 *            └───────► express lane: the same ────────────┼─► (each its own     or done() of
 *   stills (queue) ───► still lane: thread, sp_renderer ───┘   sp_encoder)       the still
 *
 * The lanes share nothing but the processor, where the still lane is nice: a still of many seconds
 * takes little from a view that moves, and a view that moves for an hour does not stop a still. The
 * still lane's renderer is made for the first still. What takes long to encode has encode threads
 * of its own, which are nice, too (encode.c). Those that are idle take part in another's large
 * JPEG.
 *
 * In the stream lane moving views go first, each session has an equal share of the time that
 * rendering and encoding take, and a refinement gives way to what moves (session/turn.c). Where the
 * renderer takes several frames at a time (sp_renderer_depth(), a GPU) the next job is begun while
 * the former ones are drawn: begin, begin, finish, begin, finish, … (flights.h). Nothing waits for
 * a second job: what was begun is finished when the hub has no other just then. What is rendered
 * for a view that changed is cancelled from the moment on that its job names (session/work.c): a
 * refinement at once, a moving frame when it is far over its budget, so that a long drag always
 * shows something. A still is cancelled when who asked for it is gone.
 *
 * A long frame stands still while short ones of those who have had less are drawn in the express
 * lane (express_lane.c).
 *
 * A renderer whose backend fails goes over to the next one (sp/renderer.h): the hub tells clients.
 *
 * Equal pictures are drawn once: the last one with all voxels and of full size is kept, and encoded
 * again for whatever session or still wants it; a still that equals one in flight is answered with
 * that one's bytes.
 *
 * Of stills the next is that of the owner who has had least (owners.h). One of the lowest class, in
 * the background, is drawn when nothing else is: it is begun when no other still waits and the
 * stream lane had nothing to do for a moment, and gives way as soon as there is something, for
 * twenty times its own time (session/share.h).
 */
#ifndef SRV_RENDER_RENDER_POOL_H
#define SRV_RENDER_RENDER_POOL_H

#include "render/catalog.h"
#include "schedule/fair_owners.h"
#include "session/hub.h"
#include "sp/renderer.h"

struct srv_render_pool;

struct srv_snapshot_result {
    bool ok;
    struct sp_error err;  /* if not ok */
    const uint8_t *bytes; /* valid during the call */
    size_t size;
    struct sp_frame *frame; /* instead of bytes, if that was wanted; during the call */
    double drawn_ms;        /* drawing that frame took; 0 = it was there */
    struct sp_frame_stats stats;
    double encode_ms;
};
struct srv_snapshot {
    struct sp_view view;
    struct srv_volume *volume;        /* a use, taken over by submit */
    char owner[SRV_FAIR_OWNER_BYTES]; /* who pays for it (owners.h) */
    enum sp_image_format format;
    int quality;
    enum sp_chroma chroma; /* of a JPEG */
    bool background;       /* the lowest class */
    double expected_ms; /* what drawing it is expected to take, in the background; 0 = not known */
    bool wants_frame;   /* encodes it itself; `format` says whether of bytes or floats */
    /* Called once, from another thread. */
    void (*done)(void *user, const struct srv_snapshot_result *result);
    /* Has who asked for it left? Asked now and then from another thread until shortly before
     * done(); then the still is dropped. Must not call the scheduler. NULL = never. */
    bool (*is_gone)(void *user);
    void *user;
};

struct srv_render_pool_options {
    struct srv_catalog *catalog;
    struct srv_metrics *metrics; /* NULL = nothing is counted */
    unsigned queue_max;          /* stills that wait, of each class; but for those in the background
                                    a quarter is out of reach of each owner */
    unsigned encode_threads;     /* without the nice ones */
    uint64_t video_px;           /* of all video encoders together; 0 = no video */
    struct sp_renderer_options stills; /* of the still lane's renderer; the express lane's has half
                                          of its memory. Strings outlive the scheduler */
};

/* Takes over *renderer, the stream lane's, on success. NULL with *err set. */
struct srv_render_pool *srv_render_pool_create(const struct srv_render_pool_options *options,
                                               struct sp_renderer **renderer, struct sp_error *err);
/* Threads start with the hub that they serve. */
bool srv_render_pool_start(struct srv_render_pool *render_pool, struct srv_hub *hub,
                           struct sp_error *err);
/* Cancels what is under way; waiting stills are answered with SP_ERR_CANCELLED. */
void srv_render_pool_stop(struct srv_render_pool *render_pool);
void srv_render_pool_destroy(struct srv_render_pool **render_pool); /* stops first */

/* Any thread; done() may be called at once. False with SP_ERR_BUDGET when the queue is full or
 * SP_ERR_CANCELLED when stopping; the volume is released then and done() is not called. */
bool srv_render_pool_submit(struct srv_render_pool *render_pool, const struct srv_snapshot *still,
                            struct sp_error *err);
/* Drops the stills of those who left, and moving frames that go over their budget while a newer
 * view waits; about ten times a second. */
void srv_render_pool_tick(struct srv_render_pool *render_pool);
/* What renders for sessions, for stills, and in the express lane; backend NULL: nothing yet, in the
 * last two. Any thread. */
void srv_render_pool_info(struct srv_render_pool *render_pool,
                          struct sp_renderer_info info[SRV_RENDERERS]);
unsigned
srv_render_pool_unanswered(struct srv_render_pool *render_pool); /* stills not yet answered */

/* For srv_hub_options and srv_catalog_options; `user` is the scheduler. */
void srv_render_pool_wake(void *render_pool);
void srv_render_pool_interrupt(void *render_pool, uint64_t of, enum srv_interrupt why);
void srv_render_pool_evict(void *render_pool, struct sp_volume *volume);
bool srv_render_pool_supports(void *render_pool, const struct sp_view *view, struct sp_error *err);

#endif
