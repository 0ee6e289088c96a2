/* SPDX-License-Identifier: Apache-2.0 */
#include "render/formats.h"

#include <ctype.h>
#include <endian.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "protocol/json.h"
#include "sp/bricks.h"

/* Reads dims, type and kind from text that ends with a NUL. */
typedef void look(const char *text, size_t size, struct srv_format_peek *peek);
static look look_at_bricks, look_at_nrrd, look_at_vtk, look_at_xml, look_at_sidecar, look_at_ply,
    look_at_meta;

static const struct format {
    const char *extension, *name;
    enum sp_kind kind; /* SP_KIND_COUNT = the file tells */
    look *look;        /* NULL = the beginning of the file does not tell more */
} formats[] = {
    { ".nrrd", "NRRD", SP_KIND_GRID, look_at_nrrd },
    { ".nhdr", "NRRD", SP_KIND_GRID, look_at_nrrd },
    { ".vtk", "VTK", SP_KIND_COUNT, look_at_vtk },
    { ".vti", "VTK", SP_KIND_GRID, look_at_xml },
    { ".vtr", "VTK", SP_KIND_GRID, look_at_xml },
    { ".pvti", "VTK", SP_KIND_GRID, look_at_xml },
    { ".pvtr", "VTK", SP_KIND_GRID, look_at_xml },
    { ".json", "raw samples", SP_KIND_GRID, look_at_sidecar },
    { ".dcm", "DICOM", SP_KIND_GRID, NULL },
    { ".ima", "DICOM", SP_KIND_GRID, NULL },
    { ".nii", "NIfTI", SP_KIND_GRID, NULL },
    { ".nii.gz", "NIfTI", SP_KIND_GRID, NULL },
    { ".hdr", "NIfTI", SP_KIND_GRID, NULL },
    { ".mrc", "MRC", SP_KIND_GRID, NULL },
    { ".mrcs", "MRC", SP_KIND_GRID, NULL },
    { ".map", "MRC", SP_KIND_GRID, NULL },
    { ".ccp4", "MRC", SP_KIND_GRID, NULL },
    { ".rec", "MRC", SP_KIND_GRID, NULL },
    { ".st", "MRC", SP_KIND_GRID, NULL },
    { ".ali", "MRC", SP_KIND_GRID, NULL },
    { ".gipl", "GIPL", SP_KIND_GRID, NULL },
    { ".mgh", "MGH", SP_KIND_GRID, NULL },
    { ".mgz", "MGH", SP_KIND_GRID, NULL },
    { ".mhd", "MetaImage", SP_KIND_GRID, look_at_meta },
    { ".mha", "MetaImage", SP_KIND_GRID, look_at_meta },
    { ".pvm", "PVM", SP_KIND_GRID, NULL },
    { ".vdb", "OpenVDB", SP_KIND_GRID, NULL },
    { ".am", "Amira", SP_KIND_GRID, NULL },
    { ".vol", "vol", SP_KIND_GRID, NULL },
    { ".longvol", "vol", SP_KIND_GRID, NULL },
    { ".vgi", "VGStudio", SP_KIND_GRID, NULL },
    { ".h5", "HDF5", SP_KIND_GRID, NULL },
    { ".hdf5", "HDF5", SP_KIND_GRID, NULL },
    { ".he5", "HDF5", SP_KIND_GRID, NULL },
    { ".nxs", "HDF5", SP_KIND_GRID, NULL },
    { ".ims", "HDF5", SP_KIND_GRID, NULL },
    { ".mat", "HDF5", SP_KIND_GRID, NULL },
    { ".nc", "NetCDF", SP_KIND_GRID, NULL },
    { ".nc4", "NetCDF", SP_KIND_GRID, NULL },
    { ".cdf", "NetCDF", SP_KIND_GRID, NULL },
    { ".tif", "TIFF", SP_KIND_GRID, NULL },
    { ".tiff", "TIFF", SP_KIND_GRID, NULL },
    { ".lsm", "TIFF", SP_KIND_GRID, NULL },
    { ".stk", "TIFF", SP_KIND_GRID, NULL },
    { ".png", "PNG", SP_KIND_GRID, NULL },
    { ".jpg", "JPEG", SP_KIND_GRID, NULL },
    { ".jpeg", "JPEG", SP_KIND_GRID, NULL },
    { ".xyz", "PLOT3D", SP_KIND_POINTS, NULL },
    { ".p3d", "PLOT3D", SP_KIND_POINTS, NULL },
    { ".spz", "SPZ", SP_KIND_GAUSSIANS, NULL },
    { ".csv", "CSV", SP_KIND_POINTS, NULL },
    { ".vts", "VTK", SP_KIND_POINTS, NULL },
    { ".vtu", "VTK", SP_KIND_POINTS, NULL },
    { ".vtp", "VTK", SP_KIND_POINTS, NULL },
    { ".pvts", "VTK", SP_KIND_POINTS, NULL },
    { ".pvtu", "VTK", SP_KIND_POINTS, NULL },
    { ".pvtp", "VTK", SP_KIND_POINTS, NULL },
    { ".vtm", "VTK", SP_KIND_GRID, NULL },
    { ".vtmb", "VTK", SP_KIND_GRID, NULL },
    { ".ply", "PLY", SP_KIND_COUNT, look_at_ply },
    { ".stl", "STL", SP_KIND_MESH, NULL },
    { ".obj", "OBJ", SP_KIND_MESH, NULL },
    { ".gltf", "glTF", SP_KIND_MESH, NULL },
    { ".glb", "glTF", SP_KIND_MESH, NULL },
    { ".zarr", "Zarr", SP_KIND_GRID, NULL },
    { ".bricks", "brick file", SP_KIND_GRID, look_at_bricks },
};

/* True for a format whose volumes are folders. */
static bool is_folder(const struct format *format) {
    return strcmp(format->extension, ".zarr") == 0;
}

static const struct format *find_format(const char *name) {
    size_t length = strlen(name);
    for (size_t i = 0; i < sizeof formats / sizeof *formats; i++) {
        size_t n = strlen(formats[i].extension);
        if (length > n && strcasecmp(name + length - n, formats[i].extension) == 0)
            return &formats[i];
    }
    return NULL;
}

const char *srv_format_of(const char *name) {
    const struct format *format = find_format(name);
    return format ? format->name : NULL;
}

bool srv_format_has_steps(const char *format) {
    static const char *const slices[] = { "DICOM", "TIFF", "PNG", "JPEG" };
    for (size_t i = 0; i < sizeof slices / sizeof *slices; i++)
        if (strcmp(format, slices[i]) == 0)
            return false;
    return true;
}

const char *srv_format_extension(const char *name) {
    const struct format *format = find_format(name);
    return format && !is_folder(format) ? format->extension : NULL;
}

bool srv_format_has_no_extension(const char *name) {
    const char *dot = strrchr(name, '.');
    for (const char *c = dot ? dot + 1 : ""; *c; c++)
        if (!isdigit((unsigned char)*c))
            return false;
    return true;
}

bool srv_format_is_dicom(const char *bytes, size_t size) {
    return size >= SRV_FORMAT_DICOM && memcmp(bytes + SRV_FORMAT_DICOM - 4, "DICM", 4) == 0;
}

void srv_format_list(char list[SRV_FORMAT_LIST]) {
    size_t count = sizeof formats / sizeof *formats, used = 0;
    while (is_folder(&formats[count - 1])) /* an upload is a file */
        count--;
    for (size_t i = 0; i < count; i++)
        used += (size_t)snprintf(list + used, SRV_FORMAT_LIST - used, "%s%s",
                                 i == 0           ? ""
                                 : i == count - 1 ? " or "
                                                  : ", ",
                                 formats[i].extension);
}

/* Returns where the last extension of name[0, length) begins; `length` if it has none. */
static size_t before_extension(const char *name, size_t length) {
    for (size_t i = length; i > 1; i--)
        if (name[i - 1] == '.')
            return i - 1;
    return length;
}

size_t srv_format_stem(const char *name) {
    static const char *const packed[] = { ".gz", ".bz2", ".xz", ".zst" };
    size_t length = strlen(name), stem = before_extension(name, length);
    for (size_t i = 0; i < sizeof packed / sizeof *packed; i++)
        if (strcasecmp(name + stem, packed[i]) == 0)
            return before_extension(name, stem);
    if (stem > 4 && strncasecmp(name + stem - 4, ".ome", 4) == 0) /* .ome.zarr, .ome.tif */
        return stem - 4;
    return stem;
}

bool srv_format_is_zarr(int folder) {
    static const char *const names[] = { ".zarray", "zarr.json", ".zattrs", ".zgroup" };
    char text[SRV_FORMAT_PEEK + 1];
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        int fd =
            openat(folder, names[i], O_RDONLY | O_NONBLOCK | O_NOFOLLOW | O_NOCTTY | O_CLOEXEC);
        if (fd < 0)
            continue;
        ssize_t size = read(fd, text, sizeof text - 1);
        close(fd);
        text[size > 0 ? size : 0] = 0;
        return size > 0 && (strstr(text, "\"multiscales\"") ||
                            !(strstr(text, "\"plate\"") || strstr(text, "\"well\"")));
    }
    return false;
}

/* Looking at files. */

static void set_type(struct srv_format_peek *peek, const char *type) {
    snprintf(peek->type, sizeof peek->type, "%s", type);
}

/* Reads three whole numbers, separated by spaces. */
static void read_dims(const char *text, struct srv_format_peek *peek) {
    unsigned long dims[3];
    char *end = (char *)(uintptr_t)text;
    for (int axis = 0; axis < 3; axis++) {
        const char *start = end + strspn(end, " \t");
        if (!isdigit((unsigned char)*start))
            return;
        dims[axis] = strtoul(start, &end, 10);
        if (dims[axis] < 1 || dims[axis] > SP_DIM_MAX)
            return;
    }
    for (int axis = 0; axis < 3; axis++)
        peek->dims[axis] = (uint32_t)dims[axis];
}

/* Returns the text after `key` at the beginning of a line; NULL if no line has it before the first
 * empty one. */
static const char *find_line(const char *text, const char *key) {
    size_t length = strlen(key);
    for (const char *line = text; line && *line && *line != '\n' && *line != '\r';) {
        if (strncasecmp(line, key, length) == 0)
            return line + length;
        line = strchr(line, '\n');
        line = line ? line + 1 : NULL;
    }
    return NULL;
}

/* The C names of types, as NRRD and VTK use them, with the names of the protocol. */
static const struct {
    const char *word, *type;
} types[] = {
    { "uchar", "uint8" },      { "unsigned char", "uint8" },   { "uint8", "uint8" },
    { "uint8_t", "uint8" },    { "unsigned_char", "uint8" },   { "signed char", "int8" },
    { "int8", "int8" },        { "int8_t", "int8" },           { "char", "int8" },
    { "ushort", "uint16" },    { "unsigned short", "uint16" }, { "unsigned short int", "uint16" },
    { "uint16", "uint16" },    { "uint16_t", "uint16" },       { "unsigned_short", "uint16" },
    { "short", "int16" },      { "short int", "int16" },       { "signed short", "int16" },
    { "int16", "int16" },      { "int16_t", "int16" },         { "int", "int32" },
    { "signed int", "int32" }, { "int32", "int32" },           { "int32_t", "int32" },
    { "float", "float32" },    { "float32", "float32" },       { "double", "float64" },
    { "float64", "float64" },
};

/* The word may begin with spaces and ends at one of `ends`. */
static void read_type(const char *text, const char *ends, struct srv_format_peek *peek) {
    text += strspn(text, " \t");
    size_t length = strcspn(text, ends);
    while (length > 0 && strchr(" \t\r", text[length - 1]))
        length--;
    for (size_t i = 0; i < sizeof types / sizeof *types; i++)
        if (strlen(types[i].word) == length && strncasecmp(types[i].word, text, length) == 0)
            set_type(peek, types[i].type);
}

static uint32_t number_at(const char *bytes) {
    uint32_t number;
    memcpy(&number, bytes, sizeof number);
    return le32toh(number);
}

/* renderer/data/bricks/format.c has the same places. */
static void look_at_bricks(const char *text, size_t size, struct srv_format_peek *peek) {
    enum { VERSION_AT = 8, TYPE_AT = 20, DIMS_AT = 28, END = DIMS_AT + 12 };
    if (size < END || memcmp(text, "SPBRICK\n", VERSION_AT) != 0 ||
        number_at(text + VERSION_AT) != SP_BRICKS_VERSION ||
        number_at(text + TYPE_AT) >= SP_TYPE_COUNT)
        return;
    set_type(peek, sp_type_name((enum sp_type)number_at(text + TYPE_AT)));
    for (int axis = 0; axis < 3; axis++)
        peek->dims[axis] = number_at(text + DIMS_AT + 4 * axis);
}

static void look_at_nrrd(const char *text, size_t size, struct srv_format_peek *peek) {
    (void)size;
    if (strncmp(text, "NRRD", 4) != 0)
        return;
    const char *sizes = find_line(text, "sizes:"), *type = find_line(text, "type:");
    const char *dimension = find_line(text, "dimension:");
    if (sizes && dimension && atoi(dimension) == 3) /* a fourth axis may be the first one */
        read_dims(sizes, peek);
    if (type)
        read_type(type, "\n", peek);
}

static void look_at_meta(const char *text, size_t size, struct srv_format_peek *peek) {
    (void)size;
    const char *dims = find_line(text, "DimSize = "), *type = find_line(text, "ElementType = MET_");
    if (dims)
        read_dims(dims, peek);
    if (type)
        read_type(type, "\n", peek);
}

static void look_at_vtk(const char *text, size_t size, struct srv_format_peek *peek) {
    (void)size;
    if (strncmp(text, "# vtk", 5) != 0)
        return;
    const char *dims = find_line(text, "DIMENSIONS"), *scalars = find_line(text, "SCALARS");
    const char *set = find_line(text, "DATASET ");
    if (set)
        peek->kind = strncasecmp(set, "STRUCTURED_POINTS", 17) == 0 ||
                             strncasecmp(set, "RECTILINEAR_GRID", 16) == 0
                         ? SP_KIND_GRID
                         : SP_KIND_POINTS;
    if (dims)
        read_dims(dims, peek);
    if (scalars) {
        scalars += strspn(scalars, " \t");
        scalars += strcspn(scalars, " \t\n"); /* the name of the array */
        read_type(scalars, " \t\n", peek);
    }
    if (scalars && !peek->type[0]) /* "SCALARS name type components" */
        read_type(scalars, "\n", peek);
}

static void look_at_xml(const char *text, size_t size, struct srv_format_peek *peek) {
    (void)size;
    static const char key[] = "WholeExtent=\"";
    const char *extent = strstr(text, key);
    int from[3], to[3];
    if (!extent || sscanf(extent + sizeof key - 1, "%7d %7d %7d %7d %7d %7d", &from[0], &to[0],
                          &from[1], &to[1], &from[2], &to[2]) != 6)
        return;
    for (int axis = 0; axis < 3; axis++)
        if (to[axis] < from[axis] || to[axis] - from[axis] >= (int)SP_DIM_MAX)
            return;
    for (int axis = 0; axis < 3; axis++)
        peek->dims[axis] = (uint32_t)(to[axis] - from[axis] + 1);
}

static void look_at_sidecar(const char *text, size_t size, struct srv_format_peek *peek) {
    struct sp_error err;
    proto_json *json = proto_json_parse(text, size, &err);
    const proto_json *dims = proto_json_get(json, "dims");
    const char *type = proto_json_string(proto_json_get(json, "type"));
    int64_t value[3];
    bool ok = proto_json_size(dims) == 3 && type;
    for (size_t axis = 0; ok && axis < 3; axis++)
        ok = proto_json_integer(proto_json_at(dims, axis), &value[axis]) && value[axis] >= 1 &&
             value[axis] <= SP_DIM_MAX;
    for (int axis = 0; ok && axis < 3; axis++)
        peek->dims[axis] = (uint32_t)value[axis];
    if (ok)
        set_type(peek, type);
    proto_json_free(&json);
}

static void look_at_ply(const char *text, size_t size, struct srv_format_peek *peek) {
    (void)size;
    if (strncmp(text, "ply", 3) != 0)
        return;
    const char *faces = find_line(text, "element face ");
    const bool is_scene = find_line(text, "property float f_dc_0") ||
                          find_line(text, "property uint packed_position");
    peek->kind = is_scene                                 ? SP_KIND_GAUSSIANS
                 : faces && strtoull(faces, NULL, 10) > 0 ? SP_KIND_MESH
                                                          : SP_KIND_POINTS;
}

void srv_format_look(const char *name, const char *bytes, size_t size,
                     struct srv_format_peek *peek) {
    const struct format *format = find_format(name);
    *peek = (struct srv_format_peek){ .kind = format ? format->kind : SP_KIND_COUNT };
    char *text = format && format->look ? malloc(size + 1) : NULL;
    if (!text)
        return;
    memcpy(text, bytes, size);
    text[size] = 0;
    format->look(text, size, peek);
    free(text);
}
