/* SPDX-License-Identifier: Apache-2.0
 *
 * The header of a NRRD file as typed fields (Teem's NRRD0001 to NRRD0005).
 *
 * This is our own parser because Teem opens whatever file a header names, and names the field at
 * fault only in the text of its errors.
 */
#ifndef SP_IMPORT_NRRD_HEADER_H
#define SP_IMPORT_NRRD_HEADER_H

#include "data/import/format.h"
#include "data/import/pattern.h"
#include "data/import/stream.h"

enum { NRRD_TEXT_MAX = 1 << 20, NRRD_VALUE_MAX = IMPORT_PATTERN_MAX }; /* bytes */
enum { NRRD_AXES_MAX = 6, NRRD_SEGMENTS_MAX = 1024, NRRD_LAYERS_MAX = 64 };

/* The table in nrrd_header.c has the same order. */
enum nrrd_field {
    NRRD_TYPE,
    NRRD_DIMENSION,
    NRRD_SIZES,
    NRRD_SPACINGS,
    NRRD_AXIS_MINS,
    NRRD_AXIS_MAXS,
    NRRD_CENTERS,
    NRRD_KINDS,
    NRRD_SPACE,
    NRRD_SPACE_DIMENSION,
    NRRD_SPACE_DIRECTIONS,
    NRRD_SPACE_UNITS,
    NRRD_SPACE_ORIGIN,
    NRRD_UNITS,
    NRRD_ENDIAN,
    NRRD_ENCODING,
    NRRD_LINE_SKIP,
    NRRD_BYTE_SKIP,
    NRRD_DATA_FILE,
    NRRD_MEASUREMENT_FRAME,
    NRRD_CONTENT,
    NRRD_IGNORED, /* the fields from here on are known and do not matter */
    NRRD_NUMBER = NRRD_IGNORED,
    NRRD_BLOCK_SIZE,
    NRRD_THICKNESSES,
    NRRD_LABELS,
    NRRD_MIN,
    NRRD_MAX,
    NRRD_OLD_MIN,
    NRRD_OLD_MAX,
    NRRD_SAMPLE_UNITS,
    NRRD_FIELD_COUNT
};

enum nrrd_role { /* of an axis */
                 NRRD_DOMAIN,
                 NRRD_TIME,
                 NRRD_VECTOR, /* x, y and z of vectors */
                 NRRD_COLOR,
                 NRRD_COMPONENT, /* other numbers of a sample */
                 NRRD_PART,      /* of a complex number */
                 NRRD_SINGLE,    /* one sample, without a meaning */
};

/* Of a segmentation by 3D Slicer. Segments of one layer share its numbers; segments of several
 * layers may overlap. */
struct nrrd_segments {
    bool are_there;
    const char *names[NRRD_SEGMENTS_MAX]; /* in the text of the header; NULL = none */
    unsigned layers[NRRD_SEGMENTS_MAX];   /* from 0 */
    unsigned layer_count;
    char layer_names[NRRD_LAYERS_MAX][SP_FIELD_BYTES];
    const char *layer_list[NRRD_LAYERS_MAX]; /* the same; NULL beyond the last layer */
};

struct nrrd_header {
    char *text; /* owned; `value` and `list` point into it */
    size_t size;
    char *value[NRRD_FIELD_COUNT];   /* trimmed, ends with 0; NULL = the field is missing */
    uint64_t byte[NRRD_FIELD_COUNT]; /* offset of the field's line in the file */
    uint64_t end;                    /* offset of the first byte after the header's blank line */
    char *list; /* the lines after "data file: LIST", up to the end of the text, else NULL */

    struct import_number number;
    enum import_encoding encoding;
    bool big_endian;
    /* The axes of the file. Those of the volume follow one another, from `first` on. Each of the
     * other roles has one axis at most; −1 = none. */
    unsigned dimension; /* [2, NRRD_AXES_MAX] */
    enum nrrd_role role[NRRD_AXES_MAX];
    unsigned first, axes; /* axes: 2 or 3 */
    int time, vectors, components;
    bool used_as;             /* the source chose what an axis is */
    bool is_diffusion;        /* volumes of one patient, each with a gradient of its own */
    const char *const *names; /* of the components; NULL = they have none */
    struct nrrd_segments segments;
    const char *times, *times_unit; /* of the steps, in the text; NULL = not given */
    uint64_t sizes[NRRD_AXES_MAX];  /* [1, SP_DIM_MAX] each */
    /* Per axis of the file, NAN = not given. */
    double spacing[NRRD_AXES_MAX], min[NRRD_AXES_MAX], max[NRRD_AXES_MAX];
    bool is_cell[NRRD_AXES_MAX]; /* samples are centred in cells, not at nodes */
    /* Dimension of the space: `axes` to 3; 4 = one more for the axis `apart`; 0 = there is none. */
    unsigned space;
    int apart; /* the axis of the time or else of the components; -1 = none */
    double direction[NRRD_AXES_MAX][4]; /* direction[axis], if `value` has space directions */
    double origin[4];                   /* if `value` has a space origin */
    double frame[3][3]; /* columns, if `value` has a measurement frame and there are vectors */
    char unit[SP_UNIT_BYTES], time_unit[SP_UNIT_BYTES];
    char anatomy[4]; /* of the axes of the space; "" = the space is not anatomical */
};

/* Reads and checks the header of file->fd. On failure nothing remains to be finished. */
bool nrrd_header_read(const struct import_file *file, struct nrrd_header *header,
                      struct sp_error *err);
void nrrd_header_finish(struct nrrd_header *header);

const char *nrrd_field_name(enum nrrd_field field);

/* Fails with the place of the field: file, byte and name. */
#define NRRD_FAIL(err, code, file, header, field, ...)                                             \
    import_fail(err, code, (file)->title, (header)->byte[field], nrrd_field_name(field),           \
                __VA_ARGS__)

/* Shared by nrrd.c, nrrd_header.c, nrrd_keys.c, nrrd_kinds.c and nrrd_space.c. */

/* Reads the roles of the axes. The type is known. */
bool nrrd_kinds_read(const struct import_file *file, struct nrrd_header *header,
                     struct sp_error *err);

/* Parses a line "KEY:=VALUE" of another program. */
void nrrd_keys_parse(struct nrrd_header *header, char *line);

/* Names the layers of a segmentation after their segments, or else "layer 1" and so on. */
void nrrd_keys_name_layers(struct nrrd_segments *segments, unsigned count);

/* Reads header->times, which is not NULL. False if it is no list of `count` rising numbers. */
bool nrrd_keys_read_times(const struct nrrd_header *header, double *times, uint64_t count);

/* The next word of a list; false at the end. A word of more than 63 bytes is cut. */
bool nrrd_next_word(const char **text, char word[64]);

/* Reads the fields about the space, units included, once the axes are known. */
bool nrrd_space_read(const struct import_file *file, struct nrrd_header *header,
                     struct sp_error *err);

/* The functions below read at *text and move it to the next word. */

static inline const char *nrrd_skip_blanks(const char *text) {
    while (*text == ' ' || *text == '\t')
        text++;
    return text;
}

/* A whole number in [0, limit]. */
bool nrrd_parse_whole(const char **text, uint64_t limit, uint64_t *out);

/* One finite or infinite number or NaN, up to a blank or one of `stops`. */
bool nrrd_parse_number(const char **text, const char *stops, double *out);

#endif
