/* SPDX-License-Identifier: Apache-2.0
 *
 * Images of a brick file against images of the same volume in memory, with memory for all of its
 * samples and for few of them.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "data/bricks/store.h"
#include "data/bricks/write.h"
#include "draw/working_set/working_set.h"
#include "sp/bricks.h"
#include "sp/edit.h"
#include "sp/measure.h"
#include "sp/slice.h"
#include "support/compare.h"
#include "support/one_thread.h"
#include "support/render.h"
#include "support/sanitized.h"
#include "unit/draw/working_set/rig.h"

/* Fills the image with the third ball. */
static void look_at_a_ball(struct sp_view *view) {
    static const double centre[3] = { 160, 45, 142 };
    memcpy(view->camera.target, centre, sizeof centre);
    for (int a = 0; a < 3; a++)
        view->camera.position[a] = centre[a] + (a == 2 ? 120 : 1);
    memcpy(view->camera.up, (const double[3]){ 0, 1, 0 }, sizeof view->camera.up);
    view->camera.fov_y = 8;
}

static void images_equal_those_of_the_volume_in_memory(void **state) {
    const struct rig *rig = *state;
    if (TEST_SANITIZED)
        print_message("reduced: subvolumes of a quarter of the samples, and two projections\n");
    /* With memory for all, and for subvolumes of a quarter of the samples. */
    for (int is_small = TEST_SANITIZED; is_small < 2; is_small++) {
        struct sp_volume *volume = rig_open_file(rig, is_small ? 2 << 20 : 0);
        struct sp_view view = rig_make_view(rig);
        rig_expect(rig, volume, &view, 200, "far");
        rig_zoom(&view, 2.5);
        view.camera.target[0] += 20;
        rig_expect(rig, volume, &view, 200, "near");
        view.shading.mode = SP_SHADING_NONE;
        rig_expect(rig, volume, &view, 200, "near, not lit");
        view.camera.projection = SP_ORTHOGRAPHIC;
        view.camera.height = 60;
        rig_expect(rig, volume, &view, 200, "orthographic");
        view = rig_make_view(rig);
        rig_zoom(&view, 2);
        view.clip.box[0][0] = 0.21;
        view.clip.box[1][1] = 0.73;
        rig_expect(rig, volume, &view, 200, "clip box");
        view.clip.plane_count = 1;
        view.clip.planes[0] = (struct sp_clip_plane){ .normal = { 1, 1, 0 }, .offset = 90 };
        rig_expect(rig, volume, &view, 200, "clip plane");
        view = rig_make_view(rig);
        rig_zoom(&view, 2);
        view.layers[0] = sp_layer_default(SP_LAYER_SURFACE);
        view.layers[0].value = 100;
        rig_expect(rig, volume, &view, is_small ? 40 : 200,
                   "surface"); /* they have no coarse levels */
        view = rig_make_view(rig);
        look_at_a_ball(&view);
        rig_expect(rig, volume, &view, 60, "close"); /* all of the frame lies in few bricks */
        struct sp_frame *frame = rig_render(rig, volume, &view, 0);
        assert_int_equal(frame->stats.bricks.level, 0);
        sp_frame_unref(&frame);
        sp_volume_unref(&volume);
    }
}

static void projections_and_edits_equal_those_of_the_volume(void **state) {
    const struct rig *rig = *state;
    struct sp_volume *volume = rig_open_file(rig, 0);
    static const enum sp_compositing modes[] = { SP_COMPOSITE_MAXIMUM, SP_COMPOSITE_MINIMUM,
                                                 SP_COMPOSITE_MEAN, SP_COMPOSITE_SUM };
    for (size_t i = 0; i < sizeof modes / sizeof *modes; i += TEST_SANITIZED ? 3 : 1) {
        struct sp_view view = rig_make_view(rig);
        view.compositing.mode = modes[i];
        rig_zoom(&view, 3);
        rig_expect(rig, volume, &view, 200, "projection");
    }
    struct sp_view view = rig_make_view(rig);
    rig_zoom(&view, 2);
    view.edit_count = 2;
    view.edits[0] = (struct sp_edit){ .type = SP_EDIT_BOX,
                                      .keep = SP_KEEP_OUTSIDE,
                                      .box = { { 0.1, 0.1, 0.1 }, { 0.6, 0.35, 0.9 } } };
    view.edits[1] = (struct sp_edit){
        .type = SP_EDIT_SPHERE, .keep = SP_KEEP_OUTSIDE, .center = { 100, 95, 97 }, .radius = 30
    };
    rig_expect(rig, volume, &view, 200, "edits");
    sp_volume_unref(&volume);
}

static void little_memory_gives_coarser_images(void **state) {
    const struct rig *rig = *state;
    struct sp_view view = rig_make_view(rig);
    view.level_of_detail = SP_LOD_OFF;
    struct sp_frame *truth = rig_render(rig, rig->whole, &view, 0);
    double last = 300;
    for (uint64_t bytes = 16 << 20; bytes >= 1 << 18; bytes /= 8) {
        struct sp_volume *volume = rig_open_file(rig, bytes);
        struct sp_brick_store *store = sp_brick_store_of(volume);
        struct sp_frame *frame = rig_render(rig, volume, &view, 0);
        uint64_t bricks, used;
        sp_brick_store_usage(store, &bricks, &used);
        assert_compare(used, <=, bytes);
        assert_compare(sp_volume_info(volume)->voxel_bytes, <=, bytes);
        assert_true(isnan(sp_volume_info(volume)->noise)); /* unknown */
        assert_false(frame->stats.bricks.is_incomplete);
        assert_int_equal(frame->stats.bricks.asked, 0);
        assert_int_equal(sp_frame_bricks_is_complete(&frame->stats.bricks),
                         frame->stats.bricks.level == 0);
        const double db = rig_compare(truth, frame);
        print_message("%u bytes: %.1f dB, level %u\n", (unsigned)bytes, db,
                      frame->stats.bricks.level);
        assert_compare(db, <, last);
        assert_compare(db, >, 20);
        last = db;
        sp_frame_unref(&frame);
        sp_volume_unref(&volume);
    }
    sp_frame_unref(&truth);
}

static void a_frame_that_does_not_wait_is_refined(void **state) {
    const struct rig *rig = *state;
    struct sp_volume *volume = rig_open_file(rig, 3 << 19); /* which gives a coarse volume */
    struct sp_view view = rig_make_view(rig);
    rig_zoom(&view, 2.5);
    struct sp_frame *first = rig_render(rig, volume, &view, -1);
    assert_true(first->stats.bricks.is_incomplete);
    assert_int_equal(first->stats.bricks.resident, 0);
    assert_compare(first->stats.bricks.wanted, >, 0);
    assert_compare(rig_mean_of(first), >, 1e-4);
    struct sp_frame *last = rig_render(rig, volume, &view, 0);
    assert_false(last->stats.bricks.is_incomplete);
    assert_compare(last->stats.bricks.level, <, first->stats.bricks.level);
    struct sp_frame *again = rig_render(rig, volume, &view, -1); /* the subvolume stays */
    assert_false(again->stats.bricks.is_incomplete);
    assert_compare(rig_compare(last, again), ==, 200);
    sp_frame_unref(&first);
    sp_frame_unref(&last);
    sp_frame_unref(&again);
    sp_volume_unref(&volume);
}

static void nothing_that_is_seen_needs_no_bricks(void **state) {
    const struct rig *rig = *state;
    struct sp_volume *volume = rig_open_file(rig, 0);
    struct sp_view view = rig_make_view(rig);
    for (uint32_t i = 0; i < view.transfer_function.point_count; i++)
        view.transfer_function.points[i].value += 200;
    struct sp_frame *frame = rig_render(rig, volume, &view, -1);
    assert_int_equal(frame->stats.bricks.wanted, 0);
    assert_true(sp_frame_bricks_is_complete(&frame->stats.bricks));
    assert_compare(rig_mean_of(frame), ==, 0);
    sp_frame_unref(&frame);
    sp_volume_unref(&volume);
}

static void a_damaged_brick_is_shown_coarsely_and_reported(void **state) {
    const struct rig *rig = *state;
    struct sp_error err;
    struct sp_view view = rig_make_view(rig);
    view.level_of_detail = SP_LOD_OFF;
    struct sp_volume *sound = rig_open_file(rig, 2 << 20);
    const struct sp_brick_file *file = sp_brick_store_file(sp_brick_store_of(sound));
    int copy = memfd_create("damaged", MFD_CLOEXEC);
    const off_t size = lseek(rig->file, 0, SEEK_END);
    char *bytes = malloc((size_t)size);
    assert_non_null(bytes);
    assert_int_equal(pread(rig->file, bytes, (size_t)size, 0), size);
    for (uint64_t b = 0; b < 4; b++) {
        const struct sp_brick_entry *entry = &sp_brick_file_entries(file, 1)[b];
        bytes[entry->at + entry->bytes / 2] ^= 1;
    }
    assert_int_equal(write(copy, bytes, (size_t)size), size);
    free(bytes);
    const struct sp_load_options options = { .subvolume_bytes = 2 << 20 };
    struct sp_volume *volume = sp_brick_store_open(copy, "damaged", "damaged", &options, &err);
    assert_non_null(volume);
    struct sp_frame *truth = rig_render(rig, sound, &view, 0),
                    *frame = rig_render(rig, volume, &view, 0);
    assert_int_equal(truth->stats.bricks.level, 1);
    assert_int_equal(frame->stats.bricks.level, 1);
    assert_true(frame->stats.bricks.is_incomplete);
    assert_int_equal(frame->stats.bricks.resident + 4, frame->stats.bricks.wanted);
    assert_int_equal(frame->stats.bricks.lost, 4);
    static const uint32_t first[2][3] = { { 0, 0, 0 }, { 128, 128, 128 } };
    assert_memory_equal(frame->stats.bricks.lost_box, first, sizeof first);
    struct sp_bricks_damage damage;
    assert_false(sp_bricks_get_damage(sound, &damage));
    assert_true(sp_bricks_get_damage(volume, &damage));
    assert_int_equal(damage.count, 4);
    assert_int_equal(damage.level, 1);
    assert_memory_equal(damage.box, first, sizeof first);
    assert_int_equal(damage.why.code, SP_ERR_FORMAT);
    assert_compare(rig_compare(truth, frame), >, 20);
    sp_frame_unref(&truth);
    sp_frame_unref(&frame);
    sp_volume_unref(&sound);
    sp_volume_unref(&volume);
}

struct visitor {
    const struct rig *rig;
    struct sp_volume *volume;
    double angle;
};

/* Needs that differ, asked for at the same time. */
static void *visit(void *user) {
    struct visitor *v = user;
    const struct sp_brick_file *file = sp_brick_store_file(sp_brick_store_of(v->volume));
    for (int i = 0; i < 8; i++) {
        struct sp_view view = rig_make_view(v->rig);
        struct sp_brick_need need;
        struct sp_brick_subvolume subvolume;
        struct sp_error err;
        rig_zoom(&view, 3);
        view.camera.target[0] += 30 * cos(v->angle + i);
        view.camera.target[1] += 30 * sin(v->angle + i);
        assert_true(sp_working_set_need(file, &view, 1, false, &need));
        if (need.count[0]) {
            if (!sp_brick_store_get(sp_brick_store_of(v->volume), &need, INFINITY, false, NULL,
                                    NULL, &subvolume, &err))
                fail_msg("%s", err.text);
            assert_true(subvolume.is_wanted);
            sp_volume_unref(&subvolume.volume);
        }
        free(need.wanted);
    }
    return NULL;
}

static void threads_share_subvolumes(void **state) {
    const struct rig *rig = *state;
    struct sp_volume *volume = rig_open_file(rig, 2 << 20);
    pthread_t threads[3];
    struct visitor visitors[3];
    for (int i = 0; i < 3; i++) {
        visitors[i] = (struct visitor){ rig, volume, 2.1 * i };
        assert_int_equal(pthread_create(&threads[i], NULL, visit, &visitors[i]), 0);
    }
    for (int i = 0; i < 3; i++)
        pthread_join(threads[i], NULL);
    sp_volume_unref(&volume);
}

/* Threads show two files, while the memory of both shrinks and grows. */
static void threads_of_two_files_share_memory(void **state) {
    enum { BYTES = 8 << 20, THREADS = 4, TIMES = 50 };
    const struct rig *rig = *state;
    struct sp_error err;
    struct sp_volume *files[2];
    struct sp_brick_usage usage;
    struct sp_brick_memory *memory = sp_brick_memory_create(BYTES, &err);
    const struct sp_load_options options = { .subvolumes = memory };
    pthread_t threads[THREADS];
    struct visitor visitors[THREADS];
    for (int i = 0; i < 2; i++) {
        files[i] = sp_brick_store_open(dup(rig->file), "file", "file", &options, &err);
        assert_non_null(files[i]);
    }
    for (int i = 0; i < THREADS; i++) {
        visitors[i] = (struct visitor){ rig, files[i % 2], 1.7 * i };
        assert_int_equal(pthread_create(&threads[i], NULL, visit, &visitors[i]), 0);
    }
    for (int i = 0; i < TIMES; i++) { /* a need is below a megabyte */
        sp_brick_memory_set(memory, i % 2 ? BYTES : BYTES / 2);
        sp_brick_memory_usage(memory, &usage);
        assert_int_equal(usage.files, 2);
    }
    for (int i = 0; i < THREADS; i++)
        pthread_join(threads[i], NULL);
    sp_brick_memory_usage(memory, &usage);
    assert_compare(usage.bytes, <=, BYTES);
    for (int i = 0; i < 2; i++)
        sp_volume_unref(&files[i]);
    sp_brick_memory_unref(&memory);
}

/* Renders all of a volume at its finest level that the memory allows; returns it. */
static unsigned show(const struct rig *rig, struct sp_volume *volume, double wait_ms) {
    struct sp_view view = rig_make_view(rig);
    view.level_of_detail = SP_LOD_OFF;
    struct sp_frame *frame = rig_render(rig, volume, &view, wait_ms);
    assert_false(frame->stats.bricks.is_incomplete);
    const unsigned level = frame->stats.bricks.level;
    sp_frame_unref(&frame);
    return level;
}

static void files_share_memory(void **state) {
    enum { BYTES = 8 << 20 }; /* for one subvolume of the finest level, not for two */
    const struct rig *rig = *state;
    const double no_wait = -1;
    struct sp_error err;
    struct sp_brick_usage usage;
    struct sp_brick_memory *memory = sp_brick_memory_create(BYTES, &err);
    assert_non_null(memory);
    const struct sp_load_options options = { .subvolumes = memory };
    struct sp_volume *a = sp_brick_store_open(dup(rig->file), "a", "a", &options, &err);
    struct sp_volume *b = sp_brick_store_open(dup(rig->file), "b", "b", &options, &err);
    assert_non_null(a);
    assert_non_null(b);
    assert_int_equal(show(rig, a, 0), 0);
    assert_int_equal(show(rig, b, 0), 1); /* less than its half, which has no finer level */
    for (int i = 0; i < 2; i++) {         /* neither drops the subvolume of the other */
        assert_int_equal(show(rig, a, no_wait), 0);
        assert_int_equal(show(rig, b, no_wait), 1);
    }
    sp_brick_memory_usage(memory, &usage);
    assert_int_equal(usage.files, 2);
    assert_compare(usage.bytes, <=, BYTES);
    sp_volume_unref(&a);
    assert_int_equal(show(rig, b, 0), 0); /* it has all */
    sp_brick_memory_set(memory, BYTES / 8);
    sp_brick_memory_usage(memory, &usage);
    assert_int_equal(usage.files, 1);
    assert_compare(usage.bytes, <=, BYTES / 8);
    assert_compare(show(rig, b, 0), >, 0);
    sp_volume_unref(&b);
    sp_brick_memory_unref(&memory);
}

static void slices_and_measures_read_their_bricks(void **state) {
    enum { WAIT_MS = 60000 };
    const struct rig *rig = *state;
    struct sp_error err;
    struct sp_volume *volume = rig_open_file(rig, 4 << 20);
    struct sp_volume_info info;
    assert_true(sp_bricks_describe(volume, 0, &info));
    assert_memory_equal(info.grid.dims, rig->info.grid.dims, sizeof info.grid.dims);
    assert_memory_equal(info.grid.origin, rig->info.grid.origin, sizeof info.grid.origin);
    for (uint32_t axis = 0; axis < 3; axis++) {
        static uint8_t want[NX * NY], got[NX * NY];
        struct sp_slice slice;
        unsigned level = 0;
        assert_true(sp_slice_init_orthogonal(&slice, &info, axis, 77, &err));
        sp_slice_sample(rig->whole, &slice, want);
        double corners[2][3];
        memcpy(corners[0], slice.origin, sizeof corners[0]);
        for (int r = 0; r < 3; r++)
            corners[1][r] = slice.origin[r] + slice.step[0][r] * (slice.size[0] - 1) +
                            slice.step[1][r] * (slice.size[1] - 1);
        struct sp_volume *part =
            sp_bricks_around(volume, (const double(*)[3])corners, 2, WAIT_MS, &level, &err);
        if (!part)
            fail_msg("%s", err.text);
        assert_int_equal(level, 0);
        assert_compare(sp_volume_info(part)->voxel_bytes, <, COUNT * 2 / 3);
        sp_slice_move(&slice, sp_volume_info(part));
        sp_slice_sample(part, &slice, got);
        assert_memory_equal(want, got, (size_t)slice.size[0] * slice.size[1]);
        sp_volume_unref(&part);
    }
    const struct sp_measure measure = {
        .kind = SP_MEASURE_ELLIPSE, .points = { { 100, 95, 97 }, { 130, 95, 97 }, { 100, 120, 97 } }
    };
    struct sp_measure_result want, got;
    unsigned level = 0;
    struct sp_volume *part = sp_bricks_around(volume, measure.points, 3, WAIT_MS, &level, &err);
    assert_non_null(part);
    assert_true(sp_measure_compute(rig->whole, &measure, &want, &err));
    assert_true(sp_measure_compute(part, &measure, &got, &err));
    assert_int_equal(got.statistics.count, want.statistics.count);
    assert_float_equal(got.statistics.mean, want.statistics.mean, 1e-9);
    assert_float_equal(got.statistics.max, want.statistics.max, 0);
    sp_volume_unref(&part);
    sp_volume_unref(&volume);
}

static void the_first_view_is_that_of_the_volume_in_memory(void **state) {
    const struct rig *rig = *state;
    struct sp_volume *volume = rig_open_file(rig, 3 << 20); /* which has level 1 in memory */
    struct sp_view want, got;
    assert_int_equal(sp_bricks_base(volume), 1);
    sp_view_choose(&want, rig->whole, "v");
    sp_view_choose(&got, volume, "v");
    const struct sp_transfer_function *a = &want.transfer_function, *b = &got.transfer_function;
    assert_float_equal(b->reference_length, a->reference_length, 1e-9);
    assert_int_equal(b->point_count, a->point_count);
    for (uint32_t i = 0; i < a->point_count; i++) {
        assert_float_equal(b->points[i].value, a->points[i].value, 3);
        assert_float_equal(b->points[i].opacity, a->points[i].opacity, 0.06);
    }
    for (int r = 0; r < 3; r++) {
        assert_float_equal(got.camera.position[r], want.camera.position[r], 15); /* of about 500 */
        assert_float_equal(got.camera.target[r], want.camera.target[r], 5);
        assert_float_equal(got.camera.up[r], want.camera.up[r], 1e-6);
    }
    /* The colours are equal. One colour for both images, because the steep colours of a smooth
     * field would multiply the small shift of the subvolume that the floor allows. */
    for (uint32_t i = 0; i < a->point_count; i++)
        for (int c = 0; c < 3; c++) {
            assert_float_equal(b->points[i].color[c], a->points[i].color[c], 1e-6);
            got.transfer_function.points[i].color[c] = 1;
            want.transfer_function.points[i].color[c] = 1;
        }
    got.level_of_detail = want.level_of_detail = SP_LOD_OFF;
    got.size[0] = got.size[1] = want.size[0] = want.size[1] = SIDE;
    struct sp_frame *truth = rig_render(rig, rig->whole, &want, 0),
                    *frame = rig_render(rig, rig->whole, &got, 0);
    const double db = rig_compare(truth, frame);
    print_message("the first view: %.1f dB\n", db);
    assert_compare(db, >, 38);
    sp_frame_unref(&truth);
    sp_frame_unref(&frame);
    sp_volume_unref(&volume);
}

static bool refuse(void *user, uint64_t bytes, struct sp_error *err) {
    uint64_t *asked = user; /* the first and the last time */
    asked[0] = asked[0] ? asked[0] : bytes;
    asked[1] = bytes;
    return sp_fail(err, SP_ERR_BUDGET, "", "refused");
}

static void opening_reserves_all_memory(void **state) {
    const struct rig *rig = *state;
    struct sp_error err;
    uint64_t asked[2] = { 0 };
    const struct sp_load_options options = { .subvolume_bytes = 1 << 20,
                                             .reserve = refuse,
                                             .user = asked };
    assert_null(sp_brick_store_open(dup(rig->file), "bricks", "bricks", &options, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_compare(asked[0], >, 1 << 20);
    assert_compare(asked[0], <, 2 << 20);
    assert_compare(asked[1], <, asked[0] / 2); /* less memory is better than none */
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(images_equal_those_of_the_volume_in_memory),
        one_thread_test(projections_and_edits_equal_those_of_the_volume),
        one_thread_test(little_memory_gives_coarser_images),
        cmocka_unit_test(a_frame_that_does_not_wait_is_refined),
        one_thread_test(nothing_that_is_seen_needs_no_bricks),
        cmocka_unit_test(a_damaged_brick_is_shown_coarsely_and_reported),
        cmocka_unit_test(threads_share_subvolumes),
        cmocka_unit_test(threads_of_two_files_share_memory),
        cmocka_unit_test(files_share_memory),
        one_thread_test(slices_and_measures_read_their_bricks),
        one_thread_test(the_first_view_is_that_of_the_volume_in_memory),
        cmocka_unit_test(opening_reserves_all_memory),
    };
    return cmocka_run_group_tests(tests, rig_setup, rig_teardown);
}
