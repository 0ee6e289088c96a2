/* SPDX-License-Identifier: Apache-2.0
 *
 * Trained scenes of Gaussians in PLY files: as Kerbl et al. (2023) write them, and compressed as
 * SuperSplat writes them.
 *
 *   trained      vertex: position, logarithms of scales, quaternion, logit of the opacity,
 *                coefficients of spherical harmonics (f_dc_*, f_rest_*)
 *   compressed   chunk: ranges of 256 Gaussians; vertex: packed bits within these ranges;
 *                sh: f_rest_* as bytes (optional)
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/ply.h"
#include "data/volume/factor.h"

enum { REST_MAX = 45, CHUNK = 256, RANGES = 18 };

/* Finds f_rest_0, f_rest_1, … and the degree that their number gives. */
static bool find_harmonics(const struct ply *ply, const struct ply_element *e,
                           int columns[REST_MAX], uint32_t *degree, struct sp_error *err) {
    char name[PLY_NAME_BYTES];
    unsigned n = 0;
    for (; n < REST_MAX; n++) {
        snprintf(name, sizeof name, "f_rest_%u", n);
        columns[n] = ply_column(ply, e, name);
        if (columns[n] < 0)
            break;
    }
    for (*degree = 0; *degree < SP_HARMONICS_DEGREE_MAX; ++*degree)
        if (3 * (sp_harmonics_count(*degree) - 1) == n)
            break;
    return 3 * (sp_harmonics_count(*degree) - 1) == n ||
           import_fail(
               err, SP_ERR_FORMAT, ply->file->title, ply->begin, e->name,
               "the file has %u properties f_rest_*; spherical harmonics need 0, 9, 24 or 45", n);
}

static bool use_gaussians(const struct ply *ply, const struct ply_element *vertex, uint32_t degree,
                          struct import_header *header, struct sp_error *err) {
    if (!ply_check_count(ply, vertex, err))
        return false;
    import_header_use_elements(header,
                               &(struct sp_elements_shape){ .kind = SP_KIND_GAUSSIANS,
                                                            .count = (uint32_t)vertex->count,
                                                            .degree = degree });
    return true;
}

static void report(const struct import_progress *progress, const struct sp_elements_shape *shape,
                   uint64_t rows) {
    const uint64_t floats = 3 + 6 + 1 + 3 * sp_harmonics_count(shape->degree);
    if (rows % 4096 == 0)
        import_report(progress, rows * floats * sizeof(float));
}

/* As trained. */

enum { X, DC = 3, OPACITY = 6, SCALE, ROTATION = 10, NAMED = 14 };

static const char *const named[NAMED] = { "x",      "y",       "z",       "f_dc_0",  "f_dc_1",
                                          "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
                                          "rot_0",  "rot_1",   "rot_2",   "rot_3" };

static bool matches_trained(const struct ply *ply) {
    const struct ply_element *vertex = ply_find(ply, "vertex");
    return ply_column(ply, vertex, "f_dc_0") >= 0 && ply_column(ply, vertex, "opacity") >= 0 &&
           ply_column(ply, vertex, "scale_0") >= 0 && ply_column(ply, vertex, "rot_0") >= 0;
}

static bool open_trained(struct ply *ply, struct import_header *header, struct sp_error *err) {
    const struct ply_element *vertex = ply_find(ply, "vertex");
    int columns[NAMED], rest[REST_MAX];
    uint32_t degree;
    return ply_columns(ply, vertex, named, NAMED, columns, err) &&
           find_harmonics(ply, vertex, rest, &degree, err) &&
           use_gaussians(ply, vertex, degree, header, err);
}

static void copy_trained(const double *row, const int named_at[NAMED], const int *rest_at,
                         const struct sp_elements *e, size_t i) {
    const uint32_t count = sp_harmonics_count(e->shape.degree);
    float *harmonics = e->harmonics + 3 * count * i;
    double scales[3], rotation[4];
    for (int a = 0; a < 3; a++) {
        e->positions[i][a] = (float)row[named_at[X + a]];
        scales[a] = exp(row[named_at[SCALE + a]]);
        harmonics[a] = (float)row[named_at[DC + a]];
        for (uint32_t k = 1; k < count; k++) /* all of red come first, then all of green */
            harmonics[3 * k + (uint32_t)a] = (float)row[rest_at[(uint32_t)a * (count - 1) + k - 1]];
    }
    for (int a = 0; a < 4; a++)
        rotation[a] = row[named_at[ROTATION + a]];
    e->opacities[i] = (float)(1 / (1 + exp(-row[named_at[OPACITY]])));
    sp_gaussian_factor(scales, rotation, e->factors[i]);
}

static bool read_trained(const struct ply *ply, const struct sp_elements *elements,
                         const struct import_progress *progress, struct sp_error *err) {
    const struct ply_element *vertex = ply_find(ply, "vertex");
    int columns[NAMED], rest[REST_MAX];
    uint32_t degree;
    if (!ply_columns(ply, vertex, named, NAMED, columns, err) ||
        !find_harmonics(ply, vertex, rest, &degree, err))
        return false;
    struct ply_rows *rows = ply_rows_open(ply, vertex, -1, err);
    bool ok = rows != NULL;
    for (uint32_t i = 0; ok && i < elements->shape.count; i++) {
        const double *row = ply_rows_next(rows, err);
        ok = row != NULL;
        if (ok)
            copy_trained(row, columns, rest, elements, i);
        report(progress, &elements->shape, i);
    }
    ply_rows_close(rows);
    return ok;
}

const struct ply_content ply_gaussians = { matches_trained, open_trained, read_trained };

/* Compressed. */

static const char *const packed[] = { "packed_position", "packed_rotation", "packed_scale",
                                      "packed_color" };

/* The last six, colours, may be missing. */
static const char *const ranges[RANGES] = {
    "min_x",       "min_y",       "min_z",       "max_x",       "max_y",       "max_z",
    "min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z",
    "min_r",       "min_g",       "min_b",       "max_r",       "max_g",       "max_b"
};
enum { RANGES_LEAST = 12, MIN_SCALE = 6, MIN_COLOR = 12 };

static bool matches_packed(const struct ply *ply) {
    return ply_find(ply, "chunk") && ply_column(ply, ply_find(ply, "vertex"), packed[0]) >= 0;
}

/* Finds the bytes of the harmonics of each Gaussian. */
static bool find_sh(const struct ply *ply, const struct ply_element *sh, int columns[REST_MAX],
                    uint32_t *degree, struct sp_error *err) {
    *degree = 0;
    if (!sh)
        return true;
    if (!find_harmonics(ply, sh, columns, degree, err))
        return false;
    for (uint32_t i = 0; i < 3 * (sp_harmonics_count(*degree) - 1); i++) {
        const struct ply_property *p = &ply->properties[sh->first + (unsigned)columns[i]];
        if (p->number.kind != IMPORT_UNSIGNED || p->number.size != 1)
            return import_fail(err, SP_ERR_UNSUPPORTED, ply->file->title, ply->begin, p->name,
                               "compressed spherical harmonics must be of type uchar");
    }
    return true;
}

static bool open_packed(struct ply *ply, struct import_header *header, struct sp_error *err) {
    const struct ply_element *vertex = ply_find(ply, "vertex"), *chunk = ply_find(ply, "chunk");
    const struct ply_element *sh = ply_find(ply, "sh");
    int columns[REST_MAX];
    uint32_t degree;
    if (!ply_columns(ply, vertex, packed, 4, columns, err) ||
        !ply_columns(ply, chunk, ranges, RANGES_LEAST, columns, err) ||
        !find_sh(ply, sh, columns, &degree, err) ||
        !use_gaussians(ply, vertex, degree, header, err))
        return false;
    uint64_t need = (vertex->count + CHUNK - 1) / CHUNK;
    if (chunk->count < need)
        return import_fail(err, SP_ERR_FORMAT, ply->file->title, ply->begin, "chunk",
                           "%" PRIu64 " rows; %" PRIu64 " Gaussians need %" PRIu64, chunk->count,
                           vertex->count, need);
    return !sh || sh->count == vertex->count ||
           import_fail(err, SP_ERR_FORMAT, ply->file->title, ply->begin, "sh",
                       "%" PRIu64 " rows for %" PRIu64 " Gaussians", sh->count, vertex->count);
}

typedef float chunk_ranges[RANGES];

/* The caller frees the result; NULL with *err set on failure. */
static chunk_ranges *read_ranges(const struct ply *ply, size_t count, struct sp_error *err) {
    const struct ply_element *chunk = ply_find(ply, "chunk");
    int columns[RANGES];
    unsigned found = RANGES_LEAST;
    if (ply_column(ply, chunk, ranges[MIN_COLOR]) >= 0)
        found = RANGES;
    if (!ply_columns(ply, chunk, ranges, found, columns, err))
        return NULL;
    chunk_ranges *out = malloc((count + 1) * sizeof *out);
    if (!out) {
        sp_fail(err, SP_ERR_MEMORY, ply->file->title, "out of memory for %zu chunks", count);
        return NULL;
    }
    struct ply_rows *rows = ply_rows_open(ply, chunk, -1, err);
    bool ok = rows != NULL;
    for (size_t i = 0; ok && i < count; i++) {
        const double *row = ply_rows_next(rows, err);
        ok = row != NULL;
        for (unsigned k = 0; ok && k < RANGES; k++)
            out[i][k] = k < found ? (float)row[columns[k]] : (float)(k >= MIN_COLOR + 3);
    }
    ply_rows_close(rows);
    if (ok)
        return out;
    free(out);
    return NULL;
}

/* The number in `count` bits above `shift`, as a fraction. */
static double fraction(uint32_t bits, unsigned shift, unsigned count) {
    const uint32_t mask = (UINT32_C(1) << count) - 1;
    return (double)(bits >> shift & mask) / mask;
}

/* Three fractions of 11, 10 and 11 bits within ranges whose three largest follow the smallest. */
static void unpack_three(uint32_t bits, const float *range, double out[3]) {
    static const unsigned shifts[] = { 21, 11, 0 }, counts[] = { 11, 10, 11 };
    for (int a = 0; a < 3; a++) {
        double t = fraction(bits, shifts[a], counts[a]);
        out[a] = (double)range[a] * (1 - t) + (double)range[a + 3] * t;
    }
}

/* Two bits name the largest number of the quaternion, which is positive; ten bits each hold the
 * others within [-√½, √½]. */
static void unpack_rotation(uint32_t bits, double rotation[4]) {
    const uint32_t largest = bits >> 30;
    double squares = 0;
    for (uint32_t i = 0, shift = 20; i < 4; i++) {
        if (i == largest)
            continue;
        rotation[i] = (fraction(bits, shift, 10) - 0.5) * M_SQRT2;
        squares += rotation[i] * rotation[i];
        shift -= 10;
    }
    rotation[largest] = sqrt(fmax(0, 1 - squares));
}

static void unpack_gaussian(const uint32_t bits[4], const float *range, const struct sp_elements *e,
                            size_t i) {
    static const double constant = 0.28209479177387814; /* the harmonic of degree 0 */
    float *harmonics = e->harmonics + 3 * sp_harmonics_count(e->shape.degree) * i;
    double position[3], scales[3], rotation[4];
    unpack_three(bits[0], range, position);
    unpack_rotation(bits[1], rotation);
    unpack_three(bits[2], range + MIN_SCALE, scales);
    for (int a = 0; a < 3; a++) {
        double t = fraction(bits[3], 24 - 8 * (unsigned)a, 8);
        double color =
            (double)range[MIN_COLOR + a] * (1 - t) + (double)range[MIN_COLOR + 3 + a] * t;
        e->positions[i][a] = (float)position[a];
        scales[a] = exp(scales[a]);
        harmonics[a] = (float)((color - 0.5) / constant);
    }
    e->opacities[i] = (float)fraction(bits[3], 0, 8);
    sp_gaussian_factor(scales, rotation, e->factors[i]);
}

/* The higher harmonics, if there are any. */
static bool read_sh(const struct ply *ply, const struct sp_elements *e,
                    const struct import_progress *progress, struct sp_error *err) {
    const struct ply_element *sh = ply_find(ply, "sh");
    const uint32_t count = sp_harmonics_count(e->shape.degree);
    int columns[REST_MAX];
    uint32_t degree;
    if (e->shape.degree == 0)
        return true;
    if (!find_sh(ply, sh, columns, &degree, err))
        return false;
    struct ply_rows *rows = ply_rows_open(ply, sh, -1, err);
    bool ok = rows != NULL;
    for (size_t i = 0; ok && i < e->shape.count; i++) {
        const double *row = ply_rows_next(rows, err);
        ok = row != NULL;
        for (uint32_t k = 3; ok && k < 3 * count; k++)
            e->harmonics[3 * count * i + k] =
                (float)(row[columns[k % 3 * (count - 1) + k / 3 - 1]] * 8 / 255 - 4);
        report(progress, &e->shape, i);
    }
    ply_rows_close(rows);
    return ok;
}

static bool read_packed(const struct ply *ply, const struct sp_elements *elements,
                        const struct import_progress *progress, struct sp_error *err) {
    const struct ply_element *vertex = ply_find(ply, "vertex");
    int columns[4];
    if (!ply_columns(ply, vertex, packed, 4, columns, err))
        return false;
    chunk_ranges *chunks =
        read_ranges(ply, ((size_t)elements->shape.count + CHUNK - 1) / CHUNK, err);
    struct ply_rows *rows = chunks ? ply_rows_open(ply, vertex, -1, err) : NULL;
    bool ok = rows != NULL;
    for (uint32_t i = 0; ok && i < elements->shape.count; i++) {
        const double *row = ply_rows_next(rows, err);
        uint32_t bits[4];
        ok = row != NULL;
        for (int k = 0; ok && k < 4; k++) {
            double value = row[columns[k]];
            ok = (value >= 0 && value <= UINT32_MAX) ||
                 import_fail(err, SP_ERR_FORMAT, ply->file->title, ply->begin, packed[k],
                             "%g in row %" PRIu32 " is not a number of 32 bits", value, i);
            bits[k] = ok ? (uint32_t)value : 0;
        }
        if (ok)
            unpack_gaussian(bits, chunks[i / CHUNK], elements, i);
        report(progress, &elements->shape, i);
    }
    ply_rows_close(rows);
    free(chunks);
    return ok && read_sh(ply, elements, progress, err);
}

const struct ply_content ply_packed_gaussians = { matches_packed, open_packed, read_packed };
