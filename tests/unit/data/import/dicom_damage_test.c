/* SPDX-License-Identifier: Apache-2.0
 *
 * Damaged DICOM files: the files of the folder dicom/, cut off and with wrong bytes. GDCM answers
 * some of them with failed assertions, which must not look like a crash. The changes are the same
 * in each run.
 */
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "unit/data/import/support.h"

enum { MUTATIONS = 34, FILES_MAX = 32, BYTES_MAX = 1 << 14, CUT = 500 };

static const char source[] = SPLATD_SOURCE_DIR "/tests/unit/data/import/dicom";

static uint32_t random_state;

static uint32_t draw(size_t below) {
    random_state = random_state * 1664525u + 1013904223u;
    return (uint32_t)(((uint64_t)(random_state >> 8) * below) >> 24);
}

static int by_name(const void *a, const void *b) {
    return strcmp(a, b);
}

static int list_files(char names[FILES_MAX][32]) {
    DIR *folder = opendir(source);
    int count = 0;
    assert_non_null(folder);
    for (struct dirent *e; (e = readdir(folder)) && count < FILES_MAX;)
        if (strstr(e->d_name, ".dcm"))
            snprintf(names[count++], 32, "%.31s", e->d_name);
    closedir(folder);
    qsort(names, (size_t)count, sizeof *names, by_name);
    return count;
}

static size_t read_source(const char *name, uint8_t *bytes) {
    char path[1024];
    snprintf(path, sizeof path, "%s/%s", source, name);
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    const size_t size = fread(bytes, 1, BYTES_MAX, file);
    fclose(file);
    assert_compare(size, >, 256);
    return size;
}

/* Wrong bytes anywhere, wrong lengths and tags in the header, lost bytes, a lost end. */
static size_t damage(int kind, uint8_t *bytes, size_t size) {
    static const uint8_t extreme[] = { 0, 1, 0x7f, 0x80, 0xfe, 0xff };
    const size_t header = size < 1200 ? size : 1200;
    if (kind == 0)
        return 132 + draw(size - 132);
    for (uint32_t i = 1 + draw(7); kind == 1 && i > 0; i--)
        bytes[draw(size)] = (uint8_t)draw(256);
    for (uint32_t i = 1 + draw(4); kind == 2 && i > 0; i--)
        bytes[132 + draw(header - 132)] = extreme[draw(sizeof extreme)];
    if (kind == 3) {
        const size_t at = 132 + draw(size - 200), lost = 1 + draw(40);
        memmove(bytes + at, bytes + at + lost, size - at - lost);
        size -= lost;
    }
    return size;
}

/* Loads, or fails with an error that names the file and says what is wrong with it. */
static void check_load(const char *path, const char *what) {
    struct sp_error err = { .code = SP_OK };
    const struct sp_load_options options = importer_options();
    struct sp_volume *volume = sp_volume_load(in_folder(path), &options, &err);
    if (volume) {
        sp_volume_unref(&volume);
        return;
    }
    const bool is_told = err.code == SP_ERR_FORMAT || err.code == SP_ERR_UNSUPPORTED ||
                         err.code == SP_ERR_NOT_FOUND || strstr(err.text, "damaged");
    if (!strstr(err.place, ".dcm") || !err.text[0] || !is_told || err.code == SP_ERR_TIMEOUT)
        fail_msg("%s: %s: %s: %s", what, sp_code_name(err.code), err.place, err.text);
}

static void damaged_files_load_or_are_errors(void **state) {
    (void)state;
    static uint8_t bytes[BYTES_MAX];
    char names[FILES_MAX][32], what[96], folder[32], path[64];
    const int files = list_files(names);
    assert_compare(files, >, 12);
    for (int i = 0; i < MUTATIONS; i++) {
        const char *name = names[i % files];
        const int kind = (i + i / files) % 4;
        random_state = (uint32_t)i;
        const size_t size = damage(kind, bytes, read_source(name, bytes));
        snprintf(what, sizeof what, "mutation %d of %s, kind %d", i, name, kind);
        snprintf(folder, sizeof folder, "m%d", i);
        snprintf(path, sizeof path, "%s/x.dcm", folder);
        assert_int_equal(mkdir(in_folder(folder), 0700), 0);
        write_file(path, bytes, size);
        check_load(path, what);
    }
}

/* A decoder of GDCM 3.0 crashes on these pixels. */
static const struct {
    int at;
    uint8_t byte;
} crash[] = { { 401, 27 }, { 763, 86 }, { 824, 137 } };

static void a_crash_of_a_decoder_is_an_error(void **state) {
    (void)state;
    static uint8_t bytes[BYTES_MAX];
    struct sp_error err;
    const struct sp_load_options options = importer_options();
    const size_t size = read_source("jpeg.dcm", bytes);
    for (size_t i = 0; i < sizeof crash / sizeof *crash; i++)
        bytes[crash[i].at] = crash[i].byte;
    assert_int_equal(mkdir(in_folder("crash"), 0700), 0);
    write_file("crash/x.dcm", bytes, size);
    assert_null(sp_volume_load(in_folder("crash/x.dcm"), &options, &err));
    assert_int_equal(err.code, SP_ERR_FORMAT);
    assert_non_null(strstr(err.place, "x.dcm"));
    assert_non_null(strstr(err.text, "damaged"));
}

/* One damaged slice does not end the load of its series. */
static void a_damaged_slice_is_left_out(void **state) {
    (void)state;
    static uint8_t bytes[BYTES_MAX];
    assert_int_equal(mkdir(in_folder("series"), 0700), 0);
    for (int k = 0; k < 4; k++) {
        char from[32], to[48];
        snprintf(from, sizeof from, "series%d.dcm", k);
        snprintf(to, sizeof to, "series/%d.dcm", k);
        const size_t size = read_source(from, bytes);
        write_file(to, bytes, k == 3 ? CUT : size);
    }
    struct sp_volume *volume = load("series/1.dcm");
    assert_int_equal(sp_volume_info(volume)->grid.dims[2], 3);
    assert_string_equal(sp_volume_info(volume)->warnings[0],
                        "Left out 1 file that cannot be read: 3.dcm: the file is cut off or "
                        "damaged.");
    sp_volume_unref(&volume);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(damaged_files_load_or_are_errors),
        cmocka_unit_test(a_crash_of_a_decoder_is_an_error),
        cmocka_unit_test(a_damaged_slice_is_left_out),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
