/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/nifti_header.h"

#include <string.h>

#include "data/import/stream.h"

enum { HEADER_ONE = 348, HEADER_TWO = 540 }; /* bytes */

static const struct nifti_layout layouts[] = {
    { .size = HEADER_ONE,
      .count = { IMPORT_SIGNED, 2 },
      .code = { IMPORT_SIGNED, 2 },
      .real = { IMPORT_FLOAT, 4 },
      .units = { IMPORT_SIGNED, 1 },
      .offset = { IMPORT_FLOAT, 4 },
      .dims = 40,
      .datatype = 70,
      .pixdim = 76,
      .offset_at = 108,
      .slope = 112,
      .start_at = 136,
      .units_at = 123,
      .forms = 252,
      .quaternion = 256,
      .shift = 268,
      .rows = 280,
      .intent = 68,
      .intent_name = 328,
      .magic = 344 },
    { .size = HEADER_TWO,
      .count = { IMPORT_SIGNED, 8 },
      .code = { IMPORT_SIGNED, 4 },
      .real = { IMPORT_FLOAT, 8 },
      .units = { IMPORT_SIGNED, 4 },
      .offset = { IMPORT_SIGNED, 8 },
      .dims = 16,
      .datatype = 12,
      .pixdim = 104,
      .offset_at = 168,
      .slope = 176,
      .start_at = 216,
      .units_at = 500,
      .forms = 344,
      .quaternion = 352,
      .shift = 376,
      .rows = 400,
      .intent = 504,
      .intent_name = 508,
      .magic = 4 },
};

/* The first number of the file is the size of its header, in either byte order. */
static const struct nifti_layout *find_layout(const uint8_t *start, bool *is_swapped) {
    int32_t size;
    memcpy(&size, start, sizeof size);
    for (size_t i = 0; i < sizeof layouts / sizeof *layouts; i++)
        for (int swapped = 0; swapped < 2; swapped++) {
            *is_swapped = swapped;
            if ((swapped ? (int32_t)__builtin_bswap32((uint32_t)size) : size) == layouts[i].size)
                return &layouts[i];
        }
    return NULL;
}

bool nifti_is_header(const uint8_t start[4]) {
    bool is_swapped;
    return find_layout(start, &is_swapped) != NULL;
}

static double number_at(const struct nifti_fields *f, const uint8_t *header, size_t at,
                        struct import_number number) {
    uint64_t value = 0;
    memcpy(&value, header + at, number.size);
    if (f->is_swapped)
        import_swap(&value, number.size, 1);
    return import_widen(&value, number);
}

static void numbers_at(const struct nifti_fields *f, const uint8_t *header, size_t at,
                       struct import_number number, double *out, int count) {
    for (int i = 0; i < count; i++)
        out[i] = number_at(f, header, at + (size_t)i * number.size, number);
}

static void read_fields(const uint8_t *header, struct nifti_fields *f) {
    const struct nifti_layout *l = f->layout;
    double forms[2];
    numbers_at(f, header, l->dims, l->count, f->dims, 8);
    numbers_at(f, header, l->pixdim, l->real, f->pixdim, 8);
    numbers_at(f, header, l->forms, l->code, forms, 2);
    numbers_at(f, header, l->quaternion, l->real, f->quaternion, 3);
    numbers_at(f, header, l->shift, l->real, f->shift, 3);
    numbers_at(f, header, l->rows, l->real, f->rows[0], 12);
    f->qform = (int)forms[0];
    f->sform = (int)forms[1];
    f->datatype =
        (int)number_at(f, header, l->datatype, (struct import_number){ IMPORT_SIGNED, 2 });
    f->intent = (int)number_at(f, header, l->intent, l->code);
    const int units = (int)number_at(f, header, l->units_at, l->units);
    f->units = units & 7;
    f->time_units = units >> 3 & 7;
    f->start = number_at(f, header, l->start_at, l->real);
    f->offset = number_at(f, header, l->offset_at, l->offset);
    f->slope = number_at(f, header, l->slope, l->real);
    f->inter = number_at(f, header, l->slope + l->real.size, l->real);
    memcpy(f->intent_name, header + l->intent_name, 16);
    f->is_single = header[l->magic] == 'n' && header[l->magic + 1] == '+';
    f->is_analyze = l->size == HEADER_ONE && header[l->magic] != 'n';
    if (!f->is_analyze)
        return;
    /* These bytes have another meaning there, or none. SPM has its scale where NIfTI has it. */
    f->units = f->time_units = f->intent = f->qform = f->sform = 0;
    f->inter = f->start = 0;
    f->intent_name[0] = 0;
}

bool nifti_header_read(const struct import_file *file, struct nifti_fields *f,
                       struct sp_error *err) {
    uint8_t header[HEADER_TWO] = { 0 };
    const size_t got = import_stream_head(file, header, sizeof header, &f->is_packed);
    f->layout = got >= HEADER_ONE ? find_layout(header, &f->is_swapped) : NULL;
    if (!f->layout || got < (size_t)f->layout->size)
        return import_fail(err, SP_ERR_FORMAT, file->title, 0, "sizeof_hdr",
                           "this is no NIfTI file: it does not begin with a header of 348 or 540 "
                           "bytes");
    read_fields(header, f);
    return true;
}
