/* SPDX-License-Identifier: Apache-2.0
 *
 * The text of a NRRD header, taken apart before teem sees any of it: teem opens whatever file a
 * header names, so it gets a copy with the fields that describe the samples and nothing else.
 */
#ifndef SP_IMPORT_NRRD_HEADER_H
#define SP_IMPORT_NRRD_HEADER_H

#include "import/format.h"

enum { NRRD_TEXT_MAX = 1 << 20, NRRD_VALUE_MAX = 4096 }; /* bytes */

/* The order is that of the table in nrrd_header.c. */
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
    NRRD_BLOCK_SIZE,
    NRRD_TO_TEEM, /* those above are passed on */
    NRRD_LINE_SKIP = NRRD_TO_TEEM,
    NRRD_BYTE_SKIP,
    NRRD_DATA_FILE,
    NRRD_OURS, /* those above are kept; those below are known and of no interest */
    NRRD_NUMBER = NRRD_OURS,
    NRRD_THICKNESSES,
    NRRD_LABELS,
    NRRD_MIN,
    NRRD_MAX,
    NRRD_OLD_MIN,
    NRRD_OLD_MAX,
    NRRD_SAMPLE_UNITS,
    NRRD_MEASUREMENT_FRAME,
    NRRD_CONTENT,
    NRRD_FIELD_COUNT
};

struct nrrd_header {
    char *text; /* owned; `value` points into it */
    size_t size;
    char *value[NRRD_FIELD_COUNT];   /* trimmed, ends with 0; NULL = not said */
    uint64_t byte[NRRD_FIELD_COUNT]; /* where its line starts */
    char *clean;                     /* owned: magic and the fields for teem, ends with 0 */
    size_t clean_size;
    uint64_t end; /* first byte after the header's blank line */
    char *list;   /* "data file: LIST": the lines after it, up to the end of the text, else NULL */
    unsigned dimension; /* 2 or 3 */
    uint64_t sizes[3];  /* [1, SP_DIM_MAX] each */
};

const char *nrrd_field_name(enum nrrd_field field);

/* Reads and checks the header of file->fd. On failure nothing is left to finish. */
bool nrrd_header_read(const struct import_file *file, struct nrrd_header *header,
                      struct sp_error *err);
void nrrd_header_finish(struct nrrd_header *header);

/* Fails with the field's place. */
__attribute__((format(printf, 6, 7))) bool
nrrd_fail(struct sp_error *err, enum sp_code code, const struct import_file *file,
          const struct nrrd_header *header, enum nrrd_field field, const char *format, ...);

#endif
