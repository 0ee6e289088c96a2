/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/hdf5_grids.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "data/volume/unit.h"

/* Removes the last part of a path; the group of the root is "/". */
static void leave(char *path) {
    char *slash = strrchr(path, '/');
    if (slash)
        slash[slash == path] = 0;
}

/* openPMD: attributes of the array, or of the group whose components the arrays are. */

static size_t mesh_numbers(const struct arrays *a, const char *name, double *out) {
    char group[ARRAY_NAME_BYTES];
    const size_t count = a->call->numbers(a->handle, a->chosen, name, out, IMPORT_RANK_MAX);
    memcpy(group, a->info.name, sizeof group);
    leave(group);
    return count > 0 || !a->call->group_numbers
               ? count
               : a->call->group_numbers(a->handle, group, name, out, IMPORT_RANK_MAX);
}

static void mesh_text(const struct arrays *a, const char *name, char *out, size_t capacity) {
    char group[ARRAY_NAME_BYTES];
    a->call->text(a->handle, a->chosen, name, out, capacity);
    memcpy(group, a->info.name, sizeof group);
    leave(group);
    if (!*out && a->call->group_text)
        a->call->group_text(a->handle, group, name, out, capacity);
}

static bool are_positive(const double *values, size_t count) {
    bool are = count > 0;
    for (size_t i = 0; i < count; i++)
        are &= isfinite(values[i]) && values[i] > 0;
    return are;
}

/* The unit of `meters` if the least step [m] is not tiny in it, or else the largest one in which it
 * is not below 1. */
static const struct sp_unit *choose_unit(double meters, double least) {
    static const char *const names[] = { "m", "mm", "um", "nm", "pm", NULL };
    const struct sp_unit *unit = NULL;
    for (const char *const *name = names; *name; name++)
        if (fabs(meters / sp_unit_find(*name)->meters - 1) < 1e-9 && least >= 1e-3 * meters)
            return sp_unit_find(*name);
    for (const char *const *name = names; *name && !(unit && least >= unit->meters); name++)
        unit = sp_unit_find(*name);
    return unit;
}

static void warn_of_values(const struct arrays *a) {
    double unit;
    if (a->call->numbers(a->handle, a->chosen, "unitSI", &unit, 1) == 1 && isfinite(unit) &&
        unit != 1)
        import_warn(a->file->warnings,
                    "The numbers are those of the file; times %g (unitSI) they are in SI units.",
                    unit);
}

/* Places the grid. The numbers of the axes have the order of the labels: the order of the
 * dimensions, or its reverse if dataOrder is Fortran's. */
static void place_mesh(const struct arrays *a, struct import_header *header) {
    double spacing[IMPORT_RANK_MAX], offset[IMPORT_RANK_MAX] = { 0 };
    double position[IMPORT_RANK_MAX] = { 0 }, meters[IMPORT_RANK_MAX];
    char geometry[64], order[8];
    const size_t rank = a->info.rank, count = mesh_numbers(a, "gridSpacing", spacing);
    if (count == 0)
        return;
    mesh_text(a, "geometry", geometry, sizeof geometry);
    mesh_text(a, "dataOrder", order, sizeof order);
    const bool is_cartesian = !*geometry || strcmp(geometry, "cartesian") == 0;
    if (!is_cartesian || count != rank || !are_positive(spacing, rank)) {
        import_warn(a->file->warnings,
                    "The mesh of openPMD %s%.40s%s: it is shown on an even grid of its indices.",
                    is_cartesian ? "has no valid gridSpacing" : "has the geometry \"",
                    is_cartesian ? "" : geometry, is_cartesian ? "" : "\"");
        return;
    }
    const size_t units = mesh_numbers(a, "gridUnitSI", meters);
    const bool has_unit = (units == 1 || units == rank) && are_positive(meters, units);
    double least = INFINITY;
    for (size_t k = 0; k < rank; k++) {
        meters[k] = has_unit ? meters[units == 1 ? 0 : k] : 1;
        least = fmin(least, spacing[k] * meters[k]);
    }
    if (mesh_numbers(a, "gridGlobalOffset", offset) != rank)
        memset(offset, 0, sizeof offset);
    if (a->call->numbers(a->handle, a->chosen, "position", position, IMPORT_RANK_MAX) != rank)
        memset(position, 0, sizeof position);
    const struct sp_unit *unit = has_unit ? choose_unit(meters[0], least) : NULL;
    for (int axis = 0; axis < 3; axis++) {
        const int d = a->axes.space[axis];
        if (d < 0)
            continue;
        const size_t k = order[0] == 'F' ? rank - 1 - (size_t)d : (size_t)d;
        const double factor = unit ? meters[k] / unit->meters : 1;
        const double origin = (offset[k] + position[k] * spacing[k]) * factor;
        header->grid.spacing[axis] = spacing[k] * factor;
        if (axis == 0) /* a flat mesh is as thick as its columns are wide */
            header->grid.spacing[1] = header->grid.spacing[2] = spacing[k] * factor;
        header->grid.origin[axis] = isfinite(origin) ? origin : 0;
    }
    snprintf(header->unit, sizeof header->unit, "%s", unit ? unit->symbol : "");
    warn_of_values(a);
}

/* DREAM.3D: GEOMETRY/MATRIX/ARRAY, of cells of a box. */

struct cells {
    double dims[3], spacing[3], origin[3]; /* of x, y and z; the origin is a corner */
};

static bool read_cells(const struct arrays *a, struct cells *cells) {
    static const char *const names[] = { "DIMENSIONS", "SPACING", "ORIGIN" };
    double *const out[] = { cells->dims, cells->spacing, cells->origin };
    char group[ARRAY_NAME_BYTES], path[ARRAY_NAME_BYTES + 64];
    memcpy(group, a->info.name, sizeof group);
    leave(group);
    leave(group);
    bool ok = a->info.rank == 3 || a->info.rank == 4;
    for (int i = 0; i < 3 && ok; i++) {
        snprintf(path, sizeof path, "%s/_SIMPL_GEOMETRY/%s", group, names[i]);
        ok = arrays_read_numbers(a, path, 1, 3, out[i]);
        snprintf(path, sizeof path, "_%s", names[i]); /* of newer versions */
        ok = ok || (a->call->group_numbers &&
                    a->call->group_numbers(a->handle, group, path, out[i], 3) == 3);
    }
    for (int axis = 0; axis < 3 && ok; axis++)
        ok = cells->dims[axis] == (double)a->info.shape[2 - axis] &&
             isfinite(cells->origin[axis]) && are_positive(&cells->spacing[axis], 1);
    return ok;
}

void hdf5_grids_name_dimensions(struct arrays *a) {
    static const char *const names[] = { "z", "y", "x", "component" };
    struct cells cells;
    for (unsigned d = 0; read_cells(a, &cells) && d < a->info.rank; d++)
        snprintf(a->info.dims[d], sizeof a->info.dims[d], "%s", names[d]);
}

void hdf5_grids_place(const struct arrays *a, struct import_header *header) {
    struct cells cells;
    place_mesh(a, header);
    if (!read_cells(a, &cells))
        return;
    for (int axis = 0; axis < 3; axis++) { /* the samples are the centres */
        header->grid.spacing[axis] = cells.spacing[axis];
        header->grid.origin[axis] = cells.origin[axis] + cells.spacing[axis] / 2;
    }
}
