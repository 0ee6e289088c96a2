/* SPDX-License-Identifier: Apache-2.0
 *
 * VTK XML files with one piece: images (.vti), rectilinear (.vtr), structured (.vts) and
 * unstructured grids (.vtu), and polygons (.vtp). expat parses the part before the appended data.
 * The reader remembers the place of arrays, never their text. A document type is refused.
 *
 *   VTKFile ─► ImageData | … ─► Piece ─► PointData, Coordinates, Points ─► DataArray
 *           └► AppendedData: here parsing stops
 */
#include <errno.h>
#include <expat.h>
#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "import/vtk.h"
#include "import/vtk_xml_probe.h"

enum { CHUNK = 1 << 16, TAG_MAX = 1 << 20 }; /* bytes */
enum { DEPTH_MAX = 32 };

struct data_array {
    struct vtk_array array;
    bool used, appended;
};

enum { SAMPLES, VECTORS };

struct xml { /* state while the file is read */
    const struct import_file *file;
    struct import_header *header;
    struct vtk_volume *volume;
    struct sp_error *err;
    XML_Parser parser;
    bool failed, stopped;
    int depth;
    enum vtk_set set;
    bool big_endian, zlib;
    unsigned length_size;
    int pieces;
    uint64_t grid_at; /* offset of the grid's element; 0 = not seen */
    bool in_grid, in_points, in_coordinates, in_positions;
    int cells;                                 /* enum vtk_cell_kind of the part; −1 = none */
    struct data_array corners[VTK_CELL_KINDS], /* of cells, and their ends */
        ends[VTK_CELL_KINDS], normals, colors;
    struct vtk_image image;
    char selected[2][96];       /* the Scalars and Vectors that PointData selects */
    struct data_array found[2]; /* samples and vectors */
    unsigned rank[2];           /* how well they suit; 0 = none is found */
    struct data_array coordinates[3];
    unsigned coordinate_count;
    struct data_array positions;
    uint64_t count;            /* points of a piece without an extent */
    struct data_array *inside; /* the array whose text is being parsed; NULL = none */
    bool appended_base64;
    uint64_t appended_at; /* 0 = there is no appended data */
    char others[160];
};

__attribute__((format(printf, 4, 5))) static void
refuse(struct xml *x, enum sp_code code, const char *field, const char *format, ...) {
    if (x->failed)
        return;
    char text[SP_ERROR_TEXT];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    x->failed = true;
    import_fail(x->err, code, x->file->shown, (uint64_t)XML_GetCurrentByteIndex(x->parser), field,
                "%s", text);
    XML_StopParser(x->parser, XML_FALSE);
}

/* Attributes. */

static const char *find(const char **attributes, const char *name) {
    for (; *attributes; attributes += 2)
        if (strcmp(attributes[0], name) == 0)
            return attributes[1];
    return NULL;
}

/* Reads exactly n numbers. A missing attribute changes nothing. */
static void take_numbers(struct xml *x, const char **attributes, const char *name, double *out,
                         int n) {
    const char *text = find(attributes, name), *at = text;
    for (int i = 0; text && i < n; i++) {
        char *end;
        out[i] = strtod(at, &end);
        if (end == at || !isfinite(out[i])) {
            refuse(x, SP_ERR_FORMAT, name, "\"%.60s\" is not %d numbers", text, n);
            return;
        }
        at = end;
    }
    if (text && at[strspn(at, " \t\n\r")])
        refuse(x, SP_ERR_FORMAT, name, "\"%.60s\" is more than %d numbers", text, n);
}

static bool take_whole(struct xml *x, const char **attributes, const char *name, uint64_t otherwise,
                       uint64_t limit, uint64_t *out) {
    const char *text = find(attributes, name);
    char *end = NULL;
    *out = text ? strtoull(text, &end, 10) : otherwise;
    if (!text || (text[0] >= '0' && text[0] <= '9' && !*end && *out <= limit))
        return true;
    refuse(x, SP_ERR_FORMAT, name, "\"%.40s\" is not a whole number up to %" PRIu64, text, limit);
    return false;
}

/* Elements. */

static const char *const sets[] = { [VTK_NO_SET] = "",
                                    [VTK_IMAGE] = "ImageData",
                                    [VTK_RECTILINEAR] = "RectilinearGrid",
                                    [VTK_STRUCTURED] = "StructuredGrid",
                                    [VTK_UNSTRUCTURED] = "UnstructuredGrid",
                                    [VTK_POLY] = "PolyData" };

static void take_root(struct xml *x, const char *name, const char **attributes) {
    const char *type = find(attributes, "type"), *order = find(attributes, "byte_order");
    const char *length = find(attributes, "header_type");
    const char *compressor = find(attributes, "compressor");
    if (strcmp(name, "VTKFile") != 0) {
        refuse(x, SP_ERR_UNSUPPORTED, NULL, "the root element is %.40s instead of VTKFile", name);
        return;
    }
    for (int set = VTK_IMAGE; type && set <= VTK_POLY; set++)
        if (strcmp(type, sets[set]) == 0)
            x->set = (enum vtk_set)set;
    x->big_endian = order && strcmp(order, "BigEndian") == 0;
    x->zlib = compressor && compressor[0];
    x->length_size = length && strcmp(length, "UInt64") == 0 ? 8 : 4;
    if (!x->set)
        refuse(
            x, SP_ERR_UNSUPPORTED, "type",
            "is %.40s; it must be ImageData, RectilinearGrid, StructuredGrid, UnstructuredGrid or "
            "PolyData",
            type ? type : "missing");
    else if (order && !x->big_endian && strcmp(order, "LittleEndian") != 0)
        refuse(x, SP_ERR_FORMAT, "byte_order", "is \"%.40s\"; it must be LittleEndian or BigEndian",
               order);
    else if (length && x->length_size == 4 && strcmp(length, "UInt32") != 0)
        refuse(x, SP_ERR_FORMAT, "header_type", "is \"%.40s\"; it must be UInt32 or UInt64",
               length);
    else if (x->zlib && strcmp(compressor, "vtkZLibDataCompressor") != 0)
        refuse(x, SP_ERR_UNSUPPORTED, "compressor",
               "%.40s is not supported; use vtkZLibDataCompressor or none", compressor);
}

static void take_grid(struct xml *x, const char *name, const char **attributes) {
    x->in_grid = strcmp(name, sets[x->set]) == 0;
    if (!x->in_grid)
        return;
    if (x->grid_at)
        refuse(x, SP_ERR_FORMAT, NULL, "%.40s occurs twice", name);
    x->grid_at = (uint64_t)XML_GetCurrentByteIndex(x->parser);
    if (x->set != VTK_IMAGE)
        return;
    take_numbers(x, attributes, "Origin", x->image.origin, 3);
    take_numbers(x, attributes, "Spacing", x->image.spacing, 3);
    take_numbers(x, attributes, "Direction", x->image.direction, 9);
}

static const char *const cell_names[VTK_CELL_KINDS] = {
    [VTK_VERTS] = "Verts", [VTK_LINES] = "Lines", [VTK_POLYS] = "Polys", [VTK_STRIPS] = "Strips"
};

static void take_piece(struct xml *x, const char *name, const char **attributes) {
    if (strcmp(name, "Piece") != 0)
        return;
    if (x->pieces++ > 0) {
        refuse(x, SP_ERR_UNSUPPORTED, "Piece",
               "several pieces are not supported; save the data as one piece");
        return;
    }
    double extent[6] = { 0 };
    if (x->set > VTK_STRUCTURED) {
        if (!find(attributes, "NumberOfPoints"))
            refuse(x, SP_ERR_FORMAT, "NumberOfPoints", "is missing");
        take_whole(x, attributes, "NumberOfPoints", 0, UINT32_MAX, &x->count);
        uint64_t cells = 0;
        take_whole(x, attributes, "NumberOfCells", 0, UINT64_MAX, &cells);
        if (x->set == VTK_UNSTRUCTURED && cells > 0 && cells != x->count)
            vtk_warn_of_cells(x->file, cells);
        for (int kind = 0; kind < VTK_CELL_KINDS && x->set == VTK_POLY; kind++) {
            char number[32];
            snprintf(number, sizeof number, "NumberOf%s", cell_names[kind]);
            take_whole(x, attributes, number, 0, UINT32_MAX, &x->volume->mesh.cells[kind].count);
        }
        return;
    }
    if (!find(attributes, "Extent"))
        refuse(x, SP_ERR_FORMAT, "Extent", "is missing");
    take_numbers(x, attributes, "Extent", extent, 6);
    for (int axis = 0; axis < 3 && !x->failed; axis++) {
        double low = extent[2 * axis], high = extent[2 * axis + 1];
        if (low != trunc(low) || high != trunc(high) || fabs(low) > INT32_MAX)
            refuse(x, SP_ERR_FORMAT, "Extent", "%g to %g is not a range of whole numbers", low,
                   high);
        else if (!(high >= low && high - low < SP_DIM_MAX))
            refuse(x, SP_ERR_FORMAT, "Extent", "%g to %g does not hold 1 to %u samples", low, high,
                   SP_DIM_MAX);
        else {
            x->image.first[axis] = (int32_t)low;
            x->header->grid.dims[axis] = (uint32_t)(high - low) + 1;
        }
    }
}

static void take_part(struct xml *x, const char *name, const char **attributes) {
    x->in_points = strcmp(name, "PointData") == 0;
    x->in_coordinates = x->set == VTK_RECTILINEAR && strcmp(name, "Coordinates") == 0;
    x->in_positions = vtk_has_points(x->set) && strcmp(name, "Points") == 0;
    x->cells = -1;
    for (int kind = 0; kind < VTK_CELL_KINDS && x->set == VTK_POLY; kind++)
        if (strcmp(name, cell_names[kind]) == 0) {
            x->cells = kind;
            x->volume->mesh.cells[kind].at = (uint64_t)XML_GetCurrentByteIndex(x->parser);
        }
    x->volume->mesh.has_cell_data |= x->set == VTK_POLY && strcmp(name, "CellData") == 0;
    static const char *const selections[] = { [SAMPLES] = "Scalars", [VECTORS] = "Vectors" };
    for (int kind = SAMPLES; kind <= VECTORS && x->in_points; kind++) {
        const char *array = find(attributes, selections[kind]);
        if (array)
            snprintf(x->selected[kind], sizeof x->selected[kind], "%s", array);
    }
}

/* Fills *out, except `components`. */
static bool describe_array(struct xml *x, const char **attributes, const char *name,
                           struct data_array *out) {
    const char *type = find(attributes, "type"), *format = find(attributes, "format");
    struct vtk_array *a = &out->array;
    *out = (struct data_array){ .used = true };
    snprintf(a->name, sizeof a->name, "DataArray \"%.60s\"", name);
    a->type = vtk_find_type(type ? type : "", true);
    if (!a->type) {
        refuse(x, SP_ERR_UNSUPPORTED, a->name, "values of type \"%.40s\" are not supported",
               type ? type : "");
        return false;
    }
    a->big_endian = x->big_endian;
    a->end = x->file->size;
    out->appended = format && strcmp(format, "appended") == 0;
    if (!format || strcmp(format, "ascii") == 0) {
        a->form = VTK_WORDS;
        return true;
    }
    a->form = out->appended ? VTK_BYTES : VTK_BASE64;
    a->zlib = x->zlib;
    a->length_size = x->length_size;
    if (out->appended)
        return take_whole(x, attributes, "offset", 0, x->file->size, &a->begin);
    if (strcmp(format, "binary") != 0) {
        refuse(x, SP_ERR_FORMAT, a->name,
               "format is \"%.40s\"; it must be ascii, binary or appended", format);
        return false;
    }
    return true;
}

/* Arrays of a data set of polygons that only a mesh has; NULL = it is none. */
static struct data_array *choose_of_mesh(struct xml *x, const char *name, bool is_byte,
                                         uint64_t components) {
    const bool is_color = is_byte && (components == 3 || components == 4);
    if (x->cells >= 0)
        return strcmp(name, "connectivity") == 0 ? &x->corners[x->cells]
               : strcmp(name, "offsets") == 0    ? &x->ends[x->cells]
                                                 : NULL;
    if (x->set != VTK_POLY || !x->in_points || x->file->field[0] || x->file->vectors[0])
        return NULL;
    if (is_color && !x->colors.used) {
        x->volume->mesh.color_components = (unsigned)components;
        return &x->colors;
    }
    return components == 3 && strcasecmp(name, "Normals") == 0 ? &x->normals : NULL;
}

/* Takes the array that PointData selects as scalars or vectors, or else the first array with one or
 * three components. Three bytes per point are colours if PointData does not select them. */
static struct data_array *choose_slot(struct xml *x, const char *name, const char *type,
                                      uint64_t components) {
    if (x->in_coordinates && x->coordinate_count == 3) {
        refuse(x, SP_ERR_FORMAT, "Coordinates", "has more than three arrays");
        return NULL;
    }
    if (x->in_coordinates)
        return &x->coordinates[x->coordinate_count++];
    if (x->in_positions) {
        if (components == 3 && !x->positions.used)
            return &x->positions;
        refuse(x, SP_ERR_FORMAT, "Points", "must have one array of three components");
        return NULL;
    }
    int kind = components == 3 ? VECTORS : SAMPLES;
    struct data_array *slot = &x->found[kind];
    const struct vtk_type *known = vtk_find_type(type ? type : "", true);
    char *own = kind == VECTORS ? x->header->vector_name : x->header->value_name;
    const char *wanted = kind == SAMPLES && x->file->field[0] ? x->file->field : x->selected[kind];
    bool is_selected = *wanted && strcmp(wanted, name) == 0;
    bool is_color = kind == VECTORS && !is_selected && known && known->sample == SP_UINT8;
    const unsigned rank =
        kind == VECTORS ? vtk_rank_vectors(x->file, name, is_selected) : is_selected + 1u;
    if ((components == 1 || components == 3) && known && !is_color && rank > x->rank[kind]) {
        x->rank[kind] = rank;
        if (kind == SAMPLES)
            import_header_add_other(x->header, own);
        else
            import_header_add_other_vectors(x->header, own);
        import_name(own, name);
        return slot;
    }
    if (kind == SAMPLES && known && components == 1)
        import_header_add_other(x->header, name);
    if (kind == VECTORS && known && !is_color)
        import_header_add_other_vectors(x->header, name);
    vtk_list(x->others, name);
    return NULL;
}

static void take_array(struct xml *x, const char *element, const char **attributes) {
    uint64_t components;
    const char *name = find(attributes, "Name");
    name = name ? name : "";
    if ((!x->in_points && !x->in_coordinates && !x->in_positions && x->cells < 0) ||
        strcmp(element, "DataArray") != 0 ||
        !take_whole(x, attributes, "NumberOfComponents", 1, 1 << 16, &components))
        return;
    const char *type = find(attributes, "type");
    struct data_array *slot =
        choose_of_mesh(x, name, type && strcmp(type, "UInt8") == 0, components);
    if (!slot && x->cells < 0)
        slot = choose_slot(x, name, type, components);
    if (!slot || !describe_array(x, attributes, name, slot) || slot->appended)
        return;
    x->inside = slot;
    slot->array.begin =
        (uint64_t)XML_GetCurrentByteIndex(x->parser) + (uint64_t)XML_GetCurrentByteCount(x->parser);
}

static void take_appended(struct xml *x, const char **attributes) {
    const char *encoding = find(attributes, "encoding");
    x->appended_base64 = !encoding || strcmp(encoding, "base64") == 0;
    if (!x->appended_base64 && strcmp(encoding, "raw") != 0)
        refuse(x, SP_ERR_UNSUPPORTED, "encoding", "is \"%.40s\"; it must be raw or base64",
               encoding);
    x->appended_at =
        (uint64_t)XML_GetCurrentByteIndex(x->parser) + (uint64_t)XML_GetCurrentByteCount(x->parser);
    x->stopped = true;
    XML_StopParser(x->parser, XML_FALSE);
}

/* The text of an array ends with its element or at a child element with metadata. */
static void end_text(struct xml *x) {
    if (x->inside)
        x->inside->array.end = (uint64_t)XML_GetCurrentByteIndex(x->parser);
    x->inside = NULL;
}

static void XMLCALL start_element(void *user, const char *name, const char **attributes) {
    struct xml *x = user;
    end_text(x);
    switch (++x->depth) {
    case 1:
        take_root(x, name, attributes);
        break;
    case 2:
        if (strcmp(name, "AppendedData") == 0)
            take_appended(x, attributes);
        else
            take_grid(x, name, attributes);
        break;
    case 3:
        if (x->in_grid)
            take_piece(x, name, attributes);
        break;
    case 4:
        if (x->in_grid)
            take_part(x, name, attributes);
        break;
    case 5:
        if (x->in_grid)
            take_array(x, name, attributes);
        break;
    case DEPTH_MAX:
        refuse(x, SP_ERR_FORMAT, NULL, "elements nest deeper than %d", DEPTH_MAX);
        break;
    }
}

static void XMLCALL end_element(void *user, const char *name) {
    (void)name;
    struct xml *x = user;
    end_text(x);
    x->depth--;
}

static void XMLCALL start_doctype(void *user, const char *name, const char *system,
                                  const char *public, int internal) {
    (void)name;
    (void)system;
    (void)public;
    (void)internal;
    refuse(user, SP_ERR_FORMAT, NULL, "a document type is not accepted");
}

/* Parsing. */

/* Checks after a chunk: expat holds back a tag that has not ended yet. */
static bool check_chunk(struct xml *x, enum XML_Status status, uint64_t fed) {
    if (x->failed)
        return false;
    if (status == XML_STATUS_OK) {
        XML_Index at = XML_GetCurrentByteIndex(x->parser);
        return at < 0 || fed - (uint64_t)at <= TAG_MAX ||
               import_fail(x->err, SP_ERR_FORMAT, x->file->shown, (uint64_t)at, NULL,
                           "a tag is longer than %d bytes", TAG_MAX);
    }
    if (x->stopped)
        return true;
    enum XML_Error why = XML_GetErrorCode(x->parser);
    return import_fail(x->err, why == XML_ERROR_NO_MEMORY ? SP_ERR_MEMORY : SP_ERR_FORMAT,
                       x->file->shown, (uint64_t)XML_GetCurrentByteIndex(x->parser), NULL,
                       "line %lu: %s", (unsigned long)XML_GetCurrentLineNumber(x->parser),
                       XML_ErrorString(why));
}

static bool parse(struct xml *x) {
    uint64_t fed = 0;
    for (bool last = false; !last && !x->stopped;) {
        void *buffer = XML_GetBuffer(x->parser, CHUNK);
        if (!buffer)
            return sp_fail(x->err, SP_ERR_MEMORY, x->file->shown,
                           "out of memory while parsing XML");
        ssize_t got = pread(x->file->fd, buffer, CHUNK, (off_t)fed);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return import_fail(x->err, SP_ERR_IO, x->file->shown, fed, NULL, "cannot read: %s",
                               strerror(errno));
        fed += (uint64_t)got;
        last = got == 0;
        if (!check_chunk(x, XML_ParseBuffer(x->parser, (int)got, last), fed))
            return false;
    }
    return true;
}

/* Appended data begins after an underscore. */
static bool find_appended(struct xml *x) {
    char start[4096];
    ssize_t n = pread(x->file->fd, start, sizeof start, (off_t)x->appended_at);
    ssize_t i = 0;
    while (i < n && (start[i] == ' ' || (start[i] >= '\t' && start[i] <= '\r')))
        i++;
    if (i >= n || start[i] != '_')
        return import_fail(x->err, SP_ERR_FORMAT, x->file->shown, x->appended_at, "AppendedData",
                           "does not begin with an underscore");
    x->appended_at += (uint64_t)i + 1;
    return true;
}

/* Computes the place of the array's values, once the whole file has been parsed. */
static bool locate(struct xml *x, struct data_array *d) {
    struct vtk_array *a = &d->array;
    if (!d->appended) {
        a->end = a->end > a->begin ? a->end : a->begin; /* an element without content */
        return true;
    }
    if (!x->appended_at)
        return import_fail(x->err, SP_ERR_FORMAT, x->file->shown, x->file->size, a->name,
                           "the file ends before its AppendedData");
    a->form = x->appended_base64 ? VTK_BASE64 : VTK_BYTES;
    a->begin += x->appended_at;
    return true;
}

static bool take_coordinates(struct xml *x) {
    if (x->coordinate_count != 3)
        return import_fail(x->err, SP_ERR_FORMAT, x->file->shown, x->grid_at, "Coordinates",
                           "%u arrays instead of three", x->coordinate_count);
    for (int axis = 0; axis < 3; axis++) {
        struct data_array *d = &x->coordinates[axis];
        d->array.count = x->header->grid.dims[axis];
        if (!locate(x, d) || !vtk_array_check(x->file, &d->array, x->err) ||
            !(x->volume->positions[axis] = vtk_array_read_numbers(x->file, &d->array, x->err)))
            return false;
    }
    return true;
}

static bool take_mesh(struct xml *x) {
    struct vtk_mesh *mesh = &x->volume->mesh;
    bool ok =
        (!x->normals.used || locate(x, &x->normals)) && (!x->colors.used || locate(x, &x->colors));
    for (int kind = 0; kind < VTK_CELL_KINDS && ok; kind++) {
        struct vtk_cells *cells = &mesh->cells[kind];
        ok = (!x->corners[kind].used || locate(x, &x->corners[kind])) &&
             (!x->ends[kind].used || locate(x, &x->ends[kind]));
        cells->points = x->corners[kind].array;
        cells->ends = x->ends[kind].array;
        cells->ends.count = cells->count;
        if (ok && cells->count && kind != VTK_VERTS && !(cells->points.type && cells->ends.type))
            ok = import_fail(x->err, SP_ERR_FORMAT, x->file->shown, cells->at, cell_names[kind],
                             "%" PRIu64 " cells without the arrays connectivity and offsets",
                             cells->count);
    }
    mesh->normals = x->normals.array;
    mesh->colors = x->colors.array;
    return ok;
}

/* The points of an unstructured grid, polygons, or a structured grid. */
static bool take_points(struct xml *x) {
    const uint32_t *dims = x->header->grid.dims;
    if (x->set == VTK_STRUCTURED)
        x->count = (uint64_t)dims[0] * dims[1] * dims[2];
    if (!x->positions.used && x->count > 0)
        return import_fail(x->err, SP_ERR_FORMAT, x->file->shown, x->grid_at, "Points",
                           "are missing");
    if (x->positions.used && !locate(x, &x->positions))
        return false;
    x->volume->points = x->positions.array;
    if (x->set == VTK_POLY && !take_mesh(x))
        return false;
    return vtk_complete_points(x->volume, x->header, x->count, x->set, x->grid_at, sets[x->set],
                               x->err);
}

static bool take_all(struct xml *x) {
    import_header_init(x->header);
    if (!parse(x) || (x->appended_at && !find_appended(x)))
        return false;
    if (!x->pieces)
        return import_fail(x->err, SP_ERR_FORMAT, x->file->shown, x->grid_at, sets[x->set],
                           "the file ends without a Piece");
    if (!vtk_has_points(x->set) && !x->found[SAMPLES].used && !x->found[VECTORS].used)
        return import_fail(x->err, SP_ERR_UNSUPPORTED, x->file->shown, x->grid_at, "PointData",
                           "the file has no array with one number or three per point; it has %s",
                           x->others[0] ? x->others : "no array of points, perhaps of cells");
    for (int kind = SAMPLES; kind <= VECTORS; kind++)
        if (x->found[kind].used && !locate(x, &x->found[kind]))
            return false;
    x->volume->samples = x->found[SAMPLES].array;
    x->volume->vectors = x->found[VECTORS].array;
    if (vtk_has_points(x->set))
        return take_points(x);
    if (!(x->set == VTK_RECTILINEAR
              ? take_coordinates(x)
              : vtk_place_image(x->file, &x->image, x->header, x->grid_at, x->err)))
        return false;
    return vtk_complete(x->volume, x->header, x->grid_at, sets[x->set], x->err);
}

static void *open_xml(const struct import_file *file, struct import_header *header,
                      struct sp_error *err) {
    struct vtk_volume *volume = calloc(1, sizeof *volume);
    struct xml *x = calloc(1, sizeof *x);
    XML_Parser parser = XML_ParserCreate("UTF-8");
    bool ok = volume && x && parser;
    if (ok) {
        volume->file = file;
        *x = (struct xml){ .file = file,
                           .header = header,
                           .volume = volume,
                           .err = err,
                           .parser = parser,
                           .cells = -1,
                           .image = { .spacing = { 1, 1, 1 },
                                      .direction = { 1, 0, 0, 0, 1, 0, 0, 0, 1 } } };
        XML_SetUserData(parser, x);
        XML_SetElementHandler(parser, start_element, end_element);
        XML_SetStartDoctypeDeclHandler(parser, start_doctype);
        ok = take_all(x);
    } else {
        sp_fail(err, SP_ERR_MEMORY, file->shown, "out of memory while parsing XML");
    }
    if (parser)
        XML_ParserFree(parser);
    free(x);
    if (ok)
        return volume;
    if (volume)
        vtk_close(volume);
    return NULL;
}

const struct import_format import_vtk_xml = { .name = "VTK XML",
                                              .probe = vtk_xml_probe,
                                              .open = open_xml,
                                              .read = vtk_read,
                                              .read_elements = vtk_read_elements,
                                              .close = vtk_close };
