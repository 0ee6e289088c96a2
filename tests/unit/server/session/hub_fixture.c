/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "unit/server/session/hub_fixture.h"

static void *acquire(void *user, const char *id, struct sp_error *err) {
    struct fixture *f = user;
    if (id && *id && strcmp(id, "v") != 0 && strcmp(id, "w") != 0) {
        sp_fail(err, SP_ERR_VOLUME_UNKNOWN, "/volume", "no volume %s", id);
        return NULL;
    }
    f->uses++;
    return f;
}

static void *add_use(void *user, void *volume) {
    ((struct fixture *)user)->uses++;
    return volume;
}

static void release(void *user, void *volume) {
    (void)volume;
    ((struct fixture *)user)->uses--;
}

static void default_view(void *user, void *volume, struct sp_view *view) {
    (void)volume;
    *view = ((struct fixture *)user)->view;
}

static void pick(void *user, void *volume, const struct sp_view *view, const uint32_t size[2],
                 const double at[2], struct sp_pick *found) {
    (void)user;
    (void)volume;
    (void)view;
    *found = (struct sp_pick){ .opacity = at[0] / size[0],
                               .is_hit = at[0] / size[0] >= 0.5,
                               .position = { 1, 2, 3 },
                               .value = 7 };
}

static void ignore(void *user) {
    (void)user;
}

static void count_interrupt(void *user, uint64_t of, enum srv_interrupt why) {
    struct fixture *f = user;
    if (why == SRV_INTERRUPT_MOTION) {
        f->yields++;
    } else {
        f->interrupts++;
        f->why = why;
        f->of = of;
    }
}

static bool token(void *user, const char *name, unsigned *rights, struct srv_quota *quota) {
    const struct fixture *f = user;
    if (!f->quota || strcmp(name, "ann") != 0)
        return false;
    *rights = f->rights;
    *quota = *f->quota;
    return true;
}

int hub_set_up(void **state) {
    struct fixture *f = calloc(1, sizeof *f);
    if (!f)
        return -1;
    f->info = (struct sp_volume_info){ .type = SP_UINT8, .components = 1, .range = { 0, 255 } };
    for (int i = 0; i < 3; i++) {
        f->info.grid.dims[i] = 8;
        f->info.grid.spacing[i] = 1;
        f->info.grid.direction[i][i] = 1;
    }
    f->info.histogram[3] = 512;
    sp_view_init(&f->view, &f->info, "v"); /* once: it searches the histogram */
    f->metrics = srv_metrics_create();
    struct srv_hub_options options = { .volumes = { f, acquire, add_use, release, default_view,
                                                    pick },
                                       .token = token,
                                       .sessions_max = 2,
                                       .participants_max = 3,
                                       .session_idle_ms = 1000,
                                       .control_ms = 500,
                                       .rest_ms = 100,
                                       .stream_bytes = 1 << 20,
                                       .metrics = f->metrics,
                                       .user = f,
                                       .ready = ignore };
    const struct srv_schedule_options schedule = { .user = f,
                                                   .wake = ignore,
                                                   .interrupt = count_interrupt };
    f->hub = srv_hub_create(&options, NULL);
    f->schedule = srv_schedule_create(f->hub, &schedule, NULL);
    proto_json *json = srv_hub_session_create(f->hub, NULL, 0, f->id, NULL);
    proto_json_free(&json);
    *state = f;
    return 0;
}

int hub_tear_down(void **state) {
    struct fixture *f = *state;
    srv_hub_destroy(&f->hub);
    srv_schedule_destroy(&f->schedule);
    srv_metrics_destroy(&f->metrics);
    int uses = f->uses;
    free(f);
    return uses; /* every use was given back */
}

struct srv_participant *hub_join(struct fixture *f, enum srv_role role, double now_ms) {
    struct srv_participant *p = srv_hub_join(f->hub, f->id, role, "", f, now_ms, NULL);
    assert_non_null(p);
    return p;
}
