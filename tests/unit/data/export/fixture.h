/* SPDX-License-Identifier: Apache-2.0
 *
 * What the tests of the writers share: folders, files in memory, and a volume to write.
 */
#ifndef TESTS_UNIT_EXPORT_FIXTURE_H
#define TESTS_UNIT_EXPORT_FIXTURE_H

#include "sp/volume.h"

enum { NX = 131, NY = 70, NZ = 65 };

extern const struct sp_load_options options; /* name the splat-import of this build */

/* For cmocka: *state is the path of a folder of its own for each test. */
int make_folder(void **state);
int remove_folder(void **state);
/* Returns the path of `name` in this folder; valid until the fourth call after this one. */
const char *path_in(void *const *state, const char *name);

struct sp_volume_info describe(void); /* uint16, NX × NY × NZ, mm */
/* Returns the descriptor of a file in memory with these bytes. */
int memory_file(const void *bytes, size_t size);

#endif
