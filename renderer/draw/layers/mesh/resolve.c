/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "draw/layers/mesh/samples.h"

enum {
    ALL = (1 << SP_MESH_SAMPLES) - 1,
    SHADED = 4 /* triangles per pixel and sheet that are always shaded on their own */
};

static const float least = 1.0f / 4096; /* smaller opacities are not drawn */

/* Bit s: sample s of a pixel meets this triangle. */
static inline unsigned match_samples(const int32_t *triangles, int32_t triangle) {
    unsigned samples = 0;
    for (int v = 0; v < SP_MESH_VECTORS; v++)
        samples |= sp_wide_mask_bits(sp_wide_int_eq(sp_wide_int_load(triangles + v * SP_WIDE),
                                                    sp_wide_int_all(triangle)))
                   << v * SP_WIDE;
    return samples;
}

/* Adds a part. `samples` are not empty. */
static inline void add_part(const struct sp_mesh *m, const float *inverse, int32_t triangle,
                            unsigned samples, struct sp_mesh_parts *parts, int at) {
    float sum = 0;
    for (unsigned left = samples; left; left &= left - 1)
        sum += inverse[__builtin_ctz(left)];
    const float mean = sum / (float)__builtin_popcount(samples);
    parts->samples[at] = (uint16_t)samples;
    parts->triangle[at] = triangle;
    parts->depth[at] = m->is_perspective ? 1 / mean : -mean;
}

/* Samples of other triangles join the first parts: each joins the part with the nearest depth.
 * Returns the samples that are near no part. */
static inline unsigned join_parts(const struct sp_mesh *m, const float *inverse, unsigned left,
                                  unsigned joined[SHADED]) {
    unsigned taken[SHADED] = { 0 };
    for (int v = 0; v < SP_MESH_VECTORS; v++) {
        const sp_wide here = sp_wide_load(inverse + v * SP_WIDE);
        const float share = m->apart / m->scale;
        sp_wide away = m->is_perspective ? here * share : sp_wide_all(share);
        sp_wide_int nearest = sp_wide_int_all(SHADED);
        for (int k = 0; k < SHADED; k++) {
            const sp_wide one = sp_wide_abs(here - inverse[__builtin_ctz(joined[k])]);
            const sp_wide_mask is_nearer = sp_wide_lt(one, away);
            away = sp_wide_select(is_nearer, one, away);
            nearest = (sp_wide_int)sp_wide_select(is_nearer, (sp_wide)sp_wide_int_all(k),
                                                  (sp_wide)nearest);
        }
        for (int k = 0; k < SHADED; k++)
            taken[k] |= sp_wide_mask_bits(sp_wide_int_eq(nearest, sp_wide_int_all(k)))
                        << v * SP_WIDE;
    }
    for (int k = 0; k < SHADED; k++) {
        joined[k] |= left & taken[k];
        left &= ~taken[k];
    }
    return left;
}

/* Lists the parts of one sheet of a pixel from number `first` on, and returns where they end. */
static inline int list_parts(const struct sp_mesh *m, const struct sp_mesh_sheet *sheet, int pixel,
                             unsigned left, struct sp_mesh_parts *parts, int first) {
    const int32_t *triangles = sheet->triangle + (size_t)pixel * SP_MESH_SAMPLES;
    const float *inverse = sheet->inverse + (size_t)pixel * SP_MESH_SAMPLES;
    unsigned samples[SP_MESH_SAMPLES];
    int32_t numbers[SP_MESH_SAMPLES];
    int count = 0;
    while (left) {
        numbers[count] = triangles[__builtin_ctz(left)];
        samples[count] = left & match_samples(triangles, numbers[count]);
        left &= ~samples[count++];
        if (count == SHADED && left)
            left = join_parts(m, inverse, left, samples);
    }
    for (int k = 0; k < count; k++)
        add_part(m, inverse, numbers[k], samples[k], parts, first + k);
    return first + count;
}

/* The middle of some samples of a pixel. */
static inline void compute_middle(unsigned samples, float middle[2]) {
    const float share = 1 / (float)__builtin_popcount(samples);
    float dx = 0, dy = 0;
    for (unsigned left = samples == ALL ? 0 : samples; left; left &= left - 1) {
        dx += sp_mesh_dx[__builtin_ctz(left)];
        dy += sp_mesh_dy[__builtin_ctz(left)];
    }
    middle[0] = 0.5f + dx * share;
    middle[1] = 0.5f + dy * share;
}

/* Lists the parts of one row of the tile. */
static void list_row(const struct sp_mesh *m, const struct sp_mesh_sheet *sheets, int count,
                     const struct sp_fragment_tile *tile, int row, struct sp_mesh_parts *parts) {
    int at = 0;
    for (int x = 0; x < SP_FRAGMENT_TILE; x++) {
        const int pixel = row * SP_FRAGMENT_TILE + x;
        parts->first[x] = at;
        for (int l = 0; l < count; l++) {
            const int32_t *triangles = sheets[l].triangle + (size_t)pixel * SP_MESH_SAMPLES;
            const unsigned hit = ALL & ~match_samples(triangles, SP_MESH_NONE);
            if (!hit)
                break;
            at = list_parts(m, &sheets[l], pixel, hit, parts, at);
        }
        for (int i = parts->first[x]; i < at; i++) {
            float middle[2];
            compute_middle(parts->samples[i], middle);
            parts->x[i] = (float)(tile->x + x) + middle[0];
            parts->y[i] = middle[1];
        }
    }
    parts->first[SP_FRAGMENT_TILE] = at;
}

/* The corners of SP_WIDE triangles. */
struct wide_triangle {
    sp_wide_int vertex[3];
    sp_wide u[3][3];  /* corner, axis of camera space */
    sp_wide share[3]; /* of each corner in the attributes; their sum is 1 */
};

/* The mean over the corners of an attribute: `width` floats per vertex, of which `column` is read.
 * Numbers of vertices are small enough for 32 bits. */
static inline sp_wide mean(const struct wide_triangle *t, const float *from, int width,
                           int column) {
    sp_wide sum = sp_wide_all(0);
    for (int k = 0; k < 3; k++)
        sum += t->share[k] * sp_wide_gather(from + column, t->vertex[k] * width);
    return sum;
}
_Static_assert(4ll * SP_ELEMENTS_MAX < INT32_MAX, "four numbers per vertex");

/* The direction of a pixel's ray, or its start: u = u2·(ray0, ray1, 1), or (ray0, ray1, u2). */
static inline void compute_ray(const struct sp_mesh *m, sp_wide x, sp_wide y, sp_wide ray[2]) {
    const float inverse = 1 / m->scale;
    ray[0] = (x - m->centre[0]) * inverse;
    ray[1] = (y - m->centre[1]) * inverse;
}

static inline void read_triangles(const struct sp_mesh *m, const int32_t *numbers, int n,
                                  struct wide_triangle *t) {
    const struct sp_elements *e = m->elements;
    int32_t vertex[3][SP_WIDE];
    for (int i = 0; i < SP_WIDE; i++)
        for (int k = 0; k < 3; k++)
            vertex[k][i] = (int32_t)e->triangles[numbers[i < n ? i : 0]][k];
    for (int k = 0; k < 3; k++) {
        sp_wide p[3];
        t->vertex[k] = sp_wide_int_load(vertex[k]);
        for (int a = 0; a < 3; a++)
            p[a] = sp_wide_gather(e->positions[0] + a, t->vertex[k] * 3) - m->origin[a];
        for (int r = 0; r < 3; r++)
            t->u[k][r] = m->shift[r] + p[0] * m->to_camera[r][0] + p[1] * m->to_camera[r][1] +
                         p[2] * m->to_camera[r][2];
    }
}

/* Computes how much each corner counts on a ray: with v_k the way from the ray to corner k at the
 * corner's depth, Σ share_k·v_k = 0. That holds for corners behind the eye as well. */
static inline void compute_shares(const struct sp_mesh *m, const sp_wide ray[2],
                                  struct wide_triangle *t) {
    const sp_wide zero = sp_wide_all(0), third = sp_wide_all(1.0f / 3);
    sp_wide v[3][2], sum = zero;
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 2; i++)
            v[k][i] = t->u[k][i] - (m->is_perspective ? ray[i] * t->u[k][2] : ray[i]);
    for (int k = 0; k < 3; k++) {
        const int p = k < 2 ? k + 1 : 0, q = p < 2 ? p + 1 : 0;
        t->share[k] = v[p][0] * v[q][1] - v[q][0] * v[p][1];
        sum += t->share[k];
    }
    sp_wide scale = 1 / sum, total = zero;
    for (int k = 0; k < 3; k++) { /* rounding may leave the triangle */
        t->share[k] = sp_wide_min(sp_wide_max(t->share[k] * scale, zero), sp_wide_all(1));
        total += t->share[k];
    }
    sp_wide_mask is_known = sp_wide_lt(sp_wide_all(0.5f), total);
    for (int k = 0; k < 3; k++)
        t->share[k] = sp_wide_select(is_known, t->share[k] / total, third);
}

/* The unit normal in world space: of the vertices, or else of the plane of the triangle. */
static inline void compute_normal(const struct sp_mesh *m, const struct wide_triangle *t,
                                  sp_wide world[3]) {
    const sp_wide tiny = sp_wide_all(1e-30f), huge = sp_wide_all(1e30f);
    sp_wide own[3], plane[3], camera[3], e[2][3];
    for (int a = 0; a < 3; a++) {
        own[a] = mean(t, m->elements->normals[0], 3, a);
        e[0][a] = t->u[1][a] - t->u[0][a];
        e[1][a] = t->u[2][a] - t->u[0][a];
    }
    for (int r = 0; r < 3; r++)
        world[r] = own[0] * m->normal_to_world[r][0] + own[1] * m->normal_to_world[r][1] +
                   own[2] * m->normal_to_world[r][2];
    sp_wide square = world[0] * world[0] + world[1] * world[1] + world[2] * world[2];
    sp_wide_mask is_known = sp_wide_lt(tiny, square) & sp_wide_lt(square, huge);
    for (int a = 0; a < 3; a++) {
        const int p = (a + 1) % 3, q = (a + 2) % 3;
        camera[a] = e[0][p] * e[1][q] - e[0][q] * e[1][p];
    }
    sp_shade_eye(m->shade, camera, plane);
    for (int a = 0; a < 3; a++)
        world[a] = sp_wide_select(is_known, world[a], plane[a]);
    square = world[0] * world[0] + world[1] * world[1] + world[2] * world[2];
    sp_wide_mask has_side = sp_wide_lt(tiny, square) & sp_wide_lt(square, huge);
    sp_wide scale = sp_wide_inverse_sqrt(sp_wide_select(has_side, square, sp_wide_all(1)));
    for (int a = 0; a < 3; a++)
        world[a] = sp_wide_keep(has_side, world[a] * scale);
}

static inline void shade(const struct sp_mesh *m, const struct wide_triangle *t,
                         const sp_wide ray[2], sp_wide color[3]) {
    sp_wide eye[3] = { sp_wide_all(0), sp_wide_all(0), sp_wide_all(-1) }, to_eye[3], normal[3];
    if (m->is_perspective) {
        sp_wide length = sp_wide_inverse_sqrt(ray[0] * ray[0] + ray[1] * ray[1] + 1);
        eye[0] = -ray[0] * length;
        eye[1] = -ray[1] * length;
        eye[2] = -length;
    }
    sp_shade_eye(m->shade, eye, to_eye);
    compute_normal(m, t, normal);
    sp_shade_direction(m->shade, normal, to_eye, color);
}

/* Colours and opacities of the parts of a row; y from the row. */
static void shade_parts(const struct sp_mesh *m, struct sp_mesh_parts *parts, int row) {
    const int count = parts->first[SP_FRAGMENT_TILE];
    const sp_wide zero = sp_wide_all(0), one = sp_wide_all(1);
    const float *colors = m->elements->colors[0];
    for (int i = 0; i < count; i += SP_WIDE) {
        struct wide_triangle t;
        sp_wide ray[2], color[3], alpha = sp_wide_all(m->opacity);
        read_triangles(m, parts->triangle + i, count - i, &t);
        compute_ray(m, sp_wide_load(parts->x + i), sp_wide_load(parts->y + i) + (float)row, ray);
        compute_shares(m, ray, &t);
        for (int c = 0; c < 3; c++)
            color[c] = m->has_own_colors
                           ? sp_wide_min(sp_wide_max(mean(&t, colors, 4, c), zero), one)
                           : sp_wide_all(m->color[c]);
        if (m->has_opacities)
            alpha *= sp_wide_min(sp_wide_max(mean(&t, colors, 4, 3), zero), one);
        if (m->shade)
            shade(m, &t, ray, color);
        sp_wide_store(parts->alpha + i, alpha);
        for (int c = 0; c < 3; c++)
            sp_wide_store(parts->color[c] + i, color[c]);
    }
}

/* The parts of a pixel, nearest first. */
static inline void sort_parts(const struct sp_mesh_parts *parts, int first, int count, int *order) {
    for (int i = 0; i < count; i++) {
        int at = i;
        for (; at > 0 && parts->depth[first + i] < parts->depth[order[at - 1]]; at--)
            order[at] = order[at - 1];
        order[at] = first + i;
    }
}

/* Parts that become one fragment. */
struct group {
    float nearest, depth; /* the latter times what they hide */
    float color[3], hidden;
};

static inline void close_group(struct group *g, struct sp_fragment_tile *tile, int pixel,
                               float *light) {
    const float alpha = g->hidden / *light;
    if (*light > least && alpha > least) {
        const float scale = 1 / *light;
        const struct sp_fragment fragment = { .depth = g->depth / g->hidden,
                                              .color = { g->color[0] * scale, g->color[1] * scale,
                                                         g->color[2] * scale },
                                              .alpha = alpha < 1 ? alpha : 1 };
        sp_fragment_add(tile, pixel, &fragment);
        *light -= g->hidden;
    }
    *g = (struct group){ .hidden = 0 };
}

/* The light that a part hides of the light that still comes through its samples; `light` is NULL if
 * no other part has them. */
static inline float hide(float *light, unsigned samples, float alpha) {
    float hidden = 0;
    if (!light)
        return alpha * (float)__builtin_popcount(samples) * (1.0f / SP_MESH_SAMPLES);
    for (unsigned left = samples; left; left &= left - 1) {
        float *one = &light[__builtin_ctz(left)], here = *one * alpha;
        *one -= here;
        hidden += here;
    }
    return hidden * (1.0f / SP_MESH_SAMPLES);
}

/* Composites the parts of a pixel sample by sample, and adds what they show. */
static void add_pixel(const struct sp_mesh *m, const struct sp_mesh_parts *parts, int x,
                      struct sp_fragment_tile *tile, int pixel) {
    int order[SP_MESH_SAMPLES * SP_MESH_SHEETS];
    float samples[SP_MESH_SAMPLES], light = 1;
    const int first = parts->first[x], count = parts->first[x + 1] - first;
    const bool is_single = count == 1 || m->sheets == 1; /* no sample is in two parts */
    struct group g = { .hidden = 0 };
    for (int s = 0; s < SP_MESH_SAMPLES; s++)
        samples[s] = 1;
    sort_parts(parts, first, count, order);
    for (int i = 0; i < count && light > least; i++) {
        const int k = order[i];
        const float depth = parts->depth[k];
        const float hidden = hide(is_single ? NULL : samples, parts->samples[k], parts->alpha[k]);
        const float apart = m->apart * (m->is_perspective ? depth : 1) / m->scale;
        if (g.hidden > 0 && depth - g.nearest > apart)
            close_group(&g, tile, pixel, &light);
        if (!(g.hidden > 0))
            g.nearest = depth;
        for (int c = 0; c < 3; c++)
            g.color[c] += hidden * parts->color[c][k];
        g.depth += hidden * depth;
        g.hidden += hidden;
    }
    close_group(&g, tile, pixel, &light);
}

void sp_mesh_tile(const struct sp_mesh *mesh, struct sp_mesh_scratch *scratch,
                  struct sp_fragment_tile *tile) {
    const int number = tile->y / SP_FRAGMENT_TILE * mesh->columns + tile->x / SP_FRAGMENT_TILE;
    const int columns = mesh->size[0] - tile->x, rows = mesh->size[1] - tile->y;
    int count = 0;
    if (mesh->first[number] == mesh->first[number + 1])
        return;
    while (count < mesh->sheets &&
           sp_mesh_cover(mesh, tile, count ? &scratch->sheets[count - 1] : NULL,
                         &scratch->sheets[count]))
        count++;
    for (int row = 0; row < SP_FRAGMENT_TILE && row < rows && count; row++) {
        list_row(mesh, scratch->sheets, count, tile, row, &scratch->parts);
        shade_parts(mesh, &scratch->parts, tile->y + row);
        for (int x = 0; x < SP_FRAGMENT_TILE && x < columns; x++)
            add_pixel(mesh, &scratch->parts, x, tile, row * SP_FRAGMENT_TILE + x);
    }
}
