/* SPDX-License-Identifier: Apache-2.0 */
#include "import/vtk.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "import/derived.h"
#include "volume/volume.h"

/* A single sample has no gap. It becomes as thick as the smallest spacing of the other axes. */
static double thickness(const struct sp_grid *grid) {
    double least = INFINITY;
    for (int axis = 0; axis < 3; axis++)
        if (grid->coordinates[axis])
            least = fmin(least, grid->spacing[axis]);
    return isfinite(least) ? least : 1;
}

static void place_samples(struct vtk_volume *v, struct sp_grid *grid) {
    for (unsigned axis = 0; axis < 3; axis++)
        if (v->positions[axis])
            import_grid_place(grid, axis, v->positions[axis]);
    for (int axis = 0; axis < 3; axis++)
        if (v->positions[axis] && !grid->coordinates[axis])
            grid->spacing[axis] = thickness(grid);
}

bool vtk_place_image(const struct import_file *file, const struct vtk_image *image,
                     struct import_header *header, uint64_t byte, struct sp_error *err) {
    struct sp_grid *grid = &header->grid;
    const double *d = image->direction;
    for (int axis = 0; axis < 3; axis++) {
        const double length = hypot(hypot(d[axis], d[3 + axis]), d[6 + axis]);
        if (!(fabs(length - 1) < 1e-2))
            return import_fail(err, SP_ERR_FORMAT, file->shown, byte, "Direction",
                               "axis %d has length %g instead of 1", axis, length);
        grid->spacing[axis] = image->spacing[axis];
        for (int row = 0; row < 3; row++) /* removes the rounding of the written digits */
            grid->direction[row][axis] = d[3 * row + axis] / length;
    }
    for (int row = 0; row < 3; row++) {
        grid->origin[row] = image->origin[row];
        for (int axis = 0; axis < 3; axis++)
            grid->origin[row] +=
                grid->direction[row][axis] * grid->spacing[axis] * image->first[axis];
    }
    return true;
}

unsigned vtk_rank_vectors(const struct import_file *file, const char *name, bool is_usual) {
    const bool is_named =
        *file->vectors ? strcmp(file->vectors, name) == 0 : import_derived_names(file->field, name);
    return is_named ? 3 : is_usual ? 2 : 1;
}

/* True if the samples come from the vectors: the file has no others, or the caller wants them. The
 * scalars of the file are then one more field. */
static bool use_derived(struct vtk_volume *v, struct import_header *header) {
    const char *field = v->file->field;
    const bool is_found = v->samples.type && (!*field || strcmp(field, header->value_name) == 0);
    if (!v->vectors.type || is_found ||
        (v->samples.type && !import_derived_of(field, header->vector_name)))
        return false;
    if (v->samples.type)
        import_header_add_other(header, header->value_name);
    v->samples.type = NULL;
    return true;
}

/* Lists what comes from the vectors as fields, and makes it the samples if use_derived(). */
static bool use_vectors(struct vtk_volume *v, struct import_header *header) {
    const bool is_derived = use_derived(v, header);
    if (is_derived)
        import_header_use_vectors(header, v->file->field);
    else if (v->vectors.type)
        import_header_list_derived(header, header->vector_name, "magnitude");
    return is_derived;
}

bool vtk_complete(struct vtk_volume *v, struct import_header *header, uint64_t byte,
                  const char *field, struct sp_error *err) {
    const struct import_file *file = v->file;
    struct sp_grid *grid = &header->grid;
    char place[SP_ERROR_PLACE];
    import_place(place, file->shown, byte, field);
    uint64_t points = (uint64_t)grid->dims[0] * grid->dims[1] * grid->dims[2];
    if (v->vectors.type)
        header->has_vectors = true;
    const bool is_derived = use_vectors(v, header);
    if (!is_derived && v->samples.type->sample < 0)
        return import_fail(
            err, SP_ERR_UNSUPPORTED, file->shown, v->samples.begin, v->samples.name,
            "samples of type %s are not supported; supported are 8 and 16 bits, int, float "
            "and double",
            v->samples.type->legacy);
    if (!is_derived)
        header->type = (enum sp_type)v->samples.type->sample;
    place_samples(v, grid);
    v->samples.count = points;
    v->vectors.count = 3 * points;
    return sp_grid_check(grid, header->type, place, &header->bytes, err) &&
           (!v->samples.type || vtk_array_check(file, &v->samples, err)) &&
           (!v->vectors.type || vtk_array_check(file, &v->vectors, err));
}

bool vtk_read(void *volume, void *voxels, float (*vectors)[3],
              const struct import_progress *progress, struct sp_error *err) {
    struct vtk_volume *v = volume;
    struct import_progress rest = *progress;
    if (v->samples.type && !vtk_array_read(v->file, &v->samples, voxels, progress, err))
        return false;
    rest.before += v->samples.type ? v->samples.count * v->samples.type->number.size : 0;
    return !vectors || vtk_array_read_floats(v->file, &v->vectors, vectors[0], &rest, err);
}

bool vtk_complete_points(struct vtk_volume *v, struct import_header *header, uint64_t count,
                         enum vtk_set set, uint64_t byte, const char *field, struct sp_error *err) {
    const struct import_file *file = v->file;
    if (count > SP_ELEMENTS_MAX)
        return import_fail(err, SP_ERR_UNSUPPORTED, file->shown, byte, field,
                           "%" PRIu64 " points are more than the %d that a volume may have", count,
                           SP_ELEMENTS_MAX);
    if (set == VTK_POLY && count > 0 && vtk_mesh_is_there(&v->mesh) && !*file->field &&
        !*file->vectors)
        return vtk_mesh_open(&v->mesh, file, &v->points, count, header, err);
    memcpy(v->dims, header->grid.dims, sizeof v->dims);
    import_header_use_elements(header,
                               &(struct sp_elements_shape){ .kind = SP_KIND_POINTS,
                                                            .count = (uint32_t)count,
                                                            .has_vectors = v->vectors.type });
    use_vectors(v, header);
    v->derived = header->derived;
    if (set == VTK_STRUCTURED) {
        header->blocks = (const uint32_t(*)[3]) & v->dims;
        header->block_count = 1;
    }
    v->points.count = v->vectors.count = 3 * count;
    v->samples.count = count;
    return count == 0 || (vtk_array_check(file, &v->points, err) &&
                          (!v->samples.type || vtk_array_check(file, &v->samples, err)) &&
                          (!v->vectors.type || vtk_array_check(file, &v->vectors, err)));
}

void vtk_warn_of_cells(const struct import_file *file, uint64_t count) {
    import_warn(file->warnings,
                "The %" PRIu64
                " cells of the unstructured grid are not read; its points are drawn.",
                count);
}

bool vtk_read_elements(void *volume, const struct sp_elements *e,
                       const struct import_progress *progress, struct sp_error *err) {
    struct vtk_volume *v = volume;
    struct import_progress rest = *progress;
    const uint32_t count = e->shape.count;
    if (e->shape.kind == SP_KIND_MESH) {
        import_mesh_parts_read(&v->mesh.parts, e);
        return true;
    }
    if (count == 0)
        return true;
    if (!vtk_array_read_floats(v->file, &v->points, e->positions[0], progress, err))
        return false;
    rest.before += 3 * sizeof(float) * (uint64_t)count;
    if (v->vectors.type) {
        if (!vtk_array_read_floats(v->file, &v->vectors, e->vectors[0], &rest, err))
            return false;
        rest.before += 3 * sizeof(float) * (uint64_t)count;
    }
    if (v->samples.type)
        return vtk_array_read_floats(v->file, &v->samples, e->values, &rest, err);
    import_derive(v->derived, (const float(*)[3])e->vectors, count, e->values);
    for (uint32_t i = 0; i < count && !v->vectors.type; i++)
        e->values[i] = 1;
    return true;
}

void vtk_close(void *volume) {
    struct vtk_volume *v = volume;
    for (int axis = 0; axis < 3; axis++)
        free(v->positions[axis]);
    import_mesh_parts_free(&v->mesh.parts);
    free(v);
}

void vtk_list(char list[160], const char *name) {
    if (strlen(list) + strlen(name) + 3 <= 160) {
        if (list[0])
            strcat(list, ", ");
        strcat(list, name);
    }
}
