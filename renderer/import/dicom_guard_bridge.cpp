// SPDX-License-Identifier: Apache-2.0
#include "import/dicom_guard.h"

#include <csetjmp>
#include <csignal>
#include <cstdio>

static sigjmp_buf way_out;

extern "C" {
static void leave(int) {
    siglongjmp(way_out, 1);
}
}

bool dicom_survive(bool (*run)(void *user), void *user, char *why, size_t capacity) {
    struct sigaction own = {}, before = {};
    own.sa_handler = leave;
    sigaction(SIGABRT, &own, &before);
    bool ok = false;
    if (sigsetjmp(way_out, 1) == 0)
        ok = run(user);
    else
        snprintf(why, capacity, "the file is cut off or damaged");
    sigaction(SIGABRT, &before, nullptr);
    return ok;
}
