/* SPDX-License-Identifier: Apache-2.0
 *
 * Archives of frames: libarchive can read them, and a cancelled archive frees its memory.
 */
#include <malloc.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <archive.h>
#include <archive_entry.h>
#include <cmocka.h>

#include "paths/archive.h"
#include "support/compare.h"

#define ID "0123456789abcdef0123456789abcdef"
enum { FRAMES = 3, FRAME_BYTES = 200000, ALL_BYTES = FRAMES * (FRAME_BYTES + 1024) + 1024 };

struct fixture {
    struct srv_folder folder;
    char parent[32];
    char frame[FRAME_BYTES];
};

static int set_up(void **state) {
    struct fixture *f = calloc(1, sizeof *f);
    strcpy(f->parent, "/tmp/splatd-archive-XXXXXX");
    if (!mkdtemp(f->parent) || !srv_folder_open(&f->folder, f->parent, NULL))
        return -1;
    for (int i = 0; i < FRAMES; i++) {
        char name[16];
        snprintf(name, sizeof name, "%06d.png", i);
        memset(f->frame, 'a' + i, sizeof f->frame);
        if (!srv_folder_write(&f->folder, ID, name, "", 0, f->frame, sizeof f->frame, NULL))
            return -1;
    }
    *state = f;
    return 0;
}

static int tear_down(void **state) {
    struct fixture *f = *state;
    srv_folder_remove(&f->folder, ID, NULL);
    rmdir(f->folder.root);
    srv_folder_close(&f->folder);
    rmdir(f->parent);
    free(f);
    return 0;
}

static void an_archive_has_all_frames(void **state) {
    struct fixture *f = *state;
    char *bytes = malloc(ALL_BYTES), *read = malloc(FRAME_BYTES);
    size_t size = 0;
    ssize_t n;
    struct srv_archive *a = srv_archive_create(&f->folder, ID, ".png", FRAMES, true, NULL);
    assert_non_null(a);
    while ((n = srv_archive_read(a, bytes + size, ALL_BYTES - size)) > 0)
        size += (size_t)n;
    assert_int_equal(n, 0);
    srv_archive_destroy(&a);
    struct archive *tar = archive_read_new();
    struct archive_entry *entry;
    archive_read_support_format_tar(tar);
    assert_int_equal(archive_read_open_memory(tar, bytes, size), ARCHIVE_OK);
    for (int i = 0; i < FRAMES; i++) {
        char name[16];
        snprintf(name, sizeof name, "%06d.png", i);
        memset(f->frame, 'a' + i, sizeof f->frame);
        assert_int_equal(archive_read_next_header(tar, &entry), ARCHIVE_OK);
        assert_string_equal(archive_entry_pathname(entry), name);
        assert_int_equal(archive_entry_size(entry), FRAME_BYTES);
        assert_int_equal(archive_read_data(tar, read, FRAME_BYTES), FRAME_BYTES);
        assert_memory_equal(read, f->frame, FRAME_BYTES);
    }
    assert_int_equal(archive_read_next_header(tar, &entry), ARCHIVE_EOF);
    archive_read_free(tar);
    free(read);
    free(bytes);
}

/* Uses the statistics of the C library, because the memory of libarchive has no counter of its own.
 */
static void a_cancelled_archive_frees_everything(void **state) {
    const struct fixture *f = *state;
    enum { TRIES = 1000 };
    char bytes[1000];
    size_t before = 0;
    for (int i = 0; i < 2 * TRIES; i++) {
        if (i == TRIES)
            before = mallinfo2().uordblks;
        struct srv_archive *a = srv_archive_create(&f->folder, ID, ".png", FRAMES, true, NULL);
        assert_non_null(a);
        /* Before the first byte, in a header and in a frame. */
        for (int part = 0; part < i % 3; part++)
            assert_compare(srv_archive_read(a, bytes, sizeof bytes), >, 0);
        srv_archive_destroy(&a);
        assert_null(a);
    }
    assert_compare(mallinfo2().uordblks, <, before + TRIES);
}

/* A missing frame ends the archive with an error. */
static void a_missing_frame_is_an_error(void **state) {
    struct fixture *f = *state;
    char *bytes = malloc(ALL_BYTES);
    ssize_t n;
    struct srv_archive *a = srv_archive_create(&f->folder, ID, ".png", FRAMES + 1, true, NULL);
    assert_non_null(a);
    size_t size = 0;
    while ((n = srv_archive_read(a, bytes, ALL_BYTES)) > 0)
        size += (size_t)n;
    assert_int_equal(n, -1);
    assert_compare(size, >=, FRAMES * FRAME_BYTES);
    srv_archive_destroy(&a);
    free(bytes);
}

/* A frame that is cut off is never a part of an archive. */
static void a_damaged_frame_is_an_error(void **state) {
    struct fixture *f = *state;
    char *bytes = malloc(ALL_BYTES), path[SRV_FILE_BYTES];
    ssize_t n;
    srv_folder_path(&f->folder, ID, "000001.png", path);
    assert_int_equal(truncate(path, FRAME_BYTES), 0); /* its seal is lost */
    struct srv_archive *a = srv_archive_create(&f->folder, ID, ".png", FRAMES, true, NULL);
    assert_non_null(a);
    size_t size = 0;
    while ((n = srv_archive_read(a, bytes, ALL_BYTES)) > 0)
        size += (size_t)n;
    assert_int_equal(n, -1);
    assert_compare(size, <, 2 * FRAME_BYTES);
    srv_archive_destroy(&a);
    free(bytes);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(an_archive_has_all_frames, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_cancelled_archive_frees_everything, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_missing_frame_is_an_error, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_damaged_frame_is_an_error, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
