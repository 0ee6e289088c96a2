/* SPDX-License-Identifier: Apache-2.0 */
#include <float.h>
#include <math.h>
#include <string.h>

#include "data/volume/grid.h"
#include "draw/layers/surface/extract.h"
#include "draw/layers/surface/filter.h"
#include "draw/layers/surface/merge.h"
#include "draw/layers/surface/surface.h"

_Static_assert((int)SP_TILE == (int)SP_FRAGMENT_TILE, "the tiles of bins are those of fragments");

struct preparation {
    const struct sp_surface_input *input;
    struct sp_surface *surface;
    struct sp_splat *records; /* by block of the points; x1 <= x0 = not seen */
};

/* Discs of a ball are moved this many times the distance that brings them to the surface on
 * average: then its silhouette keeps its place, and weights inside of it add up to 1 (README.md).
 */
static const float bend = 1.5f;

/* The largest deviation of a kernel, as a share of its distance from the eye (focus.h). */
static const float widest = 0.035f;

static void init_frame(struct sp_surface *s, const struct sp_surface_input *input) {
    const struct sp_filter filter = sp_surface_filter(&input->view->filter);
    sp_ewa_frame_init(&s->frame, input->camera, input->grid, input->view, &filter);
    sp_clip_frame_init(&s->clip, input->camera, input->grid, &input->view->clip, s->frame.unit);
    const unsigned level = input->points->level;
    const double growth = sp_surface_growth(level, filter.sigma, input->is_enlarged);
    double sign = 0, largest = 0;
    for (int a = 0; a < 3; a++) {
        double square = 0;
        const int b = (a + 1) % 3, c = (a + 2) % 3;
        for (int r = 0; r < 3; r++) {
            const int p = (r + 1) % 3, q = (r + 2) % 3;
            const double(*m)[3] = s->frame.step_hi;
            double cofactor = m[p][b] * m[q][c] - m[q][b] * m[p][c];
            s->facing[r][a] = (float)ldexp(cofactor, 2 * (int)level);
            sign += cofactor * m[r][a];
            square += m[r][a] * m[r][a];
            s->frame.kernel[r][a] *= (float)(growth / input->points->split[a]);
        }
        square *= growth * growth / (input->points->split[a] * input->points->split[a]);
        largest = fmax(largest, square);
    }
    for (int i = 0; i < 9 && sign < 0; i++)
        s->facing[i / 3][i % 3] *= -1;
    s->reach = s->frame.radius * s->frame.sigma * (float)sqrt(largest);
    /* A disc of a merged point bends as much as the discs that it stands for do together. */
    s->bend = bend * s->frame.sigma * s->frame.sigma / SURFACE_BEND_STEPS;
    if (input->is_enlarged)
        s->bend *= (float)(growth * growth);
    s->stretch = 1;
    if (s->frame.projection == SP_PERSPECTIVE)
        s->stretch += fmaxf(s->frame.ratio_max[0], s->frame.ratio_max[1]);
    for (int i = 0; i < 9; i++)
        s->to_camera[i / 3][i % 3] = (float)input->camera->w.m[i / 3][i % 3];
}

/* How much larger than on average the cells of a block are. */
static double compute_growth(const struct sp_grid *grid, const struct sp_surface_block *block) {
    double most = 1;
    for (unsigned a = 0; a < 3; a++)
        for (uint32_t i = 0; grid->coordinates[a] && i <= SURFACE_BLOCK; i++)
            if (block->corner[a] + i < grid->dims[a])
                most = fmax(most, sp_grid_local_spacing(grid, a, block->corner[a] + i) /
                                      grid->spacing[a]);
    return most;
}

/* Distance of a place from sample 0 along an axis [mean spacings]. */
static double place_of(const struct sp_grid *grid, unsigned a, uint32_t corner, uint16_t place) {
    double at = corner + place / (double)SURFACE_PLACE_STEPS;
    if (!grid->coordinates[a])
        return at;
    uint32_t last = grid->dims[a] - 1, low = at < last ? (uint32_t)at : last;
    double distance = sp_grid_distance(grid, a, low);
    if (low < last)
        distance += (at - low) * (sp_grid_distance(grid, a, low + 1) - distance);
    return distance / grid->spacing[a];
}

/* The corners of a block's bounds in camera space. */
static void compute_corners(const struct sp_ewa_frame *f, const struct sp_surface_block *block,
                            double corners[8][3]) {
    double at[3][2];
    for (unsigned a = 0; a < 3; a++) {
        at[a][0] = place_of(f->grid, a, block->corner[a], block->low[a]);
        at[a][1] = place_of(f->grid, a, block->corner[a], block->high[a]);
    }
    for (int c = 0; c < 8; c++)
        for (int r = 0; r < 3; r++)
            corners[c][r] = f->base[r] + f->step_hi[r][0] * at[0][c & 1] +
                            f->step_hi[r][1] * at[1][c >> 1 & 1] + f->step_hi[r][2] * at[2][c >> 2];
}

static bool is_clipped(const struct sp_surface *s, double corners[8][3], double reach) {
    for (uint32_t i = 0; i < s->clip.count; i++) {
        const struct sp_clip_half *h = &s->clip.planes[i];
        double most = -INFINITY;
        for (int c = 0; c < 8; c++)
            most = fmax(most, (double)h->normal[0] * corners[c][0] +
                                  (double)h->normal[1] * corners[c][1] +
                                  (double)h->normal[2] * corners[c][2] - (double)h->offset);
        if (most < -reach)
            return true;
    }
    return false;
}

static int16_t bounded(double x, int limit) {
    return (int16_t)(x > 0 ? (x < limit ? x : limit) : 0);
}

/* Fills the record of a block: the pixels that it may touch, and where it begins. */
static void project(const struct preparation *p, uint32_t b) {
    const struct sp_surface *s = p->surface;
    const struct sp_ewa_frame *f = &s->frame;
    const struct sp_surface_points *points;
    const struct sp_surface_block *block = sp_surface_block_at(s, b, &points);
    struct sp_splat *record = &p->records[b];
    const bool is_perspective = f->projection == SP_PERSPECTIVE;
    double reach = (double)s->reach * compute_growth(f->grid, block);
    const double near = (double)f->near;
    float sizes[2] = { 1, 1 };
    double corners[8][3], low[2] = { INFINITY, INFINITY }, high[2] = { -INFINITY, -INFINITY };
    double first = INFINITY, last = -INFINITY;
    *record = (struct sp_splat){ .sheet = b };
    if (s->focus.growth > 0)
        sp_surface_focus_block(&s->focus, block->corner, sizes);
    if (points == s->points && sizes[0] < 1) /* the points of `near` replace these */
        return;
    reach *= (double)sizes[1];
    compute_corners(f, block, corners);
    for (int c = 0; c < 8; c++) {
        first = fmin(first, corners[c][2]);
        last = fmax(last, corners[c][2]);
    }
    if (last + reach < near || is_clipped(s, corners, reach))
        return;
    for (int c = 0; c < 8; c++)
        for (int i = 0; i < 2; i++) {
            double depth = is_perspective ? fmax(corners[c][2], near / 2) : 1;
            double x = (double)f->centre[i] + (double)f->scale * corners[c][i] / depth;
            low[i] = fmin(low[i], x);
            high[i] = fmax(high[i], x);
        }
    double nearest = is_perspective ? fmax(first, near / 2) : 1;
    double margin = reach * (double)s->stretch * (double)f->scale / nearest +
                    (double)f->radius * sqrt((double)f->lowpass2) + 1;
    bool is_everywhere = is_perspective && first - reach < near;
    double box[4];
    for (int i = 0; i < 2; i++) {
        box[i] = is_everywhere ? 0 : floor(low[i] - margin);
        box[2 + i] = is_everywhere ? f->size[i] : ceil(high[i] + margin);
    }
    record->x0 = bounded(box[0], f->size[0]);
    record->y0 = bounded(box[1], f->size[1]);
    record->x1 = bounded(box[2], f->size[0]);
    record->y1 = bounded(box[3], f->size[1]);
    record->depth = (float)(first - reach);
    if (record->y1 <= record->y0)
        record->x1 = record->x0;
}

static void project_blocks(void *user, size_t begin, size_t end, unsigned worker) {
    const struct preparation *p = user;
    (void)worker;
    if (sp_interrupt_is_cancelled(&p->input->interrupt))
        return;
    for (size_t b = begin; b < end; b++)
        project(p, (uint32_t)b);
}

enum { DEPTH_RANGES = 4096 };

/* Sorts the visible blocks by where they begin: a counting sort by ranges of depth, which keeps the
 * order inside of each. Returns their number. */
static uint32_t sort_blocks(struct preparation *p, uint32_t *starts) {
    struct sp_surface *s = p->surface;
    const uint32_t count = s->points->block_count + s->near.block_count;
    const struct sp_surface_points *points;
    float low = INFINITY, high = -INFINITY;
    for (uint32_t b = 0; b < count; b++)
        if (p->records[b].x1 > p->records[b].x0) {
            s->drawn += sp_surface_block_at(s, b, &points)->count;
            low = fminf(low, p->records[b].depth);
            high = fmaxf(high, p->records[b].depth);
        }
    const float scale = high > low ? fminf((DEPTH_RANGES - 1) / (high - low), FLT_MAX) : 0;
    memset(starts, 0, (DEPTH_RANGES + 1) * sizeof *starts);
    for (uint32_t b = 0; b < count; b++)
        if (p->records[b].x1 > p->records[b].x0)
            starts[1 + (uint32_t)((p->records[b].depth - low) * scale)]++;
    for (int i = 0; i < DEPTH_RANGES; i++)
        starts[i + 1] += starts[i];
    for (uint32_t b = 0; b < count; b++)
        if (p->records[b].x1 > p->records[b].x0)
            s->blocks[starts[(uint32_t)((p->records[b].depth - low) * scale)]++] = p->records[b];
    s->depth_first = low < INFINITY ? low : 0;
    s->cuts_near = low < s->frame.near;
    return starts[DEPTH_RANGES];
}

/* Lists the faces of the volume that the surface comes near, where it ends. */
static void list_borders(struct sp_surface *s, const struct sp_surface_input *input) {
    const struct sp_grid *grid = input->grid;
    const uint32_t near = SURFACE_BLOCK; /* cells; more than kernels reach */
    double det;
    bool touches[3][2] = { { false } };
    for (uint32_t b = 0; b < s->points->block_count; b++)
        for (int a = 0; a < 3; a++) {
            const uint32_t corner = s->points->blocks[b].corner[a];
            touches[a][0] = touches[a][0] || corner < near;
            touches[a][1] = touches[a][1] || corner + 2 * near >= grid->dims[a];
        }
    const struct sp_mat3 direction = sp_grid_directions(grid);
    const struct sp_mat3 inverse = sp_mat3_inverse(&direction, &det);
    s->borders.count = 0;
    for (unsigned a = 0; a < 3; a++)
        for (int side = 0; side < 2; side++) {
            struct sp_vec3 n = sp_vec3_from(inverse.m[a]), at = { { 0 } };
            if (!touches[a][side])
                continue;
            n = sp_vec3_scale(n, (side ? -1 : 1) / sp_vec3_length(n));
            const double end = side ? sp_grid_distance(grid, a, grid->dims[a] - 1) : 0;
            for (int r = 0; r < 3; r++)
                at.v[r] = grid->origin[r] + end * grid->direction[r][a] - input->camera->eye.v[r];
            struct sp_clip_half *half = &s->borders.planes[s->borders.count++];
            const struct sp_vec3 c = sp_mat3_apply(&input->camera->w, n);
            half->offset = (float)(sp_vec3_dot(n, at) / s->frame.unit);
            for (int r = 0; r < 3; r++)
                half->normal[r] = (float)c.v[r];
        }
}

static bool bin_blocks(struct sp_surface *s, uint32_t count, struct sp_arena *arena,
                       struct sp_error *err) {
    struct sp_tile_grid grid = { .columns = s->columns, .rows = s->rows };
    struct sp_bins *bins = &s->bins;
    *bins = (struct sp_bins){ .tiles = (uint32_t)(s->columns * s->rows), .blocks = 1 };
    bins->counts = sp_arena_alloc(arena, "counts of tiles", bins->tiles, sizeof *bins->counts);
    bins->first = sp_arena_alloc(arena, "starts of tiles", bins->tiles + 1, sizeof *bins->first);
    if (!bins->counts || !bins->first)
        return sp_arena_fail(arena, "data", err);
    sp_bins_clear(bins, 0);
    sp_bins_count(bins, 0, &grid, s->blocks, count);
    uint64_t total = sp_bins_block_total(bins, 0);
    bins->entries =
        sp_arena_alloc(arena, "lists of tiles", total ? total : 1, sizeof *bins->entries);
    if (!bins->entries)
        return sp_arena_fail(arena, "data", err);
    bins->capacity = (uint32_t)total;
    sp_bins_start(bins, 0, 1);
    sp_bins_fill(bins, 0, &grid, s->blocks, count, 0);
    return true;
}

/* Makes the points close to the eye. Without memory for them, discs close to the eye stay large. */
static bool focus(struct sp_surface *s, const struct sp_surface_input *input,
                  struct sp_error *err) {
    const struct sp_surface_job job = { input->volume, input->layer->value, input->pool,
                                        input->interrupt };
    const float deviation = s->reach / s->frame.radius;
    const float coarse = input->is_enlarged ? (float)(1u << input->points->level) : 1;
    struct sp_error why;
    s->focus = (struct sp_surface_focus){ .frame = &s->frame };
    if (!input->volume || s->frame.projection != SP_PERSPECTIVE)
        return true;
    s->focus.growth = widest / deviation;
    s->focus.least = SURFACE_SIZE_MIN / coarse;
    s->focus.nearest = s->focus.least * deviation / SURFACE_WIDEST;
    s->focus.coarse = coarse;
    if (!sp_surface_extract_near(&job, &s->focus, s->points, input->arena, &s->near, &why)) {
        s->near = (struct sp_surface_points){ 0 };
        if (why.code == SP_ERR_CANCELLED) {
            if (err)
                *err = why;
            return false;
        }
    }
    if (!s->near.block_count)
        s->focus.growth = 0;
    return true;
}

bool sp_surface_prepare(const struct sp_surface_input *input, struct sp_surface *s,
                        struct sp_error *err) {
    const struct sp_layer *layer = input->layer;
    const bool is_opaque = (double)layer->opacity > 1 - 1.0 / 512;
    /* A small tolerance keeps sheets apart that lie close together, but takes more sheets. What is
     * behind an opaque sheet needs none; for translucent ones there are not enough. */
    const float tolerance = is_opaque ? 2 : 3.2f;
    *s = (struct sp_surface){ .points = input->points,
                              .shade = input->shade,
                              .opacity = layer->opacity,
                              .is_opaque = is_opaque,
                              .squeeze = (float)(1 - 1 / layer->flatness),
                              .tolerance = tolerance };
    for (int c = 0; c < 3; c++)
        s->color[c] = layer->color[c];
    init_frame(s, input);
    list_borders(s, input);
    s->columns = (s->frame.size[0] + SP_TILE - 1) / SP_TILE;
    s->rows = (s->frame.size[1] + SP_TILE - 1) / SP_TILE;
    if (!focus(s, input, err))
        return false;
    const uint32_t count = s->points->block_count + s->near.block_count;
    struct preparation p = { .input = input, .surface = s };
    p.records = sp_arena_alloc(input->arena, "blocks", count ? count : 1, sizeof *p.records);
    s->blocks = sp_arena_alloc(input->arena, "blocks", count ? count : 1, sizeof *s->blocks);
    uint32_t *starts =
        sp_arena_alloc(input->arena, "depth ranges", DEPTH_RANGES + 1, sizeof *starts);
    if (!p.records || !s->blocks || !starts)
        return sp_arena_fail(input->arena, "data", err);
    sp_parallel_for(input->pool, count, 256, project_blocks, &p);
    if (sp_interrupt_is_cancelled(&input->interrupt))
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    return bin_blocks(s, sort_blocks(&p, starts), input->arena, err);
}
