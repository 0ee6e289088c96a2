/* SPDX-License-Identifier: Apache-2.0
 *
 * What is kept on the GPU of the volumes that were drawn: samples, and lists of visible voxels
 * level by level (list.h). They are made there (classify.h), or uploaded as the processor made them
 * (classify/visible.h). A change of colours uploads a table.
 *
 * Samples and lists share one budget: the least recently used go. A volume whose samples have no
 * room beside its lists, or in a buffer, is classified by the processor.
 */
#ifndef GL_RESIDENCY_H
#define GL_RESIDENCY_H

#include "backend/gl/buffer.h"
#include "backend/gl/classify.h"
#include "backend/gl/visible_list.h"
#include "backend/gl/voxels.h"
#include "classify/classification.h"

enum {
    GL_LISTS = 32, /* of all volumes and levels */
    GL_VOLUMES = 16,
    GL_REFUSED_FRAMES = 64
};

struct gl_residency {
    struct gl_visible_list list[GL_LISTS];
    struct gl_voxels voxels[GL_VOLUMES];
    struct gl_classify classify;
    uint64_t clock;
    uint64_t frame;        /* the clock when this frame began: what was used since stays */
    uint64_t limit_bytes;  /* beyond this the least recently used go … */
    uint64_t beside_bytes; /* … with what else counts in it */
    uint64_t block_bytes;  /* the most that a shader sees of one buffer; 0 = not known */
    uint64_t uploaded;     /* bytes, since the beginning */
    bool tries_again;      /* a frame that lacks room is tried again: no volume is refused yet */
};

/* What a list is made of. */
struct gl_list_source {
    const struct sp_volume *volume;
    const struct sp_level *level;
    struct gl_voxels *voxels; /* the GPU makes the list, the finest one from them; NULL = the level
                                 has entries */
    const struct gl_list_source *finer; /* of a coarse level that the GPU makes; else NULL */
    bool normals;                       /* then it makes normals as well */
    enum sp_tf_order order;
    struct sp_pool *pool;
    const atomic_bool *cancel; /* NULL = never */
};

/* Programs; block_bytes as above. SP_ERR_BACKEND; gl_residency_finish() also after a failure, and
 * then they can be initialised again. A context must be current, here and below. */
bool gl_residency_init(struct gl_residency *residency, bool software, uint64_t block_bytes,
                       struct sp_error *err);
void gl_residency_finish(struct gl_residency *residency);

/* A frame begins: lists that were got for the one before may go. */
static inline void gl_residency_begin(struct gl_residency *residency) {
    residency->frame = residency->clock;
}

/* The samples that the GPU classifies the volume from, uploaded when they are needed; valid until
 * the next frame begins. NULL: the processor classifies it, which is so for 64-bit reals
 * (gl_visible_ranges_is_possible()), and volumes that were refused, at which is looked again: after
 * GL_REFUSED_FRAMES frames of theirs, after twice as many the next time. */
struct gl_voxels *gl_residency_voxels(struct gl_residency *residency, struct sp_volume *volume);

/* Uploads the samples, unless they are there, and sees to what classifying them in this order
 * takes. SP_ERR_BUDGET, SP_ERR_MEMORY, SP_ERR_CANCELLED, SP_ERR_BACKEND. cancel: NULL = never. */
bool gl_residency_load(struct gl_residency *residency, struct gl_voxels *voxels,
                       enum sp_tf_order order, const atomic_bool *cancel, struct sp_error *err);

/* From now on the processor classifies their volume: logs why, the first time. */
void gl_residency_refuse(struct gl_voxels *voxels, const struct sp_error *why);

/* The level's list on the GPU, brought up to date; valid until the next frame begins. NULL with
 * *err set: SP_ERR_BUDGET, SP_ERR_MEMORY, SP_ERR_CANCELLED, SP_ERR_BACKEND. */
const struct gl_visible_list *gl_residency_get(struct gl_residency *residency,
                                               const struct gl_list_source *source,
                                               struct sp_error *err);

/* What is not of this frame makes room for beside_bytes. SP_ERR_BUDGET. */
bool gl_residency_trim(struct gl_residency *residency, struct sp_error *err);

/* Drops all samples, also those of this frame, whose lists are made: the next ones upload them
 * again. Whether there were any. */
bool gl_residency_drop_samples(struct gl_residency *residency);

/* Drops what is there of the volume; NULL = of any. */
void gl_residency_evict(struct gl_residency *residency, const struct sp_volume *volume);

/* The context is gone, and all that was there: lets go of what is not. No context is needed. */
void gl_residency_lose(struct gl_residency *residency);

/* Bytes on the GPU for the volume; NULL = for all. */
uint64_t gl_residency_bytes(const struct gl_residency *residency, const struct sp_volume *volume);

#endif
