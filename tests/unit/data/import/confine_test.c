/* SPDX-License-Identifier: Apache-2.0
 *
 * Files that a header names: only files below the root are opened, and errors reveal nothing about
 * other files.
 */
#include "data/import/confine.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "unit/data/import/support.h"

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

/* An error about a file outside of the root does not reveal whether the file exists. */
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

static uint32_t random_state;

static uint32_t draw(uint32_t below) {
    random_state = random_state * 1664525u + 1013904223u;
    return (uint32_t)(((uint64_t)(random_state >> 8) * below) >> 24);
}

/* Writes up to `most` names, some of them "..". */
static void draw_path(char *path, size_t size, uint32_t most) {
    static const char *const parts[] = { "a", "b", "c", "d", "a", "b", "..", ".", "root", "out" };
    size_t used = 0;
    path[0] = 0;
    for (uint32_t i = 1 + draw(most); i > 0; i--)
        used += (size_t)snprintf(path + used, size - used, "%s%s", used ? "/" : "",
                                 parts[draw(sizeof parts / sizeof *parts)]);
}

/* Fills a folder "root" with folders, files and links, and a folder "out" beside it without
 * links. */
static void make_tree(const char *top) {
    char path[600], target[600];
    for (int i = 0; i < 40; i++) {
        char name[128];
        draw_path(name, sizeof name, 3);
        snprintf(path, sizeof path, "%s/%s/%s", top, i % 5 ? "root" : "out", name);
        const uint32_t kind = draw(i < 12 ? 2 : 4);
        if (kind == 0 || i < 6) {
            mkdir(path, 0700);
        } else if (kind == 1) {
            FILE *file = fopen(path, "wxe");
            if (file)
                fclose(file);
        } else if (i % 5) {
            draw_path(name, sizeof name, 4);
            snprintf(target, sizeof target, "%s%s%s", kind == 2 ? "" : top,
                     kind == 2 ? "" : "/root/", name);
            if (symlink(target, path) != 0)
                continue;
        }
    }
}

/* A path that realpath() resolves to a file below the root opens this file; a path that it resolves
 * to another place is denied. */
static void paths_lead_where_realpath_does(void **state) {
    (void)state;
    unsigned opened = 0, denied = 0;
    for (uint32_t tree = 0; tree < 12; tree++) {
        char name[16], top[256], root[300], path[600];
        random_state = tree;
        snprintf(name, sizeof name, "tree%u", tree);
        assert_int_equal(mkdir(in_folder(name), 0700), 0);
        assert_non_null(realpath(in_folder(name), top));
        snprintf(root, sizeof root, "%s/root", top);
        assert_int_equal(mkdir(root, 0700), 0);
        snprintf(path, sizeof path, "%s/out", top);
        assert_int_equal(mkdir(path, 0700), 0);
        make_tree(top);
        for (int i = 0; i < 400; i++) {
            char wanted[PATH_MAX], real[PATH_MAX], asked[256];
            uint64_t size;
            struct sp_error err = { .code = SP_OK };
            draw_path(asked, sizeof asked, 6);
            snprintf(path, sizeof path, "%s/%s", root, asked);
            const bool exists = realpath(path, wanted) != NULL;
            int fd = sp_open_confined_folder(root, path, path, real, &err);
            if (fd < 0 && err.code == SP_ERR_INVALID)
                fd = sp_open_confined(root, path, path, real, &size, &err);
            const bool is_inside =
                exists && (strcmp(root, wanted) == 0 || sp_is_below(root, wanted));
            if (is_inside && (fd < 0 || strcmp(real, wanted) != 0))
                fail_msg("tree %u: %s: %s, not %s (%s)", tree, path, fd < 0 ? "-" : real, wanted,
                         err.text);
            if (fd >= 0 && strcmp(root, real) != 0)
                assert_true(sp_is_below(root, real));
            if (exists && !is_inside) {
                assert_int_equal(fd, -1);
                assert_int_equal(err.code, SP_ERR_DENIED);
            }
            opened += is_inside;
            denied += exists && !is_inside;
            if (fd >= 0)
                close(fd);
        }
    }
    assert_compare(opened, >, 200);
    assert_compare(denied, >, 100);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(data_files_outside_the_root_are_denied),
        cmocka_unit_test(what_exists_outside_the_root_stays_unknown),
        cmocka_unit_test(paths_lead_where_realpath_does),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
