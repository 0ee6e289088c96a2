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

/* What the name of an output may end with, for messages. */
#define SP_CONVERT_SUFFIXES ".bricks, .nrrd, .nii, .nii.gz, .vdb, .zarr"

/* Converts what sp_volume_load() reads from `source` to `out`, in the format that the end
 * of its name states: a file, or a folder for OME-Zarr. It is written completely or not at all, in
 * place of an older file, or of a folder that this function wrote; it replaces no other folder
 * (SP_ERR_INVALID). What is
 * kept of a volume (renderer/data/export/README.md): samples in their type, spacing, origin,
 * direction, units and names as far as the format has them; vectors and rectilinear axes in brick
 * files only. Other fields and other time steps than options->step are left out; a warning in the
 * log says so, as it does of vectors.
 *
 * The samples pass through a file without a name in the folder of `out`, so that memory does not
 * grow with the number of slices. Built-in volumes may have up to 4096 samples per axis here. Of
 * `options`, which may be NULL, reserve() is not called. Blocks until it is done. Thread-safe.
 * Errors are those of sp_volume_load(), and SP_ERR_UNSUPPORTED for other suffixes and for what the
 * format cannot say: volumes that are no grids; rectilinear axes but in brick files; a unit that is
 * none of length in NIfTI; turned axes in OME-Zarr. */
SP_API bool sp_convert(const char *source, const char *out, const struct sp_load_options *options,
                       struct sp_error *err);

/* Checks the end of a name alone: SP_ERR_UNSUPPORTED. */
SP_API bool sp_convert_check(const char *out, struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
