/* SPDX-License-Identifier: Apache-2.0
 *
 * Backends that fail on command, and a renderer that has only these backends. The linker replaces
 * the registry by their table (--wrap=sp_registry_at).
 */
#ifndef TEST_FAKES_H
#define TEST_FAKES_H

#include "backend/backend.h"
#include "sp/inflight.h"
#include "sp/log.h"
#include "sp/renderer.h"

/* How a fake backend behaves, and a record of its calls. */
struct fake {
    const char *name;
    bool starts;
    unsigned failures;    /* how many of the next renders fail */
    unsigned refusals;    /* how many of the next begins of frames in flight fail */
    enum sp_code code;    /* the code of these errors */
    atomic_bool *cancels; /* each failure sets this flag */
    uint8_t paint;        /* value of the wrong bytes … */
    size_t painted;       /* … and their number in each image; all other bytes are 0 */
    int running;          /* states created and not destroyed */
    unsigned renders, evictions;
    const struct sp_backend_job *begun[SP_IN_FLIGHT_MAX]; /* in flight, oldest first */
    unsigned begun_count;
    struct sp_backend_options options; /* of the last start */
};
enum { GPU, PLAIN, LAST, FAKES };
extern struct fake fakes[FAKES];

extern char fakes_warnings[4096]; /* log lines, each ended by a newline */
unsigned fakes_count_warnings(void);

/* For cmocka: before and after each test. */
int fakes_reset(void **state);
int fakes_check_all_ended(void **state);

struct fakes_scene {
    struct sp_renderer *renderer;
    struct sp_frame_pool *pool;
    struct sp_volume *volume;
    struct sp_view view;
    struct sp_error err;
    atomic_bool cancel;
};
void fakes_scene_init(struct fakes_scene *s, const struct sp_renderer_options *options);
void fakes_scene_finish(struct fakes_scene *s);

/* Returns the name of the backend that drew the frame, and releases the frame; "" for NULL. */
const char *fakes_drawn_by(struct sp_frame *frame);

/* Draws a frame and returns the name of its backend; "" with s->err set on failure. */
const char *fakes_draw(struct fakes_scene *s);

#endif
