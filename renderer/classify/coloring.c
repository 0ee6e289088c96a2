/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/coloring.h"

#include <math.h>
#include <string.h>

#include "data/volume/sample.h"

/* Where the samples of a volume lie in the whole. */
static struct sp_whole_part part_of(const struct sp_volume_info *info) {
    struct sp_whole_part part = info->whole.part;
    for (int a = 0; a < 3; a++)
        part.step[a] = part.step[a] > 0 ? part.step[a] : 1;
    return part;
}

void sp_coloring_init(struct sp_coloring *c, const struct sp_layer *layer,
                      const struct sp_transfer_function *tf, struct sp_volume *drawn,
                      struct sp_volume *colors) {
    *c = (struct sp_coloring){ .by_length = strcmp(layer->color_by, SP_COLOR_BY_LENGTH) == 0 };
    c->volume = c->by_length ? drawn : colors;
    if (!c->volume)
        return;
    const struct sp_volume_info *info = sp_volume_info(c->volume), *own = sp_volume_info(drawn);
    c->is_part = info->elements.kind == SP_KIND_GRID && c->volume != drawn &&
                 (info->whole.dims[0] || own->whole.dims[0]);
    c->drawn = part_of(own);
    c->own = part_of(info);
    memcpy(c->dims, own->grid.dims, sizeof c->dims);
    double high = isnan(layer->color_high) ? c->by_length ? info->longest : info->range[1]
                                           : layer->color_high;
    c->low = isnan(layer->color_low) ? c->by_length ? 0 : info->range[0] : layer->color_low;
    c->first = tf->points[0].value;
    c->scale =
        high > c->low ? (tf->points[tf->point_count - 1].value - c->first) / (high - c->low) : 0;
}

bool sp_coloring_equal(const struct sp_coloring *a, const struct sp_coloring *b) {
    return a->volume == b->volume && a->by_length == b->by_length && a->low == b->low &&
           a->scale == b->scale && a->first == b->first && a->is_part == b->is_part &&
           memcmp(a->drawn.first, b->drawn.first, sizeof a->drawn.first) == 0 &&
           memcmp(a->drawn.step, b->drawn.step, sizeof a->drawn.step) == 0 &&
           memcmp(a->dims, b->dims, sizeof a->dims) == 0;
}

/* The samples [*begin, *end) of the volume that lie in sample i of the shown one, along an axis;
 * the nearest one if none does. */
static void map_samples(const struct sp_coloring *c, int axis, uint64_t i, uint32_t *begin,
                        uint32_t *end) {
    const uint32_t count = sp_volume_info(c->volume)->grid.dims[axis];
    const double step = c->drawn.step[axis] / c->own.step[axis];
    const double first = (double)(c->drawn.first[axis] + i) * step - c->own.first[axis];
    *begin = (uint32_t)fmin(fmax(floor(first), 0), count - 1.0);
    *end = (uint32_t)fmin(fmax(floor(first + step), 0), count);
    *end = *end > *begin ? *end : *begin + 1;
}

/* The mean of the finite samples that lie in sample `at` of the shown volume; NaN = there is none.
 */
static double mean_at(const struct sp_coloring *c, uint64_t at) {
    const struct sp_volume_info *info = sp_volume_info(c->volume);
    const void *voxels = sp_volume_voxels(c->volume);
    const uint32_t *dims = info->grid.dims;
    uint32_t begin[3], end[3];
    double sum = 0;
    uint64_t count = 0;
    for (int a = 0; a < 3; a++, at /= c->dims[a - 1])
        map_samples(c, a, at % c->dims[a], &begin[a], &end[a]);
    for (uint32_t z = begin[2]; z < end[2]; z++)
        for (uint32_t y = begin[1]; y < end[1]; y++)
            for (uint32_t x = begin[0]; x < end[0]; x++) {
                const double value =
                    sp_sample(voxels, info->type, ((uint64_t)z * dims[1] + y) * dims[0] + x);
                sum += isfinite(value) ? value : 0;
                count += isfinite(value);
            }
    return count ? sum / (double)count : (double)NAN;
}

static double number_at(const struct sp_coloring *c, uint64_t at) {
    const struct sp_elements *e = sp_volume_elements(c->volume);
    if (c->by_length) {
        const float *v = sp_volume_vectors(c->volume)[at];
        return sqrt((double)v[0] * (double)v[0] + (double)v[1] * (double)v[1] +
                    (double)v[2] * (double)v[2]);
    }
    if (c->is_part)
        return mean_at(c, at);
    return e ? (double)e->values[at]
             : sp_sample(sp_volume_voxels(c->volume), sp_volume_info(c->volume)->type, at);
}

double sp_coloring_value(const struct sp_coloring *c, uint64_t at) {
    const double number = number_at(c, at);
    return isfinite(number) ? c->first + (number - c->low) * c->scale : c->first;
}
