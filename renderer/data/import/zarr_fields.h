/* SPDX-License-Identifier: Apache-2.0
 *
 * The arrays of a Zarr hierarchy without OME metadata, as array_reader.h sees the arrays of other
 * files: all arrays of a group and of the groups in it, or one array alone. xarray writes the
 * conventions of CF into their attributes.
 */
#ifndef SP_IMPORT_ZARR_FIELDS_H
#define SP_IMPORT_ZARR_FIELDS_H

#include "data/import/array_bridge.h"
#include "data/import/zarr_array.h"

struct zarr_fields;

/* Lists the arrays at and below a node. The store and the file must stay valid until
 * zarr_fields_close(). NULL with *err set; SP_ERR_UNSUPPORTED if there are none. */
struct zarr_fields *zarr_fields_open(const struct zarr_node *node, const struct import_file *file,
                                     struct sp_error *err);
void zarr_fields_close(struct zarr_fields **fields);

/* The metadata of array n, which describe() says has numbers. */
const struct zarr_array *zarr_fields_array(const struct zarr_fields *fields, unsigned n);

/* open() and close() are NULL. */
extern const struct array_functions zarr_field_functions;

#endif
