/* SPDX-License-Identifier: Apache-2.0
 *
 * An image of a Zarr hierarchy: a list of levels from OME-Zarr 0.4 or 0.5 ("multiscales"), or one
 * plain array as the only level. A brick cache needs no more than this and zarr_chunk.h.
 */
#ifndef SP_IMPORT_ZARR_IMAGE_H
#define SP_IMPORT_ZARR_IMAGE_H

#include "import/axes.h"
#include "import/zarr_array.h"

enum { ZARR_LEVELS_MAX = 32, ZARR_CHANNELS_MAX = 1024 };

struct zarr_level {
    struct zarr_array array;
    double spacing[3], origin[3]; /* of x, y, z [unit of the image] */
    uint32_t dims[3];             /* of x, y, z; 1 without such a dimension */
};

struct zarr_image {
    struct zarr_level *levels; /* owned; the finest first */
    unsigned level_count;      /* at least 1 */
    struct import_axes axes;
    uint32_t channels;           /* at least 1 */
    uint64_t steps;              /* at least 1 */
    double first_time, interval; /* of the steps [time_unit]; interval 0 = unknown */
    char time_unit[SP_UNIT_BYTES];
    char unit[SP_UNIT_BYTES];
    char anatomy[4];               /* where x, y and z point to, in any handedness; "" = unknown */
    char (*names)[SP_FIELD_BYTES]; /* owned: of the channels or arrays; "" = none */
    unsigned name_count;           /* channels, or arrays of a plain group */
    unsigned chosen;               /* the array of a plain group that was chosen, among the names */
    bool is_group;                 /* the names are those of arrays */
};

/* Finds the image. `field` chooses among the arrays of a plain group. All levels have one rank and
 * number type, and dims in [1, SP_DIM_MAX] or more: the caller checks them. */
bool zarr_image_open(struct zarr_image *image, const struct zarr_store *store, const char *field,
                     struct sp_error *err);
/* Applies "?as=" of the source: channels become steps, or steps channels. The image must be open.
 */
bool zarr_image_choose(struct zarr_image *image, const struct import_file *file,
                       struct import_header *header, struct sp_error *err);
void zarr_image_close(struct zarr_image *image);

#endif
