/* SPDX-License-Identifier: Apache-2.0 */
#include "data/default_view/elements.h"

#include <math.h>
#include <stdlib.h>

#include "base/vec.h"
#include "data/volume/curvilinear.h"
#include "data/volume/elements.h"

enum {
    SAMPLES = 1 << 16,
    FEW = 100 /* points that hardly cover each other */
};
static const double fill = 0.86; /* of the image's height */

/* Where the camera stands, as seen from the elements, and what is up there. */
struct stand {
    struct sp_vec3 away, up;
};

/* True if points lie in a disc or on a ground: their height is less than this part of their width.
 */
static bool is_flat(const struct sp_elements *e) {
    const double flat = 0.3;
    double low[3], high[3];
    return sp_elements_core(e, low, high) &&
           high[2] - low[2] < flat * fmax(high[0] - low[0], high[1] - low[1]);
}

static struct stand stand_of(const struct sp_elements *e) {
    switch (e->shape.kind) {
    case SP_KIND_GAUSSIANS:
        return (struct stand){ { { 0.35, -0.3, -0.9 } }, { { 0, -1, 0 } } };
    case SP_KIND_MESH:
        return (struct stand){ { { 0.45, 0.35, 0.82 } }, { { 0, 1, 0 } } };
    case SP_KIND_POINTS:
        if (is_flat(e)) /* from above */
            return (struct stand){ { { 0.3, -0.62, 0.72 } }, { { 0, 0, 1 } } };
        break;
    case SP_KIND_GRID:
    case SP_KIND_COUNT:
        break;
    }
    return (struct stand){ { { 0.45, -0.82, 0.35 } }, { { 0, 0, 1 } } };
}

/* Opacity of a value: linear between the points. */
static double opacity_of(const struct sp_transfer_function *tf, double value) {
    const struct sp_tf_point *p = tf->points;
    uint32_t next = 0;
    while (next < tf->point_count && p[next].value <= value)
        next++;
    if (next == 0 || next == tf->point_count)
        return (double)p[next ? next - 1 : 0].opacity;
    double u = (value - p[next - 1].value) / (p[next].value - p[next - 1].value);
    return (1 - u) * (double)p[next - 1].opacity + u * (double)p[next].opacity;
}

static int compare(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* The places of some visible elements along the axes of the camera, sorted along each; returns how
 * many. */
static size_t project_visible(const struct sp_elements *e, const struct sp_transfer_function *tf,
                              const struct sp_vec3 axes[3], float *places[3]) {
    const uint32_t n = e->shape.kind == SP_KIND_MESH ? e->shape.vertex_count : e->shape.count;
    const uint32_t step = (n + SAMPLES - 1) / SAMPLES;
    size_t taken = 0;
    for (uint32_t i = 0; i < n; i += step) {
        if (!sp_elements_counts(e, i) || (e->values && !(opacity_of(tf, (double)e->values[i]) > 0)))
            continue;
        const struct sp_vec3 at = { { (double)e->positions[i][0], (double)e->positions[i][1],
                                      (double)e->positions[i][2] } };
        for (int k = 0; k < 3; k++)
            places[k][taken] = (float)sp_vec3_dot(axes[k], at);
        taken++;
    }
    for (int k = 0; k < 3; k++)
        qsort(places[k], taken, sizeof(float), compare);
    return taken;
}

/* Looks at all places but the first and last `cut` of each axis, and so far beside them. */
static void frame(const struct stand *stand, const struct sp_vec3 axes[3], float *const places[3],
                  size_t count, size_t cut, double beside, struct sp_camera *camera) {
    struct sp_vec3 middle = { { 0 } };
    double half[3];
    for (int k = 0; k < 3; k++) {
        double low = (double)places[k][cut], high = (double)places[k][count - 1 - cut];
        half[k] = 0.5 * (high - low) + beside;
        middle = sp_vec3_add(middle, sp_vec3_scale(axes[k], 0.5 * (high + low)));
    }
    double aside = fmax(half[0], half[1]) / fill;
    if (!(aside > 0))
        aside = half[2] > 0 ? half[2] : 1;
    camera->height = 2 * aside;
    double distance = half[2] + aside / tan(camera->fov_y * (M_PI / 360));
    for (int i = 0; i < 3; i++) {
        camera->target[i] = middle.v[i];
        camera->position[i] = middle.v[i] + distance * axes[2].v[i];
        camera->up[i] = stand->up.v[i];
    }
    camera->near = 1e-3 * distance;
}

/* How large points are drawn, 1 = as large as the space around each. Where that space differs much,
 * as in a galaxy, the kernels of points in wide space would hide all others behind a blur, so all
 * are drawn smaller: by the square of how much the usual space is narrower than nearly the widest.
 * `sizes` has space for SAMPLES numbers. */
static double size_of_points(const struct sp_elements *e, float *sizes) {
    const uint32_t step = (e->shape.count + SAMPLES - 1) / SAMPLES;
    size_t n = 0;
    for (uint32_t i = 0; i < e->shape.count; i += step)
        if (sp_elements_counts(e, i) && e->volumes[i] > 0)
            sizes[n++] = cbrtf(e->volumes[i]);
    if (n == 0)
        return 1;
    qsort(sizes, n, sizeof *sizes, compare);
    const double even = 0.6; /* median over nearly the largest: 0.8 at random, 1 in a lattice */
    const double usual = (double)sizes[n / 2] / (double)sizes[n - 1 - n / 20] / even;
    return usual < 1 ? fmax(0.1, usual * usual) : 1; /* the range of the field */
}

/* The width of the usual space around few points; 0 = there is none. */
static double usual_space(const struct sp_elements *e) {
    float sizes[FEW];
    size_t n = 0;
    for (uint32_t i = 0; i < e->shape.count; i++)
        if (sp_elements_counts(e, i) && e->volumes[i] > 0)
            sizes[n++] = cbrtf(e->volumes[i]);
    qsort(sizes, n, sizeof *sizes, compare);
    return n ? (double)sizes[n / 2] : 0;
}

/* Few points are seen one by one: opaque, and none wider than a share of the diagonal of all.
 * Returns how far a kernel reaches. */
static double show_few(const struct sp_elements *e, float *const places[3], size_t count,
                       struct sp_view *view) {
    const double share = 0.2, depth = 0.4, reach = 2 * SP_CURVILINEAR_SIGMA * usual_space(e);
    struct sp_transfer_function *tf = &view->transfer_function;
    double diagonal = 0, size = 1;
    for (int k = 0; k < 3; k++)
        diagonal = hypot(diagonal, (double)places[k][count - 1] - (double)places[k][0]);
    if (diagonal > 0 && reach > share * diagonal)
        size = fmax(0.1, share * diagonal / reach);
    view->layers[0].size = size;
    for (uint32_t i = 0; i < tf->point_count; i++)
        tf->points[i].opacity = 0.9f;
    tf->reference_length *= depth;
    return size * reach;
}

void sp_default_elements(const struct sp_volume *volume, struct sp_view *view) {
    const struct sp_elements *elements = sp_volume_elements(volume);
    const struct stand stand = stand_of(elements);
    struct sp_vec3 away = sp_vec3_normalize(stand.away);
    struct sp_vec3 right = sp_vec3_normalize(sp_vec3_cross(stand.up, away));
    const struct sp_vec3 axes[3] = { right, sp_vec3_cross(away, right), away };
    const struct sp_transfer_function every = { .point_count = 1, .points = { { .opacity = 1 } } };
    const bool are_points = elements->shape.kind == SP_KIND_POINTS;
    const bool are_few = are_points && elements->shape.count < FEW;
    float *memory = malloc((size_t)3 * SAMPLES * sizeof *memory);
    if (!memory)
        return;
    float *places[3] = { memory, memory + SAMPLES, memory + 2 * SAMPLES };
    size_t count =
        project_visible(elements, are_few ? &every : &view->transfer_function, axes, places);
    size_t cut = (size_t)(sp_elements_tail(elements->shape.kind) * (double)count);
    double beside = are_few && count > 0 ? show_few(elements, places, count, view) : 0;
    if (count > 0)
        frame(&stand, axes, places, count, cut, beside, &view->camera);
    if (are_points && !are_few)
        view->layers[0].size = size_of_points(elements, places[0]);
    free(memory);
}
