/* SPDX-License-Identifier: Apache-2.0
 *
 * Lists every place that may offer OpenGL. Each one is started as a renderer would start it, and
 * then closed.
 */
#include <stdio.h>
#include <string.h>

#include "backend/gl/context.h"
#include "backend/gl/egl.h"
#include "sp/probe.h"

static void describe(struct sp_device *device, const struct gl_info *info) {
    device->backend = info->software ? "gl-software" : "gl";
    device->is_gpu = !info->software;
    device->limits = info->limits;
    memcpy(device->name, info->renderer, sizeof device->name);
    memcpy(device->vendor, info->vendor, sizeof device->vendor);
    memcpy(device->version, info->version, sizeof device->version);
    memcpy(device->driver, info->driver, sizeof device->driver);
}

static void refuse(struct sp_device *device, const struct sp_error *why) {
    device->refusal_code = why->code;
    memcpy(device->refusal, why->text, sizeof device->refusal);
}

static void probe_place(const struct gl_place *place, const struct sp_backend_options *options,
                        sp_device_visit *visit, void *user) {
    struct sp_device device = { .backend = "gl", .gpu = place->gpu };
    struct sp_error why;
    gl_place_name(place, device.place, sizeof device.place);
    struct gl_context *context = gl_context_open(place, &why);
    if (context)
        describe(&device, gl_context_info(context));
    if (!context || !gl_works(&context, options, &why)) {
        gl_place_add_cause(place, &why);
        refuse(&device, &why);
    }
    visit(user, &device);
    gl_context_destroy(&context);
}

void gl_probe(const struct sp_backend_options *options, sp_device_visit *visit, void *user) {
    struct gl_places places;
    struct sp_error why;
    if (gl_places_list(&places, &why)) {
        for (unsigned i = 0; i < places.count; i++)
            probe_place(&places.list[i], options, visit, user);
    } else {
        struct sp_device device = { .backend = "gl", .place = "EGL", .gpu = -1 };
        refuse(&device, &why);
        visit(user, &device);
    }
}
