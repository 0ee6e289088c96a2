// SPDX-License-Identifier: Apache-2.0
#include "data/import/dicom_guard.h"

#include <csetjmp>
#include <csignal>

static sigjmp_buf way_out;

extern "C" {
static void leave(int) {
    siglongjmp(way_out, 1);
}
}

/* Not SIGBUS: it says that the disk is full, where samples are written to a file. */
static const int signals[] = { SIGABRT, SIGSEGV, SIGFPE, SIGILL };
enum { SIGNALS = sizeof signals / sizeof *signals };

bool dicom_survive(bool (*run)(void *user), void *user, sp_error *err) {
    static char stack[1 << 16]; /* the own one may be full: data sets lie in each other */
    stack_t own_stack = {}, stack_before = {};
    struct sigaction own = {}, before[SIGNALS] = {};
    own_stack.ss_sp = stack;
    own_stack.ss_size = sizeof stack;
    own.sa_handler = leave;
    own.sa_flags = SA_ONSTACK;
    sigaltstack(&own_stack, &stack_before);
    for (int i = 0; i < SIGNALS; i++)
        sigaction(signals[i], &own, &before[i]);
    bool ok = false;
    if (sigsetjmp(way_out, 1) == 0)
        ok = run(user);
    else
        sp_fail(err, SP_ERR_FORMAT, "", "the file is cut off or damaged");
    for (int i = 0; i < SIGNALS; i++)
        sigaction(signals[i], &before[i], nullptr);
    sigaltstack(&stack_before, nullptr);
    return ok;
}
