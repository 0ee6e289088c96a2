/* SPDX-License-Identifier: Apache-2.0 */
#include "support/trained.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* R of the quaternion, times the scales: its columns are the axes of the Gaussian. */
static void compute_axes(const struct test_gaussian *g, double axes[3][3]) {
    const double *q = g->rotation;
    double n = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    double w = q[0] / n, x = q[1] / n, y = q[2] / n, z = q[3] / n;
    const double turn[3][3] = {
        { 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y) },
        { 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x) },
        { 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y) },
    };
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 3; k++)
            axes[r][k] = turn[r][k] * g->scales[k];
}

static void compute_covariance(const double axes[3][3], double v[3][3]) {
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            v[r][c] = 0;
            for (int k = 0; k < 3; k++)
                v[r][c] += axes[r][k] * axes[c][k];
        }
}

void test_gaussian_store(const struct test_gaussian *g, const struct sp_elements *to, unsigned at) {
    double axes[3][3], v[3][3], l[3][3] = { { 0 } };
    compute_axes(g, axes);
    compute_covariance(axes, v);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c <= r; c++) {
            double rest = v[r][c];
            for (int k = 0; k < c; k++)
                rest -= l[r][k] * l[c][k];
            l[r][c] = r == c ? sqrt(fmax(rest, 0)) : l[c][c] > 0 ? rest / l[c][c] : 0;
            to->factors[at][r * (r + 1) / 2 + c] = (float)l[r][c];
        }
    for (int a = 0; a < 3; a++)
        to->positions[at][a] = (float)g->position[a];
    to->opacities[at] = (float)g->opacity;
    const unsigned count = sp_harmonics_count(to->shape.degree);
    for (unsigned i = 0; i < count; i++)
        for (unsigned k = 0; k < 3; k++)
            to->harmonics[(at * count + i) * 3 + k] = (float)g->harmonics[i][k];
}

/* Associated Legendre functions give the real harmonics; here they are written out. */
static void compute_color(const struct test_gaussian *g, unsigned degree, const double d[3],
                          double color[3]) {
    const double x = d[0], y = d[1], z = d[2];
    const double basis[16] = {
        0.5 / sqrt(M_PI),
        -sqrt(3 / (4 * M_PI)) * y,
        sqrt(3 / (4 * M_PI)) * z,
        -sqrt(3 / (4 * M_PI)) * x,
        sqrt(15 / (4 * M_PI)) * x * y,
        -sqrt(15 / (4 * M_PI)) * y * z,
        sqrt(5 / (16 * M_PI)) * (2 * z * z - x * x - y * y),
        -sqrt(15 / (4 * M_PI)) * x * z,
        sqrt(15 / (16 * M_PI)) * (x * x - y * y),
        -sqrt(35 / (32 * M_PI)) * y * (3 * x * x - y * y),
        sqrt(105 / (4 * M_PI)) * x * y * z,
        -sqrt(21 / (32 * M_PI)) * y * (4 * z * z - x * x - y * y),
        sqrt(7 / (16 * M_PI)) * z * (2 * z * z - 3 * x * x - 3 * y * y),
        -sqrt(21 / (32 * M_PI)) * x * (4 * z * z - x * x - y * y),
        sqrt(105 / (16 * M_PI)) * z * (x * x - y * y),
        -sqrt(35 / (32 * M_PI)) * x * (x * x - 3 * y * y),
    };
    for (int k = 0; k < 3; k++) {
        color[k] = 0.5;
        for (unsigned i = 0; i < sp_harmonics_count(degree); i++)
            color[k] += basis[i] * g->harmonics[i][k];
        color[k] = fmax(color[k], 0);
    }
}

static void cross(const double a[3], const double b[3], double out[3]) {
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void normalize(double a[3]) {
    double length = sqrt(dot(a, a));
    for (int i = 0; i < 3; i++)
        a[i] /= length;
}

struct eye {
    double axes[3][3]; /* right, down, forward */
    double at[3], scale, half[2], tangent[2];
    bool is_parallel;
};

static void open_eye(const struct sp_view *view, struct eye *eye) {
    const struct sp_camera *c = &view->camera;
    for (int i = 0; i < 3; i++) {
        eye->at[i] = c->position[i];
        eye->axes[2][i] = c->target[i] - c->position[i];
    }
    normalize(eye->axes[2]);
    cross(eye->axes[2], c->up, eye->axes[0]);
    normalize(eye->axes[0]);
    cross(eye->axes[2], eye->axes[0], eye->axes[1]);
    eye->is_parallel = c->projection == SP_ORTHOGRAPHIC;
    for (int i = 0; i < 2; i++)
        eye->half[i] = 0.5 * view->size[i];
    eye->scale =
        eye->is_parallel ? view->size[1] / c->height : eye->half[1] / tan(c->fov_y * M_PI / 360);
    for (int i = 0; i < 2; i++)
        eye->tangent[i] = eye->half[i] / eye->scale;
}

/* A Gaussian in the image. */
struct splat {
    double depth, x, y, conic[3], opacity, color[3];
    /* Close to the eye: the share of the exact value, the centre, and the inverse of the variance
     * with the filter, in the camera. */
    double share, u[3], inverse[3][3];
    double scale, half[2], near; /* of the camera */
};

static int compare_depths(const void *a, const void *b) {
    double x = ((const struct splat *)a)->depth, y = ((const struct splat *)b)->depth;
    return (x > y) - (x < y);
}

/* The 2 by 3 Jacobian at u. Kerbl et al. limit the ratios u0/u2 and u1/u2 to 1.3 times their value
 * at the border of the image; here `share` of what is beyond remains. */
static void compute_jacobian(const struct eye *eye, const double u[3], double share,
                             double j[2][3]) {
    memset(j, 0, 6 * sizeof(double));
    for (int i = 0; i < 2; i++) {
        double most = 1.3 * eye->tangent[i];
        j[i][i] = eye->is_parallel ? eye->scale : eye->scale / u[2];
        if (eye->is_parallel)
            continue;
        const double ratio = u[i] / u[2], limited = fmax(-most, fmin(ratio, most));
        j[i][2] = -eye->scale * (limited + share * (ratio - limited)) / u[2];
    }
}

/* The inverse of a symmetric matrix. */
static void invert(const double m[3][3], double out[3][3]) {
    double det = 0;
    for (int r = 0; r < 3; r++) {
        double row[3];
        cross(m[(r + 1) % 3], m[(r + 2) % 3], row);
        det = dot(m[r], row);
        memcpy(out[r], row, sizeof row);
    }
    for (int i = 0; i < 9; i++)
        out[i / 3][i % 3] /= det;
}

static double multiply(const double a[3], const double m[3][3], const double b[3]) {
    double sum = 0;
    for (int r = 0; r < 3; r++)
        sum += a[r] * dot(m[r], b);
    return sum;
}

/* Gaussians whose depth is below 6 times their size are exact, those beyond 12 times are affine,
 * and so are flat ones that face the image (renderer/splat/close.h). v: variance in the camera. */
static void place_close(const struct eye *eye, double v[3][3], double filter, struct splat *s) {
    const double *u = s->u, depth = fmax(u[2], 0), size = v[0][0] + v[1][1] + v[2][2];
    const double far = depth * fmax(sqrt(3 / size), 1 / sqrt(v[2][2]));
    const double near = fmax(fmin((12 - far) / 6, 1), 0);
    s->share = near * near * (3 - 2 * near);
    s->scale = eye->scale;
    for (int r = 0; r < 2; r++) {
        s->half[r] = eye->half[r];
        v[r][r] += filter * u[2] * u[2] / (eye->scale * eye->scale);
    }
    invert((const double(*)[3])v, s->inverse);
}

/* What remains of the opacity at a point of the image, in the distance from the ray. */
static double compute_close(const struct splat *s, double x, double y, double square) {
    const double right = (x - s->half[0]) / s->scale, down = (y - s->half[1]) / s->scale;
    const double whole = multiply(s->u, s->inverse, s->u);
    if (s->share < 1) {
        const double away[3] = { s->share * (right - s->u[0] / s->u[2]),
                                 s->share * (down - s->u[1] / s->u[2]), 0 };
        const double slope = 1 + multiply(s->u, s->inverse, away) * s->u[2] / whole;
        const double divisor = slope * slope + s->share * s->share * square / whole;
        return slope > 0 ? exp(-0.5 * square / divisor) : 0;
    }
    const double d[3] = { right, down, 1 };
    const double own = multiply(d, s->inverse, d), t = multiply(d, s->inverse, s->u) / sqrt(own);
    const double beyond = 0.5 * erfc((s->near * sqrt(own) - t) * M_SQRT1_2);
    return exp(-0.5 * (whole - t * t)) * beyond;
}

static bool project(const struct test_gaussian *g, unsigned degree, const struct eye *eye,
                    const struct sp_layer *layer, double near, struct splat *s) {
    const double *m = layer->transform, filter = 0.3;
    double axes[3][3], v[3][3], away[3], u[3], t[2][3], j[2][3], flat[2][2] = { { 0 } };
    compute_axes(g, axes);
    compute_covariance(axes, v);
    for (int r = 0; r < 3; r++) {
        away[r] = m[4 * r + 3] - eye->at[r];
        for (int a = 0; a < 3; a++)
            away[r] += m[4 * r + a] * g->position[a];
    }
    for (int r = 0; r < 3; r++)
        u[r] = dot(eye->axes[r], away);
    double turn[3][3], camera[3][3] = { { 0 } };
    for (int i = 0; i < 9; i++) {
        turn[i / 3][i % 3] = 0;
        for (int k = 0; k < 3; k++)
            turn[i / 3][i % 3] += eye->axes[i / 3][k] * m[4 * k + i % 3];
    }
    for (int i = 0; i < 9; i++)
        camera[i / 3][i % 3] = multiply(turn[i / 3], (const double(*)[3])v, turn[i % 3]);
    memcpy(s->u, u, sizeof s->u);
    s->near = near;
    place_close(eye, camera, filter, s);
    s->share = eye->is_parallel ? 0 : s->share;
    if (u[2] < near && s->share < 1)
        return false;
    compute_jacobian(eye, u, s->share, j);
    for (int i = 0; i < 2; i++) /* T = J W M */
        for (int a = 0; a < 3; a++) {
            t[i][a] = 0;
            for (int k = 0; k < 3; k++)
                for (int l = 0; l < 3; l++)
                    t[i][a] += j[i][k] * eye->axes[k][l] * m[4 * l + a];
        }
    for (int i = 0; i < 4; i++)
        for (int a = 0; a < 9; a++)
            flat[i / 2][i % 2] += t[i / 2][a / 3] * v[a / 3][a % 3] * t[i % 2][a % 3];
    double before = flat[0][0] * flat[1][1] - flat[0][1] * flat[1][0];
    flat[0][0] += filter;
    flat[1][1] += filter;
    double det = flat[0][0] * flat[1][1] - flat[0][1] * flat[1][0];
    s->depth = u[2];
    s->x = eye->half[0] + eye->scale * (eye->is_parallel ? u[0] : u[0] / u[2]);
    s->y = eye->half[1] + eye->scale * (eye->is_parallel ? u[1] : u[1] / u[2]);
    s->conic[0] = flat[1][1] / det;
    s->conic[1] = -flat[0][1] / det;
    s->conic[2] = flat[0][0] / det;
    s->opacity = g->opacity * layer->opacity;
    if (layer->convention == SP_CONVENTION_NORMALISED)
        s->opacity *= sqrt(fmax(before, 0) / det);
    /* The direction in the world of the data; transforms of the tests only turn and scale. */
    double seen[3], direction[3];
    for (int r = 0; r < 3; r++)
        seen[r] = eye->is_parallel ? eye->axes[2][r] : away[r];
    for (int a = 0; a < 3; a++)
        direction[a] = m[a] * seen[0] + m[4 + a] * seen[1] + m[8 + a] * seen[2];
    normalize(direction);
    compute_color(g, degree, direction, s->color);
    return true;
}

/* The opacity at a point of the image; 0 = it is not drawn there. */
static double compute_alpha(const struct splat *s, double x, double y) {
    double dx = x - s->x, dy = y - s->y;
    double square = s->conic[0] * dx * dx + 2 * s->conic[1] * dx * dy + s->conic[2] * dy * dy;
    double value = s->share > 0 ? compute_close(s, x, y, square) : exp(-0.5 * square);
    double alpha = fmin(0.99, s->opacity * value);
    return alpha < 1.0 / 255 ? 0 : alpha;
}

struct test_trained {
    struct splat *splats;
    unsigned count;
};

struct test_trained *test_trained_create(const struct test_gaussian *gaussians, unsigned count,
                                         unsigned degree, const struct sp_view *view,
                                         const struct sp_layer *layer) {
    struct test_trained *trained = calloc(1, sizeof *trained);
    struct splat *splats = calloc(count + 1, sizeof *splats);
    struct eye eye;
    unsigned seen = 0;
    if (!trained || !splats) {
        free(trained);
        free(splats);
        return NULL;
    }
    open_eye(view, &eye);
    for (unsigned i = 0; i < count; i++)
        seen += project(&gaussians[i], degree, &eye, layer, view->camera.near, &splats[seen]);
    qsort(splats, seen, sizeof *splats, compare_depths);
    *trained = (struct test_trained){ splats, seen };
    return trained;
}

void test_trained_destroy(struct test_trained **trained) {
    if (*trained)
        free((*trained)->splats);
    free(*trained);
    *trained = NULL;
}

unsigned test_trained_hits(const struct test_trained *trained, double x, double y,
                           struct test_hit *hits) {
    unsigned found = 0;
    for (unsigned i = 0; i < trained->count; i++) {
        const struct splat *s = &trained->splats[i];
        double alpha = compute_alpha(s, x, y);
        if (alpha <= 0)
            continue;
        hits[found] = (struct test_hit){ .depth = s->depth, .alpha = alpha };
        memcpy(hits[found++].color, s->color, sizeof s->color);
    }
    return found;
}

static void composite(const struct test_trained *trained, double x, double y, double rgba[4]) {
    double through = 1;
    for (unsigned i = 0; i < trained->count && through >= 1e-4; i++) {
        double alpha = compute_alpha(&trained->splats[i], x, y);
        for (int k = 0; k < 3; k++)
            rgba[k] += through * alpha * trained->splats[i].color[k];
        through *= 1 - alpha;
    }
    rgba[3] = 1 - through;
}

bool test_trained_render(const struct test_gaussian *gaussians, unsigned count, unsigned degree,
                         const struct sp_view *view, const struct sp_layer *layer,
                         struct test_image *image) {
    struct test_trained *trained = test_trained_create(gaussians, count, degree, view, layer);
    const bool ok = trained && test_image_init(image, view->size[0], view->size[1]);
    for (unsigned y = 0; ok && y < view->size[1]; y++)
        for (unsigned x = 0; x < view->size[0]; x++)
            composite(trained, x + 0.5, y + 0.5, test_image_at(image, x, y));
    if (ok)
        test_image_over(image, view->background);
    test_trained_destroy(&trained);
    return ok;
}
