/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/context.h"

#include <epoxy/gl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "backend/gl/egl.h"
#include "sp/log.h"
#include "sp/probe.h"

#define UNREPORTED_BYTES                                                                           \
    (UINT64_C(1) << 30) /* assumed budget if the driver does not report its memory */

struct gl_context {
    EGLDisplay display;
    EGLContext context;
    EGLSurface surface; /* EGL_NO_SURFACE where a context needs none */
    struct gl_info info;
};

bool gl_context_bind(struct gl_context *context, struct sp_error *err) {
    if (eglGetCurrentContext() == context->context && context->context != EGL_NO_CONTEXT)
        return true;
    if (!eglBindAPI(EGL_OPENGL_API) ||
        !eglMakeCurrent(context->display, context->surface, context->surface, context->context))
        return gl_egl_fail(err, "eglMakeCurrent");
    return true;
}

void gl_context_unbind(struct gl_context *context) {
    eglMakeCurrent(context->display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
}

bool gl_context_is_lost(const struct gl_context *context, struct sp_error *err) {
    static const struct {
        GLenum status;
        const char *why;
    } reasons[] = { { GL_GUILTY_CONTEXT_RESET, "because of a command of this program" },
                    { GL_INNOCENT_CONTEXT_RESET, "because of a command of another program" },
                    { GL_UNKNOWN_CONTEXT_RESET, "for an unknown reason" } };
    GLenum status = context->info.tells_reset ? glGetGraphicsResetStatus() : GL_NO_ERROR;
    if (status == GL_NO_ERROR)
        return false;
    const char *why = reasons[2].why;
    for (int i = 0; i < 2; i++)
        if (reasons[i].status == status)
            why = reasons[i].why;
    sp_fail(err, SP_ERR_BACKEND, "", "the driver has reset %.100s %s", context->info.renderer, why);
    return true;
}

uint64_t gl_video_budget(const struct gl_info *info, const struct sp_backend_options *options) {
    uint64_t all = info->limits.video_bytes, half = options->memory_bytes / 2;
    if (options->video_bytes)
        return options->video_bytes;
    if (info->software)
        return options->memory_bytes;
    return all ? all / 8 * 3 : half < UNREPORTED_BYTES ? half : UNREPORTED_BYTES;
}

const struct gl_info *gl_context_info(const struct gl_context *context) {
    return &context->info;
}

void gl_context_destroy(struct gl_context **context) {
    struct gl_context *c = *context;
    if (!c)
        return;
    if (c->context != EGL_NO_CONTEXT) {
        if (eglGetCurrentContext() == c->context)
            gl_context_unbind(c);
        eglDestroyContext(c->display, c->context);
    }
    if (c->surface != EGL_NO_SURFACE)
        eglDestroySurface(c->display, c->surface);
    free(c);
    *context = NULL;
}

/* Creates a surface of one pixel that is never drawn to, if a context cannot be current without
 * one. */
static bool create_surface(struct gl_context *c, EGLConfig *config, struct sp_error *err) {
    static const EGLint wanted[] = { EGL_SURFACE_TYPE, EGL_PBUFFER_BIT, EGL_RENDERABLE_TYPE,
                                     EGL_OPENGL_BIT, EGL_NONE };
    static const EGLint size[] = { EGL_WIDTH, 1, EGL_HEIGHT, 1, EGL_NONE };
    EGLint count = 0;
    *config = EGL_NO_CONFIG_KHR;
    if (epoxy_has_egl_extension(c->display, "EGL_KHR_surfaceless_context") &&
        epoxy_has_egl_extension(c->display, "EGL_KHR_no_config_context"))
        return true;
    if (!eglChooseConfig(c->display, wanted, config, 1, &count) || count < 1)
        return sp_fail(err, SP_ERR_BACKEND, "",
                       "EGL supports neither EGL_KHR_surfaceless_context with "
                       "EGL_KHR_no_config_context nor a pbuffer for desktop GL; update the driver");
    c->surface = eglCreatePbufferSurface(c->display, *config, size);
    return c->surface != EGL_NO_SURFACE || gl_egl_fail(err, "eglCreatePbufferSurface");
}

/* Creates a context of the newest version that the display offers, if possible one that reports
 * resets. EGL_NO_CONTEXT if there is none. */
static EGLContext create_core(EGLDisplay display, EGLConfig config) {
    static const struct {
        EGLint minor;
        bool tells_reset;
    } tries[] = { { 5, true }, { 5, false }, { 3, true }, { 3, false } };
    EGLContext context = EGL_NO_CONTEXT;
    for (unsigned i = 0; i < sizeof tries / sizeof tries[0] && context == EGL_NO_CONTEXT; i++) {
        const EGLint attributes[] = { EGL_CONTEXT_MAJOR_VERSION_KHR,
                                      4,
                                      EGL_CONTEXT_MINOR_VERSION_KHR,
                                      tries[i].minor,
                                      EGL_CONTEXT_OPENGL_PROFILE_MASK_KHR,
                                      EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT_KHR,
                                      tries[i].tells_reset
                                          ? EGL_CONTEXT_OPENGL_RESET_NOTIFICATION_STRATEGY_KHR
                                          : EGL_NONE,
                                      EGL_LOSE_CONTEXT_ON_RESET_KHR,
                                      EGL_NONE };
        context = eglCreateContext(display, config, EGL_NO_CONTEXT, attributes);
    }
    return context;
}

/* Copies a driver's text as printable ASCII: it goes into JSON and HTTP headers. */
static void copy_name(char text[SP_DEVICE_NAME], const char *name) {
    snprintf(text, SP_DEVICE_NAME, "%s", name && *name ? name : "unnamed");
    for (char *c = text; *c; c++)
        if (*c < ' ' || *c > '~')
            *c = '?';
}

/* GL reports software rendering only in its renderer string. A driver that wraps another driver
 * includes the name of that driver in its own. */
static bool is_software(const char *renderer) {
    static const char *const words[] = { "llvmpipe", "lavapipe",    "softpipe",     "swrast",
                                         "SWR (",    "SwiftShader", "Basic Render", "software" };
    for (unsigned i = 0; i < sizeof words / sizeof words[0]; i++)
        if (strcasestr(renderer, words[i]))
            return true;
    return false;
}

static uint64_t integer(GLenum name) {
    GLint64 value = 0;
    glGetInteger64v(name, &value);
    return value > 0 ? (uint64_t)value : 0;
}

static uint64_t integer_at(GLenum name, unsigned i) {
    GLint64 value = 0;
    glGetInteger64i_v(name, i, &value);
    return value > 0 ? (uint64_t)value : 0;
}

/* Returns the size of video memory from GL extensions; 0 = not known. Core GL does not report it.
 */
static uint64_t video_bytes(void) {
    enum { KIB = 1024 };
    if (epoxy_has_gl_extension("GL_NVX_gpu_memory_info"))
        return integer(GL_GPU_MEMORY_INFO_TOTAL_AVAILABLE_MEMORY_NVX) * KIB;
    GLint free_kib[4] = { 0 }; /* free memory; the memory of other programs is not reported */
    if (epoxy_has_gl_extension("GL_ATI_meminfo"))
        glGetIntegerv(GL_TEXTURE_FREE_MEMORY_ATI, free_kib);
    return free_kib[0] > 0 ? (uint64_t)free_kib[0] * KIB : 0;
}

static void read_limits(struct sp_gpu_limits *limits) {
    *limits = (struct sp_gpu_limits){
        .video_bytes = video_bytes(),
        .storage_block_bytes = integer(GL_MAX_SHADER_STORAGE_BLOCK_SIZE),
        .storage_blocks = (unsigned)integer(GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS),
        .storage_alignment = (unsigned)integer(GL_SHADER_STORAGE_BUFFER_OFFSET_ALIGNMENT),
        .shared_bytes = (unsigned)integer(GL_MAX_COMPUTE_SHARED_MEMORY_SIZE),
        .group_invocations = (unsigned)integer(GL_MAX_COMPUTE_WORK_GROUP_INVOCATIONS),
    };
    for (unsigned i = 0; i < 3; i++) {
        limits->group_size[i] = (unsigned)integer_at(GL_MAX_COMPUTE_WORK_GROUP_SIZE, i);
        limits->group_count[i] = (unsigned)integer_at(GL_MAX_COMPUTE_WORK_GROUP_COUNT, i);
    }
}

/* The context must be current. */
static void read_info(struct gl_context *c, const struct gl_place *place) {
    struct gl_info *info = &c->info;
    info->platform = place->platform;
    info->gpu = place->gpu;
    copy_name(info->renderer, (const char *)glGetString(GL_RENDERER));
    copy_name(info->vendor, (const char *)glGetString(GL_VENDOR));
    copy_name(info->version, (const char *)glGetString(GL_VERSION));
    char driver[SP_DEVICE_NAME];
    snprintf(driver, sizeof driver, "%s, EGL %s", eglQueryString(c->display, EGL_VENDOR),
             eglQueryString(c->display, EGL_VERSION));
    copy_name(info->driver, driver);
    info->major = epoxy_gl_version() / 10;
    info->minor = epoxy_gl_version() % 10;
    info->software = is_software(info->renderer);
    if (epoxy_gl_version() >= 43) {
        info->tells_reset =
            (epoxy_gl_version() >= 45 || epoxy_has_gl_extension("GL_KHR_robustness")) &&
            integer(GL_RESET_NOTIFICATION_STRATEGY) == GL_LOSE_CONTEXT_ON_RESET;
        read_limits(&info->limits);
    }
}

/* Opens a context to read its version only. */
static bool look_at(struct gl_context *c, EGLConfig config, const EGLint *attributes,
                    const struct gl_place *place, struct sp_error *err) {
    EGLContext context = eglCreateContext(c->display, config, EGL_NO_CONTEXT, attributes);
    if (context == EGL_NO_CONTEXT)
        return gl_egl_fail(err, "eglCreateContext for desktop GL");
    if (c->context != EGL_NO_CONTEXT)
        eglDestroyContext(c->display, c->context);
    c->context = context;
    if (!gl_context_bind(c, err))
        return false;
    read_info(c, place);
    return true;
}

/* Fails with the version that the display offers instead of the required core context, or with the
 * reason why it offers none. The compatibility profile may be newer than the core profile; a core
 * profile is limited by its GLSL version. */
static bool fail_version(struct gl_context *c, EGLConfig config, const struct gl_place *place,
                         struct sp_error *err) {
    static const EGLint core[] = { EGL_CONTEXT_MAJOR_VERSION_KHR,
                                   3,
                                   EGL_CONTEXT_MINOR_VERSION_KHR,
                                   2,
                                   EGL_CONTEXT_OPENGL_PROFILE_MASK_KHR,
                                   EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT_KHR,
                                   EGL_NONE };
    if (!look_at(c, config, NULL, place, err))
        return false;
    if (epoxy_gl_version() < 43 || !look_at(c, config, core, place, NULL))
        return sp_fail(err, SP_ERR_BACKEND, "",
                       "OpenGL %.60s of %.60s; a core profile of 4.3 is needed", c->info.version,
                       c->info.renderer);
    return sp_fail(err, SP_ERR_BACKEND, "",
                   "OpenGL %.60s of %.60s with GLSL %d.%02d; a core profile of 4.3 with GLSL 4.30 "
                   "is needed",
                   c->info.version, c->info.renderer, epoxy_glsl_version() / 100,
                   epoxy_glsl_version() % 100);
}

static bool open_display(struct gl_context *c, const struct gl_place *place, struct sp_error *err) {
    EGLConfig config;
    c->display = gl_place_open(place, err);
    if (c->display == EGL_NO_DISPLAY)
        return false;
    if (!eglBindAPI(EGL_OPENGL_API))
        return gl_egl_fail(err, "eglBindAPI for desktop GL");
    if (!create_surface(c, &config, err))
        return false;
    c->context = create_core(c->display, config);
    if (c->context == EGL_NO_CONTEXT)
        return fail_version(c, config, place, err);
    if (!gl_context_bind(c, err))
        return false;
    read_info(c, place);
    gl_context_unbind(c);
    return true;
}

struct gl_context *gl_context_open(const struct gl_place *place, struct sp_error *err) {
    struct gl_context *c = calloc(1, sizeof *c);
    if (!c) {
        sp_fail(err, SP_ERR_MEMORY, "", "out of memory for a GL context");
        return NULL;
    }
    if (!open_display(c, place, err))
        gl_context_destroy(&c);
    return c;
}

/* Opens a context of the requested kind. */
static struct gl_context *open_kind(const struct gl_place *place, bool software,
                                    struct sp_error *err) {
    if (place->is_software && !software) {
        sp_fail(err, SP_ERR_BACKEND, "", "%s",
                place->gpu >= 0 ? "this device is software GL" : "no device but software GL");
        return NULL;
    }
    struct gl_context *c = gl_context_open(place, err);
    if (!c || c->info.software == software)
        return c;
    sp_fail(err, SP_ERR_BACKEND, "", "%s is %s", c->info.renderer,
            software ? "a GPU, not software GL" : "software GL");
    gl_context_destroy(&c);
    return NULL;
}

bool gl_contexts_try(const struct gl_options *options, gl_context_adopt *adopt, void *user,
                     struct sp_error *err) {
    struct gl_places places;
    if (!gl_places_list(&places, err))
        return false;
    if (options->gpu >= (int)places.devices)
        return sp_fail(err, SP_ERR_INVALID, "",
                       "there is no GPU %d; EGL lists %u devices, counted from 0", options->gpu,
                       places.devices);
    unsigned first = options->gpu < 0 ? 0 : (unsigned)options->gpu;
    unsigned end = options->gpu < 0 ? places.count : first + 1;
    char reasons[SP_ERROR_TEXT] = "";
    size_t used = 0;
    for (unsigned i = first; i < end; i++) {
        struct sp_error why;
        if (options->platform != GL_PLATFORM_ANY && options->platform != places.list[i].platform)
            continue;
        struct gl_context *c = open_kind(&places.list[i], options->software, &why);
        if (c && adopt(user, c, &why))
            return true;
        gl_place_add_cause(&places.list[i], &why);
        char name[96];
        gl_place_name(&places.list[i], name, sizeof name);
        sp_log(SP_LOG_INFO, "%s is not used: %s", name, why.text);
        if (used < sizeof reasons)
            used += (size_t)snprintf(reasons + used, sizeof reasons - used, "%s%s: %s",
                                     used ? "; " : "", name, why.text);
    }
    return sp_fail(err, SP_ERR_BACKEND, "", "%s", reasons);
}

static bool keep(void *user, struct gl_context *context, struct sp_error *err) {
    (void)err;
    *(struct gl_context **)user = context;
    return true;
}

struct gl_context *gl_context_create(const struct gl_options *options, struct sp_error *err) {
    struct gl_context *context = NULL;
    return gl_contexts_try(options, keep, &context, err) ? context : NULL;
}
