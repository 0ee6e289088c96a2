/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/frame.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "draw/footprints/blend.h"
#include "draw/footprints/depth.h"
#include "draw/footprints/order.h"
#include "draw/layers/layers.h"
#include "splat/adaptive.h"

#define SPLAT_RANGE (1.0 / 16) /* cells: single splats are sorted by distance to this */
#define FARTHEST                                                                                   \
    1e7 /* cells; everything beyond counts as this far, as in draw/footprints/depth.c */

_Static_assert((int)SP_CUTS_MAX == (int)GL_CLIP_PLANES, "the shaders hold every clipping plane");
_Static_assert((int)SP_LIGHTS_MAX == (int)GL_LIGHTS, "the shaders hold every light");
_Static_assert(2 * (int)SP_LEVELS <= (int)GL_PARTS, "a part for each level, enlarged or not");

static uint32_t part_bit(unsigned level, bool is_enlarged) {
    return 1u << (2 * level + is_enlarged);
}

/* Chooses the mip level of each brick. */
static bool choose_levels(struct gl_frame *f, const struct sp_backend_job *job,
                          struct sp_arena *arena) {
    const struct sp_grid *grid = &sp_volume_info(job->volume)->grid;
    unsigned levels = sp_detail_levels(grid->dims, SP_LEVELS);
    struct sp_detail_job detail = { .camera = &f->camera,
                                    .grid = grid,
                                    .view = job->view,
                                    .floor = f->mip_level,
                                    .levels = levels > f->mip_level ? levels : f->mip_level + 1 };
    if (!sp_detail_choose(&detail, arena, &f->detail))
        return false;
    f->finest = (unsigned)__builtin_ctz(f->detail.levels);
    for (uint32_t i = 0; i < f->detail.count; i++)
        f->parts |= part_bit(f->detail.bricks[i].level, f->detail.bricks[i].is_enlarged);
    f->is_enlarged = f->parts & part_bit(f->finest, true);
    f->drawn = f->detail.levels;
    if (f->compositing != SP_COMPOSITE_SHEET) {
        /* Layers by distance use one level, the finest that some brick needs. */
        f->drawn = 1u << f->finest;
        f->parts = part_bit(f->finest, f->is_enlarged);
    }
    return true;
}

static bool get_lists(struct gl_frame *f, const struct sp_backend_job *job,
                      const struct gl_sources *from, struct sp_error *err) {
    const struct sp_view *view = job->view;
    struct sp_classify_job classify = { .tf = &view->transfer_function,
                                        .levels = f->drawn,
                                        .axis = SP_NO_AXIS, /* any order of entries will do */
                                        .normals = view->shading.mode == SP_SHADING_PHONG ||
                                                   view->transfer_function.gradient_count > 0 ||
                                                   f->is_post,
                                        .reach = sp_kernel_reach(&view->filter),
                                        .bytes_max = from->cache->limit_bytes,
                                        .pool = from->pool,
                                        .cancel = job->cancel };
    struct gl_mip_levels levels;
    if (!gl_mip_levels_get(&levels, from->residency, from->cache, job->volume, &classify, err))
        return false;
    f->visible = levels.visible;
    memcpy(f->lists, levels.lists, sizeof f->lists);
    return true;
}

/* Chooses the first voxel of the brick that is nearest to the eye. Positions are relative to it, so
 * that single precision suffices for voxels close to the eye. */
static void choose_origin(const struct sp_ewa_frame *e, uint32_t origin[3]) {
    struct sp_mat3 step;
    double determinant;
    memcpy(step.m, e->step_hi, sizeof step.m);
    step = sp_mat3_inverse(&step, &determinant);
    struct sp_vec3 eye = sp_mat3_apply(&step, sp_vec3_scale(sp_vec3_from(e->base), -1));
    for (unsigned a = 0; a < 3; a++) {
        uint32_t low = 0, high = (e->grid->dims[a] - 1) / SP_BRICK; /* bricks */
        while (low < high) {
            uint32_t middle = (low + high + 1) / 2;
            double at = sp_grid_distance(e->grid, a, middle * SP_BRICK) / e->grid->spacing[a];
            if (at <= eye.v[a])
                low = middle;
            else
                high = middle - 1;
        }
        origin[a] = low * SP_BRICK;
    }
}

/* Writes the constants of Chen's eq. 7: R·u2 of the smallest and largest kernel times the
 * thresholds, and the low-pass filter. Levels that are small enough use the kernels of the finest
 * level. */
static void write_adaptive(struct gl_part *to, const struct gl_frame *f, const struct sp_view *view,
                           const struct sp_ewa_frame *e, unsigned level, bool is_enlarged) {
    struct sp_adaptive adaptive;
    struct sp_filter filter = view->filter;
    if (!is_enlarged)
        filter.sigma = ldexp(filter.sigma, -(int)level);
    sp_adaptive_init(&adaptive, &f->camera, e->grid, view, &filter);
    double scale = (double)e->scale / e->unit;
    to->kernel[0][3] = (float)(scale * adaptive.radius[0] * adaptive.c_min);
    to->kernel[1][3] = (float)(scale * adaptive.radius[1] * adaptive.c_max);
    to->kernel[2][3] = (float)adaptive.lowpass;
}

static void write_part(struct gl_part *to, const struct sp_ewa_frame *e,
                       const struct gl_visible_list *list, enum sp_filter_mode mode,
                       unsigned level) {
    struct sp_ewa_brick brick;
    choose_origin(e, to->origin);
    sp_ewa_brick_init(&brick, e, to->origin);
    for (int r = 0; r < 3; r++) {
        memcpy(to->step[r], e->step[r], sizeof e->step[r]);
        to->step[r][3] = brick.base[r];
        memcpy(to->kernel[r], e->kernel[r], sizeof e->kernel[r]);
        to->rows[r] = list->axis_row[r];
        to->dims[r] = e->grid->dims[r];
    }
    memcpy(to->view, (float[]){ e->scale, e->centre[0], e->centre[1], e->near }, sizeof to->view);
    memcpy(to->footprint, (float[]){ e->lowpass2, e->radius, e->cut, e->peak },
           sizeof to->footprint);
    memcpy(to->bounds, (float[]){ e->gain, e->flat, e->ratio_max[0], e->ratio_max[1] },
           sizeof to->bounds);
    to->kind[0] = level;
    to->kind[1] = sp_grid_is_rectilinear(e->grid);
    to->kind[2] = list->bricks[0];
    to->kind[3] = list->bricks[1];
    to->rows[3] = mode;
}

void gl_write_planes(float (*to)[4], const struct sp_clip_frame *clip) {
    for (uint32_t i = 0; i < clip->count; i++) {
        memcpy(to[i], clip->planes[i].normal, sizeof clip->planes[i].normal);
        to[i][3] = clip->planes[i].offset;
    }
}

static void make_part(struct gl_frame *f, const struct sp_view *view, unsigned level,
                      bool is_enlarged) {
    unsigned part = 2 * level + is_enlarged;
    const struct sp_filter filter = sp_detail_filter(&view->filter, level, is_enlarged);
    struct sp_ewa_frame *ewa = &f->ewa[level][is_enlarged];
    sp_ewa_frame_init(ewa, &f->camera, &f->lists[level]->grid, view, &filter);
    sp_clip_frame_init(&ewa->clip, &f->camera, f->grid, &view->clip, ewa->unit);
    write_part(&f->constants.parts[part], ewa, f->lists[level], view->filter.mode, level);
    write_adaptive(&f->constants.parts[part], f, view, ewa, level, is_enlarged);
    gl_write_planes(f->constants.planes[part], &ewa->clip);
}

static void make_parts(struct gl_frame *f, const struct sp_view *view) {
    for (unsigned part = 0; f->parts >> part; part++)
        if (f->parts >> part & 1)
            make_part(f, view, part / 2, part % 2);
}

void gl_frame_write_shading(struct gl_constants *c, const struct sp_camera_transform *camera,
                            const struct sp_view *view) {
    struct sp_shade shade;
    sp_shade_init(&shade, camera, &view->shading);
    for (int r = 0; r < 3; r++)
        memcpy(c->to_camera[r], shade.to_camera[r], sizeof shade.to_camera[r]);
    memcpy(c->phong, (float[]){ shade.ambient, shade.diffuse, shade.specular, shade.exponent },
           sizeof c->phong);
    c->glint[0] = shade.glint_width;
    c->glint[1] = shade.glint_gain;
    for (int i = 0; i < shade.light_count; i++) {
        memcpy(c->lights[i].direction, shade.lights[i].direction, sizeof(float[3]));
        memcpy(c->lights[i].world, shade.lights[i].world, sizeof(float[3]));
        memcpy(c->lights[i].color, shade.lights[i].color, sizeof(float[3]));
    }
    c->choice[0] = view->camera.projection == SP_PERSPECTIVE;
    c->choice[1] = view->shading.mode == SP_SHADING_PHONG;
    c->choice[2] = (uint32_t)shade.light_count;
    c->lens[0] = (float)camera->scale;
    c->lens[1] = (float)camera->centre[0];
    c->lens[2] = (float)camera->centre[1];
}

static void write_constants(struct gl_frame *f, const struct gl_partition *partition,
                            const struct sp_view *view) {
    struct gl_constants *c = &f->constants;
    gl_frame_write_shading(c, &f->camera, view);
    c->choice[3] = partition->sheet_count;
    c->image_info[0] = view->size[0];
    c->image_info[1] = view->size[1];
    c->image_info[2] = f->axis;
    c->image_info[3] = gl_frame_ewa(f)->clip.count;
    c->compose[0] = f->compositing;
    c->compose[1] = f->is_post;
    c->compose[2] = f->has_depths;
    c->slabs[0] = (float)((double)partition->nearest * f->thickness);
    c->slabs[1] = (float)f->thickness;
}

/* Returns how far a kernel reaches along the ray at most [cells]. */
static double kernel_reach(const struct gl_frame *f, const struct sp_view *view) {
    double radius[2];
    sp_kernel_radii(&f->lists[f->finest]->grid, sp_kernel_sigma(&view->filter), radius);
    return (double)gl_frame_ewa(f)->radius * radius[1] / gl_frame_ewa(f)->unit;
}

/* Returns the view's slab thickness, or more if a kernel would lie in more than SP_SLOTS_MAX slabs.
 */
static double slab_thickness(const struct gl_frame *f, const struct sp_view *view) {
    const struct sp_ewa_frame *ewa = gl_frame_ewa(f);
    /* The transfer function varies as fast over an averaged scalar: its slabs stay as thin. */
    const double *spacing = f->is_post ? f->grid->spacing : f->lists[f->finest]->grid.spacing;
    double smallest = fmin(spacing[0], fmin(spacing[1], spacing[2]));
    double thickness =
        sp_depth_thickness(ewa, view->compositing.slab * smallest / ewa->unit, f->reach);
    return fmax(thickness, 2 * f->reach / (SP_SLOTS_MAX - 3));
}

/* Chooses the sheets, front to back, and the bricks in them. */
static bool cut_sheets(struct gl_frame *f, const struct gl_sources *from,
                       const struct gl_partition_source *source, struct sp_error *err) {
    uint32_t count = f->grid->dims[f->axis];
    uint32_t *order = sp_arena_alloc(from->arena, "order of sheets", count, sizeof *order);
    uint32_t *sheets = sp_arena_alloc(from->arena, "layers of sheets", count, sizeof *sheets);
    if (from->arena->failed)
        return sp_arena_fail(from->arena, "data", err);
    sp_slices_sort(&f->camera, f->grid, f->axis, order);
    for (uint32_t k = 0; k < count; k++)
        sheets[order[k]] = k;
    return gl_partition_sheets(from->partition, source, f->axis, sheets, count, err);
}

static bool cut_distances(struct gl_frame *f, const struct sp_view *view,
                          const struct gl_sources *from, const struct gl_partition_source *source,
                          struct sp_error *err) {
    const struct sp_ewa_frame *ewa = gl_frame_ewa(f);
    const bool is_slab = f->compositing == SP_COMPOSITE_SLAB;
    f->reach = kernel_reach(f, view);
    f->thickness = is_slab ? slab_thickness(f, view) : sp_depth_thickness(ewa, SPLAT_RANGE, 0);
    const struct gl_partition_depth depth = { .camera = &f->camera,
                                              .thickness = f->thickness * ewa->unit,
                                              .reach = is_slab ? f->reach * ewa->unit : 0,
                                              .farthest = FARTHEST * ewa->unit };
    return gl_partition_distances(from->partition, source, &depth, err);
}

static bool cut_layers(struct gl_frame *f, const struct sp_backend_job *job,
                       const struct gl_sources *from, struct sp_error *err) {
    const struct gl_partition_source source = { .volume = job->volume,
                                                .lists = f->lists,
                                                .detail = &f->detail,
                                                .level = f->finest,
                                                .is_enlarged = f->is_enlarged };
    if (f->compositing == SP_COMPOSITE_SHEET)
        return cut_sheets(f, from, &source, err);
    return cut_distances(f, job->view, from, &source, err);
}

bool gl_frame_begin(struct gl_frame *f, const struct sp_backend_job *job,
                    const struct gl_sources *from, struct sp_error *err) {
    const struct sp_grid *grid = &sp_volume_info(job->volume)->grid;
    double start_ms = sp_clock_ms();
    bool is_post = job->view->transfer_function.order == SP_TF_POST;
    *f = (struct gl_frame){
        .grid = grid,
        .compositing = job->view->compositing.mode,
        .is_post = is_post,
        /* Averaging a scalar over 4³ voxels changes what the transfer function shows. */
        .mip_level = is_post && job->mip_level > 1 ? 1 : job->mip_level
    };
    sp_camera_transform_init(&f->camera, &job->view->camera, job->view->size);
    f->axis = sp_slices_major_axis(&f->camera, grid);
    if (!choose_levels(f, job, from->arena))
        return sp_arena_fail(from->arena, "data", err);
    if (!get_lists(f, job, from, err))
        return false;
    make_parts(f, job->view);
    if (!cut_layers(f, job, from, err))
        return false;
    f->has_depths = f->compositing == SP_COMPOSITE_SLAB ||
                    (f->compositing == SP_COMPOSITE_SPLAT && sp_layers_are_wanted(job->view));
    write_constants(f, from->partition, job->view);
    f->stride = (f->has_depths ? 4 : 2) + gl_frame_ewa(f)->clip.count;
    f->classify_ms = sp_clock_ms() - start_ms;
    return true;
}
