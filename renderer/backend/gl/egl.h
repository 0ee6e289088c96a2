/* SPDX-License-Identifier: Apache-2.0
 *
 * Where GL may be had on this machine, and the way there. All functions are safe on any thread.
 *
 * Displays are EGL's own: one a device for the whole process, handed out again to whoever asks. So
 * they are initialised here and never terminated, which would end every context on them, also those
 * of other renderers. Software keeps threads for each, so that where a GPU is wanted its device is
 * left alone.
 */
#ifndef GL_EGL_H
#define GL_EGL_H

#define EGL_NO_X11 /* else it includes X11, whose macros are everywhere */
#include <epoxy/egl.h>
#include <stdbool.h>

#include "backend/backend.h"
#include "backend/gl/context.h"
#include "sp/probe.h"

struct gl_place {
    const char *platform; /* as in gl_info */
    int gpu;              /* as in gl_info */
    const char *missing;  /* what EGL lacks to open it, constant; NULL = nothing */
    EGLDeviceEXT device;  /* of a device */
    bool is_software;     /* EGL says so of the device, or it lists devices and says so of all:
                             then a display has no other either. Else the renderer's name tells */
    char file[64];        /* the device's node, "/dev/dri/card0"; "" = has none, or not told */
};

enum { GL_DEVICES_MAX = 64, GL_PLACES_MAX = GL_DEVICES_MAX + 2 };

struct gl_places {
    struct gl_place list[GL_PLACES_MAX]; /* place i is device i, of those that there are */
    unsigned count, devices;
};

/* Lists the places in the order in which they are tried, also those that EGL lacks, which
 * gl_place_open() refuses: devices, or a place that stands for their lack; surfaceless; default.
 * False with *err set (SP_ERR_BACKEND) when libEGL or libGL cannot be loaded. */
bool gl_places_list(struct gl_places *places, struct sp_error *err);

/* "EGL device 0 (/dev/dri/card0)", "surfaceless display", "default display". */
void gl_place_name(const struct gl_place *place, char *text, size_t size);

/* Adds to the reason why a place is refused that its node cannot be opened, if that is so: drivers
 * keep this to themselves and offer software instead. */
void gl_place_add_cause(const struct gl_place *place, struct sp_error *why);

/* An initialised display, or EGL_NO_DISPLAY with *err set (SP_ERR_BACKEND). */
EGLDisplay gl_place_open(const struct gl_place *place, struct sp_error *err);

/* A context at one place, of hardware or software. As gl_context_create(). */
struct gl_context *gl_context_open(const struct gl_place *place, struct sp_error *err);

/* Whether the backend can start on a context, which it takes and ends: *context is NULL then. False
 * with *err set: its programs do not compile, memory lacks, or, of hardware, options->passes()
 * refuses it. SP_ERR_MEMORY: it was not tried, if *context is not NULL. */
bool gl_works(struct gl_context **context, const struct sp_backend_options *options,
              struct sp_error *err);

/* For the backends' table. */
void gl_probe(const struct sp_backend_options *options, sp_device_visit *visit, void *user);

/* What may be kept on such a GPU, bytes: sp_renderer_options.video_bytes. */
uint64_t gl_video_budget(const struct gl_info *info, const struct sp_backend_options *options);

/* Sets *err to "CALL fails: EGL_…" from this thread's EGL error, SP_ERR_BACKEND; returns false. */
bool gl_egl_fail(struct sp_error *err, const char *call);

#endif
