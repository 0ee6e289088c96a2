/* SPDX-License-Identifier: Apache-2.0
 *
 * Files of camera paths are complete or absent, whichever call fails and whenever the machine
 * crashes.
 */
#include <errno.h>
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "paths/folder.h"
#include "support/compare.h"

#define ID "0123456789abcdef0123456789abcdef"
#define HEAD "the head"
#define BODY "and many bytes behind it"
static const char name[] = "000001.png", whole[] = HEAD BODY;

/* Wrappers of the calls that reach the disk: each checks the files, and one may fail. */

static struct {
    bool is_watching;
    char final[SRV_FILE_BYTES], job[SRV_FILE_BYTES], root[SRV_FOLDER_BYTES];
    unsigned calls, fails_at;  /* counted from 1; fails_at 0 = no call fails */
    const char *failed;        /* name of the call that failed */
    ino_t written;             /* file with bytes that are not synced */
    bool is_renamed, is_known; /* is_known: the folder is synced after the rename */
} disk;

static bool is_there(const char *path) {
    struct stat st;
    return stat(path, &st) == 0;
}

/* True if the file has the bytes and their seal. */
static bool is_whole(const char *path) {
    char bytes[64] = "", expected[64] = HEAD BODY "SPLTSEAL";
    const size_t all = strlen(whole) + SRV_SEAL_BYTES;
    expected[all - 8] = (char)strlen(whole);
    FILE *file = fopen(path, "rb");
    size_t size = file ? fread(bytes, 1, sizeof bytes - 1, file) : 0;
    if (file)
        fclose(file);
    return size == all && memcmp(bytes, expected, all) == 0;
}

/* Checks the files and counts the call. False: the call must fail. */
static bool call(const char *what) {
    if (!disk.is_watching)
        return true;
    int before = errno;
    disk.is_watching = false; /* the calls of the check are not watched */
    if (is_there(disk.final)) {
        assert_true(disk.is_renamed);
        assert_true(is_whole(disk.final));
    }
    disk.is_watching = true;
    errno = before;
    if (++disk.calls != disk.fails_at)
        return true;
    disk.failed = what;
    errno = ENOSPC;
    return false;
}

static ino_t inode_of(int fd) {
    struct stat st;
    return fstat(fd, &st) == 0 ? st.st_ino : 0;
}

static ino_t inode_at(const char *path) {
    struct stat st;
    return stat(path, &st) == 0 ? st.st_ino : 0;
}

ssize_t __real_write(int fd, const void *bytes, size_t size);
ssize_t __wrap_write(int fd, const void *bytes, size_t size);
int __real_fsync(int fd);
int __wrap_fsync(int fd);
int __real_close(int fd);
int __wrap_close(int fd);
int __real_rename(const char *from, const char *to);
int __wrap_rename(const char *from, const char *to);
int __real_mkdir(const char *path, mode_t mode);
int __wrap_mkdir(const char *path, mode_t mode);

/* Writes at most seven bytes per call, because write() may write less than it is given. */
ssize_t __wrap_write(int fd, const void *bytes, size_t size) {
    if (!disk.is_watching)
        return __real_write(fd, bytes, size);
    if (!call("write"))
        return -1;
    disk.written = inode_of(fd);
    return __real_write(fd, bytes, size < 7 ? size : 7);
}

int __wrap_fsync(int fd) {
    if (!call("fsync"))
        return -1;
    if (inode_of(fd) == disk.written)
        disk.written = 0;
    if (inode_of(fd) == inode_at(disk.job))
        disk.is_known = disk.is_renamed;
    return __real_fsync(fd);
}

int __wrap_close(int fd) {
    bool ok = call("close");
    int result = __real_close(fd);
    if (!ok)
        errno = ENOSPC;
    return ok ? result : -1;
}

int __wrap_rename(const char *from, const char *to) {
    if (!call("rename"))
        return -1;
    if (disk.is_watching) {
        /* After a crash from here on, the file must have its content. */
        assert_string_equal(to, disk.final);
        assert_int_equal(disk.written, 0);
        disk.is_renamed = true;
    }
    return __real_rename(from, to);
}

int __wrap_mkdir(const char *path, mode_t mode) {
    return call("mkdir") ? __real_mkdir(path, mode) : -1;
}

/* Fixtures. */

static int set_up(void **state) {
    struct srv_folder *folder = calloc(1, sizeof *folder);
    char parent[] = "/tmp/splatd-folder-XXXXXX";
    memset(&disk, 0, sizeof disk);
    if (!folder || !mkdtemp(parent) || !srv_folder_open(folder, parent, NULL))
        return -1;
    srv_folder_path(folder, ID, "", disk.job);
    srv_folder_path(folder, ID, name, disk.final);
    snprintf(disk.root, sizeof disk.root, "%s", parent);
    *state = folder;
    return 0;
}

static int tear_down(void **state) {
    struct srv_folder *folder = *state;
    char path[SRV_FOLDER_BYTES];
    disk.is_watching = false;
    srv_folder_remove(folder, ID, NULL);
    snprintf(path, sizeof path, "%s", folder->root);
    srv_folder_close(folder);
    rmdir(path);
    rmdir(disk.root);
    free(folder);
    return 0;
}

static bool watched_write(const struct srv_folder *folder, unsigned fails_at,
                          struct sp_error *err) {
    disk.calls = 0;
    disk.fails_at = fails_at;
    disk.failed = NULL;
    disk.is_renamed = disk.is_known = false;
    disk.is_watching = true;
    bool ok = srv_folder_write(folder, ID, name, HEAD, strlen(HEAD), BODY, strlen(BODY), err);
    disk.is_watching = false;
    return ok;
}

static unsigned count_files(const char *path) {
    unsigned count = 0;
    char command[SRV_FILE_BYTES + 64];
    snprintf(command, sizeof command, "find %s -type f 2>/dev/null", path);
    FILE *files = popen(command, "r");
    assert_non_null(files);
    for (int c; (c = fgetc(files)) != EOF;)
        count += c == '\n';
    pclose(files);
    return count;
}

/* Tests. */

static void a_name_stands_for_a_complete_file(void **state) {
    struct sp_error err;
    assert_true(watched_write(*state, 0, &err));
    assert_true(is_whole(disk.final));
    assert_int_equal(count_files(disk.job), 1);
    assert_int_equal(disk.written, 0);
    assert_true(disk.is_known);
}

/* Only errors of close() are ignored, after the file was synced and for folders. */
static void a_failed_write_leaves_no_file(void **state) {
    const struct srv_folder *folder = *state;
    unsigned failures = 0;
    for (unsigned at = 1;; at++) {
        struct sp_error err = { .code = SP_OK };
        bool ok = watched_write(folder, at, &err);
        if (!disk.failed) {
            assert_true(ok);
            break;
        }
        assert_int_equal(count_files(disk.job), ok ? 1 : 0);
        if (ok) {
            assert_true(is_whole(disk.final));
            assert_string_equal(disk.failed, "close");
        }
        if (!ok) {
            failures++;
            assert_int_equal(err.code, SP_ERR_IO);
            assert_non_null(strstr(err.text, strerror(ENOSPC)));
        }
        srv_folder_remove(folder, ID, NULL);
    }
    assert_compare(failures, >=, 10);
}

static void srv_folder_publish_leaves_a_complete_file(void **state) {
    const struct srv_folder *folder = *state;
    char part[SRV_FILE_BYTES];
    srv_folder_path(folder, ID, "movie.part", part);
    for (unsigned at = 1;; at++) {
        __real_mkdir(disk.job, 0700);
        int fd = open(part, O_WRONLY | O_CREAT | O_TRUNC, 0600);
        assert_int_equal(__real_write(fd, whole, strlen(whole)), strlen(whole));
        disk.written = inode_of(fd);
        __real_close(fd);
        disk.calls = 0;
        disk.fails_at = at;
        disk.failed = NULL;
        disk.is_renamed = disk.is_known = false;
        disk.is_watching = true;
        bool ok = srv_folder_publish(folder, ID, "movie.part", name, NULL);
        disk.is_watching = false;
        assert_int_equal(count_files(disk.job), ok ? 1 : 0);
        assert_true(!ok || is_whole(disk.final));
        if (!disk.failed) {
            assert_true(ok);
            break;
        }
        srv_folder_remove(folder, ID, NULL);
    }
}

/* Reads the file as a result; NULL: *code. */
static int open_again(const struct srv_folder *folder, bool must_have_seal, uint64_t *size,
                      enum sp_code *code) {
    struct sp_error err = { .code = SP_OK };
    int fd = srv_folder_open_file(folder, ID, name, must_have_seal, size, &err);
    *code = err.code;
    assert_true((fd >= 0) == (err.code == SP_OK));
    return fd;
}

static void a_file_that_was_cut_off_is_not_opened(void **state) {
    const struct srv_folder *folder = *state;
    const off_t all = (off_t)strlen(whole) + SRV_SEAL_BYTES;
    uint64_t size;
    enum sp_code code;
    assert_int_equal(open_again(folder, true, &size, &code), -1);
    assert_int_equal(code, SP_ERR_NOT_FOUND);
    for (off_t left = all; left >= 0; left--) {
        srv_folder_remove_file(folder, ID, name);
        assert_true(watched_write(folder, 0, NULL));
        assert_int_equal(truncate(disk.final, left), 0);
        int fd = open_again(folder, true, &size, &code);
        assert_int_equal(code, left == all ? SP_OK : SP_ERR_IO);
        if (fd >= 0) {
            assert_int_equal(size, strlen(whole));
            assert_true(srv_folder_size(folder, ID, name, &size));
            assert_int_equal(size, all);
            close(fd);
        }
    }
    assert_int_equal(open_again(folder, false, &size, &code), -1); /* empty */
    assert_int_equal(code, SP_ERR_IO);
    /* Files of earlier versions have no seal. */
    FILE *file = fopen(disk.final, "w");
    assert_non_null(file);
    fputs(whole, file);
    fclose(file);
    int fd = open_again(folder, false, &size, &code);
    assert_compare(fd, >=, 0);
    assert_int_equal(size, strlen(whole));
    close(fd);
    /* Cut off and filled up again: the seal is for another size. */
    srv_folder_remove_file(folder, ID, name);
    assert_true(watched_write(folder, 0, NULL));
    file = fopen(disk.final, "a");
    fwrite("SPLTSEAL\x05\0\0\0\0\0\0", 1, SRV_SEAL_BYTES, file);
    fclose(file);
    assert_int_equal(open_again(folder, true, &size, &code), -1);
    assert_int_equal(code, SP_ERR_IO);
    /* Only regular files are read, so a pipe does not block. */
    unlink(disk.final);
    assert_int_equal(mkfifo(disk.final, 0600), 0);
    assert_int_equal(open_again(folder, true, &size, &code), -1);
    assert_int_equal(code, SP_ERR_IO);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_name_stands_for_a_complete_file, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_failed_write_leaves_no_file, set_up, tear_down),
        cmocka_unit_test_setup_teardown(srv_folder_publish_leaves_a_complete_file, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(a_file_that_was_cut_off_is_not_opened, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
