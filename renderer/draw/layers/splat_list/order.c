/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/layers/splat_list/order.h"

#include <string.h>

#include "data/volume/grid.h"
#include "draw/layers/splat_list/radix.h"
#include "splat/slices.h"

/* Voxels nearer to the near plane than this are never hidden: what hides them may not be drawn
 * [mean spacings]. */
static const double near_margin = 4;

/* A need that no code meets: no face is turned to the eye, or hidden voxels are kept. */
enum { NEVER = 128 };

struct axis {
    uint32_t *slices; /* by rank: index, away from the eye */
    uint32_t *rank;   /* by index */
    uint8_t *need;    /* by index: the bit of the neighbour towards the eye, or 0 */
    /* Indices from it on rise away from the eye, those before it fall. The cell that the eye is in
     * comes first. */
    uint32_t split;
};

/* Slices of the outer axis that one worker visits at a time. */
struct group {
    uint32_t begin, end;   /* ranks */
    uint32_t first, count; /* where its voxels are */
};

struct sort {
    const struct sp_voxel_order_job *job;
    struct axis axes[3];
    unsigned major, outer, inner; /* rows are visited by the outer, then by the inner axis */
    bool spreads;                 /* voxels are sorted by slices of axis 0 at last */
    struct group *groups;
    uint32_t group_count;
    uint32_t *out;               /* voxels, group by group */
    uint32_t *counts;            /* axis 0 is major: [group][rank of the slice along it] */
    uint32_t *sorted;            /* the same voxels by that rank */
    bool has_near;               /* the near plane cuts the volume */
    double step[3], base, near;  /* u2 of a voxel and of the near plane, world units */
    double nearest, farthest;    /* u2 of the volume's corners */
    struct sp_radix_item *items; /* the voxels by depth */
};

static double middle(const struct sp_grid *grid, unsigned a, uint32_t i, int side) {
    double at = sp_grid_distance(grid, a, i);
    if (side < 0 && i > 0)
        return 0.5 * (at + sp_grid_distance(grid, a, i - 1));
    if (side > 0 && i + 1 < grid->dims[a])
        return 0.5 * (at + sp_grid_distance(grid, a, i + 1));
    return at + 0.5 * side * sp_grid_local_spacing(grid, a, i);
}

/* Computes on which side of each slice the eye is. eye: its distance along the axis from sample 0,
 * or ±infinity; NAN = the rays are parallel to the slices. */
static void compute_needs(const struct sp_grid *grid, unsigned a, double eye, struct axis *axis) {
    axis->split = 0;
    for (uint32_t i = 0; i < grid->dims[a]; i++) {
        axis->need[i] = (uint8_t)(eye < middle(grid, a, i, -1)  ? SP_VOXEL_LOW(a)
                                  : eye > middle(grid, a, i, 1) ? SP_VOXEL_HIGH(a)
                                                                : 0);
        if (axis->need[i] == SP_VOXEL_HIGH(a))
            axis->split = i + 1;
    }
}

static double compute_eye(const struct sp_camera_transform *camera, const struct sp_grid *grid,
                          unsigned a) {
    double det;
    struct sp_mat3 d = sp_grid_directions(grid);
    struct sp_vec3 n = sp_vec3_from(sp_mat3_inverse(&d, &det).m[a]);
    if (camera->projection == SP_PERSPECTIVE)
        return sp_vec3_dot(n, sp_vec3_sub(camera->eye, sp_vec3_from(grid->origin)));
    double along = sp_vec3_dot(n, sp_vec3_from(camera->w.m[2]));
    return along > 0 ? -INFINITY : along < 0 ? INFINITY : NAN;
}

static bool init_axes(struct sort *s) {
    const struct sp_grid *grid = s->job->grid;
    for (unsigned a = 0; a < 3; a++) {
        struct axis *axis = &s->axes[a];
        uint32_t n = grid->dims[a];
        axis->slices = sp_arena_alloc(s->job->arena, "slices", n, sizeof *axis->slices);
        axis->rank = sp_arena_alloc(s->job->arena, "slices", n, sizeof *axis->rank);
        axis->need = sp_arena_alloc(s->job->arena, "slices", n, 1);
        if (!axis->slices || !axis->rank || !axis->need)
            return false;
        double eye = compute_eye(s->job->camera, grid, a);
        compute_needs(grid, a, eye, axis);
        sp_slices_sort(s->job->camera, grid, a, axis->slices);
        for (uint32_t k = 0; k < n; k++)
            axis->rank[axis->slices[k]] = k;
        if (s->job->keeps_hidden)
            memset(axis->need, NEVER, n);
    }
    return true;
}

/* Finds how u2 changes over the grid, and whether the near plane may cut away what hides other
 * voxels. */
static void init_depths(struct sort *s) {
    const struct sp_camera_transform *camera = s->job->camera;
    const struct sp_grid *grid = s->job->grid;
    struct sp_vec3 forward = sp_vec3_from(camera->w.m[2]);
    double spacing = 0;
    s->base = sp_vec3_dot(forward, sp_vec3_sub(sp_vec3_from(grid->origin), camera->eye));
    s->nearest = s->farthest = s->base;
    for (int a = 0; a < 3; a++) {
        double extent[2];
        s->step[a] = 0;
        for (int r = 0; r < 3; r++)
            s->step[a] += forward.v[r] * grid->direction[r][a];
        sp_grid_extent(grid, (unsigned)a, extent);
        s->nearest += fmin(s->step[a] * extent[0], s->step[a] * extent[1]);
        s->farthest += fmax(s->step[a] * extent[0], s->step[a] * extent[1]);
        spacing = fmax(spacing, grid->spacing[a]);
    }
    s->near = camera->near + near_margin * spacing;
    s->has_near = s->nearest < s->near;
}

static double depth_of(const struct sort *s, const struct sp_voxel *v) {
    double u2 = s->base;
    for (unsigned a = 0; a < 3; a++)
        u2 += s->step[a] * sp_grid_distance(s->job->grid, a, v->at[a]);
    return u2;
}

static inline bool is_hidden(const struct sort *s, const struct sp_voxel *v, unsigned need) {
    need |= s->axes[0].need[v->at[0]];
    need = need ? need : NEVER;
    return (v->code & need) == need;
}

/* Appends the seen ones of the voxels [begin, end) to out; returns where the next one goes. */
static inline uint32_t *add_rising(const struct sort *s, uint32_t begin, uint32_t end,
                                   unsigned need, uint32_t *out) {
    for (uint32_t v = begin; v < end; v++) {
        *out = v;
        out += !is_hidden(s, &s->job->list->voxels[v], need);
    }
    return out;
}

static inline uint32_t *add_falling(const struct sort *s, uint32_t begin, uint32_t end,
                                    unsigned need, uint32_t *out) {
    for (uint32_t v = end; v-- > begin;) {
        *out = v;
        out += !is_hidden(s, &s->job->list->voxels[v], need);
    }
    return out;
}

/* Adds the voxels of a run where the near plane may have removed the voxels that hide others. */
static uint32_t *add_near(const struct sort *s, uint32_t begin, uint32_t end, bool falls,
                          unsigned need, uint32_t *out) {
    for (uint32_t i = begin; i < end; i++) {
        uint32_t v = falls ? begin + (end - 1 - i) : i;
        const struct sp_voxel *voxel = &s->job->list->voxels[v];
        if (!is_hidden(s, voxel, need) || depth_of(s, voxel) < s->near)
            *out++ = v;
    }
    return out;
}

/* Adds a row, in the order of its distance from the eye. */
static uint32_t *add_row(const struct sort *s, uint32_t y, uint32_t z, uint32_t *out) {
    const struct sp_voxel_list *list = s->job->list;
    const uint32_t *first = list->first + (uint64_t)z * list->dims[1] + y;
    unsigned need = s->axes[1].need[y] | s->axes[2].need[z];
    uint32_t split = s->axes[0].split >= list->dims[0] ? first[1] : first[0];
    while (s->axes[0].split && split < first[1] && list->voxels[split].at[0] < s->axes[0].split)
        split++;
    if (s->has_near) {
        out = add_near(s, split, first[1], false, need, out);
        return add_near(s, first[0], split, true, need, out);
    }
    out = add_rising(s, split, first[1], need, out);
    return add_falling(s, first[0], split, need, out);
}

/* Adds the rows that have voxels in slice `at` of the outer axis. */
static uint32_t *add_slice(const struct sort *s, uint32_t at, uint32_t *out) {
    const struct sp_voxel_list *list = s->job->list;
    uint32_t words = (list->dims[s->inner] + 63) / 64, split = s->axes[s->inner].split;
    const uint64_t *rows = list->rows[s->outer - 1] + (uint64_t)at * words;
    uint32_t index[3];
    index[s->outer] = at;
    for (uint32_t w = split / 64; w < words; w++) {
        uint64_t left = rows[w] & (w > split / 64 ? UINT64_MAX : UINT64_MAX << split % 64);
        for (; left; left &= left - 1) {
            index[s->inner] = w * 64 + (uint32_t)__builtin_ctzll(left);
            out = add_row(s, index[1], index[2], out);
        }
    }
    for (uint32_t w = (split + 63) / 64; w-- > 0;) {
        uint64_t left = rows[w];
        if (w == split / 64)
            left &= (UINT64_C(1) << split % 64) - 1;
        while (left) {
            uint32_t bit = 63 - (uint32_t)__builtin_clzll(left);
            left ^= UINT64_C(1) << bit;
            index[s->inner] = w * 64 + bit;
            out = add_row(s, index[1], index[2], out);
        }
    }
    return out;
}

static void add_groups(void *user, size_t begin, size_t end, unsigned worker) {
    struct sort *s = user;
    (void)worker;
    for (size_t g = begin; g < end; g++) {
        struct group *group = &s->groups[g];
        uint32_t *first = s->out + group->first, *out = first;
        for (uint32_t k = group->begin; k < group->end; k++) {
            if (sp_interrupt_is_cancelled(s->job->interrupt))
                return;
            out = add_slice(s, s->axes[s->outer].slices[k], out);
        }
        group->count = (uint32_t)(out - first);
        if (!s->spreads)
            continue;
        uint32_t *counts = s->counts + g * s->job->list->dims[0];
        for (uint32_t i = 0; i < group->count; i++)
            counts[s->axes[0].rank[s->job->list->voxels[first[i]].at[0]]]++;
    }
}

/* Sorts the voxels of groups by the slice of axis 0; their order in a slice stays. */
static void spread_groups(void *user, size_t begin, size_t end, unsigned worker) {
    struct sort *s = user;
    (void)worker;
    for (size_t g = begin; g < end; g++) {
        const uint32_t *from = s->out + s->groups[g].first;
        uint32_t *next = s->counts + g * s->job->list->dims[0];
        for (uint32_t i = 0; i < s->groups[g].count; i++)
            s->sorted[next[s->axes[0].rank[s->job->list->voxels[from[i]].at[0]]]++] = from[i];
    }
}

/* Turns counts by group and rank into starts. */
static void sum_counts(struct sort *s) {
    uint32_t sum = 0, ranks = s->job->list->dims[0];
    for (uint32_t r = 0; r < ranks; r++)
        for (uint32_t g = 0; g < s->group_count; g++) {
            uint32_t *count = &s->counts[(size_t)g * ranks + r], n = *count;
            *count = sum;
            sum += n;
        }
}

/* Closes the gaps between groups; returns the number of voxels. */
static uint32_t close_gaps(struct sort *s) {
    uint32_t count = 0;
    for (uint32_t g = 0; g < s->group_count; g++) {
        const struct group *group = &s->groups[g];
        if (!s->spreads)
            memmove(s->out + count, s->out + group->first, group->count * sizeof *s->out);
        count += group->count;
    }
    return count;
}

/* Divides the slices of the outer axis into groups, each with memory for all of its voxels. */
static bool init_groups(struct sort *s) {
    enum { GROUPS = 64 };
    const struct sp_voxel_list *list = s->job->list;
    uint32_t n = list->dims[s->outer], size = (n + GROUPS - 1) / GROUPS, first = 0;
    s->group_count = (n + size - 1) / size;
    s->groups =
        sp_arena_alloc(s->job->arena, "groups of slices", s->group_count, sizeof *s->groups);
    for (uint32_t g = 0; s->groups && g < s->group_count; g++) {
        struct group *group = &s->groups[g];
        *group = (struct group){ .begin = g * size, .end = (g + 1) * size, .first = first };
        group->end = group->end < n ? group->end : n;
        for (uint32_t k = group->begin; k < group->end; k++)
            first += list->slice_counts[s->outer - 1][s->axes[s->outer].slices[k]];
    }
    return s->groups != NULL;
}

static bool sort_by_axis_0(struct sort *s, struct sp_voxel_order *order) {
    sum_counts(s);
    s->sorted = sp_arena_alloc(s->job->arena, "order of voxels", order->count + (size_t)1,
                               sizeof *s->sorted);
    if (!s->sorted)
        return false;
    sp_parallel_for(s->job->pool, s->group_count, 1, spread_groups, s);
    order->voxels = s->sorted;
    return true;
}

static void fill_items(void *user, size_t begin, size_t end, unsigned worker) {
    const struct sort *s = user;
    double scale = (SP_RADIX_KEYS - 1) / (s->farthest - s->nearest);
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        double u2 = depth_of(s, &s->job->list->voxels[s->out[i]]);
        s->items[i] = (struct sp_radix_item){ (uint32_t)((u2 - s->nearest) * scale), s->out[i] };
    }
}

static void copy_items(void *user, size_t begin, size_t end, unsigned worker) {
    const struct sort *s = user;
    (void)worker;
    for (size_t i = begin; i < end; i++)
        s->out[i] = s->items[i].value;
}

static bool sort_by_depth(struct sort *s, uint32_t count) {
    enum { GRAIN = 1 << 13 };
    struct sp_arena *arena = s->job->arena;
    s->items = sp_arena_alloc(arena, "order of voxels", count + (size_t)1, sizeof *s->items);
    if (!s->items)
        return false;
    sp_parallel_for(s->job->pool, count, GRAIN, fill_items, s);
    s->items = sp_radix_sort(s->items, count, s->job->pool, arena);
    if (!s->items)
        return false;
    sp_parallel_for(s->job->pool, count, GRAIN, copy_items, s);
    return true;
}

bool sp_voxel_sort(const struct sp_voxel_order_job *job, struct sp_voxel_order *order) {
    struct sort s = { .job = job, .major = sp_slices_major_axis(job->camera, job->grid) };
    const struct sp_voxel_list *list = job->list;
    *order = (struct sp_voxel_order){ 0 };
    if (list->count == 0)
        return true;
    s.outer = s.major == 1 ? 1 : 2;
    s.inner = 3 - s.outer;
    s.spreads = s.major == 0 && !job->by_depth;
    if (!init_axes(&s) || !init_groups(&s))
        return false;
    init_depths(&s);
    s.out = sp_arena_alloc(job->arena, "order of voxels", list->count + (size_t)1, sizeof *s.out);
    if (s.spreads) {
        size_t counts = (size_t)s.group_count * list->dims[0];
        s.counts = sp_arena_alloc(job->arena, "slices of voxels", counts, sizeof *s.counts);
        if (s.counts)
            memset(s.counts, 0, counts * sizeof *s.counts);
    }
    if (job->arena->failed)
        return false;
    sp_parallel_for(job->pool, s.group_count, 1, add_groups, &s);
    if (sp_interrupt_is_cancelled(job->interrupt))
        return true;
    order->voxels = s.out;
    order->count = close_gaps(&s);
    if (s.job->by_depth)
        return sort_by_depth(&s, order->count);
    return !s.spreads || sort_by_axis_0(&s, order);
}
