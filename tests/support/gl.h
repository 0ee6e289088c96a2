/* SPDX-License-Identifier: Apache-2.0
 *
 * Which GPU backend the tests run: software GL, so that they need no GPU. The environment variable
 * SPLATD_TEST_GL=gl chooses the GPU of this machine instead.
 */
#ifndef TESTS_SUPPORT_GL_H
#define TESTS_SUPPORT_GL_H

#include <stdbool.h>

#include "backend/backend.h"

/* "gl-software", or "gl". */
const char *test_gl(void);
bool test_gl_is_software(void);

/* The backend of that name; a name that this build lacks ends the program. */
const struct sp_backend *test_backend(const char *name);

#endif
