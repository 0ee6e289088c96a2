/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/cloud/cut.h"

#include <math.h>
#include <string.h>

enum {
    BLOCK = 1024,                 /* cells that one thread judges at a time */
    AHEAD = 16,                   /* cells that are read in advance: they lie apart in memory */
    LEVELS_MAX = 32,              /* of a tree */
    PLANES_MAX = SP_CUTS_MAX + 5, /* of clipping, the near plane, and sides of the image */
};

/* Parts of a kernel have their centres at most that far away [deviations]. */
static const float part_reach = 2;

/* What is before a plane cannot be seen: a point at p with normal·p + spread·deviation + offset < 0
 * in the world of the data. */
struct plane {
    float normal[3], length; /* of the normal */
    float spread, offset;
};

/* What is drawn of a cell. */
enum fate {
    HIDDEN, /* nothing */
    WHOLE,  /* its merged point */
    POINTS, /* the points of a leaf */
    DIVIDED /* cells inside */
};

struct verdict {
    uint32_t first, count; /* cells inside, or range of `order`; WHOLE: the cell, and 1 */
    enum fate fate;
    float depth; /* WHOLE */
};

/* How many cells inside, and points, a block of cells gives; then where they begin. */
struct block {
    uint32_t inside, chosen;
};

struct cut {
    const struct sp_cloud_tree *tree;
    const struct sp_cloud *cloud;
    const struct sp_voxel_frame *frame;
    float pixels;
    float grow; /* from a length of the data to units of the frame */
    uint32_t plane_count;
    struct plane planes[PLANES_MAX];
    /* By bin of the values: the first one from it on that has a visible value. */
    uint16_t next_visible[SP_CLOUD_BINS + 1];
    /* The level that is being judged. */
    const uint32_t *cells; /* [count] */
    uint32_t count;
    struct verdict *verdicts; /* by cell */
    struct block *blocks;     /* by BLOCK of them */
    uint32_t *inside;         /* the next level */
    struct sp_cloud_choice chosen;
};

/* True if no point of the cell can be seen, nor its merged one. */
static bool is_hidden(const struct cut *c, const struct sp_cloud_node *node) {
    const float *p = node->position;
    const float reach = sp_cloud_bound(node->reach), deviation = sp_cloud_bound(node->deviation);
    if (c->next_visible[node->low] > node->high)
        return true;
    for (uint32_t i = 0; i < c->plane_count; i++) {
        const struct plane *plane = &c->planes[i];
        const float most = plane->normal[0] * p[0] + plane->normal[1] * p[1] +
                           plane->normal[2] * p[2] + plane->length * reach +
                           plane->spread * deviation + plane->offset;
        if (most < 0)
            return true;
    }
    return false;
}

/* True if the cell is at most as wide as it may be: at its nearest, a diagonal before its merged
 * point. */
static bool is_small(const struct cut *c, const struct sp_cloud_node *node) {
    const float *p = node->position, *row = c->cloud->place[2];
    const float side = node->cell.side * c->grow, diagonal = 1.7321f;
    const float scale = c->frame->ewa.scale;
    if (c->frame->ewa.projection == SP_ORTHOGRAPHIC)
        return side * scale <= c->pixels;
    float u2 = row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + c->cloud->offset[2];
    return side * scale <= c->pixels * (u2 - diagonal * side);
}

/* True if the merged point is drawn instead of the points inside the cell. A cell of one point is
 * always drawn so. */
static bool is_whole(const struct cut *c, const struct sp_cloud_node *node) {
    return (node->cell.is_leaf && node->cell.count == 1) || is_small(c, node);
}

/* True if one of the values that a merged point is classified by may be visible. */
static bool is_visible(const struct cut *c, const struct sp_cloud_node *node) {
    const float far = sp_cloud_share_at[SP_CLOUD_SHARES - 1] * sp_cloud_spread(c->tree, node);
    const uint32_t low = sp_cloud_bin(c->tree, node->value - far);
    return c->next_visible[low] <= sp_cloud_bin(c->tree, node->value + far);
}

static struct verdict judge(const struct cut *c, uint32_t cell) {
    const struct sp_cloud_node *node = &c->tree->nodes[cell];
    const struct sp_cloud_cell *at = &node->cell;
    struct verdict verdict = { .first = at->first, .count = at->count };
    if (!at->count || is_hidden(c, node))
        return (struct verdict){ .fate = HIDDEN };
    if (!is_whole(c, node)) {
        verdict.fate = at->is_leaf ? POINTS : DIVIDED;
        return verdict;
    }
    const struct sp_cloud_element e = { node->position, node->factor, &node->value, &node->volume };
    if (!is_visible(c, node) ||
        !((verdict.depth = sp_cloud_depth(c->cloud, c->frame, &e)) < INFINITY))
        return (struct verdict){ .fate = HIDDEN };
    verdict.fate = WHOLE;
    verdict.first = cell;
    verdict.count = 1;
    return verdict;
}

static void judge_cells(void *user, size_t begin, size_t end, unsigned worker) {
    const struct cut *c = user;
    struct block *block = &c->blocks[begin / BLOCK];
    (void)worker;
    *block = (struct block){ 0 };
    for (size_t i = begin; i < end; i++) {
        if (i + AHEAD < end)
            __builtin_prefetch(&c->tree->nodes[c->cells[i + AHEAD]]);
        const struct verdict verdict = c->verdicts[i] = judge(c, c->cells[i]);
        *(verdict.fate == DIVIDED ? &block->inside : &block->chosen) += verdict.count;
    }
}

static void write_cells(void *user, size_t begin, size_t end, unsigned worker) {
    const struct cut *c = user;
    struct block at = c->blocks[begin / BLOCK];
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const struct verdict *verdict = &c->verdicts[i];
        if (i + AHEAD < end && c->verdicts[i + AHEAD].fate == POINTS)
            __builtin_prefetch(&c->tree->order[c->verdicts[i + AHEAD].first]);
        switch (verdict->fate) {
        case DIVIDED:
            for (uint32_t k = 0; k < verdict->count; k++)
                c->inside[at.inside++] = verdict->first + k;
            continue;
        case WHOLE:
            c->chosen.elements[at.chosen] = c->cloud->elements->shape.count + verdict->first;
            c->chosen.depths[at.chosen] = verdict->depth;
            break;
        case POINTS:
            for (uint32_t k = 0; k < verdict->count; k++)
                c->chosen.elements[at.chosen + k] = c->tree->order[verdict->first + k];
            break;
        case HIDDEN:
            break;
        }
        at.chosen += verdict->count;
    }
}

/* The factor by which the placement stretches lengths, in the mean. */
static float compute_growth(const struct sp_cloud *cloud) {
    float square = 0;
    for (int k = 0; k < 9; k++)
        square += cloud->place[k / 3][k % 3] * cloud->place[k / 3][k % 3];
    return sqrtf(square / 3);
}

/* Adds a plane of the frame: before it is what has n·u + spread·deviation + offset < 0. Rounding
 * must not hide what can be seen. */
static void add_plane(struct cut *c, const float n[3], float spread, float offset) {
    const struct sp_cloud *cloud = c->cloud;
    const struct sp_cloud_node *root = &c->tree->nodes[0];
    struct plane *to = &c->planes[c->plane_count++];
    float square = 0, sum = fabsf(offset);
    *to = (struct plane){ .spread = spread, .offset = offset };
    for (int r = 0; r < 3; r++) {
        to->offset += n[r] * cloud->offset[r];
        sum += fabsf(n[r] * cloud->offset[r]);
    }
    for (int a = 0; a < 3; a++) {
        for (int r = 0; r < 3; r++)
            to->normal[a] += n[r] * cloud->place[r][a];
        square += to->normal[a] * to->normal[a];
        sum += fabsf(to->normal[a]) * (fabsf(root->position[a]) + sp_cloud_bound(root->reach));
    }
    to->length = sqrtf(square);
    to->offset += 1e-5f * sum;
}

/* At least the factor by which the placement stretches any length: the root of the largest sum of a
 * row of P·Pᵀ. */
static float bound_growth(const struct sp_cloud *cloud) {
    float most = 0;
    for (int r = 0; r < 3; r++) {
        float sum = 0;
        for (int k = 0; k < 3; k++) {
            const float *a = cloud->place[r], *b = cloud->place[k];
            sum += fabsf(a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
        }
        most = fmaxf(most, sum);
    }
    return sqrtf(most);
}

/* Adds the plane of a side of the image, along its axis. A kernel with the deviation σ at u has a
 * footprint of at most r·(|J|·σ + h) px to each side of its centre (splat/ewa.h), whose distance
 * from the side is `sign`·scale·u[axis] + border·u[2]; orthographic: without u[2]. */
static void add_side(struct cut *c, int axis, float sign, float border) {
    const struct sp_ewa_frame *f = &c->frame->ewa;
    const bool is_flat = f->projection == SP_ORTHOGRAPHIC;
    const float *most = f->ratio_max, ratio2 = is_flat ? 0 : most[axis] * most[axis];
    const float wide = border + f->radius * sqrtf(f->lowpass2);
    const float jacobian = f->scale * sqrtf(1 + ratio2);
    const float n[3] = { axis ? 0 : sign * f->scale, axis ? sign * f->scale : 0,
                         is_flat ? 0 : wide };
    const float length = sqrtf(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    const float kernel = c->cloud->size * bound_growth(c->cloud);
    const float parts = c->cloud->parts > 1 ? part_reach * length : 0;
    add_plane(c, n, kernel * (f->radius * jacobian + parts), is_flat ? wide : 0);
}

static void list_planes(struct cut *c) {
    const struct sp_ewa_frame *f = &c->frame->ewa;
    for (uint32_t i = 0; i < f->clip.count; i++)
        add_plane(c, f->clip.planes[i].normal, 0, -f->clip.planes[i].offset);
    add_plane(c, (const float[3]){ 0, 0, 1 },
              sp_cloud_reach(c->cloud, c->frame) * c->cloud->size * bound_growth(c->cloud),
              -f->near);
    for (int axis = 0; axis < 2; axis++) {
        add_side(c, axis, 1, f->centre[axis]);
        add_side(c, axis, -1, (float)f->size[axis] - f->centre[axis]);
    }
}

/* Marks which bins have visible values. Those at both ends have all values beyond. */
static void mark_visible(struct cut *c, const struct sp_visible_ranges *visible) {
    const struct sp_cloud_tree *tree = c->tree;
    const double rounding = 0.01;
    c->next_visible[SP_CLOUD_BINS] = SP_CLOUD_BINS;
    for (uint32_t k = SP_CLOUD_BINS; k-- > 0;) {
        const bool is_last = k == SP_CLOUD_BINS - 1 || !(tree->bin > 0);
        const double low = k ? tree->low + (k - rounding) * tree->bin : -INFINITY;
        const double high = is_last ? INFINITY : tree->low + (k + 1 + rounding) * tree->bin;
        const bool is_visible = !visible || sp_visible_ranges_overlap(visible, low, high);
        c->next_visible[k] = is_visible ? (uint16_t)k : c->next_visible[k + 1];
    }
}

static bool allocate(struct sp_arena *arena, uint32_t count, struct sp_cloud_choice *choice) {
    choice->count = count;
    choice->elements = sp_arena_alloc(arena, "points", count + (size_t)1, sizeof *choice->elements);
    choice->depths = sp_arena_alloc(arena, "points", count + (size_t)1, sizeof *choice->depths);
    return choice->elements && choice->depths;
}

/* Judges the cells of a level: what is drawn of them, and the `inside` cells of the next level. */
static bool cut_level(struct cut *c, struct sp_pool *pool, struct sp_arena *arena,
                      uint32_t *inside) {
    const uint32_t blocks = (c->count + BLOCK - 1) / BLOCK;
    uint32_t chosen = *inside = 0;
    c->verdicts = sp_arena_alloc(arena, "cells of points", c->count, sizeof *c->verdicts);
    c->blocks = sp_arena_alloc(arena, "cells of points", blocks, sizeof *c->blocks);
    if (!c->verdicts || !c->blocks)
        return false;
    sp_parallel_for(pool, c->count, BLOCK, judge_cells, c);
    for (uint32_t b = 0; b < blocks; b++) {
        const struct block had = c->blocks[b];
        c->blocks[b] = (struct block){ *inside, chosen };
        *inside += had.inside;
        chosen += had.chosen;
    }
    c->inside = sp_arena_alloc(arena, "cells of points", *inside + (size_t)1, sizeof *c->inside);
    if (!c->inside || !allocate(arena, chosen, &c->chosen))
        return false;
    sp_parallel_for(pool, c->count, BLOCK, write_cells, c);
    return true;
}

/* Joins what is drawn of the levels. */
static bool join(const struct sp_cloud_choice *levels, uint32_t count, uint32_t total,
                 struct sp_arena *arena, struct sp_cloud_choice *choice) {
    uint32_t at = 0;
    if (!allocate(arena, total, choice))
        return false;
    for (uint32_t i = 0; i < count; at += levels[i++].count) {
        const struct sp_cloud_choice *level = &levels[i];
        memcpy(choice->elements + at, level->elements, level->count * sizeof *level->elements);
        memcpy(choice->depths + at, level->depths, level->count * sizeof *level->depths);
    }
    return true;
}

bool sp_cloud_cut(const struct sp_cloud_cut *in, struct sp_pool *pool, struct sp_arena *arena,
                  struct sp_cloud_choice *choice) {
    struct cut c = { .tree = in->tree,
                     .cloud = in->cloud,
                     .frame = in->frame,
                     .pixels = in->pixels,
                     .grow = compute_growth(in->cloud) };
    list_planes(&c);
    mark_visible(&c, in->visible);
    struct sp_cloud_choice levels[LEVELS_MAX];
    static const uint32_t root = 0;
    uint32_t level = 0, total = 0;
    c.cells = &root;
    c.count = 1;
    while (c.count > 0 && level < LEVELS_MAX) {
        uint32_t inside;
        if (!cut_level(&c, pool, arena, &inside))
            return false;
        levels[level++] = c.chosen;
        total += c.chosen.count;
        c.cells = c.inside;
        c.count = inside;
    }
    return join(levels, level, total, arena, choice);
}
