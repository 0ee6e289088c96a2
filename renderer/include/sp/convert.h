/* SPDX-License-Identifier: Apache-2.0
 *
 * Writes volumes in the formats of other programs.
 */
#ifndef SP_CONVERT_H
#define SP_CONVERT_H

#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The suffixes that the name of an output may have, for messages. */
#define SP_CONVERT_SUFFIXES ".bricks, .nrrd, .nii, .nii.gz, .vdb, .zarr"

/* Reads the volume `source` like sp_volume_load(), and writes it to `out`. The suffix of `out`
 * chooses the format: a file, or a folder for OME-Zarr. The output is written completely or not at
 * all. It replaces an older file, or a folder that this function wrote, but no other folder
 * (SP_ERR_INVALID). The output keeps the samples in their type, and spacing, origin, direction,
 * units and names as far as the format supports them; only brick files keep vectors and rectilinear
 * axes (renderer/data/export/README.md). Other fields, and time steps other than options->step, are
 * left out. A warning in the log lists what was left out, vectors included.
 *
 * The samples pass through an unnamed file in the folder of `out`, so that memory does not grow
 * with the number of slices. Built-in volumes may have up to 4096 samples per axis here. `options`
 * may be NULL; options->reserve() is not called. Blocks until the output is complete. Thread-safe.
 * Errors are those of sp_volume_load(), and SP_ERR_UNSUPPORTED for an unknown suffix and for data
 * that the format cannot store: volumes that are not grids; rectilinear axes, except in brick
 * files; in NIfTI a unit that is not a length; in OME-Zarr turned axes. */
SP_API bool sp_convert(const char *source, const char *out, const struct sp_load_options *options,
                       struct sp_error *err);

/* Checks only the suffix of a name: SP_ERR_UNSUPPORTED. */
SP_API bool sp_convert_check(const char *out, struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
