/* SPDX-License-Identifier: Apache-2.0
 *
 * The header of a NIfTI or ANALYZE 7.5 file as typed fields, and the grid that they describe.
 */
#ifndef SP_IMPORT_NIFTI_HEADER_H
#define SP_IMPORT_NIFTI_HEADER_H

#include "data/import/meaning.h"

enum {
    NIFTI_SINGLE_START = 4, /* bytes between a header and samples in one file, at least */
    NIFTI_COMPONENTS_MAX = 65536
};

/* Where a version of the header has its numbers, and of which type they are. */
struct nifti_layout {
    int size;
    struct import_number count, code, real, units, offset;
    size_t dims, datatype, pixdim, offset_at, slope, start_at, units_at, forms, quaternion, shift,
        rows, intent, intent_name, magic;
};

struct nifti_fields {
    const struct nifti_layout *layout;
    bool is_packed, is_swapped;
    bool is_analyze; /* ANALYZE 7.5: no space, no unit, no intent */
    bool is_single;  /* the samples are in the file of the header */
    double dims[8], pixdim[8];
    int datatype, intent, units, time_units, qform, sform;
    double offset, slope, inter, start; /* start: the time of the first step */
    double quaternion[3], shift[3], rows[3][4];
    char intent_name[17];
    enum import_as as; /* of the entries of dims[5], or of dims[4] if it is TIME */
    bool are_fsl;      /* vectors lie along the axes of the grid, x to the left, as in FSL */
};

/* True if the unpacked file begins with the size of a header, in either byte order. */
bool nifti_is_header(const uint8_t start[4]);

bool nifti_header_read(const struct import_file *file, struct nifti_fields *fields,
                       struct sp_error *err);

/* Places the grid in the world by the sform, the qform or the spacing alone; its dims must be set.
 * The axes of the world point right, anterior and superior, in the scanner or in an atlas; or the
 * file does not say. Warns if a form is no map, or if both place the samples differently. */
void nifti_place(const struct import_file *file, const struct nifti_fields *fields,
                 struct import_header *header);

/* Fails if the intent code says that the file has no volume. Warns if its numbers are not what they
 * look like. */
bool nifti_check_intent(const struct import_file *file, const struct nifti_fields *fields,
                        struct sp_error *err);

/* Decides what the dimensions beyond the third are, and leaves steps in dims[4] and components in
 * dims[5]. May read the samples. */
bool nifti_choose_axes(const struct import_file *file, struct nifti_fields *fields,
                       struct import_header *header, struct sp_error *err);

/* Sets the axes of the vectors, once the grid is placed. */
void nifti_place_vectors(const struct nifti_fields *fields, struct import_header *header);

/* The names of the components; NULL = they have none. */
const char *const *nifti_component_names(const struct import_file *file,
                                         const struct nifti_fields *fields);

#endif
