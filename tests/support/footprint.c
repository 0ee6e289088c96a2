/* SPDX-License-Identifier: Apache-2.0 */
#include "support/footprint.h"

#include <math.h>
#include <string.h>

#include "data/volume/grid.h"
#include "support/cubic.h"
#include "support/sample.h"

static void keep(struct test_projection *p, const double normal[3], double offset) {
    struct test_half_space *half = &p->half[p->planes++];
    memcpy(half->normal, normal, sizeof half->normal);
    half->offset = offset;
}

static void init_planes(struct test_projection *p) {
    const struct sp_grid *grid = &p->scene->info.grid;
    const struct sp_clip *clip = &p->scene->view.clip;
    struct sp_mat3 direction;
    double det;
    memcpy(direction.m, grid->direction, sizeof direction.m);
    /* Row a of the inverse measures distance along axis a. */
    struct sp_mat3 inverse = sp_mat3_inverse(&direction, &det);
    for (unsigned a = 0; a < 3; a++) {
        const double *n = inverse.m[a];
        double back[3] = { -n[0], -n[1], -n[2] }, extent[2], origin = 0;
        sp_grid_extent(grid, a, extent);
        for (int r = 0; r < 3; r++)
            origin += n[r] * grid->origin[r];
        double low = origin + extent[0] + clip->box[0][a] * (extent[1] - extent[0]);
        double high = origin + extent[0] + clip->box[1][a] * (extent[1] - extent[0]);
        if (clip->box[0][a] > 0)
            keep(p, n, low);
        if (clip->box[1][a] < 1)
            keep(p, back, -high);
    }
    for (uint32_t i = 0; i < clip->plane_count; i++)
        keep(p, clip->planes[i].normal, clip->planes[i].offset);
}

void test_projection_init(struct test_projection *p, const struct test_scene *scene) {
    const struct sp_view *view = &scene->view;
    *p = (struct test_projection){ .scene = scene,
                                   .scale = test_camera_scale(view),
                                   .sigma = view->filter.sigma,
                                   .radius = view->filter.cutoff,
                                   .perspective = view->camera.projection == SP_PERSPECTIVE,
                                   .cubic = view->filter.kernel == SP_KERNEL_CUBIC,
                                   .post = view->transfer_function.order == SP_TF_POST };
    test_camera_axes(&view->camera, p->w);
    if (p->cubic) {
        p->sigma = sqrt(test_cubic_variance());
        p->radius = TEST_CUBIC_RADIUS / p->sigma;
    }
    init_planes(p);
}

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* a b for 2×2 symmetric a = (xx, xy, yy) */
static void apply(const double a[3], const double b[2], double out[2]) {
    out[0] = a[0] * b[0] + a[1] * b[1];
    out[1] = a[1] * b[0] + a[2] * b[1];
}

/* Inverse of a symmetric 2×2 matrix; returns the determinant. */
static double invert(const double v[3], double inverse[3]) {
    double det = v[0] * v[2] - v[1] * v[1];
    inverse[0] = v[2] / det;
    inverse[1] = -v[1] / det;
    inverse[2] = v[0] / det;
    return det;
}

/* Sets the voxel's position in camera space, and the columns of its kernel in world space: the
 * deviation times the local spacing along each axis of the grid. Returns v_k. */
static double place_kernel(const struct test_projection *p, const uint32_t voxel[3], double u[3],
                           double kernel[3][3]) {
    const struct sp_grid *grid = &p->scene->info.grid;
    struct sp_mat3 cell;
    double world[3];
    test_sample_place(grid, voxel, world);
    for (int r = 0; r < 3; r++)
        world[r] -= p->scene->view.camera.position[r];
    for (int r = 0; r < 3; r++) {
        u[r] = dot(p->w[r], world);
        for (unsigned a = 0; a < 3; a++) {
            cell.m[r][a] = grid->direction[r][a] * sp_grid_local_spacing(grid, a, voxel[a]);
            kernel[r][a] = p->sigma * cell.m[r][a];
        }
    }
    return fabs(sp_mat3_determinant(&cell));
}

/* Sets J at the point u in camera space. Returns its determinant. */
static double jacobian(const struct test_projection *p, const double u[3], struct sp_mat3 *j) {
    double s = p->scale, z = u[2], l = sqrt(dot(u, u));
    *j = (struct sp_mat3){ { { s, 0, 0 }, { 0, s, 0 }, { 0, 0, 1 } } };
    if (p->perspective)
        *j = (struct sp_mat3){ { { s / z, 0, -s * u[0] / (z * z) },
                                 { 0, s / z, -s * u[1] / (z * z) },
                                 { u[0] / l, u[1] / l, z / l } } };
    return sp_mat3_determinant(j);
}

/* Scales rows 0 and 1 of J W K by a common factor, so that the smaller eigenvalue of V̂ is at least
 * h². */
static void scale_up(double m[3][3], double h2) {
    double a = dot(m[0], m[0]), b = dot(m[0], m[1]), c = dot(m[1], m[1]);
    double smaller = 0.5 * (a + c) - sqrt(0.25 * (a - c) * (a - c) + b * b);
    if (smaller >= h2)
        return;
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++)
            m[i][k] *= sqrt(h2 / smaller);
}

static void add_cut(const struct test_half_space *half, double e, const double kernel[3][3],
                    double m[3][3], const double inverse[3], const double depth[2],
                    struct test_footprint *f) {
    double q[3], c[2], slope[2];
    for (int a = 0; a < 3; a++)
        q[a] = half->normal[0] * kernel[0][a] + half->normal[1] * kernel[1][a] +
               half->normal[2] * kernel[2][a];
    for (int i = 0; i < 2; i++)
        c[i] = dot(m[i], q);
    apply(inverse, c, slope);
    /* A plane that contains the ray has no variance; keep a minimum, so that its edge is a
     * hundredth of a deviation wide. */
    double variance = fmax(dot(q, q) - c[0] * slope[0] - c[1] * slope[1], 1e-4 * dot(q, q));
    double joint = dot(m[2], q) - depth[0] * slope[0] - depth[1] * slope[1];
    double correlation = joint / (sqrt(variance) * f->deviation), s = 1 / sqrt(variance);
    f->cut[f->planes++] = (struct test_cut){ e * s,
                                             { slope[0] * s, slope[1] * s },
                                             correlation > 0.7    ? 1
                                             : correlation < -0.7 ? -1
                                                                  : 0 };
}

/* Sets the depth and clipping data from the distribution E on the image. */
static void set_extent(const struct test_projection *p, const double u[3],
                       const double kernel[3][3], double m[3][3], const double v[3],
                       struct test_footprint *f) {
    double inverse[3], depth[2] = { dot(m[0], m[2]), dot(m[1], m[2]) }, world[3];
    invert(v, inverse);
    apply(inverse, depth, f->slope);
    double all = dot(m[2], m[2]);
    f->distance = p->perspective ? sqrt(dot(u, u)) : u[2];
    f->deviation = sqrt(fmax(all - depth[0] * f->slope[0] - depth[1] * f->slope[1], 1e-12 * all));
    f->reach = p->radius * sqrt(all);
    test_sample_place(&p->scene->info.grid, f->voxel, world);
    for (int i = 0; i < p->planes; i++)
        add_cut(&p->half[i], dot(p->half[i].normal, world) - p->half[i].offset, kernel, m, inverse,
                depth, f);
}

/* Sets conic, box and peak from Ṽ. */
static void set_shape(const struct test_projection *p, const double v[3], double volume,
                      struct test_footprint *f) {
    double det = invert(v, f->conic);
    f->rx = p->radius * sqrt(v[0]);
    f->ry = p->radius * sqrt(v[2]);
    f->peak = volume / (2 * M_PI * sqrt(det)) / -expm1(-0.5 * p->radius * p->radius);
    if (p->cubic)
        f->peak = volume * p->sigma * p->sigma / sqrt(det); /* times F(ρ) */
    f->flat = p->scene->view.filter.mode == SP_FILTER_NONE;
    if (!f->flat)
        return;
    f->rx = fmax(0.8 * sqrt(v[0]) / p->sigma, 0.5);
    f->ry = fmax(0.8 * sqrt(v[2]) / p->sigma, 0.5);
    memset(f->conic, 0, sizeof f->conic);
    f->peak = volume / (4 * f->rx * f->ry);
}

/* Sets what the voxel adds per unit of length. False if it adds nothing. */
static bool set_numbers(const struct test_projection *p, const double u[3],
                        struct test_footprint *f) {
    const struct test_scene *scene = p->scene;
    const struct sp_view *view = &scene->view;
    size_t index = test_sample_index(&scene->info.grid, f->voxel);
    double value = test_sample(scene->voxels, scene->info.type, index), gradient[3] = { 0 };
    double color[3], opacity, ahead[3];
    if (!isfinite(value))
        return false;
    if (p->post || test_needs_gradient(view))
        test_gradient(&scene->info, scene->voxels, f->voxel, gradient);
    if (p->post) {
        memcpy(f->numbers, gradient, sizeof gradient);
        f->numbers[3] = 1;
        f->numbers[4] = value;
        return true;
    }
    test_classify(&view->transfer_function, value, sqrt(dot(gradient, gradient)), color, &opacity);
    if (opacity <= 0)
        return false;
    for (int c = 0; c < 3; c++)
        ahead[c] = p->perspective ? (p->w[0][c] * u[0] + p->w[1][c] * u[1] + p->w[2][c] * u[2]) /
                                        sqrt(dot(u, u))
                                  : p->w[2][c];
    test_shade(view, ahead, gradient, color);
    f->numbers[3] = -log1p(-opacity) / view->transfer_function.reference_length;
    for (int c = 0; c < 3; c++)
        f->numbers[c] = color[c] * f->numbers[3];
    return true;
}

bool test_footprint_init(const struct test_projection *p, const uint32_t voxel[3],
                         struct test_footprint *f) {
    const struct sp_view *view = &p->scene->view;
    double u[3], kernel[3][3], m[3][3], h2 = view->filter.lowpass * view->filter.lowpass;
    *f = (struct test_footprint){ .voxel = { voxel[0], voxel[1], voxel[2] } };
    double cell = place_kernel(p, voxel, u, kernel), z = p->perspective ? u[2] : 1;
    if (u[2] < view->camera.near || !set_numbers(p, u, f))
        return false;
    f->x = 0.5 * view->size[0] + p->scale * u[0] / z;
    f->y = 0.5 * view->size[1] + p->scale * u[1] / z;
    struct sp_mat3 j, w, k, all;
    memcpy(w.m, p->w, sizeof w.m);
    memcpy(k.m, kernel, sizeof k.m);
    double volume = cell * jacobian(p, u, &j);
    all = sp_mat3_multiply(&w, &k);
    all = sp_mat3_multiply(&j, &all);
    memcpy(m, all.m, sizeof m);
    enum sp_filter_mode mode = view->filter.mode;
    if (mode == SP_FILTER_SWAN)
        scale_up(m, h2);
    if (mode != SP_FILTER_EWA && mode != SP_FILTER_LOWPASS)
        h2 = 0;
    double v[3] = { dot(m[0], m[0]) + h2, dot(m[0], m[1]), dot(m[1], m[1]) + h2 };
    double round[3] = { h2, 0, h2 };
    set_extent(p, u, (const double(*)[3])kernel, m, v, f);
    set_shape(p, mode == SP_FILTER_LOWPASS ? round : v, volume, f);
    return true;
}

double test_footprint_share(const struct test_projection *p, const struct test_crossing *c,
                            double depth) {
    if (!p->cubic)
        return 0.5 * erfc(-depth / sqrt(2));
    return test_cubic_gathered(c->rho, p->sigma * depth) / c->all;
}

bool test_footprint_cross(const struct test_projection *p, const struct test_footprint *f,
                          const double d[2], struct test_crossing *c) {
    double t[2];
    apply(f->conic, d, t);
    double m2 = d[0] * t[0] + d[1] * t[1];
    *c = (struct test_crossing){ .length = f->peak, .low = -INFINITY, .high = INFINITY };
    if (p->cubic) {
        c->rho = p->sigma * sqrt(m2);
        c->all = test_cubic_gathered(c->rho, INFINITY);
    }
    if (f->flat) {
        if (d[0] < -f->rx || d[0] >= f->rx || d[1] < -f->ry || d[1] >= f->ry)
            return false;
    } else if (m2 > p->radius * p->radius) {
        return false;
    } else if (p->cubic) {
        c->length *= c->all;
    } else {
        c->length *= exp(-0.5 * m2);
    }
    for (int i = 0; i < f->planes; i++) {
        const struct test_cut *cut = &f->cut[i];
        double eta = cut->e + cut->k[0] * d[0] + cut->k[1] * d[1];
        if (cut->side > 0)
            c->low = fmax(c->low, -eta);
        else if (cut->side < 0)
            c->high = fmin(c->high, eta);
        else
            c->length *= test_footprint_share(p, c, eta);
    }
    return c->length > 0 && c->low < c->high;
}
