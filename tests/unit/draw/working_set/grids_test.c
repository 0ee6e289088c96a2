/* SPDX-License-Identifier: Apache-2.0
 *
 * Brick files with rectilinear axes, and with vectors, against the same volumes in memory.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "data/bricks/places.h"
#include "data/bricks/store.h"
#include "data/volume/grid.h"
#include "data/volume/volume.h"
#include "sp/bricks.h"
#include "sp/slice.h"
#include "support/compare.h"
#include "support/sanitized.h"
#include "unit/draw/working_set/rig.h"

/* A level of the axes that the rig has, by hand: means of pairs. */
static uint32_t coarsen(const double *fine, uint32_t count, double *coarse) {
    for (uint32_t i = 0; i < (count + 1) / 2; i++)
        coarse[i] = 2 * i + 1 < count ? (fine[2 * i] + fine[2 * i + 1]) / 2 : fine[2 * i];
    return (count + 1) / 2;
}

static void places_of_levels_are_means(void **state) {
    const struct rig *rig = *state;
    struct sp_volume *volume = rig_open_file(rig, 0);
    const struct sp_brick_header *header =
        sp_brick_file_header(sp_brick_store_file(sp_brick_store_of(volume)));
    for (int a = 0; a < 3; a++) {
        double places[NX];
        uint32_t count = header->info.grid.dims[a];
        memcpy(places, rig->info.grid.coordinates[a], count * sizeof *places);
        for (unsigned l = 0; l < header->levels; l++) {
            assert_int_equal(header->level[l].dims[a], count);
            for (uint32_t i = 0; i < count; i++) {
                assert_float_equal(sp_brick_distance(header, l, a, i), places[i], 1e-9);
                assert_float_equal(sp_brick_sample(header, l, a, places[i]), i, 1e-9);
            }
            count = coarsen(places, count, places);
        }
    }
    sp_volume_unref(&volume);
}

/* Fills the image with the third ball. */
static void look_at_a_ball(const struct rig *rig, struct sp_view *view) {
    static const uint32_t at[3] = { 180, 40, 90 };
    const struct sp_grid *grid = &rig->info.grid;
    for (unsigned a = 0; a < 3; a++) {
        view->camera.target[a] = grid->origin[a] + sp_grid_distance(grid, a, at[a]);
        view->camera.position[a] = view->camera.target[a] + (a == 2 ? 120 : 1);
    }
    view->camera.fov_y = 8;
}

static void images_of_rectilinear_axes_equal_those_in_memory(void **state) {
    const struct rig *rig = *state;
    if (TEST_SANITIZED)
        print_message("reduced: subvolumes of a quarter of the samples\n");
    /* With memory for subvolumes of all samples, and of a quarter of them. */
    for (int is_small = TEST_SANITIZED; is_small < 2; is_small++) {
        struct sp_volume *volume = rig_open_file(rig, is_small ? 2 << 20 : 8 << 20);
        struct sp_view view = rig_make_view(rig);
        rig_expect(rig, volume, &view, 60, "far");
        rig_zoom(&view, 2.5);
        view.camera.target[0] += 20;
        rig_expect(rig, volume, &view, 60, "near");
        view.camera.projection = SP_ORTHOGRAPHIC;
        view.camera.height = 60;
        rig_expect(rig, volume, &view, 60, "orthographic");
        view = rig_make_view(rig);
        rig_zoom(&view, 2);
        view.clip.box[0][0] = 0.21;
        view.clip.box[1][1] = 0.73;
        rig_expect(rig, volume, &view, 60, "clip box");
        view.transfer_function.order = SP_TF_PRE; /* its mip levels merge classes */
        if (!is_small)
            rig_expect(rig, volume, &view, 60, "splats");
        view = rig_make_view(rig);
        look_at_a_ball(rig, &view);
        rig_expect(rig, volume, &view, 60, "close");
        view.layers[0] = sp_layer_default(SP_LAYER_SURFACE);
        view.layers[0].value = 100;
        rig_expect(rig, volume, &view, 40, "surface");
        sp_volume_unref(&volume);
    }
}

/* Samples that a subvolume stores in blocks keep their rectilinear places. */
static void blocks_have_rectilinear_axes(void **state) {
    const struct rig *rig = *state;
    struct sp_volume *volume = rig_open_file(rig, 16 << 20);
    struct sp_brick_store *store = sp_brick_store_of(volume);
    struct sp_brick_need need = { .count = { 4, 3, 3 }, .is_sparse = true };
    struct sp_brick_subvolume subvolume;
    struct sp_error err;
    assert_true(sp_brick_need_allocate(&need, BRICK_WANTED));
    assert_true(sp_brick_store_get(store, &need, INFINITY, false, NULL, NULL, &subvolume, &err));
    assert_non_null(sp_volume_blocks(subvolume.volume));
    const struct sp_view view = rig_make_view(rig);
    struct sp_frame *got = rig_render(rig, subvolume.volume, &view, 0),
                    *truth = rig_render(rig, rig->whole, &view, 0);
    assert_compare(rig_mean_of(truth), >, 1e-3);
    assert_compare(rig_compare(truth, got), >, 100);
    sp_frame_unref(&got);
    sp_frame_unref(&truth);
    sp_volume_unref(&subvolume.volume);
    free(need.wanted);
    sp_volume_unref(&volume);
}

static void slices_of_rectilinear_axes_equal_those_in_memory(void **state) {
    enum { WAIT_MS = 60000, INDEX = 77 };
    const struct rig *rig = *state;
    struct sp_error err;
    struct sp_volume *volume = rig_open_file(rig, 4 << 20);
    struct sp_volume_info info;
    assert_true(sp_bricks_describe(volume, 0, &info));
    for (uint32_t axis = 0; axis < 3; axis++) {
        struct sp_slice slice, own;
        unsigned level = 0;
        assert_true(sp_slice_init_orthogonal(&slice, &info, axis, INDEX, &err));
        assert_true(sp_slice_init_orthogonal(&own, sp_volume_info(rig->whole), axis, INDEX, &err));
        assert_memory_equal(slice.size, own.size, sizeof own.size);
        assert_int_equal(slice.type, SP_FLOAT32);
        const size_t count = (size_t)slice.size[0] * slice.size[1];
        float *want = malloc(count * sizeof *want), *got = malloc(count * sizeof *got);
        assert_true(want && got);
        sp_slice_sample(rig->whole, &own, want);
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
        for (size_t i = 0; i < count; i++)
            assert_float_equal(got[i], want[i], 1e-3);
        sp_volume_unref(&part);
        free(want);
        free(got);
    }
    assert_true(sp_bricks_describe(volume, 1, &info));
    for (uint32_t axis = 0; axis < 3; axis++) { /* a slice reaches from end to end */
        const uint32_t across = axis == 0 ? 1 : 0;
        struct sp_slice slice;
        assert_float_equal(info.grid.spacing[axis],
                           2 * sp_volume_info(rig->whole)->grid.spacing[axis], 1e-12);
        assert_true(sp_slice_init_orthogonal(&slice, &info, axis, 0, &err));
        assert_float_equal(info.grid.coordinates[across][info.grid.dims[across] - 1],
                           slice.grid_step[0][across] * (slice.size[0] - 1), 1e-9);
    }
    sp_volume_unref(&volume);
}

static struct sp_view make_streaks(const struct rig *rig) {
    struct sp_view view = rig_make_view(rig);
    view.layers[0] = sp_layer_default(SP_LAYER_VECTORS);
    view.level_of_detail = SP_LOD_OFF;
    return view;
}

/* Streaks of one level: which samples they begin at does not depend on the subvolume. */
static void streaks_equal_those_in_memory(void **state) {
    const struct rig *rig = *state;
    if (TEST_SANITIZED)
        print_message("reduced: subvolumes of some of the samples\n");
    for (int is_small = TEST_SANITIZED; is_small < 2; is_small++) {
        struct sp_volume *volume = rig_open_file(rig, is_small ? 40 << 20 : 80 << 20);
        struct sp_view view = make_streaks(rig);
        look_at_a_ball(rig, &view);
        rig_expect(rig, volume, &view, is_small ? 100 : 200, "modulated");
        view.layers[0].style = SP_VECTORS_BLEND;
        view.layers[0].density = 0.5;
        memcpy(view.layers[0].color_by, SP_COLOR_BY_LENGTH, sizeof SP_COLOR_BY_LENGTH);
        rig_expect(rig, volume, &view, is_small ? 100 : 200, "blended");
        struct sp_frame *frame = rig_render(rig, volume, &view, 0);
        assert_int_equal(frame->stats.bricks.level, 0);
        sp_frame_unref(&frame);
        sp_volume_unref(&volume);
    }
}

static struct sp_volume *find_other(void *user, const char *id) {
    assert_string_equal(id, "other");
    return sp_volume_ref(user);
}

/* Streaks of a volume in the colours of another volume. */
static struct sp_frame *render_colored(const struct rig *rig, struct sp_volume *volume,
                                       struct sp_volume *colors) {
    const struct sp_render_options options = { .format = SP_RGBAF32,
                                               .find = find_other,
                                               .user = colors };
    struct sp_view view = make_streaks(rig);
    struct sp_error err;
    look_at_a_ball(rig, &view);
    view.layers[0].density = 0.5;
    memcpy(view.layers[0].color_by, "other", sizeof "other");
    struct sp_frame *frame = sp_renderer_render(rig->renderer.renderer, volume, &view,
                                                rig->renderer.pool, &options, &err);
    if (!frame)
        fail_msg("%s: %s", err.place, err.text);
    return frame;
}

static void colours_come_from_memory_and_from_bricks(void **state) {
    enum { COARSE = 4 }; /* the number of a pair whose colours do not fit at the finest level */
    const struct rig *rig = *state;
    struct sp_volume *vectors = rig_open_file(rig, 40 << 20), *colors = rig_open_file(rig, 8 << 20),
                     *few = rig_open_file(rig, 1 << 20);
    struct sp_volume *const pairs[][2] = { { vectors, rig->whole },
                                           { rig->whole, colors },
                                           { vectors, colors },
                                           { vectors, vectors },
                                           { vectors, few } };
    struct sp_frame *truth = render_colored(rig, rig->whole, rig->whole);
    for (int i = 0; i <= COARSE; i++) {
        struct sp_frame *got = render_colored(rig, pairs[i][0], pairs[i][1]);
        const double db = rig_compare(truth, got);
        print_message("pair %d: %.1f dB\n", i, db);
        assert_int_equal(got->stats.bricks.level > 0, i == COARSE);
        assert_int_equal(sp_frame_bricks_is_complete(&got->stats.bricks), i != COARSE);
        assert_compare(db, >, i == COARSE ? 30 : 100);
        sp_frame_unref(&got);
    }
    sp_frame_unref(&truth);
    sp_volume_unref(&vectors);
    sp_volume_unref(&colors);
    sp_volume_unref(&few);
}

/* A file with one level has no coarser one. */
static void colours_without_memory_are_those_of_the_opened_volume(void **state) {
    const struct rig *rig = *state;
    struct sp_error err;
    char path[] = "/tmp/splat-colors-XXXXXX.bricks";
    const int fd = mkstemps(path, (int)strlen(".bricks"));
    const struct sp_load_options tiny = { .subvolume_bytes = 1 };
    struct sp_volume *volume = sp_volume_load("demo:tornado?size=32", NULL, &err), *colors = NULL;
    assert_true(fd >= 0 && volume);
    if (sp_bricks_convert("demo:turbulence?size=32", path, NULL, &err))
        colors = sp_brick_store_open(open(path, O_RDONLY | O_CLOEXEC), "b", "b", &tiny, &err);
    close(fd);
    unlink(path);
    if (!colors)
        fail_msg("%s: %s", err.place, err.text);
    struct sp_frame *frame = render_colored(rig, volume, colors);
    assert_true(sp_frame_bricks_is_complete(&frame->stats.bricks)); /* it has all samples */
    sp_frame_unref(&frame);
    sp_volume_unref(&volume);
    sp_volume_unref(&colors);
}

/* Compares the vectors of a subvolume with means of the rig's vectors. */
static void check_means(const struct rig *rig, const struct sp_volume *volume) {
    const struct sp_whole_part *part = &sp_volume_info(volume)->whole.part;
    const uint32_t *dims = sp_volume_info(volume)->grid.dims, size = 1u << part->level;
    const float(*vectors)[3] = sp_volume_vectors(volume);
    assert_non_null(vectors);
    for (uint32_t at = 0; at < dims[0] * dims[1] * dims[2]; at += 97) {
        const uint32_t i[3] = { at % dims[0], at / dims[0] % dims[1], at / dims[0] / dims[1] };
        double sum[3] = { 0 };
        bool is_whole = true;
        for (uint32_t k = 0; k < size * size * size; k++) {
            const uint32_t x = size * (part->first[0] + i[0]) + k % size,
                           y = size * (part->first[1] + i[1]) + k / size % size,
                           z = size * (part->first[2] + i[2]) + k / size / size;
            is_whole = is_whole && x < NX && y < NY && z < NZ;
            for (int c = 0; is_whole && c < 3; c++)
                sum[c] += (double)rig->vectors[((size_t)z * NY + y) * NX + x][c];
        }
        for (int c = 0; is_whole && c < 3; c++)
            assert_float_equal(vectors[at][c], sum[c] / (size * size * size), 1e-3);
    }
}

static void coarse_vectors_are_means(void **state) {
    const struct rig *rig = *state;
    struct sp_volume *volume = rig_open_file(rig, 8 << 20);
    const struct sp_volume_info *info = sp_volume_info(volume), *whole = sp_volume_info(rig->whole);
    assert_int_equal(info->whole.part.level, 2);
    assert_int_equal(info->vector_bytes, 12 * info->voxel_bytes);
    assert_string_equal(info->vector_name, "vortex");
    assert_float_equal(info->longest, whole->longest, 0);
    check_means(rig, volume);
    struct sp_view view = make_streaks(rig);
    struct sp_brick_store *store = sp_brick_store_of(volume);
    struct sp_brick_need need = { .level = 1, .first = { 1, 0, 0 }, .count = { 1, 2, 1 } };
    struct sp_brick_subvolume subvolume;
    struct sp_error err;
    uint16_t wanted[2] = { BRICK_WANTED, BRICK_WANTED };
    need.wanted = wanted;
    for (int turn = 0; turn < 2; turn++) { /* without vectors, then with them */
        need.has_vectors = turn;
        assert_true(
            sp_brick_store_get(store, &need, INFINITY, false, NULL, NULL, &subvolume, &err));
        assert_int_equal(sp_volume_info(subvolume.volume)->vector_bytes > 0, turn);
        assert_int_equal(subvolume.level, 1);
        if (turn)
            check_means(rig, subvolume.volume);
        sp_volume_unref(&subvolume.volume);
    }
    /* An image at a coarse level shows the same streaks, larger. */
    struct sp_frame *frame = rig_render(rig, volume, &view, 0);
    assert_false(frame->stats.bricks.is_incomplete);
    assert_compare(frame->stats.bricks.level, >, 0);
    assert_compare(rig_mean_of(frame), >, 1e-3);
    sp_frame_unref(&frame);
    sp_volume_unref(&volume);
}

static void other_layers_read_no_vectors(void **state) {
    const struct rig *rig = *state;
    struct sp_volume *volume = rig_open_file(rig, 8 << 20);
    struct sp_view view = rig_make_view(rig);
    uint64_t bricks, bytes;
    view.level_of_detail = SP_LOD_OFF;
    struct sp_frame *frame = rig_render(rig, volume, &view, 0);
    assert_int_equal(frame->stats.bricks.level, 0); /* whose vectors would not fit */
    sp_brick_store_usage(sp_brick_store_of(volume), &bricks, &bytes);
    assert_compare(bytes, <, 2 * COUNT);
    sp_frame_unref(&frame);
    sp_volume_unref(&volume);
}

enum { LOST = 3 };

/* Opens a copy of the brick file in which the vectors of the first bricks of a level are damaged:
 * at most LOST of them. */
static struct sp_volume *open_damaged(const struct rig *rig, unsigned l, uint64_t subvolume_bytes) {
    const struct sp_load_options options = { .subvolume_bytes = subvolume_bytes };
    const off_t size = lseek(rig->file, 0, SEEK_END);
    const int copy = memfd_create("damaged", MFD_CLOEXEC);
    unsigned char *bytes = malloc((size_t)size);
    struct sp_error err;
    struct sp_volume *sound = rig_open_file(rig, 0);
    const struct sp_brick_level *level =
        &sp_brick_file_header(sp_brick_store_file(sp_brick_store_of(sound)))->level[l];
    assert_non_null(bytes);
    assert_int_equal(pread(rig->file, bytes, (size_t)size, 0), size);
    for (uint64_t b = 0; b < LOST && b < sp_brick_count(level); b++) {
        struct sp_brick_entry entry;
        assert_true(sp_brick_entry_decode(bytes + level->vectors.at + b * BRICK_ENTRY_BYTES,
                                          (uint64_t)size, "copy", &entry, &err));
        assert_int_not_equal(entry.bytes, 0);
        bytes[entry.at + entry.bytes / 2] ^= 1;
    }
    assert_int_equal(write(copy, bytes, (size_t)size), size);
    struct sp_volume *volume = sp_brick_store_open(copy, "damaged", "damaged", &options, &err);
    if (!volume)
        fail_msg("%s", err.text);
    free(bytes);
    sp_volume_unref(&sound);
    return volume;
}

static uint64_t count_damage(const struct sp_volume *volume) {
    struct sp_bricks_damage damage;
    return sp_bricks_get_damage(volume, &damage) ? damage.count : 0;
}

/* Subvolumes that share bricks, with vectors and without. */
static void lost_vectors_leave_the_samples(void **state) {
    static const struct {
        bool has_vectors, has_all; /* else only the damaged bricks are wanted */
    } needs[] = { { true, false }, { false, true }, { true, true }, { false, true } };
    const struct rig *rig = *state;
    struct sp_volume *volume = open_damaged(rig, 0, 160 << 20);
    for (size_t i = 0; i < sizeof needs / sizeof *needs; i++) {
        struct sp_brick_need need = { .count = { 4, 3, 3 }, .has_vectors = needs[i].has_vectors };
        struct sp_brick_subvolume subvolume;
        struct sp_error err;
        assert_true(sp_brick_need_allocate(&need, needs[i].has_all ? BRICK_WANTED : BRICK_HIDDEN));
        for (int b = 0; b < LOST; b++)
            need.wanted[b] = BRICK_WANTED;
        assert_true(sp_brick_store_get(sp_brick_store_of(volume), &need, INFINITY, false, NULL,
                                       NULL, &subvolume, &err));
        assert_int_equal(subvolume.level, 0);
        assert_int_equal(subvolume.lost, needs[i].has_vectors ? LOST : 0);
        if (needs[i].has_all)
            assert_memory_equal(sp_volume_voxels(subvolume.volume), rig->samples, COUNT);
        assert_int_equal(count_damage(volume), LOST); /* samples that are read do not heal it */
        free(need.wanted);
        sp_volume_unref(&subvolume.volume);
    }
    sp_volume_unref(&volume);
}

/* Frames without vectors are as if no frame with them had been there. */
static void only_streaks_lose_what_vectors_lose(void **state) {
    enum { BASE = 2 };
    const struct rig *rig = *state;
    struct sp_view plain = rig_make_view(rig), streaks = make_streaks(rig);
    for (unsigned l = 0; l <= BASE; l += BASE) { /* a subvolume, then the volume that was opened */
        struct sp_volume *sound = rig_open_file(rig, l ? 8 << 20 : 80 << 20),
                         *volume = open_damaged(rig, l, l ? 8 << 20 : 80 << 20);
        plain.level_of_detail = streaks.level_of_detail = l ? SP_LOD_AUTO : SP_LOD_OFF;
        struct sp_frame *truth = rig_render_level(rig, sound, &plain, 0, l);
        for (int turn = 0; turn < 3; turn++) {
            const bool is_plain = turn != 1;
            struct sp_frame *frame =
                rig_render_level(rig, volume, is_plain ? &plain : &streaks, 0, l);
            assert_int_equal(frame->stats.bricks.level, l);
            assert_int_equal(frame->stats.bricks.lost > 0, !is_plain);
            assert_int_equal(frame->stats.bricks.is_incomplete, !is_plain);
            if (is_plain)
                assert_compare(rig_compare(truth, frame), ==, 200);
            sp_frame_unref(&frame);
        }
        sp_frame_unref(&truth);
        sp_volume_unref(&sound);
        sp_volume_unref(&volume);
    }
}

int main(void) {
    const struct CMUnitTest rectilinear[] = {
        cmocka_unit_test(places_of_levels_are_means),
        cmocka_unit_test(images_of_rectilinear_axes_equal_those_in_memory),
        cmocka_unit_test(blocks_have_rectilinear_axes),
        cmocka_unit_test(slices_of_rectilinear_axes_equal_those_in_memory),
    };
    const struct CMUnitTest vectors[] = {
        cmocka_unit_test(streaks_equal_those_in_memory),
        cmocka_unit_test(colours_come_from_memory_and_from_bricks),
        cmocka_unit_test(colours_without_memory_are_those_of_the_opened_volume),
        cmocka_unit_test(coarse_vectors_are_means),
        cmocka_unit_test(other_layers_read_no_vectors),
        cmocka_unit_test(lost_vectors_leave_the_samples),
        cmocka_unit_test(only_streaks_lose_what_vectors_lose),
    };
    const int failed = cmocka_run_group_tests_name("rectilinear", rectilinear,
                                                   rig_setup_rectilinear, rig_teardown);
    return cmocka_run_group_tests_name("vectors", vectors, rig_setup_vectors, rig_teardown) +
           failed;
}
