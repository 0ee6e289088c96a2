/* SPDX-License-Identifier: Apache-2.0
 *
 * Machines with GPUs, good ones and bad ones, that need none: EGL and GL are played by the
 * functions below, in the place of those that libepoxy found.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "backend/gl/egl.h"

#include <epoxy/gl.h>
#include <stdio.h>
#include <string.h>

#include "sp/log.h"

/* One display and the GL behind it. */
struct driver {
    bool broken;        /* does not initialise */
    EGLint error;       /* of its last call that failed; 0 = EGL_NOT_INITIALIZED */
    const char *name;   /* GL_RENDERER */
    int minor;          /* gives core contexts of OpenGL 4.0 to 4.minor; −1 = no core context */
    bool no_resets;     /* gives none that tells of resets */
    bool no_desktop;    /* gives no context of desktop GL at all */
    bool wants_surface; /* has not the extensions to do without */
    bool is_known_software; /* the device says so */
    const char *file;       /* the device's node */
    int video_mib;          /* by GL_NVX_gpu_memory_info; 0 = does not tell */
};

enum { DEVICES = 4, SURFACELESS = DEVICES, DEFAULT, DRIVERS };
static struct driver drivers[DRIVERS];
static unsigned device_count;
static const char *client_extensions;

static struct { /* what is there now */
    EGLint error;
    struct driver *current;
    int contexts, surfaces;
    int minor; /* of the newest context */
    bool tells_reset;
    unsigned initialised; /* bit n = driver n */
} machine;

static const char all_extensions[] =
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

static int begin(void **state) {
    (void)state;
    memset(&machine, 0, sizeof machine);
    for (int i = 0; i < DRIVERS; i++)
        drivers[i] = (struct driver){ .name = "Real 100", .minor = 6 };
    device_count = 1;
    client_extensions = all_extensions;
    return 0;
}

/* Nothing is left behind, whatever happened. */
static int end(void **state) {
    (void)state;
    assert_int_equal(machine.contexts, 0);
    assert_int_equal(machine.surfaces, 0);
    assert_null(machine.current);
    return 0;
}

/* Index of the driver that a context comes from; −1 with *err set for none. */
static int take(int gpu, bool software, struct gl_info *info, struct sp_error *err) {
    const struct gl_options options = { .gpu = gpu, .software = software };
    struct gl_context *context = gl_context_create(&options, err);
    if (!context)
        return -1;
    assert_null(machine.current);
    assert_true(gl_context_bind(context, NULL));
    int driver = (int)(machine.current - drivers);
    *info = *gl_context_info(context);
    gl_context_destroy(&context);
    return driver;
}

static void every_device_is_tried_in_turn(void **state) {
    (void)state;
    struct gl_info info;
    struct sp_error err;
    device_count = 4;
    drivers[0].broken = true;
    drivers[1].name = "llvmpipe (LLVM 15.0.6, 256 bits)";
    drivers[2].minor = 2;
    assert_int_equal(take(-1, false, &info, &err), 3);
    assert_int_equal(info.gpu, 3);
    assert_string_equal(info.platform, "device");
    assert_int_equal(machine.initialised, 0xf); /* and no other platform */
    assert_int_equal(take(-1, true, &info, &err), 1);
    assert_true(info.software);
    drivers[3].error = EGL_BAD_ALLOC;
    drivers[3].broken = drivers[DEFAULT].broken = true;
    drivers[SURFACELESS].no_desktop = true;
    assert_int_equal(take(-1, false, &info, &err), -1);
    assert_int_equal(err.code, SP_ERR_BACKEND);
    assert_string_equal(
        err.text, "EGL device 0: eglInitialize fails: EGL_NOT_INITIALIZED; "
                  "EGL device 1: llvmpipe (LLVM 15.0.6, 256 bits) is software GL; "
                  "EGL device 2: OpenGL 4.2 Fake of Real 100; a core profile of 4.3 is needed; "
                  "EGL device 3: eglInitialize fails: EGL_BAD_ALLOC; "
                  "surfaceless display: eglCreateContext for desktop GL fails: EGL_BAD_MATCH; "
                  "default display: eglInitialize fails: EGL_NOT_INITIALIZED");
}

static void one_device_is_taken_alone(void **state) {
    (void)state;
    struct gl_info info;
    struct sp_error err;
    device_count = 3;
    assert_int_equal(take(1, false, &info, &err), 1);
    assert_int_equal(machine.initialised, 2);
    drivers[1].name = "softpipe";
    assert_int_equal(take(1, false, &info, &err), -1);
    assert_string_equal(err.text, "EGL device 1: softpipe is software GL");
    assert_int_equal(take(1, true, &info, &err), 1);
    assert_int_equal(take(2, true, &info, &err), -1);
    assert_string_equal(err.text, "EGL device 2: Real 100 is hardware");
    assert_int_equal(take(3, false, &info, &err), -1);
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_string_equal(err.text, "there is no GPU 3; EGL lists 3 devices, from 0");
}

static void other_platforms_come_after_devices(void **state) {
    (void)state;
    struct gl_info info;
    struct sp_error err;
    drivers[0].broken = true;
    assert_int_equal(take(-1, false, &info, &err), SURFACELESS);
    assert_int_equal(info.gpu, -1);
    assert_string_equal(info.platform, "surfaceless");
    drivers[SURFACELESS].broken = true;
    assert_int_equal(take(-1, false, &info, &err), DEFAULT);
    assert_string_equal(info.platform, "default");
    drivers[DEFAULT].broken = true;
    client_extensions = "EGL_EXT_platform_base EGL_EXT_device_query EGL_EXT_device_enumeration "
                        "EGL_EXT_platform_device2 EGL_MESA_platform_surfaceless";
    assert_int_equal(take(-1, false, &info, &err), -1);
    assert_non_null(strstr(err.text, "device display: EGL does not have EGL_EXT_platform_device;"));
    client_extensions = NULL; /* before client extensions there was only this */
    drivers[DEFAULT].broken = false;
    machine.initialised = 0;
    assert_int_equal(take(-1, false, &info, &err), DEFAULT);
    assert_int_equal(machine.initialised, 1 << DEFAULT);
    client_extensions = all_extensions;
    device_count = 0;
    drivers[SURFACELESS].broken = drivers[DEFAULT].broken = true;
    assert_int_equal(take(-1, false, &info, &err), -1);
    assert_non_null(strstr(err.text, "device display: EGL does not have any device;"));
}

static void software_is_known_by_its_name(void **state) {
    (void)state;
    static const char *const soft[] = { "llvmpipe (LLVM 15.0.6, 256 bits)",
                                        "zink Vulkan 1.3(llvmpipe (LLVM 17.0.6, 256 bits))",
                                        "softpipe",
                                        "SWR (LLVM 10.0.0, 256 bits)",
                                        "Software Rasterizer",
                                        "Mesa DRI swrast",
                                        "virgl (LLVMPIPE (LLVM 15.0.7, 256 bits))",
                                        "Google SwiftShader",
                                        "D3D12 (Microsoft Basic Render Driver)" };
    static const char *const hard[] = { "NVIDIA H200/PCIe/SSE2",
                                        "AMD Radeon RX 7900 XTX (radeonsi, navi31, LLVM 15.0.6)",
                                        "Mesa Intel(R) Arc(tm) A770 Graphics (DG2)",
                                        "zink Vulkan 1.3(NVIDIA GeForce RTX 3060)" };
    struct gl_info info;
    struct sp_error err;
    for (size_t i = 0; i < sizeof soft / sizeof soft[0]; i++) {
        drivers[0].name = soft[i];
        assert_int_equal(take(0, true, &info, &err), 0);
        assert_int_equal(take(0, false, &info, &err), -1);
    }
    for (size_t i = 0; i < sizeof hard / sizeof hard[0]; i++) {
        drivers[0].name = hard[i];
        assert_int_equal(take(0, false, &info, &err), 0);
        assert_string_equal(info.renderer, hard[i]);
        assert_int_equal(take(0, true, &info, &err), -1);
    }
}

static void a_device_for_software_is_not_opened_for_a_gpu(void **state) {
    (void)state;
    struct gl_info info;
    struct sp_error err;
    device_count = 2;
    drivers[0].name = "llvmpipe";
    drivers[0].is_known_software = true;
    assert_int_equal(take(-1, false, &info, &err), 1);
    assert_int_equal(machine.initialised, 2);
    assert_int_equal(take(0, false, &info, &err), -1);
    assert_string_equal(err.text, "EGL device 0: this device is software GL");
    assert_int_equal(take(-1, true, &info, &err), 0);
    machine.initialised = 0; /* where every device is software no display is asked */
    device_count = 1;
    assert_int_equal(take(-1, false, &info, &err), -1);
    assert_int_equal(machine.initialised, 0);
    assert_string_equal(err.text, "EGL device 0: this device is software GL; surfaceless display: "
                                  "no device but software GL; default display: no device but "
                                  "software GL");
    device_count = 0; /* nothing is known of displays then */
    assert_int_equal(take(-1, false, &info, &err), SURFACELESS);
}

static void the_newest_context_is_taken(void **state) {
    (void)state;
    struct gl_info info;
    struct sp_error err;
    assert_int_equal(take(0, false, &info, &err), 0);
    assert_int_equal(info.minor, 5);
    assert_true(info.tells_reset);
    drivers[0].no_resets = true; /* the version counts for more */
    assert_int_equal(take(0, false, &info, &err), 0);
    assert_int_equal(info.minor, 5);
    assert_false(info.tells_reset);
    drivers[0].minor = 4;
    assert_int_equal(take(0, false, &info, &err), 0);
    assert_int_equal(info.minor, 3);
    drivers[0].no_resets = false;
    assert_int_equal(take(0, false, &info, &err), 0);
    assert_true(info.tells_reset);
    drivers[0].minor = -1; /* none at all, but another profile */
    assert_int_equal(take(0, false, &info, &err), -1);
    assert_string_equal(
        err.text, "EGL device 0: OpenGL 2.1 Fake of Real 100; a core profile of 4.3 is needed");
}

static void limits_and_names_are_read(void **state) {
    (void)state;
    struct gl_info info;
    struct sp_error err;
    drivers[0].video_mib = 143771;
    assert_int_equal(take(0, false, &info, &err), 0);
    assert_true(info.limits.video_bytes == UINT64_C(143771) << 20);
    assert_true(info.limits.storage_block_bytes == UINT64_C(1) << 31);
    assert_int_equal(info.limits.shared_bytes, 0); /* nonsense counts as not told */
    for (unsigned i = 0; i < 3; i++) {
        assert_int_equal(info.limits.group_size[i], 10 + i);
        assert_int_equal(info.limits.group_count[i], 20 + i);
    }
    assert_string_equal(info.vendor, "Fake & S??hne?"); /* fit for JSON and headers */
    assert_string_equal(info.driver, "Fake, EGL 1.5");
    struct sp_backend_options options = { .memory_bytes = 4000 };
    assert_true(gl_video_budget(&info, &options) == UINT64_C(143771) * 3 << 17);
    options.video_bytes = 5000;
    assert_true(gl_video_budget(&info, &options) == 5000);
    drivers[0].video_mib = 0;
    drivers[0].name = NULL;
    assert_int_equal(take(0, false, &info, &err), 0);
    assert_true(info.limits.video_bytes == 0);
    assert_true(gl_video_budget(&info, &options) == 5000);
    options.video_bytes = 0;
    assert_true(gl_video_budget(&info, &options) == 4000);
    assert_string_equal(info.renderer, "unnamed");
}

static void a_surface_is_made_where_one_is_needed(void **state) {
    (void)state;
    struct gl_info info;
    struct sp_error err;
    drivers[0].wants_surface = true;
    assert_int_equal(take(0, false, &info, &err), 0);
}

static void a_node_that_cannot_be_opened_is_named(void **state) {
    (void)state;
    struct gl_info info;
    struct sp_error err;
    drivers[0].file = "/dev/dri/card999";
    assert_int_equal(take(0, false, &info, &err), 0); /* it is nobody's business while it works */
    drivers[0].name = "llvmpipe";
    assert_int_equal(take(0, false, &info, &err), -1);
    assert_string_equal(err.text, "EGL device 0 (/dev/dri/card999): llvmpipe is software GL; "
                                  "/dev/dri/card999 cannot be opened: No such file or directory");
    drivers[0].file = "/dev/null";
    assert_int_equal(take(0, false, &info, &err), -1);
    assert_string_equal(err.text, "EGL device 0 (/dev/null): llvmpipe is software GL");
}

static void note_device(void *user, const struct sp_device *device) {
    struct sp_device **next = user;
    *(*next)++ = *device;
}

static void the_probe_tells_of_all(void **state) {
    (void)state;
    struct sp_device found[8], *next = found;
    device_count = 3;
    drivers[0].video_mib = 100;
    drivers[1].name = "llvmpipe";
    drivers[2].broken = true;
    drivers[SURFACELESS].broken = drivers[DEFAULT].broken = true;
    gl_probe(NULL, note_device, &next);
    assert_int_equal(next - found, 5);
    assert_string_equal(found[0].backend, "gl");
    assert_true(found[0].is_gpu);
    assert_string_equal(found[0].name, "Real 100");
    assert_string_equal(found[0].refusal, "");
    assert_true(found[0].limits.video_bytes == 100 << 20);
    assert_string_equal(found[1].backend, "gl-software");
    assert_false(found[1].is_gpu);
    assert_string_equal(found[1].refusal, "");
    for (int i = 2; i < 5; i++)
        assert_string_equal(found[i].refusal, "eglInitialize fails: EGL_NOT_INITIALIZED");
    static const int gpus[5] = { 0, 1, 2, -1, -1 };
    static const char *const places[5] = { "EGL device 0", "EGL device 1", "EGL device 2",
                                           "surfaceless display", "default display" };
    for (int i = 0; i < 5; i++) {
        assert_int_equal(found[i].gpu, gpus[i]);
        assert_string_equal(found[i].place, places[i]);
    }
}

static void play_the_machine(void) {
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

#define TEST(name) cmocka_unit_test_setup_teardown(name, begin, end)

int main(void) {
    const struct CMUnitTest tests[] = {
        TEST(every_device_is_tried_in_turn),
        TEST(one_device_is_taken_alone),
        TEST(other_platforms_come_after_devices),
        TEST(software_is_known_by_its_name),
        TEST(a_device_for_software_is_not_opened_for_a_gpu),
        TEST(the_newest_context_is_taken),
        TEST(limits_and_names_are_read),
        TEST(a_surface_is_made_where_one_is_needed),
        TEST(a_node_that_cannot_be_opened_is_named),
        TEST(the_probe_tells_of_all),
    };
    sp_log_init(NULL, NULL, SP_LOG_WARN);
    play_the_machine();
    return cmocka_run_group_tests(tests, NULL, NULL);
}
