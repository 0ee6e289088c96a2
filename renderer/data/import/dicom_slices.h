/* SPDX-License-Identifier: Apache-2.0
 *
 * The slices of a DICOM volume: files of a folder (dicom_folder.h), or frames of one file
 * (dicom_frames.h). Both make one list, which is sorted, split into fields and steps, and turned
 * into a grid (dicom_grid.h) by the same code.
 *
 *   folder ─┐
 *           ├─► list ─► sort by place ─► field, step ─► grid ─► pixels, slice by slice
 *   frames ─┘
 *
 * Slices of one place differ in their keys. What they show makes fields (echoes, diffusion, types
 * of images, segments); when they show it makes steps.
 */
#ifndef SP_IMPORT_DICOM_SLICES_H
#define SP_IMPORT_DICOM_SLICES_H

#include "data/import/dicom_file.h"

struct dicom_slice {
    char *name;            /* owned; of the file in the folder; "" = the file that was opened */
    uint32_t frame;        /* of that file, from 0 */
    bool is_frame;         /* the file has several */
    struct dicom_frame is; /* what the file says about it */
    double place;          /* along the normal of the slices [mm]; not placed: its slot */
    uint32_t plane;        /* number of its place, from 0 */
};

struct dicom_plane {
    double position[3]; /* of its first slice */
    double place;       /* as in struct dicom_slice */
};

struct dicom_slices {
    struct dicom_slice *items; /* owned */
    uint32_t count;
    struct dicom_plane *plane; /* owned; the different places, sorted */
    uint32_t planes;           /* how many there are */
    bool has_gaps;   /* planes without slices are added where places lie on a grid of their smallest
                        distance, as files leave out empty frames of segments */
    bool is_falling; /* sorted against the normal: the file has its frames in this order */
    bool are_together; /* the slices of one plane are segments of one label volume */
    double *times;     /* owned; of the steps, for import_header */
};

/* Adds a slice: the only image of a file, or one of its frames. False if there is no memory. */
bool dicom_slices_add(struct dicom_slices *slices, const char *name, uint32_t frame, bool is_frame,
                      const struct dicom_frame *is);

void dicom_slices_finish(struct dicom_slices *slices);

/* Keeps the slices for which this is true. */
void dicom_slices_keep(struct dicom_slices *slices,
                       bool (*is_kept)(const struct dicom_slice *slice, const void *user),
                       const void *user);

/* Numbers the different texts of the slices in the keys: texts in the order of the alphabet,
 * directions in the order of the list. Keys that have a number keep it. False if there is no
 * memory. */
bool dicom_slices_rank(struct dicom_slices *slices);

/* Sorts the slices by their places, and slices of one place by their keys and numbers. Finds the
 * planes, also the missing ones if has_gaps. False if there is no memory. */
bool dicom_slices_sort(struct dicom_slices *slices);

/* What messages call a slice: the name of its file, or the number of its frame. */
void dicom_slice_name(const struct dicom_slice *slice, char out[80]);

/* Splits slices that share their places into steps, and keeps the slices of one step: of the wanted
 * step, or else of the step that has the opened file. Fails if
 * the places have different numbers of slices. */
bool dicom_slices_choose_step(struct dicom_slices *slices, const struct dicom_source *source,
                              struct import_header *header, struct sp_error *err);

/* Keeps the slices of the wanted field and lists the others. */
bool dicom_slices_choose_field(struct dicom_slices *slices, const struct dicom_source *source,
                               struct import_header *header, struct sp_error *err);

#endif
