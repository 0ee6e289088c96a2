/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/backend.h"

extern const struct sp_backend cpu_backend, null_backend;
#ifdef SPLATD_WITH_GL
extern const struct sp_backend gl_backend, gl_software_backend;
#endif

/* In the order in which "auto" tries them. */
static const struct sp_backend *const backends[] = {
#ifdef SPLATD_WITH_GL
    &gl_backend,
    &gl_software_backend,
#endif
    &cpu_backend,
    &null_backend,
};
enum { BACKENDS = sizeof backends / sizeof backends[0] };

const struct sp_backend *sp_registry_at(unsigned i) {
    return i < BACKENDS ? backends[i] : NULL;
}
