/* SPDX-License-Identifier: Apache-2.0
 *
 * The common part of layers of triangles and layers of splats: arrays that stay on the GPU, and
 * sorting the records of a batch into the tiles of a band.
 */
#ifndef GL_ELEMENTS_H
#define GL_ELEMENTS_H

#include "backend/gl/band.h"

/* An array of a volume. */
struct gl_elements_array {
    const void *data;
    uint64_t bytes;      /* without gaps between the items */
    size_t item, stride; /* bytes of an item, and from one to the next; 0 = side by side */
};

/* Returns an item that holds the arrays, one behind the other. Uploads them unless they are
 * resident. `what` as in gl_residency_get_item(). NULL with *err set: SP_ERR_BUDGET, SP_ERR_MEMORY,
 * SP_ERR_CANCELLED. A context must be current, here and below. */
struct gl_resident *gl_elements_load(const struct gl_band *band, struct sp_volume *volume,
                                     enum gl_resident_kind kind, uint64_t made,
                                     const struct gl_elements_array *arrays, int count,
                                     const char *what, struct sp_error *err);

/* Reserves memory for batches of at most `records` records in at most `layers` layers. A record has
 * `record_bytes`, without its span. SP_ERR_MEMORY, SP_ERR_BUDGET. */
bool gl_elements_reserve(const struct gl_band *band, uint32_t records, uint32_t layers,
                         uint32_t record_bytes, struct sp_error *err);

/* Returns the tiles of the band, with `layers` layers. */
struct gl_bins_space gl_elements_space(const struct gl_band *band, uint32_t layers);

/* Runs the bound program, which makes records and counts their pairs (shaders/counts.glsl). Then
 * sorts the pairs. SP_ERR_CANCELLED, SP_ERR_BACKEND. */
bool gl_elements_sort(struct gl_band *band, const struct gl_bins_space *space, uint32_t records,
                      struct sp_error *err);

#endif
