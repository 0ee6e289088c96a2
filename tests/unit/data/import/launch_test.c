/* SPDX-License-Identifier: Apache-2.0
 *
 * Loading a volume from sources that are not regular files and from an importer that misbehaves.
 */
#include <dirent.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/clock.h"
#include "unit/data/import/support.h"

static int open_descriptors(void) {
    DIR *folder = opendir("/proc/self/fd");
    int count = 0;
    assert_non_null(folder);
    while (readdir(folder))
        count++;
    closedir(folder);
    return count;
}

static void assert_no_children(void) {
    assert_int_equal(waitpid(-1, NULL, WNOHANG), -1);
}

static struct sp_volume *load_hostile(const char *what, int timeout_ms, struct sp_error *err) {
    struct sp_load_options options = { .importer = SPLATD_TEST_DIR "/hostile_importer",
                                       .timeout_ms = timeout_ms };
    write_text(what, "nothing of interest");
    memset(err, 0, sizeof *err);
    return sp_volume_load(in_folder(what), &options, err);
}

static void misbehaving_importers_are_errors(void **state) {
    (void)state;
    static const struct {
        const char *what;
        enum sp_code code;
        const char *text;
    } cases[] = {
        { "abort", SP_ERR_CRASHED, "killed by signal 6 (SIGABRT)" },
        { "segv", SP_ERR_CRASHED, "killed by signal 11 (SIGSEGV)" },
        { "quit", SP_ERR_CRASHED, "exited with status 7 and without a result" },
        { "rubbish", SP_ERR_CRASHED, "a message of the import process starts with" },
        { "short", SP_ERR_CRASHED, "a message of 1 bytes" },
        { "long", SP_ERR_CRASHED, "a message of" },
        { "done-first", SP_ERR_CRASHED, "message 3 out of order" },
        { "progress-first", SP_ERR_CRASHED, "message 2 out of order" },
        { "closed", SP_ERR_CRASHED, "killed by signal 9" },
        { "error-code", SP_ERR_CRASHED, "failed with code 999" },
        { "error-ok", SP_ERR_CRASHED, "failed with code 0" },
        { "error-endless", SP_ERR_CRASHED, "error message that is not terminated" },
        { "error-escape", SP_ERR_FORMAT, "bad??[2Jfile" },
        { "version", SP_ERR_CRASHED, "version 77 of the handover and this program version 15" },
        { "magic", SP_ERR_CRASHED, "starts with 00000000" },
        { "type", SP_ERR_CRASHED, "sample type 12" },
        { "zero", SP_ERR_CRASHED, "dims[1] is 0" },
        { "huge", SP_ERR_CRASHED, "dims[0] is 4294967295" },
        { "wrap", SP_ERR_CRASHED, "voxels" },
        { "bytes-more", SP_ERR_CRASHED, "a size of 513 bytes; its grid needs 512" },
        { "bytes-less", SP_ERR_CRASHED, "a size of 1 bytes; its grid needs 512" },
        { "spacing", SP_ERR_CRASHED, "spacing[2]" },
        { "origin", SP_ERR_CRASHED, "origin[0]" },
        { "direction", SP_ERR_CRASHED, "length 0" },
        { "axes", SP_ERR_CRASHED, "axes of an unknown kind" },
        { "anatomy", SP_ERR_CRASHED, "unknown anatomical directions" },
        { "vertical", SP_ERR_CRASHED, "a vertical axis without a scale" },
        { "vertical unit", SP_ERR_CRASHED, "a unit that is not terminated" },
        { "unit", SP_ERR_CRASHED, "unit that is not terminated" },
        { "name", SP_ERR_CRASHED, "name that is not terminated" },
        { "vectors", SP_ERR_CRASHED, "vectors of an unknown kind" },
        { "colors", SP_ERR_CRASHED, "colours of an unknown kind" },
        { "kind", SP_ERR_CRASHED, "elements of an unknown kind" },
        { "degree", SP_ERR_CRASHED, "spherical harmonics of an unknown degree" },
        { "elements", SP_ERR_CRASHED, "elements on a grid" },
        { "coordinates-fall", SP_ERR_CRASHED, "coordinates[1]: the step from" },
        { "coordinates-nan", SP_ERR_CRASHED, "coordinates[1]: the step from" },
        { "coordinates-none", SP_ERR_CRASHED, "bad grid: coordinates[1]: the step from" },
        { "abort-late", SP_ERR_CRASHED, "killed by signal 6 (SIGABRT)" },
        { "quit-late", SP_ERR_CRASHED, "exited with status 5" },
        { "header-again", SP_ERR_CRASHED, "message 1 out of order" },
        { "after-done", SP_ERR_CRASHED, "message 3 out of order" },
        { "warning", SP_ERR_CRASHED, "a warning that is not terminated" },
        { "status", SP_ERR_CRASHED, "failed after its last message" },
        { "keeper", SP_ERR_CRASHED, "still maps the samples" },
    };
    int before = open_descriptors();
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct sp_error err;
        assert_null(load_hostile(cases[i].what, 60000, &err));
        if (err.code != cases[i].code || !strstr(err.text, cases[i].text))
            fail_msg("%s: %s: %s", cases[i].what, sp_code_name(err.code), err.text);
        if (!strstr(err.place, cases[i].what))
            fail_msg("%s: the place of the error is %s", cases[i].what, err.place);
        assert_no_children();
    }
    assert_int_equal(open_descriptors(), before);
}

static void importers_that_do_not_end_are_stopped(void **state) {
    (void)state;
    static const char *const behaviours[] = { "hang", "spin", "hang-late", "hang-done" };
    for (size_t i = 0; i < sizeof behaviours / sizeof behaviours[0]; i++) {
        struct sp_error err;
        assert_null(load_hostile(behaviours[i], 200, &err));
        assert_int_equal(err.code, SP_ERR_TIMEOUT);
        assert_non_null(strstr(err.text, "timeout of 200 ms"));
        assert_no_children();
    }
}

/* An importer may send many progress messages with values beyond the end, and it may try to change
 * the sealed size. Neither prevents loading. */
static void odd_but_harmless_importers_can_load(void **state) {
    (void)state;
    static const char *const behaviours[] = { "good", "flood", "truncate", "coordinates" };
    for (size_t i = 0; i < sizeof behaviours / sizeof behaviours[0]; i++) {
        struct sp_error err;
        struct sp_volume *volume = load_hostile(behaviours[i], 60000, &err);
        if (!volume)
            fail_msg("%s: %s", behaviours[i], err.text);
        assert_int_equal(sp_volume_info(volume)->voxel_bytes, 512);
        assert_compare(sp_volume_info(volume)->range[0], ==, 42);
        assert_int_equal(((const uint8_t *)sp_volume_voxels(volume))[511], 42);
        const double *c = sp_volume_info(volume)->grid.coordinates[1];
        assert_int_equal(c != NULL, strcmp(behaviours[i], "coordinates") == 0);
        if (c) {
            assert_compare(c[1], ==, 0.5);
            assert_compare(c[3], ==, 1.5);
            assert_compare(c[7], ==, 7);
        }
        sp_volume_unref(&volume);
        assert_no_children();
    }
}

/* Sources that are not regular files or have no known format. */

static void unreadable_sources_are_refused_without_blocking(void **state) {
    (void)state;
    assert_int_equal(mkfifo(in_folder("pipe.nrrd"), 0600), 0);
    load_error("pipe.nrrd", SP_ERR_INVALID, "pipe.nrrd", "is a pipe, not a regular file");
    assert_int_equal(mkdir(in_folder("folder.nrrd"), 0700), 0);
    load_error("folder.nrrd", SP_ERR_NOT_FOUND, "folder.nrrd", "there is no file in this folder");
    assert_int_equal(symlink("/dev/zero", in_folder("zero.nrrd")), 0);
    load_error("zero.nrrd", SP_ERR_INVALID, "zero.nrrd", "is a character device");
    struct sockaddr_un address = { .sun_family = AF_UNIX };
    snprintf(address.sun_path, sizeof address.sun_path, "%s", in_folder("socket.nrrd"));
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(bind(fd, (struct sockaddr *)&address, sizeof address), 0);
    load_error("socket.nrrd", SP_ERR_INVALID, "socket.nrrd", "is a socket");
    close(fd);
    load_error("missing.nrrd", SP_ERR_NOT_FOUND, "missing.nrrd", "there is no such file");
    load_error("pipe.nrrd/x", SP_ERR_NOT_FOUND, "pipe.nrrd/x", "there is no such file");
    assert_int_equal(symlink("loop.nrrd", in_folder("loop.nrrd")), 0);
    load_error("loop.nrrd", SP_ERR_IO, "loop.nrrd", "symbolic links");
    write_text("unknown.thing", "hello");
    load_error("unknown.thing", SP_ERR_UNSUPPORTED, "unknown.thing: byte 0", "unknown file format");
    write_text("empty.vol", "%s", "");
    load_error("empty.vol", SP_ERR_FORMAT, "empty.vol: byte 0", "the file is empty");
    if (geteuid() != 0) { /* root can read every file */
        write_text("closed.nrrd", "NRRD0004\n");
        assert_int_equal(chmod(in_folder("closed.nrrd"), 0), 0);
        load_error("closed.nrrd", SP_ERR_IO, "closed.nrrd", "Permission denied");
    }
}

static const char tiny[] =
    "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 1\nencoding: raw\n\nabcd";

static void files_outside_the_root_are_denied(void **state) {
    (void)state;
    assert_int_equal(mkdir(in_folder("in"), 0700), 0);
    assert_int_equal(mkdir(in_folder("inside"), 0700), 0);
    write_text("in/tiny.nrrd", "%s", tiny);
    write_text("inside/tiny.nrrd", "%s", tiny);
    assert_int_equal(symlink("../inside/tiny.nrrd", in_folder("in/out.nrrd")), 0);
    assert_int_equal(symlink("tiny.nrrd", in_folder("in/alias.nrrd")), 0);
    assert_int_equal(symlink("circle.nrrd", in_folder("in/circle.nrrd")), 0);
    struct sp_load_options options = importer_options();
    static const struct {
        const char *path;
        enum sp_code code;
        const char *text;
    } cases[] = {
        { "in/tiny.nrrd", SP_OK, "" },
        { "in/alias.nrrd", SP_OK, "" },
        { "in/../in/tiny.nrrd", SP_OK, "" },
        /* "in" is a prefix, but not a parent folder */
        { "inside/tiny.nrrd", SP_ERR_DENIED, "lies outside of /" },
        { "in/../inside/tiny.nrrd", SP_ERR_DENIED, "lies outside of /" },
        { "in/out.nrrd", SP_ERR_DENIED, "is a symbolic link that leads out of /" },
        { "in/circle.nrrd", SP_ERR_INVALID, "is a symbolic link that leads in a circle" },
        { "in", SP_OK, "" }, /* its first file */
        { "inside", SP_ERR_DENIED, "lies outside of /" },
    };
    options.root = strdup(in_folder("in"));
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct sp_error err = { .code = SP_OK };
        struct sp_volume *volume = sp_volume_load(in_folder(cases[i].path), &options, &err);
        if (err.code != cases[i].code)
            fail_msg("%s: %s: %s", cases[i].path, sp_code_name(err.code), err.text);
        if (err.code != SP_OK && strncmp(err.text, cases[i].text, strlen(cases[i].text)) != 0)
            assert_string_equal(err.text, cases[i].text);
        if (volume)
            assert_string_equal(sp_volume_voxels(volume), "abcd");
        sp_volume_unref(&volume);
    }
    free((char *)options.root);
    struct sp_error err;
    options.root = "/nonexistent";
    assert_null(sp_volume_load(in_folder("in/tiny.nrrd"), &options, &err));
    assert_int_equal(err.code, SP_ERR_IO);
    assert_string_equal(err.place, "/nonexistent");
    /* Without a root, a symbolic link may point outside of its folder. */
    struct sp_volume *volume = load("in/out.nrrd");
    assert_string_equal(sp_volume_info(volume)->name, "out");
    sp_volume_unref(&volume);
}

static void a_missing_importer_is_explained(void **state) {
    (void)state;
    struct sp_load_options options = { .importer = "/nonexistent/splat-import" };
    struct sp_error err;
    write_text("tiny.nrrd", "%s", tiny);
    assert_null(sp_volume_load(in_folder("tiny.nrrd"), &options, &err));
    assert_int_equal(err.code, SP_ERR_IO);
    assert_string_equal(err.place, "/nonexistent/splat-import");
    options.importer = "/etc/passwd";
    assert_null(sp_volume_load(in_folder("tiny.nrrd"), &options, &err));
    assert_int_equal(err.code, SP_ERR_IO);
}

/* Memory budget and cancellation. */

struct calls {
    int reserves, progresses, cancel_after;
    uint64_t bytes;
    double last;
    bool refuse;
};

static bool on_reserve(void *user, uint64_t bytes, struct sp_error *err) {
    struct calls *c = user;
    c->reserves++;
    c->bytes = bytes;
    return !c->refuse || sp_fail(err, SP_ERR_BUDGET, "here", "needs %llu bytes, 5 are free",
                                 (unsigned long long)bytes);
}

static bool on_progress(void *user, double fraction) {
    struct calls *c = user;
    assert_compare(fraction, >=, c->last);
    assert_compare(fraction, <=, 1);
    c->last = fraction;
    return ++c->progresses != c->cancel_after;
}

static void the_budget_is_checked_before_memory_is_allocated(void **state) {
    (void)state;
    /* 64 GiB, more than this machine can allocate. The sparse file has that size. */
    static const char header[] =
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4096 4096 4096\nencoding: raw\n\n";
    write_text("big.nrrd", "%s", header);
    if (truncate(in_folder("big.nrrd"), (off_t)strlen(header) + (INT64_C(1) << 36)) != 0) {
        print_message("skipped: the file system cannot hold a sparse file of 64 GiB\n");
        skip();
    }
    struct calls calls = { .refuse = true };
    struct sp_load_options options = importer_options();
    options.reserve = on_reserve;
    options.progress = on_progress;
    options.user = &calls;
    struct sp_error err;
    assert_null(sp_volume_load(in_folder("big.nrrd"), &options, &err));
    assert_int_equal(err.code, SP_ERR_BUDGET);
    assert_string_equal(err.text, "needs 68719476736 bytes, 5 are free");
    assert_int_equal(calls.reserves, 1);
    assert_no_children();

    write_text("tiny.nrrd", "%s", tiny);
    calls = (struct calls){ 0 };
    struct sp_volume *volume = sp_volume_load(in_folder("tiny.nrrd"), &options, &err);
    assert_non_null(volume);
    assert_int_equal(calls.reserves, 1);
    assert_int_equal(calls.bytes, 64); /* the memory is laid out in lines of 64 bytes */
    assert_compare(calls.last, ==, 1);
    assert_compare(calls.progresses, >=, 2);
    sp_volume_unref(&volume);
}

static void loading_can_be_cancelled(void **state) {
    (void)state;
    for (int after = 1; after <= 3; after++) { /* also while the importer hangs */
        struct calls calls = { .cancel_after = after };
        struct sp_load_options options = { .importer = SPLATD_TEST_DIR "/hostile_importer",
                                           .progress = on_progress,
                                           .user = &calls };
        struct sp_error err;
        write_text("hang-late", "x");
        assert_null(sp_volume_load(in_folder("hang-late"), &options, &err));
        assert_int_equal(err.code, SP_ERR_CANCELLED);
        assert_int_equal(calls.progresses, after);
        assert_no_children();
    }
}

/* Threads, other child processes and signal settings of the calling process. */

static void *load_often(void *user) {
    int *failures = user;
    struct sp_load_options options = importer_options();
    for (int i = 0; i < 12; i++) {
        struct sp_error err;
        struct sp_volume *volume = sp_volume_load(in_folder("tiny.nrrd"), &options, &err);
        if (!volume || memcmp(sp_volume_voxels(volume), "abcd", 4) != 0)
            ++*failures;
        sp_volume_unref(&volume);
    }
    return NULL;
}

static void many_threads_load_at_once(void **state) {
    (void)state;
    enum { THREADS = 6 };
    pthread_t threads[THREADS];
    int failures[THREADS] = { 0 }, before = open_descriptors();
    write_text("tiny.nrrd", "%s", tiny);
    /* A child process of other code in this program. Loading must not wait for it. */
    pid_t other = fork();
    if (other == 0) {
        pause();
        _exit(33);
    }
    for (int t = 0; t < THREADS; t++)
        assert_int_equal(pthread_create(&threads[t], NULL, load_often, &failures[t]), 0);
    for (int t = 0; t < THREADS; t++) {
        pthread_join(threads[t], NULL);
        assert_int_equal(failures[t], 0);
    }
    int status;
    assert_int_equal(waitpid(other, &status, WNOHANG), 0);
    kill(other, SIGKILL);
    assert_int_equal(waitpid(other, &status, 0), other);
    assert_no_children();
    assert_int_equal(open_descriptors(), before);
}

static void loading_works_when_sigchld_is_ignored(void **state) {
    (void)state;
    write_text("tiny.nrrd", "%s", tiny);
    signal(SIGCHLD, SIG_IGN);
    struct sp_volume *volume = load("tiny.nrrd");
    sp_volume_unref(&volume);
    struct sp_error err;
    assert_null(load_hostile("abort", 60000, &err));
    assert_int_equal(err.code, SP_ERR_CRASHED);
    signal(SIGCHLD, SIG_DFL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(misbehaving_importers_are_errors),
        cmocka_unit_test(importers_that_do_not_end_are_stopped),
        cmocka_unit_test(odd_but_harmless_importers_can_load),
        cmocka_unit_test(unreadable_sources_are_refused_without_blocking),
        cmocka_unit_test(files_outside_the_root_are_denied),
        cmocka_unit_test(a_missing_importer_is_explained),
        cmocka_unit_test(the_budget_is_checked_before_memory_is_allocated),
        cmocka_unit_test(loading_can_be_cancelled),
        cmocka_unit_test(many_threads_load_at_once),
        cmocka_unit_test(loading_works_when_sigchld_is_ignored),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
