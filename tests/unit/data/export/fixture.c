/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "unit/data/export/fixture.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

const struct sp_load_options options = { .importer = SPLATD_BIN_DIR "/splat-import" };

/* A folder of its own for each test. */
int make_folder(void **state) {
    char pattern[] = "/tmp/splat-export-XXXXXX";
    *state = mkdtemp(pattern) ? strdup(pattern) : NULL;
    return *state ? 0 : -1;
}

int remove_folder(void **state) {
    char command[256];
    snprintf(command, sizeof command, "rm -rf '%s'", (char *)*state);
    free(*state);
    return system(command);
}

const char *path_in(void *const *state, const char *name) {
    static char paths[4][256];
    static int next;
    char *path = paths[next++ % 4];
    snprintf(path, sizeof paths[0], "%s/%s", (const char *)*state, name);
    return path;
}

struct sp_volume_info describe(void) {
    return (struct sp_volume_info){ .grid = { .dims = { NX, NY, NZ },
                                              .spacing = { 0.5, 1, 2 },
                                              .origin = { 1, 2, 3 },
                                              .direction = { { 1 }, { 0, 1 }, { 0, 0, 1 } } },
                                    .type = SP_UINT16,
                                    .unit = "mm",
                                    .value_name = "density",
                                    .value_unit = "HU",
                                    .anatomy = "LPS" };
}

int memory_file(const void *bytes, size_t size) {
    int fd = memfd_create("export", MFD_CLOEXEC);
    assert_true(fd >= 0);
    assert_int_equal(pwrite(fd, bytes, size, 0), (ssize_t)size);
    return fd;
}
