/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/coloring.h"

#include <math.h>
#include <string.h>

#include "volume/sample.h"

void sp_coloring_init(struct sp_coloring *c, const struct sp_layer *layer,
                      const struct sp_transfer_function *tf, struct sp_volume *shown,
                      struct sp_volume *colors) {
    *c = (struct sp_coloring){ .by_length = strcmp(layer->color_by, SP_COLOR_BY_LENGTH) == 0 };
    c->volume = c->by_length ? shown : colors;
    if (!c->volume)
        return;
    const struct sp_volume_info *info = sp_volume_info(c->volume);
    double high = isnan(layer->color_high) ? c->by_length ? info->longest : info->range[1]
                                           : layer->color_high;
    c->low = isnan(layer->color_low) ? c->by_length ? 0 : info->range[0] : layer->color_low;
    c->first = tf->points[0].value;
    c->scale =
        high > c->low ? (tf->points[tf->point_count - 1].value - c->first) / (high - c->low) : 0;
}

bool sp_coloring_equal(const struct sp_coloring *a, const struct sp_coloring *b) {
    return a->volume == b->volume && a->by_length == b->by_length && a->low == b->low &&
           a->scale == b->scale && a->first == b->first;
}

static double number_at(const struct sp_coloring *c, uint64_t at) {
    const struct sp_elements *e = sp_volume_elements(c->volume);
    if (c->by_length) {
        const float *v = sp_volume_vectors(c->volume)[at];
        return sqrt((double)v[0] * (double)v[0] + (double)v[1] * (double)v[1] +
                    (double)v[2] * (double)v[2]);
    }
    return e ? (double)e->values[at]
             : sp_sample(sp_volume_voxels(c->volume), sp_volume_info(c->volume)->type, at);
}

double sp_coloring_value(const struct sp_coloring *c, uint64_t at) {
    const double number = number_at(c, at);
    return isfinite(number) ? c->first + (number - c->low) * c->scale : c->first;
}
