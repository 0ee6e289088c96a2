/* SPDX-License-Identifier: Apache-2.0
 *
 * The files of a folder that belong to one series.
 */
#ifndef SP_IMPORT_DICOM_FOLDER_H
#define SP_IMPORT_DICOM_FOLDER_H

#include "import/dicom_slices.h"

/* Adds the slices of all files of the folder that belong to the series of the file. */
bool dicom_folder_list(const struct dicom_source *source, struct dicom_slices *slices,
                       struct sp_error *err);

#endif
