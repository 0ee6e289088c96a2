/* SPDX-License-Identifier: Apache-2.0
 *
 * Paths of clients, listings of the data folder, ids and names of volumes, and what the first bytes
 * of files say.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "render/data_folder.h"
#include "render/formats.h"
#include "render/source.h"

static char root[PATH_MAX], data[PATH_MAX];

static void path_of(const char *name, char path[PATH_MAX]) {
    assert_in_range(snprintf(path, PATH_MAX, "%s/%s", root, name), 1, PATH_MAX - 1);
}

static void write_file(const char *name, const char *text) {
    char path[PATH_MAX];
    path_of(name, path);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    assert_int_equal(fclose(file), 0);
}

static void make_folder(const char *name) {
    char path[PATH_MAX];
    path_of(name, path);
    assert_int_equal(mkdir(path, 0700), 0);
}

static void make_link(const char *to, const char *name) {
    char path[PATH_MAX];
    path_of(name, path);
    assert_int_equal(symlink(to, path), 0);
}

static int set_up(void **state) {
    (void)state;
    char name[] = "/tmp/splatd-data-test-XXXXXX", *real;
    assert_non_null(mkdtemp(name));
    assert_non_null(real = realpath(name, NULL));
    snprintf(root, sizeof root, "%s", real);
    free(real);
    make_folder("data");
    make_folder("data/scans");
    make_folder("data/.hidden");
    make_folder("outside");
    write_file("outside/secret.nrrd", "NRRD0004\n");
    write_file("data/a.nrrd", "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 5 6\n\nxxxx");
    write_file("data/scans/b.vti",
               "<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"0 9 0 19 -1 2\">");
    write_file("data/notes.txt", "no volume");
    write_file("data/samples.raw", "no volume");
    write_file("data/.hidden.nrrd", "NRRD0004\n");
    write_file("data/bad\xff.nrrd", "NRRD0004\n");
    write_file("data/bad\xff.txt", "no volume");
    make_folder("data/bad\xff");
    make_link("../outside", "data/out");
    make_link("../outside/secret.nrrd", "data/link.nrrd");
    make_link("absent.nrrd", "data/dangling.nrrd");
    make_link("loop.nrrd", "data/loop.nrrd");
    make_link("a.nrrd", "data/same.nrrd");
    make_link("scans", "data/alias");
    path_of("data", data);
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    char command[PATH_MAX + 16];
    snprintf(command, sizeof command, "rm -r '%s'", root);
    return system(command);
}

static void resolves_to(const char *path, const char *expected) {
    char real[PATH_MAX], full[PATH_MAX];
    struct sp_error err = { .code = SP_OK };
    assert_true(srv_data_resolve(data, path, "/path", real, &err));
    path_of(expected, full);
    assert_string_equal(real, full);
}

static void is_refused(const char *path, enum sp_code code, const char *text) {
    char real[PATH_MAX];
    struct sp_error err = { .code = SP_OK };
    assert_false(srv_data_resolve(data, path, "/source", real, &err));
    assert_int_equal(err.code, code);
    assert_string_equal(err.place, "/source");
    if (!strstr(err.text, text))
        fail_msg("%s: '%s' does not say '%s'", path, err.text, text);
}

static void paths_stay_in_the_folder(void **state) {
    (void)state;
    char absolute[PATH_MAX], long_path[PATH_MAX + 8];
    resolves_to("a.nrrd", "data/a.nrrd");
    resolves_to("same.nrrd", "data/a.nrrd");
    resolves_to("alias//b.vti", "data/scans/b.vti");
    resolves_to("scans/../a.nrrd", "data/a.nrrd");
    resolves_to("", "data");
    path_of("data/a.nrrd", absolute);
    resolves_to(absolute, "data/a.nrrd");
    is_refused("absent.nrrd", SP_ERR_NOT_FOUND, "no such file");
    is_refused("../outside/secret.nrrd", SP_ERR_NOT_FOUND, "no such file");
    is_refused("../data/a.nrrd", SP_ERR_NOT_FOUND, "no such file");
    is_refused("/etc/passwd", SP_ERR_NOT_FOUND, "no such file");
    is_refused("dangling.nrrd", SP_ERR_NOT_FOUND, "leads out of the data folder or to nothing");
    is_refused("link.nrrd", SP_ERR_NOT_FOUND, "'link.nrrd' is a symbolic link that leads out");
    /* The same answer whether the rest exists or not. */
    is_refused("out/secret.nrrd", SP_ERR_NOT_FOUND, "'out' is a symbolic link that leads out");
    is_refused("out/absent.nrrd", SP_ERR_NOT_FOUND, "'out' is a symbolic link that leads out");
    path_of("database", absolute); /* begins like the folder */
    is_refused(absolute, SP_ERR_NOT_FOUND, "no such file");
    memset(long_path, 'x', sizeof long_path - 1);
    long_path[sizeof long_path - 1] = 0;
    is_refused(long_path, SP_ERR_INVALID, "more than 4095 bytes");
    long_path[300] = 0;
    is_refused(long_path, SP_ERR_INVALID, "a name of it more than 255");
    char real[PATH_MAX];
    struct sp_error err;
    assert_false(srv_data_resolve(NULL, "a.nrrd", "/path", real, &err));
    assert_int_equal(err.code, SP_ERR_DENIED);
}

static unsigned list(const char *path, const char *after, unsigned max,
                     struct srv_data_entry *entries) {
    struct sp_error err = { .code = SP_OK };
    struct srv_page page = {
        .items = entries, .item_bytes = sizeof *entries, .max = max, .after = after
    };
    unsigned unlisted;
    if (!srv_data_list(data, path, &page, &unlisted, &err))
        fail_msg("%s: %s", path, err.text);
    assert_int_equal(unlisted, path[0] ? 0 : 2); /* bad\xff and bad\xff.nrrd */
    return page.count;
}

static void a_folder_is_listed(void **state) {
    (void)state;
    static const char *const keys[] = { "/alias", "/scans", ":a.nrrd", ":same.nrrd" };
    struct srv_data_entry entries[8];
    assert_int_equal(list("", "", 8, entries), 4);
    for (unsigned i = 0; i < 4; i++)
        assert_string_equal(entries[i].key, keys[i]);
    assert_true(entries[0].is_folder);
    assert_false(entries[2].is_folder);
    assert_int_equal(entries[2].size_bytes, 52);
    assert_string_equal(entries[2].format, "NRRD");
    srv_data_describe(data, "", &entries[2]);
    assert_int_equal(entries[2].dims[2], 6);
    assert_string_equal(entries[2].type, "int16");
    assert_int_equal(list("", ":a.nrrd", 8, entries), 1); /* the next page */
    assert_int_equal(list("alias", "", 8, entries), 1);
    srv_data_describe(data, "alias", &entries[0]);
    assert_int_equal(entries[0].dims[0], 10);
    assert_int_equal(entries[0].dims[2], 4);
}

static void a_zarr_folder_is_a_volume(void **state) {
    (void)state;
    struct srv_data_entry entries[4];
    make_folder("data/scans/brain.ome.zarr");
    make_folder("data/scans/array");
    make_folder("data/scans/plate.zarr");
    write_file("data/scans/brain.ome.zarr/zarr.json", "{\"ome\": {\"multiscales\": []}}");
    write_file("data/scans/array/.zarray", "{\"zarr_format\": 2}");
    write_file("data/scans/plate.zarr/.zattrs", "{\"plate\": {}}");
    assert_int_equal(list("scans", "", 4, entries), 4);
    assert_string_equal(entries[0].key, "/plate.zarr"); /* its images are volumes */
    assert_string_equal(entries[1].key, ":array");
    assert_string_equal(entries[3].key, ":brain.ome.zarr");
    assert_true(entries[3].is_zarr);
    assert_string_equal(entries[3].format, "Zarr");
    srv_data_describe(data, "scans", &entries[3]);
    assert_int_equal(entries[3].kind, SP_KIND_GRID);
}

#define LINK(name)                                                                                 \
    "'" name "' is a symbolic link that leads out of the data folder or to nothing; only what "    \
    "lies below the data folder can be opened"

/* Whether the target exists, is a file or a folder, and may be read. */
static void a_link_tells_nothing_about_its_target(void **state) {
    (void)state;
    char long_target[NAME_MAX + 8] = "";
    memset(long_target, 'x', NAME_MAX + 1);
    const char *targets[] = { "/",  "/etc/passwd", "/absent", "/etc/passwd/x", "../absent",
                              "..", "link",        "absent",  long_target };
    char path[PATH_MAX + 8], real[PATH_MAX];
    snprintf(path, sizeof path, "%s/link", data);
    for (size_t i = 0; i < sizeof targets / sizeof *targets; i++) {
        struct sp_error err = { .code = SP_OK };
        assert_int_equal(symlink(targets[i], path), 0);
        assert_false(srv_data_resolve(data, "link", "/path", real, &err));
        assert_int_equal(err.code, SP_ERR_NOT_FOUND);
        assert_string_equal(err.text, LINK("link"));
        assert_false(srv_data_resolve(data, "link/below", "/path", real, &err));
        assert_int_equal(err.code, SP_ERR_NOT_FOUND);
        assert_string_equal(err.text, LINK("link"));
        unlink(path);
    }
}

static void what_is_no_folder_is_not_listed(void **state) {
    (void)state;
    static const struct {
        const char *path;
        enum sp_code code;
        const char *text;
    } cases[] = { { "a.nrrd", SP_ERR_INVALID, "is a file, not a folder" },
                  { "absent", SP_ERR_NOT_FOUND, "there is no such folder below the data folder" },
                  { "out", SP_ERR_NOT_FOUND, LINK("out") },
                  { "loop.nrrd", SP_ERR_NOT_FOUND, LINK("loop.nrrd") },
                  { data, SP_ERR_INVALID,
                    "must be relative to the data folder, without a slash at its beginning" },
                  { "..", SP_ERR_NOT_FOUND, "there is no such folder below the data folder" } };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct srv_data_entry entries[2];
        struct srv_page page = {
            .items = entries, .item_bytes = sizeof *entries, .max = 2, .after = ""
        };
        struct sp_error err = { .code = SP_OK };
        unsigned unlisted;
        assert_false(srv_data_list(data, cases[i].path, &page, &unlisted, &err));
        assert_int_equal(err.code, cases[i].code);
        assert_string_equal(err.text, cases[i].text);
        assert_string_equal(err.place, "/path");
    }
}

static void files_say_what_they_are(void **state) {
    (void)state;
    static const struct {
        const char *name, *text;
        unsigned dims[3];
        const char *type;
    } cases[] = {
        { "a.nrrd",
          "NRRD0005\r\ndimension: 3\r\nsizes: 1 2 3\r\ntype: unsigned char\r\n\r\n",
          { 1, 2, 3 },
          "uint8" },
        { "A.NHDR",
          "NRRD0001\n# c\ntype: float\ndimension: 3\nsizes: 512 512 100\n",
          { 512, 512, 100 },
          "float32" },
        { "a.nrrd", "NRRD0001\n\nsizes: 1 2 3\n", { 0 }, "" },
        { "a.nrrd", "NRRD0001\ndimension: 3\nsizes: 1 2\n", { 0 }, "" },
        { "a.nrrd", "NRRD0001\ndimension: 4\nsizes: 3 4 5 6\n", { 0 }, "" },
        { "a.nrrd", "NRRD0001\ndimension: 3\nsizes: 1 2 99999999999\n", { 0 }, "" },
        { "a.nrrd", "NRRD0001\ndimension: 3\nsizes: 1 -2 3\n", { 0 }, "" },
        { "a.nrrd", "PNG", { 0 }, "" },
        { "a.vtk",
          "# vtk DataFile Version 3.0\nx\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 7 8 9\n"
          "POINT_DATA 504\nSCALARS d unsigned_char\n",
          { 7, 8, 9 },
          "uint8" },
        { "a.vti", "<ImageData WholeExtent=\"0 1 0 2 0 3\">", { 2, 3, 4 }, "" },
        { "a.vti", "<ImageData WholeExtent=\"5 1 0 2 0 3\">", { 0 }, "" },
        { "a.json", "{\"dims\":[3,2,1],\"type\":\"int16\"}", { 3, 2, 1 }, "int16" },
        { "a.json", "{\"dims\":[3,2],\"type\":\"int16\"}", { 0 }, "" },
        { "a.json", "{\"name\":1}", { 0 }, "" },
        { "a.mhd",
          "NDims = 3\nDimSize = 6 5 4\nElementType = MET_USHORT\nElementDataFile = a\n",
          { 6, 5, 4 },
          "uint16" },
        { "a.tif", "II*", { 0 }, "" },
        { "a.txt", "NRRD0001\nsizes: 1 2 3\n", { 0 }, "" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct srv_format_peek peek;
        srv_format_look(cases[i].name, cases[i].text, strlen(cases[i].text), &peek);
        for (int axis = 0; axis < 3; axis++)
            assert_int_equal(peek.dims[axis], cases[i].dims[axis]);
        assert_string_equal(peek.type, cases[i].type);
    }
    static const struct {
        const char *name, *text;
        enum sp_kind kind;
    } kinds[] = {
        { "a.nrrd", "", SP_KIND_GRID },
        { "a.csv", "x,y,z\n", SP_KIND_POINTS },
        { "a.vtk", "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\n", SP_KIND_POINTS },
        { "a.vtk", "# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_GRID\n",
          SP_KIND_POINTS },
        { "a.vtk", "# vtk DataFile Version 3.0\nx\nASCII\nDATASET RECTILINEAR_GRID\n",
          SP_KIND_GRID },
        { "a.vtk", "# vtk", SP_KIND_COUNT },
        { "a.ply", "ply\nformat ascii 1.0\nelement vertex 3\nelement face 1\n", SP_KIND_MESH },
        { "a.ply", "ply\nelement vertex 3\nproperty float x\nelement face 0\n", SP_KIND_POINTS },
        { "a.ply", "ply\nelement vertex 3\nproperty float f_dc_0\n", SP_KIND_GAUSSIANS },
        { "a.ply", "ply\nelement chunk 1\nelement vertex 3\nproperty uint packed_position\n",
          SP_KIND_GAUSSIANS },
        { "a.ply", "obj", SP_KIND_COUNT },
        { "a.glb", "glTF", SP_KIND_MESH },
        { "a.txt", "", SP_KIND_COUNT },
    };
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        struct srv_format_peek peek;
        srv_format_look(kinds[i].name, kinds[i].text, strlen(kinds[i].text), &peek);
        assert_int_equal(peek.kind, kinds[i].kind);
    }
    assert_string_equal(srv_format_extension("/x/A.TIFF"), ".tiff");
    assert_string_equal(srv_format_extension("brain.nii.gz"), ".nii.gz");
    char list[SRV_FORMAT_LIST];
    srv_format_list(list);
    assert_ptr_equal(strstr(list, ".nrrd, .nhdr, "), list);
    assert_non_null(strstr(list, " or ."));
    assert_null(srv_format_of(".nrrd"));
    assert_null(srv_format_of("nrrd"));
}

static void ids_are_readable(void **state) {
    (void)state;
    static const struct {
        const char *source, *id, *name;
    } cases[] = {
        { "/d/größe.nrrd", "groesse", "größe" },
        { "/d/gro\u0308ße.nrrd", "grosse", "gro\u0308ße" },
        { "/d/x.nii.gz", "x", "x" },
        { "/d/x.nrrd.GZ", "x", "x" },
        { "/d/v1.2.nrrd", "v1.2", "v1.2" },
        { "/d/Łódź, Žižkov – Øre.vti", "Lodz-Zizkov-Oere", "Łódź, Žižkov – Øre" },
        { "/d/head (final).tif", "head-final", "head (final)" },
        { "/d/头部.nrrd", "volume", "头部" },
        { "/d/CT 头 3.nrrd", "CT-3", "CT 头 3" },
        { "/d/.nrrd", ".nrrd", ".nrrd" },
        { "/d/..nrrd", "volume", "." },
        { "/d/bad\xff\xc3.nrrd", "bad", "bad\xff\xc3" },
        { "demo:engine?size=8", "engine", "engine" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char id[SP_NAME_BYTES], name[SP_NAME_BYTES];
        srv_source_default_id(cases[i].source, id);
        assert_string_equal(id, cases[i].id);
        srv_source_default_name(cases[i].source, name);
        assert_string_equal(name, cases[i].name);
    }
    /* A long name is cut between two characters. */
    char source[600] = "/d/", id[SP_NAME_BYTES], name[SP_NAME_BYTES];
    for (int i = 0; i < 200; i++)
        strcat(source, "ä");
    srv_source_default_id(source, id);
    assert_int_equal(strlen(id), SP_NAME_BYTES - 8);
    srv_source_default_name(source, name);
    assert_int_equal(strlen(name) % 2, 0);
    assert_in_range(strlen(name), SP_NAME_BYTES - 6, SP_NAME_BYTES - 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(paths_stay_in_the_folder),
        cmocka_unit_test(a_folder_is_listed),
        cmocka_unit_test(a_link_tells_nothing_about_its_target),
        cmocka_unit_test(what_is_no_folder_is_not_listed),
        cmocka_unit_test(files_say_what_they_are),
        cmocka_unit_test(ids_are_readable),
        cmocka_unit_test(a_zarr_folder_is_a_volume),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
