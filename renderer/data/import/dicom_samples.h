/* SPDX-License-Identifier: Apache-2.0
 *
 * The numbers of the frames of one DICOM file: unpacked, in native byte order, without unused bits,
 * colours as red, green and blue.
 */
#ifndef SP_IMPORT_DICOM_SAMPLES_H
#define SP_IMPORT_DICOM_SAMPLES_H

#include "data/import/conversion.h"
#include "data/import/dicom_file.h"

struct dicom_samples {
    const struct dicom_source *source;
    struct dicom_image image; /* as the file stores it: a mosaic is one frame */
    struct import_number number;
    unsigned channels; /* numbers per pixel */
    const char *name;  /* of the file, borrowed */
    int fd;
    void *packed;                 /* of the module; NULL = the pixels are not packed */
    struct dicom_palette palette; /* of DICOM_PALETTE */
    uint8_t *raw;                 /* owned; a frame as the file has it */
    size_t raw_bytes;
    unsigned tiles; /* of a mosaic, per row and column; 0 = no mosaic */
    char *mosaic;   /* owned; NULL = not yet read */
};

/* How memory holds the numbers of an image, and their count per pixel. Fails, with the name of its
 * file, for types that are not supported. */
bool dicom_samples_type(const struct dicom_source *source, const struct dicom_image *image,
                        const char *name, struct import_number *number, unsigned *channels,
                        struct sp_error *err);

/* Checks that the pixels of an open file are not cut off, not tiles of a larger image or of a
 * mosaic of unknown size, and not colours of a kind that is not supported. Leaves the place of *err
 * to the caller. */
bool dicom_samples_check(const struct dicom_image *image, int fd, struct sp_error *err);

/* Opens a file of the folder; "" is the file that was opened. Its image must have the size and the
 * channels of the source's image. */
bool dicom_samples_open(struct dicom_samples *samples, const struct dicom_source *source,
                        const char *name, struct sp_error *err);

/* Reads one frame, from 0. */
bool dicom_samples_read(struct dicom_samples *samples, uint32_t frame, void *out,
                        struct sp_error *err);

void dicom_samples_close(struct dicom_samples *samples);

#endif
