/* SPDX-License-Identifier: Apache-2.0
 *
 * The parent's side of an import: starts `splat-import` for one file, checks its messages, and
 * turns the memory that it filled into a volume. Safe in a process with many threads: only system
 * calls run between fork and exec, descriptors close on exec, and the parent waits for the child by
 * its process id.
 */
#ifndef SP_IMPORT_LAUNCH_H
#define SP_IMPORT_LAUNCH_H

#include "sp/volume.h"

/* Implements sp_volume_load() for the source of a file. */
struct sp_volume *sp_import(const char *source, const struct sp_load_options *options,
                            struct sp_error *err);

/* Like sp_import(), but writes the samples to an unnamed file in `folder`, so that they need no
 * memory. Vectors follow them as sp_volume_layout() says, if info->vector_bytes is not 0. Returns
 * the descriptor, which the caller closes, and fills *info without range and histogram; the caller
 * frees *numbers, to which its coordinates and times point. Without keeps_axes, rectilinear axes
 * are refused before samples are read. −1 with *err set. SP_ERR_UNSUPPORTED: no grid, or axes that
 * are refused. */
int sp_import_samples(const char *source, const struct sp_load_options *options, const char *folder,
                      bool keeps_axes, struct sp_volume_info *info, double **numbers,
                      struct sp_error *err);

#endif
