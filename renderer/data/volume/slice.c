/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/slice.h"

#include <assert.h>
#include <float.h>
#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "data/volume/grid.h"
#include "data/volume/interpolate.h"
#include "data/volume/missing.h"
#include "data/volume/sample.h"
#include "data/volume/slice_colors.h"
#include "sp/view.h"

static enum sp_type interpolated_type(enum sp_type type) {
    return type == SP_INT32 || type == SP_FLOAT64 ? SP_FLOAT64 : SP_FLOAT32;
}

/* The world vector of distances along the axes. */
static void to_world(const struct sp_grid *grid, const double distances[3], double world[3]) {
    for (int r = 0; r < 3; r++) {
        world[r] = 0;
        for (int a = 0; a < 3; a++)
            world[r] += grid->direction[r][a] * distances[a];
    }
}

/* Of a rectilinear axis. */
static double smallest_gap(const struct sp_grid *grid, uint32_t axis) {
    double least = INFINITY;
    const double *c = grid->coordinates[axis];
    for (uint32_t i = 1; i < grid->dims[axis]; i++)
        least = fmin(least, c[i] - c[i - 1]);
    return least;
}

/* Writes the number of pixels along an axis and their distance. Returns true if each
 * lies on a sample. */
static bool divide_axis(const struct sp_grid *grid, uint32_t axis, uint32_t *count, double *step) {
    const double length = sp_grid_distance(grid, axis, grid->dims[axis] - 1);
    double pixels = grid->dims[axis];
    if (grid->coordinates[axis] && grid->dims[axis] > 1)
        pixels = ceil(length / smallest_gap(grid, axis) - 1e-6) + 1;
    *count = pixels > SP_SLICE_SIDE_MAX ? SP_SLICE_SIDE_MAX : (uint32_t)pixels;
    *step = grid->spacing[axis];
    if (*count > 1 && (grid->coordinates[axis] || *count != grid->dims[axis]))
        *step = length / (*count - 1.0);
    return !grid->coordinates[axis] && *count == grid->dims[axis];
}

bool sp_slice_init_orthogonal(struct sp_slice *slice, const struct sp_volume_info *info,
                              uint32_t axis, uint32_t index, struct sp_error *err) {
    const struct sp_grid *grid = &info->grid;
    if (axis > 2)
        return sp_fail(err, SP_ERR_INVALID, "axis", "axis %" PRIu32 " is outside [0, 2]", axis);
    if (index >= grid->dims[axis])
        return sp_fail(err, SP_ERR_INVALID, "index",
                       "index %" PRIu32 " is outside [0, %" PRIu32 "] along axis %" PRIu32, index,
                       grid->dims[axis] - 1, axis);
    *slice = (struct sp_slice){ .type = info->type };
    const uint32_t in_plane[2] = { axis == 0 ? 1 : 0, axis == 2 ? 1 : 2 };
    bool is_exact = true;
    for (int i = 0; i < 2; i++) {
        uint32_t a = in_plane[i];
        is_exact &= divide_axis(grid, a, &slice->size[i], &slice->grid_step[i][a]);
        to_world(grid, slice->grid_step[i], slice->step[i]);
    }
    slice->grid_origin[axis] = sp_grid_distance(grid, axis, index);
    to_world(grid, slice->grid_origin, slice->origin);
    for (int r = 0; r < 3; r++)
        slice->origin[r] += grid->origin[r];
    if (!is_exact)
        slice->type = interpolated_type(info->type);
    return true;
}

static bool check_vector(const double v[3], double most, const char *name, struct sp_error *err) {
    for (int i = 0; i < 3; i++)
        if (!(fabs(v[i]) <= most))
            return sp_fail(err, SP_ERR_INVALID, name, "%g is outside [-%g, %g]", v[i], most, most);
    return true;
}

static bool check_plane(const struct sp_slice_plane *plane, struct sp_error *err) {
    if (!check_vector(plane->origin, SP_POSITION_MAX, "origin", err) ||
        !check_vector(plane->normal, 1e300, "normal", err) ||
        !check_vector(plane->up, 1e300, "up", err))
        return false;
    if (!(sp_vec3_length(sp_vec3_unit(plane->normal)) > 0))
        return sp_fail(err, SP_ERR_INVALID, "normal", "the normal is zero; give it a direction");
    for (int i = 0; i < 2; i++)
        if (plane->size[i] < 1 || plane->size[i] > SP_SLICE_SIDE_MAX)
            return sp_fail(err, SP_ERR_INVALID, "size", "%" PRIu32 " is outside [1, %d]",
                           plane->size[i], SP_SLICE_SIDE_MAX);
    if (plane->spacing != 0 && !(plane->spacing >= 1e-12 && plane->spacing <= 1e15))
        return sp_fail(err, SP_ERR_INVALID, "spacing", "%g is outside [1e-12, 1e15]",
                       plane->spacing);
    return true;
}

bool sp_slice_init_oblique(struct sp_slice *slice, const struct sp_volume_info *info,
                           const struct sp_slice_plane *plane, struct sp_error *err) {
    const struct sp_grid *grid = &info->grid;
    if (!check_plane(plane, err))
        return false;
    struct sp_vec3 normal = sp_vec3_unit(plane->normal), up = sp_vec3_unit(plane->up);
    if (!(sp_vec3_length(up) > 0))
        up = fabs(normal.v[2]) < 0.9 ? (struct sp_vec3){ { 0, 0, 1 } }
                                     : (struct sp_vec3){ { 0, 1, 0 } };
    struct sp_vec3 right = sp_vec3_cross(up, normal);
    if (!(sp_vec3_length(right) > 1e-6))
        return sp_fail(err, SP_ERR_INVALID, "up", "up is parallel to the normal; turn one of them");
    right = sp_vec3_normalize(right);
    struct sp_vec3 down = sp_vec3_cross(right, normal);
    double spacing = plane->spacing > 0
                         ? plane->spacing
                         : fmin(grid->spacing[0], fmin(grid->spacing[1], grid->spacing[2]));
    struct sp_interpolator to;
    sp_interpolator_init_grid(&to, grid);
    *slice = (struct sp_slice){ .size = { plane->size[0], plane->size[1] },
                                .type = interpolated_type(info->type) };
    for (int r = 0; r < 3; r++) {
        slice->step[0][r] = spacing * right.v[r];
        slice->step[1][r] = spacing * down.v[r];
        slice->origin[r] = plane->origin[r] - slice->step[0][r] * (plane->size[0] - 1) / 2 -
                           slice->step[1][r] * (plane->size[1] - 1) / 2;
    }
    sp_interpolator_distances(&to, slice->origin, slice->grid_origin);
    for (int i = 0; i < 2; i++)
        for (int a = 0; a < 3; a++)
            for (int r = 0; r < 3; r++)
                slice->grid_step[i][a] += to.inverse[a][r] * slice->step[i][r];
    return true;
}

void sp_slice_move(struct sp_slice *slice, const struct sp_volume_info *to) {
    struct sp_interpolator own;
    sp_interpolator_init_grid(&own, &to->grid);
    sp_interpolator_distances(&own, slice->origin, slice->grid_origin);
}

/* Samples n pixels of a row from column `begin` on. */
static void sample_run(const struct sp_interpolator *it, const struct sp_slice *slice, uint32_t row,
                       uint32_t begin, uint32_t n, double *values) {
    double at[SP_INTERPOLATE_RUN][3];
    for (uint32_t i = 0; i < n; i++)
        for (int a = 0; a < 3; a++)
            at[i][a] = slice->grid_origin[a] + row * slice->grid_step[1][a] +
                       (begin + i) * slice->grid_step[0][a];
    sp_interpolate_run(it, n, (const double(*)[3])at, values);
}

#define STORE(T)                                                                                   \
    for (uint32_t i = 0; i < n; i++)                                                               \
    ((T *)out)[first + i] = (T)values[i]

/* Integers are only stored where every value is a sample. */
static void store(enum sp_type type, const double *values, uint32_t n, void *out, size_t first) {
    switch (type) { SP_TYPE_CASES(STORE) }
}

void sp_slice_sample(const struct sp_volume *volume, const struct sp_slice *slice, void *values) {
    struct sp_interpolator it;
    double run[SP_INTERPOLATE_RUN];
    sp_interpolator_init(&it, volume);
    for (uint32_t row = 0; row < slice->size[1]; row++)
        for (uint32_t at = 0; at < slice->size[0]; at += SP_INTERPOLATE_RUN) {
            uint32_t left = slice->size[0] - at;
            uint32_t n = left < SP_INTERPOLATE_RUN ? left : SP_INTERPOLATE_RUN;
            sample_run(&it, slice, row, at, n, run);
            store(slice->type, run, n, values, (size_t)row * slice->size[0] + at);
        }
}

static void draw_pixel(double value, const double window[2],
                       const struct sp_transfer_function *colors, uint8_t px[4]) {
    double rgb[3] = { 0 };
    if (!isnan(value) && colors)
        sp_points_color(colors, value, rgb);
    else if (!isnan(value))
        rgb[0] = rgb[1] = rgb[2] = sp_grey_level(value, window);
    for (int c = 0; c < 3; c++)
        px[c] = (uint8_t)(255 * rgb[c] + 0.5);
    px[3] = isnan(value) ? 0 : 255;
}

void sp_slice_draw(const struct sp_volume *volume, const struct sp_slice *slice,
                   const double window[2], const struct sp_transfer_function *colors,
                   struct sp_frame *frame) {
    struct sp_interpolator it;
    double run[SP_INTERPOLATE_RUN];
    bool is_opaque = true;
    assert(frame->format == SP_RGBA8 && frame->width == slice->size[0] &&
           frame->height == slice->size[1] && (colors || window[1] > 0));
    sp_interpolator_init(&it, volume);
    for (uint32_t row = 0; row < slice->size[1]; row++)
        for (uint32_t at = 0; at < slice->size[0]; at += SP_INTERPOLATE_RUN) {
            uint32_t left = slice->size[0] - at;
            uint32_t n = left < SP_INTERPOLATE_RUN ? left : SP_INTERPOLATE_RUN;
            uint8_t *px = (uint8_t *)frame->pixels + row * frame->stride_bytes + 4 * (size_t)at;
            sample_run(&it, slice, row, at, n, run);
            for (uint32_t i = 0; i < n; i++, px += 4) {
                draw_pixel(run[i], window, colors, px);
                is_opaque = is_opaque && px[3] == 255;
            }
        }
    frame->is_opaque = is_opaque;
}

void sp_slice_default_window(const struct sp_volume_info *info, double window[2]) {
    uint64_t total = 0, below = 0;
    for (int b = 0; b < SP_HISTOGRAM_BINS; b++)
        total += info->histogram[b];
    const double tail = 0.005 * (double)total, bin = sp_missing_data(info)[1] / SP_HISTOGRAM_BINS -
                                                     sp_missing_data(info)[0] / SP_HISTOGRAM_BINS;
    int low = -1, high = SP_HISTOGRAM_BINS;
    for (int b = 0; b < SP_HISTOGRAM_BINS; b++) {
        below += info->histogram[b];
        if (low < 0 && (double)below > tail)
            low = b;
        if ((double)below >= (double)total - tail) {
            high = b + 1;
            break;
        }
    }
    low = low < 0 ? 0 : low;
    window[0] = sp_missing_data(info)[0] + bin * 0.5 * (low + high);
    window[1] = fmin(bin * (high - low), DBL_MAX / 4);
    if (!(window[1] > 0))
        window[1] = 1;
}
