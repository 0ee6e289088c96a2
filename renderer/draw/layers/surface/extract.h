/* SPDX-License-Identifier: Apache-2.0
 *
 * Extracts the points of an iso-surface from a volume.
 */
#ifndef SP_SURFACE_EXTRACT_H
#define SP_SURFACE_EXTRACT_H

#include "base/arena.h"
#include "draw/layers/surface/focus.h"
#include "draw/layers/surface/points.h"
#include "draw/layers/surface/ranges.h"

/* Extracts the points of the surface of job->value. The order of the points does not depend on the
 * number of threads. Fails with SP_ERR_BUDGET, before it makes the points, if they need more than
 * bytes_max. SP_ERR_MEMORY, SP_ERR_CANCELLED. After a failure *points is empty. */
bool sp_surface_extract(struct sp_surface_points *points, const struct sp_surface_job *job,
                        const struct sp_surface_ranges *ranges, uint64_t bytes_max,
                        struct sp_error *err);

/* Extracts the points of the blocks of `far` that are close to the eye (sp_surface_focus_has()), in
 * parts of cells that are as small as the focus says. The points lie in the arena. SP_ERR_MEMORY,
 * SP_ERR_FRAME_BUDGET, SP_ERR_CANCELLED; *points has no valid contents then. */
bool sp_surface_extract_near(const struct sp_surface_job *job, const struct sp_surface_focus *focus,
                             const struct sp_surface_points *far, struct sp_arena *arena,
                             struct sp_surface_points *points, struct sp_error *err);

#endif
