/* SPDX-License-Identifier: Apache-2.0 */
#include "support/interpolant.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "support/sample.h"

static double weight(int tap) {
    static const double weights[6] = { 3, -25, 150, 150, -25, 3 };
    return weights[tap] / 256;
}

/* Fills the odd values along an axis, each from the six nearest even values. */
static void fill(struct test_interpolant *f, int axis) {
    const int step[3] = { 1, f->count[0], f->count[0] * f->count[1] };
    int n = f->count[axis], other = (axis + 1) % 3, third = (axis + 2) % 3;
    for (int j = 0; j < f->count[other]; j++)
        for (int k = 0; k < f->count[third]; k++) {
            double *line = f->values + j * step[other] + k * step[third];
            for (int i = 1; i < n; i += 2) {
                double sum = 0;
                for (int tap = 0; tap < 6; tap++) {
                    int at = i - 5 + 2 * tap;
                    at = at < 0 ? 0 : at >= n ? n - 1 : at;
                    sum += weight(tap) * line[at * step[axis]];
                }
                if (f->is_bounded) {
                    double before = line[(i - 1) * step[axis]], behind = line[(i + 1) * step[axis]];
                    sum = fmin(fmax(sum, fmin(before, behind)), fmax(before, behind));
                }
                line[i * step[axis]] = sum;
            }
        }
}

static bool init_values(struct test_interpolant *f) {
    const uint32_t *dims = f->grid->dims;
    double low = INFINITY, high = -INFINITY;
    size_t count = 1;
    for (int a = 0; a < 3; a++) {
        f->count[a] = 2 * (int)dims[a] - 1;
        count *= (size_t)f->count[a];
    }
    f->values = calloc(count, sizeof *f->values);
    if (!f->values)
        return false;
    for (uint32_t z = 0; z < dims[2]; z++)
        for (uint32_t y = 0; y < dims[1]; y++)
            for (uint32_t x = 0; x < dims[0]; x++) {
                const uint32_t i[3] = { x, y, z };
                double value = test_sample(f->scene->voxels, f->scene->info.type,
                                           test_sample_index(f->grid, i));
                size_t at = ((size_t)(2 * z) * (size_t)f->count[1] + 2 * y) * (size_t)f->count[0];
                f->values[at + 2 * x] = value;
                low = fmin(low, value);
                high = fmax(high, value);
            }
    const int across = f->slices == 0 ? 1 : 0, down = f->slices == 2 ? 1 : 2;
    const int order[3] = { across, f->slices, down };
    for (int k = 0; k < 3; k++)
        fill(f, order[k]);
    for (size_t i = 0; i < count; i++)
        f->values[i] = fmin(fmax(f->values[i], low), high);
    return true;
}

void test_invert(double m[3][3], double out[3][3]) {
    double det = 0;
    for (int c = 0; c < 3; c++)
        det += m[0][c] *
               (m[1][(c + 1) % 3] * m[2][(c + 2) % 3] - m[1][(c + 2) % 3] * m[2][(c + 1) % 3]);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            out[c][r] = (m[(r + 1) % 3][(c + 1) % 3] * m[(r + 2) % 3][(c + 2) % 3] -
                         m[(r + 1) % 3][(c + 2) % 3] * m[(r + 2) % 3][(c + 1) % 3]) /
                        det;
}

/* The sample index at a distance along an axis; false outside the volume. */
static bool compute_index(const struct sp_grid *grid, int a, double distance, double *index) {
    int last = (int)grid->dims[a] - 1;
    const double *c = grid->coordinates[a];
    double spacing = grid->spacing[a];
    double first_gap = c && last > 0 ? c[1] : spacing;
    double last_gap = c && last > 0 ? c[last] - c[last - 1] : spacing;
    double end = c ? c[last] : spacing * last;
    if (distance < -0.5 * first_gap || distance > end + 0.5 * last_gap)
        return false;
    if (!c) {
        *index = fmin(fmax(distance / spacing, 0), last);
        return true;
    }
    int i = 0;
    while (i + 1 < last && c[i + 1] <= distance)
        i++;
    *index = last ? fmin(fmax(i + (distance - c[i]) / (c[i + 1] - c[i]), 0), last) : 0;
    return true;
}

/* The field at sample indices. */
double test_interpolant_value(const struct test_interpolant *f, const double index[3]) {
    int first[3], step[3];
    double part[3], sum = 0;
    for (int a = 0; a < 3; a++) {
        double x = fmin(fmax(2 * index[a], 0), f->count[a] - 1);
        first[a] = (int)fmin(floor(x), f->count[a] - 1);
        part[a] = x - first[a];
        step[a] = first[a] + 1 < f->count[a] ? 1 : 0;
    }
    for (int k = 0; k < 8; k++) {
        int at[3];
        double product = 1;
        for (int a = 0; a < 3; a++) {
            int bit = k >> a & 1;
            at[a] = first[a] + bit * step[a];
            product *= bit ? part[a] : 1 - part[a];
        }
        sum += product * f->values[(at[2] * f->count[1] + at[1]) * f->count[0] + at[0]];
    }
    return sum;
}

/* The gradient in world space [data unit per world unit]. */
void test_interpolant_gradient(const struct test_interpolant *f, const double index[3],
                               double out[3]) {
    double slope[3];
    for (int a = 0; a < 3; a++) {
        double p[3], ends[2], gap = f->grid->spacing[a];
        for (int side = 0; side < 2; side++) {
            memcpy(p, index, sizeof p);
            p[a] += side - 0.5;
            ends[side] = test_interpolant_value(f, p);
        }
        const double *c = f->grid->coordinates[a];
        int last = (int)f->grid->dims[a] - 1, i = (int)fmin(floor(index[a]), last - 1);
        if (c && last > 0)
            gap = c[i + 1] - c[i];
        slope[a] = (ends[1] - ends[0]) / gap;
    }
    for (int r = 0; r < 3; r++)
        out[r] =
            f->inverse[0][r] * slope[0] + f->inverse[1][r] * slope[1] + f->inverse[2][r] * slope[2];
}

static bool is_kept(const struct test_interpolant *f, const double distance[3],
                    const double world[3]) {
    const struct sp_clip *clip = &f->scene->view.clip;
    for (int a = 0; a < 3; a++) {
        const double *c = f->grid->coordinates[a];
        int last = (int)f->grid->dims[a] - 1;
        double spacing = f->grid->spacing[a];
        double low = -0.5 * (c && last > 0 ? c[1] : spacing);
        double high =
            c && last > 0 ? c[last] + 0.5 * (c[last] - c[last - 1]) : spacing * (last + 0.5);
        double part = (distance[a] - low) / (high - low);
        if (part < clip->box[0][a] || part > clip->box[1][a])
            return false;
    }
    for (uint32_t i = 0; i < clip->plane_count; i++) {
        const double *n = clip->planes[i].normal;
        if (n[0] * world[0] + n[1] * world[1] + n[2] * world[2] < clip->planes[i].offset)
            return false;
    }
    return true;
}

bool test_interpolant_to_index(const struct test_interpolant *f, const double world[3],
                               double index[3]) {
    double distance[3];
    for (int a = 0; a < 3; a++) {
        distance[a] = 0;
        for (int r = 0; r < 3; r++)
            distance[a] += f->inverse[a][r] * (world[r] - f->grid->origin[r]);
        if (!compute_index(f->grid, a, distance[a], &index[a]))
            return false;
    }
    return is_kept(f, distance, world);
}

/* The axis along which the camera looks most, in samples. */
static int axis_of_slices(const struct test_interpolant *f) {
    double w[3][3], along[3];
    int best = 0;
    test_camera_axes(&f->scene->view.camera, w);
    for (int a = 0; a < 3; a++) {
        along[a] = 0;
        for (int r = 0; r < 3; r++)
            along[a] += f->inverse[a][r] * w[2][r];
        along[a] = fabs(along[a] / f->grid->spacing[a]);
        if (along[a] >= along[best])
            best = a;
    }
    return best;
}

static bool init(struct test_interpolant *f, const struct test_scene *scene, bool is_bounded) {
    double direction[3][3];
    *f = (struct test_interpolant){ .scene = scene,
                                    .grid = &scene->info.grid,
                                    .is_bounded = is_bounded };
    memcpy(direction, f->grid->direction, sizeof direction);
    test_invert(direction, f->inverse);
    f->slices = axis_of_slices(f);
    return init_values(f);
}

bool test_interpolant_init(struct test_interpolant *f, const struct test_scene *scene) {
    return init(f, scene, false);
}

bool test_interpolant_init_bounded(struct test_interpolant *f, const struct test_scene *scene) {
    return init(f, scene, true);
}

void test_interpolant_finish(struct test_interpolant *f) {
    free(f->values);
    f->values = NULL;
}
