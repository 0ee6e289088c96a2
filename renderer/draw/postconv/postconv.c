/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/postconv/postconv.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/minmax.h"
#include "data/volume/grid.h"
#include "frame/fragments.h"
#include "splat/slices.h"

/* True if the plane n·t ≥ offset clips no kernel of the grid. */
static bool is_beyond(const double normal[3], double offset, const struct sp_grid *grid,
                      const struct sp_filter *filter) {
    double largest = fmax(fabs(normal[0]), fmax(fabs(normal[1]), fabs(normal[2])));
    double lowest = 0, length2 = 0, spacing2 = 0;
    for (int r = 0; r < 3; r++) {
        lowest += normal[r] / largest * grid->origin[r];
        length2 += normal[r] / largest * (normal[r] / largest);
    }
    for (unsigned a = 0; a < 3; a++) {
        double extent[2], along = 0;
        sp_grid_extent(grid, a, extent);
        for (int r = 0; r < 3; r++)
            along += normal[r] / largest * grid->direction[r][a];
        lowest += fmin(along * extent[0], along * extent[1]);
        spacing2 += grid->spacing[a] * grid->spacing[a];
    }
    double reach = fmax(4 * sp_kernel_sigma(filter), sp_kernel_reach(filter));
    return lowest - offset / largest >= reach * sqrt(spacing2 * length2);
}

/* True if anything is clipped. A plane that is far enough away does not count, so that it does not
 * change how the image is drawn. */
static bool is_cut(const struct sp_view *view, const struct sp_grid *grid) {
    const struct sp_clip *clip = &view->clip;
    for (int a = 0; a < 3; a++)
        if (clip->box[0][a] > 0 || clip->box[1][a] < 1)
            return true;
    for (uint32_t i = 0; i < clip->plane_count; i++)
        if (!is_beyond(clip->planes[i].normal, clip->planes[i].offset, grid, &view->filter))
            return true;
    return false;
}

/* Filters reach at least three deviations, so they cannot draw a Gaussian with a smaller cutoff. */
static const double least_cutoff = 3;

bool sp_postconv_can_draw(const struct sp_view *view, const struct sp_grid *grid) {
    return view->compositing.mode == SP_COMPOSITE_SHEET &&
           view->filter.kernel == SP_KERNEL_GAUSSIAN && view->filter.mode != SP_FILTER_NONE &&
           view->filter.cutoff >= least_cutoff && view->transfer_function.order == SP_TF_PRE &&
           !sp_grid_is_rectilinear(grid) && !is_cut(view, grid);
}

struct prepare {
    const struct sp_postconv_input *input;
    struct sp_postconv *postconv;
    struct sp_postconv_brick *slots; /* by brick of the level */
    float length;                    /* of a ray in a layer, reference lengths */
    float deepest;                   /* of the transfer function, over one of them */
    bool *sight;                     /* by brick: it may be visible */
};

/* Computes the variance of a brick's footprints at u. */
static void compute_variance(const struct sp_ewa_frame *f, enum sp_filter_mode mode, unsigned axis,
                             const float u[3], struct sp_postconv_brick *b) {
    float *v = b->spread, *scale = &b->scale, *lowpass2 = &b->lowpass2;
    unsigned across[2] = { axis == 0, axis == 2 ? 1 : 2 };
    float t[2] = { 0, 0 }, fx = f->scale, m[2][3];
    if (f->projection == SP_PERSPECTIVE) {
        fx /= u[2];
        for (int i = 0; i < 2; i++)
            t[i] = fmaxf(-f->ratio_max[i], fminf(f->ratio_max[i], u[i] / u[2]));
    }
    for (int i = 0; i < 2; i++)
        for (int a = 0; a < 3; a++)
            m[i][a] = fx * (f->kernel[i][a] - t[i] * f->kernel[2][a]);
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < 2; i++)
            b->step[k][i] = fx * (f->step[i][across[k]] - t[i] * f->step[2][across[k]]);
    v[0] = m[0][0] * m[0][0] + m[0][1] * m[0][1] + m[0][2] * m[0][2];
    v[1] = m[1][0] * m[1][0] + m[1][1] * m[1][1] + m[1][2] * m[1][2];
    v[2] = m[0][0] * m[1][0] + m[0][1] * m[1][1] + m[0][2] * m[1][2];
    *scale = 1;
    *lowpass2 = f->lowpass2;
    if (mode == SP_FILTER_LOWPASS)
        *scale = 0;
    if (mode == SP_FILTER_RECONSTRUCTION || mode == SP_FILTER_SWAN)
        *lowpass2 = SP_VARIANCE_MIN;
    if (mode == SP_FILTER_SWAN) {
        float half = 0.5f * (v[0] + v[1]), apart = 0.5f * (v[0] - v[1]);
        float smaller = half - sqrtf(apart * apart + v[2] * v[2]);
        if (smaller < f->lowpass2)
            *scale = f->lowpass2 / fmaxf(smaller, 1e-12f * f->lowpass2);
    }
    float w2 = f->projection == SP_PERSPECTIVE ? u[2] * u[2] : 1;
    for (int i = 0; i < 3; i++)
        v[i] *= *scale * w2;
}

/* Computes the pixels that a brick's voxels can reach; false if none is in the image. */
static bool compute_box(const struct sp_postconv *postconv, const float size[3],
                        struct sp_postconv_brick *b) {
    const struct sp_ewa_frame *f = sp_postconv_ewa(postconv, b);
    float low[2] = { INFINITY, INFINITY }, high[2] = { -INFINITY, -INFINITY };
    float nearest = INFINITY, farthest = -INFINITY;
    for (int corner = 0; corner < 8; corner++) {
        float u[3];
        for (int r = 0; r < 3; r++) {
            u[r] = b->base[r];
            for (int a = 0; a < 3; a++)
                u[r] += corner >> a & 1 ? f->step[r][a] * size[a] : 0;
        }
        nearest = fminf(nearest, u[2]);
        farthest = fmaxf(farthest, u[2]);
        float inv = f->projection == SP_PERSPECTIVE ? 1 / u[2] : 1;
        for (int i = 0; i < 2; i++) {
            float x = f->centre[i] + f->scale * u[i] * inv;
            low[i] = fminf(low[i], x);
            high[i] = fmaxf(high[i], x);
        }
    }
    if (farthest < f->near)
        return false;
    bool near = false;
    b->range[0] = b->range[1] = 1;
    if (f->projection == SP_PERSPECTIVE) {
        near = nearest < f->near;
        b->range[0] = 1 / farthest;
        b->range[1] = 1 / (near ? f->near : nearest);
    }
    float v[3];
    b->is_unfit = b->is_unfit || !sp_postconv_choose_filters(postconv, b);
    sp_postconv_variance(b, b->range[1], v);
    int box[2][2];
    for (int i = 0; i < 2; i++) {
        /* A group may be made for wider footprints, of this brick or of another. */
        float reach = 4 * f->radius * sqrtf(v[i]);
        if (!b->is_unfit)
            reach = 1.1f * postconv->reach * sqrtf(v[i] / (1 - POSTCONV_ALIKE)) + 1;
        b->reach[i] = reach;
        box[0][i] = near ? 0 : (int)fmaxf(0, fminf(low[i] - reach, 16384));
        box[1][i] =
            near ? f->size[i] : (int)fmaxf(0, fminf(high[i] + reach + 1, (float)f->size[i]));
        if (box[0][i] >= box[1][i])
            return false;
    }
    b->x0 = (int16_t)box[0][0];
    b->y0 = (int16_t)box[0][1];
    b->x1 = (int16_t)box[1][0];
    b->y1 = (int16_t)box[1][1];
    return true;
}

/* Filters do not end at the cutoff: at three deviations 1.1 % of the depth is left. For a voxel
 * that is merely opaque (an opacity of 0.999 is a depth of 7) that is little, and footprints would
 * take four times as long. */
static const float most_depth = 24;

/* Returns the depth at a footprint's centre over the depth of a layer of such footprints, at
 * least 1. It is larger for footprints that leave gaps. */
static float compute_peak(const struct sp_postconv_brick *b) {
    float v[3], cell = fabsf(b->step[0][0] * b->step[1][1] - b->step[0][1] * b->step[1][0]);
    sp_postconv_variance(b, sqrtf(b->range[0] * b->range[1]), v);
    float det = fmaxf(v[0] * v[1] - v[2] * v[2], SP_VARIANCE_MIN * SP_VARIANCE_MIN);
    return fmaxf(1, cell / (2 * (float)M_PI * sqrtf(det)));
}

/* Consecutive layers are composited as one up to this depth. */
static const float thin = 0.2f;

/* Computes the largest depth of each slice of the brick along the axis, for the length of a ray in
 * it.
 */
static void compute_depths(const struct prepare *p, struct sp_postconv_brick *b) {
    const struct sp_level *level = sp_postconv_level(p->postconv, b);
    float scale = ldexpf(p->length, b->level) * compute_peak(b);
    for (int k = 0; k < SP_BRICK; k++) {
        b->depth[k] = scale * level->depths[p->postconv->axis][b->brick][k];
        b->is_unfit |= b->depth[k] > most_depth;
    }
}

/* Returns the largest depth of a class. */
static float compute_deepest(const struct sp_transfer_function *tf) {
    float most = 0;
    for (uint32_t i = 0; i < tf->point_count; i++)
        most = fmaxf(most, -log1pf(-tf->points[i].opacity));
    return most;
}

/* Returns the length of a ray in one layer over the transfer function's reference length, in the
 * middle of the image. */
static float layer_length(const struct sp_postconv_input *input) {
    const struct sp_grid *grid = input->grid;
    double det;
    struct sp_mat3 d = sp_grid_steps(grid, 1);
    struct sp_mat3 inverse = sp_mat3_inverse(&d, &det);
    /* Row `axis` of the inverse: slices that a world unit along the ray crosses. */
    double crossed = fabs(
        sp_vec3_dot(sp_vec3_from(inverse.m[input->axis]), sp_vec3_from(input->camera->w.m[2])));
    return (float)(1 / (crossed * input->view->transfer_function.reference_length));
}

/* Computes the position of the brick's first voxel, the distance of its last voxel in voxels, and u
 * of its middle, moved behind the near plane if necessary. */
static void place_brick(const struct sp_postconv *postconv, struct sp_postconv_brick *b,
                        float size[3], float middle[3]) {
    const struct sp_level *level = sp_postconv_level(postconv, b);
    const struct sp_ewa_frame *ewa = sp_postconv_ewa(postconv, b);
    uint32_t corner[3];
    struct sp_ewa_brick place;
    sp_visible_brick_corner(level->visible.bricks, b->brick, corner);
    sp_ewa_brick_init(&place, ewa, corner);
    memcpy(b->base, place.base, sizeof b->base);
    for (int a = 0; a < 3; a++) {
        uint32_t left = level->grid.dims[a] - corner[a];
        size[a] = (float)(left < SP_BRICK ? left : SP_BRICK) - 1;
    }
    for (int r = 0; r < 3; r++) {
        middle[r] = b->base[r];
        for (int a = 0; a < 3; a++)
            middle[r] += 0.5f * ewa->step[r][a] * size[a];
    }
    if (middle[2] < ewa->near)
        middle[2] = ewa->near;
}

static void prepare_bricks(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    struct prepare *p = user;
    const struct sp_detail_brick *bricks = p->input->detail->bricks;
    for (size_t i = begin; i < end && !sp_interrupt_is_cancelled(&p->input->interrupt); i++) {
        struct sp_postconv_brick *b = &p->slots[i];
        const struct sp_level_frame *part = &p->postconv->parts[bricks[i].level];
        const uint64_t *first = &part->level->visible.first[bricks[i].brick];
        const uint8_t *modes = part->modes[bricks[i].is_enlarged];
        float size[3], middle[3];
        p->sight[i] = false;
        if (first[0] == first[1])
            continue;
        *b = (struct sp_postconv_brick){ .brick = bricks[i].brick,
                                         .level = bricks[i].level,
                                         .is_enlarged = bricks[i].is_enlarged,
                                         .mode = (uint8_t)(modes ? modes[bricks[i].brick]
                                                                 : p->input->view->filter.mode) };
        place_brick(p->postconv, b, size, middle);
        compute_variance(sp_postconv_ewa(p->postconv, b), (enum sp_filter_mode)b->mode,
                         p->postconv->axis, middle, b);
        p->sight[i] = compute_box(p->postconv, size, b);
        if (!p->sight[i])
            continue;
        bool is_unfit = b->is_unfit;
        compute_depths(p, b);
        if (b->is_unfit != is_unfit)
            p->sight[i] = compute_box(p->postconv, size, b);
    }
}

static uint64_t count_voxels(const struct sp_postconv *postconv,
                             const struct sp_postconv_brick *b) {
    const uint64_t *first = &sp_postconv_level(postconv, b)->visible.first[b->brick];
    return first[1] - first[0];
}

/* Finds the bricks that each tile meets, and the number of voxels that the tiles look at. */
static bool meet_tiles(struct sp_postconv *postconv, struct sp_arena *arena) {
    uint32_t tiles = (uint32_t)(postconv->columns * postconv->rows);
    postconv->first =
        sp_arena_alloc(arena, "bricks of tiles", tiles + (size_t)2, sizeof *postconv->first);
    if (!postconv->first)
        return false;
    memset(postconv->first, 0, (tiles + (size_t)2) * sizeof *postconv->first);
    for (int pass = 0; pass < 2; pass++) {
        for (uint32_t i = 0; i < postconv->brick_count; i++) {
            const struct sp_postconv_brick *b = &postconv->bricks[i];
            int c1 = (b->x1 - 1) / POSTCONV_TILE, r1 = (b->y1 - 1) / POSTCONV_TILE;
            int met = (c1 - b->x0 / POSTCONV_TILE + 1) * (r1 - b->y0 / POSTCONV_TILE + 1);
            if (pass)
                postconv->work[b->is_unfit] += (double)met * (double)count_voxels(postconv, b);
            for (int r = b->y0 / POSTCONV_TILE; r <= r1; r++)
                for (int c = b->x0 / POSTCONV_TILE; c <= c1; c++) {
                    uint32_t t = (uint32_t)(r * postconv->columns + c);
                    if (pass)
                        postconv->met[postconv->first[t + 1]++] = i;
                    else
                        postconv->first[t + 2]++;
                }
        }
        if (pass)
            break;
        for (uint32_t t = 0; t < tiles; t++)
            postconv->first[t + 2] += postconv->first[t + 1];
        postconv->met = sp_arena_alloc(arena, "bricks of tiles", postconv->first[tiles + 1],
                                       sizeof *postconv->met);
        if (!postconv->met)
            return false;
    }
    return true;
}

static int by_voxels(const void *a, const void *b) {
    const struct sp_postconv_tile_cost *x = a, *y = b;
    return x->voxels == y->voxels ? (x->tile > y->tile) - (x->tile < y->tile)
                                  : (x->voxels < y->voxels) - (x->voxels > y->voxels);
}

/* Sorts the tiles in the order in which workers claim them. */
static bool order_tiles(struct sp_postconv *postconv, struct sp_arena *arena) {
    uint32_t tiles = (uint32_t)(postconv->columns * postconv->rows);
    postconv->order = sp_arena_alloc(arena, "order of tiles", tiles, sizeof *postconv->order);
    if (!postconv->order)
        return false;
    for (uint32_t t = 0; t < tiles; t++) {
        postconv->order[t] = (struct sp_postconv_tile_cost){ .tile = t };
        for (uint32_t n = postconv->first[t]; n < postconv->first[t + 1]; n++)
            postconv->order[t].voxels +=
                count_voxels(postconv, &postconv->bricks[postconv->met[n]]);
    }
    qsort(postconv->order, tiles, sizeof *postconv->order, by_voxels);
    return true;
}

static uint32_t most_met(const struct sp_postconv *postconv) {
    uint32_t most = 0;
    for (int t = 0; t < postconv->columns * postconv->rows; t++)
        if (postconv->first[t + 1] - postconv->first[t] > most)
            most = postconv->first[t + 1] - postconv->first[t];
    return most;
}

/* Returns an empty grid of samples, or NULL if the arena cannot allocate. */
static float (*create_grid(struct sp_arena *arena))[POSTCONV_PITCH][4] {
    float(*grid)[POSTCONV_PITCH][4] = sp_arena_alloc(arena, "tiles", POSTCONV_GRID, sizeof *grid);
    if (grid)
        memset(grid, 0, POSTCONV_GRID * sizeof *grid);
    return grid;
}

static bool allocate_scratch(struct sp_postconv *postconv, unsigned workers,
                             struct sp_arena *arena) {
    size_t most = (size_t)most_met(postconv) * SP_BRICK;
    postconv->scratch = sp_arena_alloc(arena, "tiles", workers, sizeof *postconv->scratch);
    for (unsigned w = 0; postconv->scratch && w < workers; w++) {
        struct sp_postconv_scratch *scratch = &postconv->scratch[w];
        scratch->grid = create_grid(arena);
        memset(scratch->skew, 0, sizeof scratch->skew);
        memset(scratch->across, 0, sizeof scratch->across);
        memset(scratch->sum, 0, sizeof scratch->sum);
        scratch->inserted = postconv->insert ? sp_postconv_inserted_create(arena) : NULL;
        scratch->splats = 0;
        scratch->fragments = 0;
        scratch->runs = sp_arena_alloc(arena, "runs", most, sizeof *scratch->runs);
        scratch->starts =
            sp_arena_alloc(arena, "layers", postconv->layers + (size_t)1, sizeof *scratch->starts);
        scratch->ends =
            sp_arena_alloc(arena, "layers", postconv->layers + (size_t)1, sizeof *scratch->ends);
    }
    return !arena->failed;
}

struct tiles {
    const struct sp_postconv *postconv;
    sp_postconv_tile_fn *draw;
    uint32_t begin, end; /* numbers of the tiles to draw */
};

static void draw_tiles(void *user, size_t begin, size_t end, unsigned worker) {
    const struct tiles *t = user;
    for (size_t i = begin; i < end && !sp_interrupt_is_cancelled(&t->postconv->interrupt); i++) {
        const uint32_t tile = t->postconv->order[i].tile;
        if (tile >= t->begin && tile < t->end)
            t->draw(t->postconv, &t->postconv->scratch[worker], tile);
    }
}

/* Draws all tiles, in bands if the fragments of other layers come in bands. */
static bool draw_bands(const struct sp_postconv_input *input, const struct sp_postconv *postconv,
                       struct sp_error *err) {
    const int height = postconv->rows * POSTCONV_TILE;
    const int step = sp_fragments_rows(input->fragments, POSTCONV_TILE, height);
    const size_t tiles = (size_t)(postconv->columns * postconv->rows);
    for (int y = 0; y < height; y += step) {
        const uint32_t first = (uint32_t)(y / POSTCONV_TILE * postconv->columns);
        struct tiles band = { postconv, input->draw_tile, first,
                              first + (uint32_t)(step / POSTCONV_TILE * postconv->columns) };
        if (!sp_fragments_ensure(input->fragments, y, y + step, err))
            return false;
        sp_parallel_for(input->pool, tiles, 1, draw_tiles, &band);
        if (sp_interrupt_is_cancelled(&input->interrupt))
            return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    }
    return true;
}

/* Returns the layer of each slice. */
static uint32_t *make_layers(const struct sp_postconv_input *input, uint32_t *count) {
    const struct sp_grid *grid = input->grid;
    uint32_t n = *count = grid->dims[input->axis];
    uint32_t *slices = sp_arena_alloc(input->arena, "order of sheets", n, sizeof *slices);
    uint32_t *layers = sp_arena_alloc(input->arena, "order of sheets", n, sizeof *layers);
    if (!slices || !layers)
        return NULL;
    sp_slices_sort(input->camera, grid, input->axis, slices);
    for (uint32_t k = 0; k < n; k++)
        layers[slices[k]] = k;
    return layers;
}

/* True if the layers rise or fall with the slices: the eye is not between slices. */
static bool has_order(const struct sp_postconv *postconv) {
    const uint32_t last = postconv->layers - 1;
    const uint32_t first_slice = postconv->is_backwards ? last : 0;
    return postconv->layer[first_slice] == 0 && postconv->layer[last - first_slice] == last;
}

/* Returns where the layers lie: joined slices in the middle of them. NULL if the arena cannot
 * allocate. */
static const struct sp_layer_places *place_layers(const struct sp_postconv_input *input,
                                                  const struct sp_postconv *postconv) {
    const uint32_t count = postconv->layers;
    struct sp_layer_places *places =
        sp_arena_alloc(input->arena, "places of sheets", 1, sizeof *places);
    float *by_slice = sp_arena_alloc(input->arena, "places of sheets", count, sizeof *by_slice);
    float *by_layer = sp_arena_alloc(input->arena, "places of sheets", count, sizeof *by_layer);
    float *slices = sp_arena_alloc(input->arena, "places of sheets", count, sizeof *slices);
    if (input->arena->failed)
        return NULL;
    sp_layer_places_init_sheets(places, input->camera, input->grid, postconv->axis, by_slice);
    memset(by_layer, 0, count * sizeof *by_layer);
    memset(slices, 0, count * sizeof *slices);
    for (uint32_t k = 0; k < count; k++) {
        const uint32_t layer = postconv->layer[k];
        slices[layer]++;
        by_layer[layer] += (by_slice[k] - by_layer[layer]) / slices[layer];
    }
    places->at = by_layer;
    return places;
}

/* Returns how many consecutive layers are composited as one, at least 1. Only the view and the
 * whole volume decide, so that nothing jumps while the camera moves. It gains little with few
 * slices. It would be visible where voxels are wide, opaque or shaded. */
static uint32_t count_joined(const struct sp_postconv_input *input,
                             const struct sp_postconv *postconv, float deepest) {
    enum { FEW_LAYERS = 64, MOST_JOINED = 4 };
    const double widest = 5;          /* largest width of a voxel [px] */
    const double most = 0.95;         /* largest optical depth of one slice */
    const double most_together = 1.0; /* the same of three or four joined slices */
    const struct sp_grid *grid = input->grid;
    unsigned first = postconv->axis == 0, second = postconv->axis == 2 ? 1 : 2;
    double width = sqrt(grid->spacing[first] * grid->spacing[second]) * input->camera->scale;
    struct sp_vec3 middle = input->camera->eye;
    for (int a = 0; a < 3; a++)
        for (int r = 0; r < 3; r++)
            middle.v[r] -= (a ? 0 : grid->origin[r]) +
                           grid->direction[r][a] * grid->spacing[a] * (grid->dims[a] - 1) / 2;
    if (input->camera->projection == SP_PERSPECTIVE)
        width /= sp_vec3_length(middle);
    double depth = (double)deepest * grid->spacing[postconv->axis] /
                   input->view->transfer_function.reference_length;
    if (postconv->shade || postconv->layers < FEW_LAYERS || width > widest || depth > most)
        return 1;
    double joined = most_together / fmax(depth, 1e-3);
    return joined < 2 ? 2 : joined < MOST_JOINED ? (uint32_t)joined : MOST_JOINED;
}

/* Joins consecutive layers that together add little depth to any pixel, and `most` layers. The
 * transmittance is exact; only the order of colours is lost. The decision is made for the whole
 * frame, so that there is no seam between tiles that meet different bricks. */
static bool join_layers(struct sp_postconv *postconv, uint32_t most, struct sp_arena *arena) {
    float *depth = sp_arena_alloc(arena, "depths of sheets", postconv->layers, sizeof *depth),
          sum = 0;
    uint32_t *joined = sp_arena_alloc(arena, "order of sheets", postconv->layers, sizeof *joined);
    if (!depth || !joined)
        return false;
    memset(depth, 0, postconv->layers * sizeof *depth);
    for (uint32_t i = 0; i < postconv->brick_count; i++) {
        const struct sp_postconv_brick *b = &postconv->bricks[i];
        uint32_t corner[3];
        sp_visible_brick_corner(sp_postconv_level(postconv, b)->visible.bricks, b->brick, corner);
        for (uint32_t k = 0; k < SP_BRICK; k++) {
            if (!(b->depth[k] > 0))
                continue;
            uint32_t layer = sp_slices_layer(postconv->layer, postconv->layers, b->level,
                                             corner[postconv->axis] + k);
            depth[layer] = sp_maxf(depth[layer], b->depth[k]);
        }
    }
    for (uint32_t l = 0; l < postconv->layers; l++) {
        bool is_next = l % most && joined[l - 1] >= l - l % most;
        bool is_joined = l > 0 && (is_next || sum + depth[l] <= thin);
        joined[l] = is_joined ? joined[l - 1] : l;
        sum = is_joined ? sum + depth[l] : depth[l];
    }
    for (uint32_t k = 0; k < postconv->layers; k++)
        postconv->layer[k] = joined[postconv->layer[k]];
    return true;
}

/* Returns the number of deviations from a voxel to the pixels that it matters to. A tile leaves out
 * voxels that are farther away, and may miss less than 1/400 of the light at its edge. For a
 * straight edge of depth d the missing depth is about d/2 · erfc(r/√2). */
static float compute_reach(const struct sp_postconv *postconv, float cutoff, float deepest) {
    float seam = sqrtf(2 * logf(fmaxf(1, 53 * deepest)));
    return fmaxf(cutoff, postconv->exact ? 4 : fminf(4, seam));
}

bool sp_postconv_prepare(const struct sp_postconv_input *input, struct sp_postconv *postconv,
                         struct sp_error *err) {
    const struct sp_view *view = input->view;
    double clock = sp_interrupt_clock_ms(&input->interrupt);
    bool exact = view->filter.mode != SP_FILTER_ADAPTIVE;
    bool linear = view->compositing.attenuation == SP_ATTENUATION_LINEAR;
    *postconv =
        (struct sp_postconv){ .view = view,
                              .frame = input->frame,
                              .interrupt = input->interrupt,
                              .tables = input->tables,
                              .shade = input->shade,
                              .linear = linear,
                              .axis = input->axis,
                              .exact = exact,
                              .smooth = { exact ? 1.3f : 0.56f, exact ? 1.3f : 1 },
                              .parts = input->parts,
                              .columns = (int)(view->size[0] + POSTCONV_TILE - 1) / POSTCONV_TILE,
                              .rows = (int)(view->size[1] + POSTCONV_TILE - 1) / POSTCONV_TILE };
    uint32_t bricks = input->detail->count;
    postconv->layer = make_layers(input, &postconv->layers);
    postconv->is_backwards = postconv->layer && postconv->layer[0] > 0;
    postconv->is_ordered = postconv->layer && has_order(postconv);
    postconv->bricks = sp_arena_alloc(input->arena, "bricks", bricks, sizeof *postconv->bricks);
    struct prepare p = { .input = input,
                         .postconv = postconv,
                         .slots = postconv->bricks,
                         .length = layer_length(input),
                         .deepest = compute_deepest(&view->transfer_function) };
    unsigned coarsest = 31 - (unsigned)__builtin_clz(input->detail->levels | 1);
    postconv->reach = compute_reach(postconv, (float)view->filter.cutoff,
                                    ldexpf(p.deepest * p.length, (int)coarsest));
    p.sight = sp_arena_alloc(input->arena, "bricks", bricks, sizeof *p.sight);
    if (input->arena->failed)
        return sp_arena_fail(input->arena, "data", err);
    sp_parallel_for(input->pool, bricks, 64, prepare_bricks, &p);
    if (sp_interrupt_is_cancelled(&input->interrupt))
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    for (uint32_t i = 0; i < bricks; i++) {
        if (p.sight[i])
            postconv->bricks[postconv->brick_count++] = postconv->bricks[i];
    }
    if (!exact && !linear &&
        !join_layers(postconv, count_joined(input, postconv, p.deepest), input->arena))
        return sp_arena_fail(input->arena, "data", err);
    if (!meet_tiles(postconv, input->arena) || !order_tiles(postconv, input->arena))
        return sp_arena_fail(input->arena, "data", err);
    if (input->fragments && !(postconv->insert = sp_postconv_insert_create(input, postconv)))
        return sp_arena_fail(input->arena, "data", err);
    if (input->frame->depth && !(postconv->places = place_layers(input, postconv)))
        return sp_arena_fail(input->arena, "data", err);
    postconv->prepare_ms = sp_interrupt_clock_ms(&input->interrupt) - clock;
    return true;
}

/* Above this share of unfit voxels, footprints that each tile sets up again take longer than
 * setting up each footprint once. Measured on three scans: 0.2 to 0.33. */
static const double most_unfit = 1.0 / 4;

bool sp_postconv_is_worthwhile(const struct sp_postconv *postconv) {
    if (postconv->insert && !postconv->is_ordered)
        return false;
    return postconv->work[1] <= most_unfit * (postconv->work[0] + postconv->work[1]);
}

bool sp_postconv_draw(const struct sp_postconv_input *input, struct sp_postconv *postconv,
                      struct sp_error *err) {
    struct sp_frame_stats *stats = &input->frame->stats;
    double clock = sp_interrupt_clock_ms(&input->interrupt);
    if (!allocate_scratch(postconv, sp_pool_threads(input->pool), input->arena))
        return sp_arena_fail(input->arena, "data", err);
    const double layers_ms = input->fragments ? input->fragments->ms : 0;
    if (!draw_bands(input, postconv, err))
        return false;
    if (input->fragments)
        clock += input->fragments->ms - layers_ms;
    for (unsigned w = 0; w < sp_pool_threads(input->pool); w++) {
        stats->splats += postconv->scratch[w].splats;
        stats->fragments += postconv->scratch[w].fragments;
    }
    stats->stage_count = 3;
    stats->stages[0] = (struct sp_stage_time){ "classify", input->classify_ms };
    stats->stages[1] = (struct sp_stage_time){ "splat", postconv->prepare_ms };
    stats->stages[2] =
        (struct sp_stage_time){ "tile", sp_interrupt_clock_ms(&input->interrupt) - clock };
    return true;
}
