/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/partition.h"

#include <math.h>
#include <string.h>

#include "draw/footprints/order.h"

/* A brick that is drawn. */
struct gl_item {
    uint32_t brick;        /* of its level */
    uint32_t first, count; /* entries of its list */
    uint8_t level;
    bool is_enlarged;
    int64_t near, far; /* it may have entries in layers [near, far] */
    /* By distance: the sphere around its voxels' centres. World units. */
    struct sp_vec3 centre;
    double radius;
};

void gl_partition_init(struct gl_partition *partition, struct sp_budget *budget) {
    *partition = (struct gl_partition){ 0 };
    sp_arena_init(&partition->kept);
    sp_arena_init(&partition->pieces);
    partition->kept.budget = partition->pieces.budget = budget;
}

void gl_partition_finish(struct gl_partition *partition) {
    sp_arena_finish(&partition->kept);
    sp_arena_finish(&partition->pieces);
}

void gl_partition_trim(struct gl_partition *partition) {
    sp_arena_trim(&partition->kept);
    sp_arena_trim(&partition->pieces);
    partition->volume = NULL;
    partition->is_cut = false;
}

static void write_list_made(const struct gl_partition_source *from, uint64_t made[SP_LEVELS]) {
    for (unsigned l = 0; l < SP_LEVELS; l++)
        made[l] = from->lists[l] ? from->lists[l]->list_made : 0;
}

/* True if the items are up to date. */
static bool is_kept(const struct gl_partition *partition, const struct gl_partition_source *from,
                    unsigned axis) {
    uint64_t made[SP_LEVELS];
    write_list_made(from, made);
    if (partition->volume != from->volume || partition->axis != axis ||
        memcmp(made, partition->list_made, sizeof made) != 0)
        return false;
    if (axis == SP_NO_AXIS)
        return partition->level == from->level && partition->is_enlarged == from->is_enlarged;
    if (partition->detail.count != from->detail->count)
        return false;
    for (uint32_t i = 0; i < partition->detail.count; i++) {
        const struct sp_detail_brick *a = &partition->detail.bricks[i],
                                     *b = &from->detail->bricks[i];
        if (a->brick != b->brick || a->level != b->level || a->is_enlarged != b->is_enlarged)
            return false;
    }
    return true;
}

static void add_item(struct gl_partition *partition, const struct gl_visible_list *list,
                     uint32_t brick, unsigned level, bool is_enlarged) {
    uint64_t count = list->first[brick + 1] - list->first[brick];
    partition->entries += count;
    if (count)
        partition->items[partition->item_count++] =
            (struct gl_item){ .brick = brick,
                              .first = (uint32_t)list->first[brick],
                              .count = (uint32_t)count,
                              .level = (uint8_t)level,
                              .is_enlarged = is_enlarged };
}

static bool keep_detail(struct gl_partition *partition, const struct sp_detail *detail) {
    partition->detail = *detail;
    partition->detail.bricks =
        sp_arena_alloc(&partition->kept, "bricks by level", detail->count, sizeof *detail->bricks);
    if (partition->detail.bricks)
        memcpy(partition->detail.bricks, detail->bricks, detail->count * sizeof *detail->bricks);
    return partition->detail.bricks != NULL;
}

/* Adds the bricks of all levels, level by level. */
static void add_detail(struct gl_partition *partition, const struct gl_partition_source *from) {
    for (unsigned l = 0; partition->detail.levels >> l; l++)
        for (uint32_t i = 0; partition->detail.levels >> l & 1 && i < partition->detail.count;
             i++) {
            const struct sp_detail_brick *brick = &partition->detail.bricks[i];
            if (brick->level == l)
                add_item(partition, from->lists[l], brick->brick, l, brick->is_enlarged);
        }
}

/* Computes the sphere around the centres of a brick's voxels. */
static void enclose(const struct gl_visible_list *list, struct gl_item *item) {
    const struct sp_grid *grid = &list->grid;
    struct sp_vec3 half[3];
    uint32_t corner[3];
    sp_visible_brick_corner(list->bricks, item->brick, corner);
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

static bool list_items(struct gl_partition *partition, const struct gl_partition_source *from,
                       unsigned axis, struct sp_error *err) {
    const struct gl_visible_list *list = from->lists[from->level];
    uint32_t most = axis == SP_NO_AXIS ? sp_visible_brick_count(list->bricks) : from->detail->count;
    sp_arena_reset(&partition->kept);
    partition->volume = NULL; /* until the list is complete */
    partition->is_cut = false;
    partition->item_count = 0;
    partition->entries = 0;
    partition->sheet_count = 0;
    partition->items = sp_arena_alloc(&partition->kept, "bricks", most, sizeof *partition->items);
    if (!partition->items || (axis != SP_NO_AXIS && !keep_detail(partition, from->detail)))
        return sp_arena_fail(&partition->kept, "data", err);
    if (axis != SP_NO_AXIS)
        add_detail(partition, from);
    for (uint32_t b = 0; axis == SP_NO_AXIS && b < most; b++)
        add_item(partition, list, b, from->level, from->is_enlarged);
    for (uint32_t i = 0; axis == SP_NO_AXIS && i < partition->item_count; i++)
        enclose(list, &partition->items[i]);
    write_list_made(from, partition->list_made);
    partition->axis = axis;
    partition->level = from->level;
    partition->is_enlarged = from->is_enlarged;
    partition->volume = from->volume;
    return true;
}

/* Finds the sheets that a brick has slices in. */
static void bound_sheets(const struct gl_partition *partition, const struct gl_visible_list *list,
                         struct gl_item *item) {
    uint32_t corner[3], first, dim = list->grid.dims[partition->axis];
    sp_visible_brick_corner(list->bricks, item->brick, corner);
    first = corner[partition->axis];
    item->near = INT64_MAX;
    item->far = 0;
    for (uint32_t s = first; s < first + SP_BRICK && s < dim; s++) {
        int64_t layer = sp_slices_layer(partition->sheets, partition->sheet_count, item->level, s);
        item->near = layer < item->near ? layer : item->near;
        item->far = layer > item->far ? layer : item->far;
    }
}

bool gl_partition_sheets(struct gl_partition *partition, const struct gl_partition_source *from,
                         unsigned axis, const uint32_t *sheets, uint32_t count,
                         struct sp_error *err) {
    if (!is_kept(partition, from, axis) && !list_items(partition, from, axis, err))
        return false;
    if (partition->sheet_count == count &&
        memcmp(partition->sheets, sheets, count * sizeof *sheets) == 0)
        return true;
    if (partition->sheet_count != count) /* the items were just listed */
        partition->sheets =
            sp_arena_alloc(&partition->kept, "order of sheets", count, sizeof *partition->sheets);
    partition->sheet_count = partition->layer_count = partition->sheets ? count : 0;
    partition->is_cut = partition->is_cut && partition->is_whole;
    partition->sheets_made++;
    if (!partition->sheets)
        return sp_arena_fail(&partition->kept, "data", err);
    memcpy(partition->sheets, sheets, count * sizeof *sheets);
    for (uint32_t i = 0; i < partition->item_count; i++)
        bound_sheets(partition, from->lists[partition->items[i].level], &partition->items[i]);
    return true;
}

/* Bounds the layers, counted from the eye, in which kernels of a brick may lie: the layers that
 * meet the sphere around the brick, and one more on each side for rounding. */
static void bound_distances(const struct gl_partition_depth *depth, struct gl_item *item) {
    const struct sp_camera_transform *camera = depth->camera;
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

bool gl_partition_distances(struct gl_partition *partition, const struct gl_partition_source *from,
                            const struct gl_partition_depth *depth, struct sp_error *err) {
    int64_t near = INT64_MAX, far = INT64_MIN;
    if (!is_kept(partition, from, SP_NO_AXIS) && !list_items(partition, from, SP_NO_AXIS, err))
        return false;
    for (uint32_t i = 0; i < partition->item_count; i++) {
        struct gl_item *item = &partition->items[i];
        bound_distances(depth, item);
        near = item->near < near ? item->near : near;
        far = item->far > far ? item->far : far;
    }
    for (uint32_t i = 0; i < partition->item_count; i++) {
        partition->items[i].near -= near;
        partition->items[i].far -= near;
    }
    partition->nearest = partition->item_count ? near : 0;
    partition->layer_count = partition->item_count ? (uint32_t)(far - near + 1) : 0;
    partition->is_cut = partition->is_cut && partition->is_whole;
    return true;
}

/* Adds the brick's chunks to the batch; only counts them while there is no memory. */
static void add_chunks(struct gl_partition *partition, const struct gl_item *item,
                       struct gl_batch *batch) {
    uint32_t part = 2u * item->level + item->is_enlarged;
    if (!batch->chunks[item->level])
        batch->chunk[item->level] = partition->chunk_count;
    for (uint32_t at = 0, n; at < item->count; at += n) {
        n = item->count - at < GL_GROUP ? item->count - at : GL_GROUP;
        if (partition->chunks)
            partition->chunks[partition->chunk_count] =
                (struct gl_chunk){ item->first + at, item->brick, n | part << 16, batch->records };
        partition->chunk_count++;
        batch->chunks[item->level]++;
        batch->records += n;
    }
}

static void add_batch(struct gl_partition *partition, const struct gl_batch *batch) {
    if (partition->batches)
        partition->batches[partition->batch_count] = *batch;
    partition->batch_count++;
}

/* Adds the batches of layers [begin, end): one, or several if there are more entries than records.
 */
static void add_batches(struct gl_partition *partition, uint32_t begin, uint32_t end) {
    struct gl_batch batch = { .first = begin, .layers = end - begin };
    for (uint32_t i = 0; i < partition->item_count; i++) {
        const struct gl_item *item = &partition->items[i];
        if (item->near >= end || item->far < begin)
            continue;
        if (batch.records + item->count > partition->records) {
            batch.stays_open = true;
            add_batch(partition, &batch);
            batch = (struct gl_batch){ .first = begin, .layers = end - begin, .resumes = true };
        }
        add_chunks(partition, item, &batch);
    }
    if (batch.records)
        add_batch(partition, &batch);
}

/* By k: entries of bricks that begin before layer k, and of bricks that end before it. */
struct sums {
    uint64_t *begun, *ended; /* [layer_count + 1] */
};

static bool sum_entries(struct gl_partition *partition, struct sums *s) {
    size_t n = (size_t)partition->layer_count + 1;
    s->begun = sp_arena_alloc(&partition->pieces, "entries by layer", n, sizeof *s->begun);
    s->ended = sp_arena_alloc(&partition->pieces, "entries by layer", n, sizeof *s->ended);
    if (partition->pieces.failed)
        return false;
    memset(s->begun, 0, n * sizeof *s->begun);
    memset(s->ended, 0, n * sizeof *s->ended);
    for (uint32_t i = 0; i < partition->item_count; i++) {
        s->begun[partition->items[i].near + 1] += partition->items[i].count;
        s->ended[partition->items[i].far + 1] += partition->items[i].count;
    }
    for (size_t k = 1; k < n; k++) {
        s->begun[k] += s->begun[k - 1];
        s->ended[k] += s->ended[k - 1];
    }
    return true;
}

static void make_batches(struct gl_partition *partition, const struct sums *s) {
    partition->batch_count = partition->chunk_count = 0;
    for (uint32_t begin = 0, end; begin < partition->layer_count; begin = end) {
        for (end = begin + 1; end < partition->layer_count && end - begin < partition->layers;
             end++)
            if (s->begun[end + 1] - s->ended[begin] > partition->records)
                break;
        if (s->begun[end] > s->ended[begin])
            add_batches(partition, begin, end);
    }
}

bool gl_partition_make(struct gl_partition *partition, uint32_t layers, uint32_t records,
                       struct sp_error *err) {
    bool is_whole = partition->layer_count <= layers && partition->entries <= records;
    struct sums s;
    if (partition->is_cut && is_whole && partition->is_whole) {
        for (uint32_t i = 0; i < partition->batch_count; i++)
            partition->batches[i].layers = partition->layer_count;
        return true;
    }
    if (partition->is_cut && !partition->is_whole && layers == partition->layers &&
        records == partition->records)
        return true;
    sp_arena_reset(&partition->pieces);
    partition->is_cut = false;
    partition->is_whole = is_whole;
    partition->layers = layers;
    partition->records = records;
    partition->batches = NULL;
    partition->chunks = NULL;
    partition->chunks_made++;
    if (!sum_entries(partition, &s))
        return sp_arena_fail(&partition->pieces, "data", err);
    make_batches(partition, &s);
    partition->chunks = sp_arena_alloc(&partition->pieces, "bricks", partition->chunk_count,
                                       sizeof *partition->chunks);
    partition->batches = sp_arena_alloc(&partition->pieces, "batches", partition->batch_count,
                                        sizeof *partition->batches);
    if (partition->pieces.failed)
        return sp_arena_fail(&partition->pieces, "data", err);
    make_batches(partition, &s);
    partition->is_cut = true;
    return true;
}
