/* SPDX-License-Identifier: Apache-2.0 */
#include "data/default_view/field.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/compare.h"
#include "data/volume/grid.h"
#include "data/volume/sample.h"

enum { BINS = SP_FIRST_BINS };

void sp_default_field_color(double share, float color[3]) {
    static const float map[][3] = { { 0.28f, 0.17f, 0.49f }, { 0.24f, 0.29f, 0.54f },
                                    { 0.19f, 0.41f, 0.56f }, { 0.15f, 0.51f, 0.56f },
                                    { 0.12f, 0.62f, 0.54f }, { 0.21f, 0.72f, 0.47f },
                                    { 0.43f, 0.81f, 0.35f }, { 0.71f, 0.87f, 0.17f },
                                    { 0.99f, 0.91f, 0.14f } };
    const int last = sizeof map / sizeof *map - 1;
    const double at = fmin(fmax(share, 0), 1) * last;
    const int i = (int)at < last ? (int)at : last - 1;
    for (int c = 0; c < 3; c++)
        color[c] = (float)((1 - (at - i)) * (double)map[i][c] + (at - i) * (double)map[i + 1][c]);
}

/* The largest distance of the values from 0, on either side. */
static double reach_of(const struct sp_default_samples *s) {
    return fmax(fabs(s->low), fabs(s->high));
}

/* The share of the counts whose values lie within `reach` of 0. */
static double share_near_zero(const struct sp_default_samples *s, const uint64_t counts[BINS],
                              double reach) {
    double near = 0, all = 0;
    for (int b = 0; b < BINS; b++) {
        all += (double)counts[b];
        near += fabs(sp_default_value(s, b + 0.5)) <= reach ? (double)counts[b] : 0;
    }
    return all > 0 ? near / all : 1;
}

bool sp_default_is_signed(const struct sp_default_samples *s) {
    const bool is_real = s->info->type == SP_FLOAT32 || s->info->type == SP_FLOAT64;
    const double reach = reach_of(s), other = fmin(-s->low, s->high);
    if (s->info->meaning == SP_MEANING_STATISTIC)
        return s->low < 0;
    if (!is_real || !(s->low < 0) || !(other > 0.2 * reach))
        return false;
    if (!(share_near_zero(s, s->histogram, 0.15 * reach) > 0.5))
        return false;
    int quiet = 0;
    for (int f = 0; f < 6; f++)
        quiet += share_near_zero(s, s->faces[f], 0.2 * reach) > 0.8;
    return quiet >= 4;
}

static void add_point(struct sp_transfer_function *tf, double value, float red, float green,
                      float blue, float opacity) {
    if (tf->point_count && !(value > tf->points[tf->point_count - 1].value))
        return;
    tf->points[tf->point_count++] = (struct sp_tf_point){ value, { red, green, blue }, opacity };
}

/* The opacity of values from `share` of the reach on: a line of sight through a sphere of all of
 * these samples has this optical depth. */
static float opacity_beyond(const struct sp_default_samples *s, double least, double depth,
                            double reference) {
    double count = 0;
    for (int b = 0; b < BINS; b++)
        count += fabs(sp_default_value(s, b + 0.5)) >= least ? (double)s->histogram[b] : 0;
    const double width = cbrt(fmax(count, 8) * s->cell[0] * s->cell[1] * s->cell[2]);
    return (float)fmin(1 - exp(-depth * reference / width), 0.9);
}

void sp_default_show_signed(const struct sp_default_samples *s, struct sp_transfer_function *tf) {
    const double reach = reach_of(s), length = tf->reference_length;
    double least = 0.5;
    while (least > 0.06 && /* what shows is some hundredth of the samples, as far as possible */
           1 - share_near_zero(s, s->histogram, least * reach) < 0.02)
        least *= 0.8;
    const double a = least * reach, b = fmax(0.5 * (reach + a), a);
    const float faint = opacity_beyond(s, a, 1.2, length), dense = opacity_beyond(s, b, 4, length);
    tf->point_count = 0;
    add_point(tf, -reach, 0.55f, 0.85f, 1.00f, dense);
    add_point(tf, -b, 0.30f, 0.60f, 1.00f, dense);
    add_point(tf, -a, 0.20f, 0.35f, 0.85f, faint);
    add_point(tf, -0.8 * a, 0.20f, 0.30f, 0.75f, 0);
    add_point(tf, 0.8 * a, 0.75f, 0.20f, 0.15f, 0);
    add_point(tf, a, 0.85f, 0.25f, 0.15f, faint);
    add_point(tf, b, 1.00f, 0.55f, 0.15f, dense);
    add_point(tf, reach, 1.00f, 0.90f, 0.35f, dense);
}

/* Slopes at an even choice of samples, in world units and per voxel; returns how many there are.
 * Values near the ends are left out: level sets end there. */
static size_t sample_slopes(const struct sp_volume *volume, double *world, double *index,
                            size_t most) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    const uint32_t *dims = info->grid.dims;
    const void *voxels = sp_volume_voxels(volume);
    const uint64_t stride[3] = { 1, dims[0], (uint64_t)dims[0] * dims[1] };
    const uint64_t all = stride[2] * dims[2], step = 1 + all / (8 * most);
    const double ends = 0.9;
    size_t n = 0;
    for (uint64_t at = step / 2; at < all && n < most; at += step) {
        const uint32_t place[3] = { (uint32_t)(at % dims[0]), (uint32_t)(at / dims[0] % dims[1]),
                                    (uint32_t)(at / stride[2]) };
        const double value = sp_sample(voxels, info->type, at);
        double squares[2] = { 0, 0 };
        bool is_inside = value > ends * info->range[0] && value < ends * info->range[1];
        for (int a = 0; a < 3 && is_inside; a++) {
            is_inside = place[a] > 0 && place[a] + 1 < dims[a];
            if (!is_inside)
                break;
            const double slope = (sp_sample(voxels, info->type, at + stride[a]) -
                                  sp_sample(voxels, info->type, at - stride[a])) /
                                 2;
            squares[0] += slope * slope / (info->grid.spacing[a] * info->grid.spacing[a]);
            squares[1] += slope * slope;
        }
        if (is_inside && isfinite(squares[0])) {
            world[n] = sqrt(squares[0]);
            index[n++] = sqrt(squares[1]);
        }
    }
    return n;
}

/* True if most of the sorted slopes are the same: distances, in any unit. */
static bool are_even(const double *slopes, size_t n) {
    const double most = 0.8, usual = slopes[n / 2];
    size_t good = 0;
    for (size_t i = 0; i < n; i++)
        good += fabs(slopes[i] - usual) < 0.1 * usual;
    return (double)good >= most * (double)n;
}

/* The share of the border that has values above 0. Nearly 0 or 1: the surface is closed. */
static double share_outside(const struct sp_default_samples *s) {
    double outside = 0, all = 0;
    for (int f = 0; f < 6; f++)
        for (int b = 0; b < BINS; b++) {
            all += (double)s->faces[f][b];
            outside += sp_default_value(s, b + 0.5) > 0 ? (double)s->faces[f][b] : 0;
        }
    return all > 0 ? outside / all : 0.5;
}

bool sp_default_is_distance(const struct sp_volume *volume, const struct sp_default_samples *s,
                            double *per_voxel) {
    enum { SLOPES = 1 << 14, SLOPES_MIN = 64 };
    const struct sp_volume_info *info = s->info;
    const bool is_known = info->meaning != SP_MEANING_UNKNOWN;
    const double *spacing = info->grid.spacing;
    *per_voxel = fmin(spacing[0], fmin(spacing[1], spacing[2]));
    if (is_known && info->meaning != SP_MEANING_DISTANCE)
        return false;
    if (!(info->range[0] < 0 && info->range[1] > 0) || info->whole.dims[0] ||
        (!is_known && fabs(share_outside(s) - 0.5) < 0.4))
        return is_known;
    double *slopes = malloc(2 * SLOPES * sizeof *slopes), *index = slopes ? slopes + SLOPES : NULL;
    const size_t n = slopes ? sample_slopes(volume, slopes, index, SLOPES) : 0;
    bool is_even = false;
    if (n >= SLOPES_MIN) {
        qsort(slopes, n, sizeof *slopes, sp_compare_doubles);
        qsort(index, n, sizeof *index, sp_compare_doubles);
        is_even = are_even(slopes, n) || are_even(index, n);
        *per_voxel = index[n / 2] > 0 ? index[n / 2] : *per_voxel;
    }
    free(slopes);
    return is_known || is_even;
}

void sp_default_show_distance(const struct sp_default_samples *s, double per_voxel,
                              struct sp_view *view) {
    struct sp_transfer_function *tf = &view->transfer_function;
    const struct sp_volume_info *info = s->info;
    const double step = fmin(per_voxel, 0.25 * fmin(info->range[1], -info->range[0]));
    const struct sp_layer surface = sp_layer_default(SP_LAYER_SURFACE);
    view->layers[0] = surface;
    view->layers[0].value = 0;
    tf->point_count = 0;
    if (!(step > 0))
        return;
    const bool is_negative_inside = share_outside(s) >= 0.5;
    add_point(tf, -step, 0.90f, 0.85f, 0.75f, is_negative_inside ? 0.9f : 0);
    add_point(tf, 0, 0.90f, 0.85f, 0.75f, 0.45f);
    add_point(tf, step, 0.90f, 0.85f, 0.75f, is_negative_inside ? 0 : 0.9f);
}
