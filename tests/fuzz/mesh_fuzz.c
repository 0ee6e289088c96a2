/* SPDX-License-Identifier: Apache-2.0
 *
 * What a reader may make of a file: vertices, triangles and lines of any numbers become a mesh. And
 * what is looked at before assimp reads a file.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/mesh_builder.h"
#include "data/import/mesh_check.h"
#include "data/import/mesh_text.h"
#include "data/import/tubes.h"

enum { POINTS_MAX = 24 };

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Vertices that are few, so that many are equal, and of extreme size. */
static void make_vertex(uint8_t byte, struct import_vertex *vertex) {
    static const float numbers[] = { 0, 1, -0.0f, NAN, INFINITY, 1e30f, 1e-30f, 2 };
    for (int a = 0; a < 3; a++) {
        vertex->position[a] = numbers[byte >> (a + 2) & 7];
        vertex->normal[a] = byte & 1 ? numbers[byte >> (a + 1) & 7] : 0;
    }
    for (int c = 0; c < 4; c++)
        vertex->color[c] = numbers[byte & 7];
}

static void add(struct import_mesh_builder *builder, const uint8_t *data, size_t size) {
    uint32_t numbers[3];
    for (size_t i = 0; i + 3 <= size; i += 3) {
        for (size_t k = 0; k < 3; k++) {
            struct import_vertex vertex;
            make_vertex(data[i + k], &vertex);
            if (!import_mesh_vertex(builder, &vertex, &numbers[k]))
                abort();
        }
        if (!import_mesh_triangle(builder, numbers))
            abort();
    }
    if (!import_mesh_finish(builder))
        abort();
    for (uint32_t t = 0; t < builder->triangle_count; t++)
        for (int k = 0; k < 3; k++)
            if (builder->triangles[t][k] >= builder->vertex_count)
                abort();
}

static void draw_lines(const uint8_t *data, size_t size) {
    float positions[POINTS_MAX][3], colors[POINTS_MAX][4];
    uint32_t counts[POINTS_MAX], points = 0, lines = 0;
    uint64_t vertices = 0, triangles = 0;
    for (size_t i = 0; i < size && points < POINTS_MAX; i++, points++) {
        struct import_vertex vertex;
        make_vertex(data[i], &vertex);
        memcpy(positions[points], vertex.position, sizeof positions[0]);
        memcpy(colors[points], vertex.color, sizeof colors[0]);
        if (i == 0 || data[i] % 5 == 0)
            counts[lines++] = 0;
        counts[lines - 1]++;
    }
    const struct import_lines all = { lines, counts, (const float(*)[3])positions,
                                      (const float(*)[4])colors };
    import_tubes_count(&all, &vertices, &triangles);
    struct sp_elements e = { .positions = malloc(vertices * sizeof *e.positions),
                             .normals = malloc(vertices * sizeof *e.normals),
                             .colors = malloc(vertices * sizeof *e.colors),
                             .triangles = malloc(triangles * sizeof *e.triangles) };
    import_tubes_fill(&all, 0.5, &e, 0, 0);
    for (uint64_t t = 0; t < triangles; t++)
        for (int k = 0; k < 3; k++)
            if (e.triangles[t][k] >= vertices)
                abort();
    free(e.positions);
    free(e.normals);
    free(e.colors);
    free(e.triangles);
}

static void check(const uint8_t *data, size_t size) {
    const struct import_file file = { .title = "input" };
    struct mesh_bytes bytes = { data, size };
    bool is_empty;
    struct sp_error err;
    if (import_stl_check(&file, &bytes, &is_empty, &err) && bytes.size > size)
        abort();
    import_stl_explain(&file, &bytes, &is_empty, &err);
    import_obj_explain(&file, &bytes, &is_empty, &err);
    import_gltf_check(&file, &(struct mesh_bytes){ data, size }, &is_empty, &err);
}

static void move(const uint8_t *data, size_t size, const char *extension) {
    struct import_shift shift = { .offset = { 1e6, -1e300, 0.1 } };
    const struct mesh_bytes bytes = { data, size };
    const struct mesh_word *word = import_mesh_text_word(extension, &bytes);
    struct mesh_bytes moved;
    char *text = NULL;
    if (word && !import_mesh_text_move(&bytes, word, &shift, &text, &moved))
        abort();
    free(text);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    check(data, size);
    move(data, size, "obj");
    move(data, size, "stl");
    struct import_mesh_builder builder = { .vertices = NULL };
    add(&builder, data, size);
    import_mesh_free(&builder);
    draw_lines(data, size);
    return 0;
}
