/* SPDX-License-Identifier: Apache-2.0
 *
 * Writes the blocks of a tile to the frame.
 */
#include "frame/resolve.h"

#include <string.h>

#include "draw/resample/kernels.h"

void sp_resample_resolve(const struct sp_resample_open_tile *t, uint64_t drawn) {
    struct sp_frame *frame = t->r->frame;
    const float *background = t->r->view->background;
    _Alignas(64) float row[4][RESAMPLE_TILE];
    const float *const planes[4] = { row[0], row[1], row[2], row[3] };
    const float none[RESAMPLE_BLOCK] = { 0 }, light[RESAMPLE_BLOCK] = { 1, 1, 1, 1, 1, 1, 1, 1 };
    for (int y = 0; y < t->height; y++) {
        unsigned char *out =
            (unsigned char *)frame->pixels + (size_t)(t->y + y) * frame->stride_bytes;
        for (int x = 0; x < t->width; x += RESAMPLE_BLOCK) {
            int b = y / RESAMPLE_BLOCK * RESAMPLE_ACROSS_MAX + x / RESAMPLE_BLOCK;
            int i = y % RESAMPLE_BLOCK * RESAMPLE_BLOCK;
            const struct sp_resample_block *block = &t->scratch->blocks[b];
            bool is_drawn = drawn >> b & 1;
            memcpy(row[0] + x, is_drawn ? block->light + i : light, sizeof light);
            for (int c = 0; c < 3; c++)
                memcpy(row[c + 1] + x, is_drawn ? block->color[c] + i : none, sizeof none);
        }
        if (frame->format == SP_RGBA8)
            sp_resolve_rgba8(planes, (uint32_t)t->width, background, out + 4 * (size_t)t->x);
        else
            sp_resolve_rgbaf32(planes, (uint32_t)t->width, background,
                               (float *)(void *)out + 4 * (size_t)t->x);
    }
}
