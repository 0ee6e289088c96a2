/* SPDX-License-Identifier: Apache-2.0
 *
 * The data of volumes that stays resident on the GPU: samples, and lists of visible voxels per mip
 * level (visible_list.h). The GPU makes the lists (classify.h), or the processor makes them
 * (classify/visible.h) and they are uploaded. A change of colours uploads a table only.
 *
 * Samples and lists share one budget; the least recently used are evicted. If the samples of a
 * volume do not fit beside its lists, or into one buffer, the processor classifies the volume.
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
    GL_RESIDENTS = 48,
    GL_REFUSED_FRAMES = 64
};

/* A buffer of resampled sheets (resample_data.h), or of other layers. */
enum gl_resident_kind {
    GL_RESIDENT_SAMPLES,
    GL_RESIDENT_CODES,
    GL_RESIDENT_VISIBLE,
    GL_RESIDENT_INTEGRAL,
    GL_RESIDENT_PLACES,
    GL_RESIDENT_SURFACE,  /* points (surfaces.h) */
    GL_RESIDENT_VERTICES, /* of a mesh (meshes.h) */
    GL_RESIDENT_TRIANGLES,
    GL_RESIDENT_ELEMENTS, /* points or Gaussians (splat_layers.h) */
    GL_RESIDENT_HARMONICS
};

struct gl_resident {
    /* Not references; NULL = empty. `original` is sp_volume_original() of the volume. */
    const struct sp_volume *volume, *original;
    enum gl_resident_kind kind;
    uint64_t made; /* serial number of the contents, unique among items of this kind */
    uint64_t used; /* clock of the last use */
    bool is_filled;
    struct gl_buffer buffer;
    struct sp_volume *held; /* elements: a reference, so that the address is not reused */
    float least;            /* GL_RESIDENT_VERTICES: opacity of a vertex; 0 = not known */
};

struct gl_residency {
    struct gl_resident items[GL_RESIDENTS];
    struct gl_visible_list list[GL_LISTS];
    struct gl_voxels voxels[GL_VOLUMES];
    struct gl_classify classify;
    uint64_t clock;
    uint64_t frame;        /* the clock when this frame began: data used since then stays */
    uint64_t limit_bytes;  /* budget of samples, lists and beside_bytes */
    uint64_t beside_bytes; /* other GPU memory that counts */
    uint64_t block_bytes;  /* largest buffer that a shader can read; 0 = not known */
    uint64_t uploaded;     /* bytes since the start */
    bool tries_again;      /* a frame without memory is tried again: do not refuse a volume yet */
};

/* The source of a list. */
struct gl_list_source {
    const struct sp_volume *volume;
    const struct sp_level *level;
    struct gl_voxels *voxels; /* the GPU makes the list, the finest list from these samples; NULL =
                                 the level has entries */
    const struct gl_list_source *finer; /* of a coarse level that the GPU makes; else NULL */
    bool normals;                       /* the GPU also makes normals */
    enum sp_tf_order order;
    struct sp_pool *pool;
    const atomic_bool *cancel; /* NULL = never */
};

/* Compiles the programs. SP_ERR_BACKEND. Call gl_residency_finish() also after a failure; then the
 * struct can be initialised again. A context must be current, here and below. */
bool gl_residency_init(struct gl_residency *residency, bool software, uint64_t block_bytes,
                       struct sp_error *err);
void gl_residency_finish(struct gl_residency *residency);

/* Begins a frame: lists of the previous frame may be evicted. */
static inline void gl_residency_begin(struct gl_residency *residency) {
    residency->frame = residency->clock;
}

/* Returns the samples from which the GPU classifies the volume. They are uploaded when needed and
 * valid until the next frame begins. NULL = the processor classifies the volume, because it has
 * 64-bit reals (gl_visible_ranges_is_possible()) or was refused. A refused volume is tried again
 * after GL_REFUSED_FRAMES frames with this volume, and after twice as many frames each next
 * time. */
struct gl_voxels *gl_residency_voxels(struct gl_residency *residency, struct sp_volume *volume);

/* Uploads the samples, unless they are resident, and prepares the data that classification in this
 * order needs. SP_ERR_BUDGET, SP_ERR_MEMORY, SP_ERR_CANCELLED, SP_ERR_BACKEND. cancel:
 * NULL = never. */
bool gl_residency_load(struct gl_residency *residency, struct gl_voxels *voxels,
                       enum sp_tf_order order, const atomic_bool *cancel, struct sp_error *err);

/* Lets the processor classify the volume from now on. Logs the reason the first time. */
void gl_residency_leave_to_cpu(struct gl_voxels *voxels, const struct sp_error *why);

/* Returns the level's list, up to date and valid until the next frame begins. NULL with
 * *err set: SP_ERR_BUDGET, SP_ERR_MEMORY, SP_ERR_CANCELLED, SP_ERR_BACKEND. */
const struct gl_visible_list *gl_residency_get(struct gl_residency *residency,
                                               const struct gl_list_source *source,
                                               struct sp_error *err);

/* Returns the item with these contents, valid until the next frame begins. If is_filled is false,
 * the item is new: its buffer has space for `bytes`, and the caller fills it and sets is_filled.
 * `what` names the contents in errors, for instance "samples". NULL with *err set: SP_ERR_BUDGET,
 * SP_ERR_MEMORY. */
struct gl_resident *gl_residency_get_item(struct gl_residency *residency,
                                          const struct sp_volume *volume,
                                          enum gl_resident_kind kind, uint64_t made, uint64_t bytes,
                                          const char *what, struct sp_error *err);

/* Evicts data of other frames until the remaining data and beside_bytes fit the limit.
 * SP_ERR_BUDGET. */
bool gl_residency_trim(struct gl_residency *residency, struct sp_error *err);

/* Drops all samples, also the samples of this frame, whose lists must be complete; the next lists
 * upload them again. False if there were no samples. */
bool gl_residency_drop_samples(struct gl_residency *residency);

/* Evicts the data of the volume; NULL = of all volumes. */
void gl_residency_evict(struct gl_residency *residency, const struct sp_volume *volume);

/* Drops everything after the context was lost. No context is needed. */
void gl_residency_lose(struct gl_residency *residency);

/* Returns the bytes of the volume's data on the GPU; NULL = of all volumes. */
uint64_t gl_residency_bytes(const struct gl_residency *residency, const struct sp_volume *volume);

#endif
