/* SPDX-License-Identifier: Apache-2.0
 *
 * Legacy and XML VTK files. The parsers list pieces and arrays, and the rest is common to both:
 *
 *   vtk_legacy.c ─┐
 *   vtk_xml.c ────┼─► pieces, arrays ─► vtk_fields.c ─► vtk_grid.c ─► samples, vectors
 *   vtk_files.c ──┘      (vtk.c)          (choice)   └► vtk_points.c ─► points, mesh (vtk_mesh.c)
 *
 * vtk_files.c reads the lists of files of parallel and composite data sets.
 */
#ifndef SP_IMPORT_VTK_H
#define SP_IMPORT_VTK_H

#include "data/import/conversion.h"
#include "data/import/mesh_parts.h"
#include "data/import/vtk_array.h"

/* The data sets that a file may have. */
enum vtk_set { VTK_NO_SET, VTK_IMAGE, VTK_RECTILINEAR, VTK_STRUCTURED, VTK_UNSTRUCTURED, VTK_POLY };

/* True if the data set gives the position of each point. */
static inline bool vtk_has_points(enum vtk_set set) {
    return set >= VTK_STRUCTURED;
}

/* Cells of a data set of polygons. */

enum vtk_cell_kind { VTK_VERTS, VTK_LINES, VTK_POLYS, VTK_STRIPS, VTK_CELL_KINDS };

struct vtk_cells {
    uint64_t count;          /* 0 = none */
    struct vtk_array points; /* of all cells, one after another; count 0 = the last end */
    struct vtk_array ends;   /* where each cell ends; without a type: each begins with its count */
    bool starts_at_0;        /* the first end is preceded by a 0, where the first cell begins */
    uint64_t at;             /* byte of the file, for errors; 0 = not seen */
};

struct vtk_mesh {
    struct import_mesh_parts parts; /* owned */
};

/* The part of the data set that an array belongs to. */
enum vtk_home {
    VTK_OF_POINTS,
    VTK_OF_CELLS,
    VTK_COORDINATES, /* of a rectilinear grid along one axis */
    VTK_POSITIONS,   /* of points */
    VTK_CORNERS,     /* numbers of the points of cells */
    VTK_ENDS,        /* where each cell ends among its corners */
};

/* What the file says that an array is for; the greater, the rather it is read. */
enum vtk_role {
    VTK_IDS,
    VTK_ANY,
    VTK_SCALARS,
    VTK_VECTORS,
    VTK_NORMALS,
    VTK_COLORS,
    VTK_PARTS, /* the source wants components */
    VTK_RGB    /* the source wants colours */
};

struct vtk_entry {          /* an array of a piece */
    struct vtk_array array; /* the parsers leave its count 0 */
    enum vtk_home home;
    enum vtk_role role;
    unsigned part; /* of COORDINATES the axis; of CORNERS and ENDS enum vtk_cell_kind */
    unsigned components;
    bool is_appended; /* XML: `array.begin` counts from the appended data, until they are found */
    char name[SP_FIELD_BYTES];
};

struct vtk_piece {
    uint32_t file;    /* 0 = the file that was opened, or else of vtk_volume.files, + 1 */
    int32_t first[3]; /* index of the first point in the whole grid */
    uint32_t dims[3]; /* points; of a data set without a grid 0 */
    uint64_t count;   /* points */
    uint64_t kept;    /* points that are not ghosts, of a data set without a grid */
    struct vtk_cells cells[VTK_CELL_KINDS]; /* of a data set of polygons */
    size_t entries, entry_count;            /* in vtk_volume.entries */
};

struct vtk_image { /* the place of an image */
    double origin[3], spacing[3], direction[9];
};

struct vtk_choice {                /* the array that is read, in each piece */
    const struct vtk_entry *entry; /* of the first piece that has it; NULL = none */
    unsigned component;            /* of samples */
};

struct vtk_volume { /* a reader of either format */
    const struct import_file *file;
    enum vtk_set set;
    struct vtk_image image;
    uint64_t grid_at;      /* byte where the file describes the grid, for errors; 0 = not seen */
    const char *grid_name; /* the same */
    struct vtk_piece *pieces;
    size_t piece_count;
    struct vtk_entry *entries;
    size_t entry_count;
    char **files; /* names of other files, relative to the folder of `file`; owned */
    uint32_t file_count;
    char selected[2][2][SP_FIELD_BYTES]; /* by home and SAMPLES or VECTORS: what XML selects */
    double time;                         /* NAN = unknown */
    char cell_names[96];                 /* of arrays of cells that are not read: ", A, B" */
    struct import_list cells;            /* in cell_names */
    bool wants_cells;                    /* the source names one of these arrays */
    uint64_t cell_count;                 /* of an unstructured grid, unless each is a point */

    struct import_file other; /* the one of `files` that is open; fd −1 = none */
    uint32_t other_number;
    char other_real[PATH_MAX], other_folder[PATH_MAX];

    struct vtk_choice samples, vectors;
    bool may_be_colored, are_colored;    /* the points are drawn in the colours of `samples` */
    enum vtk_home home;                  /* of these: the grid has points or cells */
    struct import_conversion conversion; /* of samples */
    int32_t first[3];                    /* of all pieces: the first point, and … */
    uint32_t points[3];                  /* … how many; of samples: header.grid.dims */
    uint32_t dims[3];                    /* of the samples */
    bool has_gaps;                       /* the pieces do not fill the grid */
    double *positions[3];                /* owned; of a rectilinear grid */
    enum import_derived derived;         /* how values of points come from the vectors */
    struct vtk_mesh mesh;                /* of a data set of polygons */
};

enum { VTK_SAMPLES, VTK_VECTOR_FIELD }; /* the second index of `selected` */

/* vtk.c: pieces, arrays and files. */

void vtk_init(struct vtk_volume *v, const struct import_file *file);
void vtk_close(void *volume);

/* Append one; NULL with *err set if there are too many or no memory is left. An entry belongs to
 * the last piece. The pointers are valid until the next call. */
struct vtk_piece *vtk_add_piece(struct vtk_volume *v, uint32_t file, struct sp_error *err);
struct vtk_entry *vtk_add_entry(struct vtk_volume *v, enum vtk_home home, const char *name,
                                struct sp_error *err);

/* Adds the name of another file and returns its number; 0 with *err set on failure. */
uint32_t vtk_add_file(struct vtk_volume *v, const char *name, struct sp_error *err);

/* Returns the file of this number, open until the next call; NULL with *err set. */
const struct import_file *vtk_open_file(struct vtk_volume *v, uint32_t number,
                                        struct sp_error *err);

/* The array of a piece; NULL = it has none. */
struct vtk_entry *vtk_find_entry(const struct vtk_volume *v, const struct vtk_piece *piece,
                                 enum vtk_home home, unsigned part, const char *name);

/* True if the array marks points or cells that are copies from other pieces. */
bool vtk_is_ghosts(const struct vtk_entry *entry);

/* Once everything is parsed: chooses the fields, and completes and checks the header and sizes. */
bool vtk_complete(struct vtk_volume *v, struct import_header *header, struct sp_error *err);

/* read() and read_elements() of struct import_format. */
bool vtk_read(void *volume, void *voxels, float (*vectors)[3],
              const struct import_progress *progress, struct sp_error *err);
bool vtk_read_elements(void *volume, const struct sp_elements *elements,
                       const struct import_progress *progress, struct sp_error *err);

/* Notes an array of cells that is not read, because its data set has points of their own. */
void vtk_note_cells(struct vtk_volume *v, const char *name);

/* Warns that the cells of an unstructured grid are not drawn. */
void vtk_warn_of_cells(const struct vtk_volume *v, uint64_t count);

/* vtk_fields.c. */

/* Chooses samples and vectors, and lists the other fields. False with *err set if there is nothing
 * to show. */
bool vtk_choose(struct vtk_volume *v, struct import_header *header, struct sp_error *err);

bool vtk_is_color(const struct vtk_entry *entry);

/* vtk_grid.c. */

bool vtk_grid_open(struct vtk_volume *v, struct import_header *header, struct sp_error *err);

/* Joins the extents of all pieces to one grid: first, points, dims, has_gaps. */
bool vtk_grid_join(struct vtk_volume *v, struct sp_error *err);

/* vtk_points.c. */

bool vtk_points_open(struct vtk_volume *v, struct import_header *header, struct sp_error *err);

/* vtk_mesh.c: polygons become fans of triangles, strips become triangles, and lines become tubes. A
 * warning tells what is not drawn. */

/* True if there are polygons, strips or lines. */
bool vtk_mesh_is_there(const struct vtk_volume *volume);

/* Reads the cells of all pieces and describes the mesh. */
bool vtk_mesh_open(struct vtk_volume *volume, struct import_header *header, struct sp_error *err);

/* vtk_place.c: values of pieces on their way to their places. */

struct vtk_stream { /* one array of all pieces */
    struct vtk_choice choice;
    const struct import_conversion *conversion; /* NULL = tuples of three floats */
    char *out;                                  /* of all pieces */
    struct import_shift *shift;                 /* of positions; NULL = none */
    const struct import_progress *progress;     /* NULL = none */
};

/* Checks the sizes of the array in every piece that has it. */
bool vtk_stream_check(struct vtk_volume *v, const struct vtk_stream *stream, struct sp_error *err);

bool vtk_stream_read(struct vtk_volume *v, const struct vtk_stream *stream, struct sp_error *err);

/* Counts the points of each piece that are not ghosts. */
bool vtk_count_kept(struct vtk_volume *v, uint64_t *count, struct sp_error *err);

/* Warns of samples of a grid that the file hides: points, or cells. */
bool vtk_warn_of_hidden(struct vtk_volume *v, struct sp_error *err);

/* True if the pieces do not fill the grid. */
bool vtk_has_gaps(const struct vtk_volume *v);

#endif
