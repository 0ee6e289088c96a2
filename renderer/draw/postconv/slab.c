/* SPDX-License-Identifier: Apache-2.0 */
#include "draw/postconv/slab.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

/* Voxels of one layer of a tile may differ by this factor in distance. */
static const float unlike = 1.3f;

/* What remains of the variance must suffice for the deposit and a filter [px²]. */
static const float least_variance = 0.7f;

/* Moving samples by half a sample takes a filter of this variance [samples²]. */
static const float least_filter = 0.25f;

/* Share of a filter's weight that may be missing at its ends, unless it must be exact. */
static const float negligible = 0.004f;

/* The general path draws exact slabs where a view asks for them. */
static const double most_cutoff = 4;

bool sp_slab_can_draw(const struct sp_view *view) {
    return view->compositing.mode == SP_COMPOSITE_SLAB &&
           view->compositing.attenuation == SP_ATTENUATION_EXPONENTIAL &&
           (view->filter.mode == SP_FILTER_EWA || view->filter.mode == SP_FILTER_ADAPTIVE) &&
           view->filter.cutoff < most_cutoff;
}

void sp_slab_choose(struct sp_postconv *postconv, double apart, bool pairs) {
    const double least = 0.75; /* slices per slab; fewer would be thinner than the view asks for */
    double parts = apart / postconv->view->compositing.slab;
    if (floor(parts + 0.5) > SLAB_PARTS || parts < least)
        return;
    parts = pairs ? 0.5 * parts : parts;
    postconv->slab_slices = parts < least ? 2 : 1;
    postconv->slab_parts = parts < least ? 1 : (int)(parts + 0.5);
    for (uint32_t k = 0; k < postconv->layers; k++)
        postconv->layer[k] /= (uint32_t)postconv->slab_slices;
}

static double phi(double x) {
    return 0.5 * erfc(-x * M_SQRT1_2);
}

/* Depth and image position of a kernel at 1/u2 = w in the middle of the tile: `variance` of its
 * depth [layers²] and how far it moves in the image per layer [px]. The kernels of several slices
 * that share a layer lie around its middle, which adds to the variance of the depth alone. */
static void find_motion(const struct sp_postconv *postconv, const struct sp_slab_tile *slab,
                        float w, double move[2], double *variance) {
    const struct sp_ewa_frame *f = sp_postconv_ewa(postconv, slab->brick);
    bool is_perspective = f->projection == SP_PERSPECTIVE;
    double t[2] = { 0, 0 }, fx = (double)f->scale * (is_perspective ? (double)w : 1), det;
    unsigned axis = postconv->axis;
    struct sp_mat3 m;
    for (int i = 0; i < 2 && is_perspective; i++)
        t[i] = (double)slab->ratio[i];
    double length = sqrt(1 + t[0] * t[0] + t[1] * t[1]);
    for (int a = 0; a < 3; a++) {
        for (int i = 0; i < 2; i++)
            m.m[i][a] = fx * ((double)f->step[i][a] - t[i] * (double)f->step[2][a]);
        m.m[2][a] =
            (t[0] * (double)f->step[0][a] + t[1] * (double)f->step[1][a] + (double)f->step[2][a]) /
            length;
    }
    struct sp_mat3 inverse = sp_mat3_inverse(&m, &det);
    double sigma2 = (double)f->sigma * (double)f->sigma, lowpass2 = (double)f->lowpass2;
    const double *slope = inverse.m[axis]; /* slices per px, at one distance from the eye */
    *variance = sigma2 + lowpass2 * (slope[0] * slope[0] + slope[1] * slope[1]);
    double slices = postconv->slab_slices, all = *variance + (slices * slices - 1) / 12;
    for (int i = 0; i < 2; i++) {
        move[i] = (sigma2 * m.m[i][axis] + lowpass2 * slope[i]) / all * slices;
        move[i] = postconv->is_backwards ? -move[i] : move[i];
    }
    *variance = all / (slices * slices);
}

/* The share of each sheet j in each part k of a layer, and its depth [layers]. */
struct shares {
    int reach;
    double share[SLAB_PARTS][SLAB_SLOTS];
    double slope;    /* mean depth of a part over the distance of its slab's middle */
    double variance; /* of these means [layers²] */
};

static void find_shares(int parts, double variance, struct shares *s) {
    double deviation = sqrt(variance), sum = 0, along = 0, square = 0;
    s->reach = (int)ceil(2.2 * deviation - 0.5);
    s->reach = s->reach < 1 ? 1 : s->reach > SLAB_REACH ? SLAB_REACH : s->reach;
    for (int k = 0; k < parts; k++)
        for (int j = -s->reach; j <= s->reach; j++) {
            double low = -0.5 + (double)k / parts - j, high = low + 1.0 / parts;
            double a = low / deviation, b = high / deviation, share = phi(b) - phi(a);
            double middle = 0.5 * (low + high);
            s->share[k][j + s->reach] = share;
            sum += share;
            along += deviation * (exp(-0.5 * a * a) - exp(-0.5 * b * b)) / sqrt(2 * M_PI) * middle;
            square += share * middle * middle;
        }
    s->slope = along / square;
    s->variance = s->slope * s->slope * square / sum;
    for (int k = 0; k < parts; k++)
        for (int i = 0; i <= 2 * s->reach; i++)
            s->share[k][i] /= sum;
}

/* The variance of a layer's footprints, and what the shifts of its parts add to it [px²]. */
static void find_variances(const struct sp_postconv *postconv, const struct sp_slab_tile *slab,
                           float w, double move[2], struct shares *shares, float v[3],
                           float shifted[3]) {
    double variance;
    find_motion(postconv, slab, w, move, &variance);
    find_shares(postconv->slab_parts, variance, shares);
    sp_postconv_variance(slab->brick, w, v);
    double moved = shares->variance * (move[0] * move[0] + move[1] * move[1]);
    double least = fmin((double)v[0], (double)v[1]) - fabs((double)v[2]);
    double most = fmax(0, least - (double)least_variance) / 1.21;
    double less = moved > most ? sqrt(most / moved) : 1;
    for (int a = 0; a < 2; a++)
        move[a] *= less;
    for (int a = 0; a < 3; a++)
        shifted[a] = (float)(shares->variance * move[a == 1] * move[a != 0]);
}

bool sp_slab_layer_init(const struct sp_postconv *postconv, const struct sp_slab_tile *slab,
                        float w, struct sp_slab_layer *layer) {
    double move[2], slope;
    float v[3], shifted[3], left[3], per_px[2];
    struct shares shares;
    struct sp_postconv_group *g = &layer->group;
    find_variances(postconv, slab, w, move, &shares, v, shifted);
    slope = shares.slope;
    layer->reach = shares.reach;
    for (int k = 0; k < postconv->slab_parts; k++)
        for (int j = 0; j <= 2 * shares.reach; j++)
            layer->share[k][j] = (float)shares.share[k][j];
    int farthest = 0;
    for (int a = 0; a < 2; a++) {
        per_px[a] = ldexpf(1, -slab->scale[a]);
        layer->step[a] = slope * move[a] * (double)per_px[a];
        double beyond = postconv->slab_parts > 1 ? 0.5 : 0; /* of the middles of parts */
        int far = (int)ceil(fabs(layer->step[a]) * (shares.reach + beyond));
        farthest = far > farthest ? far : farthest;
    }
    for (int a = 0; a < 3; a++)
        left[a] = v[a] - shifted[a];
    *g = (struct sp_postconv_group){ .reference = { v[0], v[1] },
                                     .middle = w,
                                     .range = { 0, INFINITY },
                                     .scale = { slab->scale[0], slab->scale[1] },
                                     .sign = left[2] < 0 ? -1 : 1 };
    if (!sp_postconv_group_find(postconv, left, farthest + 1, g))
        return false;
    for (int a = 0; a < 2; a++) {
        const struct sp_postconv_filter *first = postconv->tables->filters[postconv->exact];
        if (g->scale[a] == 0 && (float)(g->filter[a] - first) < least_filter * POSTCONV_STEPS)
            return false;
        g->base[a] += shifted[a] * per_px[a] * per_px[a];
    }
    g->cross += shifted[2] * per_px[0] * per_px[1];
    float radius = sp_postconv_ewa(postconv, slab->brick)->radius;
    g->area = (float)M_PI * radius * radius * sqrtf(fmaxf(0, v[0] * v[1] - v[2] * v[2]));
    return true;
}

/* Drops taps at both ends that hardly weigh anything, and lets the others add up to 1. */
static void trim(struct sp_postconv_filter *filter, float least) {
    int n = 2 * filter->taps, cut = 0;
    float lost = 0;
    while (cut < filter->taps && lost + filter->weight[cut] + filter->weight[n - cut] <= least) {
        lost += filter->weight[cut] + filter->weight[n - cut];
        cut++;
    }
    filter->taps -= cut;
    for (int k = 0; k <= 2 * filter->taps; k++)
        filter->weight[k] = filter->weight[k + cut] / (1 - lost);
}

void sp_slab_filter_init(const struct sp_postconv *postconv, const struct sp_postconv_group *g,
                         int axis, float part, struct sp_postconv_filter *filter) {
    const struct sp_postconv_filter *all = postconv->tables->filters[postconv->exact];
    /* Two neighbouring samples share a pixel, which adds this variance. */
    float steps = fmaxf(0, (float)(g->filter[axis] - all) - part * (1 - part) * POSTCONV_STEPS);
    int low = (int)steps;
    const struct sp_postconv_filter *from[2] = { &all[low], &all[low + 1] };
    float share[2] = { 1 - (steps - (float)low), steps - (float)low };
    memset(filter, 0, sizeof *filter);
    filter->taps = from[1]->taps + 1;
    for (int i = 0; i < 2; i++)
        for (int k = -from[i]->taps; k <= from[i]->taps; k++) {
            float weight = share[i] * from[i]->weight[k + from[i]->taps];
            filter->weight[filter->taps + k] += (1 - part) * weight;
            filter->weight[filter->taps + k - 1] += part * weight;
        }
    trim(filter, postconv->exact ? 0 : negligible);
}

/* The normal of the slices in camera space. */
static struct sp_vec3 slice_normal(const struct sp_postconv *postconv,
                                   const struct sp_ewa_frame *f) {
    unsigned first = postconv->axis == 0, second = postconv->axis == 2 ? 1 : 2;
    struct sp_vec3 side[2];
    for (int r = 0; r < 3; r++) {
        side[0].v[r] = f->step_hi[r][first];
        side[1].v[r] = f->step_hi[r][second];
    }
    return sp_vec3_cross(side[0], side[1]);
}

float sp_slab_layer_place(const struct sp_postconv *postconv, const struct sp_slab_tile *slab,
                          uint32_t layer) {
    const struct sp_ewa_frame *f = sp_postconv_ewa(postconv, slab->brick);
    const struct sp_vec3 ray = { { (double)slab->ratio[0], (double)slab->ratio[1], 1 } };
    if (f->projection != SP_PERSPECTIVE)
        return 1;
    struct sp_vec3 normal = slice_normal(postconv, f), at = sp_vec3_from(f->base);
    double slices = postconv->slab_slices, last = postconv->layers - 1;
    double slice = fmin((layer + 0.5) * slices - 0.5, last);
    slice = postconv->is_backwards ? last - slice : slice;
    for (int r = 0; r < 3; r++)
        at.v[r] += f->step_hi[r][postconv->axis] * slice;
    float w = (float)(sp_vec3_dot(normal, ray) / sp_vec3_dot(normal, at));
    return fminf(fmaxf(w, slab->range[0]), slab->range[1]);
}

/* True if there are filters for the layers of a tile. */
static bool has_filters(const struct sp_postconv *postconv, const struct sp_slab_tile *slab) {
    enum { STEPS = 4 };
    struct sp_slab_layer layer;
    float step = powf(slab->range[1] / slab->range[0], 1.0f / STEPS), w = slab->range[0];
    for (int k = 0; k <= STEPS; k++, w *= step)
        if (!sp_slab_layer_init(postconv, slab, w, &layer))
            return false;
    return true;
}

bool sp_slab_tile_init(const struct sp_postconv *postconv, uint32_t tile,
                       struct sp_slab_tile *slab) {
    uint32_t begin = postconv->first[tile], end = postconv->first[tile + 1];
    *slab = (struct sp_slab_tile){ .range = { INFINITY, 0 } };
    if (begin == end)
        return false;
    uint8_t most[2] = { POSTCONV_SCALES - 1, POSTCONV_SCALES - 1 };
    for (uint32_t n = begin; n < end; n++) {
        const struct sp_postconv_brick *b = &postconv->bricks[postconv->met[n]];
        if (b->range[0] < slab->range[0])
            slab->brick = b;
        slab->range[0] = fminf(slab->range[0], b->range[0]);
        slab->range[1] = fmaxf(slab->range[1], b->range[1]);
        for (int a = 0; a < 2; a++)
            most[a] = b->scale_max[a] < most[a] ? b->scale_max[a] : most[a];
    }
    const struct sp_ewa_frame *f = sp_postconv_ewa(postconv, slab->brick);
    const uint32_t at[2] = { tile % (uint32_t)postconv->columns,
                             tile / (uint32_t)postconv->columns };
    for (int a = 0; a < 2; a++) {
        float middle = ((float)at[a] + 0.5f) * POSTCONV_TILE;
        slab->ratio[a] = (middle - f->centre[a]) / f->scale;
    }
    /* As wide as all layers allow; the farthest ones have the smallest footprints. */
    double move[2];
    float v[3], shifted[3];
    struct shares shares;
    find_variances(postconv, slab, slab->range[0], move, &shares, v, shifted);
    slab->reach = shares.reach; /* kernels of the farthest ones are widest along the ray */
    for (int a = 0; a < 2; a++)
        while (slab->scale[a] < most[a] &&
               v[a] - shifted[a] >=
                   postconv->smooth[slab->scale[a] > 0] * (float)(4 << 2 * slab->scale[a]))
            slab->scale[a]++;
    while (!has_filters(postconv, slab)) {
        int a = slab->scale[1] > slab->scale[0];
        if (slab->scale[a] == 0)
            return false;
        slab->scale[a]--;
    }
    return true;
}

/* True if the voxels of each layer are about equally far away all over the tile. They are where the
 * plane of the layer meets the rays: u2 = constant/(n·(t0, t1, 1)). */
static bool is_level(const struct sp_postconv *postconv, const struct sp_slab_tile *slab) {
    const struct sp_ewa_frame *f = sp_postconv_ewa(postconv, slab->brick);
    double low = INFINITY, high = -INFINITY;
    if (f->projection != SP_PERSPECTIVE)
        return true;
    struct sp_vec3 normal = slice_normal(postconv, f);
    for (int corner = 0; corner < 4; corner++) {
        double half = 0.5 * POSTCONV_TILE / (double)f->scale;
        double x = (double)slab->ratio[0] + (corner & 1 ? half : -half);
        double y = (double)slab->ratio[1] + (corner & 2 ? half : -half);
        double at = normal.v[0] * x + normal.v[1] * y + normal.v[2];
        low = fmin(low, at);
        high = fmax(high, at);
    }
    return low * high > 0 && fmax(fabs(low), fabs(high)) <= unlike * fmin(fabs(low), fabs(high));
}

/* True if the layers are in the order of the slices, or the other way round. */
static bool is_ordered(const struct sp_postconv *postconv) {
    uint32_t last = postconv->layers - 1, farthest = last / (uint32_t)postconv->slab_slices;
    return (postconv->layer[0] == 0 && postconv->layer[last] == farthest) ||
           (postconv->layer[0] == farthest && postconv->layer[last] == 0);
}

bool sp_slab_fits(const struct sp_postconv *postconv) {
    struct sp_slab_tile slab;
    if (!is_ordered(postconv))
        return false;
    for (uint32_t i = 0; i < postconv->brick_count; i++)
        if (postconv->bricks[i].is_unfit || postconv->bricks[i].level > 0)
            return false;
    for (int t = 0; t < postconv->columns * postconv->rows; t++)
        if (postconv->first[t] < postconv->first[t + 1] &&
            !(sp_slab_tile_init(postconv, (uint32_t)t, &slab) && is_level(postconv, &slab)))
            return false;
    return true;
}

struct sp_slab_sheet *sp_slab_sheets_create(struct sp_arena *arena) {
    struct sp_slab_sheet *sheets = sp_arena_alloc(arena, "sheets", SLAB_SLOTS, sizeof *sheets);
    for (int i = 0; sheets && i < SLAB_SLOTS; i++)
        sheets[i] =
            (struct sp_slab_sheet){ .grid = sp_postconv_grid_create(arena), .row0 = POSTCONV_GRID };
    return sheets;
}
