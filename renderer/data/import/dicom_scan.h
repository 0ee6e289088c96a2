/* SPDX-License-Identifier: Apache-2.0
 *
 * The images of the DICOM files of a folder. The header of each file is read once.
 *
 *   files ─► headers ─► without copies and damaged files ─► stacks ─► series
 *
 * A stack is what one volume can show: images of one series with one size and direction, at several
 * places and times; or the frames of one file. A series may have several, such as an
 * overview beside the slices.
 */
#ifndef SP_IMPORT_DICOM_SCAN_H
#define SP_IMPORT_DICOM_SCAN_H

#include "data/import/dicom_file.h"
#include "data/import/folder.h"

enum { DICOM_FOLDERS_MAX = 1 << 12 }; /* sub-folders that are read */

struct dicom_found {
    char *name; /* owned; relative to the folder of the source; "" = the file that was opened, if
                   the folder has it under no name */
    uint32_t stack;
    uint32_t series; /* its number: images of one series have the same */
    bool is_copy;    /* of the image copy_of */
    uint32_t copy_of;
    uint64_t bytes; /* of the file */
    struct dicom_image image;
};

struct dicom_stack {
    uint32_t first;  /* of its images */
    uint32_t next;   /* the stack of the same series before it; UINT32_MAX = none */
    uint32_t frames; /* of all its files */
    bool is_main;    /* the largest stack of its series */
    uint64_t samples, bytes;
};

struct dicom_scan {
    struct dicom_found *images; /* owned; in the order of numbers in names, but the file that was
                                   opened comes first */
    uint32_t count;
    struct dicom_stack *stacks; /* owned */
    uint32_t stack_count;
    uint32_t copies;             /* images that are copies */
    struct import_names damaged; /* "NAME: why" */
    bool is_bounded;             /* there are more files, which were not looked at */
};

/* Reads the headers of the files of a folder; also of its sub-folders if the source is a folder
 * or a DICOMDIR. The file that was opened, unless it is a DICOMDIR, is
 * an image for sure. The caller finishes *scan, also after a failure. */
bool dicom_scan_read(const struct dicom_source *source, struct dicom_scan *scan,
                     struct sp_error *err);

void dicom_scan_finish(struct dicom_scan *scan);

/* Lists the series of the source; for struct import_format. */
bool dicom_list_series(const struct dicom_source *source, struct import_series_list *list,
                       struct sp_error *err);

/* True if the images belong to one series. */
bool dicom_is_same_series(const struct dicom_image *a, const struct dicom_image *b);

/* The first image of a stack. */
static inline const struct dicom_image *dicom_scan_image(const struct dicom_scan *scan,
                                                         uint32_t stack) {
    return &scan->images[scan->stacks[stack].first].image;
}

/* The larger of two stacks: it has more images, or else more samples, or else comes first by the
 * number of its series. */
uint32_t dicom_scan_larger(const struct dicom_scan *scan, uint32_t a, uint32_t b);

#endif
