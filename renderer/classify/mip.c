/* SPDX-License-Identifier: Apache-2.0 */
#include "classify/mip.h"

#include <stdlib.h>
#include <string.h>

#include "classify/gradient.h"
#include "data/volume/grid.h"

/* Returns the distance from sample 0 to the start of cell i along an axis; i = dims: to the end of
 * the last cell. */
static double face(const struct sp_grid *grid, unsigned axis, uint32_t i) {
    double extent[2];
    if (i > 0 && i < grid->dims[axis])
        return 0.5 * (sp_grid_distance(grid, axis, i - 1) + sp_grid_distance(grid, axis, i));
    sp_grid_extent(grid, axis, extent);
    return extent[i > 0];
}

/* Returns the middle of coarse cell i, which joins the fine cells 2·i and 2·i + 1. The last fine
 * cell may be missing. */
static double middle(const struct sp_grid *fine, unsigned axis, uint32_t i) {
    uint32_t end = 2 * i + 2 < fine->dims[axis] ? 2 * i + 2 : fine->dims[axis];
    return 0.5 * (face(fine, axis, 2 * i) + face(fine, axis, end));
}

static bool place_samples(struct sp_level *coarse, const struct sp_grid *fine, unsigned axis,
                          struct sp_error *err) {
    uint32_t n = coarse->grid.dims[axis];
    double *c = malloc(n * sizeof *c), first = middle(fine, axis, 0);
    if (!c)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for %u coordinates", n);
    for (uint32_t i = 0; i < n; i++)
        c[i] = middle(fine, axis, i) - first;
    coarse->grid.coordinates[axis] = coarse->coordinates[axis] = c;
    coarse->grid.spacing[axis] =
        n > 1 ? c[n - 1] / (n - 1) : face(fine, axis, fine->dims[axis]) - face(fine, axis, 0);
    return true;
}

bool sp_mip_grid(struct sp_level *coarse, const struct sp_grid *fine, struct sp_error *err) {
    struct sp_grid *grid = &coarse->grid;
    *grid = *fine;
    for (unsigned a = 0; a < 3; a++) {
        grid->dims[a] = (fine->dims[a] + 1) / 2;
        grid->spacing[a] = 2 * fine->spacing[a];
        double first = 0.5 * fine->spacing[a];
        if (fine->coordinates[a]) {
            if (!place_samples(coarse, fine, a, err))
                return false;
            first = middle(fine, a, 0);
        }
        for (int r = 0; r < 3; r++)
            grid->origin[r] += fine->direction[r][a] * first;
    }
    return true;
}

/* The sums over the eight voxels of a cell. */
struct sum {
    float depth, color[3]; /* order post: share, value in color[0] */
    union {
        struct sp_microflakes_sum microflakes;
        float gradient[3]; /* order post */
    };
};

/* The cells of one brick; all zero between bricks. */
struct cells {
    struct sum sums[SP_BRICK_VOXELS];
    uint64_t used[SP_BRICK_VOXELS / 64]; /* a bit per cell */
};

struct merge {
    const struct sp_level *fine;
    struct sp_level *coarse;
    struct cells *cells; /* one per worker */
    bool is_post;        /* order post: scalars, not classes */
    const struct sp_classify_job *job;
};

/* Size of a fine voxel along an axis, divided by the size of the coarse voxel that contains it. */
static float size_share(const struct merge *m, unsigned axis, uint32_t i) {
    return (float)(sp_grid_local_spacing(&m->fine->grid, axis, i) /
                   sp_grid_local_spacing(&m->coarse->grid, axis, i / 2));
}

/* The fine bricks of a coarse one, and where the cells of each begin in it; returns how many. */
static uint32_t list_bricks(const struct merge *m, uint32_t coarse, uint32_t fine[8],
                            uint16_t offset[8]) {
    const struct sp_visible *list = &m->fine->visible;
    uint32_t corner[3], count = 0;
    sp_visible_brick_corner(m->coarse->visible.bricks, coarse, corner);
    for (uint32_t i = 0; i < 8; i++) {
        uint32_t half[3] = { i & 1, i >> 1 & 1, i >> 2 }, b[3];
        bool inside = true;
        for (int a = 0; a < 3; a++) {
            b[a] = 2 * (corner[a] >> SP_BRICK_SHIFT) + half[a];
            inside = inside && b[a] < list->bricks[a];
        }
        if (!inside)
            continue;
        fine[count] = b[0] + list->bricks[0] * (b[1] + list->bricks[1] * b[2]);
        offset[count++] = (uint16_t)(half[0] << 3 | half[1] << 7 | half[2] << 11);
    }
    return count;
}

/* The cell of a coarse brick that a voxel of one of its fine bricks is part of. */
static inline uint32_t cell_of(uint16_t local, uint16_t offset) {
    return (local >> 1 & 0x777u) + offset;
}

/* Lists may hold voxels that are not visible (classification.h). */
static inline bool is_hidden(const struct merge *m, uint64_t e) {
    const struct sp_transfer *t = &m->fine->transfer;
    return m->fine->listed && !t->is_visible[sp_visible_key(&m->fine->visible, e)];
}

static uint32_t count_brick(const struct merge *m, struct cells *cells, uint32_t brick) {
    const struct sp_visible *list = &m->fine->visible;
    uint32_t fine[8];
    uint16_t offset[8];
    uint32_t bricks = list_bricks(m, brick, fine, offset), count = 0;
    for (uint32_t i = 0; i < bricks; i++) {
        uint16_t local[SP_BRICK_VOXELS];
        uint32_t entries = (uint32_t)(list->first[fine[i] + 1] - list->first[fine[i]]);
        sp_visible_locals(list, fine[i], NULL, 0, entries, local);
        for (uint32_t n = 0; n < entries; n++) {
            uint32_t cell = cell_of(local[n], offset[i]);
            if (is_hidden(m, list->first[fine[i]] + n))
                continue;
            cells->used[cell / 64] |= UINT64_C(1) << cell % 64;
        }
    }
    for (size_t w = 0; w < SP_BRICK_VOXELS / 64; w++)
        count += (uint32_t)__builtin_popcountll(cells->used[w]);
    memset(cells->used, 0, sizeof cells->used);
    return count;
}

/* A classified voxel, which takes `part` of its cell. */
static void add_class(const struct merge *m, uint64_t e, float part, struct sum *sum) {
    const struct sp_visible *list = &m->fine->visible;
    bool has_microflakes = sp_visible_has_microflakes(list);
    uint32_t gradient = list->normal && !has_microflakes ? sp_visible_normal(list, e) : 0;
    struct sp_class c = sp_transfer_class_at(&m->fine->transfer, sp_visible_key(list, e), gradient);
    c.depth *= part;
    sum->depth += c.depth;
    for (int k = 0; k < 3; k++)
        sum->color[k] += c.color[k] * c.depth;
    if (has_microflakes)
        sp_microflakes_add(&sum->microflakes, *sp_visible_microflakes(list, e), c.depth);
    else
        sp_microflakes_add_normal(&sum->microflakes, gradient, c.depth);
}

/* A voxel of a scalar that pixels will classify: value and gradient are averaged as they are. */
static void add_scalar(const struct merge *m, uint64_t e, float part, struct sum *sum) {
    const struct sp_visible *list = &m->fine->visible;
    sum->depth += part;
    sum->color[0] += part * sp_transfer_value(&m->fine->transfer, sp_visible_key(list, e));
    if (!list->normal)
        return;
    float n[3];
    uint32_t packed = sp_visible_normal(list, e);
    sp_gradient_unpack(packed, n);
    for (int k = 0; k < 3; k++)
        sum->gradient[k] += n[k] * sp_gradient_share(packed) * part;
}

static void add_brick(const struct merge *m, struct cells *cells, uint32_t brick, uint16_t offset) {
    const struct sp_visible *list = &m->fine->visible;
    float share[3][SP_BRICK];
    uint32_t corner[3];
    sp_visible_brick_corner(list->bricks, brick, corner);
    for (unsigned a = 0; a < 3; a++)
        for (uint32_t i = 0; i < SP_BRICK && corner[a] + i < m->fine->grid.dims[a]; i++)
            share[a][i] = size_share(m, a, corner[a] + i);
    uint16_t locals[SP_BRICK_VOXELS];
    uint32_t count = (uint32_t)(list->first[brick + 1] - list->first[brick]);
    sp_visible_locals(list, brick, NULL, 0, count, locals);
    for (uint32_t n = 0; n < count; n++) {
        uint64_t e = list->first[brick] + n;
        uint16_t local = locals[n];
        if (is_hidden(m, e))
            continue;
        uint32_t cell = cell_of(local, offset);
        struct sum *sum = &cells->sums[cell];
        float part = share[0][local & 15] * share[1][local >> 4 & 15] * share[2][local >> 8];
        if (m->is_post)
            add_scalar(m, e, part, sum);
        else
            add_class(m, e, part, sum);
        cells->used[cell / 64] |= UINT64_C(1) << cell % 64;
    }
}

static void write_scalar(const struct merge *m, uint64_t out, const struct sum *sum) {
    static const struct sp_gradient_grid unit = { .bound = 1 };
    struct sp_visible *list = &m->coarse->visible;
    double n[3], inverse = sum->depth > 0 ? 1 / (double)sum->depth : 0;
    union {
        float value;
        uint32_t bits;
    } u = { .value = (float)((double)sum->color[0] * inverse) };
    sp_visible_set_key(list, out, u.bits);
    if (!list->normal)
        return;
    for (int k = 0; k < 3; k++)
        n[k] = (double)sum->gradient[k] * inverse;
    sp_visible_set_normal(list, out, sp_gradient_pack(&unit, n));
}

static void write_class(const struct merge *m, uint64_t out, const struct sum *sum) {
    struct sp_visible *list = &m->coarse->visible;
    struct sp_class *c = &m->coarse->transfer.table[out];
    float inverse = sum->depth > 0 ? 1 / sum->depth : 0;
    sp_visible_set_key(list, out, (uint32_t)out);
    c->depth = sum->depth;
    for (int k = 0; k < 3; k++)
        c->color[k] = sum->color[k] * inverse;
    if (list->normal)
        *sp_visible_microflakes(list, out) = sp_microflakes_pack(&sum->microflakes, sum->depth);
}

static void fill_brick(const struct merge *m, struct cells *cells, uint32_t brick) {
    uint32_t fine[8];
    uint16_t offset[8];
    const struct sp_visible *list = &m->coarse->visible;
    uint64_t out = list->first[brick];
    uint32_t bricks = list_bricks(m, brick, fine, offset);
    for (uint32_t i = 0; i < bricks; i++)
        add_brick(m, cells, fine[i], offset[i]);
    list->axis[brick] = 2;
    for (uint32_t w = 0; w < SP_BRICK_VOXELS / 64; w++) {
        for (; cells->used[w]; cells->used[w] &= cells->used[w] - 1) {
            uint32_t cell = 64 * w + (uint32_t)__builtin_ctzll(cells->used[w]);
            list->place[out] = (uint8_t)cell;
            if (m->is_post)
                write_scalar(m, out++, &cells->sums[cell]);
            else
                write_class(m, out++, &cells->sums[cell]);
            cells->sums[cell] = (struct sum){ 0 };
        }
        list->start[brick][w / 4 + 1] =
            (uint16_t)(out - list->first[brick]); /* 256 cells per slice */
    }
}

static void count_bricks(void *user, size_t begin, size_t end, unsigned worker) {
    const struct merge *m = user;
    for (size_t b = begin; b < end && !sp_classify_cancelled(m->job, NULL); b++)
        m->coarse->visible.first[b + 1] = count_brick(m, &m->cells[worker], (uint32_t)b);
}

static void fill_bricks(void *user, size_t begin, size_t end, unsigned worker) {
    const struct merge *m = user;
    for (size_t b = begin; b < end && !sp_classify_cancelled(m->job, NULL); b++)
        fill_brick(m, &m->cells[worker], (uint32_t)b);
}

static bool allocate_entries(struct merge *m, struct sp_error *err) {
    const struct sp_classify_job *job = m->job;
    struct sp_visible *list = &m->coarse->visible;
    struct sp_transfer *transfer = &m->coarse->transfer;
    bool normals = m->fine->visible.normal != NULL;
    if (list->count > UINT32_MAX)
        return sp_fail(err, SP_ERR_MEMORY, "", "too many visible voxels for a coarse level: %llu",
                       (unsigned long long)list->count);
    uint64_t table = m->is_post ? 0 : list->count * sizeof *transfer->table;
    uint64_t need = sp_visible_entry_bytes(list, list->count, normals) + table;
    if (job->bytes_max && need > job->bytes_max)
        return sp_fail(
            err, SP_ERR_BUDGET, "/transfer_function",
            "a coarse level of %llu voxels takes %llu bytes and %llu are left: make fewer "
            "voxels visible, or allow more memory",
            (unsigned long long)list->count, (unsigned long long)need,
            (unsigned long long)job->bytes_max);
    if (!sp_visible_allocate(list, normals, err))
        return false;
    transfer->tf = *job->tf;
    if (m->is_post) { /* keys are values from the same base on */
        transfer->type = SP_FLOAT32;
        transfer->base = sp_transfer_base(&m->fine->transfer);
        return true;
    }
    transfer->table = malloc((list->count ? list->count : 1) * sizeof *transfer->table);
    if (!transfer->table)
        return sp_fail(err, SP_ERR_MEMORY, "", "out of memory for %llu classes of a coarse level",
                       (unsigned long long)list->count);
    transfer->count = (uint32_t)list->count;
    return true;
}

static bool merge_level(struct merge *m, struct sp_error *err) {
    struct sp_visible *list = &m->coarse->visible;
    sp_parallel_for(m->job->pool, sp_visible_bricks(list), 1, count_bricks, m);
    if (sp_classify_cancelled(m->job, err))
        return false;
    sp_visible_sum(list);
    if (!allocate_entries(m, err))
        return false;
    sp_parallel_for(m->job->pool, sp_visible_bricks(list), 1, fill_bricks, m);
    return !sp_classify_cancelled(m->job, err);
}

bool sp_mip_make(struct sp_level *coarse, const struct sp_level *fine,
                 const struct sp_classify_job *job, struct sp_error *err) {
    bool is_post = job->tf->order == SP_TF_POST;
    uint32_t normal_bytes = is_post ? 4 : sizeof(struct sp_microflakes);
    if (!sp_mip_grid(coarse, &fine->grid, err) ||
        !sp_visible_init(&coarse->visible, coarse->grid.dims, 4, normal_bytes, err))
        return false;
    struct merge m = { .fine = fine, .coarse = coarse, .is_post = is_post, .job = job };
    m.cells = calloc(sp_pool_threads(job->pool), sizeof *m.cells);
    bool ok = m.cells
                  ? merge_level(&m, err)
                  : sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a brick of a coarse level");
    free(m.cells);
    return ok;
}
