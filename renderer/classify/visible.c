/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/visible.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "classify/coarse.h"
#include "classify/gradient.h"

enum {
    CHUNK = 1024,         /* voxels whose keys are made at a time */
    NORMALS_GRAIN = 4096, /* entries a block */
};
/* Above this size only the list in use is kept beside the one along axis 2. */
#define SPARE_LIST_BYTES (UINT64_C(96) << 20)

static bool is_cancelled(const atomic_bool *cancel) {
    return cancel && atomic_load_explicit(cancel, memory_order_relaxed);
}

void sp_visible_finish(struct sp_visible *list) {
    free(list->first);
    free(list->position);
    free(list->key);
    free(list->normal);
    *list = (struct sp_visible){ 0 };
}

static uint64_t entry_bytes(const struct sp_visible *list, bool normals) {
    return sizeof *list->position + sizeof *list->key + (normals ? sizeof *list->normal : 0);
}

static uint64_t list_bytes(const struct sp_visible *list) {
    if (!list->slices)
        return 0;
    return (list->slices + UINT64_C(1)) * sizeof *list->first +
           list->count * entry_bytes(list, list->normal != NULL);
}

static void *allocate(uint64_t count, size_t size) {
    return count > SIZE_MAX / 2 / size ? NULL : malloc(count ? count * size : 1);
}

bool sp_visible_allocate(struct sp_visible *list, bool normals, struct sp_error *err) {
    list->position = allocate(list->count, sizeof *list->position);
    list->key = allocate(list->count, sizeof *list->key);
    if (normals)
        list->normal = allocate(list->count, sizeof *list->normal);
    if (list->position && list->key && (!normals || list->normal))
        return true;
    return sp_fail(err, SP_ERR_MEMORY, "", "no memory for a list of %llu visible voxels",
                   (unsigned long long)list->count);
}

/* May the classification grow by `more` bytes for `count` visible voxels? */
static bool may_grow(const struct sp_classification *c, const struct sp_classify_job *job,
                     uint64_t count, uint64_t more, struct sp_error *err) {
    uint64_t need = sp_classification_bytes(c) + more;
    if (job->bytes_max == 0 || need <= job->bytes_max)
        return true;
    return sp_fail(
        err, SP_ERR_BUDGET, "/transfer_function",
        "%llu voxels are visible, which takes %llu bytes beside the volume, and %llu are "
        "allowed: make fewer visible, or allow more memory",
        (unsigned long long)count, (unsigned long long)need, (unsigned long long)job->bytes_max);
}

struct collect {
    const struct sp_transfer *transfer;
    const void *voxels;
    uint32_t dims[3];
    struct sp_visible *list;
    const atomic_bool *cancel;
};

static void count_slices(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct collect *c = user;
    uint32_t keys[CHUNK];
    uint8_t visible[CHUNK];
    size_t slice = (size_t)c->dims[0] * c->dims[1];
    for (size_t s = begin; s < end && !is_cancelled(c->cancel); s++) {
        uint64_t count = 0;
        for (size_t at = 0; at < slice; at += CHUNK) {
            size_t n = slice - at < CHUNK ? slice - at : CHUNK;
            sp_transfer_keys(c->transfer, c->voxels, s * slice + at, n, keys, visible);
            unsigned some = 0;
            for (size_t i = 0; i < n; i++)
                some += visible[i];
            count += some;
        }
        c->list->first[s + 1] = count;
    }
}

static void fill_slices(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct collect *c = user;
    uint32_t keys[CHUNK];
    uint8_t visible[CHUNK];
    for (size_t s = begin; s < end && !is_cancelled(c->cancel); s++) {
        uint64_t out = c->list->first[s], stop = c->list->first[s + 1];
        for (uint32_t i1 = 0; i1 < c->dims[1] && out < stop; i1++)
            for (uint32_t i0 = 0; i0 < c->dims[0]; i0 += CHUNK) {
                size_t n = c->dims[0] - i0 < CHUNK ? c->dims[0] - i0 : CHUNK;
                size_t at = (s * c->dims[1] + i1) * c->dims[0] + i0;
                sp_transfer_keys(c->transfer, c->voxels, at, n, keys, visible);
                for (size_t i = 0; i < n; i++)
                    if (visible[i]) {
                        c->list->position[out] = (uint32_t)(i0 + i) | i1 << 16;
                        c->list->key[out++] = keys[i];
                    }
            }
        assert(out == stop);
    }
}

static bool collect_visible(struct sp_classification *c, const struct sp_classify_job *job,
                            struct sp_error *err) {
    struct sp_level *level = &c->levels[0];
    const uint32_t *dims = level->grid.dims;
    struct sp_visible *list = &level->lists[2];
    struct collect collect = { .transfer = &level->transfer,
                               .voxels = sp_volume_voxels(c->volume),
                               .dims = { dims[0], dims[1], dims[2] },
                               .list = list,
                               .cancel = job->cancel };
    list->slices = dims[2];
    list->first = calloc(list->slices + (size_t)1, sizeof *list->first);
    if (!list->first)
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory for %u slices", list->slices);
    sp_parallel_for(job->pool, list->slices, 1, count_slices, &collect);
    if (is_cancelled(job->cancel))
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    for (uint32_t s = 0; s < list->slices; s++)
        list->first[s + 1] += list->first[s];
    list->count = list->first[list->slices];
    /* All that will follow is asked for at once, so that a refusal costs a pass and no memory. */
    uint64_t count = list->count, entry = entry_bytes(list, job->normals);
    list->count = 0; /* not there yet */
    if (!may_grow(c, job, count, count * entry * (job->axis == 2 ? 1 : 2), err))
        return false;
    list->count = count;
    if (!sp_visible_allocate(list, false, err))
        return false;
    sp_parallel_for(job->pool, list->slices, 1, fill_slices, &collect);
    return !is_cancelled(job->cancel) || sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
}

struct normals {
    struct sp_gradient_grid grid;
    struct sp_visible *list;
    uint32_t *normal;
    const atomic_bool *cancel;
};

/* The slice that entry e lies in. */
static uint32_t find_slice(const struct sp_visible *list, uint64_t e) {
    uint32_t low = 0, high = list->slices;
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        if (list->first[middle] <= e)
            low = middle;
        else
            high = middle;
    }
    return low;
}

static void pack_normals(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct normals *n = user;
    if (is_cancelled(n->cancel))
        return;
    uint32_t s = find_slice(n->list, begin);
    for (size_t e = begin; e < end; e++) {
        while (e >= n->list->first[s + 1])
            s++;
        uint32_t p = n->list->position[e], i[3] = { p & 0xffff, p >> 16, s };
        double gradient[3];
        sp_gradient_at(&n->grid, i, gradient);
        n->normal[e] = sp_gradient_pack(&n->grid, gradient);
    }
}

static bool make_normals(struct sp_classification *c, const struct sp_classify_job *job,
                         struct sp_error *err) {
    struct sp_visible *list = &c->levels[0].lists[2];
    struct normals n = { .list = list, .cancel = job->cancel };
    if (!may_grow(c, job, list->count, list->count * sizeof *n.normal, err))
        return false;
    n.normal = allocate(list->count, sizeof *n.normal);
    if (!n.normal)
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory for %llu gradients",
                       (unsigned long long)list->count);
    sp_gradient_grid_init(&n.grid, c->volume);
    sp_parallel_for(job->pool, list->count, NORMALS_GRAIN, pack_normals, &n);
    if (is_cancelled(job->cancel)) {
        free(n.normal);
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    }
    list->normal = n.normal;
    return true;
}

/* A stable counting sort of the list along axis 2, so that the order inside a slice is that of
 * memory. */
static bool permute_list(struct sp_level *level, const struct sp_classify_job *job,
                         struct sp_error *err) {
    const struct sp_visible *from = &level->lists[2];
    struct sp_visible *to = &level->lists[job->axis];
    unsigned shift = job->axis == 0 ? 0 : 16;
    to->slices = level->grid.dims[job->axis];
    to->count = from->count;
    to->first = calloc(to->slices + (size_t)1, sizeof *to->first);
    if (!to->first)
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory for %u slices", to->slices);
    if (!sp_visible_allocate(to, from->normal != NULL, err))
        return false;
    for (uint64_t e = 0; e < from->count; e++)
        to->first[from->position[e] >> shift & 0xffff]++;
    uint64_t sum = 0;
    for (uint32_t s = 0; s <= to->slices; s++) { /* first[s] = begin of slice s, for now */
        uint64_t n = to->first[s];
        to->first[s] = sum;
        sum += n;
    }
    for (uint32_t i2 = 0; i2 < from->slices; i2++) {
        if (is_cancelled(job->cancel))
            return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
        for (uint64_t e = from->first[i2]; e < from->first[i2 + 1]; e++) {
            uint32_t p = from->position[e];
            uint64_t out = to->first[p >> shift & 0xffff]++;
            to->position[out] = (p >> (16 - shift) & 0xffff) | i2 << 16;
            to->key[out] = from->key[e];
            if (to->normal)
                to->normal[out] = from->normal[e];
        }
    }
    /* Now first[s] is the end of slice s, which is the begin of the next. */
    memmove(to->first + 1, to->first, to->slices * sizeof *to->first);
    to->first[0] = 0;
    return true;
}

static void drop_lists(struct sp_level *level) {
    for (int axis = 0; axis < 3; axis++)
        sp_visible_finish(&level->lists[axis]);
}

void sp_level_finish(struct sp_level *level) {
    drop_lists(level);
    sp_transfer_finish(&level->transfer);
    *level = (struct sp_level){ 0 };
}

void sp_classification_init(struct sp_classification *c, struct sp_volume *volume) {
    *c = (struct sp_classification){ .volume = sp_volume_ref(volume) };
    c->levels[0].grid = sp_volume_info(volume)->grid;
}

void sp_classification_finish(struct sp_classification *c) {
    for (int l = 0; l < SP_LEVELS; l++)
        sp_level_finish(&c->levels[l]);
    sp_volume_unref(&c->volume);
}

static bool update_transfer(struct sp_classification *c, const struct sp_transfer_function *tf,
                            struct sp_error *err) {
    struct sp_level *all = &c->levels[0];
    if (sp_transfer_function_equal(&all->transfer.tf, tf))
        return true;
    struct sp_transfer next;
    if (!sp_transfer_init(&next, tf, sp_volume_info(c->volume), err))
        return false;
    if (!sp_transfer_same_voxels(&all->transfer, &next))
        drop_lists(all);
    for (int l = 1; l < SP_LEVELS; l++) /* they hold colours */
        sp_level_finish(&c->levels[l]);
    sp_transfer_finish(&all->transfer);
    all->transfer = next;
    return true;
}

/* The list along axis 2 of all voxels, with normals if they are asked for. */
static bool update_all(struct sp_classification *c, const struct sp_classify_job *job,
                       struct sp_error *err) {
    struct sp_visible *list = &c->levels[0].lists[2];
    if (!list->slices && !collect_visible(c, job, err)) {
        drop_lists(&c->levels[0]);
        return false;
    }
    return !job->normals || list->normal || make_normals(c, job, err);
}

/* The same of a coarse level, from the next finer one. */
static bool update_coarse(struct sp_classification *c, unsigned l,
                          const struct sp_classify_job *job, struct sp_error *err) {
    struct sp_level *level = &c->levels[l];
    struct sp_visible *list = &level->lists[2];
    if (list->slices && (!job->normals || list->normal))
        return true;
    sp_level_finish(level);
    struct sp_classify_job rest = *job;
    uint64_t have = sp_classification_bytes(c);
    if (job->bytes_max)
        rest.bytes_max = have < job->bytes_max ? job->bytes_max - have : 1;
    if (sp_coarse_make(level, &c->levels[l - 1], &rest, err))
        return true;
    sp_level_finish(level);
    return false;
}

static bool update_axis(struct sp_classification *c, const struct sp_classify_job *job,
                        struct sp_error *err) {
    struct sp_level *level = &c->levels[job->level];
    struct sp_visible *base = &level->lists[2], *list = &level->lists[job->axis];
    if (list->slices && job->normals && !list->normal)
        sp_visible_finish(list);
    if (list->slices)
        return true;
    unsigned other = 1 - job->axis; /* not axis 2: that list exists */
    uint64_t more = base->count * entry_bytes(base, base->normal != NULL);
    if (list_bytes(base) > SPARE_LIST_BYTES || !may_grow(c, job, base->count, more, NULL))
        sp_visible_finish(&level->lists[other]);
    if (!may_grow(c, job, base->count, more, err))
        return false;
    if (permute_list(level, job, err))
        return true;
    sp_visible_finish(list);
    return false;
}

bool sp_classification_update(struct sp_classification *c, const struct sp_classify_job *job,
                              struct sp_error *err) {
    assert(job->axis < 3 && job->level < SP_LEVELS);
    if (!update_transfer(c, job->tf, err) || !update_all(c, job, err))
        return false;
    for (unsigned l = 1; l <= job->level; l++)
        if (!update_coarse(c, l, job, err))
            return false;
    return update_axis(c, job, err);
}

uint64_t sp_classification_bytes(const struct sp_classification *c) {
    uint64_t bytes = 0;
    for (int l = 0; l < SP_LEVELS; l++) {
        const struct sp_level *level = &c->levels[l];
        bytes += level->transfer.count * (uint64_t)(sizeof(struct sp_class) + 1);
        for (int axis = 0; axis < 3; axis++)
            bytes += list_bytes(&level->lists[axis]);
    }
    return bytes;
}
