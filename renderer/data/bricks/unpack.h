/* SPDX-License-Identifier: Apache-2.0
 *
 * All samples of a brick file, for other formats.
 */
#ifndef SP_BRICKS_UNPACK_H
#define SP_BRICKS_UNPACK_H

#include "sp/volume.h"

/* Writes the finest level to an unnamed file in `folder`, i0 fastest, one row of bricks after
 * another, followed by the vectors as sp_volume_layout() defines. Fills *info from the header;
 * names and source stay empty. *numbers: the coordinates, malloc'ed; the caller frees them. Takes
 * over the descriptor `file`, also on failure; `title` is its name in errors. Of the options, which
 * are not NULL, progress() is called. Returns a descriptor, which the caller closes; −1 with *err
 * set. A damaged brick is an error, and so are rectilinear axes without keeps_axes. */
int sp_bricks_unpack(int file, const char *title, const char *folder, bool keeps_axes,
                     const struct sp_load_options *options, struct sp_volume_info *info,
                     double **numbers, struct sp_error *err);

#endif
