/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/budget.h"

#include <assert.h>
#include <inttypes.h>
#include <stdatomic.h>
#include <stdlib.h>

struct sp_budget {
    uint64_t limit;
    _Atomic uint64_t total, used[SP_BUDGET_KINDS];
};

struct sp_budget *sp_budget_create(uint64_t limit_bytes, struct sp_error *err) {
    struct sp_budget *budget = calloc(1, sizeof *budget);
    if (!budget) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for the budget of frames");
        return NULL;
    }
    budget->limit = limit_bytes;
    return budget;
}

void sp_budget_destroy(struct sp_budget **budget) {
    assert(sp_budget_total(*budget) == 0);
    free(*budget);
    *budget = NULL;
}

bool sp_budget_acquire(struct sp_budget *budget, enum sp_budget_kind kind, uint64_t bytes) {
    if (!budget)
        return true;
    uint64_t total = atomic_load(&budget->total);
    do
        if (total > budget->limit || bytes > budget->limit - total)
            return false;
    while (!atomic_compare_exchange_weak(&budget->total, &total, total + bytes));
    atomic_fetch_add(&budget->used[kind], bytes);
    return true;
}

void sp_budget_add(struct sp_budget *budget, enum sp_budget_kind kind, uint64_t bytes) {
    if (!budget)
        return;
    atomic_fetch_add(&budget->total, bytes);
    atomic_fetch_add(&budget->used[kind], bytes);
}

void sp_budget_release(struct sp_budget *budget, enum sp_budget_kind kind, uint64_t bytes) {
    if (!budget)
        return;
    atomic_fetch_sub(&budget->used[kind], bytes);
    atomic_fetch_sub(&budget->total, bytes);
}

uint64_t sp_budget_used(const struct sp_budget *budget, enum sp_budget_kind kind) {
    return budget ? atomic_load(&budget->used[kind]) : 0;
}

uint64_t sp_budget_total(const struct sp_budget *budget) {
    return budget ? atomic_load(&budget->total) : 0;
}

uint64_t sp_budget_limit(const struct sp_budget *budget) {
    return budget ? budget->limit : UINT64_MAX;
}

bool sp_budget_fail(const struct sp_budget *budget, const char *what, uint64_t needed,
                    struct sp_error *err) {
    return sp_fail(err, SP_ERR_FRAME_BUDGET, "/size",
                   "the frame needs %" PRIu64 " more bytes for its %s; frames have %" PRIu64
                   " of the %" PRIu64 " bytes that they may have together; ask for a smaller image "
                   "or fewer layers",
                   needed, what, sp_budget_total(budget), sp_budget_limit(budget));
}
