/* SPDX-License-Identifier: Apache-2.0
 *
 * Prepares a frame: finds the volumes and bricks that it shows, applies the view's edits, and
 * decides what the view leaves open.
 */
#include "data/volume/volume.h"
#include "draw/layers/layers.h"
#include "draw/light/light.h"
#include "draw/resample/resample.h"
#include "draw/working_set/channels.h"
#include "draw/working_set/frame_source.h"
#include "renderer/renderer_private.h"
#include "sp/edit.h"

/* The order that "auto" stands for. Interpolated sheets are sharper and need no filter. A view that
 * chooses a filter is drawn with it. Means of classified voxels are closer to the truth than means
 * of values, so views use them whose voxels are much smaller than pixels. They are not used for
 * smaller differences, so that a smaller frame looks like a larger one. Coarse frames keep sheets:
 * they look like the sharp frame, and a new transfer function costs them nothing. */
static enum sp_tf_order choose_order(const struct sp_renderer *r, const struct sp_volume *volume,
                                     const struct sp_view *v) {
    const struct sp_backend *backend = atomic_load(&r->backend);
    struct sp_camera_transform camera;
    if (sp_compositing_is_projection(v->compositing.mode)) /* of interpolated values */
        return SP_TF_POST;
    if (v->transfer_function.order != SP_TF_AUTO)
        return v->transfer_function.order;
    if (sp_light_is_wanted(v) || sp_view_has_channels(v)) /* support.c has found sheets */
        return SP_TF_POST;
    if (v->compositing.mode == SP_COMPOSITE_SPLAT || !backend->capabilities.interpolated_sheets ||
        !sp_view_has_default_filter(v))
        return SP_TF_PRE;
    sp_camera_transform_init(&camera, &v->camera, v->size);
    return sp_resample_level(&sp_volume_info(volume)->grid, &camera) < 2 ? SP_TF_POST : SP_TF_PRE;
}

/* Replaces the volumes of channels by what the view's edits leave of them. */
static bool edit_channels(const struct sp_view *view, struct sp_layer_volumes *others,
                          struct sp_error *err) {
    for (uint32_t i = 0; i < view->layer_count && view->edit_count > 0; i++) {
        struct sp_view own;
        if (!view->layers[i].visible || view->layers[i].type != SP_LAYER_CHANNEL)
            continue;
        sp_layers_channel_view(view, i, sp_volume_info(others->volumes[i]), &own);
        struct sp_volume *edited = sp_edit_volume(others->volumes[i], &own, err);
        if (!edited)
            return false;
        sp_volume_unref(&others->volumes[i]);
        others->volumes[i] = edited;
    }
    return true;
}

/* Drops hidden layers, and says which volume each of the others shows. */
static void choose_layers(struct sp_renderer_frame *f) {
    const bool has_elements = sp_volume_elements(f->original);
    uint32_t kept = 0;
    for (uint32_t i = 0; i < f->view.layer_count; i++) {
        const struct sp_layer *layer = &f->view.layers[i];
        if (!layer->visible)
            continue;
        f->job.layer_volumes[kept] = f->others.volumes[i] ? f->others.volumes[i]
                                     : has_elements       ? f->original
                                                          : NULL;
        f->job.colors[kept] = f->others.colors[i];
        f->view.layers[kept++] = *layer;
    }
    f->view.layer_count = kept;
}

/* Finds what the frame shows, and gives it the volume without what the edits remove. NULL on
 * failure; the others of the frame then have no references. */
static struct sp_volume *prepare_volume(struct sp_renderer_frame *f, struct sp_volume *volume,
                                        const struct sp_frame_source_job *job,
                                        struct sp_frame_source *drawn, struct sp_error *err) {
    struct sp_volume *edited = NULL;
    if (sp_layer_volumes_find(job->view, volume, job->options, &f->others, err) &&
        sp_frame_source_choose(volume, job, drawn, err) &&
        sp_channels_choose_sources(volume, job, drawn, f->others.volumes, err) &&
        sp_frame_source_replace_colors(job->view, job->options, drawn, f->others.colors, err) &&
        edit_channels(&drawn->view, &f->others, err))
        edited = sp_edit_volume(drawn->volume, &drawn->view, err);
    sp_volume_unref(&drawn->volume);
    if (!edited)
        sp_layer_volumes_finish(&f->others);
    return edited;
}

/* Completes the view of the frame, where the caller's `view` leaves a choice open. */
static void complete_view(const struct sp_renderer *r, struct sp_renderer_frame *f,
                          const struct sp_view *view) {
    const bool has_blocks = sp_volume_blocks(f->job.volume) != NULL;
    const bool is_projection = sp_compositing_is_projection(view->compositing.mode);
    f->view.transfer_function.order =
        has_blocks ? SP_TF_POST : choose_order(r, f->job.volume, view);
    if (is_projection)
        f->view.shading.mode = SP_SHADING_NONE;
    f->may_be_pre = !is_projection && view->transfer_function.order == SP_TF_AUTO &&
                    f->view.transfer_function.order == SP_TF_POST && !sp_light_is_wanted(view) &&
                    !sp_view_has_channels(view) && !has_blocks;
}

/* Creates the frame, with depth if it is wanted and the view has one. */
static struct sp_frame *create_frame(const struct sp_backend *backend, const struct sp_view *view,
                                     struct sp_frame_pool *pool, const struct sp_render_options *o,
                                     struct sp_error *err) {
    const enum sp_compositing mode = view->compositing.mode;
    const bool has_depth = mode != SP_COMPOSITE_MEAN && mode != SP_COMPOSITE_SUM;
    return (o->wants_depth && has_depth && backend->capabilities.depth
                ? sp_frame_create_with_depth
                : sp_frame_create)(pool, view->size[0], view->size[1], o->format, err);
}

bool sp_renderer_prepare(const struct sp_renderer *r, struct sp_renderer_frame *f,
                         struct sp_volume *volume, const struct sp_view *view,
                         struct sp_frame_pool *pool, const struct sp_render_options *o,
                         struct sp_error *err) {
    const struct sp_backend *backend = atomic_load(&r->backend);
    struct sp_frame_source drawn = { .volume = NULL };
    const struct sp_frame_source_job job = { .view = view,
                                             .options = o,
                                             .reads_blocks = backend->capabilities.blocks };
    struct sp_volume *edited = prepare_volume(f, volume, &job, &drawn, err);
    if (!edited)
        return false;
    struct sp_frame *frame = create_frame(backend, view, pool, o, err);
    if (!frame) {
        sp_volume_unref(&edited);
        sp_layer_volumes_finish(&f->others);
        return false;
    }
    frame->is_opaque = view->background[3] == 1; /* frame/resolve.h */
    f->view = drawn.view;
    f->bricks = drawn.bricks;
    f->original = sp_volume_ref(volume);
    f->job = (struct sp_backend_job){ .volume = edited,
                                      .view = &f->view,
                                      .mip_level = drawn.mip_level,
                                      .is_draft = o->draft,
                                      .frame = frame,
                                      .cancel = o->cancel,
                                      .pause = o->pause };
    complete_view(r, f, view);
    choose_layers(f);
    return true;
}
