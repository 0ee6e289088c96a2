/* SPDX-License-Identifier: Apache-2.0
 *
 * Damaged OpenVDB files; `unit.formats_rest` compares undamaged files with OpenVDB itself.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "unit/data/import/support.h"

static void a_file_that_is_no_grid_is_refused(void **state) {
    (void)state;
    uint8_t bytes[200] = " BDV";
    write_file("short.vdb", bytes, 8);
    load_error("short.vdb", SP_ERR_FORMAT, "short.vdb", "");
    memset(bytes + 8, 0xff, sizeof bytes - 8);
    write_file("noise.vdb", bytes, sizeof bytes);
    load_error("noise.vdb", SP_ERR_FORMAT, "noise.vdb", "");
}

/* A file that is cut off anywhere is an error of that load, whatever the library does. */
static void a_file_that_is_cut_off_is_refused(void **state) {
    (void)state;
    static const char path[] = SPLATD_DATA_DIR "/formats/vdb/smoke.vdb";
    static const size_t sizes[] = { 100, 2000, 200000, 2000000 };
    FILE *file = fopen(path, "rb");
    if (!file) {
        print_message("skipped: %s is not there\n", path);
        skip();
    }
    char *bytes = malloc(2000000);
    assert_int_equal(fread(bytes, 1, 2000000, file), 2000000);
    fclose(file);
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        struct sp_load_options options = importer_options();
        struct sp_error err;
        write_file("cut.vdb", bytes, sizes[i]);
        assert_null(sp_volume_load(in_folder("cut.vdb"), &options, &err));
        assert_true(err.code == SP_ERR_FORMAT || err.code == SP_ERR_CRASHED);
    }
    free(bytes);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_file_that_is_no_grid_is_refused),
        cmocka_unit_test(a_file_that_is_cut_off_is_refused),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
