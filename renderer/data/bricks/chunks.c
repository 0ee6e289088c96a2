/* SPDX-License-Identifier: Apache-2.0 */
#include "data/bricks/chunks.h"

void sp_chunk_box(const struct sp_chunk_level *level, const uint32_t place[3], uint32_t first[3],
                  uint32_t size[3]) {
    for (int a = 0; a < 3; a++) {
        first[a] = place[a] * level->chunk[a];
        const uint32_t left = level->dims[a] - first[a];
        size[a] = left < level->chunk[a] ? left : level->chunk[a];
    }
}

uint64_t sp_chunk_bytes_max(const struct sp_chunk_source *source) {
    uint64_t most = 0;
    for (unsigned l = 0; l < source->levels; l++) {
        const uint32_t place[3] = { 0, 0, 0 };
        uint32_t first[3], size[3];
        sp_chunk_box(&source->level[l], place, first, size);
        const uint64_t bytes =
            (uint64_t)size[0] * size[1] * size[2] * sp_type_size(source->info.type);
        most = bytes > most ? bytes : most;
    }
    return most;
}
