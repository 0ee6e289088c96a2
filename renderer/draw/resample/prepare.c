/* SPDX-License-Identifier: Apache-2.0
 *
 * Prepares a frame before its pixels are drawn, in the same way for all backends: the mip level,
 * sample coordinates, the volume's faces and clipping planes as half spaces, the metric.
 */
#include "draw/resample/prepare.h"

#include <math.h>
#include <string.h>

#include "data/volume/grid.h"
#include "data/volume/missing.h"
#include "draw/resample/axes.h"
#include "draw/resample/silhouette.h"
#include "frame/resolve.h"

bool sp_resample_draws(const struct sp_view *view) {
    if (sp_compositing_is_projection(view->compositing.mode))
        return true;
    if (view->transfer_function.order != SP_TF_POST)
        return false;
    return view->compositing.mode == SP_COMPOSITE_SHEET ||
           (view->compositing.mode == SP_COMPOSITE_SLAB && sp_view_has_default_filter(view));
}

/* A level is drawn while its samples are at least this wide in the middle of the volume [px]. */
static const double narrowest = 0.7;

/* A block sees at most about this many samples of a sheet, per axis, at the far end of the volume.
 */
static const double most_seen = 200;

/* Returns the width of a sample in the middle of the volume [px]; far: distance of the volume's far
 * end from the eye. */
static double compute_width_px(const struct sp_grid *grid, const struct sp_camera_transform *camera,
                               double *far) {
    double width = 1, distance = 1, radius = 0;
    *far = 1;
    for (int a = 0; a < 3; a++) {
        width *= cbrt(grid->spacing[a]);
        radius += grid->spacing[a] * grid->dims[a] / 2;
    }
    if (camera->projection == SP_PERSPECTIVE) {
        struct sp_vec3 to = sp_vec3_scale(camera->eye, -1);
        for (int r = 0; r < 3; r++)
            for (int a = 0; a < 3; a++)
                to.v[r] += (a ? 0 : grid->origin[r]) +
                           grid->direction[r][a] * grid->spacing[a] * (grid->dims[a] - 1) / 2;
        distance = fmax(sp_vec3_length(to), camera->near);
        *far = distance + radius;
    }
    return width * camera->scale / distance;
}

unsigned sp_resample_level(const struct sp_grid *grid, const struct sp_camera_transform *camera) {
    const double finest = fmin(grid->spacing[0], fmin(grid->spacing[1], grid->spacing[2]));
    double far, width = compute_width_px(grid, camera, &far);
    double seen = RESAMPLE_BLOCK * far / camera->scale / finest;
    unsigned level = 0;
    while (level + 1 < SAMPLES_LEVELS &&
           (ldexp(width, (int)level) < narrowest || ldexp(seen, -(int)level) > most_seen))
        level++;
    return level;
}

static unsigned choose_level(const struct sp_view *view, const struct sp_grid *grid,
                             const struct sp_camera_transform *camera, unsigned mip_level) {
    unsigned level = mip_level, longest = 1;
    for (int a = 0; a < 3; a++)
        longest = grid->dims[a] > longest ? grid->dims[a] : longest;
    if (view->level_of_detail == SP_LOD_AUTO) {
        unsigned finest = sp_resample_level(grid, camera);
        level = level > finest ? level : finest;
    }
    while (level > 0 && longest >> level == 0)
        level--;
    return level < SAMPLES_LEVELS ? level : SAMPLES_LEVELS - 1;
}

static unsigned level_of(const struct sp_resample_input *input) {
    return choose_level(input->view, &sp_volume_info(input->volume)->grid, input->camera,
                        input->mip_level);
}

float sp_resample_antialiasing(const struct sp_view *view, const struct sp_grid *grid,
                               unsigned mip_level) {
    const double narrow = 1.8, wide = 2.3; /* px */
    const double *s = grid->spacing, finest = fmin(s[0], fmin(s[1], s[2]));
    struct sp_camera_transform camera;
    double far;
    if (!sp_resample_draws(view) || sp_compositing_is_projection(view->compositing.mode) ||
        view->level_of_detail == SP_LOD_OFF)
        return 0;
    sp_camera_transform_init(&camera, &view->camera, view->size);
    const unsigned level = choose_level(view, grid, &camera, mip_level);
    const double mean = cbrt(s[0] * s[1] * s[2]);
    const double px = ldexp(compute_width_px(grid, &camera, &far), (int)level) * finest / mean;
    return (float)fmin(fmax((wide - px) / (wide - narrow), 0), 1);
}

/* Sample coordinates of a level: x = to·(world − origin) + shift. */
struct coordinates {
    struct sp_mat3 to, from; /* from: its inverse, sample → world */
    struct sp_vec3 origin;
    double shift;
};

static struct sp_vec3 place(const struct coordinates *c, struct sp_vec3 world) {
    struct sp_vec3 x = sp_mat3_apply(&c->to, sp_vec3_sub(world, c->origin));
    for (int a = 0; a < 3; a++)
        x.v[a] += c->shift;
    return x;
}

static void init_coordinates(struct coordinates *c, const struct sp_grid *grid, unsigned level) {
    double size = ldexp(1, (int)level);
    double volume;
    c->origin = sp_vec3_from(grid->origin);
    c->from = sp_grid_steps(grid, size);
    c->to = sp_mat3_inverse(&c->from, &volume);
    c->shift = 0.5 / size - 0.5;
}

/* Adds the half space normal·world >= offset. */
static void add_half(struct sp_resample *r, const struct coordinates *c, struct sp_vec3 normal,
                     double offset) {
    struct sp_resample_half *half = &r->halves[r->half_count++];
    struct sp_mat3 turned = sp_mat3_transpose(&c->from);
    struct sp_vec3 n = sp_mat3_apply(&turned, normal);
    double length = sp_vec3_length(n), at = offset - sp_vec3_dot(normal, c->origin);
    for (int a = 0; a < 3; a++) {
        at += n.v[a] * c->shift;
        half->normal[a] = n.v[a] / length;
    }
    half->offset = at / length;
    half->is_cut = true;
}

/* The volume and what clips it. A channel also has the clip box of the first one: fractions of a
 * channel's own volume are other places. */
static void add_halves(struct sp_resample *r, const struct coordinates *c,
                       const struct sp_grid *grid) {
    static const double all[2][3] = { { 0, 0, 0 }, { 1, 1, 1 } };
    const struct sp_clip *clip = &r->view->clip;
    const struct sp_camera_transform *camera = r->camera;
    const double(*box)[3] = r->first ? all : clip->box;
    for (int a = 0; a < 3; a++)
        for (int side = 0; side < 2; side++) {
            double extent[2], part = box[side][a];
            sp_grid_extent(grid, (unsigned)a, extent);
            double distance = extent[0] + part * (extent[1] - extent[0]);
            double at = distance / grid->spacing[a] * (2 * c->shift + 1) + c->shift;
            struct sp_resample_half *half = &r->halves[r->half_count++];
            *half = (struct sp_resample_half){ .offset = side ? -at : at };
            half->normal[a] = side ? -1 : 1;
            /* Within a sample, the box ends where the data do. */
            half->is_cut = fabs(distance - extent[side]) > grid->spacing[a];
            half->is_joint = !r->first && r->whole && part != r->whole->box[side][a];
        }
    for (int i = 0; r->first && i < 6; i++) {
        struct sp_resample_half half = r->first->halves[i];
        for (int a = 0; a < 3; a++)
            half.offset += half.normal[a] * r->offset[a];
        r->halves[r->half_count++] = half;
    }
    struct sp_vec3 forward = sp_vec3_from(camera->w.m[2]);
    add_half(r, c, forward, sp_vec3_dot(forward, camera->eye) + camera->near);
    for (uint32_t i = 0; i < clip->plane_count; i++) {
        struct sp_vec3 normal = sp_vec3_from(clip->planes[i].normal);
        double largest = fmax(fabs(normal.v[0]), fmax(fabs(normal.v[1]), fabs(normal.v[2])));
        for (int a = 0; a < 3; a++) /* squares of components, or 1 / largest, may overflow */
            normal.v[a] /= largest;
        double length = sp_vec3_length(normal);
        add_half(r, c, sp_vec3_scale(normal, 1 / length),
                 clip->planes[i].offset / largest / length);
        r->halves[r->half_count - 1].is_joint = r->whole && i >= r->whole->plane_count;
    }
}

static void init_camera(struct sp_resample *r, const struct coordinates *c) {
    const struct sp_camera_transform *camera = r->camera;
    struct sp_vec3 axis[3];
    for (int i = 0; i < 3; i++)
        axis[i] = sp_mat3_apply(&c->to, sp_vec3_from(camera->w.m[i]));
    struct sp_vec3 eye = place(c, camera->eye);
    for (int a = 0; a < 3; a++) {
        r->eye[a] = r->start[a] = eye.v[a];
        r->ray[a] = axis[2].v[a];
        r->right[a] = axis[0].v[a] / camera->scale;
        r->down[a] = axis[1].v[a] / camera->scale;
    }
}

/* Fills r->share, and returns the axis with the largest share. */
static int choose_axis(struct sp_resample *r, const struct coordinates *c) {
    double along[3];
    for (int a = 0; a < 3; a++) {
        const struct sp_vec3 column = { { c->from.m[0][a], c->from.m[1][a], c->from.m[2][a] } };
        along[a] = fabs(r->ray[a]) * sp_vec3_length(column);
    }
    return sp_axes_choose(along, r->share);
}

/* Fills the coordinates of the samples of a level; `distances`: [samples of the finest level]. */
static void place_samples(const struct sp_grid *grid, unsigned a, unsigned level, double *distances,
                          float *place) {
    const double size = ldexp(1, (int)level);
    uint32_t count = grid->dims[a];
    memcpy(distances, grid->coordinates[a], count * sizeof *distances);
    for (unsigned l = 0; l < level; l++, count = (count + 1) / 2)
        sp_grid_coarsen(distances, count, distances);
    for (uint32_t k = 0; k < count; k++)
        place[k] = (float)((distances[k] / grid->spacing[a] + 0.5) / size - 0.5);
}

/* Tables of a rectilinear axis. */
static bool init_axis(struct sp_resample_axis *axis, const struct sp_resample_input *input,
                      const struct sp_samples *samples, unsigned a, unsigned level) {
    const struct sp_grid *grid = &sp_volume_info(input->volume)->grid;
    uint32_t dims = samples->dims[a], i = 0;
    *axis = (struct sp_resample_axis){ 0 };
    if (!grid->coordinates[a] || dims < 2)
        return true;
    enum { PER_SAMPLE = 16, MOST = 1 << 16 };
    axis->steps = dims < MOST / PER_SAMPLE ? (int)dims * PER_SAMPLE : MOST;
    float *place = sp_arena_alloc(input->arena, "coordinates", dims, sizeof *place);
    float *index =
        sp_arena_alloc(input->arena, "coordinates", (size_t)axis->steps + 1, sizeof *index);
    double *distances =
        sp_arena_alloc(input->arena, "coordinates", grid->dims[a], sizeof *distances);
    if (!place || !index || !distances)
        return false;
    place_samples(grid, a, level, distances, place);
    axis->first = place[0];
    axis->steps_per_place = (float)axis->steps / (place[dims - 1] - place[0]);
    for (int k = 0; k <= axis->steps; k++) {
        float at = axis->first + (float)k / axis->steps_per_place;
        while (i + 2 < dims && place[i + 1] < at)
            i++;
        index[k] = (float)i + (at - place[i]) / (place[i + 1] - place[i]);
    }
    axis->narrowest = INFINITY;
    for (uint32_t k = 1; k < dims; k++) {
        axis->narrowest = fminf(axis->narrowest, place[k] - place[k - 1]);
        axis->widest = fmaxf(axis->widest, place[k] - place[k - 1]);
    }
    axis->place = place;
    axis->index = index;
    return true;
}

/* Returns the world units per reference length. */
static double init_metric(struct sp_resample *r, const struct coordinates *c) {
    const double most = 1e15; /* reference lengths per sample: what is visible is opaque */
    double unit = r->view->transfer_function.reference_length;
    struct sp_mat3 turned = sp_mat3_transpose(&c->from);
    struct sp_mat3 m = sp_mat3_multiply(&turned, &c->from);
    for (int a = 0; a < 3; a++) /* so that squares fit a float */
        unit = fmax(unit, sqrt(m.m[a][a]) / most);
    static const int pair[6][2] = { { 0, 0 }, { 1, 1 }, { 2, 2 }, { 1, 2 }, { 0, 2 }, { 0, 1 } };
    for (int i = 0; i < 6; i++)
        r->metric[i] = m.m[pair[i][0]][pair[i][1]] / (unit * unit);
    struct sp_mat3 slope = sp_mat3_transpose(&c->to); /* gradients turn by the inverse transpose */
    double largest = 0;
    for (int i = 0; i < 9; i++)
        largest = fmax(largest, fabs(slope.m[i / 3][i % 3]));
    for (int i = 0; i < 9; i++)
        r->to_world[i / 3][i % 3] = (float)(slope.m[i / 3][i % 3] / largest);
    r->gradient_unit = (float)(largest / r->curve.codes_per_unit);
    return unit;
}

/* Sets the normals of the faces of cuts. */
static void init_faces(struct sp_resample *r) {
    for (uint32_t h = 0; h < r->half_count; h++) {
        struct sp_resample_half *half = &r->halves[h];
        float square = 0;
        for (int w = 0; w < 3; w++) {
            half->face[w] = 0;
            for (int a = 0; a < 3; a++)
                half->face[w] += r->to_world[w][a] * (float)half->normal[a];
            square += half->face[w] * half->face[w];
        }
        for (int w = 0; w < 3; w++)
            half->face[w] *= half->is_cut ? 1 / sqrtf(square) : 0;
    }
}

/* Rays that go farther than 1.3 from slice to slice get half sheets, and so do those about 12 px
 * beside them: in small images of wide views, rays change a lot from pixel to pixel, and all that
 * are nearly steep gain by half sheets. At the limit steepness changes by about 1/scale per pixel.
 * Drafts get them only beyond two slices or samples. */
static void init_steep(struct sp_resample *r, bool is_draft) {
    const double limit = is_draft ? 2 : 1.3, least_width = 0.01, beside_px = 12;
    bool is_perspective = r->camera->projection == SP_PERSPECTIVE;
    double beside = is_perspective ? beside_px / r->camera->scale : 0;
    r->steep[1] = (float)(limit - beside);
    r->steep[0] = (float)(limit - 1.5 * beside - least_width);
}

/* Surfaces change the value by at least this share of the transfer function's span per sample. */
static const double surface = 0.08;

static void init_light(struct sp_resample *r, unsigned level) {
    const struct sp_transfer_function *tf = &r->view->transfer_function;
    double span = tf->points[tf->point_count - 1].value - tf->points[0].value;
    float size = ldexpf(1, (int)level); /* coordinate on level 0 = (coordinate + ½)·size − ½ */
    r->light_scale = size * r->light->per_sample;
    r->light_first = (size - 1) / 2 * r->light->per_sample + r->light->first;
    r->light_firmness = (float)fmin(1 / (surface * span * r->curve.codes_per_unit), 1e6);
}

/* Gradients from one sample to the next one that rounded samples and codes may have. */
static float compute_rounding(enum sp_type type, const struct sp_curve *curve) {
    const double codes = 4; /* what refining rounds, and linear interpolation of it */
    bool is_real = type == SP_FLOAT32 || type == SP_FLOAT64;
    return (float)fmax(codes, is_real ? 0 : 0.5 * curve->codes_per_unit);
}

/* Returns the noise that explains differences of fine and smooth gradients [data unit]. It includes
 * the rounding of integers. The estimate of most exact fields is below 0.3 % of the range, because
 * of their own details; so much is subtracted from every estimate. */
static double choose_noise(const struct sp_volume_info *info, unsigned level) {
    const double range = info->data[1] - info->data[0], detail = 0.003 * range;
    const double seen = 0.0005 * range; /* less is not seen */
    bool is_real = info->type == SP_FLOAT32 || info->type == SP_FLOAT64;
    double square = is_real ? 0 : 1 / 12.0;
    /* Means of 2 × 2 × 2 samples keep 0.35 of white noise, and more of the noise of scans, whose
     * neighbours are correlated: half is assumed. */
    if (!isnan(info->noise))
        square += ldexp(fmax(info->noise * info->noise - detail * detail, 0), -2 * (int)level);
    return sqrt(square) > seen ? sqrt(square) : 0;
}

/* Sets how fine and smooth gradients are mixed (gradient.h). */
static void init_smoothing(struct sp_resample *r, const struct sp_volume_info *info,
                           unsigned level) {
    /* Noise of deviation 1 gives `aside` (gradient.h) a length of √6, and often more. 1.5 times as
     * much brings images of exact fields with noise nearer to the truth, but for the engine. */
    const double explained = 1.5 * sqrt(6);
    const double wide = 1.2; /* px: samples that are as narrow as `narrowest` have smooth normals */
    const double smoothing = r->view->shading.smoothing;
    double noise = choose_noise(info, level) * r->curve.codes_per_unit, square = 0;
    r->keep_max = 1;
    if (!isnan(smoothing)) {
        r->keep_max = (float)(1 - smoothing);
        noise = 0;
    } else if (r->view->level_of_detail == SP_LOD_AUTO) {
        double far, px = ldexp(compute_width_px(&info->grid, r->camera, &far), (int)level);
        r->keep_max = (float)fmin(fmax((px - narrowest) / (wide - narrowest), 0), 1);
    }
    for (int i = 0; i < 9; i++)
        square += (double)r->to_world[i / 3][i % 3] * (double)r->to_world[i / 3][i % 3] / 3;
    r->noise_square = (float)(square * pow(explained * noise, 2));
    r->is_smoothed = r->shade && (r->noise_square > 0 || r->keep_max < 1);
    for (int a = 0; a < 3; a++)
        r->is_smoothed = r->is_smoothed && r->samples->dims[a] >= RESAMPLE_SMOOTH;
}

/* Lit drafts have light per quad, unless the gradient also decides what is seen. */
static void init_quads(struct sp_resample *r, bool is_draft) {
    const uint32_t *dims = r->samples->dims;
    r->has_quads = is_draft && r->shade && r->view->transfer_function.gradient_count == 0 &&
                   dims[0] >= RESAMPLE_SMOOTH && dims[1] >= RESAMPLE_SMOOTH &&
                   dims[2] >= RESAMPLE_SMOOTH;
    r->needs_gradient = r->needs_gradient && !r->has_quads;
}

/* What the samples of coarser levels are made of: a maximum of means would lose thin structures. */
static enum sp_samples_kind kind_of(enum sp_compositing mode) {
    return mode == SP_COMPOSITE_MAXIMUM   ? SAMPLES_MAXIMA
           : mode == SP_COMPOSITE_MINIMUM ? SAMPLES_MINIMA
                                          : SAMPLES_MEANS;
}

/* False without memory. */
static bool init_reduction(const struct sp_resample_input *input, struct sp_resample *r,
                           double length_unit) {
    const struct sp_volume_info *info = sp_volume_info(input->volume);
    float(*colors)[4] =
        sp_arena_alloc(input->arena, "colours", REDUCTION_COLORS + 1, sizeof *colors);
    if (!colors)
        return false;
    sp_reduction_colors(input->view, info, colors);
    sp_reduction_init(&r->reduction, input->view, info, &r->curve, length_unit);
    r->colors = (const float(*)[4])colors;
    return true;
}

bool sp_resample_turn(const struct sp_resample_input *input, struct sp_resample *r, int axis,
                      struct sp_error *err) {
    struct sp_transfer_function tf; /* by which a projection skips samples */
    bool is_projection = sp_compositing_is_projection(input->view->compositing.mode);
    if (is_projection)
        sp_reduction_transfer(input->view, sp_volume_info(input->volume), &tf);
    struct sp_samples_job job = { .volume = input->volume,
                                  .level = r->level,
                                  .kind = kind_of(input->view->compositing.mode),
                                  .axis = (unsigned)axis,
                                  .tf = is_projection ? &tf : &input->view->transfer_function,
                                  .bytes_max = input->bytes_max,
                                  .compute_ranges = input->compute_ranges,
                                  .pool = input->pool,
                                  .interrupt = input->interrupt,
                                  .keeps_layout = input->keeps_layout };
    r->samples = sp_samples_get(input->cache, &job, &r->class, err);
    if (!r->samples)
        return false;
    r->curve = r->class->curve;
    r->axis = axis;
    return true;
}

/* Computes where sample 0 of the first channel lies. */
static void compute_offset(struct sp_resample *r, const struct coordinates *own,
                           const struct sp_grid *first_grid) {
    struct coordinates first;
    init_coordinates(&first, first_grid, r->first->level);
    const struct sp_vec3 back = { { -first.shift, -first.shift, -first.shift } };
    const struct sp_vec3 world = sp_vec3_add(first.origin, sp_mat3_apply(&first.from, back));
    const struct sp_vec3 at = place(own, world);
    memcpy(r->offset, at.v, sizeof r->offset);
}

/* Small volumes are drawn fast, and drafts of them differ more. */
static bool is_large(const struct sp_grid *grid) {
    const uint32_t least = 24; /* samples along an axis */
    return grid->dims[0] >= least && grid->dims[1] >= least && grid->dims[2] >= least;
}

/* Prepares a channel at a mip level. first: the first channel; NULL = this is the first. */
static bool prepare(const struct sp_resample_input *input, const struct sp_resample *first,
                    const struct sp_grid *first_grid, unsigned level, struct sp_resample *r,
                    struct sp_error *err) {
    const struct sp_volume_info *info = sp_volume_info(input->volume);
    const struct sp_view *view = input->view;
    const bool is_projection = sp_compositing_is_projection(view->compositing.mode);
    const bool is_draft = input->is_draft && !is_projection && is_large(&info->grid);
    *r = (struct sp_resample){
        .first = first,
        .level = level,
        .view = view,
        .whole = input->whole,
        .frame = input->frame,
        .interrupt = input->interrupt,
        .camera = input->camera,
        .shade = input->shade,
        .light = input->light,
        .fragments = input->fragments,
        .is_fine = view->compositing.mode == SP_COMPOSITE_SLAB,
        .is_linear = view->compositing.attenuation == SP_ATTENUATION_LINEAR,
        .needs_gradient =
            !is_projection && (input->shade || view->transfer_function.gradient_count > 0),
        .has_depth = input->frame->depth,
        .dark = is_draft ? 1.0f / 48 : SP_TRANSMITTANCE_MIN,
        .columns = ((int)input->frame->width + RESAMPLE_TILE - 1) / RESAMPLE_TILE,
        .rows = ((int)input->frame->height + RESAMPLE_TILE - 1) / RESAMPLE_TILE
    };
    struct coordinates coordinates;
    init_coordinates(&coordinates, &info->grid, level);
    if (first)
        compute_offset(r, &coordinates, first_grid);
    add_halves(r, &coordinates, &info->grid);
    init_camera(r, &coordinates);
    if (!sp_resample_turn(input, r, choose_axis(r, &coordinates), err))
        return false;
    r->rounding = compute_rounding(info->type, &r->curve);
    init_steep(r, is_draft);
    r->lowest = sp_missing_are_holes(info) ? CURVE_CODE_NONE : CURVE_CODE_MIN;
    for (unsigned a = 0; a < 3; a++)
        if (!init_axis(&r->axes[a], input, r->samples, a, level))
            return sp_arena_fail(input->arena, "data", err);
    if (r->light)
        init_light(r, level);
    double length_unit = init_metric(r, &coordinates);
    init_faces(r);
    init_smoothing(r, info, level);
    init_quads(r, is_draft);
    if (is_projection && !init_reduction(input, r, length_unit))
        return sp_arena_fail(input->arena, "data", err);
    input->frame->stats.mip_level = input->mip_level;
    input->frame->stats.is_draft |= is_draft;
    input->frame->stats.visible_voxels +=
        r->class->visible_count * SAMPLES_REGION * SAMPLES_REGION * SAMPLES_REGION;
    return true;
}

/* The mean distance of a volume's samples [world unit]. */
static double compute_width(const struct sp_resample_input *input) {
    const double *spacing = sp_volume_info(input->volume)->grid.spacing;
    return cbrt(spacing[0]) * cbrt(spacing[1]) * cbrt(spacing[2]);
}

/* The level at which a channel's samples are as far apart as the samples of the other channels:
 * subvolumes of volumes that are larger than memory may have coarser samples than volumes in
 * memory.
 */
static unsigned common_level(const struct sp_resample_input *input, double width) {
    const double level = log2(width / compute_width(input));
    return (unsigned)fmin(fmax(round(level), 0), SAMPLES_LEVELS - 1);
}

/* Sets the silhouettes of all channels, if they are the same: a pixel has one ray. */
static void init_silhouettes(struct sp_resample *first) {
    bool is_same = first->view->level_of_detail == SP_LOD_AUTO;
    for (struct sp_resample *r = first; is_same && r; r = r->next) {
        sp_silhouette_init(&r->silhouette, r);
        is_same = sp_silhouette_is_equal(&r->silhouette, &first->silhouette);
    }
    if (!is_same)
        first->silhouette.count = 0;
}

bool sp_resample_prepare(const struct sp_resample_input *input, struct sp_resample *r,
                         struct sp_error *err) {
    const struct sp_grid *grid = &sp_volume_info(input->volume)->grid;
    struct sp_resample *first = r;
    double width = 0;
    for (const struct sp_resample_input *i = input; i; i = i->next)
        width = fmax(width, ldexp(compute_width(i), (int)level_of(i)));
    input->frame->stats.visible_voxels = 0;
    sp_samples_begin(input->cache);
    if (!prepare(input, NULL, NULL, common_level(input, width), r, err))
        return false;
    for (input = input->next; input; input = input->next) {
        r->next = sp_arena_alloc(input->arena, "channels", 1, sizeof *r->next);
        if (!r->next)
            return sp_arena_fail(input->arena, "data", err);
        r = r->next;
        if (!prepare(input, first, grid, common_level(input, width), r, err))
            return false;
    }
    init_silhouettes(first);
    return true;
}
