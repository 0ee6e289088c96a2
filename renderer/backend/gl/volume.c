/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/volume.h"

#include <string.h>

#include "backend/gl/program.h"
#include "volume/grid.h"

enum { KEY_SHIFT = 12, GRAIN = 16 };

/* Bricks or entries that are being written into mapped memory. */
struct upload {
    const struct sp_level *level;
    uint32_t *words;
    float (*classes)[4];
    bool has_keys;
};

static uint64_t list_bytes(const struct gl_list *list) {
    return list->entries.bytes + list->tables.bytes + list->normals.bytes;
}

static void empty(struct gl_list *list) {
    gl_buffer_finish(&list->entries);
    gl_buffer_finish(&list->tables);
    gl_buffer_finish(&list->normals);
    *list = (struct gl_list){ 0 };
}

static void write_words(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct upload *u = user;
    const struct sp_visible *v = &u->level->visible;
    uint16_t local[SP_BRICK_VOXELS];
    for (size_t b = begin; b < end; b++) {
        uint64_t first = v->first[b];
        uint32_t n = (uint32_t)(v->first[b + 1] - first);
        sp_visible_locals(v, (uint32_t)b, NULL, 0, n, local);
        for (uint32_t i = 0; i < n; i++)
            u->words[first + i] =
                local[i] | (u->has_keys ? sp_visible_key(v, first + i) << KEY_SHIFT : 0);
    }
}

/* Colour and depth; order post: the value. */
static void write_class(const struct sp_transfer *transfer, uint32_t key, float row[4]) {
    if (transfer->tf.order == SP_TF_POST) {
        memcpy(row, (float[4]){ sp_transfer_value(transfer, key) }, sizeof(float[4]));
        return;
    }
    struct sp_class c = sp_transfer_class(transfer, key);
    memcpy(row, c.color, sizeof c.color);
    row[3] = c.depth;
}

/* Of entries, whose classes no table by key holds. */
static void write_classes(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct upload *u = user;
    for (size_t e = begin; e < end; e++)
        write_class(&u->level->transfer, sp_visible_key(&u->level->visible, e), u->classes[e]);
}

static bool upload_entries(struct gl_lists *lists, struct gl_list *list,
                           const struct sp_level *level, struct sp_pool *pool,
                           struct sp_error *err) {
    struct upload u = { .level = level, .has_keys = list->has_keys };
    uint64_t bytes = (level->visible.count + 1) * sizeof *u.words;
    if (!gl_buffer_reserve(&list->entries, "visible voxels", bytes, lists->block_bytes, GL_USE_KEPT,
                           err) ||
        !(u.words = gl_buffer_map(&list->entries, bytes, err)))
        return false;
    sp_parallel_for(pool, sp_visible_bricks(&level->visible), GRAIN, write_words, &u);
    lists->uploaded += bytes;
    return gl_buffer_unmap(&list->entries, err);
}

static bool upload_normals(struct gl_lists *lists, struct gl_list *list,
                           const struct sp_level *level, struct sp_error *err) {
    const struct sp_visible *v = &level->visible;
    uint64_t bytes = v->count * v->normal_bytes, room = (bytes + 7) / 4 * 4;
    list->normal_bytes = v->normal ? v->normal_bytes : 0;
    if (!v->normal || !bytes)
        return true;
    if (!gl_buffer_reserve(&list->normals, "gradients", room, lists->block_bytes, GL_USE_KEPT, err))
        return false;
    gl_buffer_write(&list->normals, v->normal, bytes);
    lists->uploaded += bytes;
    return true;
}

/* Rows of the tables that rectilinear axes take; where each begins goes to axis_row. */
static uint32_t place_axes(struct gl_list *list, const struct sp_grid *grid) {
    uint32_t row = GL_TABLE_SCALES;
    for (int a = 0; a < 3; a++) {
        list->axis_row[a] = row;
        row += sp_grid_is_rectilinear(grid) ? grid->dims[a] : 0;
    }
    return row;
}

static void write_axes(const struct gl_list *list, const struct sp_grid *grid, float (*rows)[4]) {
    if (!sp_grid_is_rectilinear(grid))
        return;
    for (unsigned a = 0; a < 3; a++)
        for (uint32_t i = 0; i < grid->dims[a]; i++) {
            double inv = 1 / grid->spacing[a];
            double start = sp_grid_distance(grid, a, i & ~(SP_BRICK - 1u));
            float *row = rows[list->axis_row[a] + i];
            row[0] = (float)((sp_grid_distance(grid, a, i) - start) * inv);
            row[1] = (float)(sp_grid_local_spacing(grid, a, i) * inv);
        }
}

static void write_scales(const struct sp_transfer *transfer, float (*rows)[4]) {
    for (int i = 0; i < 4 * GL_TABLE_SCALES; i++)
        rows[i / 4][i % 4] = transfer->scale ? transfer->scale[i] : 1;
}

static bool upload_tables(struct gl_lists *lists, struct gl_list *list,
                          const struct sp_level *level, struct sp_pool *pool,
                          struct sp_error *err) {
    const struct sp_transfer *transfer = &level->transfer;
    uint64_t classes = list->has_keys ? transfer->count : level->visible.count;
    list->has_scales = transfer->scale != NULL;
    list->first_class = place_axes(list, &level->grid);
    uint64_t bytes = (list->first_class + classes + 1) * sizeof(float[4]);
    float(*rows)[4];
    if (!gl_buffer_reserve(&list->tables, "classes of visible voxels", bytes, lists->block_bytes,
                           GL_USE_KEPT, err) ||
        !(rows = gl_buffer_map(&list->tables, bytes, err)))
        return false;
    write_scales(transfer, rows);
    write_axes(list, &level->grid, rows);
    struct upload u = { .level = level, .classes = rows + list->first_class };
    for (uint32_t k = 0; list->has_keys && k < transfer->count; k++)
        write_class(transfer, k, u.classes[k]);
    if (!list->has_keys)
        sp_parallel_for(pool, level->visible.count, SP_BRICK_VOXELS, write_classes, &u);
    lists->uploaded += bytes;
    return gl_buffer_unmap(&list->tables, err);
}

/* A place for another list: an empty one, or that of the least recently used. */
static struct gl_list *take_place(struct gl_lists *lists) {
    struct gl_list *oldest = &lists->list[0];
    for (int i = 1; i < GL_LISTS; i++)
        if (lists->list[i].used < oldest->used)
            oldest = &lists->list[i];
    empty(oldest);
    return oldest;
}

static struct gl_list *find(struct gl_lists *lists, const struct sp_volume *volume,
                            const struct sp_level *level) {
    for (int i = 0; i < GL_LISTS; i++)
        if (lists->list[i].volume == volume && lists->list[i].list_made == level->list_made)
            return &lists->list[i];
    return NULL;
}

static bool fail_budget(const struct gl_lists *lists, uint64_t bytes, struct sp_error *err) {
    return sp_fail(err, SP_ERR_BUDGET, "",
                   "the visible voxels take %llu bytes of video memory, and %llu are allowed: make "
                   "fewer visible, or allow more",
                   (unsigned long long)bytes, (unsigned long long)lists->limit_bytes);
}

/* Makes room by dropping the least recently used lists but those of this frame. */
static bool trim(struct gl_lists *lists, struct sp_error *err) {
    while (gl_lists_bytes(lists, NULL) > lists->limit_bytes) {
        struct gl_list *oldest = NULL;
        for (int i = 0; i < GL_LISTS; i++) {
            struct gl_list *list = &lists->list[i];
            if (list->volume && list->used <= lists->frame &&
                (!oldest || list->used < oldest->used))
                oldest = list;
        }
        if (!oldest)
            return fail_budget(lists, gl_lists_bytes(lists, NULL), err);
        empty(oldest);
    }
    return true;
}

/* Whether a list could stay at all: one that is too long is refused before it is uploaded. */
static bool may_fit(const struct gl_lists *lists, const struct sp_visible *v,
                    struct sp_error *err) {
    uint64_t bytes = v->count * (sizeof(uint32_t) + (v->normal ? v->normal_bytes : 0));
    return bytes <= lists->limit_bytes || fail_budget(lists, bytes, err);
}

static bool upload_list(struct gl_lists *lists, struct gl_list *list, const struct sp_level *level,
                        struct sp_pool *pool, struct sp_error *err) {
    list->has_keys = level->transfer.table && sp_transfer_key_bytes(&level->transfer) <= 2 &&
                     level->visible.key_bytes <= 2;
    return upload_entries(lists, list, level, pool, err) && upload_normals(lists, list, level, err);
}

/* What a frame needs of the level beside the buffers; borrowed. */
static void describe(struct gl_list *list, const struct sp_level *level) {
    list->grid = level->grid;
    memcpy(list->bricks, level->visible.bricks, sizeof list->bricks);
    list->count = level->visible.count;
    list->first = level->visible.first;
    list->base = sp_transfer_base(&level->transfer);
}

const struct gl_list *gl_lists_get(struct gl_lists *lists, const struct sp_volume *volume,
                                   const struct sp_level *level, struct sp_pool *pool,
                                   struct sp_error *err) {
    struct gl_list *list = find(lists, volume, level);
    bool is_new = !list;
    if (is_new && !may_fit(lists, &level->visible, err))
        return NULL;
    if (is_new)
        list = take_place(lists);
    list->volume = volume;
    list->used = ++lists->clock;
    if ((is_new && !upload_list(lists, list, level, pool, err)) ||
        ((is_new || list->table_made != level->table_made) &&
         !upload_tables(lists, list, level, pool, err)) ||
        !trim(lists, err)) {
        empty(list);
        return NULL;
    }
    list->list_made = level->list_made;
    list->table_made = level->table_made;
    describe(list, level);
    return list;
}

void gl_lists_forget(struct gl_lists *lists, const struct sp_volume *volume) {
    for (int i = 0; i < GL_LISTS; i++)
        if (!volume || lists->list[i].volume == volume)
            empty(&lists->list[i]);
}

uint64_t gl_lists_bytes(const struct gl_lists *lists, const struct sp_volume *volume) {
    uint64_t bytes = 0;
    for (int i = 0; i < GL_LISTS; i++)
        if (!volume || lists->list[i].volume == volume)
            bytes += list_bytes(&lists->list[i]);
    return bytes;
}
