/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/cut.h"

#include <math.h>
#include <string.h>

#include "tile/order.h"

/* A brick that is drawn. */
struct gl_item {
    uint32_t brick;        /* of its level */
    uint32_t first, count; /* entries of its list */
    uint8_t level;
    bool is_enlarged;
    int64_t near, far; /* layers that it may have entries in: [near, far] */
    /* By distance: a sphere around its voxels' centres. World units. */
    struct sp_vec3 centre;
    double radius;
};

void gl_cut_init(struct gl_cut *cut) {
    *cut = (struct gl_cut){ 0 };
    sp_arena_init(&cut->kept);
    sp_arena_init(&cut->pieces);
}

void gl_cut_finish(struct gl_cut *cut) {
    sp_arena_finish(&cut->kept);
    sp_arena_finish(&cut->pieces);
}

static bool fail_memory(const struct sp_arena *arena, struct sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, "", "no memory for the frame's %s", arena->failed);
}

static void write_list_made(const struct gl_cut_source *from, uint64_t made[SP_LEVELS]) {
    for (unsigned l = 0; l < SP_LEVELS; l++)
        made[l] = from->lists[l] ? from->lists[l]->list_made : 0;
}

/* Whether the items are those of the source. */
static bool is_kept(const struct gl_cut *cut, const struct gl_cut_source *from, unsigned axis) {
    uint64_t made[SP_LEVELS];
    write_list_made(from, made);
    if (cut->volume != from->volume || cut->axis != axis ||
        memcmp(made, cut->list_made, sizeof made) != 0)
        return false;
    if (axis == SP_NO_AXIS)
        return cut->level == from->level && cut->is_enlarged == from->is_enlarged;
    if (cut->detail.count != from->detail->count)
        return false;
    for (uint32_t i = 0; i < cut->detail.count; i++) {
        const struct sp_detail_brick *a = &cut->detail.bricks[i], *b = &from->detail->bricks[i];
        if (a->brick != b->brick || a->level != b->level || a->is_enlarged != b->is_enlarged)
            return false;
    }
    return true;
}

static void add_item(struct gl_cut *cut, const struct gl_list *list, uint32_t brick, unsigned level,
                     bool is_enlarged) {
    uint64_t count = list->first[brick + 1] - list->first[brick];
    cut->entries += count;
    if (count)
        cut->items[cut->item_count++] = (struct gl_item){ .brick = brick,
                                                          .first = (uint32_t)list->first[brick],
                                                          .count = (uint32_t)count,
                                                          .level = (uint8_t)level,
                                                          .is_enlarged = is_enlarged };
}

static bool keep_detail(struct gl_cut *cut, const struct sp_detail *detail) {
    cut->detail = *detail;
    cut->detail.bricks =
        sp_arena_alloc(&cut->kept, "bricks by level", detail->count, sizeof *detail->bricks);
    if (cut->detail.bricks)
        memcpy(cut->detail.bricks, detail->bricks, detail->count * sizeof *detail->bricks);
    return cut->detail.bricks != NULL;
}

/* Bricks of the cut through the levels, those of a level together. */
static void add_detail(struct gl_cut *cut, const struct gl_cut_source *from) {
    for (unsigned l = 0; cut->detail.levels >> l; l++)
        for (uint32_t i = 0; cut->detail.levels >> l & 1 && i < cut->detail.count; i++) {
            const struct sp_detail_brick *brick = &cut->detail.bricks[i];
            if (brick->level == l)
                add_item(cut, from->lists[l], brick->brick, l, brick->is_enlarged);
        }
}

/* The sphere around the centres of a brick's voxels. */
static void enclose(const struct gl_list *list, struct gl_item *item) {
    const struct sp_grid *grid = &list->grid;
    struct sp_vec3 half[3];
    uint32_t corner[3];
    gl_list_corner(list, item->brick, corner);
    item->centre = sp_vec3_from(grid->origin);
    for (unsigned a = 0; a < 3; a++) {
        uint32_t last = corner[a] + SP_BRICK - 1;
        last = last < grid->dims[a] ? last : grid->dims[a] - 1;
        double low = sp_grid_distance(grid, a, corner[a]), high = sp_grid_distance(grid, a, last);
        for (int r = 0; r < 3; r++) {
            item->centre.v[r] += 0.5 * (low + high) * grid->direction[r][a];
            half[a].v[r] = 0.5 * (high - low) * grid->direction[r][a];
        }
    }
    for (int i = 0; i < 4; i++) { /* diagonals */
        struct sp_vec3 to = half[2];
        to = i & 1 ? sp_vec3_add(to, half[0]) : sp_vec3_sub(to, half[0]);
        to = i & 2 ? sp_vec3_add(to, half[1]) : sp_vec3_sub(to, half[1]);
        item->radius = fmax(item->radius, sp_vec3_length(to));
    }
}

static bool list_items(struct gl_cut *cut, const struct gl_cut_source *from, unsigned axis,
                       struct sp_error *err) {
    const struct gl_list *list = from->lists[from->level];
    uint32_t most = axis == SP_NO_AXIS ? gl_list_bricks(list) : from->detail->count;
    sp_arena_reset(&cut->kept);
    cut->volume = NULL; /* until all is there */
    cut->is_cut = false;
    cut->item_count = 0;
    cut->entries = 0;
    cut->sheet_count = 0;
    cut->items = sp_arena_alloc(&cut->kept, "bricks", most, sizeof *cut->items);
    if (!cut->items || (axis != SP_NO_AXIS && !keep_detail(cut, from->detail)))
        return fail_memory(&cut->kept, err);
    if (axis != SP_NO_AXIS)
        add_detail(cut, from);
    for (uint32_t b = 0; axis == SP_NO_AXIS && b < most; b++)
        add_item(cut, list, b, from->level, from->is_enlarged);
    for (uint32_t i = 0; axis == SP_NO_AXIS && i < cut->item_count; i++)
        enclose(list, &cut->items[i]);
    write_list_made(from, cut->list_made);
    cut->axis = axis;
    cut->level = from->level;
    cut->is_enlarged = from->is_enlarged;
    cut->volume = from->volume;
    return true;
}

/* The sheets that a brick has slices in. */
static void find_sheets(const struct gl_cut *cut, const struct gl_list *list,
                        struct gl_item *item) {
    uint32_t corner[3], first, dim = list->grid.dims[cut->axis];
    gl_list_corner(list, item->brick, corner);
    first = corner[cut->axis];
    item->near = INT64_MAX;
    item->far = 0;
    for (uint32_t s = first; s < first + SP_BRICK && s < dim; s++) {
        int64_t layer = sp_slices_layer(cut->sheets, cut->sheet_count, item->level, s);
        item->near = layer < item->near ? layer : item->near;
        item->far = layer > item->far ? layer : item->far;
    }
}

bool gl_cut_sheets(struct gl_cut *cut, const struct gl_cut_source *from, unsigned axis,
                   const uint32_t *sheets, uint32_t count, struct sp_error *err) {
    if (!is_kept(cut, from, axis) && !list_items(cut, from, axis, err))
        return false;
    if (cut->sheet_count == count && memcmp(cut->sheets, sheets, count * sizeof *sheets) == 0)
        return true;
    if (cut->sheet_count != count) /* just listed */
        cut->sheets = sp_arena_alloc(&cut->kept, "order of sheets", count, sizeof *cut->sheets);
    cut->sheet_count = cut->layer_count = cut->sheets ? count : 0;
    cut->is_cut = cut->is_cut && cut->is_whole;
    cut->sheets_made++;
    if (!cut->sheets)
        return fail_memory(&cut->kept, err);
    memcpy(cut->sheets, sheets, count * sizeof *sheets);
    for (uint32_t i = 0; i < cut->item_count; i++)
        find_sheets(cut, from->lists[cut->items[i].level], &cut->items[i]);
    return true;
}

/* Layers that kernels of a brick may lie in, counted from the eye: those of the sphere around it,
 * and one more on either side for rounding. */
static void find_distances(const struct gl_cut_depth *depth, struct gl_item *item) {
    const struct sp_camera_frame *camera = depth->camera;
    struct sp_vec3 away = sp_vec3_sub(item->centre, camera->eye);
    double distance = camera->projection == SP_PERSPECTIVE
                          ? sp_vec3_length(away)
                          : sp_vec3_dot(away, sp_vec3_from(camera->w.m[2]));
    double far = fmin(distance + item->radius, depth->farthest) + depth->reach;
    double near = fmin(distance - item->radius, depth->farthest) - depth->reach;
    near = fmax(near, -depth->farthest);
    item->near = (int64_t)floor(near / depth->thickness) - 1;
    item->far = (int64_t)floor(fmax(near, far) / depth->thickness) + 1;
}

bool gl_cut_distances(struct gl_cut *cut, const struct gl_cut_source *from,
                      const struct gl_cut_depth *depth, struct sp_error *err) {
    int64_t near = INT64_MAX, far = INT64_MIN;
    if (!is_kept(cut, from, SP_NO_AXIS) && !list_items(cut, from, SP_NO_AXIS, err))
        return false;
    for (uint32_t i = 0; i < cut->item_count; i++) {
        struct gl_item *item = &cut->items[i];
        find_distances(depth, item);
        near = item->near < near ? item->near : near;
        far = item->far > far ? item->far : far;
    }
    for (uint32_t i = 0; i < cut->item_count; i++) {
        cut->items[i].near -= near;
        cut->items[i].far -= near;
    }
    cut->nearest = cut->item_count ? near : 0;
    cut->layer_count = cut->item_count ? (uint32_t)(far - near + 1) : 0;
    cut->is_cut = cut->is_cut && cut->is_whole;
    return true;
}

/* Adds the brick's chunks to the batch. Only counts where there is no memory yet. */
static void add_chunks(struct gl_cut *cut, const struct gl_item *item, struct gl_batch *batch) {
    uint32_t part = 2u * item->level + item->is_enlarged;
    if (!batch->chunks[item->level])
        batch->chunk[item->level] = cut->chunk_count;
    for (uint32_t at = 0, n; at < item->count; at += n) {
        n = item->count - at < GL_GROUP ? item->count - at : GL_GROUP;
        if (cut->chunks)
            cut->chunks[cut->chunk_count] =
                (struct gl_chunk){ item->first + at, item->brick, n | part << 16, batch->records };
        cut->chunk_count++;
        batch->chunks[item->level]++;
        batch->records += n;
    }
}

static void add_batch(struct gl_cut *cut, const struct gl_batch *batch) {
    if (cut->batches)
        cut->batches[cut->batch_count] = *batch;
    cut->batch_count++;
}

/* Adds the batches of layers [begin, end): one, unless its entries are more than a batch's records.
 */
static void add_batches(struct gl_cut *cut, uint32_t begin, uint32_t end) {
    struct gl_batch batch = { .first = begin, .layers = end - begin };
    for (uint32_t i = 0; i < cut->item_count; i++) {
        const struct gl_item *item = &cut->items[i];
        if (item->near >= end || item->far < begin)
            continue;
        if (batch.records + item->count > cut->records) {
            batch.stays_open = true;
            add_batch(cut, &batch);
            batch = (struct gl_batch){ .first = begin, .layers = end - begin, .resumes = true };
        }
        add_chunks(cut, item, &batch);
    }
    if (batch.records)
        add_batch(cut, &batch);
}

/* Entries of bricks with layers before k, and of those that end before k. */
struct sums {
    uint64_t *begun, *ended; /* [layer_count + 1] */
};

static bool sum_entries(struct gl_cut *cut, struct sums *s) {
    size_t n = (size_t)cut->layer_count + 1;
    s->begun = sp_arena_alloc(&cut->pieces, "entries by layer", n, sizeof *s->begun);
    s->ended = sp_arena_alloc(&cut->pieces, "entries by layer", n, sizeof *s->ended);
    if (cut->pieces.failed)
        return false;
    memset(s->begun, 0, n * sizeof *s->begun);
    memset(s->ended, 0, n * sizeof *s->ended);
    for (uint32_t i = 0; i < cut->item_count; i++) {
        s->begun[cut->items[i].near + 1] += cut->items[i].count;
        s->ended[cut->items[i].far + 1] += cut->items[i].count;
    }
    for (size_t k = 1; k < n; k++) {
        s->begun[k] += s->begun[k - 1];
        s->ended[k] += s->ended[k - 1];
    }
    return true;
}

static void make_batches(struct gl_cut *cut, const struct sums *s) {
    cut->batch_count = cut->chunk_count = 0;
    for (uint32_t begin = 0, end; begin < cut->layer_count; begin = end) {
        for (end = begin + 1; end < cut->layer_count && end - begin < cut->layers; end++)
            if (s->begun[end + 1] - s->ended[begin] > cut->records)
                break;
        if (s->begun[end] > s->ended[begin])
            add_batches(cut, begin, end);
    }
}

bool gl_cut_make(struct gl_cut *cut, uint32_t layers, uint32_t records, struct sp_error *err) {
    bool is_whole = cut->layer_count <= layers && cut->entries <= records;
    struct sums s;
    if (cut->is_cut && is_whole && cut->is_whole) {
        for (uint32_t i = 0; i < cut->batch_count; i++)
            cut->batches[i].layers = cut->layer_count;
        return true;
    }
    if (cut->is_cut && !cut->is_whole && layers == cut->layers && records == cut->records)
        return true;
    sp_arena_reset(&cut->pieces);
    cut->is_cut = false;
    cut->is_whole = is_whole;
    cut->layers = layers;
    cut->records = records;
    cut->batches = NULL;
    cut->chunks = NULL;
    cut->chunks_made++;
    if (!sum_entries(cut, &s))
        return fail_memory(&cut->pieces, err);
    make_batches(cut, &s);
    cut->chunks = sp_arena_alloc(&cut->pieces, "bricks", cut->chunk_count, sizeof *cut->chunks);
    cut->batches = sp_arena_alloc(&cut->pieces, "batches", cut->batch_count, sizeof *cut->batches);
    if (cut->pieces.failed)
        return fail_memory(&cut->pieces, err);
    make_batches(cut, &s);
    cut->is_cut = true;
    return true;
}
