/* SPDX-License-Identifier: Apache-2.0
 *
 * A search of the data folder: what it finds, what it leaves out, and its limits.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "protocol/text.h"
#include "render/data_search.h"

enum { HITS = 32 };

static char root[PATH_MAX], data[PATH_MAX];

static void path_of(const char *name, char path[PATH_MAX]) {
    assert_in_range(snprintf(path, PATH_MAX, "%s/%s", root, name), 1, PATH_MAX - 1);
}

static void write_file(const char *name, const void *bytes, size_t size) {
    char path[PATH_MAX];
    path_of(name, path);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    assert_int_equal(fwrite(bytes, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

static void write_text(const char *name) {
    write_file(name, "x", 1);
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
    static const char *const folders[] = {
        "data",
        "data/study",
        "data/study/ct",
        "data/study/.hidden",
        "outside",
        "data/series",
        "data/series/box",
        "data/series/x.zarr",
        "data/odd # & % ?",
        "data/bad\xff",
        "data/many",
        "data/series/x.zarr/brain",
    };
    static const char *const files[] = {
        "outside/brain.nrrd",
        "data/Brain.nrrd",
        "data/.brain.nrrd",
        "data/brain.txt",
        "data/study/ct/BRAIN 2.nii.gz",
        "data/study/.hidden/brain.nrrd",
        "data/series/t1.vti",
        "data/series/t2.vti",
        "data/series/t10.vti",
        "data/series/T10.vti",
        "data/series/box/b1.vti",
        "data/series/box/b2.vti",
        "data/series/box/b*.vti",
        "data/series/box/p1.png",
        "data/series/box/p2.png",
        "data/series/x.zarr/brain/brain.nrrd",
        "data/odd # & % ?/a*b? 100% #1 & Größe.nrrd",
        "data/odd # & % ?/gro\u0308\u00dfe.nrrd",
        "data/bad\xff/brain.nrrd",
        "data/bad\xff.brain.nrrd",
    };
    char dicom[140] = "";
    (void)state;
    char name[] = "/tmp/splatd-search-test-XXXXXX", *real;
    assert_non_null(mkdtemp(name));
    assert_non_null(real = realpath(name, NULL));
    snprintf(root, sizeof root, "%s", real);
    free(real);
    for (size_t i = 0; i < sizeof folders / sizeof *folders; i++)
        make_folder(folders[i]);
    for (size_t i = 0; i < sizeof files / sizeof *files; i++)
        write_text(files[i]);
    write_file("data/series/x.zarr/.zarray", "{\"zarr_format\": 2}", 18);
    memcpy(dicom + 128, "DICM", 4);
    for (int i = 0; i < 4; i++) {
        snprintf(name, sizeof name, "data/study/ct/IM%d", i);
        write_file(name, dicom, sizeof dicom);
    }
    write_text("data/study/ct/IM5"); /* no DICOM file */
    make_link("../outside", "data/out");
    make_link("../../study", "data/study/ct/loop");
    make_link("../Brain.nrrd", "data/study/brain-link.nrrd");
    make_link("../../outside/brain.nrrd", "data/study/brain-out.nrrd");
    path_of("data", data);
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    char command[PATH_MAX + 16];
    snprintf(command, sizeof command, "rm -r '%s'", root);
    return system(command);
}

static struct srv_data_hit hits[HITS];

static struct srv_data_search search_for(const char *path, const char *text, unsigned hits_max,
                                         unsigned names_max) {
    struct srv_data_search search = { .data = data,
                                      .text = text,
                                      .hits = hits,
                                      .hits_max = hits_max,
                                      .names_max = names_max,
                                      .end_ms = INFINITY };
    struct sp_error err = { .code = SP_OK };
    if (!srv_data_search(&search, path, &err))
        fail_msg("%s: %s", text, err.text);
    return search;
}

/* Compares the hits, "folder/name" or "folder/name=files", each followed by a '|'. */
static void finds(const char *path, const char *text, const char *expected) {
    char found[4096] = "";
    struct srv_data_search search = search_for(path, text, HITS, 1000);
    for (unsigned i = 0; i < search.count; i++) {
        const size_t used = strlen(found);
        const char *name = srv_data_name(&hits[i].entry);
        if (hits[i].files > 1)
            snprintf(found + used, sizeof found - used, "%s/%s=%u|", hits[i].folder, name,
                     hits[i].files);
        else
            snprintf(found + used, sizeof found - used, "%s/%s|", hits[i].folder, name);
    }
    srv_data_search_finish(&search);
    assert_string_equal(found, expected);
    assert_int_equal(search.cut, SRV_DATA_CUT_NONE);
}

static void names_are_found_below_a_folder(void **state) {
    (void)state;
    finds("", "brain", "/Brain.nrrd|study/brain-link.nrrd|study/ct/BRAIN 2.nii.gz|");
    finds("study", "bra 2", "study/ct/BRAIN 2.nii.gz|");
    finds("study///", "BRAIN 2", "study/ct/BRAIN 2.nii.gz|");
    finds("", "CT", "study/ct|");
    finds("", "zarr", "series/x.zarr|");
    finds("", "secret", "");
    struct srv_data_search search = search_for("", "brain", HITS, 1000);
    assert_int_equal(search.unlisted, 2); /* a folder and a file that are not UTF-8 */
    assert_int_equal(search.unread, 0);
    srv_data_search_finish(&search);
}

static void odd_names_are_found(void **state) {
    (void)state;
    static const char *const texts[] = { "*b", "b?", "100%", "#1", "gro\u0308ße 100" };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++)
        finds("", texts[i], "odd # & % ?/a*b? 100% #1 & Größe.nrrd|");
    finds("", "&", "/odd # & % ?|odd # & % ?/a*b? 100% #1 & Größe.nrrd|");
    finds("", "GRÖ", "odd # & % ?/a*b? 100% #1 & Größe.nrrd|odd # & % ?/gro\u0308\u00dfe.nrrd|");
}

static void files_that_open_together_are_one_hit(void **state) {
    (void)state;
    finds("", ".vti t",
          "series/T10.vti|series/t*.vti=3|series/box/b*.vti|series/box/b1.vti|"
          "series/box/b2.vti|");
    finds("series", "t1", "series/T10.vti|series/t1.vti|series/t10.vti|");
    finds("", "png", "series/box/p1.png|series/box/p2.png|");
    finds("", "im", "study/ct/IM0=4|");
    finds("", "im3", "study/ct/IM3|");
    finds("", "im5", "");
}

static void limits_cut_a_search(void **state) {
    (void)state;
    struct srv_data_search search = search_for("", "brain", 2, 1000);
    assert_int_equal(search.count, 2);
    assert_int_equal(search.cut, SRV_DATA_CUT_LIMIT);
    srv_data_search_finish(&search);
    search = search_for("", "brain", 3, 1000);
    assert_int_equal(search.cut, SRV_DATA_CUT_NONE);
    srv_data_search_finish(&search);
    search = search_for("study", "brain", HITS, 3);
    assert_int_equal(search.cut, SRV_DATA_CUT_NAMES);
    assert_int_equal(search.count, 1);
    srv_data_search_finish(&search);
    search = search_for("study/ct", "im", HITS, 2);
    assert_int_equal(search.cut, SRV_DATA_CUT_NAMES);
    srv_data_search_finish(&search);
    struct sp_error err;
    search = (struct srv_data_search){
        .data = data, .text = "brain", .hits = hits, .hits_max = HITS, .names_max = 1000
    };
    assert_true(srv_data_search(&search, "", &err)); /* its time is over */
    assert_int_equal(search.cut, SRV_DATA_CUT_TIME);
    assert_int_equal(search.count, 0);
    srv_data_search_finish(&search);
}

static void a_large_folder_is_searched(void **state) {
    (void)state;
    char name[64];
    for (int i = 0; i < 300; i++) {
        snprintf(name, sizeof name, "data/many/scan%d.vtk", i);
        write_text(name);
    }
    finds("", "scan", "many/scan*.vtk=300|");
    finds("many", "scan29.", "many/scan29.vtk|");
    struct srv_data_search search = search_for("many", "scan1", HITS, 1000);
    assert_int_equal(search.count, HITS);
    assert_int_equal(search.cut, SRV_DATA_CUT_LIMIT);
    assert_string_equal(srv_data_name(&hits[1].entry), "scan10.vtk");
    srv_data_search_finish(&search);
}

static void wrong_searches_are_refused(void **state) {
    (void)state;
    char long_text[512], most[2 * 255 + 1] = "";
    memset(long_text, 'x', 256);
    long_text[256] = 0;
    const struct {
        const char *path, *text;
        enum sp_code code;
        const char *place;
    } cases[] = { { "", "", SP_ERR_INVALID, "/find" },
                  { "", "  ", SP_ERR_INVALID, "/find" },
                  { "", long_text, SP_ERR_INVALID, "/find" },
                  { "Brain.nrrd", "x", SP_ERR_INVALID, "/path" },
                  { "absent", "x", SP_ERR_NOT_FOUND, "/path" },
                  { "out", "x", SP_ERR_NOT_FOUND, "/path" },
                  { "..", "x", SP_ERR_NOT_FOUND, "/path" },
                  { "/", "x", SP_ERR_INVALID, "/path" } };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct srv_data_search search = { .data = data,
                                          .text = cases[i].text,
                                          .hits = hits,
                                          .hits_max = HITS,
                                          .names_max = 1000,
                                          .end_ms = INFINITY };
        struct sp_error err = { .code = SP_OK };
        assert_false(srv_data_search(&search, cases[i].path, &err));
        assert_int_equal(err.code, cases[i].code);
        assert_string_equal(err.place, cases[i].place);
        srv_data_search_finish(&search);
    }
    for (int i = 0; i < 255; i++)
        strcat(most, "ä");
    finds("", most, "");
}

static void texts_are_folded(void **state) {
    (void)state;
    static const char *const cases[][2] = {
        { "GRO\u0308SSE", "grosse" }, { "Grösse", "grosse" },     { "Łódź × Œ", "łodz × œ" },
        { "ΑΒΓ Жук", "αβγ жук" },     { "頭 𝔸", "頭 𝔸" },         { "A\xff\xc3", "a\xff\xc3" },
        { "İŸ\u1e9e", "iy\u1e9e" },   { "\xe2\x82", "\xe2\x82" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[64];
        snprintf(text, sizeof text, "%s", cases[i][0]);
        proto_text_fold(text);
        assert_string_equal(text, cases[i][1]);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(names_are_found_below_a_folder),
        cmocka_unit_test(odd_names_are_found),
        cmocka_unit_test(files_that_open_together_are_one_hit),
        cmocka_unit_test(limits_cut_a_search),
        cmocka_unit_test(a_large_folder_is_searched),
        cmocka_unit_test(wrong_searches_are_refused),
        cmocka_unit_test(texts_are_folded),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
