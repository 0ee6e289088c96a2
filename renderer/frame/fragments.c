/* SPDX-License-Identifier: Apache-2.0 */
#include "frame/fragments.h"

#include <math.h>
#include <string.h>

void sp_fragment_tile_clear(struct sp_fragment_tile *tile, int x, int y) {
    tile->x = x;
    tile->y = y;
    memset(tile->count, 0, sizeof tile->count);
}

/* Merges `behind` into `front`, which keeps its depth. */
static void merge(struct sp_fragment *front, const struct sp_fragment *behind) {
    float through = 1 - front->alpha;
    for (int c = 0; c < 3; c++)
        front->color[c] += through * behind->color[c];
    front->alpha += through * behind->alpha;
}

/* An error counts as smaller only if it is smaller by this factor. If two errors differ only by
 * rounding, all backends therefore choose the first pair. */
#define CLEARLY 0.999f

/* Returns the index of the pair of neighbours to merge: the pair with the smallest error. Matter of
 * other layers between the two is then seen through both of them, or through neither. */
static int find_pair(const struct sp_fragment *list, int count) {
    float through = 1, least = INFINITY;
    int found = count - 2;
    for (int i = 0; i + 1 < count; i++) {
        through *= 1 - list[i].alpha;
        float error = through * list[i + 1].alpha * (list[i + 1].depth - list[i].depth);
        if (error < CLEARLY * least) {
            least = error;
            found = i;
        }
    }
    return found;
}

void sp_fragment_insert(struct sp_fragment_tile *tile, int pixel,
                        const struct sp_fragment *fragment) {
    struct sp_fragment *list = tile->list[pixel];
    int count = tile->count[pixel], at = count;
    while (at > 0 && fragment->depth < list[at - 1].depth)
        at--;
    if (at == SP_FRAGMENTS_MAX) {
        merge(&list[at - 1], fragment);
        return;
    }
    memmove(list + at + 1, list + at, (size_t)(count - at) * sizeof *list);
    list[at] = *fragment;
    if (count < SP_FRAGMENTS_MAX) {
        tile->count[pixel] = (uint8_t)(count + 1);
        return;
    }
    int pair = find_pair(list, count + 1);
    merge(&list[pair], &list[pair + 1]);
    memmove(list + pair + 1, list + pair + 2, (size_t)(count - pair - 1) * sizeof *list);
}

bool sp_fragments_init(struct sp_fragments *fragments, const uint32_t size[2],
                       struct sp_arena *arena) {
    fragments->columns = (int)((size[0] + SP_FRAGMENT_TILE - 1) / SP_FRAGMENT_TILE);
    fragments->rows = (int)((size[1] + SP_FRAGMENT_TILE - 1) / SP_FRAGMENT_TILE);
    size_t tiles = (size_t)fragments->columns * (size_t)fragments->rows;
    fragments->first = sp_arena_alloc(arena, "fragments by tile", tiles, sizeof *fragments->first);
    fragments->list = sp_arena_alloc(arena, "fragments by tile", tiles, sizeof *fragments->list);
    if (!fragments->first || !fragments->list)
        return false;
    fragments->begin = 0;
    fragments->end = fragments->most = fragments->rows;
    fragments->ms = 0;
    sp_fragments_clear(fragments);
    return true;
}

void sp_fragments_clear(struct sp_fragments *fragments) {
    const size_t tiles = (size_t)fragments->columns * (size_t)fragments->rows;
    memset(fragments->first, 0, tiles * sizeof *fragments->first);
    memset(fragments->list, 0, tiles * sizeof *fragments->list);
}

void sp_fragments_limit(struct sp_fragments *fragments, size_t bytes) {
    const size_t tile_bytes =
        SP_FRAGMENT_PIXELS * (SP_FRAGMENTS_MAX * sizeof(struct sp_fragment) + sizeof(uint32_t));
    const size_t rows = bytes / tile_bytes / (size_t)fragments->columns;
    fragments->begin = fragments->end = 0;
    fragments->most = rows < 1 ? 1 : rows < (size_t)fragments->rows ? (int)rows : fragments->rows;
}

int sp_fragments_rows(const struct sp_fragments *fragments, int tile, int height) {
    const int all = (height + tile - 1) / tile * tile;
    if (!fragments || fragments->most == fragments->rows)
        return all;
    const int rows = fragments->most * SP_FRAGMENT_TILE / tile * tile;
    return rows < tile ? tile : rows < all ? rows : all;
}

bool sp_fragments_ensure(struct sp_fragments *fragments, int begin, int end, struct sp_error *err) {
    if (!fragments)
        return true;
    const int first = begin / SP_FRAGMENT_TILE;
    const int below = (end + SP_FRAGMENT_TILE - 1) / SP_FRAGMENT_TILE;
    const int last = below < fragments->rows ? below : fragments->rows;
    if (fragments->begin <= first && fragments->end >= last)
        return true;
    fragments->begin = fragments->end = 0;
    sp_fragments_clear(fragments);
    if (!fragments->fill(fragments->user, first, last, err))
        return false;
    fragments->begin = first;
    fragments->end = last;
    return true;
}

uint32_t sp_fragment_tile_count(const struct sp_fragment_tile *tile) {
    uint32_t count = 0;
    for (int i = 0; i < SP_FRAGMENT_PIXELS; i++)
        count += tile->count[i];
    return count;
}

void sp_fragments_store(struct sp_fragments *fragments, const struct sp_fragment_tile *tile,
                        uint32_t *first, struct sp_fragment *list) {
    int number = tile->y / SP_FRAGMENT_TILE * fragments->columns + tile->x / SP_FRAGMENT_TILE;
    uint32_t at = 0;
    for (int i = 0; i < SP_FRAGMENT_PIXELS; i++) {
        first[i] = at;
        memcpy(list + at, tile->list[i], tile->count[i] * sizeof *list);
        at += tile->count[i];
    }
    first[SP_FRAGMENT_PIXELS] = at;
    fragments->first[number] = first;
    fragments->list[number] = list;
}
