/* SPDX-License-Identifier: Apache-2.0 */
#include "data/volume/elements.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdlib.h>

const char *sp_kind_name(enum sp_kind kind) {
    static const char *const names[SP_KIND_COUNT] = { "grid", "points", "gaussians", "mesh" };
    assert(kind < SP_KIND_COUNT);
    return names[kind];
}

const char *sp_elements_shape_problem(const struct sp_elements_shape *shape) {
    if (shape->kind >= SP_KIND_COUNT)
        return "unknown kind of elements";
    if (shape->kind == SP_KIND_GRID)
        return shape->count || shape->vertex_count || shape->degree || shape->has_vectors ||
                       shape->lacks_colors
                   ? "a grid with elements"
                   : NULL;
    if (shape->count > SP_ELEMENTS_MAX || shape->vertex_count > SP_ELEMENTS_MAX)
        return "too many elements";
    if (shape->kind != SP_KIND_MESH && shape->vertex_count)
        return "vertices without a mesh";
    if (shape->kind == SP_KIND_MESH && shape->count && !shape->vertex_count)
        return "triangles without vertices";
    if (shape->has_vectors && shape->kind != SP_KIND_POINTS)
        return "vectors without points";
    if (shape->lacks_colors && shape->kind != SP_KIND_MESH)
        return "a lack of colours without a mesh";
    if (shape->degree > (shape->kind == SP_KIND_GAUSSIANS ? SP_HARMONICS_DEGREE_MAX : 0))
        return "spherical harmonics of an unknown degree";
    return NULL;
}

/* Takes an array of `count` items from the memory; NULL memory only counts bytes. */
static void *carve(char *memory, uint64_t *at, uint64_t count, size_t item) {
    const uint64_t line = 64;
    void *array = memory ? memory + *at : NULL;
    *at += (count * item + line - 1) / line * line;
    return array;
}

static struct sp_elements lay_out(const struct sp_elements_shape *shape, char *memory,
                                  uint64_t *at) {
    struct sp_elements e = { .shape = *shape };
    const uint64_t n = shape->count, vertices = shape->vertex_count;
    const bool is_mesh = shape->kind == SP_KIND_MESH;
    *at = 0;
    (void)carve(memory, at, 1, sizeof(float)); /* the sample */
    e.positions = carve(memory, at, is_mesh ? vertices : n, sizeof *e.positions);
    if (is_mesh) {
        e.normals = carve(memory, at, vertices, sizeof *e.normals);
        e.colors = carve(memory, at, vertices, sizeof *e.colors);
        e.triangles = carve(memory, at, n, sizeof *e.triangles);
        return e;
    }
    e.factors = carve(memory, at, n, sizeof *e.factors);
    if (shape->kind == SP_KIND_POINTS) {
        e.values = carve(memory, at, n, sizeof *e.values);
        e.volumes = carve(memory, at, n, sizeof *e.volumes);
        if (shape->has_vectors)
            e.vectors = carve(memory, at, n, sizeof *e.vectors);
    } else {
        e.opacities = carve(memory, at, n, sizeof *e.opacities);
        e.harmonics = carve(memory, at, n, 3 * sizeof(float) * sp_harmonics_count(shape->degree));
    }
    return e;
}

uint64_t sp_elements_bytes(const struct sp_elements_shape *shape) {
    uint64_t bytes;
    (void)lay_out(shape, NULL, &bytes);
    return bytes;
}

struct sp_elements sp_elements_at(const struct sp_elements_shape *shape, void *memory) {
    uint64_t bytes;
    return lay_out(shape, memory, &bytes);
}

bool sp_elements_are_sound(const struct sp_elements *e) {
    uint32_t largest = 0;
    for (uint32_t i = 0; e->triangles && i < e->shape.count; i++)
        for (int k = 0; k < 3; k++)
            largest = e->triangles[i][k] > largest ? e->triangles[i][k] : largest;
    return !e->triangles || !e->shape.count || largest < e->shape.vertex_count;
}

/* True for a place that a camera can look at (SP_POSITION_MAX). */
static bool is_near(const float p[3]) {
    const float most = 1e15f;
    return fabsf(p[0]) < most && fabsf(p[1]) < most && fabsf(p[2]) < most;
}

void sp_elements_grid(const struct sp_elements *e, struct sp_grid *grid) {
    double low[3] = { INFINITY, INFINITY, INFINITY }, high[3] = { -INFINITY, -INFINITY, -INFINITY };
    const uint32_t n = e->shape.kind == SP_KIND_MESH ? e->shape.vertex_count : e->shape.count;
    for (uint32_t i = 0; i < n; i++) {
        if (!is_near(e->positions[i]))
            continue;
        for (int a = 0; a < 3; a++) {
            low[a] = fmin(low[a], e->positions[i][a]);
            high[a] = fmax(high[a], e->positions[i][a]);
        }
    }
    double longest = 0;
    for (int a = 0; a < 3; a++)
        longest = fmax(longest, high[a] - low[a]);
    const double least = longest > 0 ? 1e-3 * longest : 1;
    *grid = (struct sp_grid){ .dims = { 1, 1, 1 } };
    for (int a = 0; a < 3; a++) {
        bool is_empty = !(low[a] <= high[a]);
        grid->spacing[a] = fmax(is_empty ? 0 : high[a] - low[a], least);
        grid->origin[a] = is_empty ? 0 : 0.5 * (low[a] + high[a]);
        grid->direction[a][a] = 1;
    }
}

double sp_elements_tail(enum sp_kind kind) {
    static const double tails[SP_KIND_COUNT] = {
        [SP_KIND_POINTS] = 0.002, [SP_KIND_GAUSSIANS] = 0.03
    };
    return tails[kind];
}

bool sp_elements_counts(const struct sp_elements *e, uint32_t i) {
    const float faint = 0.1f;
    return is_near(e->positions[i]) && (!e->values || isfinite(e->values[i])) &&
           (!e->opacities || e->opacities[i] > faint);
}

static int compare(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

enum {
    SAMPLES = 4096, /* elements that decide about the typical size */
    PLACES = 1 << 16
};

bool sp_elements_core(const struct sp_elements *e, double low[3], double high[3]) {
    const uint32_t n = e->shape.kind == SP_KIND_MESH ? e->shape.vertex_count : e->shape.count;
    const uint32_t step = n / PLACES + 1;
    size_t taken = 0;
    float *places = malloc(PLACES * sizeof *places);
    for (int a = 0; places && a < 3; a++) {
        taken = 0;
        for (uint32_t i = 0; i < n; i += step)
            if (sp_elements_counts(e, i))
                places[taken++] = e->positions[i][a];
        if (!taken)
            break;
        qsort(places, taken, sizeof *places, compare);
        size_t cut = (size_t)(sp_elements_tail(e->shape.kind) * (double)taken);
        low[a] = (double)places[cut];
        high[a] = (double)places[taken - 1 - cut];
    }
    free(places);
    return taken > 0;
}

double sp_elements_spacing(const struct sp_elements *e, const struct sp_grid *grid) {
    double sum = 0, diameter = 0;
    uint32_t counted = 0, step = e->shape.count / SAMPLES + 1;
    for (int a = 0; a < 3; a++)
        diameter += grid->spacing[a] * grid->spacing[a];
    diameter = sqrt(diameter);
    for (uint32_t i = 0; e->factors && i < e->shape.count; i += step) {
        const float *l = e->factors[i];
        double volume = e->volumes ? e->volumes[i] : fabs((double)l[0] * l[2] * l[5]);
        /* Elements that are not drawn have the smallest volume, or none. */
        if (!(volume > (double)FLT_MIN) || !isfinite(volume) || !sp_elements_counts(e, i))
            continue;
        sum += log(volume);
        counted++;
    }
    double spacing = counted ? exp(sum / counted / 3) : 0;
    return spacing > 1e-9 * diameter ? fmin(spacing, diameter) : 1e-3 * diameter;
}
