/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/vectors.h"

#include <math.h>

#include "data/import/derived.h"
#include "data/import/number.h"
#include "data/import/shift.h"

enum { BLOCK = 512 }; /* numbers that are converted at once */

/* `axis`: of the first number; the others follow in turn where the stride is 1. */
static void convert(const struct import_vectors *v, unsigned axis, const void *numbers, size_t n,
                    float *out, size_t stride) {
    const struct import_number number = v->number;
    double values[BLOCK];
    for (size_t at = 0, run; at < n; at += run) {
        run = n - at < BLOCK ? n - at : BLOCK;
        import_widen_all((const char *)numbers + at * number.size, number, number.size, run,
                         values);
        for (size_t i = 0; i < run && v->scale; i++)
            values[i] = v->scale->slope * values[i] + v->scale->offset;
        for (size_t i = 0; i < run; i++)
            out[(at + i) * stride] =
                v->shift ? import_shift_put(
                               v->shift, (int)(stride == 1 ? (axis + at + i) % 3 : axis), values[i])
                         : (float)values[i];
    }
}

void import_vectors_put(const struct import_vectors *v, uint64_t first, const void *numbers,
                        size_t n) {
    if (!v->planar) {
        convert(v, (unsigned)(first % 3), numbers, n, (float *)(void *)v->out + first, 1);
        return;
    }
    while (n > 0) {
        uint64_t component = first / v->count, at = first % v->count, run = v->count - at;
        run = run < n ? run : n;
        convert(v, (unsigned)component, numbers, (size_t)run, v->out[at] + component, 3);
        numbers = (const char *)numbers + run * v->number.size;
        first += run;
        n -= (size_t)run;
    }
}

static bool is_identity(const double frame[3][3]) {
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++)
            if (frame[row][column] != (row == column))
                return false;
    return true;
}

void import_vectors_finish(const struct import_header *header, float (*vectors)[3], void *voxels) {
    const struct sp_grid *grid = &header->grid;
    uint64_t count = (uint64_t)grid->dims[0] * grid->dims[1] * grid->dims[2];
    const double(*f)[3] = header->frame;
    bool unchanged = is_identity(f);
    for (uint64_t i = 0; i < count && !unchanged; i++) {
        float *v = vectors[i];
        const double x = (double)v[0], y = (double)v[1], z = (double)v[2];
        for (int row = 0; row < 3; row++)
            v[row] = (float)(f[row][0] * x + f[row][1] * y + f[row][2] * z);
    }
    import_derive(header->derived, (const float(*)[3])vectors, count, voxels);
}

void import_vectors_warn(const struct import_file *file, const float (*vectors)[3],
                         uint64_t count) {
    for (uint64_t i = 0; i < count; i++) {
        const float length = fabsf(vectors[i][0]) + fabsf(vectors[i][1]) + fabsf(vectors[i][2]);
        if (length > 0 && isfinite(length))
            return;
    }
    import_warn(file->warnings,
                "All vectors of the file are 0 or not finite, so there are no streaks.");
}
