/* SPDX-License-Identifier: Apache-2.0
 *
 * Images and rectilinear grids of VTK files. Values of points are samples where they are; values of
 * cells are samples at the centres of the cells.
 */
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/vtk.h"
#include "data/volume/volume.h"

/* Joins the extents of all pieces. Empty pieces are left out. */
static bool join_pieces(struct vtk_volume *v, struct sp_error *err) {
    size_t count = 0;
    for (size_t p = 0; p < v->piece_count; p++)
        if (v->pieces[p].dims[0] && v->pieces[p].dims[1] && v->pieces[p].dims[2])
            v->pieces[count++] = v->pieces[p];
    if (count == 0)
        return import_fail(err, SP_ERR_FORMAT, v->file->title, v->grid_at, v->grid_name,
                           v->piece_count ? "the grid is empty" : "the file ends without a Piece");
    v->piece_count = count;
    for (int axis = 0; axis < 3; axis++) {
        int64_t low = INT64_MAX, high = INT64_MIN;
        for (size_t p = 0; p < count; p++) {
            const int64_t first = v->pieces[p].first[axis];
            const int64_t last = first + v->pieces[p].dims[axis] - 1;
            low = first < low ? first : low;
            high = last > high ? last : high;
        }
        if (high - low >= SP_DIM_MAX)
            return import_fail(err, SP_ERR_UNSUPPORTED, v->file->title, v->grid_at, v->grid_name,
                               "the pieces lie between %" PRId64 " and %" PRId64
                               " on axis %d, which is more than %u samples",
                               low, high, axis, SP_DIM_MAX);
        v->first[axis] = (int32_t)low;
        v->points[axis] = (uint32_t)(high - low + 1);
    }
    return true;
}

bool vtk_grid_join(struct vtk_volume *v, struct sp_error *err) {
    if (!join_pieces(v, err))
        return false;
    memcpy(v->dims, v->points, sizeof v->dims);
    for (int axis = 0; axis < 3 && v->home == VTK_OF_CELLS; axis++)
        v->dims[axis] -= v->points[axis] > 1;
    v->has_gaps = vtk_has_gaps(v);
    return true;
}

static bool place_image(const struct vtk_volume *v, struct sp_grid *grid, struct sp_error *err) {
    const double *d = v->image.direction;
    for (int axis = 0; axis < 3; axis++) {
        const double length = hypot(hypot(d[axis], d[3 + axis]), d[6 + axis]);
        if (!(fabs(length - 1) < 1e-2))
            return import_fail(err, SP_ERR_FORMAT, v->file->title, v->grid_at, "Direction",
                               "the vector of axis %d has the length %g instead of 1", axis,
                               length);
        grid->spacing[axis] = v->image.spacing[axis];
        for (int row = 0; row < 3; row++) /* removes the rounding of the written digits */
            grid->direction[row][axis] = d[3 * row + axis] / length;
    }
    for (int row = 0; row < 3; row++) {
        grid->origin[row] = v->image.origin[row];
        for (int axis = 0; axis < 3; axis++) {
            const double shift = v->dims[axis] < v->points[axis] ? 0.5 : 0;
            grid->origin[row] +=
                grid->direction[row][axis] * grid->spacing[axis] * (v->first[axis] + shift);
        }
    }
    return true;
}

/* Reads the coordinates of every piece into v->positions. */
static bool read_coordinates(struct vtk_volume *v, struct sp_error *err) {
    for (int axis = 0; axis < 3; axis++)
        if (!(v->positions[axis] = calloc(v->points[axis], sizeof **v->positions)))
            return sp_fail(err, SP_ERR_MEMORY, v->file->title, "out of memory for coordinates");
    for (size_t i = 0; i < v->piece_count; i++) {
        const struct vtk_piece *p = &v->pieces[i];
        const struct import_file *file = vtk_open_file(v, p->file, err);
        for (unsigned axis = 0; axis < 3; axis++) {
            const struct vtk_entry *e = vtk_find_entry(v, p, VTK_COORDINATES, axis, NULL);
            if (!file)
                return false;
            if (!e)
                return import_fail(err, SP_ERR_FORMAT, file->title, v->grid_at, "Coordinates",
                                   "there are %u arrays instead of three", axis);
            struct vtk_array a = e->array;
            a.count = p->dims[axis];
            double *numbers =
                vtk_array_check(file, &a, err) ? vtk_array_read_numbers(file, &a, err) : NULL;
            if (!numbers)
                return false;
            memcpy(v->positions[axis] + (p->first[axis] - v->first[axis]), numbers,
                   p->dims[axis] * sizeof *numbers);
            free(numbers);
        }
    }
    return true;
}

/* A single sample has no gap. It becomes as thick as the smallest spacing of the other axes. */
static double thickness(const struct sp_grid *grid) {
    double least = INFINITY;
    for (int axis = 0; axis < 3; axis++)
        if (grid->coordinates[axis])
            least = fmin(least, grid->spacing[axis]);
    return isfinite(least) ? least : 1;
}

static bool place_rectilinear(struct vtk_volume *v, struct sp_grid *grid, struct sp_error *err) {
    double widths[3] = { 0 };
    if (!read_coordinates(v, err))
        return false;
    for (unsigned axis = 0; axis < 3; axis++) {
        double *at = v->positions[axis];
        if (v->dims[axis] < v->points[axis]) { /* centres of cells */
            widths[axis] = fabs(at[1] - at[0]);
            for (uint32_t i = 0; i < v->dims[axis]; i++)
                at[i] = (at[i] + at[i + 1]) / 2;
        }
        import_grid_set_positions(grid, axis, at);
    }
    for (int axis = 0; axis < 3; axis++)
        if (!grid->coordinates[axis])
            grid->spacing[axis] = widths[axis] > 0 ? widths[axis] : thickness(grid);
    return true;
}

/* How the numbers of the file become samples. */
static void choose_type(struct vtk_volume *v, struct import_header *header) {
    const struct vtk_entry *e = v->samples.entry;
    struct import_conversion *c = &v->conversion;
    *c = import_conversion_of(e->array.type->number, v->file->warnings);
    c->components = e->components;
    c->component = v->samples.component;
    if (e->role == VTK_COLORS && c->number.kind == IMPORT_FLOAT) { /* in [0, 1] */
        c->slope = 255;
        c->offset = 0.5; /* rounds */
        c->type = SP_UINT8;
    }
    header->type = c->type;
}

bool vtk_grid_open(struct vtk_volume *v, struct import_header *header, struct sp_error *err) {
    struct sp_grid *grid = &header->grid;
    char place[SP_ERROR_PLACE];
    import_place(place, v->file->title, v->grid_at, v->grid_name);
    if (!vtk_choose(v, header, err) || !vtk_grid_join(v, err))
        return false;
    if (!v->samples.entry && !v->vectors.entry)
        return import_fail(err, SP_ERR_UNSUPPORTED, v->file->title, v->grid_at, v->grid_name,
                           "neither points nor cells have an array of numbers");
    memcpy(grid->dims, v->dims, sizeof grid->dims);
    const struct vtk_stream samples = { .choice = v->samples };
    const struct vtk_stream vectors = { .choice = v->vectors };
    if (!(v->set == VTK_RECTILINEAR ? place_rectilinear(v, grid, err) : place_image(v, grid, err)))
        return false;
    if (v->samples.entry)
        choose_type(v, header);
    if (!sp_grid_check(grid, header->type, place, &header->bytes, err) ||
        !vtk_stream_check(v, &samples, err) || !vtk_stream_check(v, &vectors, err) ||
        !vtk_warn_of_hidden(v, err))
        return false;
    if (v->has_gaps)
        import_warn(v->file->warnings,
                    "The pieces of the file do not fill the grid; samples between them are %s.",
                    header->type == SP_FLOAT32 || header->type == SP_FLOAT64 ? "not numbers" : "0");
    return true;
}

/* Samples that no piece has are not numbers, or 0. */
static void fill(const struct vtk_volume *v, void *voxels, float (*vectors)[3]) {
    const uint64_t count = (uint64_t)v->dims[0] * v->dims[1] * v->dims[2];
    const bool has_samples = v->samples.entry && voxels;
    for (uint64_t i = 0; has_samples && i < count && v->conversion.type == SP_FLOAT32; i++)
        ((float *)voxels)[i] = NAN;
    for (uint64_t i = 0; has_samples && i < count && v->conversion.type == SP_FLOAT64; i++)
        ((double *)voxels)[i] = NAN;
    for (uint64_t i = 0; vectors && i < 3 * count; i++)
        vectors[i / 3][i % 3] = NAN;
}

bool vtk_read(void *volume, void *voxels, float (*vectors)[3],
              const struct import_progress *progress, struct sp_error *err) {
    struct vtk_volume *v = volume;
    struct import_progress rest = *progress;
    const uint64_t count = (uint64_t)v->dims[0] * v->dims[1] * v->dims[2];
    const struct vtk_stream samples = {
        .choice = v->samples, .conversion = &v->conversion, .out = voxels, .progress = progress
    };
    if (v->has_gaps)
        fill(v, voxels, vectors);
    if (v->samples.entry && !vtk_stream_read(v, &samples, err))
        return false;
    rest.before += v->samples.entry ? count * sp_type_size(v->conversion.type) : 0;
    const struct vtk_stream triples = { .choice = v->vectors,
                                        .out = (char *)vectors,
                                        .progress = &rest };
    return !vectors || vtk_stream_read(v, &triples, err);
}
