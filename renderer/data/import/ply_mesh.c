/* SPDX-License-Identifier: Apache-2.0
 *
 * Meshes in PLY files: vertices and faces. A face of more than three vertices becomes a fan.
 */
#include <stdlib.h>
#include <string.h>

#include "data/import/number.h"
#include "data/import/ply.h"
#include "data/import/shift.h"

static const char *const position[] = { "x", "y", "z" };

/* The list of the vertices of a face. */
static int find_list(const struct ply *ply, const struct ply_element *face) {
    static const char *const names[] = { "vertex_indices", "vertex_index" };
    for (unsigned i = 0; face && i < face->properties; i++) {
        const struct ply_property *p = &ply->properties[face->first + i];
        for (size_t k = 0; k < sizeof names / sizeof *names; k++)
            if (p->length.size && strcmp(p->name, names[k]) == 0)
                return (int)i;
    }
    return -1;
}

static bool matches(const struct ply *ply) {
    const struct ply_element *face = ply_find(ply, "face");
    return face && ply_column(ply, ply_find(ply, "vertex"), "x") >= 0;
}

/* Where the faces go: to a builder, or to memory, or they are counted. */
struct faces {
    const struct ply *ply;
    uint64_t vertices;                 /* of the file */
    uint64_t triangles;                /* so far */
    struct import_mesh_builder *build; /* NULL = none */
    uint32_t *numbers;                 /* in `build`, of the file's vertices */
    uint32_t (*out)[3];                /* NULL = none */
    uint64_t capacity;                 /* of `out` */
    bool is_out_of_memory;             /* of `build` */
};

static bool fail_face(const struct ply *ply, uint64_t number, struct sp_error *err,
                      const char *text) {
    return import_fail(err, SP_ERR_FORMAT, ply->file->title, ply->begin, "face", "%s %llu", text,
                       (unsigned long long)number);
}

static bool add_face(struct faces *f, uint64_t number, const double *items, uint64_t count,
                     struct sp_error *err) {
    for (uint64_t i = 0; i < count; i++)
        if (!(items[i] >= 0 && items[i] < (double)f->vertices))
            return fail_face(f->ply, number, err, "a vertex number is not in the file, in face");
    for (uint64_t i = 2; i < count; i++, f->triangles++) {
        uint32_t corners[3] = { (uint32_t)items[0], (uint32_t)items[i - 1], (uint32_t)items[i] };
        if (f->out && f->triangles == f->capacity)
            return fail_face(f->ply, number, err,
                             "the file was changed while it was read, at face");
        if (f->out)
            memcpy(f->out[f->triangles], corners, sizeof corners);
        if (!f->build || f->is_out_of_memory)
            continue;
        for (int k = 0; k < 3; k++)
            corners[k] = f->numbers[corners[k]];
        f->is_out_of_memory = !import_mesh_triangle(f->build, corners);
    }
    return f->triangles <= SP_ELEMENTS_MAX ||
           fail_face(f->ply, number, err, "the mesh has too many triangles, from face");
}

static bool read_faces(struct faces *f, struct sp_error *err) {
    const struct ply_element *face = ply_find(f->ply, "face");
    const int list = find_list(f->ply, face);
    if (face->count == 0)
        return true;
    if (list < 0)
        return import_fail(err, SP_ERR_UNSUPPORTED, f->ply->file->title, f->ply->begin, "face",
                           "the faces have no list \"vertex_indices\"");
    struct ply_rows *rows = ply_rows_open(f->ply, face, list, err);
    bool ok = rows != NULL;
    for (uint64_t i = 0; ok && i < face->count; i++) {
        const double *row = ply_rows_next(rows, err);
        ok = row && add_face(f, i, ply_rows_items(rows), (uint64_t)row[list], err);
    }
    ply_rows_close(rows);
    return ok;
}

/* Columns of the attributes; -1 = the file has none. */
struct columns {
    int position[3], normal[3], color[4];
    double scale[4]; /* colours → [0, 1] */
};

static void fill_columns(const struct ply *ply, const struct ply_element *vertex,
                         struct columns *c) {
    static const char *const normals[] = { "nx", "ny", "nz" };
    static const char *const colors[2][4] = { { "red", "green", "blue", "alpha" },
                                              { "r", "g", "b", "a" } };
    for (int a = 0; a < 3; a++) {
        c->position[a] = ply_column(ply, vertex, position[a]);
        c->normal[a] = ply_column(ply, vertex, normals[a]);
    }
    for (int k = 0; k < 4; k++) {
        c->color[k] = ply_column(ply, vertex, colors[0][k]);
        if (c->color[k] < 0)
            c->color[k] = ply_column(ply, vertex, colors[1][k]);
        if (c->color[k] < 0)
            continue;
        c->scale[k] = import_number_color_scale(
            ply->properties[vertex->first + (unsigned)c->color[k]].number);
    }
}

static bool has_normals(const struct columns *c) {
    return c->normal[0] >= 0 && c->normal[1] >= 0 && c->normal[2] >= 0;
}

static bool has_colors(const struct columns *c) {
    return c->color[0] >= 0 || c->color[1] >= 0 || c->color[2] >= 0;
}

static void set_vertex(const struct columns *c, struct import_shift *shift, const double *row,
                       struct import_vertex *v) {
    for (int a = 0; a < 3; a++) {
        v->position[a] = import_shift_put(shift, a, row[c->position[a]]);
        v->normal[a] = has_normals(c) ? (float)row[c->normal[a]] : 0;
    }
    for (int k = 0; k < 4; k++)
        v->color[k] = c->color[k] >= 0 ? (float)(row[c->color[k]] * c->scale[k]) : k < 3 ? 0.8f : 1;
}

/* Passes the vertices to `take` until it fails. */
typedef bool visit_vertex(void *user, uint32_t number, const struct import_vertex *vertex);

static bool read_vertices(const struct ply *ply, uint32_t count, visit_vertex *visit, void *user,
                          const struct import_progress *progress, struct sp_error *err) {
    const struct ply_element *vertex = ply_find(ply, "vertex");
    struct columns columns;
    fill_columns(ply, vertex, &columns);
    struct ply_rows *rows = ply_rows_open(ply, vertex, -1, err);
    bool ok = rows != NULL;
    for (uint32_t i = 0; ok && i < count; i++) {
        const double *row = ply_rows_next(rows, err);
        struct import_vertex v;
        ok = row != NULL;
        if (ok) {
            set_vertex(&columns, ply->file->shift, row, &v);
            ok = visit(user, i, &v);
        }
        if (i % 4096 == 0)
            import_report(progress, (uint64_t)i * sizeof v.position);
    }
    ply_rows_close(rows);
    return ok;
}

static bool build_vertex(void *user, uint32_t number, const struct import_vertex *vertex) {
    const struct faces *f = user;
    return import_mesh_vertex(f->build, vertex, &f->numbers[number]);
}

/* Finds the normals, and splits edges, of a mesh that fits into memory. The faces have been read
 * once, so that errors can only be a lack of memory. */
static void build_mesh(struct ply *ply, uint32_t vertices) {
    uint32_t *numbers = malloc((vertices + (size_t)1) * sizeof *numbers);
    struct faces f = { .ply = ply, .vertices = vertices, .build = &ply->mesh, .numbers = numbers };
    bool ok = numbers && read_vertices(ply, vertices, build_vertex, &f, NULL, NULL);
    while (ok && import_mesh_shift(&ply->mesh, ply->file->shift)) {
        import_mesh_free(&ply->mesh);
        ok = read_vertices(ply, vertices, build_vertex, &f, NULL, NULL);
    }
    ok = ok && read_faces(&f, NULL) && !f.is_out_of_memory && import_mesh_finish(&ply->mesh);
    free(numbers);
    if (ok)
        return;
    import_mesh_free(&ply->mesh);
    import_warn(ply->file->warnings,
                "The mesh is shown without sharp edges: it is too large to find them. A file with "
                "normals needs less memory.");
}

static bool open_mesh(struct ply *ply, struct import_header *header, struct sp_error *err) {
    const struct ply_element *vertex = ply_find(ply, "vertex");
    struct faces f = { .ply = ply, .vertices = vertex->count };
    struct columns columns;
    int needed[3];
    if (!ply_columns(ply, vertex, position, 3, needed, err) || !ply_check_count(ply, vertex, err) ||
        !read_faces(&f, err))
        return false;
    struct sp_elements_shape shape = { .kind = SP_KIND_MESH,
                                       .count = (uint32_t)f.triangles,
                                       .vertex_count = (uint32_t)vertex->count };
    fill_columns(ply, vertex, &columns);
    shape.lacks_colors = !has_colors(&columns);
    header->has_normals = has_normals(&columns);
    if (!header->has_normals && shape.count)
        build_mesh(ply, shape.vertex_count);
    if (ply->mesh.triangle_count) {
        header->has_normals = true;
        shape.vertex_count = ply->mesh.vertex_count;
    }
    import_header_use_elements(header, &shape);
    return true;
}

static bool store_vertex(void *user, uint32_t number, const struct import_vertex *vertex) {
    const struct sp_elements *e = user;
    memcpy(e->positions[number], vertex->position, sizeof vertex->position);
    memcpy(e->normals[number], vertex->normal, sizeof vertex->normal);
    memcpy(e->colors[number], vertex->color, sizeof vertex->color);
    return true;
}

static bool read_mesh(const struct ply *ply, const struct sp_elements *e,
                      const struct import_progress *progress, struct sp_error *err) {
    const struct import_mesh_builder *b = &ply->mesh;
    struct faces f = { .ply = ply,
                       .vertices = ply_find(ply, "vertex")->count,
                       .out = e->triangles,
                       .capacity = e->shape.count };
    if (!b->triangle_count)
        return read_vertices(ply, e->shape.vertex_count, store_vertex, (void *)(uintptr_t)e,
                             progress, err) &&
               read_faces(&f, err);
    for (uint32_t i = 0; i < b->vertex_count; i++)
        store_vertex((void *)(uintptr_t)e, i, &b->vertices[i]);
    memcpy(e->triangles, b->triangles, b->triangle_count * sizeof *b->triangles);
    return true;
}

const struct ply_content ply_mesh = { matches, open_mesh, read_mesh };
