/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "support/compare.h"
#include "unit/backend/gl/fake_machine.h"

struct driver drivers[DRIVERS];
unsigned device_count;
const char *client_extensions;
struct machine machine;

const char all_extensions[] =
    "EGL_EXT_platform_base EGL_EXT_device_enumeration EGL_EXT_device_query EGL_EXT_platform_device "
    "EGL_MESA_platform_surfaceless";

static void *fail_with(EGLint error) {
    machine.error = error;
    return NULL;
}

static EGLint get_error(void) {
    EGLint error = machine.error ? machine.error : EGL_SUCCESS;
    machine.error = EGL_SUCCESS;
    return error;
}

static const char *query_string(EGLDisplay display, EGLint name) {
    const struct driver *driver = display;
    if (!driver)
        return name == EGL_EXTENSIONS ? client_extensions : NULL;
    return name == EGL_VENDOR      ? "Fake"
           : name == EGL_VERSION   ? "1.5"
           : driver->wants_surface ? "EGL_KHR_create_context"
                                   : "EGL_KHR_surfaceless_context EGL_KHR_no_config_context";
}

static EGLBoolean query_devices(EGLint max, EGLDeviceEXT *devices, EGLint *count) {
    for (*count = 0; *count < (EGLint)device_count && *count < max; ++*count)
        devices[*count] = &drivers[*count];
    return EGL_TRUE;
}

static const char *query_device_string(EGLDeviceEXT device, EGLint name) {
    const struct driver *driver = device;
    if (name == EGL_EXTENSIONS)
        return driver->file                ? "EGL_EXT_device_drm"
               : driver->is_known_software ? "EGL_MESA_device_software"
                                           : "";
    return name == EGL_DRM_DEVICE_FILE_EXT ? driver->file : fail_with(EGL_BAD_PARAMETER);
}

static EGLDisplay get_platform_display(EGLenum platform, void *native, const EGLint *attributes) {
    (void)attributes;
    return platform == EGL_PLATFORM_DEVICE_EXT ? native : &drivers[SURFACELESS];
}

static EGLDisplay get_display(EGLNativeDisplayType native) {
    (void)native;
    return &drivers[DEFAULT];
}

static EGLBoolean initialize(EGLDisplay display, EGLint *major, EGLint *minor) {
    struct driver *driver = display;
    (void)major;
    (void)minor;
    machine.initialised |= 1u << (driver - drivers);
    if (driver->broken)
        fail_with(driver->error ? driver->error : EGL_NOT_INITIALIZED);
    return !driver->broken;
}

static EGLBoolean bind_api(EGLenum api) {
    return api == EGL_OPENGL_API;
}

static EGLContext create_context(EGLDisplay display, EGLConfig config, EGLContext share,
                                 const EGLint *attributes) {
    struct driver *driver = display;
    int minor = 0;
    bool core = attributes != NULL;
    machine.tells_reset = false;
    (void)share;
    assert_int_equal(config != NULL, driver->wants_surface);
    for (const EGLint *a = attributes; a && *a != EGL_NONE; a += 2) {
        if (a[0] == EGL_CONTEXT_MINOR_VERSION_KHR)
            minor = a[1];
        if (a[0] == EGL_CONTEXT_OPENGL_RESET_NOTIFICATION_STRATEGY_KHR)
            machine.tells_reset = a[1] == EGL_LOSE_CONTEXT_ON_RESET_KHR;
    }
    if (driver->no_desktop || (machine.tells_reset && driver->no_resets) ||
        (core && minor > driver->minor))
        return fail_with(EGL_BAD_MATCH);
    machine.minor = core ? minor : driver->minor;
    machine.contexts++;
    return driver;
}

static EGLBoolean destroy_context(EGLDisplay display, EGLContext context) {
    assert_ptr_equal(display, context);
    machine.contexts--;
    return EGL_TRUE;
}

static EGLBoolean make_current(EGLDisplay display, EGLSurface draw, EGLSurface read,
                               EGLContext context) {
    const struct driver *driver = display;
    assert_ptr_equal(draw, read);
    if (context)
        assert_int_equal(draw != EGL_NO_SURFACE, driver->wants_surface);
    machine.current = context;
    return EGL_TRUE;
}

static EGLContext get_current_context(void) {
    return machine.current;
}

static EGLBoolean choose_config(EGLDisplay display, const EGLint *attributes, EGLConfig *configs,
                                EGLint size, EGLint *count) {
    (void)attributes;
    configs[0] = display;
    *count = size > 0;
    return EGL_TRUE;
}

static EGLSurface create_surface(EGLDisplay display, EGLConfig config, const EGLint *attributes) {
    (void)attributes;
    assert_ptr_equal(display, config);
    machine.surfaces++;
    return display;
}

static EGLBoolean destroy_surface(EGLDisplay display, EGLSurface surface) {
    assert_ptr_equal(display, surface);
    machine.surfaces--;
    return EGL_TRUE;
}

static const GLubyte *get_string(GLenum name) {
    static char version[32];
    snprintf(version, sizeof version, machine.current->minor < 0 ? "2.1 Fake" : "4.%d Fake",
             machine.minor);
    const char *text = name == GL_RENDERER  ? machine.current->name
                       : name == GL_VERSION ? version
                       : name == GL_VENDOR  ? "Fake & Söhne\n"
                                            : "";
    return (const GLubyte *)text;
}

static const GLubyte *get_string_at(GLenum name, GLuint i) {
    (void)name;
    return (const GLubyte *)(i == 0 ? "GL_KHR_robustness" : "GL_NVX_gpu_memory_info");
}

static void get_integers(GLenum name, GLint *value) {
    *value = name == GL_NUM_EXTENSIONS ? 1 + (machine.current->video_mib > 0) : 0;
}

static void get_integer(GLenum name, GLint64 *value) {
    *value = name == GL_GPU_MEMORY_INFO_TOTAL_AVAILABLE_MEMORY_NVX
                 ? (GLint64)machine.current->video_mib << 10
             : name == GL_RESET_NOTIFICATION_STRATEGY
                 ? (machine.tells_reset ? GL_LOSE_CONTEXT_ON_RESET : GL_NO_RESET_NOTIFICATION)
             : name == GL_MAX_SHADER_STORAGE_BLOCK_SIZE ? INT64_C(1) << 31
                                                        : -1;
}

static void get_integer_at(GLenum name, GLuint i, GLint64 *value) {
    *value = name == GL_MAX_COMPUTE_WORK_GROUP_SIZE ? 10 + i : 20 + i;
}

static GLuint create_shader(GLenum type) {
    return type == GL_COMPUTE_SHADER ? ++machine.names : 0;
}

static GLuint make_live(void) {
    assert_compare(machine.names + 1, <, NAMES);
    machine.is_live[++machine.names] = true;
    return machine.names;
}

static GLuint create_program(void) {
    return make_live();
}

static void shader_source(GLuint shader, GLsizei count, const GLchar *const *texts,
                          const GLint *lengths) {
    (void)shader, (void)count, (void)texts, (void)lengths;
}

static void ignore_name(GLuint name) {
    (void)name;
}

static void ignore_names(GLuint program, GLuint shader) {
    (void)program, (void)shader;
}

static void get_status(GLuint name, GLenum what, GLint *value) {
    (void)name;
    *value = what == GL_INFO_LOG_LENGTH ? 8 : !machine.current->compiles_nothing;
}

static void get_log(GLuint name, GLsizei size, GLsizei *length, GLchar *text) {
    (void)name, (void)length;
    snprintf(text, (size_t)size, "no idea");
}

static void delete_program(GLuint program) {
    machine.is_live[program] = false;
}

static void name_things(GLsizei count, GLuint *names) {
    for (GLsizei i = 0; i < count; i++)
        names[i] = ++machine.names;
}

static void ignore_things(GLsizei count, const GLuint *names) {
    (void)count, (void)names;
}

static void name_buffers(GLsizei count, GLuint *names) {
    for (GLsizei i = 0; i < count; i++)
        names[i] = make_live();
}

static void delete_buffers(GLsizei count, const GLuint *names) {
    for (GLsizei i = 0; i < count; i++)
        machine.is_live[names[i]] = false;
}

static void bind_buffer(GLenum target, GLuint name) {
    (void)target, (void)name;
}

static void buffer_data(GLenum target, GLsizeiptr bytes, const void *data, GLenum usage) {
    (void)target, (void)bytes, (void)data, (void)usage;
    machine.gl_error = machine.current->lacks_memory ? GL_OUT_OF_MEMORY : GL_NO_ERROR;
}

static void buffer_sub_data(GLenum target, GLintptr at, GLsizeiptr bytes, const void *data) {
    (void)target, (void)at, (void)bytes, (void)data;
}

static GLenum get_gl_error(void) {
    GLenum error = machine.gl_error;
    machine.gl_error = GL_NO_ERROR;
    return error;
}

int machine_begin(void **state) {
    (void)state;
    memset(&machine, 0, sizeof machine);
    for (int i = 0; i < DRIVERS; i++)
        drivers[i] = (struct driver){ .name = "Real 100", .minor = 6 };
    device_count = 1;
    client_extensions = all_extensions;
    return 0;
}

int machine_end(void **state) {
    (void)state;
    assert_int_equal(machine.contexts, 0);
    assert_int_equal(machine.surfaces, 0);
    for (GLuint i = 0; i < NAMES; i++)
        assert_false(machine.is_live[i]);
    assert_null(machine.current);
    return 0;
}

static void play_the_programs(void) {
    epoxy_glCreateShader = create_shader;
    epoxy_glCreateProgram = create_program;
    epoxy_glShaderSource = shader_source;
    epoxy_glCompileShader = epoxy_glLinkProgram = epoxy_glDeleteShader = ignore_name;
    epoxy_glAttachShader = epoxy_glDetachShader = ignore_names;
    epoxy_glGetShaderiv = epoxy_glGetProgramiv = get_status;
    epoxy_glGetShaderInfoLog = epoxy_glGetProgramInfoLog = get_log;
    epoxy_glDeleteProgram = delete_program;
    epoxy_glGenQueries = name_things;
    epoxy_glDeleteQueries = ignore_things;
    epoxy_glGenBuffers = name_buffers;
    epoxy_glDeleteBuffers = delete_buffers;
    epoxy_glBindBuffer = bind_buffer;
    epoxy_glBufferData = buffer_data;
    epoxy_glInvalidateBufferData = ignore_name;
    epoxy_glBufferSubData = buffer_sub_data;
    epoxy_glGetError = get_gl_error;
}

void play_the_machine(void) {
    play_the_programs();
    epoxy_eglGetError = get_error;
    epoxy_eglQueryString = query_string;
    epoxy_eglQueryDevicesEXT = query_devices;
    epoxy_eglQueryDeviceStringEXT = query_device_string;
    epoxy_eglGetPlatformDisplayEXT = get_platform_display;
    epoxy_eglGetDisplay = get_display;
    epoxy_eglInitialize = initialize;
    epoxy_eglBindAPI = bind_api;
    epoxy_eglCreateContext = create_context;
    epoxy_eglDestroyContext = destroy_context;
    epoxy_eglMakeCurrent = make_current;
    epoxy_eglGetCurrentContext = get_current_context;
    epoxy_eglChooseConfig = choose_config;
    epoxy_eglCreatePbufferSurface = create_surface;
    epoxy_eglDestroySurface = destroy_surface;
    epoxy_glGetString = get_string;
    epoxy_glGetStringi = get_string_at;
    epoxy_glGetIntegerv = get_integers;
    epoxy_glGetInteger64v = get_integer;
    epoxy_glGetInteger64i_v = get_integer_at;
}
