/* SPDX-License-Identifier: Apache-2.0
 *
 * What programs write beside the conventions of CF: the axis tags of vigra and ilastik, and the
 * size of a voxel as an attribute.
 */
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "data/import/array_reader.h"
#include "data/volume/unit.h"

enum { TAGS_BYTES = 8192 };

/* The flags of vigra's axis types. */
enum { VIGRA_CHANNELS = 1, VIGRA_TIME = 8 };

/* An image of HDF5 in colours: rows of pixels, or a plane per colour. */
static void read_color_tags(struct arrays *a) {
    char class[24], mode[24];
    a->call->text(a->handle, a->chosen, "IMAGE_SUBCLASS", class, sizeof class);
    a->call->text(a->handle, a->chosen, "INTERLACE_MODE", mode, sizeof mode);
    if (strcmp(class, "IMAGE_TRUECOLOR") != 0 || a->info.rank != 3)
        return;
    const bool is_plane = strcmp(mode, "INTERLACE_PLANE") == 0;
    for (unsigned d = 0; d < 3; d++)
        snprintf(a->info.dims[d], sizeof a->info.dims[d], "%c", (is_plane ? "cyx" : "yxc")[d]);
}

void arrays_read_tags(struct arrays *a) {
    char text[TAGS_BYTES];
    const json_t *axes, *axis;
    json_error_t why;
    size_t d;
    read_color_tags(a);
    a->call->text(a->handle, a->chosen, "axistags", text, sizeof text);
    if (!*text)
        return;
    json_t *tags = json_loads(text, 0, &why);
    axes = json_object_get(tags, "axes");
    if (json_array_size(axes) != a->info.rank || a->info.rank == 0)
        import_warn(a->file->warnings,
                    "The attribute axistags was left out: it does not have one axis for each of "
                    "the %u dimensions.",
                    a->info.rank);
    else
        json_array_foreach(axes, d, axis) {
            const char *key = json_string_value(json_object_get(axis, "key"));
            const json_int_t flags = json_integer_value(json_object_get(axis, "typeFlags"));
            const double step = json_number_value(json_object_get(axis, "resolution"));
            snprintf(a->info.dims[d], sizeof a->info.dims[d], "%s",
                     flags & VIGRA_CHANNELS ? "c"
                     : flags & VIGRA_TIME   ? "t"
                     : key                  ? key
                                            : "");
            a->steps[d] = isfinite(step) && step > 0 ? step : 0;
        }
    json_decref(tags);
}

/* Attributes that give the size of a voxel. The names of some contain the unit. */
static const struct size_name {
    const char *name, *unit;
} names[] = {
    { "element_size_um", "um" }, { "voxel_size_um", "um" },   { "voxel_size_nm", "nm" },
    { "voxel_size_mm", "mm" },   { "pixel_size_um", "um" },   { "pixel_size_nm", "nm" },
    { "pixel_size_mm", "mm" },   { "spacing_um", "um" },      { "spacing_nm", "nm" },
    { "spacing_mm", "mm" },      { "resolution_um", "um" },   { "resolution_nm", "nm" },
    { "spacing", NULL },         { "voxel_size", NULL },      { "voxel_spacing", NULL },
    { "voxelsize", NULL },       { "voxelSize", NULL },       { "VoxelSize", NULL },
    { "pixel_size", NULL },      { "pixel_spacing", NULL },   { "pixelSize", NULL },
    { "element_size", NULL },    { "element_spacing", NULL }, { "resolution", NULL },
};

/* Finds the attribute of the array, or of the file. */
static const struct size_name *find_size(const struct arrays *a, double *sizes, size_t *count,
                                         unsigned *owner) {
    for (unsigned i = 0; i < 2; i++) {
        *owner = i == 0 ? a->chosen : ARRAY_OF_FILE;
        for (const struct size_name *one = names; one < names + sizeof names / sizeof *names;
             one++) {
            *count = a->call->numbers(a->handle, *owner, one->name, sizes, IMPORT_RANK_MAX);
            bool is_size = *count > 0;
            for (size_t k = 0; k < *count; k++)
                is_size &= isfinite(sizes[k]) && sizes[k] > 0;
            if (is_size)
                return one;
        }
    }
    return NULL;
}

/* The dimensions of space in the order of the file. */
static unsigned list_space(const struct arrays *a, int axes[3]) {
    unsigned count = 0;
    for (int d = 0; d < (int)a->info.rank; d++)
        for (int axis = 0; axis < 3; axis++)
            if (a->axes.space[axis] == d)
                axes[count++] = axis;
    return count;
}

static void read_unit(const struct arrays *a, const struct size_name *from, unsigned owner,
                      struct import_header *header) {
    char name[64], text[SP_UNIT_BYTES];
    const char *const more[] = { name, "unit", "spatial_unit", "spacing_units" };
    snprintf(text, sizeof text, "%s", from->unit ? from->unit : "");
    snprintf(name, sizeof name, "%s_unit", from->name);
    for (size_t i = 0; !*text && i < sizeof more / sizeof *more; i++)
        a->call->text(a->handle, owner, more[i], text, sizeof text);
    const struct sp_unit *unit = sp_unit_find(text);
    if (*text)
        snprintf(header->unit, sizeof header->unit, "%s", unit ? unit->symbol : text);
}

/* True if the array of WRF lies on the faces of cells along an axis: the dimension has one place
 * more than there are cells. */
static bool is_staggered(const struct arrays *a, int axis) {
    static const char *const dims[3] = { "west_east_stag", "south_north_stag", "bottom_top_stag" };
    char stagger[8];
    const int d = a->axes.space[axis];
    if (d < 0 || strcmp(a->info.dims[d], dims[axis]) == 0)
        return d >= 0;
    a->call->text(a->handle, a->chosen, "stagger", stagger, sizeof stagger);
    return strncmp(a->info.dims[d], dims[axis], strcspn(dims[axis], "_")) == 0 &&
           strchr(stagger, "XYZ"[axis]);
}

/* The grid of WRF is even on its map: DX and DY of the file are its steps. Its levels have no even
 * height, so they get a share of the horizontal extent of the cells. */
static void read_wrf_steps(struct arrays *a, struct import_header *header) {
    static const char *const dims[2] = { "west_east", "south_north" };
    static const char *const attributes[2] = { "DX", "DY" };
    struct sp_grid *grid = &header->grid;
    double steps[2], extent = 0;
    for (int axis = 0; axis < 2; axis++) {
        const int d = a->axes.space[axis];
        if (d < 0 || a->is_placed[axis] ||
            strncmp(a->info.dims[d], dims[axis], strlen(dims[axis])) != 0 ||
            a->call->numbers(a->handle, ARRAY_OF_FILE, attributes[axis], &steps[axis], 1) != 1 ||
            !isfinite(steps[axis]) || !(steps[axis] > 0))
            return;
        const double cells = (double)grid->dims[axis] - is_staggered(a, axis);
        extent = fmax(extent, fmax(cells - 1, axis == 0) * steps[axis]);
    }
    for (int axis = 0; axis < 2; axis++) {
        grid->spacing[axis] = steps[axis];
        a->is_placed[axis] = true;
    }
    snprintf(header->unit, sizeof header->unit, "m");
    if (a->is_placed[2])
        return;
    grid->spacing[2] = steps[0]; /* of a flat array */
    if (grid->dims[2] < 2)
        return;
    const double levels = (double)grid->dims[2] - is_staggered(a, 2);
    grid->spacing[2] = extent * ARRAYS_HEIGHT_SHARE / fmax(levels - 1, 1);
    header->vertical.per_unit = grid->spacing[2];
    snprintf(header->vertical.unit, sizeof header->vertical.unit, "levels");
    import_warn(a->file->warnings,
                "The levels of WRF have no height here: the vertical axis was scaled to a quarter "
                "of the horizontal ones.");
}

/* The centre of the first cell is at 0; its first face lies half a cell before. */
static void apply_wrf(struct arrays *a, struct import_header *header) {
    bool has_coordinates[3];
    memcpy(has_coordinates, a->is_placed, sizeof has_coordinates);
    read_wrf_steps(a, header);
    for (int axis = 0; axis < 3; axis++)
        if (!has_coordinates[axis] && is_staggered(a, axis))
            header->grid.origin[axis] = -header->grid.spacing[axis] / 2;
}

void arrays_read_sizes(struct arrays *a, struct import_header *header) {
    double sizes[IMPORT_RANK_MAX], offsets[IMPORT_RANK_MAX];
    int axes[3];
    size_t count;
    unsigned owner;
    const unsigned space = list_space(a, axes);
    apply_wrf(a, header);
    for (unsigned i = 0; i < space; i++)
        if (a->steps[a->axes.space[axes[i]]] > 0 && !a->is_placed[axes[i]])
            header->grid.spacing[axes[i]] = a->steps[a->axes.space[axes[i]]];
    const struct size_name *from = find_size(a, sizes, &count, &owner);
    if (!from || a->is_placed[0] || a->is_placed[1] || a->is_placed[2])
        return;
    if (count != 1 && count != space && count != a->info.rank) {
        import_warn(a->file->warnings,
                    "The attribute %s was left out: it has %zu numbers, the array %u dimensions "
                    "of space.",
                    from->name, count, space);
        return;
    }
    const bool has_offset =
        a->call->numbers(a->handle, owner, "offset", offsets, IMPORT_RANK_MAX) == count;
    for (unsigned i = 0; i < space; i++) {
        const int axis = axes[i], d = a->axes.space[axis];
        const size_t k = count == 1 ? 0 : count == space ? i : (size_t)d;
        header->grid.spacing[axis] = sizes[k];
        if (has_offset && isfinite(offsets[k]))
            header->grid.origin[axis] = offsets[k];
    }
    if (space == 2 && count == 3) /* of one slice */
        header->grid.spacing[3 - axes[0] - axes[1]] = sizes[0];
    read_unit(a, from, owner, header);
    if (!from->unit)
        import_warn(a->file->warnings,
                    "The attribute %s gives the spacing, in the order of the dimensions%s.",
                    from->name, header->unit[0] ? "" : "; the file does not tell its unit");
}
