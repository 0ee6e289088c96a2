/* SPDX-License-Identifier: Apache-2.0
 *
 * Writes the blocks of a tile to the frame.
 */
#include "frame/resolve.h"

#include <string.h>

#include "draw/resample/depth.h"

/* A row of pixels of the tile: moments, base and factor (frame/depth.h). */
struct depth_row {
    _Alignas(64) float moment[2][RESAMPLE_TILE], place[2][RESAMPLE_TILE];
};

/* Fills the part of a row that row y of a block has. */
static void fill_depth(const struct sp_resample_open_tile *t, const struct sp_resample_block *block,
                       int y, struct depth_row *row) {
    const int x = block->at[0], i = y * RESAMPLE_BLOCK;
    const double origin = isnan(block->origin) ? 0 : (double)block->origin;
    const double right = t->x + x + 0.5 - t->r->camera->centre[0];
    const double down = t->y + block->at[1] + y + 0.5 - t->r->camera->centre[1];
    const double sign = t->is_backwards ? -1 : 1;
    double step[2], next[2], below[2]; /* of the row's first pixel, and of those beside it */
    float ahead[2], across[2][2];
    sp_resample_depth_steps(t, right, down, step);
    sp_resample_depth_steps(t, right + 1, down, next);
    sp_resample_depth_steps(t, right, down + 1, below);
    ahead[0] = (float)((double)t->reference + sign * origin - step[0]);
    ahead[1] = (float)step[1];
    for (int a = 0; a < 2; a++) {
        across[0][a] = (float)(next[a] - step[a]);
        across[1][a] = (float)(below[a] - step[a]);
        memcpy(row->moment[a] + x, block->moment[a] + i, RESAMPLE_BLOCK * sizeof(float));
    }
    for (int k = 0; k < RESAMPLE_BLOCK; k++) {
        const float px = (float)k + (block->is_crossed ? block->moved[0][i + k] : 0);
        const float py = block->is_crossed ? block->moved[1][i + k] : 0;
        const float inverse = 1 / (ahead[1] + px * across[0][1] + py * across[1][1]);
        row->place[0][x + k] = (ahead[0] - px * across[0][0] - py * across[1][0]) * inverse;
        row->place[1][x + k] = (float)sign * inverse;
    }
}

/* Writes the depth of row y of the tile. light: transmittances. */
static void resolve_depth(const struct sp_resample_open_tile *t, int y, const float *light,
                          const struct depth_row *row) {
    const struct sp_frame *frame = t->r->frame;
    const size_t at = (size_t)(t->y + y);
    const float *const planes[3] = { light, row->moment[0], row->moment[1] };
    const float *const places[2] = { row->place[0], row->place[1] };
    sp_depth_resolve(planes, places, (uint32_t)t->width,
                     sp_depth_row(frame, frame->depth, at) + t->x,
                     sp_depth_row(frame, frame->spread, at) + t->x);
}

void sp_resample_resolve(const struct sp_resample_open_tile *t, uint64_t drawn) {
    struct sp_frame *frame = t->r->frame;
    const float *background = t->r->view->background;
    _Alignas(64) float row[4][RESAMPLE_TILE];
    const float *const planes[4] = { row[0], row[1], row[2], row[3] };
    const float none[RESAMPLE_BLOCK] = { 0 }, light[RESAMPLE_BLOCK] = { 1, 1, 1, 1, 1, 1, 1, 1 };
    struct depth_row depth;
    if (frame->depth)
        memset(&depth, 0, sizeof depth); /* of blocks that are not drawn */
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
            if (frame->depth && is_drawn)
                fill_depth(t, block, y % RESAMPLE_BLOCK, &depth);
        }
        if (frame->depth)
            resolve_depth(t, y, row[0], &depth);
        if (frame->format == SP_RGBA8)
            sp_resolve_rgba8(planes, (uint32_t)t->width, background, out + 4 * (size_t)t->x);
        else
            sp_resolve_rgbaf32(planes, (uint32_t)t->width, background,
                               (float *)(void *)out + 4 * (size_t)t->x);
    }
}
