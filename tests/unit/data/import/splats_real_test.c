/* SPDX-License-Identifier: Apache-2.0
 *
 * Real scenes of Gaussians, compared with a reader in Python.
 */
#include <stdio.h>
#include <unistd.h>

#include "unit/data/import/support.h"

static void real_scenes_agree_with_another_reader(void **state) {
    static const struct {
        const char *file;
        uint32_t count, degree;
    } scenes[] = { { "pc_short_100.ply", 100, 3 }, { "guitar.compressed.ply", 90854, 0 } };
    (void)state;
    if (access(SPLATD_DATA_DIR "/formats/splats", R_OK) != 0) {
        print_message("skipped: there are no scenes in %s\n", SPLATD_DATA_DIR);
        skip();
    }
    for (size_t i = 0; i < sizeof scenes / sizeof *scenes; i++) {
        char path[512];
        struct sp_load_options options = importer_options();
        struct sp_error err = { .text = "" };
        snprintf(path, sizeof path, "%s/formats/splats/%s", SPLATD_DATA_DIR, scenes[i].file);
        struct sp_volume *volume = sp_volume_load(path, &options, &err);
        if (!volume)
            fail_msg("%s: %s [%s]", path, err.text, err.place);
        const struct sp_elements *e = sp_volume_elements(volume);
        assert_int_equal(e->shape.kind, SP_KIND_GAUSSIANS);
        assert_int_equal(e->shape.count, scenes[i].count);
        assert_int_equal(e->shape.degree, scenes[i].degree);
        assert_are_gaussians(volume, path);
        sp_volume_unref(&volume);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(real_scenes_agree_with_another_reader) };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
