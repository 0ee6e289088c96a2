/* SPDX-License-Identifier: Apache-2.0
 *
 * Two frames of the GPU backend in flight. The second frame changes data on the GPU before the
 * first is finished; each image still equals the image of its frame drawn alone. A second run
 * covers drivers whose buffers cannot stay mapped.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "backend/backend.h"
#include "backend/gl/state.h"
#include "sp/log.h"
#include "support/data.h"
#include "support/gl.h"
#include "support/image.h"

enum { SIZE = 40, SHOTS = 10 };

/* A view, and its image when it is drawn alone. */
struct shot {
    struct sp_volume *volume;
    struct sp_view view;
    unsigned mip_level;
    struct test_image alone;
};

struct rig {
    const struct sp_backend *backend;
    struct gl_state *state;
    struct sp_frame_pool *pool;
    struct sp_volume *volumes[2];
    struct shot shots[SHOTS];
    bool stays_mapped; /* the memory into which pixels are read back */
};

static struct sp_backend_job make_job(struct rig *rig, const struct shot *shot,
                                      const atomic_bool *cancel) {
    const uint32_t *size = shot->view.size;
    struct sp_frame *frame = sp_frame_create(rig->pool, size[0], size[1], SP_RGBAF32, NULL);
    assert_non_null(frame);
    return (struct sp_backend_job){ .volume = shot->volume,
                                    .view = &shot->view,
                                    .mip_level = shot->mip_level,
                                    .frame = frame,
                                    .cancel = cancel };
}

static void begin(struct rig *rig, const struct sp_backend_job *job) {
    struct sp_error err;
    if (!rig->backend->begin(rig->state, job, &err))
        fail_msg("%s", err.text);
}

/* Finishes the oldest frame, which must equal the image of the shot. */
static void finish(struct rig *rig, struct sp_backend_job *job, const struct shot *shot) {
    struct sp_error err;
    struct test_image image;
    if (!rig->backend->finish(rig->state, job, &err))
        fail_msg("%s", err.text);
    assert_true(test_image_from_frame(&image, job->frame));
    double psnr = test_image_psnr(&image, &shot->alone);
    if (!(psnr >= 110))
        fail_msg("%.1f dB", psnr);
    assert_string_equal(job->frame->stats.stages[GL_STAGE_READ].name, "read");
    test_image_finish(&image);
    sp_frame_unref(&job->frame);
}

/* Draws each shot while another shot is in flight before it or after it. */
static void check_all(struct rig *rig) {
    struct sp_backend_job jobs[SHOTS];
    for (int i = 0; i < SHOTS; i++) {
        jobs[i] = make_job(rig, &rig->shots[i], NULL);
        begin(rig, &jobs[i]);
        if (i > 0)
            finish(rig, &jobs[i - 1], &rig->shots[i - 1]);
    }
    finish(rig, &jobs[SHOTS - 1], &rig->shots[SHOTS - 1]);
}

static void two_frames_in_flight_do_not_disturb_each_other(void **state) {
    check_all(*state);
}

/* Buffers for pairs, bins and bands grow while another frame is on the GPU. */
static void a_frame_that_exceeds_its_buffers_is_drawn_again(void **state) {
    struct rig *rig = *state;
    if (!rig->stays_mapped)
        skip(); /* the same as with memory that stays mapped */
    const struct gl_limits whole = rig->state->workload.limits;
    struct gl_limits small[] = { whole, whole, whole };
    small[0].pairs = 3000;
    small[1].tiles = 1; /* one row of tiles per band */
    small[2].bins = 1;
    for (size_t i = 0; i < sizeof small / sizeof small[0]; i++) {
        for (int k = 1; k < 4; k++) {
            struct shot *shot = &rig->shots[k];
            struct sp_backend_job jobs[2] = { make_job(rig, shot, NULL),
                                              make_job(rig, &rig->shots[0], NULL) };
            rig->state->workload.limits = small[i];
            rig->state->workload.pairs = 500;
            begin(rig, &jobs[0]);
            begin(rig, &jobs[1]);
            finish(rig, &jobs[0], shot);
            finish(rig, &jobs[1], &rig->shots[0]);
            struct gl_workload *workload = &rig->state->workload;
            workload->rows = workload->layers = workload->records = 1 << 14;
            workload->passes = 1;
        }
        rig->state->workload.limits = whole;
    }
}

/* A second frame is submitted although the first has several short batches. */
static void a_few_batches_are_handed_over(void **state) {
    struct rig *rig = *state;
    if (!rig->stays_mapped)
        skip(); /* the same as with memory that stays mapped */
    struct sp_backend_job jobs[2] = { make_job(rig, &rig->shots[0], NULL),
                                      make_job(rig, &rig->shots[0], NULL) };
    struct gl_workload *workload = &rig->state->workload;
    uint32_t layers = workload->layers;
    workload->layers = 4;
    begin(rig, &jobs[0]);
    begin(rig, &jobs[1]);
    assert_in_range(rig->state->partition.batch_count, 3, 8);
    const struct gl_slot *second = &rig->state->slots[(rig->state->oldest + 1) % GL_IN_FLIGHT];
    assert_int_equal(second->end, SIZE);
    workload->layers = layers;
    finish(rig, &jobs[0], &rig->shots[0]);
    finish(rig, &jobs[1], &rig->shots[0]);
}

/* The lists of the second volume replace the lists of the first. */
static void a_volume_can_be_evicted_while_its_frame_is_in_flight(void **state) {
    struct rig *rig = *state;
    uint64_t limit = rig->state->residency.limit_bytes, bytes = 0;
    for (int i = 0; i < 2; i++) {
        uint64_t own = gl_residency_bytes(&rig->state->residency, rig->volumes[i]);
        bytes = own > bytes ? own : bytes;
    }
    rig->state->residency.limit_bytes = bytes + gl_draw_bytes(rig->state) + 4096;
    check_all(rig);
    rig->state->residency.limit_bytes = limit;
    struct sp_backend_job job = make_job(rig, &rig->shots[0], NULL);
    begin(rig, &job);
    rig->backend->evict(rig->state, rig->volumes[0]);
    finish(rig, &job, &rig->shots[0]);
}

static void one_is_cancelled_and_not_the_other(void **state) {
    struct rig *rig = *state;
    struct sp_error err;
    for (int k = 0; k < 2; k++) {
        atomic_bool cancel = false;
        struct sp_backend_job jobs[2];
        for (int i = 0; i < 2; i++) {
            jobs[i] = make_job(rig, &rig->shots[i], i == k ? &cancel : NULL);
            begin(rig, &jobs[i]);
        }
        atomic_store(&cancel, true);
        for (int i = 0; i < 2; i++) {
            if (i != k) {
                finish(rig, &jobs[i], &rig->shots[i]);
                continue;
            }
            /* The GPU may have finished the frame already. */
            if (!rig->backend->finish(rig->state, &jobs[i], &err))
                assert_int_equal(err.code, SP_ERR_CANCELLED);
            sp_frame_unref(&jobs[i].frame);
        }
    }
    atomic_bool cancel = true;
    struct sp_backend_job first = make_job(rig, &rig->shots[0], NULL);
    struct sp_backend_job second = make_job(rig, &rig->shots[1], &cancel);
    begin(rig, &first);
    assert_false(rig->backend->begin(rig->state, &second, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    finish(rig, &first, &rig->shots[0]);
    sp_frame_unref(&second.frame);
}

/* Runs last: it destroys the renderer. */
static void unfinished_frames_are_released(void **state) {
    struct rig *rig = *state;
    struct sp_backend_job jobs[2] = { make_job(rig, &rig->shots[0], NULL),
                                      make_job(rig, &rig->shots[1], NULL) };
    begin(rig, &jobs[0]);
    begin(rig, &jobs[1]);
    rig->backend->destroy(rig->state);
    rig->state = NULL;
    sp_frame_unref(&jobs[0].frame);
    sp_frame_unref(&jobs[1].frame);
}

/* Views that need different data on the GPU. */
static void describe_shots(struct rig *rig) {
    for (int i = 0; i < SHOTS; i++) {
        struct shot *shot = &rig->shots[i];
        shot->volume = rig->volumes[i == 1];
        sp_view_init(&shot->view, sp_volume_info(shot->volume), "v");
        shot->view.compositing.mode = SP_COMPOSITE_SHEET;
        shot->view.size[0] = shot->view.size[1] = SIZE;
    }
    rig->shots[2].view.compositing.mode = SP_COMPOSITE_SLAB;
    rig->shots[2].view.transfer_function.order = SP_TF_POST;
    rig->shots[2].view.filter.mode = SP_FILTER_EWA; /* with the default, slabs are not splatted */
    rig->shots[3].view.size[0] = 2 * SIZE + 3;
    rig->shots[3].mip_level = 1;
    struct sp_view *tinted = &rig->shots[4].view;
    for (uint32_t p = 0; p < tinted->transfer_function.point_count; p++) {
        tinted->transfer_function.points[p].color[1] = 0;
        tinted->transfer_function.points[p].opacity *= 0.5f;
    }
    rig->shots[5].view.shading.mode = SP_SHADING_PHONG;
    rig->shots[5].view.camera.position[0] *= 1.5;
    rig->shots[6].view.transfer_function.order = SP_TF_POST; /* interpolated values */
    rig->shots[6].view.shading.mode = SP_SHADING_PHONG;
}

/* Other layers in the volume, without it, and in footprints. */
static void describe_layers(struct rig *rig) {
    for (int i = 7; i < SHOTS; i++) {
        struct sp_view *view = &rig->shots[i].view;
        struct sp_layer *surface = &view->layers[1], *shell = &view->layers[2];
        const double *range = sp_volume_info(rig->shots[i].volume)->range;
        *surface = sp_layer_default(SP_LAYER_SURFACE);
        surface->value = 0.6 * range[0] + 0.4 * range[1];
        surface->opacity = 0.4f;
        *shell = sp_layer_default(SP_LAYER_SHELL);
        view->layer_count = 3;
        view->transfer_function.order = i == 7 ? SP_TF_POST : SP_TF_PRE;
    }
    struct sp_view *alone = &rig->shots[8].view;
    alone->layers[0] = alone->layers[2];
    alone->layer_count = 2;
}

static void draw_alone(struct rig *rig, struct shot *shot) {
    struct sp_error err;
    struct sp_backend_job job = make_job(rig, shot, NULL);
    if (!rig->backend->render(rig->state, &job, &err))
        fail_msg("%s", err.text);
    assert_true(test_image_from_frame(&shot->alone, job.frame));
    sp_frame_unref(&job.frame);
}

static bool open_rig(struct rig *rig, struct sp_error *err) {
    const struct sp_backend_options options = {
        .threads = 2, .memory_bytes = (uint64_t)1 << 30, .isa = "auto", .gpu = -1
    };
    *rig = (struct rig){ .backend = test_backend(test_gl()) };
    rig->state = rig->backend->create(&options, err);
    if (!rig->state)
        return false;
    rig->pool = sp_frame_pool_create((size_t)64 << 20, err);
    rig->volumes[0] = sp_volume_load("demo:phantom?size=16", NULL, err);
    rig->volumes[1] = sp_volume_load("demo:engine?size=20", NULL, err);
    assert_true(rig->volumes[0]);
    assert_true(rig->volumes[1]);
    describe_shots(rig);
    describe_layers(rig);
    for (int i = 0; i < SHOTS; i++)
        draw_alone(rig, &rig->shots[i]);
    return true;
}

static void close_rig(struct rig *rig) {
    for (int i = 0; i < SHOTS; i++)
        test_image_finish(&rig->shots[i].alone);
    for (int i = 0; i < 2; i++)
        sp_volume_unref(&rig->volumes[i]);
    sp_frame_pool_destroy(&rig->pool);
}

int main(int argc, char **argv) {
    static struct rig rig;
    struct sp_error err;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    if (!open_rig(&rig, &err)) {
        printf("skipped: no software GL here: %s\n", err.text);
        return TEST_SKIPPED;
    }
    rig.stays_mapped = argc < 2 || strcmp(argv[1], "mapped-on-demand") != 0;
    if (rig.stays_mapped == !rig.state->slots[0].readback.mapped) {
        fprintf(stderr, "what is read back %s\n",
                rig.stays_mapped ? "does not stay mapped" : "stays mapped");
        return 1;
    }
#define ON(test)                                                                                   \
    { #test, test, NULL, NULL, &rig }
    const struct CMUnitTest tests[] = {
        ON(two_frames_in_flight_do_not_disturb_each_other),
        ON(a_frame_that_exceeds_its_buffers_is_drawn_again),
        ON(a_few_batches_are_handed_over),
        ON(a_volume_can_be_evicted_while_its_frame_is_in_flight),
        ON(one_is_cancelled_and_not_the_other),
        ON(unfinished_frames_are_released),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    close_rig(&rig);
    return failed;
}
