/* SPDX-License-Identifier: Apache-2.0
 *
 * Why this parser is our own: parsers.md.
 */
#include "data/import/mesh_builder.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/grow.h"
#include "base/vec.h"
#include "sp/elements.h"

enum {
    TABLE_MIN = 4096,
    CORNERS_MAX = 64 /* at vertices with more triangles, all of them are one surface */
};

static uint32_t hash(const struct import_vertex *vertex) {
    uint32_t words[sizeof *vertex / 4], sum = 0;
    memcpy(words, vertex, sizeof words);
    for (size_t i = 0; i < sizeof words / sizeof *words; i++) {
        sum = (sum ^ words[i]) * 0x9e3779b1u;
        sum ^= sum >> 15;
    }
    return sum;
}

/* The place in the table of a vertex, or where it would go. */
static uint32_t *find_slot(const struct import_mesh_builder *b,
                           const struct import_vertex *vertex) {
    uint32_t at = hash(vertex) & (b->table_size - 1);
    while (b->table[at] && memcmp(&b->vertices[b->table[at] - 1], vertex, sizeof *vertex) != 0)
        at = (at + 1) & (b->table_size - 1);
    return &b->table[at];
}

/* Keeps the table at most half full. */
static bool grow_table(struct import_mesh_builder *b) {
    if (b->table && b->vertex_count < b->table_size / 2)
        return true;
    const uint32_t size = b->table ? 2 * b->table_size : TABLE_MIN;
    uint32_t *table = calloc(size, sizeof *table);
    if (!table)
        return false;
    free(b->table);
    b->table = table;
    b->table_size = size;
    for (uint32_t i = 0; i < b->vertex_count; i++)
        *find_slot(b, &b->vertices[i]) = i + 1;
    return true;
}

static bool append(struct import_mesh_builder *b, const struct import_vertex *vertex) {
    if (b->vertex_count >= SP_ELEMENTS_MAX ||
        !sp_grow(&b->vertices, b->vertex_count, sizeof *b->vertices))
        return false;
    b->vertices[b->vertex_count++] = *vertex;
    return true;
}

bool import_mesh_vertex(struct import_mesh_builder *b, const struct import_vertex *vertex,
                        uint32_t *number) {
    struct import_vertex wanted = *vertex;
    for (int a = 0; a < 3; a++) { /* −0 is 0 */
        wanted.position[a] += 0.0f;
        wanted.normal[a] += 0.0f;
    }
    if (!grow_table(b))
        return false;
    uint32_t *place = find_slot(b, &wanted);
    if (!*place) {
        if (!append(b, &wanted))
            return false;
        *place = b->vertex_count;
    }
    *number = *place - 1;
    return true;
}

bool import_mesh_shift(const struct import_mesh_builder *b, struct import_shift *shift) {
    return b->vertex_count &&
           import_shift_choose(shift, b->vertices, sizeof *b->vertices, b->vertex_count);
}

bool import_mesh_triangle(struct import_mesh_builder *b, const uint32_t vertices[3]) {
    if (b->triangle_count >= SP_ELEMENTS_MAX ||
        !sp_grow(&b->triangles, b->triangle_count, sizeof *b->triangles))
        return false;
    memcpy(b->triangles[b->triangle_count++], vertices, sizeof *b->triangles);
    return true;
}

/* The normal of a triangle, as long as twice its area. */
static struct sp_vec3 normal_of(const struct import_mesh_builder *b, const uint32_t at[3]) {
    struct sp_vec3 e[2];
    for (int k = 0; k < 2; k++)
        for (int a = 0; a < 3; a++)
            e[k].v[a] =
                (double)b->vertices[at[k + 1]].position[a] - (double)b->vertices[at[0]].position[a];
    return sp_vec3_cross(e[0], e[1]);
}

/* The corners of triangles at each vertex: 3 · triangle + corner. */
struct corners {
    uint32_t *first; /* [vertices + 1] */
    uint32_t *list;
};

static bool list_corners(const struct import_mesh_builder *b, struct corners *c) {
    const size_t count = 3 * (size_t)b->triangle_count;
    c->first = calloc((size_t)b->vertex_count + 2, sizeof *c->first);
    c->list = malloc((count + 1) * sizeof *c->list);
    if (!c->first || !c->list)
        return false;
    for (size_t i = 0; i < count; i++)
        c->first[b->triangles[i / 3][i % 3] + 2]++;
    for (uint32_t v = 0; v < b->vertex_count; v++)
        c->first[v + 2] += c->first[v + 1];
    for (size_t i = 0; i < count; i++)
        c->list[c->first[b->triangles[i / 3][i % 3] + 1]++] = (uint32_t)i;
    return true;
}

static void set_normal(struct import_vertex *vertex, struct sp_vec3 normal) {
    const struct sp_vec3 unit = sp_vec3_normalize(normal);
    for (int a = 0; a < 3; a++)
        vertex->normal[a] = (float)unit.v[a];
}

/* Sums the normals at a vertex that differ little from one of them, which has a length. */
static struct sp_vec3 sum_near(const struct sp_vec3 *normals, uint32_t count, uint32_t one) {
    const double least = cos(IMPORT_SMOOTH_DEGREES * M_PI / 180);
    struct sp_vec3 sum = { { 0, 0, 0 } };
    for (uint32_t i = 0; i < count; i++) {
        const double along = sp_vec3_dot(normals[i], normals[one]);
        const double lengths = sp_vec3_length(normals[i]) * sp_vec3_length(normals[one]);
        if (i == one || along >= least * lengths)
            sum = sp_vec3_add(sum, normals[i]);
    }
    return sum;
}

/* Gives a vertex its normal. Where surfaces meet at an edge, each gets a vertex of its own. */
static bool split(struct import_mesh_builder *b, uint32_t v, const uint32_t *corners,
                  uint32_t count) {
    struct sp_vec3 normals[CORNERS_MAX], sums[CORNERS_MAX];
    uint32_t vertices[CORNERS_MAX], groups = 0;
    for (uint32_t i = 0; i < count; i++)
        normals[i] = normal_of(b, b->triangles[corners[i] / 3]);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t g = 0;
        if (!(sp_vec3_length(normals[i]) > 0)) /* no area: it may have any vertex */
            continue;
        const struct sp_vec3 sum = sum_near(normals, count, i);
        while (g < groups && memcmp(&sums[g], &sum, sizeof sum) != 0)
            g++;
        if (g == groups) {
            struct import_vertex vertex = b->vertices[v];
            vertices[g] = g ? b->vertex_count : v;
            sums[groups++] = sum;
            set_normal(&vertex, sum);
            if (g == 0)
                b->vertices[v] = vertex;
            else if (!append(b, &vertex))
                return false;
        }
        b->triangles[corners[i] / 3][corners[i] % 3] = vertices[g];
    }
    return true;
}

static bool compute_normal(struct import_mesh_builder *b, uint32_t v, const uint32_t *corners,
                           uint32_t count) {
    struct sp_vec3 sum = { { 0, 0, 0 } };
    if (count <= CORNERS_MAX)
        return split(b, v, corners, count);
    for (uint32_t i = 0; i < count; i++)
        sum = sp_vec3_add(sum, normal_of(b, b->triangles[corners[i] / 3]));
    set_normal(&b->vertices[v], sum);
    return true;
}

static bool has_normal(const struct import_vertex *vertex) {
    return vertex->normal[0] != 0 || vertex->normal[1] != 0 || vertex->normal[2] != 0;
}

bool import_mesh_finish(struct import_mesh_builder *b) {
    struct corners corners = { NULL, NULL };
    const uint32_t count = b->vertex_count;
    uint32_t first = 0;
    free(b->table);
    b->table = NULL;
    while (first < count && has_normal(&b->vertices[first]))
        first++;
    bool ok = first == count || list_corners(b, &corners);
    for (uint32_t v = first; ok && v < count; v++)
        if (!has_normal(&b->vertices[v]))
            ok = compute_normal(b, v, corners.list + corners.first[v],
                                corners.first[v + 1] - corners.first[v]);
    free(corners.first);
    free(corners.list);
    return ok;
}

void import_mesh_free(struct import_mesh_builder *b) {
    free(b->vertices);
    free(b->triangles);
    free(b->table);
    *b = (struct import_mesh_builder){ .vertices = NULL };
}
