/* SPDX-License-Identifier: Apache-2.0
 *
 * An image of a Zarr hierarchy: a list of levels from OME-Zarr 0.4 or 0.5 ("multiscales"), or one
 * plain array (zarr_fields.h) as the only level. A brick cache needs no more than this and
 * zarr_chunk.h.
 */
#ifndef SP_IMPORT_ZARR_IMAGE_H
#define SP_IMPORT_ZARR_IMAGE_H

#include "data/import/axes.h"
#include "data/import/zarr_array.h"

enum { ZARR_LEVELS_MAX = 32, ZARR_CHANNELS_MAX = 1024 };

struct zarr_level {
    struct zarr_array array;
    double spacing[3], origin[3]; /* of x, y, z [unit of the image] */
    bool is_turned[3];            /* x, y, z fall: the scale is negative */
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
    char (*names)[SP_FIELD_BYTES]; /* owned: of the channels; "" = none */
    unsigned name_count;           /* of channels */
    bool are_labels;               /* the numbers name objects */
    bool is_plain;                 /* there is no metadata of OME: nothing else is set */
};

/* Finds the image at a node. All levels have one rank and number type, and dims in [1, SP_DIM_MAX]
 * or more: the caller checks them. */
bool zarr_image_open(struct zarr_image *image, const struct zarr_node *node, struct sp_error *err);
/* Finds the image at the node of a group, with the level of this path as the only one. ZARR_MISSING
 * if the group has no image that lists it. */
enum zarr_found zarr_image_open_level(struct zarr_image *image, const struct zarr_node *node,
                                      const char *path, struct sp_error *err);
/* Makes an array the only level of a plain image. False without memory. */
bool zarr_image_use_array(struct zarr_image *image, const struct zarr_array *array,
                          const struct import_axes *axes);
/* Applies "?as=" of the source: channels become steps, or steps channels. The image must be open.
 */
bool zarr_image_choose(struct zarr_image *image, const struct import_file *file,
                       struct import_header *header, struct sp_error *err);
void zarr_image_close(struct zarr_image *image);

#endif
