/* SPDX-License-Identifier: Apache-2.0
 *
 * The order in which bricks are read: nearest to the eye and most visible first. One thread reads,
 * so that the order is the same each time.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/bricks/store.h"
#include "draw/working_set/working_set.h"
#include "support/compare.h"
#include "unit/draw/working_set/rig.h"

enum { BRICKS_MAX = 4 * 4 * 4 };

/* A view from a corner that shows all values, faintly. */
static struct sp_view make_view(const struct rig *rig) {
    struct sp_view view = rig_make_view(rig);
    const double far[3] = { 700, 430, 560 }; /* perspective, outside of the volume */
    memcpy(view.camera.position, far, sizeof far);
    view.camera.fov_y = 40;
    view.transfer_function.point_count = 1;
    view.transfer_function.points[0].opacity = 0.02f;
    return view;
}

static void compute_need(const struct sp_brick_file *file, const struct sp_view *view,
                         bool is_whole, struct sp_brick_need *need) {
    assert_true(sp_working_set_need(file, view, 0, is_whole, need));
    assert_compare(sp_brick_need_wanted(need), >, 8);
    assert_compare(sp_brick_need_count(need), <=, BRICKS_MAX);
}

static void compute_centre(const struct sp_brick_file *file, const struct sp_brick_need *need,
                           uint64_t i, double centre[3]) {
    const struct sp_brick_header *header = sp_brick_file_header(file);
    const struct sp_brick_level *level = &header->level[need->level];
    const struct sp_grid *grid = &header->info.grid;
    uint32_t first[3], size[3];
    sp_brick_box(level, sp_brick_need_at(need, level, i), first, size);
    for (int a = 0; a < 3; a++) /* the grid has the axes of the world */
        centre[a] = grid->origin[a] + grid->spacing[a] * (first[a] + 0.5 * size[a] - 0.5);
}

static double compute_distance(const struct sp_view *view, const double point[3]) {
    double sum = 0;
    for (int a = 0; a < 3; a++)
        sum += pow(point[a] - view->camera.position[a], 2);
    return sqrt(sum);
}

/* Bricks of a need while they are read. */
struct reader {
    const struct sp_brick_file *file;
    const struct sp_brick_need *need;
    uint8_t *samples; /* of the box; no sample of a wanted brick is 0 */
    unsigned limit;   /* reading stops after so many bricks */
};

/* Marks the wanted bricks that were read; returns how many. */
static unsigned mark_read(const struct reader *r, bool is_read[BRICKS_MAX]) {
    const struct sp_brick_level *level = &sp_brick_file_header(r->file)->level[0];
    unsigned count = 0;
    for (uint64_t i = 0; i < sp_brick_need_count(r->need); i++) {
        uint32_t box[3], extent[3], first[3], size[3];
        sp_brick_need_box(r->need, level, box, extent);
        sp_brick_box(level, sp_brick_need_at(r->need, level, i), first, size);
        const size_t at = ((size_t)(first[2] - box[2]) * extent[1] + first[1] - box[1]) * extent[0];
        is_read[i] = r->need->wanted[i] >= BRICK_WANTED && r->samples[at + first[0] - box[0]] != 0;
        count += is_read[i];
    }
    return count;
}

static bool is_over(void *user) {
    const struct reader *r = user;
    bool is_read[BRICKS_MAX];
    return mark_read(r, is_read) >= r->limit;
}

/* Reads `limit` bricks of a need, then stops. Marks the bricks that it read. */
static void read_some(const struct sp_brick_file *file, const struct sp_brick_need *need,
                      unsigned limit, bool is_read[BRICKS_MAX]) {
    struct reader reader = { file, need, calloc(1, (size_t)sp_brick_need_bytes(file, need)),
                             limit };
    uint8_t lost[BRICKS_MAX] = { 0 };
    struct sp_error why, err;
    struct sp_pool *pool = sp_pool_create(1, &err);
    assert_non_null(reader.samples);
    assert_non_null(pool);
    const struct sp_brick_fill_job job = { .file = (struct sp_brick_file *)file, /* only read */
                                           .need = need,
                                           .pool = pool,
                                           .is_cancelled = is_over,
                                           .user = &reader,
                                           .samples = reader.samples,
                                           .lost = lost };
    const bool ok = sp_brick_fill(&job, &why, &err);
    assert_true(ok || err.code == SP_ERR_CANCELLED);
    assert_int_equal(mark_read(&reader, is_read), limit);
    sp_pool_destroy(&pool);
    free(reader.samples);
}

/* The wanted bricks in the order in which they are read. */
static unsigned compute_order(const struct sp_brick_file *file, const struct sp_brick_need *need,
                              uint64_t order[BRICKS_MAX]) {
    const unsigned count = (unsigned)sp_brick_need_wanted(need);
    bool before[BRICKS_MAX] = { false };
    for (unsigned n = 0; n < count; n++) {
        bool is_read[BRICKS_MAX];
        unsigned fresh = 0;
        read_some(file, need, n + 1, is_read);
        for (uint64_t i = 0; i < sp_brick_need_count(need); i++) {
            assert_true(is_read[i] || !before[i]);
            if (is_read[i] && !before[i]) {
                order[n] = i;
                fresh++;
            }
        }
        assert_int_equal(fresh, 1);
        memcpy(before, is_read, sizeof before);
    }
    return count;
}

static void the_nearest_of_equal_bricks_is_read_first(void **state) {
    const struct rig *rig = *state;
    struct sp_volume *volume = rig_open_file(rig, 0);
    const struct sp_brick_file *file = sp_brick_store_file(sp_brick_store_of(volume));
    for (int is_flat = 0; is_flat < 2; is_flat++) {
        struct sp_view view = make_view(rig);
        struct sp_brick_need need;
        uint64_t order[BRICKS_MAX];
        view.camera.projection = is_flat ? SP_ORTHOGRAPHIC : SP_PERSPECTIVE;
        view.camera.height = 400;
        compute_need(file, &view, false, &need);
        const unsigned count = compute_order(file, &need, order);
        double last = 0;
        /* Bricks at the far ends are smaller; only bricks of full size are compared. */
        const struct sp_brick_level *level = &sp_brick_file_header(file)->level[0];
        unsigned compared = 0;
        for (unsigned n = 0; n < count; n++) {
            uint32_t first[3], size[3];
            double centre[3], distance = 0;
            sp_brick_box(level, sp_brick_need_at(&need, level, order[n]), first, size);
            if (size[0] * size[1] * size[2] < BRICK_SIDE * BRICK_SIDE * BRICK_SIDE)
                continue;
            compute_centre(file, &need, order[n], centre);
            if (is_flat) {
                double way[3], length = compute_distance(&view, view.camera.target);
                for (int a = 0; a < 3; a++) {
                    way[a] = (view.camera.target[a] - view.camera.position[a]) / length;
                    distance += way[a] * (centre[a] - view.camera.position[a]);
                }
            } else {
                distance = compute_distance(&view, centre);
            }
            assert_compare(distance, >=, last * 0.999); /* importance has steps of 0.07 % */
            last = distance;
            compared++;
        }
        assert_compare(compared, >=, 8);
        free(need.wanted);
    }
    sp_volume_unref(&volume);
}

/* The transfer function shows noise faintly and balls opaquely: bricks with balls are first, even
 * behind the others. */
static void opaque_bricks_are_read_before_faint_ones(void **state) {
    const struct rig *rig = *state;
    struct sp_volume *volume = rig_open_file(rig, 0);
    const struct sp_brick_file *file = sp_brick_store_file(sp_brick_store_of(volume));
    const struct sp_brick_entry *entries = sp_brick_file_entries(file, 0);
    struct sp_view view = make_view(rig);
    struct sp_brick_need need;
    uint64_t order[BRICKS_MAX];
    view.transfer_function.point_count = 3;
    view.transfer_function.points[0] = (struct sp_tf_point){ .value = 0, .opacity = 0.001f };
    view.transfer_function.points[1] = (struct sp_tf_point){ .value = 60, .opacity = 0.001f };
    view.transfer_function.points[2] = (struct sp_tf_point){ .value = 200, .opacity = 1 };
    compute_need(file, &view, false, &need);
    const unsigned count = compute_order(file, &need, order);
    unsigned balls = 0, faint = 0;
    for (unsigned n = 0; n < count; n++) {
        const uint64_t number =
            sp_brick_need_at(&need, &sp_brick_file_header(file)->level[0], order[n]);
        const double high = entries[number].range[1];
        assert_true(high < 60 || faint == 0);
        balls += high >= 150;
        faint += high < 60;
    }
    assert_compare(balls, >, 4);
    assert_compare(faint, >, 4);
    free(need.wanted);
    sp_volume_unref(&volume);
}

static void bricks_beside_the_image_are_read_last(void **state) {
    const struct rig *rig = *state;
    struct sp_volume *volume = rig_open_file(rig, 0);
    const struct sp_brick_file *file = sp_brick_store_file(sp_brick_store_of(volume));
    struct sp_view view = make_view(rig);
    struct sp_brick_need seen, whole;
    uint64_t order[BRICKS_MAX];
    rig_zoom(&view, 2.5);
    view.camera.fov_y = 10;
    compute_need(file, &view, false, &seen);
    compute_need(file, &view, true, &whole);
    const unsigned count = compute_order(file, &whole, order);
    const unsigned seen_count = (unsigned)sp_brick_need_wanted(&seen);
    assert_compare(count, >, seen_count);
    for (unsigned n = 0; n < count; n++) {
        uint64_t at;
        const bool is_seen = sp_brick_need_find(&whole, order[n], &seen, &at) && seen.wanted[at];
        assert_int_equal(is_seen, n < seen_count);
    }
    free(seen.wanted);
    free(whole.wanted);
    sp_volume_unref(&volume);
}

/* A source that is read chunk by chunk, and remembers in which order. */
struct recorder {
    const struct rig *rig;
    unsigned count;
    uint32_t places[BRICKS_MAX][3];
};

static const uint32_t chunk[3] = { 50, 75, 133 };

static bool record_chunk(void *user, unsigned reader, unsigned level, const uint32_t place[3],
                         void *out, bool (*is_cancelled)(void *cancel), void *cancel,
                         struct sp_error *err) {
    struct recorder *r = user;
    (void)is_cancelled;
    (void)cancel;
    (void)err;
    assert_int_equal(reader, 0);
    assert_compare(r->count, <, BRICKS_MAX);
    if (level == 0)
        memcpy(r->places[r->count++], place, sizeof r->places[0]);
    memset(out, 100, (size_t)chunk[0] * chunk[1] * chunk[2]);
    return true;
}

static void keep_source(void *user) {
    (void)user;
}

static void chunks_of_the_nearest_bricks_are_read_first(void **state) {
    const struct rig *rig = *state;
    struct recorder recorder = { .rig = rig };
    struct sp_chunk_source source = {
        .info = rig->info,
        .levels = 2,
        .level = { { { NX, NY, NZ }, { chunk[0], chunk[1], chunk[2] }, { 1, 1, 1 }, { 0, 0, 0 } },
                   { { 50, 75, 133 },
                     { chunk[0], chunk[1], chunk[2] },
                     { NX / 50.0, 2, 1 },
                     { 0, 0, 0 } } },
        .readers = 1,
        .user = &recorder,
        .read = record_chunk,
        .close = keep_source
    };
    struct sp_load_options options = { .subvolume_bytes = 12 << 20 };
    struct sp_error err;
    source.info.range[1] = 255;
    struct sp_volume *volume =
        sp_brick_store_open_chunks(&source, "chunks", "chunks", &options, &err);
    if (!volume)
        fail_msg("%s", err.text);
    struct sp_brick_store *store = sp_brick_store_of(volume);
    assert_int_equal(sp_brick_store_base(store), 1);
    const struct sp_view view = make_view(rig);
    struct sp_brick_need need;
    struct sp_brick_subvolume subvolume;
    compute_need(sp_brick_store_file(store), &view, false, &need);
    recorder.count = 0;
    assert_true(sp_brick_store_get(store, &need, INFINITY, false, NULL, NULL, &subvolume, &err));
    assert_true(subvolume.is_wanted);
    assert_int_equal(recorder.count, 5 * 2); /* each chunk once */
    /* A chunk is as important as the most important brick in it. */
    unsigned last = UINT16_MAX;
    for (unsigned n = 0; n < recorder.count; n++) {
        unsigned most = 0;
        for (uint64_t i = 0; i < sp_brick_need_count(&need); i++) {
            uint32_t first[3], size[3];
            bool is_in = true;
            const struct sp_brick_level *level =
                &sp_brick_file_header(sp_brick_store_file(store))->level[0];
            sp_brick_box(level, sp_brick_need_at(&need, level, i), first, size);
            for (int a = 0; a < 3; a++)
                is_in = is_in && first[a] < (recorder.places[n][a] + 1) * chunk[a] &&
                        first[a] + size[a] > recorder.places[n][a] * chunk[a];
            most = is_in && need.wanted[i] > most ? need.wanted[i] : most;
        }
        assert_compare(most, <=, last);
        last = most;
    }
    assert_compare(recorder.places[0][0], >=, 2); /* the camera is at the far end */
    sp_volume_unref(&subvolume.volume);
    free(need.wanted);
    sp_volume_unref(&volume);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_nearest_of_equal_bricks_is_read_first),
        cmocka_unit_test(opaque_bricks_are_read_before_faint_ones),
        cmocka_unit_test(bricks_beside_the_image_are_read_last),
        cmocka_unit_test(chunks_of_the_nearest_bricks_are_read_first),
    };
    return cmocka_run_group_tests(tests, rig_setup, rig_teardown);
}
