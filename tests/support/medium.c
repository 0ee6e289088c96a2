/* SPDX-License-Identifier: Apache-2.0 */
#include "support/medium.h"

#include <math.h>
#include <string.h>

enum { N = 24, SIDE = TEST_MEDIUM_SIDE };

const double test_medium_field[4] = { 0.03, -0.02, 0.05, 0.4 };
const float test_medium_color[3] = { 0.9f, 0.5f, 0.1f };

double test_medium_value(const double p[3]) {
    return test_medium_field[0] * p[0] + test_medium_field[1] * p[1] + test_medium_field[2] * p[2] +
           test_medium_field[3];
}

double test_dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

void test_medium_init(struct test_medium *s, enum sp_projection projection) {
    static double values[N * N * N];
    s->grid = (struct sp_grid){ .dims = { N, N, N },
                                .spacing = { 1, 1.5, 0.75 },
                                .origin = { -9, 4, -6 },
                                .direction = { { 0.8, -0.6, 0 }, { 0.6, 0.8, 0 }, { 0, 0, 1 } } };
    for (int i = 0; i < N * N * N; i++) {
        const int at[3] = { i % N, i / N % N, i / N / N };
        double p[3];
        for (int r = 0; r < 3; r++) {
            p[r] = s->grid.origin[r];
            for (int a = 0; a < 3; a++)
                p[r] += s->grid.direction[r][a] * s->grid.spacing[a] * at[a];
        }
        values[i] = test_medium_value(p);
    }
    s->volume = sp_volume_create(&s->grid, SP_FLOAT64, values, "medium", NULL);
    if (!s->volume)
        return;
    sp_view_init(&s->view, sp_volume_info(s->volume), "medium");
    s->view.size[0] = s->view.size[1] = SIDE;
    s->view.level_of_detail = SP_LOD_OFF; /* a pixel shows the ray through its centre */
    s->view.camera.projection = projection;
    s->view.shading.mode = SP_SHADING_NONE;
    s->view.background[2] = 0.25f;
    struct sp_transfer_function *tf = &s->view.transfer_function;
    tf->point_count = 1;
    tf->gradient_count = 0;
    tf->reference_length = 10;
    tf->points[0] = (struct sp_tf_point){ .value = 0, .opacity = 0.5f };
    memcpy(tf->points[0].color, test_medium_color, sizeof test_medium_color);
    s->sigma = log(2) / 10;
    s->view.slices.center = 0.5;
    s->view.slices.width = 2;
    s->view.slices.in_3d = true;
}

void test_medium_ray(const struct sp_camera *c, double x, double y, double from[3],
                     double along[3]) {
    double forward[3], right[3], down[3], length = 0;
    for (int i = 0; i < 3; i++)
        forward[i] = c->target[i] - c->position[i];
    length = sqrt(test_dot(forward, forward));
    for (int i = 0; i < 3; i++)
        forward[i] /= length;
    for (int i = 0; i < 3; i++)
        right[i] =
            forward[(i + 1) % 3] * c->up[(i + 2) % 3] - forward[(i + 2) % 3] * c->up[(i + 1) % 3];
    length = sqrt(test_dot(right, right));
    for (int i = 0; i < 3; i++)
        right[i] /= length;
    for (int i = 0; i < 3; i++)
        down[i] =
            forward[(i + 1) % 3] * right[(i + 2) % 3] - forward[(i + 2) % 3] * right[(i + 1) % 3];
    const bool is_flat = c->projection == SP_ORTHOGRAPHIC;
    double unit = (is_flat ? c->height : 2 * tan(c->fov_y * M_PI / 360)) / SIDE;
    for (int i = 0; i < 3; i++) {
        double aside = ((x - 0.5 * SIDE) * right[i] + (y - 0.5 * SIDE) * down[i]) * unit;
        from[i] = c->position[i] + (is_flat ? aside : 0);
        along[i] = forward[i] + (is_flat ? 0 : aside);
    }
    length = sqrt(test_dot(along, along));
    for (int i = 0; i < 3; i++)
        along[i] /= length;
}

void test_medium_axis(const struct sp_grid *g, int a, double axis[3], double range[2]) {
    for (int r = 0; r < 3; r++)
        axis[r] = g->direction[r][a];
    range[0] = -0.5 * g->spacing[a];
    range[1] = (N - 0.5) * g->spacing[a];
}

bool test_medium_cut(const struct test_medium *s, const double from[3], const double along[3],
                     bool clipped, double t[2]) {
    t[0] = 0;
    t[1] = INFINITY;
    for (int a = 0; a < 3; a++) {
        double axis[3], range[2], relative[3], ends[2];
        test_medium_axis(&s->grid, a, axis, range);
        for (int r = 0; r < 3; r++)
            relative[r] = from[r] - s->grid.origin[r];
        for (int e = 0; e < 2; e++) {
            double share = clipped ? s->view.clip.box[e][a] : e;
            double at = range[0] + share * (range[1] - range[0]);
            ends[e] = (at - test_dot(axis, relative)) / test_dot(axis, along);
        }
        t[0] = fmax(t[0], fmin(ends[0], ends[1]));
        t[1] = fmin(t[1], fmax(ends[0], ends[1]));
    }
    return t[0] < t[1];
}
