/* SPDX-License-Identifier: Apache-2.0 */
#include "support/kernels.h"

#include <math.h>
#include <stdlib.h>

struct eye {
    double at[3], axes[3][3]; /* right, down, forward */
    double scale, near;
};

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3]) {
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static void normalize(double a[3]) {
    const double length = sqrt(dot(a, a));
    for (int i = 0; i < 3; i++)
        a[i] /= length;
}

static struct eye open_eye(const struct sp_view *view) {
    const struct sp_camera *c = &view->camera;
    struct eye eye = { .scale = 0.5 * view->size[1] / tan(c->fov_y * M_PI / 360), .near = c->near };
    for (int i = 0; i < 3; i++) {
        eye.at[i] = c->position[i];
        eye.axes[2][i] = c->target[i] - c->position[i];
    }
    normalize(eye.axes[2]);
    cross(eye.axes[2], c->up, eye.axes[0]);
    normalize(eye.axes[0]);
    cross(eye.axes[2], eye.axes[0], eye.axes[1]);
    return eye;
}

/* A kernel with the factor of its variance, in which lengths are measured. */
struct placed {
    const struct test_kernel *kernel;
    double rank, depth, l[6], from[3]; /* of the centre; factor; from the centre to the eye */
};

static int compare_depths(const void *a, const void *b) {
    const struct placed *p = a, *q = b;
    const double x = p->rank, y = q->rank, u = p->depth, v = q->depth;
    return x > y ? 1 : x < y ? -1 : (u > v) - (u < v);
}

/* L⁻¹·v */
static void whiten(const double l[6], const double v[3], double out[3]) {
    out[0] = v[0] / l[0];
    out[1] = (v[1] - l[1] * out[0]) / l[2];
    out[2] = (v[2] - l[3] * out[0] - l[4] * out[1]) / l[5];
}

/* The factor of L·Lᵀ + more·(r·rᵀ + d·dᵀ), where r and d are the axes of the image. */
static void widen(const double l[6], const struct eye *eye, double more, double out[6]) {
    const double rows[3][3] = { { l[0], 0, 0 }, { l[1], l[2], 0 }, { l[3], l[4], l[5] } };
    double m[3][3] = { { 0 } };
    for (int r = 0; r < 3; r++)
        for (int c = 0; c <= r; c++) {
            double rest = dot(rows[r], rows[c]);
            for (int axis = 0; axis < 2; axis++)
                rest += more * eye->axes[axis][r] * eye->axes[axis][c];
            for (int k = 0; k < c; k++)
                rest -= m[r][k] * m[c][k];
            m[r][c] = r == c ? sqrt(rest) : rest / m[c][c];
            out[r * (r + 1) / 2 + c] = m[r][c];
        }
}

static struct placed place(const struct eye *eye, const struct test_kernel *kernel,
                           double lowpass) {
    struct placed p = { .kernel = kernel, .rank = kernel->rank };
    double away[3];
    for (int r = 0; r < 3; r++)
        away[r] = kernel->position[r] - eye->at[r];
    p.depth = dot(away, eye->axes[2]);
    widen(kernel->factor, eye, lowpass * p.depth * p.depth / (eye->scale * eye->scale), p.l);
    for (int r = 0; r < 3; r++)
        away[r] = -away[r];
    whiten(p.l, away, p.from);
    return p;
}

/* What a kernel hides of a ray, which has the direction d: its depth grows by 1 per step. */
static double compute_alpha(const struct placed *p, const struct eye *eye, const double d[3],
                            double cutoff) {
    double w[3];
    whiten(p->l, d, w);
    /* At the step s: ½·(a·s² − 2·b·s + c) */
    const double a = dot(w, w), b = -dot(w, p->from), c = dot(p->from, p->from);
    const double square = c - b * b / a, least = p->kernel->mass > 0 ? cutoff : 3.5;
    if (square > least * least)
        return 0;
    const double beyond = 0.5 * erfc((eye->near * a - b) / sqrt(2 * a));
    const double value = exp(-0.5 * square) * beyond;
    if (p->kernel->mass > 0) {
        const double size = p->l[0] * p->l[2] * p->l[5];
        const double whole = -expm1(-0.5 * cutoff * cutoff);
        const double integral = sqrt(dot(d, d) / a) * value / (2 * M_PI * size * whole);
        return -expm1(-p->kernel->mass * integral);
    }
    const double alpha = fmin(p->kernel->opacity * value, 0.99);
    return alpha < 1.0 / 255 ? 0 : alpha;
}

static void composite(const struct placed *placed, unsigned count, const struct eye *eye,
                      const double d[3], double cutoff, double rgba[4]) {
    double through = 1;
    for (unsigned i = 0; i < count && through > 1e-4; i++) {
        const double alpha = compute_alpha(&placed[i], eye, d, cutoff);
        for (int k = 0; k < 3; k++)
            rgba[k] += through * alpha * placed[i].kernel->color[k];
        through *= 1 - alpha;
    }
    rgba[3] = 1 - through;
}

bool test_kernels_render(const struct test_kernel *kernels, unsigned count,
                         const struct sp_view *view, double lowpass, struct test_image *image) {
    const struct eye eye = open_eye(view);
    struct placed *placed = calloc(count + 1u, sizeof *placed);
    const bool ok = placed && test_image_init(image, view->size[0], view->size[1]);
    for (unsigned i = 0; ok && i < count; i++)
        placed[i] = place(&eye, &kernels[i], lowpass);
    if (ok)
        qsort(placed, count, sizeof *placed, compare_depths);
    for (unsigned y = 0; ok && y < view->size[1]; y++)
        for (unsigned x = 0; x < view->size[0]; x++) {
            const double right = (x + 0.5 - 0.5 * view->size[0]) / eye.scale;
            const double down = (y + 0.5 - 0.5 * view->size[1]) / eye.scale;
            double d[3];
            for (int r = 0; r < 3; r++)
                d[r] = eye.axes[2][r] + right * eye.axes[0][r] + down * eye.axes[1][r];
            composite(placed, count, &eye, d, view->filter.cutoff, test_image_at(image, x, y));
        }
    free(placed);
    return ok;
}
