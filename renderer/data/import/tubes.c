/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/tubes.h"

#include <string.h>

#include "base/vec.h"

enum { SIDES = 8, CAP = SIDES - 2 };

void import_tubes_count(const struct import_lines *lines, uint64_t *vertices, uint64_t *triangles) {
    for (uint32_t i = 0; i < lines->count; i++) {
        const uint64_t points = lines->counts[i];
        if (points < 2)
            continue;
        *vertices += SIDES * points;
        *triangles += 2 * SIDES * (points - 1) + 2 * CAP;
    }
}

/* A ring: its axis along the line, and two directions across it. All of unit length. */
struct ring {
    struct sp_vec3 along, across[2];
};

static struct sp_vec3 point_at(const float p[3]) {
    return (struct sp_vec3){ { (double)p[0], (double)p[1], (double)p[2] } };
}

/* Turns the ring into a direction. One without length, or not finite, changes nothing. */
static void turn(struct ring *ring, struct sp_vec3 along) {
    const double length = sp_vec3_length(along);
    if (!(length > 0 && isfinite(length)))
        return;
    ring->along = sp_vec3_scale(along, 1 / length);
    for (int k = 0; k < 2; k++) { /* one of both is not along the line */
        const struct sp_vec3 old = ring->across[k];
        const struct sp_vec3 flat =
            sp_vec3_sub(old, sp_vec3_scale(ring->along, sp_vec3_dot(old, ring->along)));
        if (sp_vec3_length(flat) < 0.5)
            continue;
        ring->across[k] = sp_vec3_normalize(flat);
        ring->across[!k] = k ? sp_vec3_cross(ring->across[1], ring->along)
                             : sp_vec3_cross(ring->along, ring->across[0]);
        return;
    }
}

static void set_ring(const struct ring *ring, const float center[3], const float color[4],
                     double radius, const struct sp_elements *e, uint32_t vertex) {
    for (int s = 0; s < SIDES; s++) {
        const double angle = 2 * M_PI * s / SIDES;
        for (int a = 0; a < 3; a++) {
            const double n = cos(angle) * ring->across[0].v[a] + sin(angle) * ring->across[1].v[a];
            e->normals[vertex + (uint32_t)s][a] = (float)n;
            e->positions[vertex + (uint32_t)s][a] = (float)((double)center[a] + radius * n);
        }
        memcpy(e->colors[vertex + (uint32_t)s], color, 4 * sizeof *color);
    }
}

static uint32_t add_triangle(const struct sp_elements *e, uint32_t at, uint32_t a, uint32_t b,
                             uint32_t c) {
    e->triangles[at][0] = a;
    e->triangles[at][1] = b;
    e->triangles[at][2] = c;
    return at + 1;
}

/* The sides between the ring before `vertex` and the one from there on. */
static uint32_t add_sides(const struct sp_elements *e, uint32_t at, uint32_t vertex) {
    for (uint32_t s = 0; s < SIDES; s++) {
        const uint32_t next = s + 1 < SIDES ? s + 1 : 0, before = vertex - SIDES;
        at = add_triangle(e, at, before + s, before + next, vertex + next);
        at = add_triangle(e, at, before + s, vertex + next, vertex + s);
    }
    return at;
}

static uint32_t add_cap(const struct sp_elements *e, uint32_t at, uint32_t vertex) {
    for (uint32_t s = 1; s <= CAP; s++)
        at = add_triangle(e, at, vertex, vertex + s, vertex + s + 1);
    return at;
}

void import_tubes_fill(const struct import_lines *lines, double radius, const struct sp_elements *e,
                       uint32_t vertex, uint32_t triangle) {
    uint64_t first = 0;
    for (uint32_t i = 0; i < lines->count; first += lines->counts[i], i++) {
        const uint32_t points = lines->counts[i];
        struct ring ring = { { { 0, 0, 1 } }, { { { 1, 0, 0 } }, { { 0, 1, 0 } } } };
        if (points < 2)
            continue;
        triangle = add_cap(e, triangle, vertex);
        for (uint32_t k = 0; k < points; k++, vertex += SIDES) {
            const float(*p)[3] = lines->positions + first + k;
            const struct sp_vec3 from = point_at(p[k > 0 ? -1 : 0]);
            const struct sp_vec3 to = point_at(p[k + 1 < points ? 1 : 0]);
            turn(&ring, sp_vec3_sub(to, from));
            set_ring(&ring, p[0], lines->colors[first + k], radius, e, vertex);
            if (k > 0)
                triangle = add_sides(e, triangle, vertex);
        }
        triangle = add_cap(e, triangle, vertex - SIDES);
    }
}
