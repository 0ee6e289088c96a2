/* SPDX-License-Identifier: Apache-2.0
 *
 * Finds the places on this machine that offer OpenGL and opens them. All functions are thread-safe.
 *
 * EGL owns the displays: one per device and process, shared by all code in the process. This file
 * initialises displays and never terminates them, because that would end every context on them,
 * also the contexts of other renderers. A software display keeps threads; therefore the search for
 * a GPU does not open it.
 */
#ifndef GL_EGL_H
#define GL_EGL_H

#define EGL_NO_X11 /* without this, EGL headers include X11, whose macros clash with common names  \
                    */
#include <epoxy/egl.h>
#include <stdbool.h>

#include "backend/backend.h"
#include "backend/gl/platform.h"
#include "sp/probe.h"

struct gl_context; /* backend/gl/context.h */
struct gl_info;

struct gl_place {
    enum gl_platform platform; /* as in gl_info */
    int gpu;                   /* as in gl_info */
    const char *missing;       /* what EGL lacks to open it, a constant; NULL = nothing */
    EGLDeviceEXT device;       /* of a device */
    bool is_software; /* EGL marks this device as software, or it marks every device so; then a
                         display offers nothing else. If false, the renderer's name decides */
    char file[64];    /* the device's node, "/dev/dri/card0"; "" = none, or not known */
};

enum { GL_DEVICES_MAX = 64, GL_PLACES_MAX = GL_DEVICES_MAX + 2 };

struct gl_places {
    struct gl_place list[GL_PLACES_MAX]; /* place i < devices is device i */
    unsigned count, devices;
};

/* Lists the places in the order in which they are tried: devices, or one place that represents the
 * lack of devices; surfaceless; default. Places that EGL lacks are also listed; gl_place_open()
 * refuses them. False with *err set (SP_ERR_BACKEND) if libEGL or libGL cannot be loaded. */
bool gl_places_list(struct gl_places *places, struct sp_error *err);

/* Writes the name of a place: "EGL device 0 (/dev/dri/card0)", "surfaceless display" or "default
 * display". */
void gl_place_name(const struct gl_place *place, char *text, size_t size);

/* If this user cannot open the device node of the place, adds this cause to the text of *why:
 * drivers do not report it and offer software instead. */
void gl_place_add_cause(const struct gl_place *place, struct sp_error *why);

/* Returns an initialised display, or EGL_NO_DISPLAY with *err set (SP_ERR_BACKEND). */
EGLDisplay gl_place_open(const struct gl_place *place, struct sp_error *err);

/* Opens a context at one place, hardware or software. Errors as gl_context_create(). */
struct gl_context *gl_context_open(const struct gl_place *place, struct sp_error *err);

/* True if the backend can start on the context. The call destroys the context and sets *context to
 * NULL. False with *err set: the programs do not compile, memory is short, or (hardware)
 * options->passes() refuses the device. If *context is not NULL after a failure, nothing was tried
 * (SP_ERR_MEMORY). */
bool gl_works(struct gl_context **context, const struct sp_backend_options *options,
              struct sp_error *err);

/* The probe slot of struct sp_backend. */
void gl_probe(const struct sp_backend_options *options, sp_device_visit *visit, void *user);

/* Returns the budget of video memory [bytes]: sp_renderer_options.video_bytes or its default. */
uint64_t gl_video_budget(const struct gl_info *info, const struct sp_backend_options *options);

/* Sets *err to "CALL fails: EGL_…" (SP_ERR_BACKEND) from this thread's EGL error; returns false. */
bool gl_egl_fail(struct sp_error *err, const char *call);

#endif
