/* SPDX-License-Identifier: Apache-2.0
 *
 * Backends that fail on command, and a renderer that has no others: the linker puts their table in
 * the place of the registry's (--wrap=sp_registry_at).
 */
#ifndef TEST_FAKES_H
#define TEST_FAKES_H

#include "backend/backend.h"
#include "sp/inflight.h"
#include "sp/log.h"
#include "sp/renderer.h"

/* What the fakes are to do, and what happened to them. */
struct fake {
    const char *name;
    bool starts;
    unsigned failures;    /* renders that fail from now on, before one works */
    unsigned refusals;    /* of frames that are begun */
    enum sp_code code;    /* with which they fail */
    atomic_bool *cancels; /* set by each failure */
    uint8_t paint;        /* a byte … */
    size_t painted;       /* … in so many places of its images; all other bytes are 0 */
    int running;          /* states created and not destroyed */
    unsigned renders, forgotten;
    const struct sp_backend_job *begun[SP_IN_FLIGHT_MAX]; /* oldest first */
    unsigned begun_count;
    struct sp_backend_options options; /* of the last start */
};
enum { GPU, PLAIN, LAST, FAKES };
extern struct fake fakes[FAKES];

extern char fakes_warnings[4096]; /* one after the other, a line each */
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

/* The backend that drew the frame, which is released; "" for NULL. */
const char *fakes_drawn_by(struct sp_frame *frame);

/* The same of a frame that it draws; s->err tells why there is none. */
const char *fakes_draw(struct fakes_scene *s);

#endif
