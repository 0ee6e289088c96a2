/* SPDX-License-Identifier: Apache-2.0 */
#ifndef PROTO_VOLUME_H
#define PROTO_VOLUME_H

#include <stdbool.h>

#include "protocol/json.h"
#include "sp/volume.h"

/* {"id", "name", "source", "dims", "spacing", "origin", "direction" (3 rows), "unit", "type",
 * "components", "range", "nonfinite", "bytes"}; of a rectilinear grid "coordinates", an array or
 * null an axis; if wanted, "histogram": {"range", "counts"} of 256 bins. The daemon adds "state",
 * "progress" and "memory". NULL when out of memory. */
proto_json *proto_volume_encode(const struct sp_volume_info *info, const char *id,
                                bool with_histogram);

#endif
