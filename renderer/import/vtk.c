/* SPDX-License-Identifier: Apache-2.0 */
#include "import/vtk.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "volume/grid.h"

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

bool vtk_complete(struct vtk_volume *v, struct import_header *header, uint64_t byte,
                  const char *field, struct sp_error *err) {
    const struct import_file *file = v->file;
    struct sp_grid *grid = &header->grid;
    char place[SP_ERROR_PLACE];
    import_place(place, file->shown, byte, field);
    uint64_t points = (uint64_t)grid->dims[0] * grid->dims[1] * grid->dims[2];
    if (v->vectors.type)
        header->has_vectors = true;
    if (!v->samples.type)
        import_header_use_lengths(header);
    else if (v->samples.type->sample < 0)
        return import_fail(
            err, SP_ERR_UNSUPPORTED, file->shown, v->samples.begin, v->samples.name,
            "samples of type %s are not supported; supported are 8 and 16 bits, int, float "
            "and double",
            v->samples.type->legacy);
    else
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
    return !vectors || vtk_array_read_vectors(v->file, &v->vectors, vectors, &rest, err);
}

void vtk_close(void *volume) {
    struct vtk_volume *v = volume;
    for (int axis = 0; axis < 3; axis++)
        free(v->positions[axis]);
    free(v);
}

void vtk_list(char list[160], const char *name) {
    if (strlen(list) + strlen(name) + 3 <= 160) {
        if (list[0])
            strcat(list, ", ");
        strcat(list, name);
    }
}
