/* SPDX-License-Identifier: Apache-2.0
 *
 * A random number per sample or point of a layer of vectors. It decides whether the sample is
 * drawn, and gives its phase. It depends on the index of the sample alone, so that it is the same
 * in all frames.
 */
#ifndef SP_SPLAT_LIST_PHASE_H
#define SP_SPLAT_LIST_PHASE_H

#include <stdbool.h>
#include <stdint.h>

/* The upper half decides whether sample n is drawn, the lower half is its phase. (The finalizer of
 * MurmurHash3, by Appleby.) */
static inline uint32_t sp_streak_hash(uint64_t n) {
    n = (n ^ n >> 33) * UINT64_C(0xff51afd7ed558ccd);
    n = (n ^ n >> 33) * UINT64_C(0xc4ceb9fe1a85ec53);
    return (uint32_t)(n ^ n >> 33);
}

/* True for the share `density` of all samples; a smaller share is a part of a larger one. */
static inline bool sp_streak_is_drawn(uint32_t hash, double density) {
    return hash >> 16 < (uint32_t)(density * 65536);
}

#endif
