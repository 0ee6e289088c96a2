/* SPDX-License-Identifier: Apache-2.0
 *
 * Four floats at a time in the compiler's portable vectors: written once, it becomes whatever the
 * target has. No alignment is needed to load or store.
 */
#ifndef SP_BASE_WIDE_H
#define SP_BASE_WIDE_H

#include <stdint.h>
#include <string.h>

enum { SP_WIDE = 4 };
typedef float sp_wide __attribute__((vector_size(16)));
typedef int32_t sp_wide_mask __attribute__((vector_size(16))); /* 0 or −1 a lane */

static inline sp_wide sp_wide_all(float x) {
    return (sp_wide){ x, x, x, x };
}

static inline sp_wide sp_wide_load(const float *p) {
    sp_wide a;
    memcpy(&a, p, sizeof a);
    return a;
}

static inline void sp_wide_store(float *p, sp_wide a) {
    memcpy(p, &a, sizeof a);
}

/* The lanes of a that the mask names; 0 in the others. */
static inline sp_wide sp_wide_keep(sp_wide_mask mask, sp_wide a) {
    return (sp_wide)((sp_wide_mask)a & mask);
}

#endif
