/* SPDX-License-Identifier: Apache-2.0
 *
 * The folder of real volumes: $SPLATD_DATA_DIR, else the path given to CMake. It may not exist; a
 * test that needs it then prints this and exits with TEST_SKIPPED.
 */
#ifndef TESTS_SUPPORT_DATA_H
#define TESTS_SUPPORT_DATA_H

#include <stdbool.h>
#include <stddef.h>

enum { TEST_SKIPPED = 77 }; /* exit status that ctest shows as "Skipped" */

/* Never NULL. */
const char *test_data_folder(const char *configured);

/* Finds a volume file in the folder or in its subfolder `volumes`. If it does not exist, prints a
 * line with its name and returns false. */
bool test_data_path(const char *configured, const char *file, char *path, size_t size);

#endif
