/* SPDX-License-Identifier: Apache-2.0 */
#include "support/formula.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/vec.h"
#include "support/sample.h"

struct formula {
    const struct test_scene *scene;
    struct sp_mat3 to_world, to_camera; /* index → world, index → camera, without the offsets */
    double w[3][3];
    double volume; /* v_k */
    double scale;  /* f or s, px */
    bool perspective;
    struct test_image *sheet; /* E and T */
};

struct footprint {
    double x, y;       /* centre, px */
    double qa, qb, qc; /* conic */
    double rx, ry;     /* half sides of the box, px */
    double peak, r2;   /* τ_k(x_k), cutoff² */
    double emission[3];
};

static void init(struct formula *f, const struct test_scene *scene) {
    const struct sp_grid *grid = &scene->info.grid;
    const struct sp_camera *camera = &scene->view.camera;
    struct sp_mat3 w;
    double height = scene->view.size[1];
    f->scene = scene;
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            f->to_world.m[r][a] = grid->direction[r][a] * grid->spacing[a];
    test_camera_axes(camera, f->w);
    memcpy(w.m, f->w, sizeof w.m);
    f->to_camera = sp_mat3_multiply(&w, &f->to_world);
    f->volume = fabs(sp_mat3_determinant(&f->to_world));
    f->perspective = camera->projection == SP_PERSPECTIVE;
    f->scale =
        f->perspective ? 0.5 * height / tan(camera->fov_y * M_PI / 360) : height / camera->height;
}

/* The Jacobian at camera position u and its determinant. */
static double jacobian(const struct formula *f, const struct sp_vec3 *u, struct sp_mat3 *j) {
    double s = f->scale, z = u->v[2], l = sp_vec3_length(*u);
    *j = (struct sp_mat3){ { { s, 0, 0 }, { 0, s, 0 }, { 0, 0, 1 } } };
    if (f->perspective)
        *j = (struct sp_mat3){ { { s / z, 0, -s * u->v[0] / (z * z) },
                                 { 0, s / z, -s * u->v[1] / (z * z) },
                                 { u->v[0] / l, u->v[1] / l, z / l } } };
    return sp_mat3_determinant(j);
}

/* False when the voxel is not drawn. */
static bool set_up(const struct formula *f, const uint32_t i[3], struct footprint *p) {
    const struct test_scene *scene = f->scene;
    const struct sp_view *view = &scene->view;
    const uint32_t *dims = scene->info.grid.dims;
    size_t index = i[0] + dims[0] * (i[1] + (size_t)dims[1] * i[2]);
    double value = test_sample(scene->voxels, scene->info.type, index), opacity;
    test_classify(&view->transfer_function, value, 0, p->emission, &opacity);
    struct sp_vec3 t = sp_mat3_apply(&f->to_world, (struct sp_vec3){ { i[0], i[1], i[2] } }), u;
    for (int a = 0; a < 3; a++)
        t.v[a] += scene->info.grid.origin[a] - view->camera.position[a];
    for (int r = 0; r < 3; r++)
        u.v[r] = f->w[r][0] * t.v[0] + f->w[r][1] * t.v[1] + f->w[r][2] * t.v[2];
    if (!isfinite(value) || opacity <= 0 || u.v[2] < view->camera.near)
        return false;
    if (view->shading.mode == SP_SHADING_PHONG) {
        double gradient[3], ahead[3];
        struct sp_vec3 unit = sp_vec3_normalize(t);
        for (int c = 0; c < 3; c++)
            ahead[c] = f->perspective ? unit.v[c] : f->w[2][c];
        test_gradient(&scene->info, scene->voxels, i, gradient);
        test_shade(view, ahead, gradient, p->emission);
    }
    struct sp_mat3 j, m;
    double det_j = jacobian(f, &u, &j), v[3] = { 0 }, h2 = pow(view->filter.lowpass, 2);
    double sigma2 = pow(view->filter.sigma, 2), cutoff = view->filter.cutoff;
    m = sp_mat3_multiply(&j, &f->to_camera);
    for (int a = 0; a < 3; a++) {
        v[0] += sigma2 * m.m[0][a] * m.m[0][a];
        v[1] += sigma2 * m.m[0][a] * m.m[1][a];
        v[2] += sigma2 * m.m[1][a] * m.m[1][a];
    }
    if (view->filter.mode == SP_FILTER_LOWPASS)
        v[0] = v[1] = v[2] = 0;
    if (view->filter.mode != SP_FILTER_RECONSTRUCTION) {
        v[0] += h2;
        v[2] += h2;
    }
    double det = v[0] * v[2] - v[1] * v[1], z = f->perspective ? u.v[2] : 1;
    double g = -log1p(-opacity) / view->transfer_function.reference_length;
    p->x = 0.5 * view->size[0] + f->scale * u.v[0] / z;
    p->y = 0.5 * view->size[1] + f->scale * u.v[1] / z;
    p->qa = v[2] / det;
    p->qb = -v[1] / det;
    p->qc = v[0] / det;
    p->r2 = cutoff * cutoff;
    p->rx = cutoff * sqrt(v[0]);
    p->ry = cutoff * sqrt(v[2]);
    p->peak = g * f->volume * det_j / (2 * M_PI * sqrt(det)) / -expm1(-0.5 * p->r2);
    return true;
}

static void add(const struct formula *f, const struct footprint *p) {
    double width = f->sheet->width, height = f->sheet->height;
    double x0 = fmax(ceil(p->x - p->rx - 0.5), 0), x1 = fmin(p->x + p->rx - 0.5, width - 1);
    double y0 = fmax(ceil(p->y - p->ry - 0.5), 0), y1 = fmin(p->y + p->ry - 0.5, height - 1);
    for (double y = y0; y <= y1; y++)
        for (double x = x0; x <= x1; x++) {
            double dx = x + 0.5 - p->x, dy = y + 0.5 - p->y;
            double r2 = p->qa * dx * dx + 2 * p->qb * dx * dy + p->qc * dy * dy;
            if (r2 > p->r2)
                continue;
            double *to = test_image_at(f->sheet, (unsigned)x, (unsigned)y);
            double tau = p->peak * exp(-0.5 * r2);
            for (int c = 0; c < 3; c++)
                to[c] += p->emission[c] * tau;
            to[3] += tau;
        }
}

/* The axis whose slices' normal is nearest to the direction of view; *rising: the nearest slice is
 * the first. */
static int major_axis(const struct formula *f, bool *rising) {
    double det, best = -1;
    struct sp_mat3 inverse = sp_mat3_inverse(&f->to_camera, &det);
    int axis = 0;
    for (int a = 0; a < 3; a++) {
        /* Row a of the inverse is normal to the slices of axis a. */
        struct sp_vec3 normal = sp_vec3_normalize(sp_vec3_from(inverse.m[a]));
        if (fabs(normal.v[2]) > best) {
            best = fabs(normal.v[2]);
            axis = a;
            *rising = normal.v[2] > 0;
        }
    }
    return axis;
}

static void composite(const struct test_image *sheet, struct test_image *image) {
    for (size_t i = 0; i < (size_t)sheet->width * sheet->height; i++) {
        double *from = sheet->rgba + i * 4, *to = image->rgba + i * 4;
        if (from[3] <= 0)
            continue;
        double alpha = -expm1(-from[3]) * (1 - to[3]);
        for (int c = 0; c < 3; c++)
            to[c] += from[c] / from[3] * alpha;
        to[3] += alpha;
        memset(from, 0, 4 * sizeof *from);
    }
}

bool test_formula_render(const struct test_scene *scene, struct test_image *image) {
    const uint32_t *dims = scene->info.grid.dims;
    struct formula f;
    struct test_image sheet;
    bool rising = true;
    assert(scene->view.filter.mode <= SP_FILTER_LOWPASS);
    init(&f, scene);
    if (!test_image_init(image, scene->view.size[0], scene->view.size[1]))
        return false;
    if (!test_image_init(&sheet, image->width, image->height)) {
        test_image_finish(image);
        return false;
    }
    f.sheet = &sheet;
    int axis = major_axis(&f, &rising), p = (axis + 1) % 3, q = (axis + 2) % 3;
    for (uint32_t n = 0; n < dims[axis]; n++) {
        uint32_t i[3];
        struct footprint foot;
        i[axis] = rising ? n : dims[axis] - 1 - n;
        for (i[p] = 0; i[p] < dims[p]; i[p]++)
            for (i[q] = 0; i[q] < dims[q]; i[q]++)
                if (set_up(&f, i, &foot))
                    add(&f, &foot);
        composite(&sheet, image);
    }
    test_image_over(image, scene->view.background);
    test_image_finish(&sheet);
    return true;
}
