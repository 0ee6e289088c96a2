/* SPDX-License-Identifier: Apache-2.0
 *
 * The version of the library. While the major version is 0, a new minor version may change the API
 * and the ABI; the shared library's SONAME is libsplat.so.MAJOR.MINOR until then.
 */
#ifndef SP_VERSION_H
#define SP_VERSION_H

#include "sp/api.h"

#ifdef __cplusplus
extern "C" {
#endif

/* CMake reads the project's version from these three lines. */
#define SP_VERSION_MAJOR 0
#define SP_VERSION_MINOR 1
#define SP_VERSION_PATCH 0

/* One number that can be compared: SP_VERSION >= SP_VERSION_NUMBER(0, 2, 0). */
#define SP_VERSION_NUMBER(major, minor, patch) ((major)*10000 + (minor)*100 + (patch))
#define SP_VERSION SP_VERSION_NUMBER(SP_VERSION_MAJOR, SP_VERSION_MINOR, SP_VERSION_PATCH)

/* Returns SP_VERSION of the linked library, which may differ from the version of the headers.
 * Thread-safe. */
SP_API int sp_version(void);
/* Returns the version as text, "0.1.0": a constant string. Thread-safe. */
SP_API const char *sp_version_string(void);

#ifdef __cplusplus
}
#endif

#endif
