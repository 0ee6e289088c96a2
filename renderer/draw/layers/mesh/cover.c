/* SPDX-License-Identifier: Apache-2.0 */
#include <float.h>
#include <math.h>

#include "draw/layers/mesh/samples.h"

/* Some triangles in the tile. An edge is where a·x + b·y + c = 0, with x and y from the tile's
 * corner; a sample is inside where the sum exceeds `least`. Two triangles at an edge have opposite
 * numbers, to the bit: each sample beside it lies in one of them. */
struct triangles {
    float a[3][SP_WIDE], b[3][SP_WIDE], c[3][SP_WIDE], least[3][SP_WIDE];
    float slope[2][SP_WIDE], start[SP_WIDE];                  /* of 1/u2 */
    float low[SP_WIDE], high[SP_WIDE];                        /* bounds of the same */
    float x0[SP_WIDE], y0[SP_WIDE], x1[SP_WIDE], y1[SP_WIDE]; /* box, px, inclusive */
    int32_t number[SP_WIDE];                                  /* in the mesh */
    unsigned seen; /* bit k: the box and the area are not empty */
};

struct corners {
    sp_wide x[3], y[3], inverse[3];
};

static inline void read_corners(const struct sp_mesh *m, const struct sp_fragment_tile *tile,
                                const uint32_t *entries, int n, struct triangles *t,
                                struct corners *out) {
    const uint32_t count = m->elements->shape.count;
    float at[3][3][SP_WIDE] = { { { 0 } } };
    for (int i = 0; i < n; i++) {
        const uint32_t entry = entries[i];
        const bool is_piece = entry >= count;
        const struct sp_mesh_piece *piece = is_piece ? &m->pieces[entry - count] : NULL;
        const uint32_t number = is_piece ? piece->triangle : entry;
        const uint32_t *vertices = m->elements->triangles[number];
        t->number[i] = (int32_t)number;
        for (int k = 0; k < 3; k++) {
            const struct sp_mesh_place *p = is_piece ? &piece->corners[k] : &m->places[vertices[k]];
            at[0][k][i] = p->x;
            at[1][k][i] = p->y;
            at[2][k][i] = p->inverse;
        }
    }
    for (int k = 0; k < 3; k++) {
        out->x[k] = sp_wide_load(at[0][k]) - (float)tile->x;
        out->y[k] = sp_wide_load(at[1][k]) - (float)tile->y;
        out->inverse[k] = sp_wide_load(at[2][k]);
    }
}

static inline void set_up_edge(const struct corners *p, int i, sp_wide area, struct triangles *t) {
    const int k = i < 2 ? i + 1 : 0;
    const sp_wide zero = sp_wide_all(0);
    /* Both triangles at an edge take its ends in the same order. */
    sp_wide_mask turns = sp_wide_lt(p->x[k], p->x[i]) |
                         (sp_wide_eq(p->x[k], p->x[i]) & sp_wide_lt(p->y[k], p->y[i]));
    sp_wide x = sp_wide_select(turns, p->x[k], p->x[i]),
            y = sp_wide_select(turns, p->y[k], p->y[i]);
    sp_wide a = y - sp_wide_select(turns, p->y[i], p->y[k]);
    sp_wide b = sp_wide_select(turns, p->x[i], p->x[k]) - x;
    sp_wide c = -sp_wide_fma(a, x, b * y);
    sp_wide side = sp_wide_select(turns, -area, area);
    sp_wide_mask is_other = sp_wide_lt(side, zero);
    sp_wide_store(t->a[i], sp_wide_select(is_other, -a, a));
    sp_wide_store(t->b[i], sp_wide_select(is_other, -b, b));
    sp_wide_store(t->c[i], sp_wide_select(is_other, -c, c));
    sp_wide_store(t->least[i], sp_wide_select(is_other, zero, sp_wide_all(-FLT_MIN)));
}

/* The pixels between the ends of an axis, in the tile and the image. */
static inline sp_wide_mask bound_pixels(const sp_wide p[3], int size, float *first, float *last) {
    const sp_wide end = sp_wide_all((float)(size < SP_FRAGMENT_TILE ? size : SP_FRAGMENT_TILE) - 1);
    sp_wide low = sp_wide_floor(sp_wide_min(sp_wide_min(p[0], p[1]), p[2]));
    sp_wide high = sp_wide_floor(sp_wide_max(sp_wide_max(p[0], p[1]), p[2]));
    low = sp_wide_max(low, sp_wide_all(0));
    high = sp_wide_min(high, end);
    sp_wide_store(first, low);
    sp_wide_store(last, high);
    return sp_wide_le(low, high);
}

static inline void set_up(const struct sp_mesh *m, const struct sp_fragment_tile *tile,
                          const uint32_t *entries, int n, struct triangles *t) {
    struct corners p;
    read_corners(m, tile, entries, n, t, &p);
    const sp_wide *x = p.x, *y = p.y, *q = p.inverse;
    sp_wide area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
    sp_wide_mask seen = sp_wide_first(n) & sp_wide_lt(sp_wide_all(0), sp_wide_abs(area));
    seen = seen & bound_pixels(x, m->size[0] - tile->x, t->x0, t->x1);
    seen = seen & bound_pixels(y, m->size[1] - tile->y, t->y0, t->y1);
    t->seen = sp_wide_mask_bits(seen);
    if (!t->seen)
        return;
    for (int i = 0; i < 3; i++)
        set_up_edge(&p, i, area, t);
    sp_wide scale = 1 / area, q1 = (q[1] - q[0]) * scale, q2 = (q[2] - q[0]) * scale;
    sp_wide along = q1 * (y[2] - y[0]) - q2 * (y[1] - y[0]);
    sp_wide down = q2 * (x[1] - x[0]) - q1 * (x[2] - x[0]);
    sp_wide_store(t->slope[0], along);
    sp_wide_store(t->slope[1], down);
    sp_wide_store(t->start, q[0] - along * x[0] - down * y[0]);
    sp_wide_store(t->low, sp_wide_min(sp_wide_min(q[0], q[1]), q[2]));
    sp_wide_store(t->high, sp_wide_max(sp_wide_max(q[0], q[1]), q[2]));
}

/* Samples that the half-spaces of the mesh keep. */
static inline sp_wide_mask keep(const struct sp_mesh *m, sp_wide x, sp_wide y, sp_wide inverse,
                                sp_wide_mask inside) {
    for (uint32_t i = 0; i < m->half_count; i++) {
        const struct sp_mesh_half *h = &m->halves[i];
        inside = inside & sp_wide_le(sp_wide_all(0), h->a * x + h->b * y + h->c + h->d * inverse);
    }
    return inside;
}

/* What add_triangle() needs beside the triangle. */
struct cover {
    const struct sp_mesh *mesh;
    const struct sp_mesh_sheet *before;
    struct sp_mesh_sheet *sheet;
    sp_wide dx[SP_MESH_VECTORS], dy[SP_MESH_VECTORS];
    float x, y; /* of the tile's corner */
    bool is_hit;
};

static inline void add_samples(struct cover *c, int32_t triangle, int x, int y, int v,
                               sp_wide_mask inside, sp_wide inverse) {
    const int at = (y * SP_FRAGMENT_TILE + x) * SP_MESH_SAMPLES + v * SP_WIDE;
    const sp_wide_int number = sp_wide_int_all(triangle);
    float *nearest = c->sheet->inverse + at;
    sp_wide had = sp_wide_load(nearest);
    inside = inside & sp_wide_lt(had, inverse);
    if (c->before) {
        /* Triangles at the same depth follow each other in their order. */
        sp_wide last = sp_wide_load(c->before->inverse + at);
        sp_wide_int before = sp_wide_int_load(c->before->triangle + at);
        inside = inside & (sp_wide_lt(inverse, last) |
                           (sp_wide_eq(inverse, last) & sp_wide_int_lt(before, number)));
    }
    if (c->mesh->half_count)
        inside = keep(c->mesh, c->x + (float)x + 0.5f + c->dx[v], c->y + (float)y + 0.5f + c->dy[v],
                      inverse, inside);
    const bool is_hit = sp_wide_any(inside);
    if (SP_MESH_VECTORS > 1 && !is_hit)
        return;
    int32_t *triangles = c->sheet->triangle + at;
    sp_wide numbers = (sp_wide)sp_wide_int_load(triangles);
    sp_wide_store(nearest, sp_wide_select(inside, inverse, had));
    sp_wide_int_store(triangles, (sp_wide_int)sp_wide_select(inside, (sp_wide)number, numbers));
    c->is_hit |= is_hit;
}

static inline void add_triangle(struct cover *c, const struct triangles *t, int k) {
    sp_wide edge[3][SP_MESH_VECTORS], depth[SP_MESH_VECTORS], least[3];
    const sp_wide low = sp_wide_all(t->low[k]), high = sp_wide_all(t->high[k]);
    const float along = t->slope[0][k], down = t->slope[1][k];
    const int32_t number = t->number[k];
    float reach[3], ea[3], eb[3], ec[3];
    for (int i = 0; i < 3; i++) {
        ea[i] = t->a[i][k];
        eb[i] = t->b[i][k];
        ec[i] = t->c[i][k];
        reach[i] = -0.5f * (fabsf(ea[i]) + fabsf(eb[i]));
        least[i] = sp_wide_all(t->least[i][k]);
        for (int v = 0; v < SP_MESH_VECTORS; v++)
            edge[i][v] = sp_wide_fma(sp_wide_all(eb[i]), c->dy[v], ea[i] * c->dx[v]);
    }
    for (int v = 0; v < SP_MESH_VECTORS; v++)
        depth[v] = along * c->dx[v] + down * c->dy[v] + t->start[k];
    const int x0 = (int)t->x0[k], x1 = (int)t->x1[k], y1 = (int)t->y1[k];
    for (int y = (int)t->y0[k]; y <= y1; y++)
        for (int x = x0; x <= x1; x++) {
            const float px = (float)x + 0.5f, py = (float)y + 0.5f;
            const float e0 = ec[0] + ea[0] * px + eb[0] * py;
            const float e1 = ec[1] + ea[1] * px + eb[1] * py;
            const float e2 = ec[2] + ea[2] * px + eb[2] * py;
            /* One vector takes as long as this test. */
            if (SP_MESH_VECTORS > 1 && ((e0 < reach[0]) | (e1 < reach[1]) | (e2 < reach[2])))
                continue;
            const float q = along * px + down * py;
            for (int v = 0; v < SP_MESH_VECTORS; v++) {
                sp_wide_mask inside = sp_wide_lt(least[0], edge[0][v] + e0) &
                                      sp_wide_lt(least[1], edge[1][v] + e1) &
                                      sp_wide_lt(least[2], edge[2][v] + e2);
                add_samples(c, number, x, y, v, inside,
                            sp_wide_max(sp_wide_min(depth[v] + q, high), low));
            }
        }
}

bool sp_mesh_cover(const struct sp_mesh *mesh, const struct sp_fragment_tile *tile,
                   const struct sp_mesh_sheet *before, struct sp_mesh_sheet *sheet) {
    const int number = tile->y / SP_FRAGMENT_TILE * mesh->columns + tile->x / SP_FRAGMENT_TILE;
    const uint32_t end = mesh->first[number + 1];
    struct cover c = {
        .mesh = mesh, .before = before, .sheet = sheet, .x = (float)tile->x, .y = (float)tile->y
    };
    for (int v = 0; v < SP_MESH_VECTORS; v++) {
        c.dx[v] = sp_wide_load(sp_mesh_dx + v * SP_WIDE);
        c.dy[v] = sp_wide_load(sp_mesh_dy + v * SP_WIDE);
    }
    for (int i = 0; i < SP_FRAGMENT_PIXELS * SP_MESH_SAMPLES; i++) {
        sheet->inverse[i] = -INFINITY;
        sheet->triangle[i] = SP_MESH_NONE;
    }
    for (uint32_t i = mesh->first[number]; i < end; i += SP_WIDE) {
        struct triangles t;
        set_up(mesh, tile, mesh->entries + i, end - i < SP_WIDE ? (int)(end - i) : SP_WIDE, &t);
        for (unsigned seen = t.seen; seen; seen &= seen - 1)
            add_triangle(&c, &t, __builtin_ctz(seen));
    }
    return c.is_hit;
}
