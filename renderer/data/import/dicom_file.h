/* SPDX-License-Identifier: Apache-2.0
 *
 * One DICOM file: the one that was opened, or another file of its folder.
 */
#ifndef SP_IMPORT_DICOM_FILE_H
#define SP_IMPORT_DICOM_FILE_H

#include <math.h>

#include "data/import/dicom_bridge.h"
#include "data/import/format.h"

enum { DICOM_PREFIX = 132 }; /* bytes that dicom_is_file() needs */

struct dicom_source {
    const struct import_file *file; /* that was opened; may be a folder or a DICOMDIR */
    const struct dicom_bridge_functions *call;
    bool is_named;            /* one image was opened by its name, so it is part of the volume */
    char name[PATH_MAX];      /* of the file whose image follows, in the folder; "" = that one */
    struct dicom_image image; /* of the first file of the volume */
};

/* True if a file that begins with these bytes is DICOM. */
bool dicom_is_file(const uint8_t *start, size_t size);

/* True for the usual endings of the names of DICOM files. */
bool dicom_has_ending(const char *name);

/* Fails with the place "FILE: NAME", or "FILE" if the name is "". */
bool dicom_fail(const struct dicom_source *source, enum sp_code code, const char *name,
                const char *text, struct sp_error *err);

/* Opens a file of the folder; "" is the file that was opened. Returns −1 with *err set. Close it
 * with dicom_close(). */
int dicom_open(const struct dicom_source *source, const char *name, struct sp_error *err);
void dicom_close(const struct dicom_source *source, int fd);

/* Reads what the file says about its image. Leaves the place of *err to the caller. */
bool dicom_describe(const struct dicom_source *source, int fd, struct dicom_image *image,
                    struct sp_error *err);

/* Numbers rise, before NaN, so that the order is total. */
static inline int dicom_compare_numbers(double a, double b) {
    if (isnan(a) || isnan(b))
        return isnan(a) - isnan(b);
    return (a > b) - (a < b);
}

#endif
