/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/probe.h"

#include <unistd.h>

#include "backend/backend.h"
#include "backend/defaults.h"

unsigned sp_default_threads(void) {
    long n = sysconf(_SC_NPROCESSORS_ONLN);
    return n < 1 ? 1 : n > SP_THREADS_MAX ? SP_THREADS_MAX : (unsigned)n;
}

uint64_t sp_default_memory(void) {
    long pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
    return pages > 0 && page > 0 ? (uint64_t)pages * (uint64_t)page / 2 : UINT64_C(1) << 30;
}

struct probing {
    sp_device_visit *visit;
    void *user;
    bool works; /* any GPU so far */
};

static void visit_device(void *user, const struct sp_device *device) {
    struct probing *probing = user;
    probing->works = probing->works || (device->is_gpu && device->refusal_code == SP_OK);
    probing->visit(probing->user, device);
}

bool sp_probe(sp_device_visit *visit, void *user) {
    const struct sp_backend_options options = { .threads = sp_default_threads(),
                                                .memory_bytes = sp_default_memory(),
                                                .isa = "auto",
                                                .gpu = -1 };
    const struct sp_device none = { .backend = "none",
                                    .place = "GPU",
                                    .refusal_code = SP_ERR_UNSUPPORTED,
                                    .refusal = "this build has no GPU backend",
                                    .gpu = -1 };
    struct probing probing = { .visit = visit, .user = user };
    bool has_gpu = false;
    const struct sp_backend *backend;
    for (unsigned i = 0; (backend = sp_registry_at(i)); i++)
        has_gpu = has_gpu || backend->is_gpu;
    if (!has_gpu)
        visit(user, &none);
    for (unsigned i = 0; (backend = sp_registry_at(i)); i++)
        sp_registry_probe(backend, &options, visit_device, &probing);
    return probing.works;
}
