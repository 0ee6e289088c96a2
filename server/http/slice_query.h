/* SPDX-License-Identifier: Apache-2.0
 *
 * The query of a slice (openapi.yaml, getSlice): which plane, in which window, in which format.
 */
#ifndef SRV_HTTP_SLICE_QUERY_H
#define SRV_HTTP_SLICE_QUERY_H

#include "sp/slice.h"

enum srv_slice_format { SRV_SLICE_PNG, SRV_SLICE_JPEG, SRV_SLICE_RAW };

struct srv_slice_query {
    bool is_oblique;
    bool has_level;
    uint32_t level;       /* of an orthogonal slice's samples; without has_level: of the volume's */
    uint32_t axis, index; /* orthogonal */
    struct sp_slice_plane plane; /* oblique */
    double window[2];            /* centre, width > 0; {0, 0} = the volume's */
    enum srv_slice_format format;
    bool is_colored; /* by the transfer function of the view; images only */
};

/* Returns the value of a query parameter; NULL = it is not given. */
typedef const char *srv_query_get(void *user, const char *name);

/* Reads the parameters. SP_ERR_FORMAT: a value is malformed. SP_ERR_INVALID: parameters that do not
 * belong together. err->place is the parameter. */
bool srv_slice_query_read(struct srv_slice_query *query, srv_query_get *get, void *user,
                          struct sp_error *err);

/* Finds the slice in a volume. SP_ERR_INVALID: a value is out of range. */
bool srv_slice_query_resolve(const struct srv_slice_query *query, const struct sp_volume_info *info,
                             struct sp_slice *slice, struct sp_error *err);

#endif
