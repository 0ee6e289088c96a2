/* SPDX-License-Identifier: Apache-2.0
 *
 * OME-Zarr 0.4 in Zarr v2: the folder of one image, with a level of detail per array.
 *
 *   OUT/.zgroup, .zattrs     what the image is (zarr_text.c)
 *   OUT/N/.zarray            what level N is, 0 = the finest
 *   OUT/N/z/y/x              a chunk of 64³ samples, packed by zstd (zarr.c); zeros have no file
 */
#ifndef SP_EXPORT_ZARR_H
#define SP_EXPORT_ZARR_H

#include "data/export/job.h"

enum { ZARR_CHUNK = 64, ZARR_LEVELS = 16, ZARR_ZSTD_LEVEL = 3 };

/* The beginning of .zattrs, which identifies a folder that convert wrote. */
#define ZARR_ATTRIBUTES_START "{\n  \"_creator\": { \"name\": \"splatctl convert\" },\n"

struct sp_zarr_level {
    uint32_t dims[3], chunk[3];
    double spacing[3], origin[3];
};

struct sp_zarr_image {
    const struct sp_export_job *job;
    struct sp_zarr_level level[ZARR_LEVELS];
    unsigned levels;
    char anatomy[4]; /* of x, y and z, in any handedness; "" = the source does not say */
    double range[2]; /* of the finite samples; least > most = there are none */
};

/* Computes the world, whose axes are the axes of the grid, and the levels: halves every axis until
 * one chunk holds the whole level. SP_ERR_UNSUPPORTED if the axes of the grid are turned, unless it
 * is by quarter turns in an anatomy. */
bool sp_zarr_image_init(struct sp_zarr_image *image, const struct sp_export_job *job,
                        struct sp_error *err);

/* Writes the metadata into the folder job->out; the folders of the levels are there. */
bool sp_zarr_write_text(const struct sp_zarr_image *image, struct sp_error *err);

#endif
