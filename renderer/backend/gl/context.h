/* SPDX-License-Identifier: Apache-2.0
 *
 * One OpenGL core context without a window, through EGL.
 *
 *   places:  EGL device 0, 1, … ─► surfaceless ─► default display        (egl.h)
 *   each:    initialise ─► GL 4.5 core, else 4.3 ─► hardware or software?
 *            ─► does the backend start on it? (gl.c) ─► taken, or refused with the reason
 *
 * Every refused place is reported with its reason. Software GL is recognised by its renderer string
 * and never accepted as a GPU: EGL alone does not distinguish the two on every platform.
 */
#ifndef GL_CONTEXT_H
#define GL_CONTEXT_H

#include <stdbool.h>

#include "backend/gl/platform.h"
#include "sp/probe.h"
#include "sp/renderer.h"
#include "sp/status.h"

struct gl_options {
    int gpu; /* index of an EGL device; −1 = the first place of `platform` that works */
    enum gl_platform platform;
    bool software; /* true: only software GL; false: only hardware */
};

/* The device and driver of a context. Strings are printable ASCII, cut to fit, never empty. */
struct gl_info {
    /* From GL; `driver` is the vendor and version of EGL. */
    char renderer[SP_DEVICE_NAME], vendor[SP_DEVICE_NAME], version[SP_DEVICE_NAME];
    char driver[SP_DEVICE_NAME];
    enum gl_platform platform; /* never GL_PLATFORM_ANY */
    int gpu;                   /* index of the EGL device; −1 on the other platforms */
    int major, minor;          /* of the version, 4.3 or later */
    bool software;             /* the processor renders */
    bool tells_reset;          /* glGetGraphicsResetStatus() reports a lost context */
    struct sp_gpu_limits limits;
};

struct gl_context;

/* Receives a context that is current on no thread. The callee owns the context, also if it returns
 * false. False with *err set: the context is not usable. */
typedef bool gl_context_adopt(void *user, struct gl_context *context, struct sp_error *err);

/* Opens a context at each place in turn until adopt() accepts one. False with *err set:
 * SP_ERR_BACKEND with the reason of every place, or SP_ERR_INVALID if no device has the index.
 * Refusals are logged. */
bool gl_contexts_try(const struct gl_options *options, gl_context_adopt *adopt, void *user,
                     struct sp_error *err);

/* Opens the first context that can be opened; NULL with *err set as above. */
struct gl_context *gl_context_create(const struct gl_options *options, struct sp_error *err);

/* Destroys the context. It may be current on the calling thread, but on no other thread. */
void gl_context_destroy(struct gl_context **context);

/* Makes the context current on the calling thread until gl_context_unbind() on the same thread. A
 * context is current on one thread at a time, not always the same one. SP_ERR_BACKEND. */
bool gl_context_bind(struct gl_context *context, struct sp_error *err);
void gl_context_unbind(struct gl_context *context);

/* True with *err set (SP_ERR_BACKEND) if the driver has reset the context, which must be current.
 * Its contents are gone and the caller must create a new one. Always false if the driver does not
 * report resets (info->tells_reset). */
bool gl_context_is_lost(const struct gl_context *context, struct sp_error *err);

/* Returns the information about the context. It is constant and lives as long as the context. */
const struct gl_info *gl_context_info(const struct gl_context *context);

#endif
