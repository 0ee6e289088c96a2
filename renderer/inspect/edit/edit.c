/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/edit.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/minmax.h"
#include "classify/transfer.h"
#include "data/volume/sample.h"
#include "data/volume/volume.h"
#include "inspect/edit/apply.h"

/* The input that an edited volume depends on. */
struct key {
    double empty;
    uint32_t count, unused;
    struct sp_edit edits[SP_EDITS_MAX];
};

static size_t key_bytes(const struct key *key) {
    return offsetof(struct key, edits) + key->count * sizeof key->edits[0];
}

/* The lowest of the transparent values at the ends of the range and at the points of the transfer
 * function; NaN = none. */
static double choose_transparent(const struct sp_volume_info *info,
                                 const struct sp_transfer_function *tf) {
    double best = info->range[0];
    struct sp_class least;
    sp_transfer_function_eval(tf, best, &least);
    for (uint32_t i = 0; i <= tf->point_count; i++) {
        double value = i < tf->point_count ? tf->points[i].value : info->range[1];
        struct sp_class class;
        if (!(value > info->range[0] && value <= info->range[1]))
            continue;
        sp_transfer_function_eval(tf, value, &class);
        if (class.depth < least.depth) {
            least = class;
            best = value;
        }
    }
    return least.depth > 0 ? NAN : best;
}

/* Do all layers show samples whatever their opacity is? */
static bool has_surfaces_only(const struct sp_view *view) {
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (view->layers[i].type != SP_LAYER_SURFACE)
            return false;
    return true;
}

/* Returns the new value of removed samples: a value that the view does not show, or NaN. */
static double choose_empty(const struct sp_volume_info *info, const struct sp_view *view) {
    double empty = has_surfaces_only(view) ? info->range[0]
                                           : choose_transparent(info, &view->transfer_function);
    /* These show all values. */
    if (sp_compositing_is_projection(view->compositing.mode) || sp_view_draws_slices(view))
        return NAN;
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (view->layers[i].type == SP_LAYER_SURFACE && !(empty < view->layers[i].value))
            return NAN;
    return empty;
}

static void make_key(struct key *key, const struct sp_volume *volume, const struct sp_view *view) {
    memset(key, 0, sizeof *key);
    key->empty = choose_empty(sp_volume_info(volume), view);
    key->count = view->edit_count;
    memcpy(key->edits, view->edits, view->edit_count * sizeof view->edits[0]);
}

/* The smallest floating-point type that holds all values of a type. */
static enum sp_type type_for_holes(enum sp_type type) {
    return type == SP_INT32 || type == SP_FLOAT64 ? SP_FLOAT64 : SP_FLOAT32;
}

/* Of the numbers that a type holds. */
static const double limits[SP_TYPE_COUNT][2] = {
    [SP_UINT8] = { 0, UINT8_MAX },          [SP_INT8] = { INT8_MIN, INT8_MAX },
    [SP_UINT16] = { 0, UINT16_MAX },        [SP_INT16] = { INT16_MIN, INT16_MAX },
    [SP_INT32] = { INT32_MIN, INT32_MAX },  [SP_FLOAT32] = { -FLT_MAX, FLT_MAX },
    [SP_FLOAT64] = { -INFINITY, INFINITY },
};

bool sp_edited_keep(const struct sp_edited *edited, uint64_t at, double share) {
    enum sp_type type = edited->info->type;
    double value = sp_sample(edited->voxels, type, at);
    bool is_hole = isnan(edited->empty);
    if (!isfinite(value) || (is_hole && share >= 0.5))
        return false;
    double mixed = edited->empty + share * (value - edited->empty);
    if (type != SP_FLOAT32 && type != SP_FLOAT64)
        mixed = round(mixed);
    sp_sample_set(edited->voxels, type, at,
                  is_hole ? NAN : sp_clamp(mixed, limits[type][0], limits[type][1]));
    return is_hole;
}

static void release(void *voxels, size_t bytes) {
    (void)bytes;
    free(voxels);
}

/* Applies edits [first, key->count) to the samples. */
static bool apply(const struct key *key, uint32_t first, struct sp_edited *edited,
                  struct sp_error *err) {
    for (uint32_t i = first; i < key->count; i++) {
        const struct sp_edit *edit = &key->edits[i];
        if (edit->type != SP_EDIT_PART)
            sp_edit_cut(edited, edit);
        else if (!sp_edit_part(edited, edit, err))
            return false;
    }
    return true;
}

struct copy {
    const void *from;
    enum sp_type type;
    const struct sp_edited *to;
};

/* Copies samples to a floating-point type. */
static void convert_rows(void *user, size_t begin, size_t end, unsigned worker) {
    const struct copy *copy = user;
    const size_t width = copy->to->info->grid.dims[0];
    (void)worker;
    for (size_t i = begin * width; i < end * width; i++) {
        double value = sp_sample(copy->from, copy->type, i);
        if (copy->to->info->type == SP_FLOAT32)
            ((float *)copy->to->voxels)[i] = (float)value;
        else
            ((double *)copy->to->voxels)[i] = value;
    }
}

static void copy_samples(const struct sp_volume *from, const struct sp_edited *to) {
    const struct sp_volume_info *info = sp_volume_info(from);
    const uint32_t *dims = info->grid.dims;
    struct copy copy = { sp_volume_voxels(from), info->type, to };
    if (info->type == to->info->type)
        memcpy(to->voxels, copy.from, info->voxel_bytes);
    else
        sp_parallel_for(to->pool, (size_t)dims[1] * dims[2], 64, convert_rows, &copy);
}

/* Makes the edited volume from one that has the first `done` edits already. */
static struct sp_volume *make(const struct sp_volume *from, const struct key *key, uint32_t done,
                              struct sp_error *err) {
    struct sp_volume_info info = *sp_volume_info(from);
    const uint64_t count = info.voxel_bytes / sp_type_size(info.type);
    if (isnan(key->empty))
        info.type = type_for_holes(info.type);
    size_t capacity = (count * sp_type_size(info.type) + 63) & ~(uint64_t)63;
    void *voxels = aligned_alloc(64, capacity);
    if (!voxels) {
        sp_fail(err, SP_ERR_MEMORY, "/edits", "out of memory for a copy of the volume");
        return NULL;
    }
    struct sp_edited edited = { .info = &info,
                                .voxels = voxels,
                                .empty = key->empty,
                                .pool = sp_pool_create(sp_volume_threads(), err) };
    if (edited.pool)
        copy_samples(from, &edited);
    if (!edited.pool || !apply(key, done, &edited, err)) {
        sp_pool_destroy(&edited.pool);
        free(voxels);
        return NULL;
    }
    sp_pool_destroy(&edited.pool);
    return sp_volume_derive(from, info.type, info.nonfinite + edited.holes, voxels, capacity,
                            release, err);
}

struct sp_volume *sp_edit_volume(struct sp_volume *volume, const struct sp_view *view,
                                 struct sp_error *err) {
    struct key key, old;
    size_t bytes = sizeof old;
    if (view->edit_count == 0)
        return sp_volume_ref(volume);
    make_key(&key, volume, view);
    struct sp_volume *made = sp_volume_derived(volume, &old, &bytes);
    if (made && bytes == key_bytes(&key) && memcmp(&old, &key, bytes) == 0)
        return made;
    /* Further edits begin where the last ones ended. */
    bool goes_on = made && memcmp(&old.empty, &key.empty, sizeof key.empty) == 0 &&
                   old.count < key.count &&
                   memcmp(old.edits, key.edits, old.count * sizeof old.edits[0]) == 0;
    struct sp_volume *edited =
        goes_on ? make(made, &key, old.count, err) : make(volume, &key, 0, err);
    sp_volume_unref(&made);
    if (edited)
        sp_volume_set_derived(volume, edited, &key, key_bytes(&key));
    return edited;
}

struct sp_volume *sp_edit_volume_made(struct sp_volume *volume, const struct sp_view *view) {
    struct key key, old;
    size_t bytes = sizeof old;
    make_key(&key, volume, view);
    struct sp_volume *made = view->edit_count ? sp_volume_derived(volume, &old, &bytes) : NULL;
    if (made && bytes == key_bytes(&key) && memcmp(&old, &key, bytes) == 0)
        return made;
    sp_volume_unref(&made);
    return sp_volume_ref(volume);
}
