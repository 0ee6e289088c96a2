/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/version.h"

#define TEXT_OF(x) #x
#define TEXT(x) TEXT_OF(x)

int sp_version(void) {
    return SP_VERSION;
}

const char *sp_version_string(void) {
    return TEXT(SP_VERSION_MAJOR) "." TEXT(SP_VERSION_MINOR) "." TEXT(SP_VERSION_PATCH);
}
