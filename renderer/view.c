/* SPDX-License-Identifier: Apache-2.0 */
#include "sp/view.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/vec.h"
#include "data/default_view/transfer.h"
#include "data/volume/anatomy.h"
#include "data/volume/grid.h"
#include "data/volume/missing.h"
#include "sp/slice.h"

/* Half edges of the box of all voxels' cells, as world vectors, and its middle. */
static struct sp_vec3 compute_box(const struct sp_grid *grid, struct sp_vec3 half[3]) {
    struct sp_vec3 middle = sp_vec3_from(grid->origin);
    for (unsigned a = 0; a < 3; a++) {
        double extent[2];
        sp_grid_extent(grid, a, extent);
        for (int r = 0; r < 3; r++) {
            half[a].v[r] = 0.5 * (extent[1] - extent[0]) * grid->direction[r][a];
            middle.v[r] += 0.5 * (extent[1] + extent[0]) * grid->direction[r][a];
        }
    }
    return middle;
}

/* Distance from the middle at which the box just fits the vertical field of view, seen along
 * -`away`, and the radius of the sphere around it. */
static double fit_box(const struct sp_vec3 half[3], struct sp_vec3 away, struct sp_vec3 up,
                      double tangent, double *radius) {
    struct sp_vec3 right = sp_vec3_normalize(sp_vec3_cross(up, away));
    struct sp_vec3 above = sp_vec3_cross(away, right);
    double distance = *radius = 0;
    for (int corner = 0; corner < 8; corner++) {
        struct sp_vec3 p = { { 0 } };
        for (int a = 0; a < 3; a++)
            p = sp_vec3_add(p, sp_vec3_scale(half[a], corner >> a & 1 ? 1 : -1));
        double aside = fmax(fabs(sp_vec3_dot(p, right)), fabs(sp_vec3_dot(p, above)));
        distance = fmax(distance, sp_vec3_dot(p, away) + aside / tangent);
        *radius = fmax(*radius, sp_vec3_length(p));
    }
    return distance;
}

/* From the front (the side of low index 1), a little from the right and above. Close enough to fill
 * the image, but no closer than three quarters of the distance at which the volume can be turned
 * all around inside it. */
static void init_camera(struct sp_camera *camera, const struct sp_volume_info *info,
                        double smallest) {
    double rise = sp_anatomy_is_plain_stack(info) ? -1 : 1, radius;
    struct sp_vec3 away = sp_vec3_normalize((struct sp_vec3){ { 0.45, -0.82, 0.35 * rise } });
    struct sp_vec3 up = { { 0, 0, rise } }, half[3], middle = compute_box(&info->grid, half);
    *camera = (struct sp_camera){ .up = { 0, 0, rise }, .fov_y = 30, .near = 0.1 * smallest };
    double angle = 0.5 * camera->fov_y * (M_PI / 180);
    double fitting = 1.03 * fit_box(half, away, up, tan(angle), &radius);
    double distance = fmax(fitting, 0.75 * radius / sin(angle));
    camera->height = 2 * radius;
    for (int i = 0; i < 3; i++) {
        camera->target[i] = middle.v[i];
        camera->position[i] = middle.v[i] + distance * away.v[i];
    }
}

enum { CLASSES = 4, BINS = SP_HISTOGRAM_BINS };

/* The opacity of a single value: a line of sight through the thinnest side of the volume has an
 * optical depth of 1.5, so a single voxel is no shadow and a large volume no brick. */
static float opacity_of_one_value(const struct sp_grid *grid, double reference_length) {
    struct sp_vec3 half[3];
    compute_box(grid, half);
    double thickness = INFINITY;
    for (int a = 0; a < 3; a++)
        thickness = fmin(thickness, 2 * sp_vec3_length(half[a]));
    return (float)(1 - exp(-1.5 * reference_length / thickness));
}

/* The lowest class is background and transparent; the other three are soft matter, which is seen
 * through, dense matter, which shapes the image, and the densest. */
static void init_transfer_function(struct sp_transfer_function *tf,
                                   const struct sp_volume_info *info, double smallest) {
    static const struct {
        int cut;     /* lies between this cut and the next; the last cut is the maximum */
        float share; /* of the way from this cut to the next */
        float color[3], opacity;
    } ramp[] = {
        { 0, 0.0f, { 0.62f, 0.26f, 0.18f }, 0.0f },  { 0, 0.35f, { 0.84f, 0.48f, 0.34f }, 0.03f },
        { 0, 0.8f, { 0.92f, 0.66f, 0.50f }, 0.05f }, { 1, 0.0f, { 0.95f, 0.78f, 0.60f }, 0.10f },
        { 1, 0.5f, { 0.98f, 0.90f, 0.76f }, 0.28f }, { 2, 0.0f, { 1.00f, 0.96f, 0.88f }, 0.50f },
        { 2, 1.0f, { 1.00f, 1.00f, 1.00f }, 0.80f },
    };
    double low = sp_missing_data(info)[0], span = sp_missing_data(info)[1] - low;
    *tf = (struct sp_transfer_function){ .reference_length = smallest, .order = SP_TF_AUTO };
    if (!(span > 0) || !isfinite(span)) { /* one value alone, or no middle: show what there is */
        tf->point_count = 1;
        const bool has_grid = info->elements.kind == SP_KIND_GRID;
        const float opacity = has_grid ? opacity_of_one_value(&info->grid, smallest) : 0.1f;
        tf->points[0] = (struct sp_tf_point){ low, { 0.95f, 0.78f, 0.60f }, opacity };
        return;
    }
    unsigned cuts[CLASSES + 1];
    sp_default_split(info->histogram, 0, BINS, CLASSES, cuts);
    for (size_t i = 0; i < sizeof ramp / sizeof ramp[0]; i++) {
        double first = cuts[ramp[i].cut + 1], last = cuts[ramp[i].cut + 2];
        double value = low + span * ((first + (last - first) * (double)ramp[i].share) / BINS);
        if (tf->point_count && value <= tf->points[tf->point_count - 1].value)
            continue;
        struct sp_tf_point *p = &tf->points[tf->point_count++];
        p->value = value;
        memcpy(p->color, ramp[i].color, sizeof p->color);
        p->opacity = ramp[i].opacity;
    }
}

static const struct sp_filter default_filter = { .mode = SP_FILTER_ADAPTIVE,
                                                 .kernel = SP_KERNEL_GAUSSIAN,
                                                 .sigma = 0.7,
                                                 .cutoff = 3,
                                                 .lowpass = 1,
                                                 .c_min = 0.07,
                                                 .c_max = NAN };

bool sp_view_has_default_filter(const struct sp_view *view) {
    const struct sp_filter *a = &view->filter, *b = &default_filter;
    return a->mode == b->mode && a->kernel == b->kernel && a->sigma == b->sigma &&
           a->cutoff == b->cutoff && a->lowpass == b->lowpass && a->c_min == b->c_min &&
           isnan(a->c_max);
}

struct sp_layer sp_layer_default(enum sp_layer_type type) {
    return (struct sp_layer){
        .type = type,
        .visible = true,
        .value = NAN,
        .color = { 0.9f, 0.85f, 0.75f },
        .opacity = 1,
        .flatness = INFINITY,
        .low = 0.05,
        .high = 0.95,
        .detail = SP_SHELL_HIGH,
        .style = SP_VECTORS_MODULATE,
        .stretch = 4,
        .density = 0.2,
        .transform = { [0] = 1, [5] = 1, [10] = 1, [15] = 1 },
        .size = 1,
        .color_low = NAN,
        .color_high = NAN,
    };
}

void sp_channel_function(const struct sp_view *view, const struct sp_layer *channel,
                         const struct sp_volume_info *info, struct sp_transfer_function *function) {
    memset(function, 0, sizeof *function);
    function->reference_length = view->transfer_function.reference_length;
    function->order = view->transfer_function.order;
    function->point_count = channel->point_count;
    memcpy(function->points, channel->points, sizeof channel->points);
    if (channel->point_count)
        return;
    double window[2];
    sp_slice_default_window(info, window);
    const double low = window[0] - window[1] / 2, high = window[0] + window[1] / 2;
    const bool has_contrast = sp_missing_data(info)[1] > sp_missing_data(info)[0] && high > low;
    function->point_count = has_contrast ? 2 : 1;
    function->points[0].value = low;
    function->points[1].value = high;
    function->points[1].opacity = 0.5f;
    for (int i = 0; i < 2; i++)
        memcpy(function->points[i].color, channel->color, sizeof channel->color);
}

bool sp_view_has_channels(const struct sp_view *view) {
    for (uint32_t i = 0; i < view->layer_count; i++)
        if (view->layers[i].visible && view->layers[i].type == SP_LAYER_CHANNEL)
            return true;
    return false;
}

/* The layer that shows a volume of this kind. */
static enum sp_layer_type layer_of_kind(enum sp_kind kind) {
    static const enum sp_layer_type types[SP_KIND_COUNT] = {
        [SP_KIND_GRID] = SP_LAYER_VOLUME,
        [SP_KIND_POINTS] = SP_LAYER_POINTS,
        [SP_KIND_GAUSSIANS] = SP_LAYER_GAUSSIANS,
        [SP_KIND_MESH] = SP_LAYER_GEOMETRY,
    };
    return types[kind];
}

static void init_slices(struct sp_slices *slices, const struct sp_volume_info *info) {
    struct sp_vec3 half[3], middle = compute_box(&info->grid, half);
    double window[2];
    sp_slice_default_window(info, window);
    *slices = (struct sp_slices){ .planes = { true, true, true },
                                  .normal = { 0, 0, 1 },
                                  .center = window[0],
                                  .width = window[1] };
    for (int i = 0; i < 3; i++)
        slices->position[i] = middle.v[i] + 0.0; /* -0 becomes 0 */
}

bool sp_view_draws_slices(const struct sp_view *view) {
    const struct sp_slices *s = &view->slices;
    return s->in_3d && !sp_compositing_is_projection(view->compositing.mode) &&
           (s->mode == SP_SLICES_OBLIQUE ||
            (s->mode == SP_SLICES_ORTHOGONAL && (s->planes[0] || s->planes[1] || s->planes[2])));
}

void sp_view_init(struct sp_view *view, const struct sp_volume_info *info, const char *id) {
    const struct sp_grid *grid = &info->grid;
    const double *spacing = info->whole.dims[0] ? info->whole.spacing : grid->spacing;
    double smallest = fmin(spacing[0], fmin(spacing[1], spacing[2]));
    if (info->elements.kind != SP_KIND_GRID)
        smallest = info->element_spacing;
    *view = (struct sp_view){
        .size = { 512, 512 },
        .background = { 0, 0, 0, 1 },
        .filter = default_filter,
        .compositing = { .mode = SP_COMPOSITE_SHEET,
                         .slab = 1,
                         .center = NAN,
                         .width = NAN,
                         .zero = NAN,
                         .absorption = NAN },
        .shading = { .mode = SP_SHADING_PHONG,
                     .ambient = 0.25,
                     .diffuse = 0.8,
                     .specular = 0.25,
                     .exponent = 24,
                     .smoothing = NAN,
                     .reach = 0.2,
                     .light_count = 1,
                     .lights = { { { 0.3, 0.5, 1 }, SP_LIGHT_CAMERA, { 1, 1, 1 } } } },
        .layer_count = 1,
        .clip = { .box = { { 0, 0, 0 }, { 1, 1, 1 } } },
        .level_of_detail = SP_LOD_AUTO,
        .time = { info->steps.index },
    };
    snprintf(view->volume, sizeof view->volume, "%s", id);
    view->layers[0] = sp_layer_default(layer_of_kind(info->elements.kind));
    init_slices(&view->slices, info);
    init_camera(&view->camera, info, smallest);
    init_transfer_function(&view->transfer_function, info, smallest);
}
