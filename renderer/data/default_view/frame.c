/* SPDX-License-Identifier: Apache-2.0 */
#include "data/default_view/frame.h"

#include <math.h>
#include <stdlib.h>

enum { STEPS = 4096 };
static const float faint = 1e-6f; /* the weight of haze, which does not decide how close */
static const double tail = 0.001; /* share of the visible matter that may lie outside */
static const double fill = 0.86;  /* of the image's height or width */

/* Visible samples in the camera's directions. */
struct cloud {
    size_t count;
    float *weight, *at[3]; /* right, up, towards the camera; relative to the volume's middle */
};

static void cloud_finish(struct cloud *c) {
    free(c->weight);
    for (int i = 0; i < 3; i++)
        free(c->at[i]);
}

static bool place_axes(const struct sp_default_samples *s, const struct sp_vec3 axes[3],
                       struct sp_vec3 middle, float *along[3][3]) {
    const struct sp_grid *grid = &s->info->grid;
    struct sp_vec3 from = sp_vec3_sub(sp_vec3_from(grid->origin), middle);
    for (int a = 0; a < 3; a++)
        for (int i = 0; i < 3; i++) {
            double slope = 0, start = a == 0 ? sp_vec3_dot(from, axes[i]) : 0;
            for (int r = 0; r < 3; r++)
                slope += grid->direction[r][a] * axes[i].v[r];
            if (!(along[a][i] = malloc(s->count[a] * sizeof(float))))
                return false;
            for (uint32_t n = 0; n < s->count[a]; n++)
                along[a][i][n] = (float)(start + slope * s->along[a][n]);
        }
    return true;
}

static void add_samples(const struct sp_default_samples *s, const float weight[SP_FIRST_BINS],
                        float *along[3][3], struct cloud *c) {
    const uint16_t *bin = s->bins;
    for (uint32_t k = 0; k < s->count[2]; k++)
        for (uint32_t j = 0; j < s->count[1]; j++)
            for (uint32_t i = 0; i < s->count[0]; i++, bin++) {
                if (*bin == SP_FIRST_NONE || !(weight[*bin] > 0))
                    continue;
                c->weight[c->count] = weight[*bin];
                for (int a = 0; a < 3; a++)
                    c->at[a][c->count] = along[0][a][i] + along[1][a][j] + along[2][a][k];
                c->count++;
            }
}

static bool cloud_init(struct cloud *c, const struct sp_default_samples *s,
                       const double extinction[SP_FIRST_BINS], const struct sp_vec3 axes[3],
                       struct sp_vec3 middle) {
    double cell = cbrt(s->cell[0] * s->cell[1] * s->cell[2]);
    float weight[SP_FIRST_BINS];
    size_t total = 0;
    for (int b = 0; b < SP_FIRST_BINS; b++) {
        double opacity = 1 - exp(-extinction[b] * cell);
        weight[b] = opacity > 0.002 ? (float)opacity : extinction[b] > 0 ? faint : 0;
        total += weight[b] > 0 ? s->histogram[b] : 0;
    }
    *c = (struct cloud){ .weight = malloc((total + 1) * sizeof(float)) };
    bool ok = total > 0 && c->weight;
    for (int i = 0; i < 3; i++)
        ok = (c->at[i] = malloc((total + 1) * sizeof(float))) && ok;
    if (!ok)
        return false;
    float *along[3][3] = { { NULL } }; /* [grid axis][camera axis]: what a sample's place adds */
    if (place_axes(s, axes, middle, along))
        add_samples(s, weight, along, c);
    else
        ok = false;
    for (int a = 0; a < 9; a++)
        free(along[a / 3][a % 3]);
    return ok;
}

/* The values between which all but the share `tail` of the weight lies, on each side. */
static void compute_ends(const float *values, const float *weight, size_t n, double ends[2]) {
    double sums[STEPS] = { 0 }, total = 0, low = INFINITY, high = -INFINITY;
    for (size_t i = 0; i < n; i++) {
        low = fmin(low, (double)values[i]);
        high = fmax(high, (double)values[i]);
    }
    double scale = high > low ? (STEPS - 1) / (high - low) : 0;
    for (size_t i = 0; i < n; i++) {
        sums[(int)(((double)values[i] - low) * scale)] += (double)weight[i];
        total += (double)weight[i];
    }
    double sum = 0;
    int first = 0, last = STEPS - 1;
    while (first < STEPS - 1 && (sum += sums[first]) <= tail * total)
        first++;
    for (sum = 0; last > first && (sum += sums[last]) <= tail * total;)
        last--;
    ends[0] = scale > 0 ? low + first / scale : low;
    ends[1] = scale > 0 ? low + last / scale : high;
}

/* How far from the middle all but a small share of the visible samples lie towards the camera,
 * however faint they are: inside of a cloud, nothing is seen but haze. */
static double measure_front(const struct cloud *c) {
    const double share = 0.002;
    double low = INFINITY, high = -INFINITY;
    size_t counts[STEPS] = { 0 }, beyond = 0;
    for (size_t i = 0; i < c->count; i++) {
        low = fmin(low, (double)c->at[2][i]);
        high = fmax(high, (double)c->at[2][i]);
    }
    if (!(high > low))
        return high;
    for (size_t i = 0; i < c->count; i++)
        counts[(int)(((double)c->at[2][i] - low) / (high - low) * (STEPS - 1))]++;
    int last = STEPS - 1;
    while (last > 0 && (double)(beyond += counts[last]) <= share * (double)c->count)
        last--;
    return low + (last + 1) * (high - low) / (STEPS - 1);
}

static struct sp_vec3 middle_of(const struct sp_default_samples *s) {
    double a[3], b[3];
    sp_default_position(s, (const uint32_t[3]){ 0, 0, 0 }, a);
    sp_default_position(s, (const uint32_t[3]){ s->count[0] - 1, s->count[1] - 1, s->count[2] - 1 },
                        b);
    return sp_vec3_scale(sp_vec3_add(sp_vec3_from(a), sp_vec3_from(b)), 0.5);
}

void sp_default_frame(const struct sp_default_samples *s, const double extinction[SP_FIRST_BINS],
                      const struct sp_default_orientation *o, struct sp_camera *camera) {
    struct sp_vec3 axes[3], middle = middle_of(s);
    axes[2] = o->away;
    axes[0] = sp_vec3_normalize(sp_vec3_cross(o->up, o->away));
    axes[1] = sp_vec3_cross(axes[2], axes[0]);
    struct cloud c;
    if (!cloud_init(&c, s, extinction, axes, middle)) {
        cloud_finish(&c);
        return;
    }
    double ends[3][2], centre[3], half = 0;
    for (int i = 0; i < 3; i++) {
        compute_ends(c.at[i], c.weight, c.count, ends[i]);
        centre[i] = 0.5 * (ends[i][0] + ends[i][1]);
        middle = sp_vec3_add(middle, sp_vec3_scale(axes[i], centre[i]));
        half = i < 2 ? fmax(half, 0.5 * (ends[i][1] - ends[i][0])) : half;
    }
    const double front = measure_front(&c) - centre[2];
    double tangent = tan(0.5 * camera->fov_y * (M_PI / 180)) * fill;
    double cell = fmax(s->cell[0], fmax(s->cell[1], s->cell[2]));
    for (size_t i = 0; i < c.count; i++) { /* the distance at which this sample is just inside */
        double right = fabs((double)c.at[0][i] - centre[0]);
        double above = fabs((double)c.at[1][i] - centre[1]);
        c.at[2][i] = (float)((double)c.at[2][i] - centre[2] + fmax(right, above) / tangent);
    }
    compute_ends(c.at[2], c.weight, c.count, ends[2]);
    double distance = fmax(ends[2][1], 0) + cell / tangent;
    distance = fmax(distance, front + 0.25 * half); /* outside, with the haze before the eye */
    cloud_finish(&c);
    camera->height = 2 * (half + 0.5 * cell) / fill;
    for (int i = 0; i < 3; i++) {
        camera->target[i] = middle.v[i];
        camera->position[i] = middle.v[i] + distance * o->away.v[i];
        camera->up[i] = o->up.v[i];
    }
}
