/* SPDX-License-Identifier: Apache-2.0
 *
 * A file that splatctl writes is on the disk before it has its name.
 */
#include <errno.h>
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

#include "output.h"

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

static void a_name_stands_for_what_is_on_the_disk(void **state) {
    (void)state;
    char folder[] = "/tmp/splatctl-output-XXXXXX", path[64];
    struct sp_error err;
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/out", folder);
    disk.fails = true;
    assert_false(output_write(path, "bytes", 5, &err));
    assert_non_null(strstr(err.text, strerror(ENOSPC)));
    assert_int_equal(rmdir(folder), 0); /* nothing is left */
    assert_int_equal(mkdir(folder, 0700), 0);
    disk.fails = false;
    assert_true(output_write(path, "bytes", 5, &err));
    assert_true(output_write(path, "other", 5, &err));
    assert_int_equal(disk.renames, 2);
    assert_int_equal(unlink(path), 0);
    assert_int_equal(rmdir(folder), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = { cmocka_unit_test(a_name_stands_for_what_is_on_the_disk) };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
