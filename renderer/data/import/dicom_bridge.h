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

#include "sp/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What an image shows, in words. Images of one place that differ in it are fields. */
enum dicom_trait {
    DICOM_TEXT_FLAVOUR, /* type of image, part of a complex one, or label of the segment */
    DICOM_TEXT_ORIGIN,  /* original or derived */
    DICOM_TEXT_QUANTITY,
    DICOM_TEXT_UNIT,
    DICOM_TEXT_KERNEL, /* of the reconstruction */
    DICOM_TEXT_FILTER,
    DICOM_TEXT_METHOD,
    DICOM_TEXT_CORRECTION,
    DICOM_TEXT_AGENT, /* of contrast */
    DICOM_TEXT_COIL,
    DICOM_TEXT_DESCRIPTION, /* of the series or of the derivation */
    DICOM_TEXT_OTHER,       /* dimensions that the reader does not know, detectors */
    DICOM_TEXT_DIRECTION,   /* of diffusion; its key is DICOM_KEY_DIRECTION */
    DICOM_TEXT_COUNT
};

/* What tells apart images that show the same place, in this order. The first keys number the
 * different texts (dicom_slices_rank()). NaN = the file does not say. */
enum dicom_key {
    DICOM_KEY_FLAVOUR = DICOM_TEXT_FLAVOUR,
    DICOM_KEY_OTHER = DICOM_TEXT_OTHER,
    DICOM_KEY_ECHO = DICOM_TEXT_OTHER + 1, /* time of the echo [ms] */
    DICOM_KEY_ECHO_NUMBER,                 /* where its time is not known */
    DICOM_KEY_DIFFUSION,                   /* b-value [s/mm²] */
    DICOM_KEY_DIRECTION,                   /* of diffusion: a number for each */
    DICOM_KEY_VOLTAGE,                     /* of the tube [kV] */
    DICOM_KEY_FLIP,                        /* [degree] */
    DICOM_KEY_INVERSION,                   /* time of the inversion [ms] */
    DICOM_KEY_THICKNESS,                   /* of the slice [mm] */
    DICOM_KEY_PHASE,                       /* temporal position, a number; the first key of times */
    DICOM_KEY_PERCENT,                     /* of the heartbeat */
    DICOM_KEY_DELAY, /* time since a trigger, such as a heartbeat, or since the start [s] */
    DICOM_KEY_CLOCK, /* time of the acquisition [s], since 1970; less than a day: no date known */
    DICOM_KEY_ACQUISITION, /* its number */
    DICOM_KEYS_OF_ORDER,   /* those before order images; those from here on do not */
    DICOM_KEY_CONTENT = DICOM_KEYS_OF_ORDER, /* when the image was made [s], like the clock */
    DICOM_KEY_COUNT
};

enum { DICOM_TEXT_BYTES = 44, DICOM_FRAMES_MAX = 1 << 18 };

struct dicom_frame {      /* what a file says about one of its images */
    bool is_placed;       /* the file gives the position and the directions */
    double position[3];   /* of the first pixel, in the patient: left, posterior, superior [mm] */
    double along[2][3];   /* directions of a row and of a column, unit length */
    double spacing[3];    /* between columns, rows and slices or frames [mm]; 0 = not known; the
                             spacing of slices is negative where they go against the normal */
    bool has_regions;     /* the spacing comes from one region of ultrasound, and others differ */
    bool is_turned_wrong; /* the file gives a position, but its directions are none */
    bool is_ratio;        /* only the ratio of the spacings of pixels is known: they have no unit */
    bool is_spaced;       /* the distance between slices is given, not only their thickness */
    bool is_assumed;      /* the file gives neither: the next frame is taken to lie 1 mm apart */
    bool is_contradicted; /* the offsets of a dose fit neither of their two meanings */
    double slope, intercept;
    double keys[DICOM_KEY_COUNT];
    char texts[DICOM_TEXT_COUNT][DICOM_TEXT_BYTES]; /* "" = the file does not say */
    double low, high;                               /* the numbers that its pixels can have */
    uint32_t segment;                               /* its label; 0 = this is no segmentation */
    char stack[20]; /* frames of other stacks are other volumes; "" = not known */
    char unit[32];  /* of the values after slope and intercept; "" = not known */
    double slot;    /* not placed: its number in the stack; frames with one number share a place */
    long instance;  /* number in the series; 0 = not known */
};

/* How a file stores colours. */
enum dicom_colors {
    DICOM_GRAY,
    DICOM_RGB,
    DICOM_YBR_FULL, /* luminance and colour differences of each pixel */
    DICOM_YBR_422,  /* the same with one pair of differences per two pixels of a row */
    DICOM_PALETTE,
    DICOM_OTHER_COLORS /* not supported */
};

/* What the frames of a file are to each other where the frames themselves do not say it. */
enum dicom_order { DICOM_ORDER_PLACES, DICOM_ORDER_TIMES };

struct dicom_image {  /* what a file says about its images */
    char id[68];      /* unique id of the file's images; "" = none */
    char series[68];  /* unique id of the series; "" = none */
    char patient[68]; /* id of the patient; "" = none */
    char space[68];   /* unique id of the frame of reference of positions; "" = none */
    bool has_number;
    long number;       /* of the series in its study */
    bool is_directory; /* the file is a DICOMDIR */
    char modality[20];
    char description[68];           /* of the series, UTF-8 */
    uint32_t columns, rows, frames; /* columns 0 = the file has no image */
    bool has_empty_image;           /* the file has pixels, but columns or rows are 0 */
    unsigned channels;              /* numbers per pixel */
    unsigned bytes, bits;           /* per number: in memory, and used */
    unsigned high_bit;              /* the highest of the bits that are used */
    bool is_signed, is_float;
    bool is_bits;    /* one bit per pixel, without a gap between rows or frames */
    bool is_planar;  /* each frame has its channels one after the other */
    bool is_packed;  /* the pixels are compressed */
    bool is_swapped; /* their byte order is not that of this machine */
    bool is_labels;  /* the frames are segments, each pixel in it or not */
    bool has_words;  /* bytes lie in words of 2, whose byte order is not that of this machine */
    bool has_labels; /* the pixels are labels of segments */
    bool is_tiled;   /* the frames are tiles of one large image, as of a microscope */
    double tiled[2]; /* columns and rows of this image; NaN = not known */
    unsigned planes; /* of focus, or colours, where such an image is one tile; 0 = several tiles */
    bool has_places; /* each frame has a place of its own: frames of several files make a stack */
    bool is_mosaic;  /* the frames are tiles of one image as the file stores it, row by row */
    unsigned tiles;  /* of a mosaic: tiles per row and per column; 0 = not known */
    bool is_in_patient; /* the positions are those of a patient, not of a device */
    enum dicom_colors colors;
    char color_name[20]; /* in the file (PhotometricInterpretation) */
    enum dicom_order order;
    char note[160];    /* a sentence for the user on what the reader does not apply; "" = none */
    double frame_time; /* [s] between frames in time; 0 = not known */
    uint64_t pixels_at, pixels_bytes; /* where they lie in the file; 0 = not known */
    struct dicom_frame first;         /* the first frame */
};

/* Colours of a palette: rows of red, green, blue for the values from `first` on. */
struct dicom_palette {
    long first;
    uint32_t count;
    uint8_t (*colors)[3]; /* owned; release with free() */
    bool is_rounded;      /* the file has 16 bits per colour that 8 do not hold */
};

struct dicom_bridge_functions {
    /* Reads everything but the pixels. Functions that fail set *err but for its place. */
    bool (*describe)(const char *path, struct dicom_image *image, struct sp_error *err);
    /* Describes `count` frames. */
    bool (*describe_frames)(const char *path, struct dicom_frame *frames, uint32_t count,
                            struct sp_error *err);
    /* Opens compressed pixels. NULL on failure. If their code has other colours than
     * *image says, corrects image->colors, and says so in image->note, which otherwise stays. */
    void *(*open_pixels)(const char *path, struct dicom_image *image, struct sp_error *err);
    /* Unpacks one frame into `size` bytes, in native byte order, with the channels of a pixel side
     * by side. */
    bool (*read_frame)(void *pixels, uint32_t frame, void *out, size_t size, struct sp_error *err);
    void (*close_pixels)(void *pixels);
    bool (*read_palette)(const char *path, struct dicom_palette *palette, struct sp_error *err);
};

#define DICOM_BRIDGE_MODULE "splat-import-dicom.so"
#define DICOM_BRIDGE_SYMBOL "splat_dicom_bridge"
extern const struct dicom_bridge_functions splat_dicom_bridge;

#ifdef __cplusplus
}
#endif
#endif
