/* SPDX-License-Identifier: Apache-2.0 */
#include "shell/order.h"

#include <string.h>

#include "splat/slices.h"
#include "volume/grid.h"

/* Voxels nearer to the near plane than this are never hidden: what hides them may not be drawn
 * [mean spacings]. */
static const double near_margin = 4;

struct axis {
    uint32_t *slices; /* by rank: index, away from the eye */
    uint32_t *rank;   /* by index */
    uint8_t *need;    /* by index: the bit of the neighbour towards the eye, or 0 */
    uint32_t split;   /* indices from it on rise away from the eye, those before it fall */
};

struct sort {
    const struct sp_shell_order_job *job;
    struct axis axes[3];
    unsigned major;
    uint32_t groups, size;      /* of slices along `outer`, and slices per group */
    unsigned outer;             /* axis that is divided among the workers */
    uint32_t *counts;           /* by group, or by rank of the slice along axis 0 and group */
    uint32_t *out;              /* NULL = count only */
    bool has_near;              /* the near plane cuts the volume */
    double step[3], base, near; /* u2 of a voxel and of the near plane, world units */
};

static double middle(const struct sp_grid *grid, unsigned a, uint32_t i, int side) {
    double at = sp_grid_distance(grid, a, i);
    if (side < 0 && i > 0)
        return 0.5 * (at + sp_grid_distance(grid, a, i - 1));
    if (side > 0 && i + 1 < grid->dims[a])
        return 0.5 * (at + sp_grid_distance(grid, a, i + 1));
    return at + 0.5 * side * sp_grid_local_spacing(grid, a, i);
}

/* Finds on which side of each slice the eye is. eye: its distance along the axis from sample 0, or
 * ±infinity; NAN = the rays are parallel to the slices. */
static void find_needs(const struct sp_grid *grid, unsigned a, double eye, struct axis *axis) {
    axis->split = 0;
    for (uint32_t i = 0; i < grid->dims[a]; i++) {
        axis->need[i] = (uint8_t)(eye < middle(grid, a, i, -1)  ? SP_SHELL_LOW(a)
                                  : eye > middle(grid, a, i, 1) ? SP_SHELL_HIGH(a)
                                                                : 0);
        if (sp_grid_distance(grid, a, i) < eye)
            axis->split = i + 1;
    }
}

static double find_eye(const struct sp_camera_transform *camera, const struct sp_grid *grid,
                       unsigned a) {
    struct sp_mat3 d;
    double det;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            d.m[r][c] = grid->direction[r][c];
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
        double eye = find_eye(s->job->camera, grid, a);
        find_needs(grid, a, eye, axis);
        sp_slices_sort(s->job->camera, grid, a, axis->slices);
        for (uint32_t k = 0; k < n; k++)
            axis->rank[axis->slices[k]] = k;
        if (isnan(eye)) /* any order serves; sp_slices_sort() falls */
            axis->split = n;
    }
    return true;
}

/* Finds whether the near plane may cut away what hides other voxels. */
static void init_near(struct sort *s) {
    const struct sp_camera_transform *camera = s->job->camera;
    const struct sp_grid *grid = s->job->grid;
    struct sp_vec3 forward = sp_vec3_from(camera->w.m[2]);
    double spacing = 0, nearest;
    s->base = sp_vec3_dot(forward, sp_vec3_sub(sp_vec3_from(grid->origin), camera->eye));
    nearest = s->base;
    for (int a = 0; a < 3; a++) {
        double extent[2];
        s->step[a] = 0;
        for (int r = 0; r < 3; r++)
            s->step[a] += forward.v[r] * grid->direction[r][a];
        sp_grid_extent(grid, (unsigned)a, extent);
        nearest += fmin(s->step[a] * extent[0], s->step[a] * extent[1]);
        spacing = fmax(spacing, grid->spacing[a]);
    }
    s->near = camera->near + near_margin * spacing;
    s->has_near = nearest < s->near;
}

static bool is_near(const struct sort *s, const struct sp_shell_voxel *v) {
    double u2 = s->base;
    for (unsigned a = 0; a < 3; a++)
        u2 += s->step[a] * sp_grid_distance(s->job->grid, a, v->at[a]);
    return u2 < s->near;
}

static inline bool is_hidden(const struct sort *s, const struct sp_shell_voxel *v, unsigned need) {
    need |= s->axes[0].need[v->at[0]];
    if ((v->code & need) != need || !need || s->job->keeps_hidden)
        return false;
    return !(s->has_near && is_near(s, v));
}

/* Appends the seen voxels of a row to out[n], or counts them. Returns the new n. */
static uint32_t add_row(const struct sort *s, uint32_t y, uint32_t z, uint32_t *out, uint32_t n) {
    const struct sp_shell_list *list = s->job->list;
    const uint32_t *first = list->first + (uint64_t)z * list->dims[1] + y;
    unsigned need = s->axes[1].need[y] | s->axes[2].need[z];
    uint32_t split = first[0];
    while (split < first[1] && list->voxels[split].at[0] < s->axes[0].split)
        split++;
    for (uint32_t v = split; v < first[1]; v++)
        if (!is_hidden(s, &list->voxels[v], need)) {
            if (out)
                out[n] = v;
            n++;
        }
    for (uint32_t v = split; v-- > first[0];)
        if (!is_hidden(s, &list->voxels[v], need)) {
            if (out)
                out[n] = v;
            n++;
        }
    return n;
}

/* The same, each voxel to the slice of axis 0 that it belongs to. next: by rank of the slice. */
static void spread_row(const struct sort *s, uint32_t y, uint32_t z, uint32_t *next) {
    const struct sp_shell_list *list = s->job->list;
    const uint32_t *first = list->first + (uint64_t)z * list->dims[1] + y;
    unsigned need = s->axes[1].need[y] | s->axes[2].need[z];
    for (uint32_t v = first[0]; v < first[1]; v++)
        if (!is_hidden(s, &list->voxels[v], need)) {
            uint32_t *at = &next[s->axes[0].rank[list->voxels[v].at[0]]];
            if (s->out)
                s->out[*at] = v;
            ++*at;
        }
}

/* Visits the rows of some groups of slices of the outer axis. */
static void visit_groups(void *user, size_t begin, size_t end, unsigned worker) {
    struct sort *s = user;
    unsigned inner = 3 - s->outer; /* of axes 1 and 2 */
    const uint32_t *dims = s->job->list->dims;
    (void)worker;
    for (size_t g = begin; g < end; g++) {
        uint32_t last = ((uint32_t)g + 1) * s->size, n = s->counts[g];
        last = last < dims[s->outer] ? last : dims[s->outer];
        for (uint32_t k = (uint32_t)g * s->size; k < last; k++) {
            if (sp_interrupt_is_cancelled(s->job->interrupt))
                return;
            for (uint32_t j = 0; j < dims[inner]; j++) {
                uint32_t at[3];
                at[s->outer] = s->axes[s->outer].slices[k];
                at[inner] = s->axes[inner].slices[j];
                if (s->major == 0)
                    spread_row(s, at[1], at[2], s->counts + g * dims[0]);
                else
                    n = add_row(s, at[1], at[2], s->out, n);
            }
        }
        if (s->major != 0)
            s->counts[g] = n;
    }
}

/* Turns counts into starts; returns their sum. */
static uint32_t sum_counts(struct sort *s) {
    uint32_t sum = 0, ranks = s->major == 0 ? s->job->list->dims[0] : 1;
    for (uint32_t r = 0; r < ranks; r++)
        for (uint32_t g = 0; g < s->groups; g++) {
            uint32_t *count = &s->counts[(size_t)g * ranks + r], n = *count;
            *count = sum;
            sum += n;
        }
    return sum;
}

bool sp_shell_sort(const struct sp_shell_order_job *job, struct sp_shell_order *order) {
    enum { GROUPS = 64 };
    struct sort s = { .job = job, .major = sp_slices_major_axis(job->camera, job->grid) };
    const uint32_t *dims = job->list->dims;
    *order = (struct sp_shell_order){ 0 };
    if (job->list->count == 0)
        return true;
    s.outer = s.major == 1 ? 1 : 2;
    s.size = (dims[s.outer] + GROUPS - 1) / GROUPS;
    s.groups = (dims[s.outer] + s.size - 1) / s.size;
    size_t counts = (size_t)s.groups * (s.major == 0 ? dims[0] : 1);
    s.counts = sp_arena_alloc(job->arena, "shell's slices", counts, sizeof *s.counts);
    if (!s.counts || !init_axes(&s))
        return false;
    init_near(&s);
    memset(s.counts, 0, counts * sizeof *s.counts);
    sp_parallel_for(job->pool, s.groups, 1, visit_groups, &s);
    order->count = sum_counts(&s);
    order->voxels =
        sp_arena_alloc(job->arena, "shell's order", order->count + (size_t)1, sizeof(uint32_t));
    if (!order->voxels)
        return false;
    s.out = order->voxels;
    sp_parallel_for(job->pool, s.groups, 1, visit_groups, &s);
    return true;
}
