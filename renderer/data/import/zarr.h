/* SPDX-License-Identifier: Apache-2.0
 *
 * The format "Zarr" on any store: zarr.c gives it the folder of a file, tests other stores.
 */
#ifndef SP_IMPORT_ZARR_H
#define SP_IMPORT_ZARR_H

#include "data/import/zarr_store.h"

struct zarr; /* import_zarr.reader_size bytes */

/* As open(), read() and close() of struct import_format. The store must stay valid until
 * zarr_close(). */
bool zarr_open(struct zarr *z, const struct zarr_store *store, const struct import_file *file,
               struct import_header *header, struct sp_error *err);
bool zarr_read(void *reader, void *voxels, float (*vectors)[3],
               const struct import_progress *progress, struct sp_error *err);
void zarr_close(void *reader);

#endif
