/* SPDX-License-Identifier: Apache-2.0
 *
 * The data of a volume and a transfer function that resampled sheets read on the GPU. The samples
 * of the finest level are shared with the lists of voxels. Data per level, per transfer function or
 * per axis is an item of the residency.
 */
#ifndef GL_RESAMPLE_DATA_H
#define GL_RESAMPLE_DATA_H

#include "backend/gl/resample_programs.h"
#include "backend/gl/residency.h"
#include "draw/resample/prepare.h"

struct gl_resample_data {
    enum gl_samples_kind kind;
    const struct gl_buffer *samples;
    const struct gl_buffer *visible;  /* samples_class.visible, of the frame's axis */
    const struct gl_buffer *integral; /* curve.integral */
    /* tables of rectilinear axes, one after the other: place[dims] and index[steps + 1] per axis;
     * NULL = no axis is rectilinear */
    const struct gl_buffer *places;
};

/* Uploads the data that is not resident. The buffers are valid until the next frame begins.
 * SP_ERR_MEMORY, SP_ERR_BUDGET, SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_resample_data_get(struct gl_resample_data *data, struct gl_residency *residency,
                          struct sp_volume *volume, const struct sp_resample *resample,
                          struct sp_pool *pool, struct sp_error *err);

/* Returns the visible intervals between slices of another axis, for the same frame. NULL on
 * failure, errors as above. */
const struct gl_buffer *gl_resample_data_turn(struct gl_residency *residency,
                                              struct sp_volume *volume,
                                              const struct sp_resample *resample,
                                              struct sp_error *err);

#endif
