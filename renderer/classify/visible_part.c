/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/visible_part.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "base/vec.h"
#include "classify/gradient.h"
#include "classify/transfer.h"
#include "data/volume/elements.h"
#include "data/volume/grid.h"
#include "data/volume/sample.h"

enum {
    SIDE = 128,       /* samples along an axis */
    SIDE_CLOSE = 320, /* the same for an object that falls between them */
    SEEN_MIN = 256,   /* visible samples below which it is looked for */
    FLOAT_BINS = 1 << 16
};
/* What may be visible. Each has profiles of its own, so that much of one does not make the ends of
 * another count as tails. */
enum source { SOURCE_VOLUME, SOURCE_SHELL, SOURCE_SURFACES, SOURCES };
static const double tail = 0.001;   /* share of the opacity that may lie beyond each end */
static const double faint = 0.002;  /* opacity of a sample that does not count … */
static const double fainter = 0.02; /* … unless it is this share of the highest */

/* The opacity of each value, over the distance between two samples. */
struct weights {
    float *at; /* owned; 0 = invisible */
    uint32_t count;
    double low, scale; /* bin = (value − low) · scale */
};

/* An even choice of the voxels in the clip box, and what of them is visible. */
struct lattice {
    const struct sp_volume_info *info;
    const struct sp_view *view;
    const void *voxels;
    struct sp_gradient_grid gradients; /* used with a gradient axis */
    uint32_t begin[3], dims[3], count[3];
    uint32_t *voxel[3];    /* [axis][sample]: its index in the volume */
    double cells[3], cell; /* mean distance of samples along an axis, and of all; world units */
    double *plane[SP_CLIP_PLANES_MAX][3]; /* [plane][axis][sample]: its share of the dot product */
    double *profile[SOURCES][3];          /* sum of the opacity in each slice */
    uint64_t seen[SOURCES];               /* visible samples */
    uint32_t *first, *last;               /* of each row along axis 0; first > last = empty */
};

/* The visible layers of the view. */
static const struct sp_layer *layer_of(const struct sp_view *view, enum sp_layer_type type) {
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (view->layers[i].type == type && view->layers[i].visible)
            return &view->layers[i];
    return NULL;
}

/* A surface exists within the range of the volume. */
static bool is_surface(const struct sp_volume_info *info, const struct sp_layer *layer) {
    return layer->type == SP_LAYER_SURFACE && layer->visible && layer->opacity > 0 &&
           layer->value > info->range[0] && layer->value <= info->range[1];
}

static bool has_source(const struct sp_view *view, const struct sp_volume_info *info,
                       enum source source) {
    if (source == SOURCE_SHELL)
        return layer_of(view, SP_LAYER_SHELL) != NULL;
    if (source != SOURCE_SURFACES) /* a layer of vectors shows what the volume shows */
        return layer_of(view, SP_LAYER_VOLUME) || layer_of(view, SP_LAYER_VECTORS);
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (is_surface(info, &view->layers[i]))
            return true;
    return false;
}

static double distance_of(const struct lattice *l, unsigned axis, uint32_t i) {
    return sp_grid_distance(&l->info->grid, axis, l->voxel[axis][i]);
}

static void lattice_finish(struct lattice *l) {
    for (int a = 0; a < 3; a++) {
        for (int source = 0; source < SOURCES; source++)
            free(l->profile[source][a]);
        free(l->voxel[a]);
    }
    for (int p = 0; p < SP_CLIP_PLANES_MAX; p++)
        for (int a = 0; a < 3; a++)
            free(l->plane[p][a]);
    free(l->first);
    free(l->last);
}

/* The voxels of an axis whose centres lie in the clip box. */
static void clip_axis(struct lattice *l, unsigned axis) {
    const struct sp_grid *grid = &l->info->grid;
    double ends[2];
    sp_grid_extent(grid, axis, ends);
    double size = ends[1] - ends[0], low = ends[0] + l->view->clip.box[0][axis] * size,
           high = ends[0] + l->view->clip.box[1][axis] * size;
    uint32_t begin = 0, end = grid->dims[axis];
    while (begin < end && sp_grid_distance(grid, axis, begin) < low)
        begin++;
    while (end > begin && sp_grid_distance(grid, axis, end - 1) > high)
        end--;
    l->begin[axis] = begin;
    l->dims[axis] = end - begin;
}

static bool place_samples(struct lattice *l, unsigned axis) {
    uint64_t n = l->count[axis];
    uint32_t *voxel = l->voxel[axis] = malloc(n * sizeof *voxel);
    for (uint64_t i = 0; voxel && i < n; i++)
        voxel[i] = l->begin[axis] + (uint32_t)((2 * i + 1) * l->dims[axis] / (2 * n));
    return voxel != NULL;
}

static bool place_planes(struct lattice *l) {
    const struct sp_grid *grid = &l->info->grid;
    const struct sp_clip *clip = &l->view->clip;
    for (uint32_t p = 0; p < clip->plane_count; p++) {
        const double *n = clip->planes[p].normal;
        for (unsigned a = 0; a < 3; a++) {
            double slope = 0, start = 0;
            for (int r = 0; r < 3; r++) {
                slope += n[r] * grid->direction[r][a];
                start += a == 0 ? n[r] * grid->origin[r] : 0;
            }
            double *at = l->plane[p][a] = malloc(l->count[a] * sizeof *at);
            if (!at)
                return false;
            for (uint32_t i = 0; i < l->count[a]; i++)
                at[i] = start + slope * distance_of(l, a, i);
        }
    }
    return true;
}

/* False when memory is short; count 0 = the clip box has no voxel. */
static bool lattice_init(struct lattice *l, const struct sp_view *view,
                         const struct sp_volume *volume, uint32_t side) {
    double product = 1;
    *l = (struct lattice){ .info = sp_volume_info(volume),
                           .view = view,
                           .voxels = sp_volume_voxels(volume) };
    for (unsigned a = 0; a < 3; a++) {
        clip_axis(l, a);
        uint32_t step = (l->dims[a] + side - 1) / side;
        l->count[a] = step ? l->dims[a] / step : 0;
        l->cells[a] = l->info->grid.spacing[a] * (double)step;
        product *= l->cells[a];
    }
    if (!l->count[0] || !l->count[1] || !l->count[2]) {
        l->count[0] = 0;
        return true;
    }
    l->cell = cbrt(product);
    if (view->transfer_function.gradient_count > 0)
        sp_gradient_grid_init(&l->gradients, volume);
    size_t rows = (size_t)l->count[1] * l->count[2];
    bool ok = (l->first = malloc(rows * sizeof *l->first)) != NULL;
    ok = (l->last = calloc(rows, sizeof *l->last)) && ok;
    for (unsigned a = 0; a < 3; a++) {
        for (int source = 0; source < SOURCES; source++)
            ok = (l->profile[source][a] = calloc(l->count[a], sizeof(double))) && ok;
        ok = place_samples(l, a) && ok;
    }
    if (ok)
        memset(l->first, 0xff, rows * sizeof *l->first);
    return ok && place_planes(l);
}

/* `shell`: only what is opaque enough for it; NULL = all that is not too faint. The outer voxels of
 * what is opaque enough are in the shell, and only they matter here. */
static bool weights_init(struct weights *w, const struct lattice *l, const struct sp_layer *shell) {
    const struct sp_volume_info *info = l->info;
    const struct sp_transfer_function *tf = &l->view->transfer_function;
    bool is_table = info->type != SP_INT32 && info->type != SP_FLOAT32 && info->type != SP_FLOAT64;
    double range = info->range[1] - info->range[0], highest = 0;
    w->count = is_table ? (uint32_t)range + 1 : FLOAT_BINS;
    w->low = info->range[0];
    w->scale = is_table ? 1 : range > 0 ? FLOAT_BINS / range : 0;
    w->at = malloc(w->count * sizeof *w->at);
    if (!w->at)
        return false;
    for (uint32_t i = 0; i < w->count; i++) {
        struct sp_class class;
        double at = is_table ? i : (i + 0.5) / FLOAT_BINS * range;
        sp_transfer_function_eval(tf, w->low + at, &class);
        double opacity = -expm1(-(double)class.depth / tf->reference_length * l->cell);
        if (shell && -expm1(-(double)class.depth) < shell->low)
            opacity = 0;
        w->at[i] = (float)opacity;
        highest = fmax(highest, opacity);
    }
    float least = shell ? 0 : (float)fmin(faint, fainter * highest);
    for (uint32_t i = 0; i < w->count; i++)
        w->at[i] = w->at[i] > least ? w->at[i] : 0;
    return true;
}

static inline float weight_at(const struct weights *w, double value) {
    double bin = (value - w->low) * w->scale;
    if (!(bin >= 0)) /* also NaN */
        return 0;
    return w->at[bin < w->count ? (uint32_t)bin : w->count - 1];
}

static bool is_clipped(const struct lattice *l, const uint32_t at[3]) {
    const struct sp_clip *clip = &l->view->clip;
    for (uint32_t p = 0; p < clip->plane_count; p++)
        if (l->plane[p][0][at[0]] + l->plane[p][1][at[1]] + l->plane[p][2][at[2]] <
            clip->planes[p].offset)
            return true;
    return false;
}

/* The opacity of a visible value after the gradient axis and the clip planes. */
static float remaining(const struct lattice *l, const uint32_t at[3], float weight) {
    const struct sp_view *view = l->view;
    if (is_clipped(l, at))
        return 0;
    if (view->transfer_function.gradient_count == 0)
        return weight;
    const uint32_t voxel[3] = { l->voxel[0][at[0]], l->voxel[1][at[1]], l->voxel[2][at[2]] };
    double g[3];
    sp_gradient_at(&l->gradients, voxel, g);
    double magnitude = sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]) / l->gradients.scale;
    return weight * (float)sp_transfer_function_scale(&view->transfer_function, magnitude);
}

/* Counts a visible sample. */
static inline void see(struct lattice *l, enum source source, const uint32_t at[3], double weight) {
    size_t row = (size_t)at[2] * l->count[1] + at[1];
    for (int a = 0; a < 3; a++)
        l->profile[source][a][at[a]] += weight;
    l->first[row] = l->first[row] < at[0] ? l->first[row] : at[0];
    l->last[row] = l->last[row] > at[0] ? l->last[row] : at[0];
    l->seen[source]++;
}

static uint64_t row_of(const struct lattice *l, const uint32_t at[3]) {
    const uint32_t *dims = l->info->grid.dims;
    return ((uint64_t)l->voxel[2][at[2]] * dims[1] + l->voxel[1][at[1]]) * dims[0];
}

static void read_samples(struct lattice *l, const struct weights *w, enum source source) {
    uint32_t at[3];
    for (at[2] = 0; at[2] < l->count[2]; at[2]++)
        for (at[1] = 0; at[1] < l->count[1]; at[1]++) {
            uint64_t row = row_of(l, at);
            for (at[0] = 0; at[0] < l->count[0]; at[0]++) {
                float weight =
                    weight_at(w, sp_sample(l->voxels, l->info->type, row + l->voxel[0][at[0]]));
                if (weight > 0 && (weight = remaining(l, at, weight)) > 0)
                    see(l, source, at, (double)weight);
            }
        }
}

/* Of which surfaces a sample lies inside, one bit each, and whether it is finite. */
enum { FINITE = 1 << SP_LAYERS_MAX };
static uint16_t sides_of(const struct lattice *l, double value) {
    uint16_t sides = isfinite(value) ? FINITE : 0;
    for (uint32_t i = 0; i < l->view->layer_count; i++)
        if (is_surface(l->info, &l->view->layers[i]) && value >= l->view->layers[i].value)
            sides |= (uint16_t)(1 << i);
    return sides;
}

/* Between two samples beside each other that lie on different sides there is a surface. The one
 * inside is seen. */
static void compare_sides(struct lattice *l, const uint32_t at[3], unsigned axis, uint16_t own,
                          uint16_t other) {
    uint16_t differ = own ^ other;
    if (!(own & other & FINITE) || !differ)
        return;
    uint32_t before[3] = { at[0], at[1], at[2] };
    before[axis]--;
    if (differ & own && !is_clipped(l, at))
        see(l, SOURCE_SURFACES, at, 1);
    if (differ & other && !is_clipped(l, before))
        see(l, SOURCE_SURFACES, before, 1);
}

/* False when memory is short. */
static bool read_surfaces(struct lattice *l) {
    uint32_t at[3];
    uint16_t *slice = malloc((size_t)l->count[0] * l->count[1] * sizeof *slice);
    if (!slice)
        return false;
    for (at[2] = 0; at[2] < l->count[2]; at[2]++)
        for (at[1] = 0; at[1] < l->count[1]; at[1]++) {
            uint64_t row = row_of(l, at);
            uint16_t *own = slice + (size_t)at[1] * l->count[0];
            for (at[0] = 0; at[0] < l->count[0]; at[0]++, own++) {
                uint16_t below = *own;
                *own = sides_of(l, sp_sample(l->voxels, l->info->type, row + l->voxel[0][at[0]]));
                if (at[0] > 0)
                    compare_sides(l, at, 0, *own, own[-1]);
                if (at[1] > 0)
                    compare_sides(l, at, 1, *own, own[-(ptrdiff_t)l->count[0]]);
                if (at[2] > 0)
                    compare_sides(l, at, 2, *own, below);
            }
        }
    free(slice);
    return true;
}

/* The slices of an axis between which all but the tails lie. */
static void trim(const double *profile, uint32_t count, uint32_t ends[2]) {
    double total = 0, sum = 0;
    for (uint32_t i = 0; i < count; i++)
        total += profile[i];
    ends[0] = 0;
    ends[1] = count - 1;
    while (ends[0] < ends[1] && (sum += profile[ends[0]]) <= tail * total)
        ends[0]++;
    for (sum = 0; ends[1] > ends[0] && (sum += profile[ends[1]]) <= tail * total;)
        ends[1]--;
}

/* Fills the box, the centre and the half edges from two distances along each axis. */
static void set_box(const struct sp_grid *grid, const double low[3], const double high[3],
                    struct sp_visible_part *part) {
    for (int r = 0; r < 3; r++)
        part->center[r] = grid->origin[r];
    part->radius = 0;
    for (unsigned a = 0; a < 3; a++) {
        double ends[2];
        sp_grid_extent(grid, a, ends);
        part->box[0][a] = fmax(0, (low[a] - ends[0]) / (ends[1] - ends[0]));
        part->box[1][a] = fmin(1, (high[a] - ends[0]) / (ends[1] - ends[0]));
        for (int r = 0; r < 3; r++) {
            part->center[r] += grid->direction[r][a] * 0.5 * (low[a] + high[a]);
            part->half[a][r] = grid->direction[r][a] * 0.5 * (high[a] - low[a]);
        }
    }
    for (int corner = 0; corner < 4; corner++) {
        struct sp_vec3 at = sp_vec3_from(part->half[0]);
        at = sp_vec3_add(at, sp_vec3_scale(sp_vec3_from(part->half[1]), corner & 1 ? -1 : 1));
        at = sp_vec3_add(at, sp_vec3_scale(sp_vec3_from(part->half[2]), corner & 2 ? -1 : 1));
        part->radius = fmax(part->radius, sqrt(sp_vec3_dot(at, at)));
    }
}

static void set_whole(const struct sp_grid *grid, struct sp_visible_part *part) {
    double low[3], high[3];
    for (unsigned a = 0; a < 3; a++) {
        double ends[2];
        sp_grid_extent(grid, a, ends);
        low[a] = ends[0];
        high[a] = ends[1];
    }
    set_box(grid, low, high, part);
}

/* The border before sample i of an axis: in the middle between two samples. */
static double border(const struct lattice *l, unsigned axis, uint32_t i) {
    double ends[2];
    sp_grid_extent(&l->info->grid, axis, ends);
    double size = ends[1] - ends[0];
    if (i == 0)
        return ends[0] + l->view->clip.box[0][axis] * size;
    if (i == l->count[axis])
        return ends[0] + l->view->clip.box[1][axis] * size;
    return 0.5 * (distance_of(l, axis, i - 1) + distance_of(l, axis, i));
}

/* The square of the distance of the farthest corner of a sample's cell from the centre. */
static double reach_of(const struct lattice *l, const uint32_t at[3], const double center[3]) {
    const struct sp_grid *grid = &l->info->grid;
    double d[3], square = 0;
    for (unsigned a = 0; a < 3; a++) {
        d[a] = distance_of(l, a, at[a]) - center[a];
        d[a] += copysign(0.5 * l->cells[a], d[a]);
    }
    for (int r = 0; r < 3; r++) {
        double v = grid->direction[r][0] * d[0] + grid->direction[r][1] * d[1] +
                   grid->direction[r][2] * d[2];
        square += v * v;
    }
    return square;
}

/* The radius around the centre that holds the ends of all rows between `ends`. */
static double radius_of(const struct lattice *l, uint32_t ends[3][2], const double center[3]) {
    double most = 0;
    for (uint32_t k = ends[2][0]; k <= ends[2][1]; k++)
        for (uint32_t j = ends[1][0]; j <= ends[1][1]; j++) {
            size_t row = (size_t)k * l->count[1] + j;
            for (int side = 0; side < 2 && l->first[row] <= l->last[row]; side++) {
                uint32_t i = side ? l->last[row] : l->first[row];
                i = i < ends[0][0] ? ends[0][0] : i > ends[0][1] ? ends[0][1] : i;
                most = fmax(most, reach_of(l, (const uint32_t[3]){ i, j, k }, center));
            }
        }
    return sqrt(most);
}

/* The slices of an axis between which all that is visible lies. */
static void bound_axis(const struct lattice *l, unsigned axis, uint32_t ends[2]) {
    ends[0] = l->count[axis] - 1;
    ends[1] = 0;
    for (int source = 0; source < SOURCES; source++) {
        uint32_t own[2];
        if (l->seen[source] == 0)
            continue;
        trim(l->profile[source][axis], l->count[axis], own);
        ends[0] = own[0] < ends[0] ? own[0] : ends[0];
        ends[1] = own[1] > ends[1] ? own[1] : ends[1];
    }
}

static void set_part(const struct lattice *l, struct sp_visible_part *part) {
    uint32_t ends[3][2];
    double low[3], high[3], center[3];
    for (unsigned a = 0; a < 3; a++) {
        bound_axis(l, a, ends[a]);
        low[a] = border(l, a, ends[a][0]);
        high[a] = border(l, a, ends[a][1] + 1);
        center[a] = 0.5 * (low[a] + high[a]);
    }
    set_box(&l->info->grid, low, high, part);
    part->radius = fmin(part->radius, radius_of(l, ends, center));
    part->is_visible = true;
}

/* False when memory is short. */
static bool read_source(struct lattice *l, enum source source) {
    struct weights w = { NULL };
    if (source == SOURCE_SURFACES)
        return read_surfaces(l);
    const struct sp_layer *shell =
        source == SOURCE_SHELL ? layer_of(l->view, SP_LAYER_SHELL) : NULL;
    if (!weights_init(&w, l, shell))
        return false;
    read_samples(l, &w, source);
    free(w.at);
    return true;
}

/* Reads at most side³ samples for each source. */
static bool measure_visible(const struct sp_view *view, const struct sp_volume *volume,
                            uint32_t side, bool *is_missed, struct sp_visible_part *part) {
    struct lattice l;
    bool ok = lattice_init(&l, view, volume, side), is_seen = false;
    *is_missed = false;
    for (int source = 0; ok && l.count[0] > 0 && source < SOURCES; source++) {
        if (!has_source(view, l.info, source))
            continue;
        ok = read_source(&l, source);
        is_seen = is_seen || l.seen[source] > 0;
        *is_missed = *is_missed ||
                     (l.seen[source] < SEEN_MIN && memcmp(l.count, l.dims, sizeof l.count) != 0);
    }
    if (ok && is_seen)
        set_part(&l, part);
    lattice_finish(&l);
    return ok;
}

/* The core of the volume's elements, if a visible layer shows them. */
static void measure_elements(const struct sp_view *view, const struct sp_volume *volume,
                             struct sp_visible_part *part) {
    const struct sp_grid *grid = &sp_volume_info(volume)->grid;
    double low[3], high[3];
    for (uint32_t i = 0; i < view->layer_count; i++)
        part->is_visible =
            part->is_visible || (view->layers[i].visible &&
                                 view->layers[i].type >= SP_LAYER_POINTS && !view->layers[i].id[0]);
    if (!part->is_visible || !sp_elements_core(sp_volume_elements(volume), low, high))
        return;
    for (int a = 0; a < 3; a++) {
        low[a] -= grid->origin[a];
        high[a] -= grid->origin[a];
    }
    set_box(grid, low, high, part);
}

bool sp_view_compute_visible_part(const struct sp_view *view, const struct sp_volume *volume,
                                  struct sp_visible_part *part, struct sp_error *err) {
    bool is_missed;
    *part = (struct sp_visible_part){ .is_visible = false };
    set_whole(&sp_volume_info(volume)->grid, part);
    if (sp_view_draws_slices(view)) {
        part->is_visible = true;
        return true;
    }
    if (sp_volume_elements(volume)) {
        measure_elements(view, volume, part);
        return true;
    }
    if (measure_visible(view, volume, SIDE, &is_missed, part) &&
        (!is_missed || measure_visible(view, volume, SIDE_CLOSE, &is_missed, part)))
        return true;
    return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for the visible part");
}
