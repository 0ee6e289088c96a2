/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/resample/rays.h"

#include <math.h>
#include <string.h>

/* The direction of the ray (x, y) px from the image's centre [samples per unit of depth]. */
static void compute_direction(const struct sp_resample *r, double x, double y, double out[3]) {
    for (int a = 0; a < 3; a++)
        out[a] = r->ray[a] + x * r->right[a] + y * r->down[a];
}

float sp_resample_reference(const struct sp_resample *r, int axis) {
    const struct sp_resample_axis *map = &r->axes[axis];
    int last = (int)r->samples->dims[axis] - 1, i = last / 2;
    float middle = 0.5f * (float)last;
    if (r->first)
        return sp_resample_reference(r->first, axis) + (float)r->offset[axis];
    if (!map->place)
        return middle;
    return last == 0 ? map->place[0]
                     : map->place[i] + (middle - (float)i) * (map->place[i + 1] - map->place[i]);
}

/* The axis to which the ray has the smallest angle, in world space. */
static int nearest_axis(const struct sp_resample *r, const double direction[3]) {
    int best = 0;
    for (int a = 1; a < 3; a++)
        if (fabs(direction[a]) * sqrt(r->metric[a]) >=
            fabs(direction[best]) * sqrt(r->metric[best]))
            best = a;
    return best;
}

static void set_axis(struct sp_resample_rays *rays, const struct sp_resample *r, int slices,
                     const double direction[3]) {
    rays->axis[0] = slices == 0 ? 1 : 0;
    rays->axis[1] = slices == 2 ? 1 : 2;
    rays->axis[2] = slices;
    rays->is_backwards = direction[slices] < 0;
    rays->reference = sp_resample_reference(r, slices);
}

/* 1/cos of the angle between the ray and an axis, in world space. */
static double slant(const struct sp_resample *r, const double direction[3], int axis) {
    const double *m = r->metric, *d = direction;
    double square = m[0] * d[0] * d[0] + m[1] * d[1] * d[1] + m[2] * d[2] * d[2] +
                    2 * (m[3] * d[1] * d[2] + m[4] * d[0] * d[2] + m[5] * d[0] * d[1]);
    return sqrt(square / (m[axis] * d[axis] * d[axis]));
}

/* Steepness of the ray (x, y) px from the image's centre. */
static double compute_steepness(const struct sp_resample *r, double x, double y, int axis) {
    bool is_perspective = r->camera->projection == SP_PERSPECTIVE;
    double direction[3], square = 0;
    compute_direction(r, is_perspective ? x : 0, is_perspective ? y : 0, direction);
    for (int a = 0; a < 3; a++)
        square += direction[a] * direction[a];
    return fmax(sqrt(square) / fabs(direction[axis]), slant(r, direction, axis));
}

/* Steepness is a convex function, so it is largest at a corner, and hardly below twice its value at
 * the centre minus its value at the opposite corner. */
static int choose_sheets(const struct sp_resample *r, const struct sp_resample_rays *rays,
                         const int place[4]) {
    double x = rays->centre[0] - r->camera->centre[0], y = rays->centre[1] - r->camera->centre[1];
    double largest = 0;
    for (int corner = 0; corner < 4; corner++)
        largest = fmax(largest,
                       compute_steepness(r, x + (corner & 1 ? 0.5 : -0.5) * place[2],
                                         y + (corner & 2 ? 0.5 : -0.5) * place[3], rays->axis[2]));
    double least = 2 * compute_steepness(r, x, y, rays->axis[2]) - largest;
    if (r->is_fine || least >= (double)r->steep[1])
        return RESAMPLE_HALVES;
    return largest <= (double)r->steep[0] ? RESAMPLE_WHOLE : RESAMPLE_WHOLE | RESAMPLE_HALVES;
}

void sp_resample_rays_init(struct sp_resample_rays *rays, const struct sp_resample *r,
                           const int place[4]) {
    bool is_perspective = r->camera->projection == SP_PERSPECTIVE;
    double direction[3], centre[3];
    rays->centre[0] = place[0] + 0.5 * place[2];
    rays->centre[1] = place[1] + 0.5 * place[3];
    double x = rays->centre[0] - r->camera->centre[0], y = rays->centre[1] - r->camera->centre[1];
    memcpy(direction, r->ray, sizeof direction);
    if (is_perspective)
        compute_direction(r, x, y, direction);
    /* One axis for the whole image, so that there are no seams; but its own axis for a tile whose
     * rays would hardly cross those slices. */
    set_axis(rays, r, r->axis, r->ray);
    if (slant(r, direction, r->axis) > 2.5 || direction[r->axis] * r->ray[r->axis] <= 0)
        set_axis(rays, r, nearest_axis(r, direction), direction);
    const int *axis = rays->axis;
    double forward = direction[axis[2]], sign = rays->is_backwards ? -1 : 1;
    for (int a = 0; a < 3; a++)
        centre[a] = is_perspective ? r->eye[a] : r->start[a] + x * r->right[a] + y * r->down[a];
    double ahead = (double)rays->reference - centre[axis[2]]; /* slices from the start to s = 0 */
    for (int a = 0; a < 2; a++) {
        rays->change[a] = direction[axis[a]] / forward;
        rays->at[a] = centre[axis[a]] + ahead * rays->change[a];
        rays->right[a] = r->right[axis[a]] - r->right[axis[2]] * rays->change[a];
        rays->down[a] = r->down[axis[a]] - r->down[axis[2]] * rays->change[a];
        if (is_perspective) {
            rays->right[a] /= forward;
            rays->down[a] /= forward;
        }
        rays->change[a] *= sign;
    }
    rays->fall[0] = is_perspective ? r->right[axis[2]] / forward : 0;
    rays->fall[1] = is_perspective ? r->down[axis[2]] / forward : 0;
    rays->lever = is_perspective ? ahead : 1;
    rays->is_too_wide = fabs(rays->fall[0]) * place[2] + fabs(rays->fall[1]) * place[3] > 1.7;
    rays->sheets = choose_sheets(r, rays, place);
}
