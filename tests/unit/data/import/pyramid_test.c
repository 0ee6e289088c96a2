/* SPDX-License-Identifier: Apache-2.0
 *
 * OME-Zarr that is larger than memory, shown from its chunks: the processes that read the chunks,
 * also processes that misbehave.
 */
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "data/bricks/store.h"
#include "unit/data/import/support.h"

enum { SIDE = 96, LEVELS = 4, CHUNK = 24, SUBVOLUME = 192 << 10, MEMORY = 800000 };

static uint8_t value_at(unsigned level, unsigned x, unsigned y, unsigned z) {
    return (uint8_t)(50 * level + (x + 3 * y + 7 * z) % 50);
}

static void write_chunk(const char *name, unsigned level, unsigned x, unsigned y, unsigned z) {
    static uint8_t samples[CHUNK * CHUNK * CHUNK];
    char path[96];
    for (unsigned i = 0; i < sizeof samples; i++)
        samples[i] = value_at(level, CHUNK * x + i % CHUNK, CHUNK * y + i / CHUNK % CHUNK,
                              CHUNK * z + i / CHUNK / CHUNK);
    snprintf(path, sizeof path, "%s/%u/%u.%u.%u", name, level, z, y, x);
    write_file(path, samples, sizeof samples);
}

/* Levels of 96, 48, 24 and 12 samples, without the last chunk of level 0. */
static void write_image(const char *name, unsigned levels) {
    char path[96], list[512];
    size_t used = 0;
    mkdir(in_folder(name), 0700);
    for (unsigned l = 0; l < levels; l++) {
        const unsigned side = SIDE >> l, chunks = (side + CHUNK - 1) / CHUNK;
        used += (size_t)snprintf(list + used, sizeof list - used,
                                 "%s{\"path\": \"%u\", \"coordinateTransformations\": [{\"type\": "
                                 "\"scale\", \"scale\": [%u, %u, %u]}]}",
                                 l ? ", " : "", l, 1U << l, 1U << l, 1U << l);
        snprintf(path, sizeof path, "%s/%u", name, l);
        mkdir(in_folder(path), 0700);
        snprintf(path, sizeof path, "%s/%u/.zarray", name, l);
        write_text(path,
                   "{\"zarr_format\": 2, \"shape\": [%u, %u, %u], \"chunks\": [%d, %d, %d], "
                   "\"order\": \"C\", \"dtype\": \"|u1\", \"fill_value\": 250, \"filters\": null, "
                   "\"compressor\": null}",
                   side, side, side, CHUNK, CHUNK, CHUNK);
        for (unsigned i = 0; i < chunks * chunks * chunks; i++)
            if (l > 0 || i + 1 < chunks * chunks * chunks)
                write_chunk(name, l, i % chunks, i / chunks % chunks, i / chunks / chunks);
    }
    snprintf(path, sizeof path, "%s/.zgroup", name);
    write_text(path, "{\"zarr_format\": 2}");
    snprintf(path, sizeof path, "%s/.zattrs", name);
    write_text(path,
               "{\"multiscales\": [{\"version\": \"0.4\", \"axes\": [{\"name\": \"z\", \"type\": "
               "\"space\"}, {\"name\": \"y\", \"type\": \"space\"}, {\"name\": \"x\", \"type\": "
               "\"space\"}], \"datasets\": [%s]}]}",
               list);
}

static bool grant(void *user, uint64_t bytes, struct sp_error *err) {
    const uint64_t *limit = user;
    return bytes <= *limit ||
           sp_fail(err, SP_ERR_BUDGET, "", "%u bytes are too many", (unsigned)bytes);
}

static uint64_t memory = MEMORY;

static struct sp_load_options small_memory(void) {
    struct sp_load_options options = importer_options();
    options.reserve = grant;
    options.user = &memory;
    options.subvolume_bytes = SUBVOLUME;
    return options;
}

static struct sp_volume *open_image(const char *name) {
    const struct sp_load_options options = small_memory();
    struct sp_error err;
    struct sp_volume *volume = sp_volume_load(in_folder(name), &options, &err);
    if (!volume)
        fail_msg("%s: %s", err.place, err.text);
    assert_non_null(sp_brick_store_of(volume));
    return volume;
}

/* Reads all bricks of a level, or only the brick at `place`. */
static struct sp_brick_subvolume read_bricks(struct sp_volume *volume, unsigned l,
                                             const uint32_t *place) {
    struct sp_brick_store *store = sp_brick_store_of(volume);
    const struct sp_brick_level *level =
        &sp_brick_file_header(sp_brick_store_file(store))->level[l];
    struct sp_brick_need need = { .level = l };
    struct sp_brick_subvolume subvolume;
    struct sp_error err;
    for (int a = 0; a < 3; a++) {
        need.first[a] = place ? place[a] : 0;
        need.count[a] = place ? 1 : level->bricks[a];
    }
    assert_true(sp_brick_need_allocate(&need, BRICK_WANTED));
    if (!sp_brick_store_get(store, &need, INFINITY, false, NULL, NULL, &subvolume, &err))
        fail_msg("%s", err.text);
    free(need.wanted);
    assert_true(subvolume.is_wanted);
    assert_int_equal(subvolume.level, l);
    return subvolume;
}

static void check_subvolume(struct sp_brick_subvolume *w) {
    const uint8_t *samples = sp_volume_voxels(w->volume);
    for (unsigned i = 0; i < w->size[0] * w->size[1] * w->size[2]; i++) {
        const unsigned x = w->first[0] + i % w->size[0],
                       y = w->first[1] + i / w->size[0] % w->size[1],
                       z = w->first[2] + i / w->size[0] / w->size[1];
        const bool is_missing =
            w->level == 0 && x >= SIDE - CHUNK && y >= SIDE - CHUNK && z >= SIDE - CHUNK;
        assert_int_equal(samples[i], is_missing ? 250 : value_at(w->level, x, y, z));
    }
    assert_int_equal(w->lost, 0);
    sp_volume_unref(&w->volume);
}

static void a_pyramid_is_shown_from_its_chunks(void **state) {
    (void)state;
    write_image("pyramid.ome.zarr", LEVELS);
    struct sp_volume *volume = open_image("pyramid.ome.zarr");
    const struct sp_volume_info *info = sp_volume_info(volume);
    assert_string_equal(info->name, "pyramid");
    assert_int_equal(info->whole.dims[0], SIDE);
    assert_int_equal(info->whole.levels, LEVELS);
    assert_int_equal(info->grid.dims[0], SIDE >> 2); /* a quarter of the memory for subvolumes */
    assert_float_equal(info->grid.spacing[0], 4, 0);
    assert_float_equal(info->grid.origin[0], 1.5, 0);
    struct sp_brick_subvolume subvolume = read_bricks(volume, 1, NULL);
    check_subvolume(&subvolume);
    subvolume = read_bricks(volume, 0, (const uint32_t[]){ 1, 1, 1 });
    assert_int_equal(subvolume.size[0], SIDE - BRICK_SIDE);
    check_subvolume(&subvolume);
    sp_volume_unref(&volume);
}

/* Kills the child processes of the main thread, which started the readers; the thread that reads
 * chunks has started none. Returns their number. */
static int kill_children(void) {
    char path[64];
    int count = 0;
    pid_t child;
    snprintf(path, sizeof path, "/proc/self/task/%d/children", getpid());
    FILE *list = fopen(path, "r");
    assert_non_null(list);
    for (; fscanf(list, "%d", &child) == 1; count++)
        kill(child, SIGKILL);
    fclose(list);
    return count;
}

static void a_process_that_dies_is_started_again(void **state) {
    (void)state;
    write_image("killed.zarr", LEVELS);
    struct sp_volume *volume = open_image("killed.zarr");
    assert_compare(kill_children(), >, 0);
    struct sp_brick_subvolume subvolume = read_bricks(volume, 1, NULL);
    check_subvolume(&subvolume);
    sp_volume_unref(&volume);
}

static void a_damaged_chunk_is_a_hole(void **state) {
    (void)state;
    write_image("damaged.zarr", LEVELS);
    write_file("damaged.zarr/0/3.3.2", "short", 5);
    struct sp_volume *volume = open_image("damaged.zarr");
    struct sp_brick_subvolume subvolume = read_bricks(volume, 0, (const uint32_t[]){ 1, 1, 1 });
    assert_int_equal(subvolume.lost, 1);
    sp_volume_unref(&subvolume.volume);
    subvolume = read_bricks(volume, 0, (const uint32_t[]){ 0, 0, 0 });
    check_subvolume(&subvolume);
    sp_volume_unref(&volume);
}

static void what_has_no_small_level_needs_memory(void **state) {
    (void)state;
    const struct sp_load_options options = small_memory();
    struct sp_error err;
    write_image("single.zarr", 1);
    assert_null(sp_volume_load(in_folder("single.zarr"), &options, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_string_equal(err.text, "884736 bytes are too many");
    assert_null(sp_volume_load(in_folder("pyramid.ome.zarr?level=0"), &options, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET); /* a level that is named is read */
}

/* Refuses memory for all samples. */
static bool grant_later(void *user, uint64_t bytes, struct sp_error *err) {
    int *calls = user;
    (void)bytes;
    return ++*calls > 1 || sp_fail(err, SP_ERR_BUDGET, "", "too large");
}

static void misbehaving_importers_are_errors(void **state) {
    (void)state;
    static const struct {
        const char *what, *text;
    } cases[] = { { "levels-none", "sent 0 levels" },
                  { "levels-many", "sent 77 levels" },
                  { "levels-size", "a bad size of level 1" },
                  { "levels-chunk", "a bad size of level 0" },
                  { "levels-step", "a bad place of level 1" },
                  { "levels-other", "levels of another volume" },
                  { "chunk-other", "another chunk" },
                  { "chunk-dies", "status 6 and without a result" } };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int calls = 0;
        struct sp_load_options options = { .importer = SPLATD_TEST_DIR "/hostile_importer",
                                           .reserve = grant_later,
                                           .user = &calls,
                                           .subvolume_bytes = 128 };
        struct sp_error err;
        write_text(cases[i].what, "nothing of interest");
        assert_null(sp_volume_load(in_folder(cases[i].what), &options, &err));
        if (!strstr(err.text, cases[i].text))
            fail_msg("%s: %s: %s", cases[i].what, sp_code_name(err.code), err.text);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_pyramid_is_shown_from_its_chunks),
        cmocka_unit_test(a_process_that_dies_is_started_again),
        cmocka_unit_test(a_damaged_chunk_is_a_hole),
        cmocka_unit_test(what_has_no_small_level_needs_memory),
        cmocka_unit_test(misbehaving_importers_are_errors),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
