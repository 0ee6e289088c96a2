/* SPDX-License-Identifier: Apache-2.0
 *
 * One OpenGL core context without a window, through EGL.
 *
 *   places:  EGL device 0, 1, … ─► surfaceless ─► default display        (egl.h)
 *   each:    initialise ─► GL 4.5 core, else 4.3 ─► hardware or software?
 *            ─► does it do what it is for? (gl.c) ─► taken, or the reason
 *
 * A place is refused with its reason, never passed over in silence, and software GL, known by its
 * renderer string, is never taken for a GPU: EGL itself tells the two apart on no platform.
 */
#ifndef GL_CONTEXT_H
#define GL_CONTEXT_H

#include <stdbool.h>

#include "sp/probe.h"
#include "sp/renderer.h"
#include "sp/status.h"

struct gl_options {
    int gpu;              /* index of an EGL device; −1 = the first place that works … */
    const char *platform; /* … of this platform (struct gl_info); NULL = of any */
    bool software;        /* true: software GL alone; false: never */
};

/* What a context runs on. Strings are printable ASCII, cut to fit, never empty. */
struct gl_info {
    /* As GL gives them; the driver is EGL's vendor and version. */
    char renderer[SP_DEVICE_NAME], vendor[SP_DEVICE_NAME], version[SP_DEVICE_NAME];
    char driver[SP_DEVICE_NAME];
    const char *platform; /* "device", "surfaceless" or "default" */
    int gpu;              /* index of the EGL device; −1 on the other platforms */
    int major, minor;     /* of the version, 4.3 or later */
    bool software;        /* rendered by the processor */
    bool tells_reset;     /* glGetGraphicsResetStatus() tells of a lost context */
    struct sp_gpu_limits limits;
};

struct gl_context;

/* Hands over a context that is current on no thread, and that is the callee's, whatever it returns.
 * False with *err set: it will not do. */
typedef bool gl_context_take(void *user, struct gl_context *context, struct sp_error *err);

/* Opens a context at one place after the other until one is taken. False with *err set:
 * SP_ERR_BACKEND with the reason of every place; SP_ERR_INVALID for an index that no device has.
 * The refusals on the way to the one that is taken are logged. */
bool gl_contexts_try(const struct gl_options *options, gl_context_take *take, void *user,
                     struct sp_error *err);

/* The first that there is; NULL with *err set as above. */
struct gl_context *gl_context_create(const struct gl_options *options, struct sp_error *err);

/* Unbinds it from the calling thread if it is current there; it must be current on no other. */
void gl_context_destroy(struct gl_context **context);

/* Makes the context current on the calling thread, where GL calls go to it until
 * gl_context_unbind() on the same thread. It belongs to one thread at a time, not always the same.
 * SP_ERR_BACKEND. */
bool gl_context_bind(struct gl_context *context, struct sp_error *err);
void gl_context_unbind(struct gl_context *context);

/* Whether the driver has reset the context, which must be current: what it held is gone, whatever
 * it draws is worthless, and another one is to be made. *err is set then (SP_ERR_BACKEND). Where
 * drivers do not tell (info->tells_reset) it never is. */
bool gl_context_is_lost(const struct gl_context *context, struct sp_error *err);

/* Constant; lives as long as the context. */
const struct gl_info *gl_context_info(const struct gl_context *context);

#endif
