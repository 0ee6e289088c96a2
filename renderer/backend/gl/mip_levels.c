/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/mip_levels.h"

struct work {
    struct gl_residency *residency;
    struct gl_voxels *voxels; /* NULL = the processor classifies */
    const struct sp_classify_job *job;
    struct gl_list_source sources[SP_LEVELS];
};

/* Fills the sources of the lists of all levels up to `last`. */
static void fill_sources(struct work *w, const struct sp_classification *c, unsigned last) {
    for (unsigned l = 0; l <= last; l++)
        w->sources[l] =
            (struct gl_list_source){ .volume = c->volume,
                                     .level = &c->levels[l],
                                     .voxels = w->voxels,
                                     .finer = w->voxels && l > 0 ? &w->sources[l - 1] : NULL,
                                     .normals = w->job->normals,
                                     .order = w->job->tf->order,
                                     .pool = w->job->pool,
                                     .cancel = w->job->cancel };
}

static bool count(void *user, const struct sp_classification *c, unsigned level, uint64_t *counts,
                  struct sp_error *err) {
    struct work *w = user;
    struct gl_classify *classify = &w->residency->classify;
    if (level == 0)
        return gl_residency_load(w->residency, w->voxels, w->job->tf->order, w->job->cancel, err) &&
               gl_classify_count(classify, w->voxels, &c->levels[0], w->job->cancel, counts, err);
    fill_sources(w, c, level - 1);
    const struct gl_visible_list *finer =
        gl_residency_get(w->residency, &w->sources[level - 1], err);
    return finer && gl_classify_count_mip(classify, finer, w->job->tf->order == SP_TF_POST,
                                          &c->levels[level], w->job->cancel, counts, err);
}

static bool histogram(void *user, const struct sp_classification *c, uint64_t *counts,
                      struct sp_error *err) {
    struct work *w = user;
    return gl_residency_load(w->residency, w->voxels, w->job->tf->order, w->job->cancel, err) &&
           gl_classify_histogram(&w->residency->classify, w->voxels, c->levels[0].transfer.count,
                                 w->job->cancel, counts, err);
}

static bool get(struct gl_mip_levels *levels, struct work *w, struct sp_classify_cache *cache,
                struct sp_volume *volume, struct sp_error *err) {
    const struct sp_counter counter = { count, histogram, w };
    struct sp_classify_job job = *w->job;
    job.counter = w->voxels ? &counter : NULL;
    const struct sp_classification *c = sp_classify_cache_get(cache, volume, &job, err);
    *levels = (struct gl_mip_levels){ .visible = c ? c->visible : 0 };
    if (!c)
        return false;
    fill_sources(w, c, SP_LEVELS - 1);
    for (unsigned l = 0; job.levels >> l; l++)
        if (job.levels >> l & 1 &&
            !(levels->lists[l] = gl_residency_get(w->residency, &w->sources[l], err)))
            return false;
    return true;
}

bool gl_mip_levels_get(struct gl_mip_levels *levels, struct gl_residency *residency,
                       struct sp_classify_cache *cache, struct sp_volume *volume,
                       const struct sp_classify_job *job, struct sp_error *err) {
    struct sp_error why = { .code = SP_OK };
    gl_residency_begin(residency);
    struct work w = { .residency = residency,
                      .voxels = gl_residency_voxels(residency, volume),
                      .job = job };
    if (w.voxels && get(levels, &w, cache, volume, &why))
        return true;
    bool is_out_of_memory = why.code == SP_ERR_BUDGET || why.code == SP_ERR_MEMORY;
    if (w.voxels && !(is_out_of_memory && !residency->tries_again))
        return sp_fail(err, why.code, why.place, "%s", why.text);
    if (w.voxels)
        gl_residency_leave_to_cpu(w.voxels, &why);
    w.voxels = NULL;
    return get(levels, &w, cache, volume, err);
}
