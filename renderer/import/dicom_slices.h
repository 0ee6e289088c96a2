/* SPDX-License-Identifier: Apache-2.0
 *
 * The slices of a DICOM volume: files of a folder (dicom_folder.h), or frames of one file
 * (dicom_frames.h). Both make one list, which is sorted, split into steps, and turned into a grid
 * (dicom_grid.h) by the same code.
 *
 *   folder ─┐
 *           ├─► list ─► sort by place ─► fields, steps ─► grid ─► pixels, slice by slice
 *   frames ─┘
 */
#ifndef SP_IMPORT_DICOM_SLICES_H
#define SP_IMPORT_DICOM_SLICES_H

#include "import/dicom_file.h"

struct dicom_slice {
    char *name;            /* owned; of the file in the folder; "" = the file that was opened */
    uint32_t frame;        /* of that file, from 0 */
    struct dicom_frame is; /* what the file says about it */
    double place;          /* along the normal of the slices [mm]; not placed: its number */
};

struct dicom_slices {
    struct dicom_slice *items; /* owned */
    uint32_t count, capacity;
};

/* Adds a slice. False if there is no memory. */
bool dicom_slices_add(struct dicom_slices *slices, const char *name, uint32_t frame,
                      const struct dicom_frame *is);

void dicom_slices_finish(struct dicom_slices *slices);

/* Sorts the slices by their places, and those of one place by their keys and numbers. */
void dicom_slices_sort(struct dicom_slices *slices);

/* Splits slices that share their places into steps, and keeps those of the wanted one. Fails if
 * the places have different numbers of slices. */
bool dicom_slices_take_step(struct dicom_slices *slices, const struct dicom_source *source,
                            struct import_header *header, struct sp_error *err);

#endif
