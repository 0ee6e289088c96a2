/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/postconv/shear.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "data/volume/grid.h"
#include "splat/slices.h"

/* The least share of visible voxels in the slices that are drawn. Below it deposits are faster. */
static const double least_share = 0.55;

/* From this share on the plane is taken whatever its samples. Below, voxels are surfaces, and with
 * fewer samples per voxel the plane would be up to 7 dB farther from `ewa` than deposits. */
static const double dense = 0.75, fine = 0.8;

/* Above this depth of a slice, most voxels are hidden, which tiles of the image notice sooner. */
static const float opaque = 1.5f;

/* Voxels per sample of the plane, below which the plane itself costs more than it saves. */
static const double few_per_sample = 4;
enum { FEW_VOXELS = 1 << 17 };

/* The plane's samples are as dense as voxels at least (with these samples per voxel at the back),
 * and so that no sheet has a smaller variance [samples²]. */
static const double least_per_voxel = 0.66, least_variance = 0.7;

static const double most_ratio = 2.5; /* of the distances of the last and first slice */

void sp_shear_residual(const struct sp_shear *shear, double x, double y, double distance,
                       double out[3]) {
    double t[3] = { (x - shear->centre[0]) / shear->scale[0],
                    (y - shear->centre[1]) / shear->scale[1], shear->side };
    const double(*p)[3] = shear->pixel.m, (*q)[3] = shear->ray.m;
    double w = p[2][0] * t[0] + p[2][1] * t[1] + p[2][2] * t[2], g[2][2], s[2];
    for (int a = 0; a < 2; a++) {
        s[a] = shear->scale[a] / distance;
        for (int i = 0; i < 2; i++)
            g[a][i] = shear->scale[a] * w * (q[a][i] - t[a] * shear->side * q[2][i]);
    }
    for (int k = 0; k < 3; k++) {
        int a = k == 1, b = k > 0; /* 00, 11, 01 */
        double kernel = shear->sigma2 * ((k < 2) + t[a] * t[b]) - (k < 2 ? 1.0 / 3 : 0);
        out[k] = s[a] * s[b] * kernel + shear->lowpass2 * (g[a][0] * g[b][0] + g[a][1] * g[b][1]);
    }
}

/* True if the axes of the grid are at right angles. */
static bool is_orthogonal(const struct sp_grid *grid) {
    for (int a = 0; a < 3; a++)
        for (int b = 0; b <= a; b++) {
            double dot = 0;
            for (int r = 0; r < 3; r++)
                dot += grid->direction[r][a] * grid->direction[r][b];
            if (!(fabs(dot - (a == b)) < 1e-6))
                return false;
        }
    return true;
}

/* Sets the eye and the rays, in units of voxels along i, j and k. */
static bool find_rays(const struct sp_postconv_input *input, struct sp_shear *shear) {
    const struct sp_grid *grid = &shear->level->grid;
    const struct sp_camera_transform *camera = input->camera;
    const unsigned axes[3] = { shear->across[0], shear->across[1], shear->axis };
    double det;
    for (int n = 0; n < 3; n++) {
        unsigned a = axes[n];
        double row[3] = { 0 };
        shear->eye[n] = 0;
        for (int r = 0; r < 3; r++) {
            double along = grid->direction[r][a] / grid->spacing[a];
            shear->eye[n] += along * (camera->eye.v[r] - grid->origin[r]);
            for (int i = 0; i < 3; i++)
                row[i] += along * camera->w.m[i][r];
        }
        for (int i = 0; i < 2; i++)
            shear->ray.m[n][i] = row[i] / camera->scale;
        shear->ray.m[n][2] =
            row[2] - (row[0] * camera->centre[0] + row[1] * camera->centre[1]) / camera->scale;
    }
    shear->pixel = sp_mat3_inverse(&shear->ray, &det);
    double last = (double)grid->dims[shear->axis] - 1;
    shear->side = shear->eye[2] < 0 ? 1 : -1;
    return det != 0 && (shear->eye[2] < -1 || shear->eye[2] > last + 1);
}

/* Finds the distances of the nearest and the farthest slice [voxels]. */
static void find_distances(const struct sp_shear *shear, double distance[2]) {
    double last = (double)shear->level->grid.dims[shear->axis] - 1;
    distance[0] = shear->side > 0 ? -shear->eye[2] : shear->eye[2] - last;
    distance[1] = distance[0] + last;
}

/* Finds the slopes of the rays that meet the volume and the image; false if the image sees no such
 * ray, or some of its rays do not meet the slices. */
static bool find_slopes(const struct sp_shear *shear, const uint32_t size[2], double slope[2][2]) {
    double distance[2], seen[2][2] = { { INFINITY, -INFINITY }, { INFINITY, -INFINITY } };
    find_distances(shear, distance);
    for (int corner = 0; corner < 4; corner++) {
        double x = corner & 1 ? size[0] : 0, y = corner & 2 ? size[1] : 0, q[3];
        for (int n = 0; n < 3; n++)
            q[n] = shear->ray.m[n][0] * x + shear->ray.m[n][1] * y + shear->ray.m[n][2];
        if (!(q[2] * shear->side > 1e-3 * (fabs(q[0]) + fabs(q[1]))))
            return false;
        for (int a = 0; a < 2; a++) {
            seen[a][0] = fmin(seen[a][0], q[a] / (q[2] * shear->side));
            seen[a][1] = fmax(seen[a][1], q[a] / (q[2] * shear->side));
        }
    }
    for (int a = 0; a < 2; a++) {
        const double reach = 4;
        double low = -reach - shear->eye[a],
               high = shear->level->grid.dims[shear->across[a]] + reach - shear->eye[a];
        slope[a][0] = fmax(seen[a][0], fmin(low / distance[0], low / distance[1]));
        slope[a][1] = fmin(seen[a][1], fmax(high / distance[0], high / distance[1]));
        if (!(slope[a][0] < slope[a][1]))
            return false;
    }
    return true;
}

enum { NODES = 5 };

/* Coordinate of node n of a range. */
static double node(const double range[2], int n) {
    return range[0] + (range[1] - range[0]) * n / (NODES - 1);
}

/* Chooses how dense the plane's samples are, and its size. False if it would be too large. */
static bool choose_plane(struct sp_shear *shear, double slope[2][2]) {
    enum { MOST = 4096 };
    double distance[2], least[2] = { INFINITY, INFINITY };
    find_distances(shear, distance);
    shear->scale[0] = shear->scale[1] = 1;
    shear->centre[0] = shear->centre[1] = 0;
    for (int n = 0; n < NODES * NODES; n++) {
        double r[3];
        sp_shear_residual(shear, node(slope[0], n % NODES), node(slope[1], n / NODES), distance[1],
                          r);
        for (int a = 0; a < 2; a++)
            least[a] = fmin(least[a], r[a] + 1 / (3 * distance[1] * distance[1]));
    }
    for (int a = 0; a < 2; a++) {
        double scale = fmax(least_per_voxel * distance[1], sqrt(least_variance / least[a]));
        double low = floor(scale * slope[a][0]) - 4, high = ceil(scale * slope[a][1]) + 4;
        if (!(high - low < MOST))
            return false;
        shear->scale[a] = scale;
        shear->centre[a] = -low;
        shear->size[a] = (int)(high - low) + 1;
    }
    return true;
}

/* Returns how far a filter reaches. */
static int taps_of(const struct sp_shear *shear, double variance) {
    int n = (int)(fmax(0, variance) * POSTCONV_STEPS) + 1;
    return n < POSTCONV_FILTERS ? shear->taps[n] : POSTCONV_MARGIN;
}

/* Finds how far filters reach; false if there are none for some samples and slices. */
static bool find_margin(struct sp_shear *shear, double slope[2][2]) {
    const double sharpest = 0.02;
    double distance[2], r[3];
    int reach = 1;
    find_distances(shear, distance);
    for (int n = 0; n < 2 * NODES * NODES; n++) {
        double x = node(slope[0], n / 2 % NODES), y = node(slope[1], n / 2 / NODES);
        sp_shear_residual(shear, shear->centre[0] + shear->scale[0] * x,
                          shear->centre[1] + shear->scale[1] * y, distance[n & 1], r);
        double cross = fabs(r[2]), wide = fmax(r[0], r[1]) - cross;
        int diagonal = taps_of(shear, cross), straight = taps_of(shear, wide);
        reach = diagonal + straight > reach ? diagonal + straight : reach;
        if (!(fmin(r[0], r[1]) - cross >= -sharpest) || diagonal > SHEAR_TAPS ||
            straight > SHEAR_TAPS)
            return false;
    }
    shear->margin = (reach + SHEAR_BLOCK - 1) / SHEAR_BLOCK * SHEAR_BLOCK;
    return shear->margin <= SHEAR_MARGIN;
}

static void make_filters(const struct sp_postconv *postconv, struct sp_shear *shear) {
    memset(shear->filter, 0, sizeof shear->filter);
    for (int n = 0; n < POSTCONV_FILTERS; n++) {
        const struct sp_postconv_filter *f = &postconv->tables->filters[postconv->exact][n];
        shear->taps[n] = f->taps;
        for (int k = 0; k <= f->taps && k <= SHEAR_TAPS; k++)
            shear->filter[n][k] = f->weight[f->taps + k];
    }
}

/* True if enough voxels of the bricks' slices in sight are visible, all of one level and kind.
 * share: of the voxels of these slices that are visible. */
static bool is_dense(const struct sp_postconv *postconv, uint8_t *level, double *voxels,
                     double *share) {
    const struct sp_postconv_brick *first = postconv->bricks;
    uint64_t count = 0, slices = 0;
    float deepest = 0;
    for (uint32_t i = 0; i < postconv->brick_count; i++) {
        const struct sp_postconv_brick *b = &postconv->bricks[i];
        const struct sp_visible *list = &sp_postconv_level(postconv, b)->visible;
        const uint16_t *start = list->start[b->brick];
        if (b->is_unfit || b->level != first->level || (b->is_enlarged && b->level) ||
            b->mode != SP_FILTER_EWA)
            return false;
        for (int k = 0; k < SP_BRICK; k++) {
            deepest = fmaxf(deepest, b->depth[k]);
            slices += start[k] != start[k + 1];
        }
        count += start[SP_BRICK];
    }
    *level = postconv->brick_count ? first->level : 0;
    *voxels = (double)count;
    *share = slices ? *voxels / (double)(slices * SP_BRICK * SP_BRICK) : 0;
    return deepest <= opaque && count >= FEW_VOXELS && *share >= least_share;
}

/* True if the view is one that this stage draws. */
static bool is_possible(const struct sp_postconv_input *input, const struct sp_postconv *postconv) {
    return input->camera->projection == SP_PERSPECTIVE && !postconv->exact && !postconv->linear &&
           !postconv->shade && !postconv->insert &&
           (input->detail->levels & (input->detail->levels - 1)) == 0;
}

bool sp_shear_can_draw(const struct sp_postconv_input *input, const struct sp_postconv *postconv,
                       struct sp_shear *shear) {
    uint8_t level;
    double slope[2][2], voxels, share, distance[2];
    if (!is_possible(input, postconv) || !is_dense(postconv, &level, &voxels, &share))
        return false;
    const struct sp_level_frame *part = &postconv->parts[level];
    const struct sp_ewa_frame *ewa = &part->ewa[0];
    const struct sp_grid *grid = &part->level->grid;
    unsigned axis = postconv->axis, across[2] = { axis == 0, axis == 2 ? 1 : 2 };
    *shear = (struct sp_shear){
        .postconv = postconv,
        .level = part->level,
        .axis = axis,
        .across = { across[0], across[1] },
        .sigma2 = (double)ewa->sigma * (double)ewa->sigma,
        .lowpass2 = (double)ewa->lowpass2,
        .length = (float)(grid->spacing[axis] / input->view->transfer_function.reference_length)
    };
    if (part->level->transfer.scale || !is_orthogonal(grid) || !find_rays(input, shear) ||
        !find_slopes(shear, input->view->size, slope) || !choose_plane(shear, slope) ||
        voxels < few_per_sample * shear->size[0] * shear->size[1])
        return false;
    find_distances(shear, distance);
    if (share < dense && fmin(shear->scale[0], shear->scale[1]) < fine * distance[1])
        return false;
    for (int a = 0; a < 2; a++)
        shear->unit[a] = shear->scale[a] * grid->spacing[axis] / grid->spacing[across[a]];
    make_filters(postconv, shear);
    return distance[1] <= most_ratio * distance[0] && find_margin(shear, slope);
}

/* Lists the slices of each layer. */
static bool sort_slices(const struct sp_postconv_input *input, struct sp_shear *shear) {
    const struct sp_postconv *postconv = shear->postconv;
    uint32_t slices = shear->level->grid.dims[shear->axis], layers = postconv->layers;
    unsigned level = (unsigned)(__builtin_ctz(input->detail->levels));
    shear->first = sp_arena_alloc(input->arena, "slices", layers + (size_t)2, sizeof *shear->first);
    shear->slices = sp_arena_alloc(input->arena, "slices", slices, sizeof *shear->slices);
    if (!shear->first || !shear->slices)
        return false;
    memset(shear->first, 0, (layers + (size_t)2) * sizeof *shear->first);
    for (uint32_t k = 0; k < slices; k++)
        shear->first[sp_slices_layer(postconv->layer, layers, level, k) + 2]++;
    for (uint32_t l = 0; l < layers; l++)
        shear->first[l + 2] += shear->first[l + 1];
    for (uint32_t k = 0; k < slices; k++)
        shear->slices[shear->first[sp_slices_layer(postconv->layer, layers, level, k) + 1]++] = k;
    return true;
}

/* Splits `size` into tiles of at most `most`, a multiple of `unit`. */
static void split(int size, int most, int unit, int *tiles, int *tile) {
    *tiles = (size + most - 1) / most;
    *tile = ((size + *tiles - 1) / *tiles + unit - 1) / unit * unit;
}

static bool allocate(const struct sp_postconv_input *input, struct sp_shear *shear) {
    unsigned workers = sp_pool_threads(input->pool);
    split(shear->size[0], SHEAR_WIDTH, 16, &shear->columns, &shear->tile[0]);
    split(shear->size[1], SHEAR_HEIGHT, SHEAR_BLOCK, &shear->rows, &shear->tile[1]);
    shear->plane = sp_arena_alloc(
        input->arena, "plane", (size_t)shear->size[0] * (size_t)shear->size[1], 4 * sizeof(float));
    shear->scratch = sp_arena_alloc(input->arena, "tiles", workers, sizeof *shear->scratch);
    for (unsigned w = 0; shear->scratch && w < workers; w++)
        memset(&shear->scratch[w], 0, sizeof shear->scratch[w]);
    return !input->arena->failed;
}

struct draw {
    const struct sp_shear_kernels *kernels;
    const struct sp_shear *shear;
};

static void draw_tiles(void *user, size_t begin, size_t end, unsigned worker) {
    const struct draw *d = user;
    for (size_t i = begin; i < end; i++)
        d->kernels->tile(d->shear, &d->shear->scratch[worker], (uint32_t)i);
}

static void warp_rows(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct draw *d = user;
    d->kernels->warp(d->shear, (int)begin, (int)end);
}

typedef float vec4 __attribute__((vector_size(16)));

/* Turns lines of `count` samples, `step` apart, into coefficients of a cubic B-spline through them.
 * The first and the last sample go on forever. `lines` lines lie beside each other. */
static void find_coefficients(vec4 *at, size_t step, int count, size_t lines) {
    const float pole = -0.267949192f, gain = 1 - pole; /* √3 − 2 */
    for (int n = 1; n < count; n++) {
        vec4 *to = at + (size_t)n * step;
        for (size_t i = 0; i < lines; i++)
            to[i] = gain * to[i] + pole * (to - step)[i];
    }
    for (int n = count - 1; n-- > 0;) {
        vec4 *to = at + (size_t)n * step;
        for (size_t i = 0; i < lines; i++)
            to[i] = gain * to[i] + pole * (to + step)[i];
    }
}

static void filter_rows(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct sp_shear *shear = ((const struct draw *)user)->shear;
    for (size_t y = begin; y < end; y++)
        find_coefficients((vec4 *)(void *)shear->plane + y * (size_t)shear->size[0], 1,
                          shear->size[0], 1);
}

static void filter_columns(void *user, size_t begin, size_t end, unsigned worker) {
    (void)worker;
    const struct sp_shear *shear = ((const struct draw *)user)->shear;
    find_coefficients((vec4 *)(void *)shear->plane + begin, (size_t)shear->size[0], shear->size[1],
                      end - begin);
}

/* Returns the mean number of pixels of a footprint. */
static double mean_area(const struct sp_shear *shear) {
    const struct sp_postconv *postconv = shear->postconv;
    double sum = 0;
    for (uint32_t i = 0; i < postconv->brick_count; i++) {
        const struct sp_postconv_brick *b = &postconv->bricks[i];
        float v[3], radius = sp_postconv_ewa(postconv, b)->radius;
        sp_postconv_variance(b, sqrtf(b->range[0] * b->range[1]), v);
        sum += M_PI * (double)(radius * radius * sqrtf(fmaxf(0, v[0] * v[1] - v[2] * v[2])));
    }
    return postconv->brick_count ? sum / postconv->brick_count : 0;
}

bool sp_shear_draw(const struct sp_postconv_input *input, const struct sp_shear_kernels *kernels,
                   struct sp_shear *shear, struct sp_error *err) {
    struct sp_frame_stats *stats = &input->frame->stats;
    double clock = sp_interrupt_clock_ms(&input->interrupt);
    struct draw draw = { kernels, shear };
    if (!sort_slices(input, shear) || !allocate(input, shear))
        return sp_arena_fail(input->arena, "data", err);
    sp_parallel_for(input->pool, (size_t)(shear->columns * shear->rows), 1, draw_tiles, &draw);
    if (sp_interrupt_is_cancelled(&input->interrupt))
        return sp_fail(err, SP_ERR_CANCELLED, "", "cancelled");
    sp_parallel_for(input->pool, (size_t)shear->size[1], 16, filter_rows, &draw);
    sp_parallel_for(input->pool, (size_t)shear->size[0], 16, filter_columns, &draw);
    sp_parallel_for(input->pool, input->view->size[1], 16, warp_rows, &draw);
    for (unsigned w = 0; w < sp_pool_threads(input->pool); w++)
        stats->splats += shear->scratch[w].splats;
    stats->fragments += (uint64_t)((double)stats->splats * mean_area(shear));
    stats->stage_count = 3;
    stats->stages[0] = (struct sp_stage_time){ "classify", input->classify_ms };
    stats->stages[1] = (struct sp_stage_time){ "splat", shear->postconv->prepare_ms };
    stats->stages[2] =
        (struct sp_stage_time){ "tile", sp_interrupt_clock_ms(&input->interrupt) - clock };
    return true;
}
