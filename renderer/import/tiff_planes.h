/* SPDX-License-Identifier: Apache-2.0
 *
 * Which page of a TIFF is which slice, channel and step in time: from the OME-XML of an OME-TIFF,
 * or from the description that ImageJ writes.
 */
#ifndef SP_IMPORT_TIFF_PLANES_H
#define SP_IMPORT_TIFF_PLANES_H

#include "import/format.h"

struct tiff_planes {
    uint32_t slices, channels, steps; /* at least 1; channels that have pages of their own */
    uint32_t *pages; /* owned: of slice k, channel c and step t at (t·channels + c)·slices + k */
    char (*names)[SP_FIELD_BYTES]; /* owned: of the channels; "" = none. NULL = all have none */
    double spacing[3];             /* of x, y and z; 0 = unknown */
    char unit[SP_UNIT_BYTES];
    double interval; /* of the steps; 0 = unknown */
    char time_unit[SP_UNIT_BYTES];
};

enum { TIFF_NO_PAGE = UINT32_MAX };

/* Allocates the pages, of which none is known yet. `most`: how many pages the file has; more
 * planes than a hundred times that are refused. */
bool tiff_planes_allocate(struct tiff_planes *planes, const struct import_file *file, uint32_t most,
                          struct sp_error *err);
void tiff_planes_finish(struct tiff_planes *planes);

/* True if a description is OME-XML. */
bool tiff_is_ome(const char *description);

/* Reads OME-XML of `size` bytes. `pages`: of the file; `samples`: channels within a page. Only the
 * first image is read. Planes in other files are an error that names one. */
bool tiff_ome_parse(struct tiff_planes *planes, const struct import_file *file, const char *xml,
                    size_t size, uint32_t pages, unsigned samples, struct sp_error *err);

#endif
