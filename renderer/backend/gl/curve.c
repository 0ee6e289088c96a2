/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/curve.h"

#include <stdlib.h>
#include <string.h>

#include "data/volume/missing.h"
#include "data/volume/volume.h"
#include "draw/footprints/post.h"

enum {
    NODES = SP_POST_NODES + 1,
    HEAD = 4,
    ROWS = HEAD + 2 * SP_TF_POINTS_MAX + SP_GRADIENT_POINTS_MAX + 3 * NODES
};

struct rows {
    struct sp_post_curve curve;
    double integral[NODES][4];
    float out[ROWS][4];
};

/* A sum in two floats, and the difference to the next node's. */
static void write_nodes(const struct rows *r, float (*out)[4]) {
    for (int n = 0; n < NODES; n++)
        for (int k = 0; k < 4; k++) {
            double sum = r->integral[n][k], next = r->integral[n + 1 < NODES ? n + 1 : n][k];
            float high = (float)sum;
            out[3 * n][k] = high;
            out[3 * n + 1][k] = (float)(sum - (double)high);
            out[3 * n + 2][k] = (float)(next - sum);
        }
}

static size_t write_rows(struct rows *r, float half) {
    const struct sp_post_curve *c = &r->curve;
    uint32_t counts[4] = { c->count, c->gradient_count, c->integral ? NODES : 0, 0 };
    float(*out)[4] = r->out + HEAD;
    memcpy(r->out[0], counts, sizeof counts);
    r->out[1][0] = (float)c->first_node;
    r->out[1][1] = (float)c->nodes_per_unit;
    r->out[1][2] = half;
    for (int end = 0; end < 2; end++)
        for (int k = 0; k < 4; k++)
            r->out[2 + end][k] = (float)c->ends[end][k];
    for (uint32_t i = 0; i < c->count; i++, out += 2) {
        memcpy(out[0], (float[4]){ c->value[i], c->inverse[i], c->opacity[i] }, sizeof out[0]);
        memcpy(out[1], c->color[i], sizeof c->color[i]);
    }
    for (uint32_t i = 0; i < c->gradient_count; i++, out++)
        memcpy(out[0], (float[4]){ c->magnitude[i], c->scale[i] }, sizeof out[0]);
    if (c->integral) {
        write_nodes(r, out);
        out += 3 * NODES;
    }
    return (size_t)(out - r->out);
}

bool gl_curve_update(struct gl_curve *curve, const struct sp_volume *volume, double base,
                     const struct sp_transfer_function *tf, double thickness,
                     struct sp_error *err) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    struct sp_gradient_grid gradient;
    sp_gradient_units_init(&gradient, info);
    float half = (float)(0.5 * thickness * gradient.unit);
    double range[2];
    sp_missing_limits(info, range);
    const double made_for[4] = { range[0], range[1], base, gradient.unit };
    if (curve->buffer.name && memcmp(curve->made_for, made_for, sizeof made_for) == 0 &&
        curve->half == half && sp_transfer_function_equal(&curve->tf, tf))
        return true;
    struct rows *r = calloc(1, sizeof *r);
    if (!r)
        return sp_fail(err, SP_ERR_MEMORY, "",
                       "out of memory for the transfer function's integral");
    sp_post_curve_init(&r->curve, tf, range, base, gradient.unit, r->integral);
    size_t rows = write_rows(r, half);
    bool ok =
        gl_buffer_reserve(&curve->buffer, "transfer function", sizeof r->out, 0, GL_USE_KEPT, err);
    if (ok) {
        gl_buffer_write(&curve->buffer, r->out, rows * sizeof r->out[0]);
        memcpy(curve->made_for, made_for, sizeof made_for);
        curve->tf = *tf;
        curve->half = half;
    }
    free(r);
    return ok;
}
