/* SPDX-License-Identifier: Apache-2.0
 *
 * Measurements of connected parts: the samples whose values lie in a range, as far as faces of such
 * samples connect them with a point.
 *
 *   volume   the cells of its samples
 *   area     the iso-surfaces of both ends of the range between the samples of the part and others
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
/* Memory for the points of a surface, at most: 50 million of them or more. */
#define SP_PART_AREA_BYTES (UINT64_C(1) << 30)

struct sp_part {
    double point[3]; /* of the part, or at most two samples beside it, world */
    double range[2]; /* lowest and highest value, data unit */
};

struct sp_part_size {
    bool is_found;    /* false: no sample of the range is near the point; all else is 0 */
    uint64_t samples; /* of the part */
    double volume;    /* world unit³ */
    double area;      /* world unit², without what lies on the border of the volume */
    bool is_open;     /* it reaches the border of the volume */
};

struct sp_part_path {
    bool is_found;   /* false: a part is missing at one end, or both ends are of different parts */
    double straight; /* distance of the ends, world units */
    double length;   /* of the path, world units */
    uint32_t count;  /* points of the path, the ends included, [2, SP_PART_PATH_MAX] */
    double points[SP_PART_PATH_MAX][3]; /* world */
};

/* Measures a part. Takes about 20 ns per sample of the volume. SP_ERR_MEMORY; SP_ERR_BUDGET if a
 * surface at an end of the range, of all parts together, needs more than SP_PART_AREA_BYTES.
 * Thread-safe. */
SP_API bool sp_part_measure(const struct sp_volume *volume, const struct sp_part *part,
                            struct sp_part_size *size, struct sp_error *err);

/* Finds a shortest path on the part's surface from its point to `to`, world. SP_ERR_MEMORY.
 * Thread-safe. */
SP_API bool sp_part_find_path(const struct sp_volume *volume, const struct sp_part *part,
                              const double to[3], struct sp_part_path *path, struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
