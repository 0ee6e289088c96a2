/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/check.h"

#include <math.h>

#include "data/volume/procedural.h"

enum { SIDE = 64 }; /* px */

/* The settings that are compared. Together they run every stage except the sorting of single
 * splats. */
enum { WAYS = 3 };

struct drawing {
    const struct sp_backend *backend;
    void *state;
};

struct check {
    struct drawing own, reference;
    struct sp_volume *volume;
    struct sp_frame_pool *pool;
};

/* Sets up view number `way`; false if the backend does not support it. */
static bool choose_way(int way, const struct sp_capabilities *can, struct sp_view *view) {
    view->size[0] = view->size[1] = SIDE;
    view->transfer_function.order = SP_TF_PRE;
    if (way == 0)
        return true;
    view->transfer_function.order = SP_TF_POST;
    if (way == 1)
        return can->interpolated_sheets && can->orders & SP_CAN(SP_TF_POST);
    view->compositing.mode = SP_COMPOSITE_SLAB;
    view->filter.mode = SP_FILTER_EWA;
    return can->compositings & SP_CAN(SP_COMPOSITE_SLAB) && can->orders & SP_CAN(SP_TF_POST) &&
           can->filters & SP_CAN(SP_FILTER_EWA);
}

/* Returns a reference that the caller owns, or NULL with *err set. */
static struct sp_frame *draw(const struct check *c, const struct drawing *by,
                             const struct sp_view *view, struct sp_error *err) {
    struct sp_frame *frame = sp_frame_create(c->pool, SIDE, SIDE, SP_RGBA8, err);
    const struct sp_backend_job job = { .volume = c->volume, .view = view, .frame = frame };
    if (frame && !by->backend->render(by->state, &job, err))
        sp_frame_unref(&frame);
    return frame;
}

static double psnr(const struct sp_frame *a, const struct sp_frame *b) {
    double sum = 0;
    for (uint32_t y = 0; y < SIDE; y++) {
        const uint8_t *p = (const uint8_t *)a->pixels + y * a->stride_bytes;
        const uint8_t *q = (const uint8_t *)b->pixels + y * b->stride_bytes;
        for (uint32_t i = 0; i < 4 * SIDE; i++)
            sum += (double)((p[i] - q[i]) * (p[i] - q[i]));
    }
    return sum > 0 ? 10 * log10(255.0 * 255.0 * 4 * SIDE * SIDE / sum) : INFINITY;
}

static bool compare(const struct check *c, const struct sp_view *view, struct sp_error *err) {
    struct sp_frame *own = draw(c, &c->own, view, err);
    struct sp_frame *right = own ? draw(c, &c->reference, view, err) : NULL;
    double alike = right ? psnr(own, right) : 0;
    bool ok = right && alike >= SP_CHECK_PSNR;
    if (right && !ok)
        sp_fail(err, SP_ERR_BACKEND, "",
                "it draws wrong images: %.1f dB from backend %s, at least %.0f dB are required; "
                "update the driver",
                alike, c->reference.backend->entry.name, SP_CHECK_PSNR);
    sp_frame_unref(&own);
    sp_frame_unref(&right);
    return ok;
}

static bool compare_all(const struct check *c, struct sp_error *err) {
    for (int way = 0; way < WAYS; way++) {
        struct sp_view view;
        sp_view_init(&view, sp_volume_info(c->volume), "check");
        if (choose_way(way, &c->own.backend->capabilities, &view) && !compare(c, &view, err))
            return false;
    }
    return true;
}

bool sp_backend_check(const struct sp_backend *backend, void *state,
                      const struct sp_backend *reference, const struct sp_backend_options *options,
                      struct sp_error *err) {
    struct check c = { .own = { backend, state }, .reference = { .backend = reference } };
    bool ok = (c.pool = sp_frame_pool_create(0, err)) &&
              (c.volume = sp_demo_load("demo:engine?size=32", NULL, err)) &&
              (c.reference.state = reference->create(options, err)) && compare_all(&c, err);
    if (c.volume && backend->evict)
        backend->evict(state, c.volume);
    if (c.reference.state)
        reference->destroy(c.reference.state);
    sp_volume_unref(&c.volume);
    sp_frame_pool_destroy(&c.pool);
    return ok;
}
