/* SPDX-License-Identifier: Apache-2.0
 *
 * The folder of real volumes: $SPLATD_DATA_DIR, else the path given to CMake. It may be absent; a
 * test that needs it then says so and ends with TEST_SKIPPED.
 */
#ifndef TESTS_SUPPORT_DATA_H
#define TESTS_SUPPORT_DATA_H

#include <stdbool.h>
#include <stddef.h>

enum { TEST_SKIPPED = 77 }; /* exit status that ctest shows as "Skipped" */

/* Never NULL. */
const char *test_data_folder(const char *configured);

/* The path of a volume file, looked for in the folder itself and in its folder `volumes`. False,
 * and a line that says what is missing, if there is none. */
bool test_data_path(const char *configured, const char *file, char *path, size_t size);

#endif
