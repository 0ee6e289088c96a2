/* SPDX-License-Identifier: Apache-2.0
 *
 * NIfTI-1, or NIfTI-2 where an axis has more than 32767 samples: one file, packed by gzip if its
 * name ends with ".gz". The world of NIfTI has the axes right, anterior, superior.
 */
#include <math.h>
#include <string.h>

#include "data/export/job.h"
#include "data/volume/unit.h"
#include "sp/log.h"

enum {
    HEADER_ONE = 348,
    HEADER_TWO = 540,
    EXTENSION = 4,
    DIM_ONE_MAX = 32767,
    NAME_BYTES = 16,
    INTENT_LABEL = 1002
};
/* The world: the scanner's, or an aligned one, which the file does not name. */
enum { FORM_NONE = 0, FORM_SCANNER = 1, FORM_ALIGNED = 2 };
enum kind { INT8, INT16, INT32, INT64, FLOAT32, FLOAT64 };

/* Where a version of the header has its numbers, and of which type they are. */
struct layout {
    int size;
    enum kind count, code, real, units, offset;
    size_t dims, datatype, bits, pixdim, offset_at, slope, units_at, forms, quaternion, shift, rows,
        name, intent;
};

static const struct layout layouts[] = {
    { .size = HEADER_ONE,
      .count = INT16,
      .code = INT16,
      .real = FLOAT32,
      .units = INT8,
      .offset = FLOAT32,
      .dims = 40,
      .datatype = 70,
      .bits = 72,
      .pixdim = 76,
      .offset_at = 108,
      .slope = 112,
      .units_at = 123,
      .forms = 252,
      .quaternion = 256,
      .shift = 268,
      .rows = 280,
      .name = 328,
      .intent = 68 },
    { .size = HEADER_TWO,
      .count = INT64,
      .code = INT32,
      .real = FLOAT64,
      .units = INT32,
      .offset = INT64,
      .dims = 16,
      .datatype = 12,
      .bits = 14,
      .pixdim = 104,
      .offset_at = 168,
      .slope = 176,
      .units_at = 500,
      .forms = 344,
      .quaternion = 352,
      .shift = 376,
      .rows = 400,
      .name = 508,
      .intent = 504 },
};

struct header {
    const struct layout *layout;
    unsigned char bytes[HEADER_TWO + EXTENSION];
};

#define PUT(type)                                                                                  \
    {                                                                                              \
        const type number = (type)numbers[i];                                                      \
        memcpy(h->bytes + at + (size_t)i * sizeof number, &number, sizeof number);                 \
        break;                                                                                     \
    }

static void put(struct header *h, size_t at, enum kind kind, const double *numbers, int count) {
    for (int i = 0; i < count; i++)
        switch (kind) {
        case INT8:
            PUT(int8_t)
        case INT16:
            PUT(int16_t)
        case INT32:
            PUT(int32_t)
        case INT64:
            PUT(int64_t)
        case FLOAT32:
            PUT(float)
        case FLOAT64:
            PUT(double)
        }
}

static void put_one(struct header *h, size_t at, enum kind kind, double number) {
    put(h, at, kind, &number, 1);
}

/* Chooses the unit of the file. *factor: the unit of the volume, measured in it. */
static bool choose_unit(const struct sp_export_job *job, int *code, double *factor,
                        struct sp_error *err) {
    static const struct {
        int code;
        double meters;
    } known[] = { { 3, 1e-6 }, { 2, 1e-3 }, { 1, 1 } };
    const struct sp_unit *own = sp_unit_find(job->info->unit);
    *code = 0;
    *factor = 1;
    if (!job->info->unit[0])
        return true;
    if (!own)
        return sp_fail(err, SP_ERR_UNSUPPORTED, job->title,
                       "NIfTI measures in m, mm or um, and this volume in \"%s\"; write .nrrd or "
                       ".ome.zarr",
                       job->info->unit);
    /* The next larger one: cm becomes m, nm becomes um. */
    size_t i = 0;
    while (i < 2 && known[i].meters < own->meters * 0.999)
        i++;
    *code = known[i].code;
    *factor = own->meters / known[i].meters;
    if (fabs(*factor - 1) < 1e-9)
        *factor = 1;
    return true;
}

static bool is_orthogonal(const double d[3][3]) {
    for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3;
        if (fabs(d[0][a] * d[0][b] + d[1][a] * d[1][b] + d[2][a] * d[2][b]) > 1e-5)
            return false;
    }
    return true;
}

/* The rotation as b, c and d of a unit quaternion, and −1 in *third if the third axis is turned
 * around before (nifti1.h, method 2). */
static void compute_quaternion(const double direction[3][3], double q[3], double *third) {
    double r[3][3], full[4];
    memcpy(r, direction, sizeof r);
    const double volume = r[0][0] * (r[1][1] * r[2][2] - r[1][2] * r[2][1]) -
                          r[0][1] * (r[1][0] * r[2][2] - r[1][2] * r[2][0]) +
                          r[0][2] * (r[1][0] * r[2][1] - r[1][1] * r[2][0]);
    *third = volume < 0 ? -1 : 1;
    for (int row = 0; row < 3; row++)
        r[row][2] *= *third;
    /* Four times each square; the largest is the divisor. */
    const double squares[4] = { 1 + r[0][0] + r[1][1] + r[2][2], 1 + r[0][0] - r[1][1] - r[2][2],
                                1 - r[0][0] + r[1][1] - r[2][2], 1 - r[0][0] - r[1][1] + r[2][2] };
    const double products[4][4] = {
        /* four times each product */
        { squares[0], r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1] },
        { r[2][1] - r[1][2], squares[1], r[0][1] + r[1][0], r[0][2] + r[2][0] },
        { r[0][2] - r[2][0], r[0][1] + r[1][0], squares[2], r[1][2] + r[2][1] },
        { r[1][0] - r[0][1], r[0][2] + r[2][0], r[1][2] + r[2][1], squares[3] }
    };
    int largest = 0;
    for (int i = 1; i < 4; i++)
        largest = squares[i] > squares[largest] ? i : largest;
    const double divisor = 2 * sqrt(squares[largest]);
    for (int i = 0; i < 4; i++)
        full[i] = products[largest][i] / divisor;
    for (int i = 0; i < 3; i++)
        q[i] = full[0] < 0 ? -full[i + 1] : full[i + 1];
}

static bool has_place(const struct sp_grid *grid) {
    for (int row = 0; row < 3; row++)
        for (int axis = 0; axis < 3; axis++)
            if (grid->origin[row] != 0 || grid->direction[row][axis] != (row == axis))
                return true;
    return false;
}

static int choose_form(const struct sp_export_job *job) {
    if (job->info->anatomy[0])
        return FORM_SCANNER;
    if (!has_place(&job->info->grid))
        return FORM_NONE;
    sp_log(SP_LOG_WARN,
           "%s: the source does not say where its axes point to in a patient; those of NIfTI are "
           "right, anterior and superior",
           job->title);
    return FORM_ALIGNED;
}

static bool put_place(const struct sp_export_job *job, struct header *h, struct sp_error *err) {
    const struct layout *l = h->layout;
    const int form = choose_form(job);
    double direction[3][3], origin[3], rows[3][4], quaternion[3], factor;
    double pixdim[8] = { 1, 1, 1, 1, 1, 1, 1, 1 };
    int unit;
    if (!choose_unit(job, &unit, &factor, err))
        return false;
    sp_export_place(job->info, "RAS", direction, origin);
    for (int row = 0; row < 3; row++) {
        origin[row] *= factor;
        rows[row][3] = origin[row];
        pixdim[row + 1] = job->info->grid.spacing[row] * factor;
    }
    for (int row = 0; row < 3; row++)
        for (int axis = 0; axis < 3; axis++)
            rows[row][axis] = direction[row][axis] * pixdim[axis + 1];
    if (form != FORM_NONE && is_orthogonal(direction)) {
        compute_quaternion(direction, quaternion, &pixdim[0]);
        put_one(h, l->forms, l->code, form);
        put(h, l->quaternion, l->real, quaternion, 3);
        put(h, l->shift, l->real, origin, 3);
    }
    if (form != FORM_NONE) {
        put_one(h, l->forms + (l->code == INT16 ? 2 : 4), l->code, form);
        put(h, l->rows, l->real, rows[0], 12);
    }
    put(h, l->pixdim, l->real, pixdim, 8);
    put_one(h, l->units_at, l->units, unit);
    return true;
}

/* As much of the name as there are bytes for, without half of a character. */
static void put_name(struct header *h, const char *name) {
    size_t n = strlen(name);
    if (n >= NAME_BYTES)
        for (n = NAME_BYTES - 1; n > 0 && ((unsigned char)name[n] & 0xc0) == 0x80;)
            n--;
    memcpy(h->bytes + h->layout->name, name, n);
}

static void put_shape(const struct sp_volume_info *info, struct header *h) {
    static const int types[SP_TYPE_COUNT] = { 2, 256, 512, 4, 8, 16, 64 };
    const struct layout *l = h->layout;
    const uint32_t *d = info->grid.dims;
    const double dims[8] = { 3, d[0], d[1], d[2], 1, 1, 1, 1 };
    const bool is_one = l->size == HEADER_ONE;
    put_one(h, 0, INT32, l->size);
    put(h, l->dims, l->count, dims, 8);
    put_one(h, l->datatype, INT16, types[info->type]);
    put_one(h, l->bits, INT16, (double)sp_type_size(info->type) * 8);
    put_one(h, l->offset_at, l->offset, l->size + EXTENSION);
    put_one(h, l->slope, l->real, 1);
    if (is_one)
        h->bytes[38] = 'r'; /* for ANALYZE 7.5 */
    memcpy(h->bytes + (is_one ? 344 : 4), is_one ? "n+1\0" : "n+2\0\r\n\032\n", is_one ? 4 : 8);
    if (info->meaning == SP_MEANING_LABELS)
        put_one(h, l->intent, l->code, INTENT_LABEL);
    put_name(h, info->value_name);
}

bool sp_export_nifti(const struct sp_export_job *job, struct sp_error *err) {
    const struct sp_volume_info *info = job->info;
    const size_t length = strlen(job->title);
    const bool is_packed = length > 3 && strcmp(job->title + length - 3, ".gz") == 0;
    struct header h = { .layout = layouts };
    for (int axis = 0; axis < 3; axis++)
        if (info->grid.dims[axis] > DIM_ONE_MAX)
            h.layout = &layouts[1];
    put_shape(info, &h);
    return put_place(job, &h, err) &&
           sp_export_stream(job, h.bytes, (size_t)h.layout->size + EXTENSION, is_packed, err);
}
