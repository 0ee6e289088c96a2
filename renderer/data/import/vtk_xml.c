/* SPDX-License-Identifier: Apache-2.0
 *
 * One XML file of VTK: images (.vti), rectilinear (.vtr), structured (.vts) and unstructured grids
 * (.vtu), and polygons (.vtp). expat parses the part before the appended data. The reader remembers
 * the place of arrays, never their text. A document type is refused.
 *
 *   VTKFile ─► ImageData | … ─► Piece ─► PointData, Coordinates, Points ─► DataArray
 *           │                └► FieldData ─► DataArray
 *           └► AppendedData: here parsing stops
 *
 * Of a parallel or composite data set, the elements name other files.
 *
 * Why this parser is our own: parsers.md.
 */
#include <expat.h>
#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "data/import/vtk_xml.h"

enum { CHUNK = 1 << 16, TAG_MAX = 1 << 20 }; /* bytes */
enum { DEPTH_MAX = 32 };

struct xml { /* state while a file is read */
    const struct import_file *file;
    struct vtk_volume *volume;
    struct vtk_xml_names *names; /* of other files; NULL = the file is a piece of another one */
    uint32_t number;             /* of the file */
    struct sp_error *err;
    XML_Parser parser;
    bool failed, stopped;
    int depth;
    enum vtk_set set;
    bool is_parallel, is_composite;
    bool big_endian;
    enum vtk_packing packing;
    unsigned length_size;
    bool in_grid, in_piece, in_data; /* inside of the data set, a piece, its FieldData */
    bool has_grid;
    bool in_cells; /* the part has data of cells that are not read */
    int home;      /* enum vtk_home of the part; −1 = none that is read */
    int kind;      /* enum vtk_cell_kind of the part */
    unsigned coordinate_count;
    struct vtk_entry time; /* of FieldData; without a type if there is none */
    bool has_time;
    struct vtk_entry *inside; /* the array whose text is being parsed; NULL = none */
    size_t first_entry;       /* of this file */
    bool appended_base64;
    uint64_t appended_at; /* 0 = there is no appended data */
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
    import_fail(x->err, code, x->file->title, (uint64_t)XML_GetCurrentByteIndex(x->parser), field,
                "%s", text);
    XML_StopParser(x->parser, XML_FALSE);
}

/* Attributes. */

static const char *get_attr(const char **attributes, const char *name) {
    for (; *attributes; attributes += 2)
        if (strcmp(attributes[0], name) == 0)
            return attributes[1];
    return NULL;
}

/* Reads exactly n numbers. A missing attribute changes nothing. */
static void read_numbers(struct xml *x, const char **attributes, const char *name, double *out,
                         int n) {
    const char *text = get_attr(attributes, name), *at = text;
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

static bool read_whole(struct xml *x, const char **attributes, const char *name, uint64_t otherwise,
                       uint64_t limit, uint64_t *out) {
    const char *text = get_attr(attributes, name);
    char *end = NULL;
    *out = text ? strtoull(text, &end, 10) : otherwise;
    if (!text || (text[0] >= '0' && text[0] <= '9' && !*end && *out <= limit))
        return true;
    refuse(x, SP_ERR_FORMAT, name, "\"%.40s\" is not a whole number up to %" PRIu64, text, limit);
    return false;
}

/* Elements. */

/* The data set of the file; "P" before it: in pieces of other files. */
static void parse_type(struct xml *x, const char *type) {
    if (!vtk_xml_find_type(type, &x->set, &x->is_parallel, &x->is_composite))
        refuse(x, SP_ERR_UNSUPPORTED, "type",
               "data set %.40s is not supported; supported are ImageData, RectilinearGrid, "
               "StructuredGrid, UnstructuredGrid, PolyData, the same with P before them, "
               "vtkMultiBlockDataSet and vtkPartitionedDataSet",
               type);
    else if (!x->names && (x->is_parallel || x->is_composite || x->set != x->volume->set))
        refuse(x, SP_ERR_UNSUPPORTED, "type", "is %.40s, but a piece must be %s", type,
               vtk_set_names[x->volume->set]);
}

static void parse_root(struct xml *x, const char *name, const char **attributes) {
    const char *type = get_attr(attributes, "type"), *order = get_attr(attributes, "byte_order");
    const char *length = get_attr(attributes, "header_type");
    const char *compressor = get_attr(attributes, "compressor");
    if (strcmp(name, "VTKFile") != 0) {
        refuse(x, SP_ERR_UNSUPPORTED, NULL, "this is XML of the kind <%.40s>, not <VTKFile>", name);
        return;
    }
    if (type)
        parse_type(x, type);
    if (x->names && x->set) {
        x->volume->set = x->set;
        x->volume->grid_name = vtk_set_names[x->set];
    }
    if (!type)
        refuse(x, SP_ERR_UNSUPPORTED, "type",
               "is missing; it must be ImageData, RectilinearGrid, StructuredGrid, "
               "UnstructuredGrid or PolyData");
    x->big_endian = order && strcmp(order, "BigEndian") == 0;
    x->length_size = length && strcmp(length, "UInt64") == 0 ? 8 : 4;
    if (order && !x->big_endian && strcmp(order, "LittleEndian") != 0)
        refuse(x, SP_ERR_FORMAT, "byte_order", "is \"%.40s\"; it must be LittleEndian or BigEndian",
               order);
    else if (length && x->length_size == 4 && strcmp(length, "UInt32") != 0)
        refuse(x, SP_ERR_FORMAT, "header_type", "is \"%.40s\"; it must be UInt32 or UInt64",
               length);
    else if (compressor && !vtk_xml_find_packing(compressor, &x->packing))
        refuse(x, SP_ERR_UNSUPPORTED, "compressor",
               "%.40s is not supported; supported are vtkZLibDataCompressor, vtkLZ4DataCompressor "
               "and vtkLZMADataCompressor",
               compressor);
}

static void parse_grid(struct xml *x, const char *name, const char **attributes) {
    struct vtk_volume *v = x->volume;
    x->in_grid = x->set && strcmp(name + x->is_parallel, vtk_set_names[x->set]) == 0;
    if (!x->in_grid)
        return;
    if (x->has_grid)
        refuse(x, SP_ERR_FORMAT, NULL, "%.40s occurs twice", name);
    x->has_grid = true;
    if (!x->names) /* the file that names the pieces gives their place */
        return;
    v->grid_at = (uint64_t)XML_GetCurrentByteIndex(x->parser);
    if (x->set != VTK_IMAGE)
        return;
    read_numbers(x, attributes, "Origin", v->image.origin, 3);
    read_numbers(x, attributes, "Spacing", v->image.spacing, 3);
    read_numbers(x, attributes, "Direction", v->image.direction, 9);
}

static const char *const cell_names[VTK_CELL_KINDS] = {
    [VTK_VERTS] = "Verts", [VTK_LINES] = "Lines", [VTK_POLYS] = "Polys", [VTK_STRIPS] = "Strips"
};

static void stop(struct xml *x) {
    x->failed = true;
    XML_StopParser(x->parser, XML_FALSE);
}

/* The arrays that a section calls its scalars and vectors; the first section that does counts. */
static void parse_selection(struct xml *x, enum vtk_home home, const char **attributes) {
    static const char *const names[] = {
        [VTK_SAMPLES] = "Scalars", [VTK_VECTOR_FIELD] = "Vectors"
    };
    for (int kind = VTK_SAMPLES; kind <= VTK_VECTOR_FIELD; kind++) {
        const char *array = get_attr(attributes, names[kind]);
        if (array && !x->volume->selected[home][kind][0])
            import_name(x->volume->selected[home][kind], array);
    }
}

static void parse_counts(struct xml *x, struct vtk_piece *piece, const char **attributes) {
    uint64_t cells = 0;
    if (!get_attr(attributes, "NumberOfPoints"))
        refuse(x, SP_ERR_FORMAT, "NumberOfPoints", "this field is missing");
    read_whole(x, attributes, "NumberOfPoints", 0, UINT32_MAX, &piece->count);
    read_whole(x, attributes, "NumberOfCells", 0, UINT64_MAX, &cells);
    if (x->set == VTK_UNSTRUCTURED && cells != piece->count)
        x->volume->cell_count += cells;
    for (int kind = 0; kind < VTK_CELL_KINDS && x->set == VTK_POLY; kind++) {
        char number[32];
        snprintf(number, sizeof number, "NumberOf%s", cell_names[kind]);
        read_whole(x, attributes, number, 0, UINT32_MAX, &piece->cells[kind].count);
    }
}

static void parse_extent(struct xml *x, struct vtk_piece *piece, const char **attributes) {
    double extent[6] = { 0 };
    if (!get_attr(attributes, "Extent"))
        refuse(x, SP_ERR_FORMAT, "Extent", "this field is missing");
    read_numbers(x, attributes, "Extent", extent, 6);
    for (int axis = 0; axis < 3 && !x->failed; axis++) {
        const double low = extent[2 * axis], high = extent[2 * axis + 1];
        if (low != trunc(low) || high != trunc(high) || fabs(low) > INT32_MAX / 2)
            refuse(x, SP_ERR_FORMAT, "Extent", "%g to %g is not a range of whole numbers", low,
                   high);
        else if (!(high >= low - 1 && high - low < SP_DIM_MAX))
            refuse(x, SP_ERR_FORMAT, "Extent", "%g to %g does not hold 0 to %u samples", low, high,
                   SP_DIM_MAX);
        else {
            piece->first[axis] = (int32_t)low;
            piece->dims[axis] = (uint32_t)(high - low + 1);
        }
    }
}

static void parse_piece(struct xml *x, const char **attributes) {
    if (x->is_parallel) {
        const char *source = get_attr(attributes, "Source");
        if (!source || !*source)
            refuse(x, SP_ERR_FORMAT, "Source", "is missing: the piece names no file");
        else if (!x->failed && !vtk_add_file(x->volume, source, x->err))
            stop(x);
        return;
    }
    struct vtk_piece *piece = vtk_add_piece(x->volume, x->number, x->err);
    if (!piece)
        stop(x);
    else if (vtk_has_points(x->set) && x->set != VTK_STRUCTURED)
        parse_counts(x, piece, attributes);
    else
        parse_extent(x, piece, attributes);
}

static void parse_in_grid(struct xml *x, const char *name, const char **attributes) {
    x->in_piece = strcmp(name, "Piece") == 0;
    x->in_data = strcmp(name, "FieldData") == 0;
    x->coordinate_count = 0;
    if (x->in_piece)
        parse_piece(x, attributes);
    else if (x->is_parallel && strcmp(name, "PPointData") == 0)
        parse_selection(x, VTK_OF_POINTS, attributes);
    else if (x->is_parallel && strcmp(name, "PCellData") == 0)
        parse_selection(x, VTK_OF_CELLS, attributes);
}

static void parse_section(struct xml *x, const char *name, const char **attributes) {
    struct vtk_piece *piece = &x->volume->pieces[x->volume->piece_count - 1];
    x->home = -1;
    x->in_cells = strcmp(name, "CellData") == 0 && vtk_has_points(x->set);
    if (strcmp(name, "PointData") == 0)
        x->home = VTK_OF_POINTS;
    else if (strcmp(name, "CellData") == 0 && !vtk_has_points(x->set))
        x->home = VTK_OF_CELLS;
    else if (x->set == VTK_RECTILINEAR && strcmp(name, "Coordinates") == 0)
        x->home = VTK_COORDINATES;
    else if (vtk_has_points(x->set) && strcmp(name, "Points") == 0)
        x->home = VTK_POSITIONS;
    for (int kind = 0; kind < VTK_CELL_KINDS && x->set == VTK_POLY; kind++)
        if (strcmp(name, cell_names[kind]) == 0) {
            x->home = VTK_CORNERS;
            x->kind = kind;
            piece->cells[kind].at = (uint64_t)XML_GetCurrentByteIndex(x->parser);
        }
    if (x->home == VTK_OF_POINTS || x->home == VTK_OF_CELLS)
        parse_selection(x, (enum vtk_home)x->home, attributes);
}

/* Fills in everything but the name and home. */
static bool describe_array(struct xml *x, const char **attributes, const char *name,
                           struct vtk_entry *e) {
    const char *type = get_attr(attributes, "type"), *format = get_attr(attributes, "format");
    struct vtk_array *a = &e->array;
    snprintf(a->name, sizeof a->name, "DataArray \"%.60s\"", name);
    a->type = vtk_find_type(type ? type : "", true);
    a->big_endian = x->big_endian;
    a->end = x->file->size;
    e->is_appended = format && strcmp(format, "appended") == 0;
    if (!format || strcmp(format, "ascii") == 0) {
        a->form = VTK_WORDS;
        return true;
    }
    a->form = e->is_appended ? VTK_BYTES : VTK_BASE64;
    a->packing = x->packing;
    a->length_size = x->length_size;
    if (e->is_appended)
        return read_whole(x, attributes, "offset", 0, x->file->size, &a->begin);
    if (strcmp(format, "binary") != 0) {
        refuse(x, SP_ERR_FORMAT, a->name,
               "format is \"%.40s\"; it must be ascii, binary or appended", format);
        return false;
    }
    return true;
}

static void begin_text(struct xml *x, struct vtk_entry *e) {
    x->inside = e;
    e->array.begin =
        (uint64_t)XML_GetCurrentByteIndex(x->parser) + (uint64_t)XML_GetCurrentByteCount(x->parser);
}

/* Sets what the array is for. False if the part cannot have it. */
static bool place_array(struct xml *x, struct vtk_entry *e, const char *name) {
    if (e->home == VTK_COORDINATES && x->coordinate_count == 3) {
        refuse(x, SP_ERR_FORMAT, "Coordinates", "has more than three arrays");
        return false;
    }
    if (e->home == VTK_COORDINATES)
        e->part = x->coordinate_count++;
    if (e->home == VTK_POSITIONS)
        e->name[0] = 0;
    if (e->home == VTK_POSITIONS && e->components != 3) {
        refuse(x, SP_ERR_FORMAT, "Points", "must have one array of three components");
        return false;
    }
    if (e->home == VTK_CORNERS) {
        e->home = strcmp(name, "offsets") == 0 ? VTK_ENDS : VTK_CORNERS;
        e->part = (unsigned)x->kind;
    }
    if (e->home == VTK_OF_POINTS || e->home == VTK_OF_CELLS) {
        char(*selected)[SP_FIELD_BYTES] = x->volume->selected[e->home];
        const bool has_name = e->name[0] != 0;
        e->role = has_name && strcmp(e->name, selected[VTK_VECTOR_FIELD]) == 0 ? VTK_VECTORS
                  : has_name && strcmp(e->name, selected[VTK_SAMPLES]) == 0    ? VTK_SCALARS
                  : strcasecmp(e->name, "Normals") == 0                        ? VTK_NORMALS
                                                                               : VTK_ANY;
    }
    return true;
}

/* Parses the time of the data set. */
static void parse_time(struct xml *x, const char *name, const char **attributes) {
    if (strcmp(name, "TimeValue") != 0 && strcmp(name, "TIME") != 0)
        return;
    x->time = (struct vtk_entry){ .components = 1 };
    if (!describe_array(x, attributes, name, &x->time))
        return;
    x->has_time = x->time.array.type != NULL;
    if (x->has_time && !x->time.is_appended)
        begin_text(x, &x->time);
}

static void parse_array(struct xml *x, const char *element, const char **attributes) {
    uint64_t components;
    const char *name = get_attr(attributes, "Name"), *type = get_attr(attributes, "type");
    name = name ? name : "";
    if (x->in_cells && strcmp(element, "DataArray") == 0)
        vtk_note_cells(x->volume, name);
    if (x->home < 0 || x->failed || strcmp(element, "DataArray") != 0 ||
        !read_whole(x, attributes, "NumberOfComponents", 1, VTK_COMPONENTS_MAX, &components))
        return;
    const bool is_field = x->home == VTK_OF_POINTS || x->home == VTK_OF_CELLS;
    if (is_field && (!vtk_find_type(type ? type : "", true) || components == 0))
        return; /* texts */
    struct vtk_entry *e = vtk_add_entry(x->volume, (enum vtk_home)x->home, name, x->err);
    if (!e) {
        stop(x);
        return;
    }
    e->components = (unsigned)components;
    if (!place_array(x, e, name) || !describe_array(x, attributes, name, e))
        return;
    if (!e->array.type)
        refuse(x, SP_ERR_UNSUPPORTED, e->array.name, "values of type \"%.40s\" are not supported",
               type ? type : "");
    else if (!e->is_appended)
        begin_text(x, e);
}

static void parse_appended(struct xml *x, const char **attributes) {
    const char *encoding = get_attr(attributes, "encoding");
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

/* An element of a composite data set that names a file. */
static void parse_block(struct xml *x, const char *name, const char **attributes) {
    const char *source = get_attr(attributes, "file");
    if (strcmp(name, "DataSet") == 0 && source && *source &&
        !vtk_xml_add_name(x->names, source, x->file, x->err))
        stop(x);
}

static void XMLCALL start_element(void *user, const char *name, const char **attributes) {
    struct xml *x = user;
    end_text(x);
    x->depth++;
    if (x->depth == DEPTH_MAX)
        refuse(x, SP_ERR_FORMAT, NULL, "elements nest deeper than %d", DEPTH_MAX);
    else if (x->depth == 1)
        parse_root(x, name, attributes);
    else if (x->is_composite)
        parse_block(x, name, attributes);
    else if (x->depth == 2 && strcmp(name, "AppendedData") == 0)
        parse_appended(x, attributes);
    else if (x->depth == 2)
        parse_grid(x, name, attributes);
    else if (x->depth == 3 && x->in_grid)
        parse_in_grid(x, name, attributes);
    else if (x->depth == 4 && x->in_piece && !x->is_parallel)
        parse_section(x, name, attributes);
    else if (x->depth == 4 && x->in_data)
        parse_time(x, get_attr(attributes, "Name") ? get_attr(attributes, "Name") : "", attributes);
    else if (x->depth == 5 && x->in_piece && !x->is_parallel)
        parse_array(x, name, attributes);
}

static void XMLCALL end_element(void *user, const char *name) {
    (void)name;
    struct xml *x = user;
    end_text(x);
    x->depth--;
    if (x->depth == 3)
        x->home = -1;
    if (x->depth <= 2)
        x->in_piece = x->in_data = false;
    if (x->depth <= 1)
        x->in_grid = false;
}

static void XMLCALL start_doctype(void *user, const char *name, const char *system,
                                  const char *public, int internal) {
    (void)name;
    (void)system;
    (void)public;
    (void)internal;
    refuse(user, SP_ERR_FORMAT, NULL, "the file has a document type (<!DOCTYPE); remove it");
}

/* Parsing. */

/* Checks after a chunk: expat holds back a tag that has not ended yet. */
static bool check_chunk(struct xml *x, enum XML_Status status, uint64_t fed) {
    if (x->failed)
        return false;
    if (status == XML_STATUS_OK) {
        XML_Index at = XML_GetCurrentByteIndex(x->parser);
        return at < 0 || fed - (uint64_t)at <= TAG_MAX ||
               import_fail(x->err, SP_ERR_FORMAT, x->file->title, (uint64_t)at, NULL,
                           "a tag is longer than %d bytes", TAG_MAX);
    }
    if (x->stopped)
        return true;
    enum XML_Error why = XML_GetErrorCode(x->parser);
    return import_fail(x->err, why == XML_ERROR_NO_MEMORY ? SP_ERR_MEMORY : SP_ERR_FORMAT,
                       x->file->title, (uint64_t)XML_GetCurrentByteIndex(x->parser), NULL,
                       "line %lu: %s", (unsigned long)XML_GetCurrentLineNumber(x->parser),
                       XML_ErrorString(why));
}

static bool parse(struct xml *x) {
    uint64_t fed = 0;
    for (bool last = false; !last && !x->stopped;) {
        void *buffer = XML_GetBuffer(x->parser, CHUNK);
        if (!buffer)
            return sp_fail(x->err, SP_ERR_MEMORY, x->file->title,
                           "out of memory while parsing XML");
        size_t got;
        if (!import_read(x->file, buffer, CHUNK, fed, &got, x->err))
            return false;
        fed += got;
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
        return import_fail(x->err, SP_ERR_FORMAT, x->file->title, x->appended_at, "AppendedData",
                           "the data does not begin with an underscore");
    x->appended_at += (uint64_t)i + 1;
    return true;
}

/* Computes the place of the array's values, once the whole file has been parsed. */
static bool locate(struct xml *x, struct vtk_entry *e) {
    struct vtk_array *a = &e->array;
    if (!e->is_appended) {
        a->end = a->end > a->begin ? a->end : a->begin; /* an element without content */
        return true;
    }
    if (!x->appended_at)
        return import_fail(x->err, SP_ERR_FORMAT, x->file->title, x->file->size, a->name,
                           "the file ends before its AppendedData");
    a->form = x->appended_base64 ? VTK_BASE64 : VTK_BYTES;
    a->begin += x->appended_at;
    return true;
}

/* Cells of polygons get their arrays. */
static bool join_cells(struct xml *x, struct vtk_piece *piece) {
    for (unsigned kind = 0; kind < VTK_CELL_KINDS; kind++) {
        struct vtk_cells *cells = &piece->cells[kind];
        const struct vtk_entry *corners =
            vtk_find_entry(x->volume, piece, VTK_CORNERS, kind, "connectivity");
        const struct vtk_entry *ends = vtk_find_entry(x->volume, piece, VTK_ENDS, kind, NULL);
        if (cells->count && kind != VTK_VERTS && !(corners && ends))
            return import_fail(x->err, SP_ERR_FORMAT, x->file->title, cells->at, cell_names[kind],
                               "%" PRIu64 " cells without the arrays connectivity and offsets",
                               cells->count);
        if (!corners || !ends)
            continue;
        cells->points = corners->array;
        cells->ends = ends->array;
        cells->ends.count = cells->count;
    }
    return true;
}

static bool read_time(struct xml *x) {
    struct vtk_array *a = &x->time.array;
    a->count = 1;
    if (!locate(x, &x->time) || !vtk_array_check(x->file, a, x->err))
        return false;
    double *time = vtk_array_read_numbers(x->file, a, x->err);
    if (time)
        x->volume->time = *time;
    free(time);
    return time != NULL;
}

static bool finish(struct xml *x) {
    struct vtk_volume *v = x->volume;
    if (x->appended_at && !find_appended(x))
        return false;
    for (size_t i = x->first_entry; i < v->entry_count; i++)
        if (!locate(x, &v->entries[i]))
            return false;
    for (size_t p = 0; p < v->piece_count; p++)
        if (v->pieces[p].file == x->number && x->set == VTK_POLY && !join_cells(x, &v->pieces[p]))
            return false;
    return !x->has_time || read_time(x);
}

bool vtk_xml_read(struct vtk_volume *v, uint32_t number, struct vtk_xml_names *names,
                  struct sp_error *err) {
    const struct import_file *file = vtk_open_file(v, number, err);
    if (!file)
        return false;
    struct xml x = { .file = file,
                     .volume = v,
                     .names = names,
                     .number = number,
                     .err = err,
                     .parser = XML_ParserCreate("UTF-8"),
                     .home = -1,
                     .first_entry = v->entry_count };
    if (!x.parser)
        return sp_fail(err, SP_ERR_MEMORY, file->title, "out of memory while parsing XML");
    XML_SetUserData(x.parser, &x);
    XML_SetElementHandler(x.parser, start_element, end_element);
    XML_SetStartDoctypeDeclHandler(x.parser, start_doctype);
    const bool ok = parse(&x) && finish(&x);
    if (names && ok) {
        names->is_parallel = x.is_parallel;
        names->is_composite = x.is_composite;
    }
    XML_ParserFree(x.parser);
    return ok;
}
