/* SPDX-License-Identifier: Apache-2.0
 *
 * VTK data sets that give the position of each point: structured and unstructured grids, and
 * polygons. They are points or a mesh.
 */
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/derived.h"
#include "data/import/vtk.h"
#include "data/volume/volume.h"

static const struct import_conversion *float_conversion(struct vtk_volume *v) {
    const struct vtk_entry *e = v->samples.entry;
    v->conversion = (struct import_conversion){ .number = e->array.type->number,
                                                .components = e->components,
                                                .component = v->samples.component,
                                                .slope = 1,
                                                .type = SP_FLOAT32 };
    return &v->conversion;
}

/* The array of positions of all pieces. */
static struct vtk_choice positions_of(const struct vtk_volume *v) {
    for (size_t i = 0; i < v->entry_count; i++)
        if (v->entries[i].home == VTK_POSITIONS)
            return (struct vtk_choice){ &v->entries[i], 0 };
    return (struct vtk_choice){ NULL, 0 };
}

/* Every piece with points must give their positions. */
static bool check_positions(const struct vtk_volume *v, struct sp_error *err) {
    for (size_t p = 0; p < v->piece_count; p++) {
        const struct vtk_entry *e = vtk_find_entry(v, &v->pieces[p], VTK_POSITIONS, 0, NULL);
        if (v->pieces[p].count && !e)
            return import_fail(err, SP_ERR_FORMAT, v->file->title, v->grid_at, "Points",
                               "the points are missing");
    }
    return true;
}

/* Fills in how many points there are, without ghosts. */
static bool count_points(struct vtk_volume *v, uint64_t *count, struct sp_error *err) {
    if (v->set == VTK_STRUCTURED) {
        if (!vtk_grid_join(v, err))
            return false;
        *count = (uint64_t)v->dims[0] * v->dims[1] * v->dims[2];
        for (size_t p = 0; p < v->piece_count; p++)
            v->pieces[p].count =
                (uint64_t)v->pieces[p].dims[0] * v->pieces[p].dims[1] * v->pieces[p].dims[2];
    } else {
        *count = 0;
        for (size_t p = 0; p < v->piece_count; p++)
            *count += v->pieces[p].count;
    }
    if (*count > SP_ELEMENTS_MAX)
        return import_fail(err, SP_ERR_UNSUPPORTED, v->file->title, v->grid_at, v->grid_name,
                           "%" PRIu64 " points are more than the %d that a volume may have", *count,
                           SP_ELEMENTS_MAX);
    return v->set == VTK_STRUCTURED || vtk_count_kept(v, count, err);
}

static bool check_streams(struct vtk_volume *v, struct sp_error *err) {
    const struct vtk_stream streams[] = { { .choice = positions_of(v) },
                                          { .choice = v->samples },
                                          { .choice = v->vectors } };
    for (int i = 0; i < 3; i++)
        if (!vtk_stream_check(v, &streams[i], err))
            return false;
    return true;
}

bool vtk_points_open(struct vtk_volume *v, struct import_header *header, struct sp_error *err) {
    const struct import_file *file = v->file;
    uint64_t count;
    if (v->piece_count == 0)
        return import_fail(err, SP_ERR_FORMAT, file->title, v->grid_at, v->grid_name,
                           "the file ends without a Piece");
    v->home = VTK_OF_POINTS;
    v->may_be_colored = v->set != VTK_STRUCTURED;
    if (!count_points(v, &count, err) || !check_positions(v, err) || !vtk_choose(v, header, err))
        return false;
    if (v->set == VTK_POLY && count > 0 && vtk_mesh_is_there(v) && !*file->field &&
        !*file->vectors) {
        header->has_vectors = false;
        return vtk_mesh_open(v, header, err);
    }
    const enum import_derived derived = header->derived;
    import_header_use_elements(
        header,
        &(struct sp_elements_shape){ .kind = v->are_colored ? SP_KIND_GAUSSIANS : SP_KIND_POINTS,
                                     .count = (uint32_t)count,
                                     .has_vectors = v->vectors.entry });
    v->derived = derived;
    if (v->are_colored) {
        const struct import_number number = v->samples.entry->array.type->number;
        header->are_colored_points = true;
        header->color_most = import_number_is_whole(number) && number.size <= 2
                                 ? 1 / import_number_color_scale(number)
                                 : 0;
    }
    if (v->set == VTK_STRUCTURED) {
        header->blocks = (const uint32_t(*)[3]) & v->dims;
        header->block_count = 1;
    }
    if (v->has_gaps)
        import_warn(file->warnings,
                    "The pieces of the file do not fill the grid; points between them are not "
                    "drawn.");
    return count == 0 || check_streams(v, err);
}

static bool read_colors(struct vtk_volume *v, const struct sp_elements *e,
                        struct import_progress rest, struct sp_error *err) {
    const uint32_t count = e->shape.count;
    float *values = malloc(count * sizeof *values);
    bool ok = values || sp_fail(err, SP_ERR_MEMORY, v->file->title, "out of memory for colours");
    for (unsigned k = 0; ok && k < 3; k++) {
        v->samples.component = k;
        const struct vtk_stream color = { .choice = v->samples,
                                          .conversion = float_conversion(v),
                                          .out = (char *)values,
                                          .progress = &rest };
        ok = vtk_stream_read(v, &color, err);
        for (uint32_t i = 0; ok && i < count; i++)
            e->harmonics[3 * (size_t)i + k] = values[i];
        rest.before += sizeof *values * (uint64_t)count;
    }
    free(values);
    return ok;
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
    for (uint32_t i = 0; i < count && v->has_gaps; i++)
        e->positions[i][0] = e->positions[i][1] = e->positions[i][2] = e->values[i] = NAN;
    const struct vtk_stream positions = { .choice = positions_of(v),
                                          .out = (char *)e->positions[0],
                                          .shift = v->file->shift,
                                          .progress = progress };
    if (!vtk_stream_read(v, &positions, err))
        return false;
    rest.before += 3 * sizeof(float) * (uint64_t)count;
    const struct vtk_stream vectors = { .choice = v->vectors,
                                        .out = (char *)e->vectors,
                                        .progress = &rest };
    if (v->vectors.entry) {
        if (!vtk_stream_read(v, &vectors, err))
            return false;
        rest.before += 3 * sizeof(float) * (uint64_t)count;
    }
    if (v->are_colored)
        return read_colors(v, e, rest, err);
    if (v->samples.entry) {
        const struct vtk_stream samples = { .choice = v->samples,
                                            .conversion = float_conversion(v),
                                            .out = (char *)e->values,
                                            .progress = &rest };
        return vtk_stream_read(v, &samples, err);
    }
    import_derive(v->derived, (const float(*)[3])e->vectors, count, e->values);
    for (uint32_t i = 0; i < count && !v->vectors.entry; i++)
        e->values[i] = 1;
    return true;
}
