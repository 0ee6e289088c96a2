/* SPDX-License-Identifier: Apache-2.0
 *
 * The part of GDCM that the DICOM reader needs, for C. GDCM is a module of its own,
 * DICOM_BRIDGE_MODULE beside the program, which dicom.c loads when a file may be DICOM. The module
 * exports one table of functions, DICOM_BRIDGE_SYMBOL. One file at a time, one thread.
 */
#ifndef SP_IMPORT_DICOM_BRIDGE_H
#define SP_IMPORT_DICOM_BRIDGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What tells apart images that show the same place. Each is a number that rises in the order in
 * which the images are listed; NaN = the file does not say. */
enum dicom_key {
    DICOM_KEY_ECHO,  /* time of the echo [ms] */
    DICOM_KEY_PHASE, /* temporal position, a number */
    DICOM_KEY_DELAY, /* time since a trigger, such as a heartbeat, or since the start [s] */
    DICOM_KEY_CLOCK, /* time of the acquisition [s], from any origin */
    DICOM_KEY_COUNT
};

struct dicom_frame {    /* what a file says about one of its images */
    bool is_placed;     /* the file gives the position and the directions */
    double position[3]; /* of the first pixel, in the patient: left, posterior, superior [mm] */
    double along[2][3]; /* directions of a row and of a column, unit length */
    double spacing[3];  /* between columns, rows and slices or frames [mm]; 0 = not known */
    double slope, intercept;
    double keys[DICOM_KEY_COUNT];
    long instance; /* number in the series; 0 = not known */
};

struct dicom_image { /* what a file says about its images */
    char series[68]; /* unique id of the series; "" = none */
    char modality[20];
    char rescale_type[20]; /* "HU", "US" = unspecified, …; "" = the file does not say */
    char description[68];  /* of the series */
    uint32_t columns, rows, frames;
    unsigned channels;    /* numbers per pixel, which alternate */
    unsigned bytes, bits; /* per number: in memory, and those that are used */
    bool is_signed, is_float, is_palette,
        is_other_color;       /* colours that are not red, green, blue */
    bool is_packed;           /* the pixels do not lie in the file as in memory */
    uint64_t pixels_at;       /* byte of the file where they begin; 0 = not known */
    struct dicom_frame first; /* the first frame */
};

struct dicom_bridge_functions {
    /* Reads everything but the pixels. False with the reason in `why` (`capacity` bytes). */
    bool (*describe)(const char *path, struct dicom_image *image, char *why, size_t capacity);
    /* Unpacks the pixels of all frames into `size` bytes, in native byte order, colours
     * alternating. If they are cut off in the file, the rest is 0. */
    bool (*read)(const char *path, void *out, size_t size, char *why, size_t capacity);
};

#define DICOM_BRIDGE_MODULE "splat-import-dicom.so"
#define DICOM_BRIDGE_SYMBOL "splat_dicom_bridge"
extern const struct dicom_bridge_functions splat_dicom_bridge;

#ifdef __cplusplus
}
#endif
#endif
