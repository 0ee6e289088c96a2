/* SPDX-License-Identifier: Apache-2.0
 *
 * A random number per sample or point of a layer of vectors. It decides whether the sample is
 * drawn, and gives its phase. It depends only on the index of the sample, so that it is the same in
 * all frames.
 */
#ifndef SP_SPLAT_LIST_PHASE_H
#define SP_SPLAT_LIST_PHASE_H

#include <stdbool.h>
#include <stdint.h>

/* Returns the random number of sample n: the upper half decides whether the sample is drawn, the
 * lower half is its phase. (The finalizer of MurmurHash3, by Appleby.) */
static inline uint32_t sp_streak_hash(uint64_t n) {
    n = (n ^ n >> 33) * UINT64_C(0xff51afd7ed558ccd);
    n = (n ^ n >> 33) * UINT64_C(0xc4ceb9fe1a85ec53);
    return (uint32_t)(n ^ n >> 33);
}

/* True for the share `density` of all samples, [0, 1]. The samples drawn at one density are also
 * drawn at every higher density. */
static inline bool sp_streak_is_drawn(uint32_t hash, double density) {
    return hash >> 16 < (uint32_t)(density * 65536);
}

#endif
