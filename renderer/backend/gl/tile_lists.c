/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/tile_lists.h"

#include <string.h>

uint32_t gl_tile_lists_write(uint32_t *first, struct gl_entry *entries, const struct sp_bins *bins,
                             gl_block_size_fn *size, const void *user) {
    uint32_t most = 0;
    memcpy(first, bins->first, (bins->tiles + (size_t)1) * sizeof *first);
    for (uint32_t t = 0; t < bins->tiles; t++) {
        uint32_t before = 0;
        for (uint32_t e = bins->first[t]; e < bins->first[t + 1]; e++) {
            entries[e] = (struct gl_entry){ bins->entries[e], before };
            before += size(user, bins->entries[e]);
        }
        most = before > most ? before : most;
    }
    return most;
}

uint32_t gl_tile_lists_words(const struct sp_bins *bins) {
    return bins->tiles + 1 +
           bins->first[bins->tiles] * (uint32_t)(sizeof(struct gl_entry) / sizeof(uint32_t));
}
