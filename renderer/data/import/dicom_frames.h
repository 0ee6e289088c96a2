/* SPDX-License-Identifier: Apache-2.0
 *
 * The frames of a file.
 */
#ifndef SP_IMPORT_DICOM_FRAMES_H
#define SP_IMPORT_DICOM_FRAMES_H

#include "data/import/dicom_slices.h"

/* Adds a slice for each frame of a file of the folder, whose image this is; "" is the file that was
 * opened. */
bool dicom_frames_add(const struct dicom_source *source, const char *name,
                      const struct dicom_image *image, struct dicom_slices *slices,
                      struct sp_error *err);

/* Keeps the largest stack of the frames of all files, with a warning, and finds in which direction
 * they lie. */
bool dicom_frames_choose(const struct dicom_source *source, struct dicom_slices *slices,
                         struct sp_error *err);

#endif
