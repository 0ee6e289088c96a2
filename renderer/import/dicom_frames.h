/* SPDX-License-Identifier: Apache-2.0
 *
 * The frames of one file.
 */
#ifndef SP_IMPORT_DICOM_FRAMES_H
#define SP_IMPORT_DICOM_FRAMES_H

#include "import/dicom_slices.h"

/* Adds a slice for each frame of the file that was opened. */
bool dicom_frames_list(const struct dicom_source *source, struct dicom_slices *slices,
                       struct sp_error *err);

#endif
