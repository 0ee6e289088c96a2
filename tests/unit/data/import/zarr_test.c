/* SPDX-License-Identifier: Apache-2.0
 *
 * Zarr hierarchies that this test writes by hand. tests/formats compares with zarr-python, in all
 * codecs and orders.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "data/import/zarr_chunk.h"
#include "data/import/zarr_image.h"
#include "unit/data/import/support.h"

#define V2 "{\"zarr_format\": 2, \"shape\": [2, 3, 4], \"chunks\": [1, 3, 2], \"order\": \"C\", "
#define V3                                                                                         \
    "{\"zarr_format\": 3, \"node_type\": \"array\", \"shape\": [3], \"chunk_grid\": {\"name\": "   \
    "\"regular\", \"configuration\": {\"chunk_shape\": [2]}}, \"fill_value\": 0, "

static void make_folder(const char *name) {
    mkdir(in_folder(name), 0700);
}

/* A v2 array of 2 x 3 x 4 bytes in chunks of 1 x 3 x 2, without chunk 1.0.1; sample i is `first` +
 * i along x, y and z. */
static void write_array(const char *folder, uint8_t first, const char *more) {
    char name[64];
    make_folder(folder);
    snprintf(name, sizeof name, "%s/.zarray", folder);
    write_text(name,
               V2 "\"dtype\": \"|u1\", \"fill_value\": 99, \"filters\": null, "
                  "\"compressor\": null%s}",
               more);
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < 2; i++) {
            uint8_t chunk[6];
            for (int n = 0; n < 6; n++)
                chunk[n] = (uint8_t)(first + (k * 3 + n / 2) * 4 + 2 * i + n % 2);
            snprintf(name, sizeof name, "%s/%d.0.%d", folder, k, i);
            if (k == 0 || i == 0)
                write_file(name, chunk, sizeof chunk);
        }
}

static void check_array(const struct sp_volume *volume, uint8_t first) {
    const uint8_t *samples = sp_volume_voxels(volume);
    const struct sp_volume_info *info = sp_volume_info(volume);
    assert_int_equal(info->grid.dims[0], 4);
    assert_int_equal(info->grid.dims[1], 3);
    assert_int_equal(info->grid.dims[2], 2);
    for (int i = 0; i < 24; i++)
        assert_int_equal(samples[i], i >= 12 && i % 4 >= 2 ? 99 : first + i);
}

static void chunks_are_joined_and_missing_ones_filled(void **state) {
    (void)state;
    write_array("plain", 5, "");
    struct sp_volume *volume = load("plain");
    check_array(volume, 5);
    assert_string_equal(sp_volume_info(volume)->name, "plain");
    sp_volume_unref(&volume);
    volume = load("plain/.zarray"); /* the file is the same */
    check_array(volume, 5);
    sp_volume_unref(&volume);
}

static void write_image(const char *name) {
    char path[64];
    make_folder(name);
    snprintf(path, sizeof path, "%s/.zgroup", name);
    write_text(path, "{\"zarr_format\": 2}");
    snprintf(path, sizeof path, "%s/.zattrs", name);
    write_text(path,
               "{\"multiscales\": [{\"version\": \"0.4\", \"note\": NaN, \"axes\": "
               "[{\"name\": \"z\", \"type\": \"space\", \"unit\": \"nanometer\"}, "
               "{\"name\": \"y\", \"type\": \"space\", \"unit\": \"millimeter\"}, "
               "{\"name\": \"x\", \"type\": \"space\", \"unit\": \"micrometer\"}], \"datasets\": ["
               "{\"path\": \"0\", \"coordinateTransformations\": ["
               "{\"type\": \"scale\", \"scale\": [500, 0.003, 4]}, "
               "{\"type\": \"translation\", \"translation\": [1000, 0.25, 7]}]}, "
               "{\"path\": \"1\", \"coordinateTransformations\": ["
               "{\"type\": \"scale\", \"scale\": [1000, 0.006, 8]}]}]}]}");
    snprintf(path, sizeof path, "%s/0", name);
    write_array(path, 1, "");
    snprintf(path, sizeof path, "%s/1", name);
    write_array(path, 50, "");
}

static void levels_have_scale_translation_and_unit(void **state) {
    (void)state;
    write_image("image.ome.zarr");
    struct sp_volume *volume = load("image.ome.zarr");
    const struct sp_volume_info *info = sp_volume_info(volume);
    check_array(volume, 1);
    assert_string_equal(info->unit, "um");
    assert_string_equal(info->name, "image");
    const double spacing[3] = { 4, 3, 0.5 }, origin[3] = { 7, 250, 1 };
    for (int a = 0; a < 3; a++) {
        assert_float_equal(info->grid.spacing[a], spacing[a], 1e-12);
        assert_float_equal(info->grid.origin[a], origin[a], 1e-9);
    }
    sp_volume_unref(&volume);
    volume = load("image.ome.zarr?level=1");
    check_array(volume, 50);
    assert_float_equal(sp_volume_info(volume)->grid.spacing[0], 8, 1e-12);
    sp_volume_unref(&volume);
    load_error("image.ome.zarr?level=2", SP_ERR_NOT_FOUND, "image.ome.zarr", "to 1");
}

/* Grants memory at the second request only, and not for showing the image from its chunks. */
static bool grant_second(void *user, uint64_t bytes, struct sp_error *err) {
    int *calls = user;
    return (++*calls > 1 && bytes < 1000) || sp_fail(err, SP_ERR_BUDGET, "", "too large");
}

static void without_memory_a_coarser_level_is_loaded(void **state) {
    (void)state;
    struct sp_load_options options = importer_options();
    struct sp_error err;
    int calls = 0;
    options.reserve = grant_second;
    options.user = &calls;
    write_image("large.zarr");
    struct sp_volume *volume = sp_volume_load(in_folder("large.zarr"), &options, &err);
    assert_non_null(volume);
    check_array(volume, 50);
    assert_non_null(strstr(sp_volume_info(volume)->warnings[0], "level 1 was read, of 0 to 1."));
    sp_volume_unref(&volume);
    calls = 0; /* unless the source names a level */
    assert_null(sp_volume_load(in_folder("large.zarr?level=0"), &options, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
}

static void chunks_can_be_read_alone(void **state) {
    (void)state;
    char path[256];
    write_image("cached.zarr");
    snprintf(path, sizeof path, "%s", in_folder("cached.zarr"));
    const struct import_file file = {
        .fd = -1, .title = "cached.zarr/.zattrs", .root = path, .folder = path, .field = ""
    };
    struct zarr_store *store = zarr_folder_open(&file);
    struct zarr_node node;
    struct zarr_image image;
    struct zarr_chunks chunks;
    struct sp_error err;
    uint8_t out[6];
    assert_int_equal(zarr_node_open(&node, store, "", &err), ZARR_FOUND);
    assert_true(zarr_image_open(&image, &node, &err));
    zarr_node_close(&node);
    assert_int_equal(image.level_count, 2);
    const struct zarr_array *array = &image.levels[1].array;
    assert_int_equal(array->chunk_bytes, sizeof out);
    assert_int_equal(zarr_array_chunks(array, 2), 2);
    zarr_chunks_init(&chunks, store, &file);
    const uint64_t there[ZARR_RANK_MAX] = { 1, 0, 0 }, missing[ZARR_RANK_MAX] = { 1, 0, 1 };
    assert_int_equal(zarr_chunk_read(&chunks, array, there, out, &err), ZARR_FOUND);
    assert_memory_equal(out, ((uint8_t[]){ 62, 63, 66, 67, 70, 71 }), sizeof out);
    assert_int_equal(zarr_chunk_read(&chunks, array, missing, out, &err), ZARR_MISSING);
    assert_memory_equal(out, ((uint8_t[]){ 99, 99, 99, 99, 99, 99 }), sizeof out);
    zarr_chunks_finish(&chunks);
    zarr_image_close(&image);
    zarr_folder_close(&store);
}

static void a_damaged_chunk_is_a_hole_with_a_warning(void **state) {
    (void)state;
    write_array("hole", 5, "");
    write_file("hole/1.0.1", "1234", 4);
    struct sp_volume *volume = load("hole");
    check_array(volume, 5); /* as if it was missing */
    const char *warning = sp_volume_info(volume)->warnings[0];
    assert_string_equal(warning, "The chunk 1.0.1 was left out: the chunk has 4 bytes and needs 6: "
                                 "it is cut off, or its metadata is wrong.");
    sp_volume_unref(&volume);
}

static void damaged_hierarchies_are_refused(void **state) {
    (void)state;
    static const struct {
        const char *name, *metadata, *place, *text;
    } cases[] = {
        { ".zarray", "{\"zarr_format\": 2", "x: .zarray", "line 1" },
        { ".zarray", "{\"zarr_format\": 1}", "/zarr_format", "versions 2 and 3" },
        { ".zarray", V2 "\"dtype\": \"<M8\"}", "/dtype", "<M8" },
        { ".zarray", V2 "\"dtype\": [[\"a\", \"<i2\"]]}", "/dtype", "of a structure" },
        { ".zarray", V2 "\"dtype\": \"<i2\", \"compressor\": {\"id\": \"snappy\"}}",
          "/compressor/id", "\"snappy\" is not supported" },
        { ".zarray", "{\"zarr_format\": 2, \"dtype\": \"<i2\", \"shape\": [3, -1]}", "/shape",
          "number 1" },
        { ".zarray", "{\"zarr_format\": 2, \"dtype\": \"<i2\", \"shape\": [9], \"chunks\": [0]}",
          "/chunks", "number 0" },
        { ".zarray",
          "{\"zarr_format\": 2, \"dtype\": \"<i2\", \"shape\": [9], \"chunks\": [999999999999]}",
          "/chunks", "smaller" },
        { ".zgroup", "{\"zarr_format\": 2}", ".zgroup", "neither" },
        { "zarr.json", V3 "\"data_type\": \"r16\"}", "/data_type", "r16" },
        { "zarr.json", V3 "\"data_type\": \"int16\", \"codecs\": []}", "/codecs", "bytes" },
        { "zarr.json",
          V3 "\"data_type\": \"int16\", \"codecs\": [{\"name\": \"bytes\"}, {\"name\": \"zfp\"}]}",
          "/codecs", "\"zfp\" is not supported" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char name[64];
        make_folder("x");
        snprintf(name, sizeof name, "x/%s", cases[i].name);
        write_text(name, "%s", cases[i].metadata);
        struct sp_load_options options = importer_options();
        struct sp_error err = { .text = "" };
        if (sp_volume_load(in_folder("x"), &options, &err))
            fail_msg("case %zu was loaded", i);
        if (!strstr(err.place, cases[i].place) || !strstr(err.text, cases[i].text))
            fail_msg("case %zu: %s [%s]", i, err.text, err.place);
        remove(in_folder(name));
    }
    static const char *const in_order[] = { "short/0.0.0", "short/0.0.1", "short/1.0.0",
                                            "short/1.0.1" };
    write_array("short", 0, "");
    for (int i = 0; i < 4; i++)
        write_file(in_order[i], "1234", 4);
    load_error("short", SP_ERR_FORMAT, "1.0.1", "has 4 bytes and needs 6");
    write_array("outside", 0, "");
    remove(in_folder("outside/0.0.1"));
    assert_int_equal(symlink("/etc/passwd", in_folder("outside/0.0.1")), 0);
    load_error("outside", SP_ERR_DENIED, "0.0.1", "symbolic link");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(chunks_are_joined_and_missing_ones_filled),
        cmocka_unit_test(levels_have_scale_translation_and_unit),
        cmocka_unit_test(without_memory_a_coarser_level_is_loaded),
        cmocka_unit_test(chunks_can_be_read_alone),
        cmocka_unit_test(a_damaged_chunk_is_a_hole_with_a_warning),
        cmocka_unit_test(damaged_hierarchies_are_refused),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
