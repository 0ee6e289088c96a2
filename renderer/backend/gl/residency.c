/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/residency.h"

#include <stdio.h>
#include <string.h>

#include "backend/gl/program.h"
#include "backend/gl/visible_ranges.h"
#include "data/volume/grid.h"
#include "data/volume/volume.h"
#include "sp/log.h"

enum { KEY_SHIFT = 12, GRAIN = 16 };

/* Context of the workers that write bricks or entries into mapped memory. */
struct upload {
    const struct sp_level *level;
    uint32_t *words;
    float (*classes)[4];
    bool has_keys;
};

static uint64_t list_bytes(const struct gl_visible_list *list) {
    return list->entries.bytes + list->tables.bytes + list->normals.bytes;
}

static void empty(struct gl_visible_list *list) {
    gl_buffer_finish(&list->entries);
    gl_buffer_finish(&list->tables);
    gl_buffer_finish(&list->normals);
    *list = (struct gl_visible_list){ 0 };
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

/* Computes colour and depth; order post: the value. */
static void write_class(const struct sp_transfer *transfer, uint32_t key, float row[4]) {
    if (transfer->tf.order == SP_TF_POST) {
        memcpy(row, (float[4]){ sp_transfer_value(transfer, key) }, sizeof(float[4]));
        return;
    }
    struct sp_class c = sp_transfer_class(transfer, key);
    memcpy(row, c.color, sizeof c.color);
    row[3] = c.depth;
}

/* Writes the classes of entries, if the list has no table by key. */
static void write_entries(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct upload *u = user;
    for (size_t e = begin; e < end; e++)
        write_class(&u->level->transfer, sp_visible_key(&u->level->visible, e), u->classes[e]);
}

static bool upload_entries(struct gl_residency *residency, struct gl_visible_list *list,
                           const struct gl_list_source *from, struct sp_error *err) {
    struct upload u = { .level = from->level, .has_keys = list->has_keys };
    const struct sp_visible *v = &from->level->visible;
    uint64_t bytes = (v->count + 1) * sizeof *u.words, normals = v->count * list->normal_bytes;
    if (!(u.words = gl_buffer_map(&list->entries, bytes, err)))
        return false;
    sp_parallel_for(from->pool, sp_visible_bricks(v), GRAIN, write_words, &u);
    if (normals)
        gl_buffer_write(&list->normals, v->normal, normals);
    residency->uploaded += bytes + normals;
    return gl_buffer_unmap(&list->entries, err);
}

/* Assigns rows of the tables to rectilinear axes; stores the first row of each axis in axis_row.
 * Returns the row after
 * the last one. */
static uint32_t place_axes(struct gl_visible_list *list, const struct sp_grid *grid) {
    uint32_t row = GL_TABLE_SCALES;
    for (int a = 0; a < 3; a++) {
        list->axis_row[a] = row;
        row += sp_grid_is_rectilinear(grid) ? grid->dims[a] : 0;
    }
    return row;
}

static void write_axes(const struct gl_visible_list *list, const struct sp_grid *grid,
                       float (*rows)[4]) {
    if (!sp_grid_is_rectilinear(grid))
        return;
    for (unsigned a = 0; a < 3; a++)
        for (uint32_t i = 0; i < grid->dims[a]; i++) {
            double inv = 1 / grid->spacing[a];
            double start = sp_grid_distance(grid, a, i & ~(SP_BRICK - 1u));
            float *row = rows[list->axis_row[a] + i];
            row[0] = (float)((sp_grid_distance(grid, a, i) - start) * inv);
            row[1] = (float)(sp_grid_local_spacing(grid, a, i) * inv);
            row[2] = (float)(start * inv);
            row[3] = (float)(start * inv - (double)row[2]);
        }
}

static void write_scales(const struct sp_transfer *transfer, float (*rows)[4]) {
    for (int i = 0; i < 4 * GL_TABLE_SCALES; i++)
        rows[i / 4][i % 4] = transfer->scale ? transfer->scale[i] : 1;
}

static void write_classes(const struct gl_visible_list *list, const struct gl_list_source *from,
                          float (*classes)[4]) {
    const struct sp_transfer *transfer = &from->level->transfer;
    struct upload u = { .level = from->level, .classes = classes };
    for (uint32_t k = 0; list->has_keys && k < transfer->count; k++)
        write_class(transfer, k, classes[k]);
    if (!list->has_keys)
        sp_parallel_for(from->pool, from->level->visible.count, SP_BRICK_VOXELS, write_entries, &u);
}

/* Uploads scales and axes, and the classes unless the GPU makes them. */
static bool upload_tables(struct gl_residency *residency, struct gl_visible_list *list,
                          const struct gl_list_source *from, struct sp_error *err) {
    const struct sp_level *level = from->level;
    const struct sp_transfer *transfer = &level->transfer;
    uint64_t classes = list->has_keys ? transfer->count : level->visible.count, written;
    list->has_scales = transfer->scale != NULL;
    list->first_class = place_axes(list, &level->grid);
    uint64_t bytes = (list->first_class + classes + 1) * sizeof(float[4]);
    float(*rows)[4];
    bool are_made = from->voxels && !list->has_keys; /* by the GPU */
    written = are_made ? list->first_class * sizeof(float[4]) : bytes;
    if (!gl_buffer_reserve(&list->tables, "classes of visible voxels", bytes,
                           residency->block_bytes, GL_USE_KEPT, err) ||
        !(rows = gl_buffer_map(&list->tables, written, err)))
        return false;
    write_scales(transfer, rows);
    write_axes(list, &level->grid, rows);
    if (!are_made)
        write_classes(list, from, rows + list->first_class);
    residency->uploaded += written;
    return gl_buffer_unmap(&list->tables, err);
}

/* Empties and returns a slot for another list: an unused one, or the least recently used one. */
static struct gl_visible_list *recycle_list(struct gl_residency *residency) {
    struct gl_visible_list *oldest = &residency->list[0];
    for (int i = 1; i < GL_LISTS; i++)
        if (residency->list[i].used < oldest->used)
            oldest = &residency->list[i];
    empty(oldest);
    return oldest;
}

static struct gl_visible_list *find_list(struct gl_residency *residency,
                                         const struct gl_list_source *from) {
    for (int i = 0; i < GL_LISTS; i++)
        if (residency->list[i].volume == from->volume &&
            residency->list[i].list_made == from->level->list_made)
            return &residency->list[i];
    return NULL;
}

static void empty_voxels(struct gl_voxels *voxels) {
    gl_voxels_drop(voxels);
    sp_volume_unref(&voxels->volume);
    *voxels = (struct gl_voxels){ 0 };
}

struct gl_voxels *gl_residency_voxels(struct gl_residency *residency, struct sp_volume *volume) {
    struct gl_voxels *place = &residency->voxels[0];
    if (!gl_visible_ranges_is_possible(sp_volume_info(volume)))
        return NULL;
    for (int i = 1; i < GL_VOLUMES && place->volume != volume; i++)
        if (residency->voxels[i].volume == volume || residency->voxels[i].used < place->used)
            place = &residency->voxels[i];
    if (place->volume != volume) {
        empty_voxels(place);
        place->volume = sp_volume_ref(volume);
    }
    place->used = ++residency->clock;
    if (place->skips == 0)
        return place;
    place->skips--;
    return NULL;
}

void gl_residency_leave_to_cpu(struct gl_voxels *voxels, const struct sp_error *why) {
    enum { DOUBLINGS = 8 };
    if (voxels->refusals == 0)
        sp_log(SP_LOG_WARN, "volume %s is classified by the processor: %s",
               sp_volume_info(voxels->volume)->name, why->text);
    gl_voxels_drop(voxels);
    voxels->skips = GL_REFUSED_FRAMES << voxels->refusals;
    voxels->refusals += voxels->refusals < DOUBLINGS;
}

static void empty_item(struct gl_resident *item) {
    gl_buffer_finish(&item->buffer);
    sp_volume_unref(&item->held);
    *item = (struct gl_resident){ 0 };
}

static bool fail_budget(const struct gl_residency *residency, const char *what, uint64_t bytes,
                        struct sp_error *err) {
    return sp_fail(err, SP_ERR_BUDGET, "",
                   "%s %llu bytes of video memory, and %llu are allowed: make fewer visible, or "
                   "allow more",
                   what, (unsigned long long)bytes, (unsigned long long)residency->limit_bytes);
}

/* Returns the least recently used list, and samples, that this frame does not use; NULL = none. */
static struct gl_visible_list *oldest_list(struct gl_residency *residency) {
    struct gl_visible_list *oldest = NULL;
    for (int i = 0; i < GL_LISTS; i++) {
        struct gl_visible_list *list = &residency->list[i];
        if (list->volume && list->used <= residency->frame &&
            (!oldest || list->used < oldest->used))
            oldest = list;
    }
    return oldest;
}

static struct gl_voxels *oldest_voxels(struct gl_residency *residency) {
    struct gl_voxels *oldest = NULL;
    for (int i = 0; i < GL_VOLUMES; i++) {
        struct gl_voxels *voxels = &residency->voxels[i];
        if (voxels->samples.name && voxels->used <= residency->frame &&
            (!oldest || voxels->used < oldest->used))
            oldest = voxels;
    }
    return oldest;
}

static struct gl_resident *oldest_item(struct gl_residency *residency) {
    struct gl_resident *oldest = NULL;
    for (int i = 0; i < GL_RESIDENTS; i++) {
        struct gl_resident *item = &residency->items[i];
        if (item->volume && item->used <= residency->frame &&
            (!oldest || item->used < oldest->used))
            oldest = item;
    }
    return oldest;
}

/* Evicts the least recently used data that this frame does not use; false = there is none. */
static bool evict_oldest(struct gl_residency *residency) {
    struct gl_visible_list *list = oldest_list(residency);
    struct gl_voxels *voxels = oldest_voxels(residency);
    struct gl_resident *item = oldest_item(residency);
    uint64_t ages[3] = { list ? list->used : UINT64_MAX, voxels ? voxels->used : UINT64_MAX,
                         item ? item->used : UINT64_MAX };
    if (item && ages[2] <= ages[0] && ages[2] <= ages[1])
        empty_item(item);
    else if (list && ages[0] < ages[1])
        empty(list);
    else if (voxels)
        gl_voxels_drop(voxels);
    return list || voxels || item;
}

/* Frees memory for `more` bytes: evicts the least recently used data, but nothing that this frame
 * uses. */
static bool trim(struct gl_residency *residency, const char *what, uint64_t more,
                 struct sp_error *err) {
    more += residency->beside_bytes;
    if (more > residency->limit_bytes)
        return fail_budget(residency, what, more, err);
    while (gl_residency_bytes(residency, NULL) + more > residency->limit_bytes)
        if (!evict_oldest(residency))
            return fail_budget(residency, what, gl_residency_bytes(residency, NULL) + more, err);
    return true;
}

bool gl_residency_trim(struct gl_residency *residency, struct sp_error *err) {
    return trim(residency, "the visible voxels and the render buffers take", 0, err);
}

bool gl_residency_drop_samples(struct gl_residency *residency) {
    bool had = false;
    for (int i = 0; i < GL_VOLUMES; i++) {
        had = had || residency->voxels[i].samples.name;
        gl_voxels_drop(&residency->voxels[i]);
    }
    return had;
}

bool gl_residency_load(struct gl_residency *residency, struct gl_voxels *voxels,
                       enum sp_tf_order order, const atomic_bool *cancel, struct sp_error *err) {
    const struct sp_volume_info *info = sp_volume_info(voxels->volume);
    bool is_post = order == SP_TF_POST;
    uint64_t more = voxels->samples.name ? 0 : info->voxel_bytes;
    if (is_post) /* a pass needs two of them while it runs */
        more += gl_cell_bounds_bytes(&info->grid) * (voxels->cells.name ? 2 : 3);
    return (more == 0 || trim(residency, "its voxels and the visible ones take", more, err)) &&
           gl_classify_load(&residency->classify, voxels, is_post, cancel, err);
}

/* Returns the bytes per normal of the list. */
static uint32_t normal_bytes(const struct gl_list_source *from) {
    bool wanted = from->voxels ? from->normals : from->level->visible.normal != NULL;
    return wanted ? from->level->visible.normal_bytes : 0;
}

/* Reserves memory for entries. Refuses a list that can never fit before it is made. */
static bool reserve(struct gl_residency *residency, struct gl_visible_list *list,
                    const struct gl_list_source *from, struct sp_error *err) {
    uint64_t count = from->level->visible.count, words = (count + 1) * sizeof(uint32_t);
    uint64_t normals = (count * list->normal_bytes + 7) / 4 * 4;
    const char *what =
        from->voxels ? "its voxels and the visible ones take" : "the visible voxels take";
    if (!list->normal_bytes)
        normals = 0;
    return trim(residency, what, words + normals, err) &&
           gl_buffer_reserve(&list->entries, "visible voxels", words, residency->block_bytes,
                             GL_USE_KEPT, err) &&
           (!normals || gl_buffer_reserve(&list->normals, "gradients", normals,
                                          residency->block_bytes, GL_USE_KEPT, err));
}

/* Makes the entries on the GPU, or only their classes. */
static bool fill(struct gl_residency *residency, struct gl_visible_list *list,
                 const struct gl_list_source *from, bool has_entries, struct sp_error *err) {
    struct gl_classify *c = &residency->classify;
    enum sp_tf_order order = from->order;
    if (!from->finer)
        return gl_residency_load(residency, from->voxels, order, from->cancel, err) &&
               (has_entries ? gl_classify_color : gl_classify_fill)(c, from->voxels, from->level,
                                                                    list, from->cancel, err);
    const struct gl_visible_list *finer = gl_residency_get(residency, from->finer, err);
    return finer && gl_classify_fill_mip(c, finer, order == SP_TF_POST, from->level, list,
                                         from->cancel, err);
}

/* Makes the missing parts of the list. */
static bool update(struct gl_residency *residency, struct gl_visible_list *list,
                   const struct gl_list_source *from, struct sp_error *err) {
    const struct sp_level *level = from->level;
    uint32_t wanted = normal_bytes(from);
    bool has_entries = list->list_made && (!wanted || list->normal_bytes == wanted) &&
                       (list->is_rising || !from->voxels) &&
                       (list->has_keys || list->is_rising == (from->voxels != NULL));
    bool has_tables = list->table_made == level->table_made && (has_entries || list->has_keys);
    if (!has_entries) {
        gl_buffer_finish(&list->entries);
        gl_buffer_finish(&list->normals);
        list->normal_bytes = wanted;
        list->is_rising = from->voxels != NULL;
        list->has_keys = level->transfer.table && level->visible.key_bytes <= 2 &&
                         sp_transfer_key_bytes(&level->transfer) <= 2;
    }
    if (!has_tables && !upload_tables(residency, list, from, err))
        return false;
    if (!has_entries && !reserve(residency, list, from, err))
        return false;
    bool fills = from->voxels && (!has_entries || (!has_tables && !list->has_keys));
    if (fills && !fill(residency, list, from, has_entries, err))
        return false;
    if (!from->voxels && !has_entries && !upload_entries(residency, list, from, err))
        return false;
    return trim(residency, "the visible voxels take", 0, err);
}

/* Describes the level for a frame: everything but the buffers. The pointers are borrowed. */
static void describe(struct gl_visible_list *list, const struct sp_level *level) {
    list->grid = level->grid;
    memcpy(list->bricks, level->visible.bricks, sizeof list->bricks);
    list->count = level->visible.count;
    list->first = level->visible.first;
    list->base = sp_transfer_base(&level->transfer);
    list->list_made = level->list_made;
    list->table_made = level->table_made;
}

const struct gl_visible_list *gl_residency_get(struct gl_residency *residency,
                                               const struct gl_list_source *from,
                                               struct sp_error *err) {
    struct gl_visible_list *list = find_list(residency, from);
    if (!list)
        list = recycle_list(residency);
    list->volume = from->volume;
    list->original = sp_volume_original(from->volume);
    list->used = ++residency->clock;
    if (!update(residency, list, from, err)) {
        empty(list);
        return NULL;
    }
    describe(list, from->level);
    return list;
}

/* Returns an empty item in place of the least recently used one. */
static struct gl_resident *recycle_item(struct gl_residency *residency) {
    struct gl_resident *oldest = &residency->items[0];
    for (int i = 1; i < GL_RESIDENTS; i++)
        if (residency->items[i].used < oldest->used)
            oldest = &residency->items[i];
    empty_item(oldest);
    return oldest;
}

struct gl_resident *gl_residency_get_item(struct gl_residency *residency,
                                          const struct sp_volume *volume,
                                          enum gl_resident_kind kind, uint64_t made, uint64_t bytes,
                                          const char *what, struct sp_error *err) {
    char use[96];
    struct gl_resident *item = NULL;
    for (int i = 0; i < GL_RESIDENTS && !item; i++)
        if (residency->items[i].volume == volume && residency->items[i].kind == kind &&
            residency->items[i].made == made)
            item = &residency->items[i];
    if (!item) {
        item = recycle_item(residency);
        *item = (struct gl_resident){
            .volume = volume, .original = sp_volume_original(volume), .kind = kind, .made = made
        };
    }
    snprintf(use, sizeof use, "the %s and the render buffers take", what);
    item->used = ++residency->clock;
    if (item->is_filled || item->buffer.bytes >= bytes ||
        (trim(residency, use, bytes, err) &&
         gl_buffer_reserve(&item->buffer, what, bytes, residency->block_bytes, GL_USE_KEPT, err)))
        return item;
    empty_item(item);
    return NULL;
}

/* sp_volume_is_of() for volumes that may be gone. */
static bool is_of(const struct sp_volume *volume, const struct sp_volume *original,
                  const struct sp_volume *wanted) {
    return !wanted || volume == wanted || original == wanted;
}

void gl_residency_evict(struct gl_residency *residency, const struct sp_volume *volume) {
    for (int i = 0; i < GL_LISTS; i++)
        if (is_of(residency->list[i].volume, residency->list[i].original, volume))
            empty(&residency->list[i]);
    for (int i = 0; i < GL_VOLUMES; i++)
        if (sp_volume_is_of(residency->voxels[i].volume, volume))
            empty_voxels(&residency->voxels[i]);
    for (int i = 0; i < GL_RESIDENTS; i++)
        if (is_of(residency->items[i].volume, residency->items[i].original, volume))
            empty_item(&residency->items[i]);
}

void gl_residency_lose(struct gl_residency *residency) {
    for (int i = 0; i < GL_LISTS; i++)
        residency->list[i] = (struct gl_visible_list){ 0 };
    for (int i = 0; i < GL_RESIDENTS; i++) {
        sp_volume_unref(&residency->items[i].held);
        residency->items[i] = (struct gl_resident){ 0 };
    }
    for (int i = 0; i < GL_VOLUMES; i++) {
        sp_volume_unref(&residency->voxels[i].volume);
        residency->voxels[i] = (struct gl_voxels){ 0 };
    }
}

uint64_t gl_residency_bytes(const struct gl_residency *residency, const struct sp_volume *volume) {
    uint64_t bytes = 0;
    for (int i = 0; i < GL_LISTS; i++)
        if (is_of(residency->list[i].volume, residency->list[i].original, volume))
            bytes += list_bytes(&residency->list[i]);
    for (int i = 0; i < GL_VOLUMES; i++)
        if (sp_volume_is_of(residency->voxels[i].volume, volume))
            bytes += gl_voxels_bytes(&residency->voxels[i]);
    for (int i = 0; i < GL_RESIDENTS; i++)
        if (is_of(residency->items[i].volume, residency->items[i].original, volume))
            bytes += residency->items[i].buffer.bytes;
    return bytes;
}

bool gl_residency_init(struct gl_residency *residency, bool software, uint64_t block_bytes,
                       struct sp_error *err) {
    residency->block_bytes = residency->classify.block_bytes = block_bytes;
    residency->classify.uploaded = &residency->uploaded;
    return gl_classify_init(&residency->classify, software, err);
}

void gl_residency_finish(struct gl_residency *residency) {
    gl_residency_evict(residency, NULL);
    gl_classify_finish(&residency->classify);
}
