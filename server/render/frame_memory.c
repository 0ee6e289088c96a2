/* SPDX-License-Identifier: Apache-2.0 */
#include "render/frame_memory.h"

#include <unistd.h>

static uint64_t default_bytes(void) {
    const uint64_t least = UINT64_C(2) << 30;
    const long pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
    const uint64_t quarter = pages > 0 && page > 0 ? (uint64_t)pages * (uint64_t)page / 4 : 0;
    return quarter > least ? quarter : least;
}

bool srv_frame_memory_init(struct srv_frame_memory *memory, uint64_t bytes, struct sp_error *err) {
    const uint64_t all = bytes ? bytes : default_bytes();
    *memory = (struct srv_frame_memory){ .sessions = sp_budget_create(all / 2, err) };
    if (memory->sessions)
        memory->snapshots = sp_budget_create(all - all / 2, err);
    return memory->snapshots != NULL;
}

void srv_frame_memory_finish(struct srv_frame_memory *memory) {
    sp_budget_destroy(&memory->sessions);
    sp_budget_destroy(&memory->snapshots);
}

uint64_t srv_frame_memory_of(enum sp_image_format format, const uint32_t size[2]) {
    const bool has_depth = format == SP_IMAGE_EXR;
    const uint64_t color = sp_image_format_info(format)->wants_float ? 16 : 4;
    const uint64_t pixel = color + (has_depth ? 2 * sizeof(float) : 0);
    const uint64_t padding = (has_depth ? 3 : 1) * 64; /* of each row, and of the frame */
    return (size[0] * pixel + padding) * size[1] + padding * 16 + sp_encode_bytes(format, size);
}
