/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/support.h"

#include <stdio.h>

#include "draw/light/light.h"
#include "draw/resample/resample.h"

/* Checks one choice of the view against a capability mask. `names` are the protocol's names, ended
 * by NULL. */
static bool check_choice(const char *backend, const char *pointer, unsigned value, uint32_t mask,
                         const char *const *names, struct sp_error *err) {
    if (mask & SP_CAN(value))
        return true;
    char supported[160] = "nothing";
    size_t used = 0;
    for (unsigned i = 0; names[i] && used < sizeof supported; i++)
        if (mask & SP_CAN(i))
            used += (size_t)snprintf(supported + used, sizeof supported - used, "%s%s",
                                     used ? ", " : "", names[i]);
    return sp_fail(err, SP_ERR_UNSUPPORTED, pointer,
                   "the %s backend does not support \"%s\"; it supports %s", backend, names[value],
                   supported);
}

static bool has_clip_box(const struct sp_clip *clip) {
    for (int i = 0; i < 3; i++)
        if (clip->box[0][i] > 0 || clip->box[1][i] < 1)
            return true;
    return false;
}

bool sp_support_check(const struct sp_backend *backend, const struct sp_view *v,
                      struct sp_error *err) {
    static const char *const projections[] = { "perspective", "orthographic", NULL };
    static const char *const filters[] = { "adaptive", "ewa", "reconstruction", "lowpass", "swan",
                                           "none",     NULL };
    static const char *const kernels[] = { "gaussian", "cubic", NULL };
    static const char *const compositings[] = { "splat",   "sheet", "slab", "maximum",
                                                "minimum", "mean",  "sum",  NULL };
    static const char *const attenuations[] = { "exponential", "linear", NULL };
    static const char *const orders[] = { "pre", "post", "auto", NULL };
    static const char *const shadings[] = { "none", "phong", NULL };
    static const char *const lods[] = { "auto", "off", NULL };
    const struct sp_capabilities *can = &backend->capabilities;
    const char *name = backend->entry.name;
    const struct {
        const char *pointer;
        unsigned value;
        uint32_t mask;
        const char *const *names;
    } choices[] = {
        { "/camera/projection", v->camera.projection, can->projections, projections },
        { "/filter/mode", v->filter.mode, can->filters, filters },
        { "/filter/kernel", v->filter.kernel, can->kernels, kernels },
        { "/compositing/mode", v->compositing.mode, can->compositings, compositings },
        { "/compositing/attenuation", v->compositing.attenuation, can->attenuations, attenuations },
        { "/transfer_function/order", v->transfer_function.order, can->orders, orders },
        { "/shading/mode", v->shading.mode, can->shadings, shadings },
        { "/quality/level_of_detail", v->level_of_detail, can->levels_of_detail, lods },
    };
    for (size_t i = 0; i < sizeof choices / sizeof choices[0]; i++)
        if (!check_choice(name, choices[i].pointer, choices[i].value, choices[i].mask,
                          choices[i].names, err))
            return false;
    if (v->transfer_function.gradient_count && !can->gradient_axis)
        return sp_fail(err, SP_ERR_UNSUPPORTED, "/transfer_function/gradient",
                       "the %s backend has no gradient axis; leave the list empty", name);
    if (has_clip_box(&v->clip) && !can->clip_box)
        return sp_fail(err, SP_ERR_UNSUPPORTED, "/clip/box",
                       "the %s backend does not clip; use [[0,0,0],[1,1,1]]", name);
    if (v->clip.plane_count && !can->clip_planes)
        return sp_fail(err, SP_ERR_UNSUPPORTED, "/clip/planes",
                       "the %s backend does not clip; leave the list empty", name);
    return true;
}

/* True unless the view needs sheets of interpolated values and no backend may draw them. */
static bool check_sheets(const struct sp_backend *backend, bool is_alone, const struct sp_view *v,
                         struct sp_error *err) {
    if (!sp_resample_draws(v) || backend->capabilities.interpolated_sheets || !is_alone)
        return true;
    if (sp_compositing_is_projection(v->compositing.mode))
        return sp_fail(err, SP_ERR_UNSUPPORTED, "/compositing/mode",
                       "the %s backend draws no projections: use \"sheet\", \"slab\" or \"splat\"",
                       backend->entry.name);
    return sp_fail(err, SP_ERR_UNSUPPORTED, "/transfer_function/order",
                   "the %s backend does not classify sheets after interpolation: use order "
                   "\"pre\", or compositing.mode \"slab\" with a filter other than the default",
                   backend->entry.name);
}

bool sp_support_check_layers(const struct sp_backend *backend, const struct sp_view *v,
                             struct sp_error *err) {
    char place[32];
    for (uint32_t i = 0; i < v->layer_count; i++) {
        const struct sp_layer *layer = &v->layers[i];
        if (layer->type == SP_LAYER_VOLUME || !layer->visible ||
            backend->capabilities.layers & SP_CAN(layer->type))
            continue;
        snprintf(place, sizeof place, "/layers/%u/type", i);
        return sp_fail(err, SP_ERR_UNSUPPORTED, place,
                       "the %s backend does not draw layers of this type: remove the layer, or "
                       "start with backend \"auto\" or \"cpu\"",
                       backend->entry.name);
    }
    return true;
}

/* True unless a layer needs a backend that may not draw. */
static bool check_layers(const struct sp_backend *backend, bool is_alone, const struct sp_view *v,
                         struct sp_error *err) {
    char place[32];
    for (uint32_t i = 0; i < v->layer_count && sp_compositing_is_projection(v->compositing.mode);
         i++) {
        if (v->layers[i].type == SP_LAYER_VOLUME || v->layers[i].type == SP_LAYER_CHANNEL ||
            !v->layers[i].visible)
            continue;
        snprintf(place, sizeof place, "/layers/%u/type", i);
        return sp_fail(
            err, SP_ERR_UNSUPPORTED, place,
            "a projection shows the volume and its channels alone: hide the layer, or set "
            "compositing.mode to \"sheet\" or \"slab\"");
    }
    return !is_alone || sp_support_check_layers(backend, v, err);
}

/* True unless the view needs ambient occlusion or a shadow and no backend may draw it. */
static bool check_light(const struct sp_backend *backend, bool is_alone, const struct sp_view *v,
                        struct sp_error *err) {
    const char *pointer = v->shading.occlusion > 0 ? "/shading/occlusion" : "/shading/shadow";
    if (!sp_light_is_wanted(v))
        return true;
    if (v->compositing.mode != SP_COMPOSITE_SHEET || v->transfer_function.order == SP_TF_PRE)
        return sp_fail(err, SP_ERR_UNSUPPORTED, pointer,
                       "ambient occlusion and shadows need compositing.mode \"sheet\" and "
                       "transfer_function.order \"auto\" or \"post\": use both, or set them to 0");
    return backend->capabilities.light || !is_alone ||
           sp_fail(err, SP_ERR_UNSUPPORTED, pointer,
                   "the %s backend draws neither ambient occlusion nor shadows: set them to 0",
                   backend->entry.name);
}

/* True unless the view has channels and is not drawn by what mixes them. */
static bool check_channels(const struct sp_view *v, struct sp_error *err) {
    const enum sp_compositing mode = v->compositing.mode;
    if (!sp_view_has_channels(v) || sp_compositing_is_projection(mode))
        return true;
    if (mode == SP_COMPOSITE_SPLAT)
        return sp_fail(err, SP_ERR_UNSUPPORTED, "/compositing/mode",
                       "channels cannot be mixed splat by splat: use \"sheet\", \"slab\" or a "
                       "projection");
    if (v->transfer_function.order == SP_TF_PRE)
        return sp_fail(err, SP_ERR_UNSUPPORTED, "/transfer_function/order",
                       "channels are classified after interpolation: use \"auto\" or \"post\"");
    return mode != SP_COMPOSITE_SLAB || sp_view_has_default_filter(v) ||
           sp_fail(err, SP_ERR_UNSUPPORTED, "/filter",
                   "slabs with channels need the default filter: reset it, or use "
                   "compositing.mode \"sheet\"");
}

bool sp_support_check_kind(const struct sp_backend *backend, bool is_alone,
                           const struct sp_view *view, struct sp_error *err) {
    return check_sheets(backend, is_alone, view, err) && check_channels(view, err) &&
           check_light(backend, is_alone, view, err) && check_layers(backend, is_alone, view, err);
}
