/* SPDX-License-Identifier: Apache-2.0
 *
 * Files that a header names: only those below the root are opened, and errors tell nothing of the
 * others.
 */
#include "import/confine.h"

#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "unit/import/support.h"

enum { COUNT = 60 };

static void data_files_outside_the_root_are_denied(void **state) {
    (void)state;
    uint8_t samples[COUNT];
    make_ramp(SP_UINT8, COUNT, samples);
    assert_int_equal(mkdir(in_folder("root"), 0700), 0);
    assert_int_equal(mkdir(in_folder("root/sub"), 0700), 0);
    write_file("secret.raw", samples, COUNT);
    write_file("root/open.raw", samples, COUNT);
    char target[512];
    snprintf(target, sizeof target, "%s", in_folder("secret.raw"));
    assert_int_equal(symlink(target, in_folder("root/sub/link.raw")), 0);
    assert_int_equal(symlink("../open.raw", in_folder("root/sub/inside.raw")), 0);
    snprintf(target, sizeof target, "%s", in_folder("root/open.raw"));
    assert_int_equal(symlink(target, in_folder("root/sub/absolute.raw")), 0);
    assert_int_equal(symlink(in_folder("root/sub"), in_folder("root/sub/there")), 0);

    const struct {
        const char *name;
        bool with_root; /* the root is "root"; without it, the folder of the file, "root/sub" */
        enum sp_code code;
    } cases[] = {
        { "../open.raw", true, SP_OK },
        { "inside.raw", true, SP_OK },
        { target, true, SP_OK },
        { "absolute.raw", true, SP_OK },
        { "there/absolute.raw", true, SP_OK },
        { "there/../open.raw", true, SP_OK },
        { "../../root/open.raw", true, SP_OK },
        { "../open.raw", false, SP_ERR_DENIED },
        { "inside.raw", false, SP_ERR_DENIED },
        { target, false, SP_ERR_DENIED },
        { "link.raw", true, SP_ERR_DENIED },
        { "../../secret.raw", true, SP_ERR_DENIED },
        { "/etc/passwd", true, SP_ERR_DENIED },
        { "/proc/self/environ", true, SP_ERR_DENIED },
        { "../../../../../../../dev/zero", true, SP_ERR_DENIED },
        { "missing.raw", true, SP_ERR_NOT_FOUND },
        { "..", true, SP_ERR_DENIED },
        { ".", true, SP_ERR_INVALID },
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        write_text("root/sub/head.nhdr",
                   "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n"
                   "data file: %s\n",
                   cases[i].name);
        struct sp_load_options options = importer_options();
        options.root = cases[i].with_root ? in_folder("root") : NULL;
        struct sp_error err = { .code = SP_OK };
        struct sp_volume *volume = sp_volume_load(in_folder("root/sub/head.nhdr"), &options, &err);
        if (err.code != cases[i].code)
            fail_msg("%s: %s: %s", cases[i].name, sp_code_name(err.code), err.text);
        if (volume)
            assert_is_ramp(volume, COUNT);
        else
            assert_string_equal(err.place, cases[i].name);
        sp_volume_unref(&volume);
    }
}

/* An error about a file outside of the root tells nothing of what is there. */
static void what_exists_outside_the_root_stays_unknown(void **state) {
    (void)state;
    assert_int_equal(mkdir(in_folder("closed"), 0700), 0);
    assert_int_equal(mkdir(in_folder("beside"), 0700), 0);
    write_text("beside/file.raw", "x");
    assert_int_equal(symlink("circle", in_folder("beside/circle")), 0);
    assert_int_equal(symlink("../closed", in_folder("beside/back")), 0);
    write_text("closed/own.raw", "x");
    static const char *const names[] = { "file.raw",   "missing.raw",  "file.raw/x",
                                         "missing/x",  "circle",       "circle/x",
                                         "../beside",  "back/own.raw", "back/missing.raw",
                                         "./file.raw", "file.raw/../x" };
    for (int kind = 0; kind < 3; kind++) {
        char first[SP_ERROR_TEXT] = "";
        for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
            char name[1024], target[512], link[64];
            snprintf(target, sizeof target, "../beside/%s", names[i]);
            snprintf(name, sizeof name, "%s", target);
            if (kind == 1) /* by an absolute name */
                snprintf(name, sizeof name, "%s/%s", in_folder("beside"), names[i]);
            if (kind == 2) { /* by a link in the folder */
                snprintf(name, sizeof name, "link%zu", i);
                snprintf(link, sizeof link, "closed/link%zu", i);
                assert_int_equal(symlink(target, in_folder(link)), 0);
            }
            write_text("closed/head.nhdr",
                       "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n"
                       "data file: %s\n",
                       name);
            struct sp_error err = { .code = SP_OK };
            const struct sp_load_options options = importer_options();
            assert_null(sp_volume_load(in_folder("closed/head.nhdr"), &options, &err));
            if (!*first)
                memcpy(first, err.text, sizeof first);
            assert_int_equal(err.code, SP_ERR_DENIED);
            assert_string_equal(err.text, first);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(data_files_outside_the_root_are_denied),
        cmocka_unit_test(what_exists_outside_the_root_stays_unknown),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
