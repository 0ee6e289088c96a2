/* SPDX-License-Identifier: Apache-2.0
 *
 * The files of a folder that make one volume: the stack of the file that was opened, or of the
 * series that the source names, or else the largest one.
 */
#ifndef SP_IMPORT_DICOM_FOLDER_H
#define SP_IMPORT_DICOM_FOLDER_H

#include "data/import/dicom_scan.h"
#include "data/import/dicom_slices.h"

/* Adds the slices of all files of the folder that belong to the volume, and makes source->image the
 * image of the first one, and source->name its name. Warns of what is left out. SP_ERR_NOT_FOUND:
 * there is no image, or no such series. */
bool dicom_folder_list(struct dicom_source *source, struct dicom_slices *slices,
                       struct sp_error *err);

#endif
