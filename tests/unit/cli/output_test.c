/* SPDX-License-Identifier: Apache-2.0
 *
 * Output files of splatctl: the bytes are synced before the rename, the name after it, and a
 * dropped file leaves nothing behind.
 */
#include <errno.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "cli/output.h"

static struct {
    ino_t synced;
    bool fails;
    unsigned renames;
} disk;

int __real_fsync(int fd);
int __wrap_fsync(int fd);
int __real_rename(const char *from, const char *to);
int __wrap_rename(const char *from, const char *to);

int __wrap_fsync(int fd) {
    struct stat st;
    assert_int_equal(fstat(fd, &st), 0);
    disk.synced = st.st_ino;
    errno = ENOSPC;
    return disk.fails ? -1 : __real_fsync(fd);
}

int __wrap_rename(const char *from, const char *to) {
    struct stat st;
    assert_int_equal(stat(from, &st), 0);
    assert_int_equal(st.st_size, 5);
    assert_int_equal(st.st_ino, disk.synced);
    disk.renames++;
    return __real_rename(from, to);
}

static void a_file_is_synced_before_it_gets_its_name(void **state) {
    (void)state;
    char folder[] = "/tmp/splatctl-output-XXXXXX", path[64];
    struct sp_error err;
    struct stat there;
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/out", folder);
    disk.fails = true;
    assert_false(output_write(path, "bytes", 5, &err));
    assert_non_null(strstr(err.text, strerror(ENOSPC)));
    assert_int_equal(rmdir(folder), 0); /* the folder is empty */
    assert_int_equal(mkdir(folder, 0700), 0);
    disk.fails = false;
    assert_int_equal(stat(folder, &there), 0);
    assert_true(output_write(path, "bytes", 5, &err));
    assert_int_equal(disk.synced, there.st_ino);
    assert_true(output_write(path, "other", 5, &err));
    assert_int_equal(disk.renames, 2);
    assert_int_equal(unlink(path), 0);
    bool is_new;
    snprintf(path, sizeof path, "%s/new", folder);
    disk.synced = 0;
    assert_true(output_make_folder(path, &is_new, &err));
    assert_true(is_new);
    assert_int_equal(disk.synced, there.st_ino);
    assert_true(output_make_folder(path, &is_new, &err));
    assert_false(is_new);
    assert_int_equal(rmdir(path), 0);
    assert_int_equal(rmdir(folder), 0);
}

static volatile sig_atomic_t signals;

static void on_signal(int number) {
    signals += number == SIGINT;
}

static void signals_wait_until_the_file_is_complete_or_removed(void **state) {
    (void)state;
    char folder[] = "/tmp/splatctl-output-XXXXXX", path[64], text[8] = "";
    struct output output;
    struct sp_error err;
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/out", folder);
    signal(SIGINT, on_signal);
    for (int is_dropped = 1; is_dropped >= 0; is_dropped--) {
        signals = 0;
        assert_true(output_open(&output, path, &err));
        assert_true(output_add(&output, "taken back", 10, &err));
        raise(SIGINT); /* delivered when the output is closed or dropped */
        assert_true(output_restart(&output));
        assert_true(output_add(&output, "by", 2, &err));
        assert_true(output_add(&output, "tes", 3, &err));
        assert_int_equal(access(path, F_OK), -1);
        assert_int_equal(signals, 0);
        if (is_dropped) {
            output_drop(&output);
            assert_int_equal(rmdir(folder), 0);
            assert_int_equal(mkdir(folder, 0700), 0);
        } else {
            assert_true(output_close(&output, &err));
        }
        assert_int_equal(signals, 1);
        assert_null(output.path);
        output_drop(&output); /* has no effect */
    }
    FILE *file = fopen(path, "r");
    assert_non_null(file);
    assert_non_null(fgets(text, sizeof text, file));
    fclose(file);
    assert_string_equal(text, "bytes");
    assert_int_equal(unlink(path), 0);
    assert_int_equal(rmdir(folder), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_file_is_synced_before_it_gets_its_name),
        cmocka_unit_test(signals_wait_until_the_file_is_complete_or_removed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
