/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/footprints/insert.h"

#include <math.h>

#include "data/volume/grid.h"
#include "draw/footprints/tile_depth.h"
#include "splat/slices.h"

bool sp_insert_init_sheets(struct sp_insert *insert, const struct sp_grid *grid, unsigned axis,
                           struct sp_arena *arena) {
    const unsigned u = (axis + 1) % 3, v = (axis + 2) % 3;
    struct sp_vec3 column[3], to_origin;
    uint32_t count = grid->dims[axis];
    double extent[2];
    for (unsigned a = 0; a < 3; a++)
        column[a] = (struct sp_vec3){ { grid->direction[0][a], grid->direction[1][a],
                                        grid->direction[2][a] } };
    struct sp_vec3 normal = sp_vec3_normalize(sp_vec3_cross(column[u], column[v]));
    if (sp_vec3_dot(normal, column[axis]) < 0)
        normal = sp_vec3_scale(normal, -1);
    to_origin = sp_vec3_sub(sp_vec3_from(grid->origin), insert->camera->eye);
    uint32_t *sorted = sp_arena_alloc(arena, "order of sheets", count, sizeof *sorted);
    uint32_t *layer = sp_arena_alloc(arena, "layers of sheets", count, sizeof *layer);
    double *offset = sp_arena_alloc(arena, "planes of sheets", count + 1, sizeof *offset);
    if (arena->failed)
        return false;
    sp_slices_sort(insert->camera, grid, axis, sorted);
    for (uint32_t k = 0; k < count; k++)
        layer[sorted[k]] = k;
    sp_grid_extent(grid, axis, extent);
    for (uint32_t i = 0; i <= count; i++) {
        double along = i == 0       ? extent[0]
                       : i == count ? extent[1]
                                    : sp_grid_distance(grid, axis, i - 1) / 2 +
                                          sp_grid_distance(grid, axis, i) / 2;
        offset[i] = sp_vec3_dot(normal, to_origin) + along * sp_vec3_dot(normal, column[axis]);
    }
    for (int r = 0; r < 3; r++)
        insert->normal[r] = sp_vec3_dot(sp_vec3_from(insert->camera->w.m[r]), normal);
    insert->offset = offset;
    insert->layer = layer;
    insert->planes = count + 1;
    return true;
}

/* A point among the layers of a ray. */
struct place {
    uint32_t layer; /* that it lies in, or the first one behind it; UINT32_MAX = there is none */
    double share;   /* of that layer in front of it, [0, 1] */
};

static struct place place_in_sheets(const struct sp_insert *insert, const double ray[3],
                                    const double point[3]) {
    const uint32_t last = insert->planes - 1;
    double rise = 0, at = 0;
    uint32_t low = 0, high = insert->planes;
    for (int r = 0; r < 3; r++) {
        rise += insert->normal[r] * ray[r];
        at += insert->normal[r] * point[r];
    }
    while (low < high) { /* the first plane beyond the point */
        uint32_t middle = low + (high - low) / 2;
        if (insert->offset[middle] <= at)
            low = middle + 1;
        else
            high = middle;
    }
    if (low == (rise < 0 ? 0 : insert->planes))
        return (struct place){ .layer = UINT32_MAX };
    if (low == 0 || low == insert->planes)
        return (struct place){ .layer = insert->layer[low == 0 ? 0 : last - 1] };
    double before = at - insert->offset[low - 1], behind = insert->offset[low] - at;
    return (struct place){ .layer = insert->layer[low - 1],
                           .share = (rise < 0 ? behind : before) / (before + behind) };
}

static uint32_t limit_layer(double number) {
    return !(number >= 0) ? 0 : number < UINT32_MAX ? (uint32_t)number : UINT32_MAX;
}

/* A fragment divides splats as long as their kernels reach it, or the next fragment is nearer to
 * them. */
static struct place place_in_splats(const struct sp_insert *insert, double distance, double next) {
    double end = fmin(distance + insert->reach, 0.5 * (distance + next));
    return (struct place){ .layer =
                               limit_layer(ceil((end - insert->nearest) / insert->thickness - 0.5)),
                           .share = distance / insert->unit };
}

/* Where the first of `count` fragments on the ray of pixel (x, y) of the image lies. */
static struct place compute_place(const struct sp_insert *insert, int x, int y,
                                  const struct sp_fragment *list, uint32_t count) {
    const struct sp_camera_transform *camera = insert->camera;
    bool is_perspective = camera->projection == SP_PERSPECTIVE;
    double aside[2] = { (x + 0.5 - camera->centre[0]) / camera->scale,
                        (y + 0.5 - camera->centre[1]) / camera->scale };
    double depth = (double)list->depth, ray[3] = { 0, 0, 1 },
           point[3] = { aside[0], aside[1], depth };
    for (int a = 0; is_perspective && a < 2; a++) {
        ray[a] = aside[a];
        point[a] = aside[a] * depth;
    }
    if (insert->planes)
        return place_in_sheets(insert, ray, point);
    double length = sqrt(ray[0] * ray[0] + ray[1] * ray[1] + 1);
    if (insert->has_splats)
        return place_in_splats(insert, depth * length,
                               count > 1 ? (double)list[1].depth * length : INFINITY);
    double number = (depth * length - insert->nearest) / insert->thickness;
    return (struct place){ .layer = limit_layer(number),
                           .share =
                               number >= 0 && number < UINT32_MAX ? number - floor(number) : 0 };
}

/* The fragments of a pixel of the tile. */
static const struct sp_fragment *
find_fragments(const struct sp_tile *tile, const struct sp_insert *insert, int i, uint32_t *count) {
    const struct sp_fragments *all = insert->fragments;
    int x = tile->x + i % SP_TILE, y = tile->y + i / SP_TILE;
    *count = 0;
    if (x >= all->columns * SP_FRAGMENT_TILE || y >= all->rows * SP_FRAGMENT_TILE)
        return NULL;
    return sp_fragments_at(all, x, y, count);
}

static void set_next(struct sp_tile *tile, const struct sp_insert *insert, int i, uint8_t next) {
    uint32_t count;
    const struct sp_fragment *list = find_fragments(tile, insert, i, &count);
    struct place place = { .layer = UINT32_MAX, .share = 1e30 };
    if (next < count)
        place = compute_place(insert, tile->x + i % SP_TILE, tile->y + i / SP_TILE, list + next,
                              count - next);
    tile->insert->next[i] = next;
    tile->insert->layer[i] = place.layer;
    tile->insert->share[i] = (float)place.share;
}

void sp_insert_open(struct sp_tile *tile, const struct sp_insert *insert) {
    for (int i = 0; i < SP_TILE_AREA; i++)
        set_next(tile, insert, i, 0);
}

/* Composites the shares of splats that lie behind the fragment of pixel i, at depth z. */
static void composite_behind(struct sp_tile *tile, int i, float z) {
    float *through = &tile->done[0][0][0] + i;
    float *behind = tile->sums + (size_t)(i / SP_TILE) * SP_PLANES * SP_TILE + i % SP_TILE;
    for (int p = 1; p < SP_PLANES; p++)
        through[p * SP_TILE_AREA] += *through * behind[p * SP_TILE];
    if (tile->depth)
        sp_tile_depth_add(tile, i, *through * behind[0], z);
    *through *= 1 - behind[0];
    for (int p = 0; p < SP_PLANES; p++)
        behind[p * SP_TILE] = 0;
}

/* Composites the next fragment of pixel i. */
static void composite(struct sp_tile *tile, const struct sp_insert *insert, int i) {
    uint32_t count;
    const struct sp_fragment *fragment =
        find_fragments(tile, insert, i, &count) + tile->insert->next[i];
    float *through = &tile->done[0][0][0] + i;
    for (int c = 0; c < 3; c++)
        through[(c + 1) * SP_TILE_AREA] += *through * fragment->color[c];
    if (tile->depth)
        sp_tile_depth_add(tile, i, *through * fragment->alpha, fragment->depth);
    *through *= 1 - fragment->alpha;
    if (insert->has_splats)
        composite_behind(tile, i, fragment->depth);
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

/* Composites the part of T and E of pixel i in front of a point, and leaves the rest. */
static void composite_part(struct sp_tile *tile, uint32_t layer, int i, bool linear, float part,
                           float *sum) {
    float *through = &tile->done[0][0][0] + i;
    float t = part * *sum, alpha = linear ? fminf(t, 1) : -expm1f(-t);
    float f = t > 0 ? *through * alpha / t : 0;
    for (int p = 1; p < SP_PLANES; p++)
        through[p * SP_TILE_AREA] += f * part * sum[p * SP_TILE];
    if (tile->depth)
        sp_tile_depth_add_layer(tile->depth, i, *through * alpha, layer);
    *through *= 1 - alpha;
    for (int p = 0; p < SP_PLANES; p++)
        sum[p * SP_TILE] *= 1 - part;
}

void sp_insert_row(struct sp_tile *tile, const struct sp_insert *insert, uint32_t layer, int y,
                   int begin, int end, bool linear, float *sum) {
    const struct sp_tile_insert *own = tile->insert;
    for (int x = begin, i = y * SP_TILE + begin; x < end; x++, i++)
        for (float done = 0; own->layer[i] <= layer;) {
            float share = own->layer[i] == layer ? own->share[i] : 0;
            if (share > done) {
                composite_part(tile, layer, i, linear, (share - done) / (1 - done), sum + x);
                done = share;
            }
            composite(tile, insert, i);
        }
}

void sp_insert_rest(struct sp_tile *tile, const struct sp_insert *insert) {
    for (int i = 0; i < SP_TILE_AREA; i++) {
        uint32_t count;
        find_fragments(tile, insert, i, &count);
        while (tile->insert->next[i] < count)
            composite(tile, insert, i);
    }
}
