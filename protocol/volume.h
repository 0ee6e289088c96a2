/* SPDX-License-Identifier: Apache-2.0 */
#ifndef PROTO_VOLUME_H
#define PROTO_VOLUME_H

#include <stdbool.h>

#include "protocol/json.h"
#include "sp/histogram.h"
#include "sp/visible_part.h"
#include "sp/volume.h"

/* Encodes {"id", "name", "source", "dims", "spacing", "origin", "direction" (3 rows), "unit",
 * "type", "components", "range", "nonfinite", "fields", "bytes"}, and "other_fields",
 * "other_vectors", "warnings", "steps", "meaning", "vertical" and "first_layout" unless they are
 * empty. "vertical" is {"per_unit", "unit"}, see struct sp_vertical. "fields" lists the samples,
 * and then the vectors if there are any: {"name", "components", "type", "range"}. A grid also has
 * "noise", null = unknown; a rectilinear one "coordinates": per axis an array, or null if the axis
 * is evenly spaced.
 * with_histogram adds "histogram": {"range", "counts"} with 256 bins. The daemon adds "state",
 * "progress" and "memory". NULL when out of memory. Thread-safe. */
proto_json *proto_volume_encode(const struct sp_volume_info *info, const char *id,
                                bool with_histogram);

/* Encodes a histogram for an editor of transfer functions: {"volume": id, "type", "axes",
 * "samples", "counts", "windows"}. `joint` NULL: the 256 bins of the values. Otherwise: the bins of
 * value and gradient magnitude, one row per bin of the magnitude. "windows" has
 * sp_projection_window() per projection: {"center", "width"}. NULL when out of memory.
 * Thread-safe. */
proto_json *proto_histogram_encode(const struct sp_volume_info *info, const char *id,
                                   const struct sp_joint_histogram *joint);

/* Encodes {"volume": id, "visible", "box", "center", "half", "radius"}. NULL when out of memory.
 * Thread-safe. */
proto_json *proto_visible_part_encode(const struct sp_visible_part *part, const char *id);

#endif
