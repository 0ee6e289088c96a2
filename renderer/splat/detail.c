/* SPDX-License-Identifier: Apache-2.0 */
#include "splat/detail.h"

#include <math.h>

#include "classify/visible.h"
#include "splat/adaptive.h"

struct choice {
    const struct sp_detail_job *job;
    struct sp_detail *detail;
    double size; /* the largest extent of a voxel in the image [px]; perspective: multiplied by its
                    distance */
    double depth[3], base; /* u2 = base + Σ depth·distance along the axis */
    double most[32];       /* px of a cell, by level */
};

unsigned sp_detail_levels(const uint32_t dims[3], unsigned most) {
    uint32_t longest = dims[0] > dims[1] ? dims[0] : dims[1];
    longest = longest > dims[2] ? longest : dims[2];
    unsigned levels = 1;
    while (levels < most && sp_detail_cells(longest, levels - 1) > SP_BRICK)
        levels++;
    return levels;
}

bool sp_detail_is_possible(const struct sp_view *view) {
    enum sp_filter_mode mode = view->filter.mode;
    return view->level_of_detail == SP_LOD_AUTO && view->transfer_function.order == SP_TF_PRE &&
           view->filter.kernel == SP_KERNEL_GAUSSIAN &&
           (mode == SP_FILTER_EWA || mode == SP_FILTER_ADAPTIVE || mode == SP_FILTER_LOWPASS);
}

double sp_detail_pixels(const struct sp_view *view, const struct sp_grid *grid, unsigned level) {
    const struct sp_transfer_function *tf = &view->transfer_function;
    double deepest = 0, radius[2];
    sp_kernel_radii(grid, 1, radius);
    for (uint32_t i = 0; i < tf->point_count; i++)
        deepest = fmax(deepest, -log1p(-(double)tf->points[i].opacity));
    double depth = ldexp(deepest * radius[1] / tf->reference_length, (int)level);
    return depth <= SP_DETAIL_THIN ? SP_DETAIL_THIN_PIXELS : SP_DETAIL_PIXELS;
}

struct sp_filter sp_detail_filter(const struct sp_filter *filter, unsigned level,
                                  bool is_enlarged) {
    struct sp_filter own = *filter;
    if (level == 0 || is_enlarged || filter->kernel != SP_KERNEL_GAUSSIAN)
        return own;
    double cell = ldexp(1, (int)level),
           left = filter->sigma * filter->sigma - (cell * cell - 1) / 12;
    own.sigma = fmax(SP_DETAIL_SIGMA, sqrt(fmax(0, left)) / cell);
    return own;
}

/* Returns the largest extent that a voxel of the box can have in the image. */
static double voxel_size(const struct choice *c, const uint32_t first[3], const uint32_t last[3]) {
    const struct sp_grid *grid = c->job->grid;
    double nearest = c->base;
    for (unsigned a = 0; a < 3; a++)
        nearest += fmin(c->depth[a] * sp_grid_distance(grid, a, first[a]),
                        c->depth[a] * sp_grid_distance(grid, a, last[a]));
    if (c->job->camera->projection == SP_ORTHOGRAPHIC)
        return c->size;
    return nearest > 0 ? c->size / nearest : INFINITY;
}

static void add(struct choice *c, unsigned level, uint32_t brick, bool is_enlarged) {
    c->detail->bricks[c->detail->count++] =
        (struct sp_detail_brick){ brick, (uint8_t)level, is_enlarged };
    c->detail->levels |= 1u << level;
}

/* Adds the brick of a level or, where it is too coarse, its bricks of finer levels. The recursion
 * is at most as deep as there are levels. */
static void visit(struct choice *c, unsigned level, const uint32_t place[3]) {
    const struct sp_grid *grid = c->job->grid;
    uint32_t first[3], last[3], bricks[3];
    for (unsigned a = 0; a < 3; a++) {
        uint64_t side = (uint64_t)SP_BRICK << level, end = (place[a] + UINT64_C(1)) * side;
        bricks[a] = (sp_detail_cells(grid->dims[a], level) + SP_BRICK - 1) >> SP_BRICK_SHIFT;
        if (place[a] >= bricks[a])
            return;
        first[a] = (uint32_t)(place[a] * side);
        last[a] = (uint32_t)(end < grid->dims[a] ? end : grid->dims[a]) - 1;
    }
    bool is_small = ldexp(voxel_size(c, first, last), (int)level) <= c->most[level];
    if (is_small || level == c->job->floor) {
        add(c, level, place[0] + bricks[0] * (place[1] + bricks[1] * place[2]), !is_small);
        return;
    }
    for (uint32_t i = 0; i < 8; i++)
        visit(c, level - 1,
              (uint32_t[3]){ 2 * place[0] + (i & 1), 2 * place[1] + (i >> 1 & 1),
                             2 * place[2] + (i >> 2) });
}

static void init_choice(struct choice *c) {
    const struct sp_camera_transform *camera = c->job->camera;
    const struct sp_grid *grid = c->job->grid;
    double radius[2], tangent2 = 0;
    sp_kernel_radii(grid, 1, radius);
    for (int a = 0; a < 3; a++) {
        for (int r = 0; r < 3; r++)
            c->depth[a] += camera->w.m[2][r] * grid->direction[r][a];
        c->base += camera->w.m[2][a] * (grid->origin[a] - camera->eye.v[a]);
    }
    for (int i = 0; camera->projection == SP_PERSPECTIVE && i < 2; i++)
        tangent2 += camera->tan_half[i] * camera->tan_half[i];
    c->size = camera->scale * radius[1] * sqrt(1 + tangent2);
    for (unsigned l = 0; l < c->job->levels && sp_detail_is_possible(c->job->view); l++)
        c->most[l] = sp_detail_pixels(c->job->view, grid, l) * c->job->view->filter.lowpass;
}

bool sp_detail_choose(const struct sp_detail_job *job, struct sp_arena *arena,
                      struct sp_detail *detail) {
    struct choice c = { .job = job, .detail = detail };
    uint64_t most = 1;
    uint32_t top[3];
    unsigned highest = job->levels - 1;
    bool is_free = sp_detail_is_possible(job->view);
    if (!is_free)
        highest = job->floor;
    for (int a = 0; a < 3; a++) {
        most *= (sp_detail_cells(job->grid->dims[a], job->floor) + SP_BRICK - 1) >> SP_BRICK_SHIFT;
        top[a] = (sp_detail_cells(job->grid->dims[a], highest) + SP_BRICK - 1) >> SP_BRICK_SHIFT;
    }
    *detail = (struct sp_detail){ 0 };
    detail->bricks = sp_arena_alloc(arena, "bricks by level", most, sizeof *detail->bricks);
    if (!detail->bricks)
        return false;
    init_choice(&c);
    for (uint32_t b2 = 0; b2 < top[2]; b2++)
        for (uint32_t b1 = 0; b1 < top[1]; b1++)
            for (uint32_t b0 = 0; b0 < top[0]; b0++)
                visit(&c, highest, (uint32_t[3]){ b0, b1, b2 });
    return true;
}
