/* SPDX-License-Identifier: Apache-2.0
 *
 * Triangle meshes and lines: STL, OBJ and glTF. assimp reads them whole, from bytes in memory
 * (mesh_bridge.h). Its own steps that join vertices and find normals take four times as much memory
 * as mesh_builder.c. Lines become tubes.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/mman.h>
#include <unistd.h>

#include "data/import/confine.h"
#include "data/import/format.h"
#include "data/import/mesh_bridge.h"
#include "data/import/mesh_check.h"
#include "data/import/mesh_parts.h"
#include "data/import/mesh_text.h"
#include "data/import/module.h"

enum { FILES_MAX = 32 }; /* the file itself and the files that it names */

struct mesh {
    const struct import_file *file;
    const struct mesh_bridge_functions *call;
    struct mesh_bridge *bridge;
    int files;
    struct mesh_bytes bytes[FILES_MAX];
    struct import_mesh_parts parts;
    struct mesh_bridge_part part; /* that is being read */
    uint32_t *numbers;            /* of its vertices in `built`; UINT32_MAX = none yet */
};

static bool fail(struct sp_error *err, enum sp_code code, const struct mesh *m, const char *text) {
    return sp_fail(err, code, m->file->title, "%s", text);
}

static bool map_file(struct mesh *m, int fd, uint64_t size, struct mesh_bytes *bytes) {
    if (m->files == FILES_MAX || size == 0)
        return false;
    void *start = mmap(NULL, size, PROT_READ, MAP_PRIVATE, fd, 0);
    if (start == MAP_FAILED)
        return false;
    *bytes = m->bytes[m->files++] = (struct mesh_bytes){ start, size };
    return true;
}

/* Opens a file that the mesh names, below the root only. */
static bool find_file(void *user, const char *name, struct mesh_bytes *bytes) {
    struct mesh *m = user;
    char path[PATH_MAX], real[PATH_MAX];
    struct sp_error ignored;
    uint64_t size;
    const bool is_absolute = name[0] == '/';
    if (snprintf(path, sizeof path, "%s%s%s", is_absolute ? "" : m->file->folder,
                 is_absolute ? "" : "/", name) >= (int)sizeof path)
        return false;
    int fd = sp_open_confined(m->file->root, path, name, real, &size, &ignored);
    bool ok = fd >= 0 && map_file(m, fd, size, bytes);
    if (fd >= 0)
        close(fd);
    return ok;
}

static const char *extension_of(const char *name) {
    static const char *const known[] = { "stl", "obj", "gltf", "glb" };
    const char *dot = strrchr(name, '.');
    for (size_t i = 0; dot && i < sizeof known / sizeof *known; i++)
        if (strcasecmp(dot + 1, known[i]) == 0)
            return known[i];
    return NULL;
}

/* From linear light to sRGB. */
static float encode(float x) {
    return x <= 0.0031308f ? 12.92f * x : 1.055f * powf(x, 1 / 2.4f) - 0.055f;
}

static void set_color(const struct mesh_bridge_part *part, uint32_t vertex, float color[4]) {
    for (int c = 0; c < 4; c++) {
        color[c] = part->color[c] * (part->colors ? part->colors[vertex][c] : 1);
        if (part->is_linear && c < 3)
            color[c] = encode(color[c]);
    }
}

static bool add_triangle(void *user, const uint32_t vertices[3]) {
    struct mesh *m = user;
    uint32_t numbers[3];
    for (int k = 0; k < 3; k++) {
        uint32_t *number = &m->numbers[vertices[k]];
        if (*number == UINT32_MAX) {
            struct import_vertex v = { .normal = { 0, 0, 0 } };
            memcpy(v.position, m->part.positions[vertices[k]], sizeof v.position);
            if (m->part.normals)
                memcpy(v.normal, m->part.normals[vertices[k]], sizeof v.normal);
            set_color(&m->part, vertices[k], v.color);
            if (!import_mesh_vertex(&m->parts.built, &v, number))
                return false;
        }
        numbers[k] = *number;
    }
    return import_mesh_triangle(&m->parts.built, numbers);
}

static bool read_triangles(struct mesh *m, struct sp_error *err) {
    bool ok = true;
    for (unsigned n = 0; ok && m->call->part(m->bridge, n, &m->part); n++) {
        const size_t bytes = (m->part.vertices + (size_t)1) * sizeof *m->numbers;
        m->parts.has_colors |= m->part.has_colors;
        m->numbers = malloc(bytes);
        if (m->numbers)
            memset(m->numbers, 0xff, bytes);
        ok = m->numbers && m->call->triangles(m->bridge, n, add_triangle, m);
        free(m->numbers);
        m->numbers = NULL;
    }
    return ok || sp_fail(err, SP_ERR_MEMORY, m->file->title,
                         "out of memory, or more than %d vertices or triangles", SP_ELEMENTS_MAX);
}

static bool count_point(void *user, uint32_t vertex, bool begins) {
    struct mesh *m = user;
    (void)vertex;
    m->parts.points.count++;
    m->parts.points.lines += begins;
    return m->parts.points.count <= SP_ELEMENTS_MAX;
}

static bool add_point(void *user, uint32_t vertex, bool begins) {
    struct mesh *m = user;
    struct import_line_points *p = &m->parts.points;
    p->lines += begins;
    p->counts[p->lines - 1]++;
    memcpy(p->positions[p->count], m->part.positions[vertex], sizeof p->positions[0]);
    set_color(&m->part, vertex, p->colors[p->count]);
    p->count++;
    return true;
}

static bool walk_lines(struct mesh *m, bool (*add)(void *user, uint32_t vertex, bool begins)) {
    bool ok = true;
    m->parts.points.count = m->parts.points.lines = 0;
    for (unsigned n = 0; ok && m->call->part(m->bridge, n, &m->part); n++)
        ok = m->call->lines(m->bridge, n, add, m);
    return ok;
}

static bool read_lines(struct mesh *m, struct sp_error *err) {
    struct import_line_points *p = &m->parts.points;
    if (!walk_lines(m, count_point))
        return fail(err, SP_ERR_UNSUPPORTED, m,
                    "the lines have more than 2^31 - 1 points; save parts of them as files");
    if (!import_mesh_parts_alloc_lines(&m->parts, p->count, p->lines))
        return fail(err, SP_ERR_MEMORY, m, "out of memory");
    return walk_lines(m, add_point);
}

/* Copies what assimp has read, and lets it free its memory. */
static bool copy_mesh(struct mesh *m, struct sp_error *err) {
    if (!read_triangles(m, err) || !read_lines(m, err))
        return false;
    m->call->close(m->bridge);
    m->bridge = NULL;
    return import_mesh_finish(&m->parts.built) ||
           fail(err, SP_ERR_MEMORY, m, "out of memory for normals");
}

/* Why assimp has refused a file. True if the file is valid and only empty. */
static bool explain(const struct mesh *m, const char *extension, const struct mesh_bytes *bytes,
                    const struct sp_error *why, struct sp_error *err) {
    bool is_empty = false;
    if (strcmp(extension, "stl") == 0 && !import_stl_explain(m->file, bytes, &is_empty, err))
        return false;
    if (strcmp(extension, "obj") == 0 && !import_obj_explain(m->file, bytes, &is_empty, err))
        return false;
    return is_empty || fail(err, why->code, m, why->text);
}

/* Unmaps files from number `first` on. */
static void unmap(struct mesh *m, int first) {
    while (m->files > first) {
        m->files--;
        munmap((void *)(uintptr_t)m->bytes[m->files].start, m->bytes[m->files].size);
    }
}

/* Reads the triangles and lines by assimp. Text far from 0 is read once more, moved. */
static bool read_all(struct mesh *m, const char *extension, const struct mesh_bytes *bytes,
                     struct sp_error *err) {
    const struct mesh_word *word = import_mesh_text_word(extension, bytes);
    struct import_shift *shift = m->file->shift;
    struct mesh_bytes source = *bytes;
    struct sp_error why;
    char *text = NULL;
    m->call = import_module_load(m->file, MESH_BRIDGE_MODULE, MESH_BRIDGE_SYMBOL, "assimp",
                                 "libassimp5", err);
    bool ok = m->call != NULL;
    if (shift && word)
        shift->is_rounded = true; /* as far as assimp tells */
    while (ok) {
        m->bridge = m->call->open(&source, extension, find_file, m, &why);
        ok = m->bridge ? copy_mesh(m, err) : explain(m, extension, bytes, &why, err);
        if (!ok || !word || !import_mesh_parts_shift(&m->parts, shift))
            break;
        import_mesh_parts_free(&m->parts);
        unmap(m, 1);
        free(text);
        ok = import_mesh_text_move(bytes, word, shift, &text, &source) ||
             fail(err, SP_ERR_MEMORY, m, "out of memory to move the vertices near 0");
    }
    free(text);
    if (ok && !import_shift_is_there(shift))
        import_shift_warn_of_steps(m->file, m->parts.built.vertices,
                                   sizeof *m->parts.built.vertices, m->parts.built.vertex_count);
    return ok;
}

static bool open_mesh(void *reader, const struct import_file *file, struct import_header *header,
                      struct sp_error *err) {
    struct mesh *m = reader;
    m->file = file;
    const char *known = extension_of(m->file->title), *extension = known ? known : "glb";
    struct mesh_bytes bytes;
    bool is_empty = false;
    if (!map_file(m, m->file->fd, m->file->size, &bytes))
        return fail(err, SP_ERR_MEMORY, m, "out of memory for the bytes of the file");
    if (strcmp(extension, "stl") == 0
            ? !import_stl_check(m->file, &bytes, &is_empty, err)
            : extension[0] == 'g' && !import_gltf_check(m->file, &bytes, &is_empty, err))
        return false;
    if (!is_empty && !read_all(m, extension, &bytes, err))
        return false;
    return import_mesh_parts_describe(&m->parts, m->file, header, err);
}

static void close_mesh(void *reader) {
    struct mesh *m = reader;
    if (m->bridge)
        m->call->close(m->bridge);
    unmap(m, 0);
    import_mesh_parts_free(&m->parts);
}

static bool read_elements(void *reader, const struct sp_elements *elements,
                          const struct import_progress *progress, struct sp_error *err) {
    const struct mesh *m = reader;
    (void)progress; /* it takes no time */
    (void)err;
    import_mesh_parts_read(&m->parts, elements);
    return true;
}

static bool probe_mesh(const uint8_t *start, size_t size, const char *title) {
    return extension_of(title) || (size >= 4 && memcmp(start, "glTF", 4) == 0);
}

const struct import_format import_mesh = { .name = "meshes (.stl, .obj, .gltf, .glb)",
                                           .needs_module = true,
                                           .probe = probe_mesh,
                                           .reader_size = sizeof(struct mesh),
                                           .open = open_mesh,
                                           .read_elements = read_elements,
                                           .close = close_mesh };
