/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/levels.h"

struct work {
    struct gl_lists *lists;
    struct gl_voxels *voxels; /* NULL = the processor classifies */
    const atomic_bool *cancel;
};

static bool count(void *user, const struct sp_level *level, uint64_t *counts,
                  struct sp_error *err) {
    const struct work *w = user;
    return gl_lists_load(w->lists, w->voxels, w->cancel, err) &&
           gl_classify_count(&w->lists->classify, w->voxels, level, w->cancel, counts, err);
}

static bool get(struct gl_levels *levels, const struct work *w, struct sp_classify_cache *cache,
                struct sp_volume *volume, const struct sp_classify_job *wanted,
                struct sp_error *err) {
    const struct sp_counter counter = { count, (void *)w };
    struct sp_classify_job job = *wanted;
    job.counter = w->voxels ? &counter : NULL;
    const struct sp_classification *c = sp_classify_cache_get(cache, volume, &job, err);
    *levels = (struct gl_levels){ .visible = c ? c->visible : 0 };
    for (unsigned l = 0; c && job.levels >> l; l++) {
        const struct gl_list_source from = { .volume = volume,
                                             .level = &c->levels[l],
                                             .voxels = l == 0 ? w->voxels : NULL,
                                             .normals = job.normals,
                                             .pool = job.pool,
                                             .cancel = job.cancel };
        if (job.levels >> l & 1 && !(levels->lists[l] = gl_lists_get(w->lists, &from, err)))
            return false;
    }
    return c != NULL;
}

bool gl_levels_get(struct gl_levels *levels, struct gl_lists *lists,
                   struct sp_classify_cache *cache, struct sp_volume *volume,
                   const struct sp_classify_job *job, struct sp_error *err) {
    struct sp_error why = { .code = SP_OK };
    gl_lists_begin(lists);
    struct work w = { lists, gl_lists_voxels(lists, volume, job->tf->order), job->cancel };
    if (w.voxels && get(levels, &w, cache, volume, job, &why))
        return true;
    bool has_no_room = why.code == SP_ERR_BUDGET || why.code == SP_ERR_MEMORY;
    if (w.voxels && !has_no_room)
        return sp_fail(err, why.code, why.place, "%s", why.text);
    if (w.voxels)
        gl_lists_refuse(w.voxels, &why);
    w.voxels = NULL;
    return get(levels, &w, cache, volume, job, err);
}
