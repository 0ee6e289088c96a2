/* SPDX-License-Identifier: Apache-2.0
 *
 * OpenVDB: one grid of a file, dense in the box of its active voxels; what is not active has the
 * value of the background. OpenImageIO reads it (image_bridge.h).
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/image_bridge.h"
#include "data/import/module.h"
#include "data/volume/volume.h"

enum { GRIDS_MAX = 1024 };

struct vdb {
    const struct import_file *file;
    const struct image_bridge_functions *call;
    struct image_bridge *bridge;
    struct image_grid grid; /* that is read */
    int number;             /* of it; -1 = none */
};

static bool probe(const uint8_t *start, size_t size, const char *title) {
    (void)title;
    return size >= 8 && memcmp(start, " BDV\0\0\0\0", 8) == 0;
}

static bool is_readable(const struct image_grid *grid) {
    return grid->channels == 1 && !grid->is_other && grid->dims[0] > 0 && grid->dims[1] > 0 &&
           grid->dims[2] > 0;
}

/* Chooses the grid that is wanted, or else the first one of scalars. */
static bool choose_grid(struct vdb *v, struct import_header *header, struct sp_error *err) {
    struct image_grid grid;
    struct sp_error why;
    int status = 1;
    v->number = -1;
    for (int n = 0; n < GRIDS_MAX && (status = v->call->grid(v->bridge, n, &grid, &why)) > 0; n++) {
        if (!is_readable(&grid))
            continue;
        const bool is_wanted = strcmp(grid.name, v->file->field) == 0;
        if (v->number >= 0 && !is_wanted) {
            import_header_add_other(header, grid.name);
            continue;
        }
        if (v->number >= 0)
            import_header_add_other(header, v->grid.name);
        v->grid = grid;
        v->number = n;
    }
    if (status < 0)
        return sp_fail(err, why.code, v->file->title, "%s", why.text);
    if (v->number < 0)
        return sp_fail(err, SP_ERR_UNSUPPORTED, v->file->title,
                       "the file has no grid of float or double that has active voxels; grids of "
                       "vectors and integers are not read");
    import_name(header->value_name, v->grid.name);
    return true;
}

static bool place(const struct vdb *v, struct import_header *header, struct sp_error *err) {
    struct sp_grid *grid = &header->grid;
    for (int axis = 0; axis < 3; axis++) {
        const double *step = v->grid.rows[axis];
        const double length = sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2]);
        if (v->grid.dims[axis] > (int)SP_DIM_MAX)
            return sp_fail(err, SP_ERR_UNSUPPORTED, v->file->title,
                           "%d voxels along axis %d are more than %u", v->grid.dims[axis], axis + 1,
                           SP_DIM_MAX);
        grid->dims[axis] = (uint32_t)v->grid.dims[axis];
        grid->spacing[axis] = length;
        for (int row = 0; row < 3; row++)
            grid->direction[row][axis] = step[row] / length;
    }
    for (int row = 0; row < 3; row++) {
        grid->origin[row] = v->grid.rows[3][row];
        for (int axis = 0; axis < 3; axis++)
            grid->origin[row] += v->grid.first[axis] * v->grid.rows[axis][row];
    }
    header->type = v->grid.is_double ? SP_FLOAT64 : SP_FLOAT32;
    if (v->grid.is_level_set)
        header->meaning = SP_MEANING_DISTANCE;
    return sp_grid_check(grid, header->type, v->file->title, &header->bytes, err);
}

static bool open_vdb(void *reader, const struct import_file *file, struct import_header *header,
                     struct sp_error *err) {
    struct vdb *v = reader;
    v->file = file;
    char path[40];
    struct sp_error why;
    v->call = import_module_load(v->file, IMAGE_BRIDGE_MODULE, IMAGE_BRIDGE_SYMBOL, "OpenImageIO",
                                 "libopenimageio2.4", err);
    if (!v->call)
        return false;
    /* Opens by descriptor, because the name may refer to another file by now. */
    snprintf(path, sizeof path, "/proc/self/fd/%d", v->file->fd);
    v->bridge = v->call->open(path, "openvdb", &why);
    if (!v->bridge)
        return sp_fail(err, why.code, v->file->title, "%s", why.text);
    return choose_grid(v, header, err) && place(v, header, err);
}

static void close_vdb(void *reader) {
    struct vdb *v = reader;
    if (v->bridge)
        v->call->close(v->bridge);
}

struct reading {
    const struct import_progress *progress;
    size_t size; /* bytes of a voxel */
};

static void report(void *user, size_t done) {
    const struct reading *r = user;
    import_report(r->progress, done * r->size);
}

static bool read_vdb(void *reader, void *voxels, float (*vectors)[3],
                     const struct import_progress *progress, struct sp_error *err) {
    struct vdb *v = reader;
    struct reading r = { progress, v->grid.is_double ? sizeof(double) : sizeof(float) };
    struct sp_error why;
    (void)vectors;
    return v->call->voxels(v->bridge, v->number, voxels, report, &r, &why) ||
           sp_fail(err, why.code, v->file->title, "%s", why.text);
}

const struct import_format import_vdb = { .name = "OpenVDB",
                                          .needs_module = true,
                                          .probe = probe,
                                          .reader_size = sizeof(struct vdb),
                                          .open = open_vdb,
                                          .read = read_vdb,
                                          .close = close_vdb };
