/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "draw/layers/mesh/mesh.h"

enum { PLANES = 5, CORNERS_MAX = 3 + PLANES };
_Static_assert((int)SP_MESH_PIECES_MAX == CORNERS_MAX - 2, "a polygon is cut into a fan");

/* A corner in homogeneous coordinates of the image: at (x/w, y/w), behind the near plane by z. */
struct corner {
    double x, y, w, z;
};

static struct corner compute_corner(const struct sp_mesh *m, const float position[3]) {
    double u[3];
    for (int r = 0; r < 3; r++) {
        u[r] = (double)m->shift[r];
        for (int a = 0; a < 3; a++)
            u[r] += (double)m->to_camera[r][a] * ((double)position[a] - (double)m->origin[a]);
    }
    const double w = m->is_perspective ? u[2] : 1, scale = (double)m->scale;
    return (struct corner){ (double)m->centre[0] * w + scale * u[0],
                            (double)m->centre[1] * w + scale * u[1], w, u[2] - (double)m->near };
}

/* Distance from plane number i, in some unit; positive inside. */
static double compute_side(const struct sp_mesh *m, const struct corner *c, int i) {
    const double margin = 4096; /* px beside the image */
    switch (i) {
    case 0:
        return c->z;
    case 1:
        return c->x + margin * c->w;
    case 2:
        return (m->size[0] + margin) * c->w - c->x;
    case 3:
        return c->y + margin * c->w;
    default:
        return (m->size[1] + margin) * c->w - c->y;
    }
}

/* The place between a corner inside and one outside, the same for both triangles at an edge. */
static struct corner cut(const struct corner *in, double in_side, const struct corner *out,
                         double out_side) {
    const double t = in_side / (in_side - out_side);
    return (struct corner){ in->x + t * (out->x - in->x), in->y + t * (out->y - in->y),
                            in->w + t * (out->w - in->w), in->z + t * (out->z - in->z) };
}

static int cut_polygon(const struct sp_mesh *m, int plane, const struct corner *from, int count,
                       struct corner *to) {
    int n = 0;
    /* Rounding may bend a thin polygon, which a plane then cuts more than twice. */
    for (int i = 0; i < count && n < CORNERS_MAX; i++) {
        const struct corner *a = &from[i], *b = &from[i + 1 < count ? i + 1 : 0];
        const double a_side = compute_side(m, a, plane), b_side = compute_side(m, b, plane);
        if (a_side >= 0)
            to[n++] = *a;
        if (a_side >= 0 && b_side < 0)
            to[n++] = cut(a, a_side, b, b_side);
        else if (a_side < 0 && b_side >= 0)
            to[n++] = cut(b, b_side, a, a_side);
    }
    return n < CORNERS_MAX ? n : CORNERS_MAX;
}

static struct sp_mesh_place place(const struct sp_mesh *m, const struct corner *c) {
    const double u2 = c->z + (double)m->near;
    return (struct sp_mesh_place){ .x = (float)(c->x / c->w),
                                   .y = (float)(c->y / c->w),
                                   .inverse = (float)(m->is_perspective ? 1 / u2 : -u2),
                                   .u2 = (float)u2 };
}

int sp_mesh_clip(const struct sp_mesh *mesh, uint32_t triangle,
                 struct sp_mesh_piece pieces[SP_MESH_PIECES_MAX]) {
    struct corner corners[2][CORNERS_MAX + 1];
    int count = 3, now = 0;
    for (int k = 0; k < 3; k++) {
        const uint32_t vertex = mesh->elements->triangles[triangle][k];
        corners[0][k] = compute_corner(mesh, mesh->elements->positions[vertex]);
        if (!isfinite(corners[0][k].x + corners[0][k].y + corners[0][k].z))
            return 0;
    }
    for (int plane = 0; plane < PLANES && count; plane++, now = !now)
        count = cut_polygon(mesh, plane, corners[now], count, corners[!now]);
    for (int i = 2; i < count; i++)
        pieces[i - 2] = (struct sp_mesh_piece){ { place(mesh, &corners[now][0]),
                                                  place(mesh, &corners[now][i - 1]),
                                                  place(mesh, &corners[now][i]) },
                                                triangle };
    return count > 2 ? count - 2 : 0;
}
