/* SPDX-License-Identifier: Apache-2.0
 *
 * Measurements of connected parts. A part consists of the samples whose values lie in a range and
 * that are connected with a point through the faces of such samples.
 *
 *   volume   the cells of its samples
 *   area     the iso-surfaces at both ends of the range, between samples of the part and others
 *   path     along the samples at its border, then pulled tight on the iso-surface of the lowest
 *            value: a geodesic, or a curve close to one
 *
 * A part that reaches the border of the volume is open there: that face has no area.
 */
#ifndef SP_PART_H
#define SP_PART_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/api.h"
#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { SP_PART_PATH_MAX = 1025 /* points of a path, at most */ };
/* Most memory for the points of a surface: enough for at least 50 million points. */
#define SP_PART_AREA_BYTES (UINT64_C(1) << 30)

struct sp_part {
    double point[3]; /* world; in the part, or at most two samples away from it */
    double range[2]; /* lowest and highest value, data unit */
};

struct sp_part_size {
    bool is_found; /* false: no sample in the range is near the point, and all other fields are 0 */
    uint64_t samples; /* samples in the part */
    double volume;    /* world unit³ */
    double area;      /* world unit², without the area on the border of the volume */
    bool is_open;     /* the part reaches the border of the volume */
};

struct sp_part_path {
    bool is_found;   /* false: there is no part at one end, or the ends lie on different parts */
    double straight; /* straight distance between the ends, world units */
    double length;   /* of the path, world units */
    uint32_t count;  /* points of the path, the ends included, [2, SP_PART_PATH_MAX] */
    double points[SP_PART_PATH_MAX][3]; /* world */
};

/* Measures a part. Takes about 20 ns per sample of the volume. SP_ERR_MEMORY; SP_ERR_BUDGET if the
 * iso-surface at one end of the range needs more than SP_PART_AREA_BYTES for all parts together.
 * Thread-safe. */
SP_API bool sp_part_measure(const struct sp_volume *volume, const struct sp_part *part,
                            struct sp_part_size *size, struct sp_error *err);

/* Finds a shortest path on the surface of the part, from part->point to the world position `to`.
 * SP_ERR_MEMORY. Thread-safe. */
SP_API bool sp_part_find_path(const struct sp_volume *volume, const struct sp_part *part,
                              const double to[3], struct sp_part_path *path, struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
