/* SPDX-License-Identifier: Apache-2.0 */
#include "tile/insert.h"

#include <math.h>

#include "splat/slices.h"
#include "volume/grid.h"

bool sp_insert_init_sheets(struct sp_insert *insert, const struct sp_grid *grid, unsigned axis,
                           struct sp_arena *arena) {
    const unsigned u = (axis + 1) % 3, v = (axis + 2) % 3;
    struct sp_vec3 column[3], to_origin;
    uint32_t count = grid->dims[axis];
    for (unsigned a = 0; a < 3; a++)
        column[a] = (struct sp_vec3){ { grid->direction[0][a], grid->direction[1][a],
                                        grid->direction[2][a] } };
    struct sp_vec3 normal = sp_vec3_normalize(sp_vec3_cross(column[u], column[v]));
    if (sp_vec3_dot(normal, column[axis]) < 0)
        normal = sp_vec3_scale(normal, -1);
    to_origin = sp_vec3_sub(sp_vec3_from(grid->origin), insert->camera->eye);
    uint32_t *sorted = sp_arena_alloc(arena, "order of sheets", count, sizeof *sorted);
    uint32_t *layer = sp_arena_alloc(arena, "layers of sheets", count, sizeof *layer);
    double *offset = sp_arena_alloc(arena, "planes of sheets", count, sizeof *offset);
    if (arena->failed)
        return false;
    sp_slices_sort(insert->camera, grid, axis, sorted);
    for (uint32_t k = 0; k < count; k++)
        layer[sorted[k]] = k;
    for (uint32_t i = 0; i < count; i++)
        offset[i] = sp_vec3_dot(normal, to_origin) +
                    sp_grid_distance(grid, axis, i) * sp_vec3_dot(normal, column[axis]);
    for (int r = 0; r < 3; r++)
        insert->normal[r] = sp_vec3_dot(sp_vec3_from(insert->camera->w.m[r]), normal);
    insert->offset = offset;
    insert->layer = layer;
    insert->slices = count;
    return true;
}

/* The first sheet behind a point of a ray: of the slices that the ray crosses from there on. */
static uint32_t sheet_behind(const struct sp_insert *insert, const double ray[3],
                             const double point[3]) {
    double rise = 0, at = 0;
    uint32_t low = 0, high = insert->slices;
    for (int r = 0; r < 3; r++) {
        rise += insert->normal[r] * ray[r];
        at += insert->normal[r] * point[r];
    }
    while (low < high) { /* the first slice at or beyond the point */
        uint32_t middle = low + (high - low) / 2;
        if (insert->offset[middle] < at)
            low = middle + 1;
        else
            high = middle;
    }
    if (rise < 0)
        return low > 0 ? insert->layer[low - 1] : UINT32_MAX;
    return low < insert->slices ? insert->layer[low] : UINT32_MAX;
}

/* The first layer whose middle is behind a depth on the ray of pixel (x, y) of the image. */
static uint32_t layer_behind(const struct sp_insert *insert, int x, int y, double depth) {
    const struct sp_camera_transform *camera = insert->camera;
    bool is_perspective = camera->projection == SP_PERSPECTIVE;
    double aside[2] = { (x + 0.5 - camera->centre[0]) / camera->scale,
                        (y + 0.5 - camera->centre[1]) / camera->scale };
    double ray[3] = { 0, 0, 1 }, point[3] = { aside[0], aside[1], depth };
    for (int a = 0; is_perspective && a < 2; a++) {
        ray[a] = aside[a];
        point[a] = aside[a] * depth;
    }
    if (insert->offset)
        return sheet_behind(insert, ray, point);
    double distance = depth * sqrt(ray[0] * ray[0] + ray[1] * ray[1] + 1);
    double number = ceil((distance - insert->nearest) / insert->thickness - 0.5);
    return number < 0 ? 0 : number < UINT32_MAX ? (uint32_t)number : UINT32_MAX;
}

/* The fragments of a pixel of the tile. */
static const struct sp_fragment *find(const struct sp_tile *tile, const struct sp_insert *insert,
                                      int i, uint32_t *count) {
    const struct sp_fragments *all = insert->fragments;
    int x = tile->x + i % SP_TILE, y = tile->y + i / SP_TILE;
    *count = 0;
    if (x >= all->columns * SP_FRAGMENT_TILE || y >= all->rows * SP_FRAGMENT_TILE)
        return NULL;
    return sp_fragments_at(all, x, y, count);
}

static void set_next(struct sp_tile *tile, const struct sp_insert *insert, int i, uint8_t next) {
    uint32_t count;
    const struct sp_fragment *list = find(tile, insert, i, &count);
    tile->insert->next[i] = next;
    tile->insert->layer[i] = next < count
                                 ? layer_behind(insert, tile->x + i % SP_TILE,
                                                tile->y + i / SP_TILE, (double)list[next].depth)
                                 : UINT32_MAX;
}

void sp_insert_open(struct sp_tile *tile, const struct sp_insert *insert) {
    for (int i = 0; i < SP_TILE_AREA; i++)
        set_next(tile, insert, i, 0);
}

/* Composites the next fragment of pixel i. */
static void composite(struct sp_tile *tile, const struct sp_insert *insert, int i) {
    uint32_t count;
    const struct sp_fragment *fragment = find(tile, insert, i, &count) + tile->insert->next[i];
    float *through = &tile->done[0][0][0] + i;
    for (int c = 0; c < 3; c++)
        through[(c + 1) * SP_TILE_AREA] += *through * fragment->color[c];
    *through *= 1 - fragment->alpha;
    set_next(tile, insert, i, (uint8_t)(tile->insert->next[i] + 1));
}

void sp_insert_before(struct sp_tile *tile, const struct sp_insert *insert,
                      const struct sp_box *box, uint32_t layer) {
    const uint32_t *behind = tile->insert->layer;
    for (int y = box->y0; y < box->y1; y++)
        for (int i = y * SP_TILE + box->x0; i < y * SP_TILE + box->x1; i++)
            while (behind[i] <= layer)
                composite(tile, insert, i);
}

void sp_insert_rest(struct sp_tile *tile, const struct sp_insert *insert) {
    for (int i = 0; i < SP_TILE_AREA; i++) {
        uint32_t count;
        find(tile, insert, i, &count);
        while (tile->insert->next[i] < count)
            composite(tile, insert, i);
    }
}
