/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/resample_constants.h"

#include <math.h>
#include <string.h>

#include "draw/resample/rays.h"

static void write_axes(struct gl_resample_constants *c, const struct sp_resample *r) {
    uint32_t row = 0;
    for (int a = 0; a < 3; a++) {
        const struct sp_resample_axis *from = &r->axes[a];
        struct gl_resample_axis *to = &c->axes[a];
        to->rows[0] = r->samples->dims[a];
        to->scale[3] = sp_resample_reference(r, a);
        if (!from->place)
            continue;
        to->scale[0] = from->first;
        to->scale[1] = from->steps_per_place;
        to->scale[2] = from->widest;
        to->rows[1] = (uint32_t)from->steps;
        to->rows[2] = row;
        to->rows[3] = row + r->samples->dims[a];
        row = to->rows[3] + (uint32_t)from->steps + 1;
    }
}

static void write_halves(struct gl_resample_constants *c, const struct sp_resample *r) {
    for (uint32_t h = 0; h < r->half_count; h++)
        for (int a = 0; a < 3; a++) {
            const struct sp_resample_half *half = &r->halves[h];
            double reference = (double)sp_resample_reference(r, a);
            c->halves[h][a] = (float)half->normal[a];
            c->gaps[h][a] = (float)(half->offset - half->normal[a] * reference);
            c->faces[h][a] = half->face[a];
        }
}

/* Relates depths in camera space to s. */
static void write_depths(struct gl_resample_constants *c, const struct sp_resample *r) {
    const int axis = r->axis;
    double inside = ((double)sp_resample_reference(r, axis) - r->eye[axis]) / r->ray[axis];
    c->metric[1][3] = (float)inside;
    for (int a = 0; a < 3; a++) {
        double place = r->eye[a] + (double)c->metric[1][3] * r->ray[a];
        c->depths[a][0] = (float)(place - (double)sp_resample_reference(r, a));
        c->depths[a][1] = (float)r->ray[a];
        c->depths[a][2] = (float)r->right[a];
        c->depths[a][3] = (float)r->down[a];
    }
}

/* The base of codes: of integers as an integer and a rest, of reals as two floats. */
static void write_base(struct gl_resample_constants *c, const struct sp_resample *r) {
    enum sp_type type = r->samples->type;
    double base = r->curve.base;
    float high = (float)base;
    c->code_scale[1] = high;
    c->code_scale[2] = (float)(base - (double)high);
    if (type == SP_FLOAT32 || type == SP_FLOAT64)
        return;
    double whole = fmin(fmax(floor(base), INT32_MIN), INT32_MAX);
    c->base[0] = (int32_t)whole;
    c->code_scale[2] = (float)(base - whole);
}

static void write_reduction(struct gl_resample_constants *c, const struct sp_reduction *r) {
    const float numbers[2][4] = { { r->sign, r->start, r->full, r->zero },
                                  { r->absorption, r->gain, r->offset } };
    const int32_t choices[4] = { r->is_extreme, r->is_mean, r->leaves_out };
    memcpy(c->numbers, numbers, sizeof numbers);
    memcpy(c->choices, choices, sizeof choices);
}

void gl_resample_constants_init(struct gl_resample_constants *c, const struct sp_resample *r) {
    const struct sp_transfer_function *tf = &r->view->transfer_function;
    *c = (struct gl_resample_constants){ 0 };
    for (int i = 0; i < 3; i++)
        memcpy(c->to_world[i], r->to_world[i], sizeof r->to_world[i]);
    for (int i = 0; i < 6; i++)
        c->metric[i / 3][i % 3] = (float)r->metric[i];
    c->metric[0][3] = r->rounding;
    c->smoothing[0] = r->noise_square;
    c->smoothing[1] = r->keep_max;
    c->smoothing[2] = r->is_smoothed ? 1 : 0;
    write_depths(c, r);
    memcpy(c->steep, r->steep, sizeof r->steep);
    write_base(c, r);
    c->code_scale[0] = (float)r->curve.codes_per_unit;
    c->code_scale[3] = r->lowest;
    memcpy(c->bin_scale,
           (float[]){ r->curve.bins_per_code, r->curve.first_bin, r->curve.visible[0],
                      r->curve.visible[1] },
           sizeof c->bin_scale);
    memcpy(c->above_bins, r->curve.above, sizeof c->above_bins);
    write_reduction(c, &r->reduction);
    c->base[1] = r->is_linear;
    c->base[2] = (int32_t)r->half_count;
    c->base[3] = (int32_t)tf->gradient_count;
    memcpy(c->regions, r->samples->regions, sizeof r->samples->regions);
    c->regions[3] = r->class->axis;
    c->size[0] = (uint32_t)r->columns;
    write_axes(c, r);
    write_halves(c, r);
    c->size[2] = (uint32_t)r->silhouette.count;
    for (int i = 0; i < r->silhouette.count; i++)
        for (int k = 0; k < 3; k++)
            c->sides[i][k] = (float)r->silhouette.line[i][k];
    for (uint32_t i = 0; i < tf->gradient_count; i++) {
        c->magnitudes[i][0] = (float)(tf->gradient[i].magnitude / (double)r->gradient_unit);
        c->magnitudes[i][1] = tf->gradient[i].scale;
    }
}

struct builder {
    const struct sp_resample *r;
    struct gl_resample_squares *to; /* its squares are NULL while they are counted */
};

static void write_square(struct gl_resample_square *to, const struct sp_resample_rays *rays) {
    *to =
        (struct gl_resample_square){ .kind = { 0, rays->axis[2], rays->is_backwards, rays->sheets },
                                     .fall = { (float)rays->fall[0], (float)rays->fall[1],
                                               (float)rays->lever },
                                     .centre = { (float)rays->centre[0], (float)rays->centre[1] } };
    for (int a = 0; a < 2; a++) {
        to->at[a] = (float)rays->at[a];
        to->at[a + 2] = (float)rays->change[a];
        to->turn[a] = (float)rays->right[a];
        to->turn[a + 2] = (float)rays->down[a];
    }
}

/* Writes square number i, and its parts behind all others. */
static void add_square(const struct builder *b, uint32_t i, int x, int y, int side) {
    int right = (int)b->r->frame->width - x, below = (int)b->r->frame->height - y;
    const int place[4] = { x, y, right < side ? right : side, below < side ? below : side };
    struct gl_resample_square *to = b->to->squares ? &b->to->squares[i] : NULL;
    struct sp_resample_rays rays;
    if (to)
        *to = (struct gl_resample_square){ 0 };
    if (right <= 0 || below <= 0)
        return;
    sp_resample_rays_init(&rays, b->r, place);
    if (rays.is_too_wide && side > RESAMPLE_BLOCK) {
        uint32_t first = b->to->count;
        b->to->count += 4;
        for (int k = 0; k < 4; k++)
            add_square(b, first + (uint32_t)k, x + (k & 1) * side / 2, y + (k >> 1) * side / 2,
                       side / 2);
        if (to)
            to->kind[0] = (int32_t)first;
        return;
    }
    int slices = (int)b->r->samples->dims[rays.axis[2]];
    b->to->slices = slices > b->to->slices ? slices : b->to->slices;
    b->to->sheets |= rays.sheets;
    if (to)
        write_square(to, &rays);
}

static void add_squares(const struct builder *b) {
    int columns = b->r->columns, rows = b->r->rows;
    b->to->count = (uint32_t)(columns * rows);
    for (int i = 0; i < columns * rows; i++)
        add_square(b, (uint32_t)i, i % columns * RESAMPLE_TILE, i / columns * RESAMPLE_TILE,
                   RESAMPLE_TILE);
}

bool gl_resample_squares_init(struct gl_resample_squares *squares, const struct sp_resample *r,
                              struct sp_arena *arena) {
    const struct builder builder = { r, squares };
    *squares = (struct gl_resample_squares){ NULL };
    add_squares(&builder);
    squares->squares =
        sp_arena_alloc(arena, "squares of pixels", squares->count, sizeof *squares->squares);
    if (!squares->squares)
        return false;
    add_squares(&builder);
    return true;
}
