/* SPDX-License-Identifier: Apache-2.0
 *
 * A PLY file (Turk 1994): a header that lists elements and their properties, then the rows of each
 * element, as words or bytes.
 *
 *   ply_parse() ─► elements, properties ─► ply_rows_open("vertex") ─► ply_rows_next() …
 */
#ifndef SP_IMPORT_PLY_H
#define SP_IMPORT_PLY_H

#include "data/import/format.h"
#include "data/import/mesh_builder.h"

enum {
    PLY_NAME_BYTES = 64,
    PLY_ELEMENTS_MAX = 16,
    PLY_PROPERTIES_MAX = 512,
    PLY_LIST_MAX = 1 << 16 /* items of a list that is not skipped */
};

enum ply_form { PLY_WORDS, PLY_LITTLE, PLY_BIG };

struct ply_property {
    char name[PLY_NAME_BYTES];
    struct import_number number;
    struct import_number length; /* of a list; size 0 = not a list */
};

struct ply_element {
    char name[PLY_NAME_BYTES];
    uint64_t count;             /* rows, [0, 2^40] */
    unsigned first, properties; /* of struct ply */
    uint64_t least; /* bytes of a row without the items of its lists; PLY_WORDS: words */
    bool has_lists;
};

struct ply {
    const struct import_file *file;
    enum ply_form form;
    unsigned element_count, property_count;
    struct ply_element elements[PLY_ELEMENTS_MAX];
    struct ply_property properties[PLY_PROPERTIES_MAX];
    uint64_t begin; /* offset of the first row */
    /* Of a mesh without normals, from open() on; freed with the file. Empty: there was no memory
     * for it, and the normals are left to import_elements_finish(). */
    struct import_mesh_builder mesh;
};

/* Reads the header. Compares the size of the file with the counts, so that a wrong header is
 * refused before memory is allocated. */
bool ply_parse(struct ply *ply, const struct import_file *file, struct sp_error *err);

/* Finds an element by its name; NULL if there is none. */
const struct ply_element *ply_find(const struct ply *ply, const char *element);

/* Returns the number of a property in the rows of its element; -1 if there is none, or if it is a
 * list. `element` may be NULL. */
int ply_column(const struct ply *ply, const struct ply_element *element, const char *property);

/* Finds the columns of `count` properties; false with *err set if one is missing. */
bool ply_columns(const struct ply *ply, const struct ply_element *element,
                 const char *const *properties, unsigned count, int *columns, struct sp_error *err);

struct ply_rows; /* goes through the rows of one element */

/* Goes to the first row. The items of the list in column `list` are kept; -1 = of none. NULL with
 * *err set on failure. */
struct ply_rows *ply_rows_open(const struct ply *ply, const struct ply_element *element, int list,
                               struct sp_error *err);

/* Reads the next row and returns its numbers, of lists their lengths; NULL with *err set on
 * failure. There must be one. The numbers are valid until the next call. */
const double *ply_rows_next(struct ply_rows *rows, struct sp_error *err);

/* The items of the list that is kept, of the row that was read last. */
const double *ply_rows_items(const struct ply_rows *rows);

/* Warns if all rows of the last element were read and the file goes on. NULL does nothing. */
void ply_rows_close(struct ply_rows *rows);

/* What a PLY file may be. */
struct ply_content {
    bool (*matches)(const struct ply *ply);
    /* Calls import_header_use_elements(). */
    bool (*open)(struct ply *ply, struct import_header *header, struct sp_error *err);
    bool (*read)(const struct ply *ply, const struct sp_elements *elements,
                 const struct import_progress *progress, struct sp_error *err);
};

extern const struct ply_content ply_gaussians, ply_packed_gaussians, ply_points, ply_mesh;

/* Refuses more elements than a volume may have. */
bool ply_check_count(const struct ply *ply, const struct ply_element *element,
                     struct sp_error *err);

#endif
