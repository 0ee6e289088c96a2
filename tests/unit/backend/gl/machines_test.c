/* SPDX-License-Identifier: Apache-2.0
 *
 * Fake machines with working and broken GPUs (fake_machine.h).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "backend/gl/state.h"
#include "sp/log.h"
#include "sp/probe.h"
#include "support/compare.h"
#include "support/gl.h"
#include "unit/backend/gl/fake_machine.h"

/* Returns the index of the driver of a new context; −1 with *err set if there is none. */
static int open_driver(int gpu, bool software, struct gl_info *info, struct sp_error *err) {
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
    assert_int_equal(open_driver(-1, false, &info, &err), 3);
    assert_int_equal(info.gpu, 3);
    assert_int_equal(info.platform, GL_PLATFORM_DEVICE);
    assert_int_equal(machine.initialised, 0xf); /* no other platform is tried */
    assert_int_equal(open_driver(-1, true, &info, &err), 1);
    assert_true(info.software);
    drivers[3].error = EGL_BAD_ALLOC;
    drivers[3].broken = drivers[DEFAULT].broken = true;
    drivers[SURFACELESS].no_desktop = true;
    assert_int_equal(open_driver(-1, false, &info, &err), -1);
    assert_int_equal(err.code, SP_ERR_BACKEND);
    assert_string_equal(
        err.text, "EGL device 0: eglInitialize failed: EGL_NOT_INITIALIZED; "
                  "EGL device 1: llvmpipe (LLVM 15.0.6, 256 bits) is software GL; "
                  "EGL device 2: OpenGL 4.2 Fake of Real 100; a core profile of 4.3 is needed; "
                  "EGL device 3: eglInitialize failed: EGL_BAD_ALLOC; "
                  "surfaceless display: eglCreateContext for desktop GL failed: EGL_BAD_MATCH; "
                  "default display: eglInitialize failed: EGL_NOT_INITIALIZED");
}

static void a_named_device_is_the_only_one_tried(void **state) {
    (void)state;
    struct gl_info info;
    struct sp_error err;
    device_count = 3;
    assert_int_equal(open_driver(1, false, &info, &err), 1);
    assert_int_equal(machine.initialised, 2);
    drivers[1].name = "softpipe";
    assert_int_equal(open_driver(1, false, &info, &err), -1);
    assert_string_equal(err.text, "EGL device 1: softpipe is software GL");
    assert_int_equal(open_driver(1, true, &info, &err), 1);
    assert_int_equal(open_driver(2, true, &info, &err), -1);
    assert_string_equal(err.text, "EGL device 2: Real 100 is a GPU, not software GL");
    assert_int_equal(open_driver(3, false, &info, &err), -1);
    assert_int_equal(err.code, SP_ERR_INVALID);
    assert_string_equal(err.text, "there is no GPU 3; EGL lists 3 devices, counted from 0");
}

static void other_platforms_come_after_devices(void **state) {
    (void)state;
    struct gl_info info;
    struct sp_error err;
    drivers[0].broken = true;
    assert_int_equal(open_driver(-1, false, &info, &err), SURFACELESS);
    assert_int_equal(info.gpu, -1);
    assert_int_equal(info.platform, GL_PLATFORM_SURFACELESS);
    drivers[SURFACELESS].broken = true;
    assert_int_equal(open_driver(-1, false, &info, &err), DEFAULT);
    assert_int_equal(info.platform, GL_PLATFORM_DEFAULT);
    drivers[DEFAULT].broken = true;
    client_extensions = "EGL_EXT_platform_base EGL_EXT_device_query EGL_EXT_device_enumeration "
                        "EGL_EXT_platform_device2 EGL_MESA_platform_surfaceless";
    assert_int_equal(open_driver(-1, false, &info, &err), -1);
    assert_non_null(strstr(err.text, "device display: EGL does not have EGL_EXT_platform_device;"));
    drivers[0].broken = false; /* NVIDIA's list has one name for enumeration and query */
    client_extensions = "EGL_EXT_platform_base EGL_EXT_device_base EGL_EXT_platform_device";
    assert_int_equal(open_driver(-1, false, &info, &err), 0);
    drivers[0].broken = true;
    client_extensions = NULL; /* old EGL has only the default display */
    drivers[DEFAULT].broken = false;
    machine.initialised = 0;
    assert_int_equal(open_driver(-1, false, &info, &err), DEFAULT);
    assert_int_equal(machine.initialised, 1 << DEFAULT);
    client_extensions = all_extensions;
    device_count = 0;
    drivers[SURFACELESS].broken = drivers[DEFAULT].broken = true;
    assert_int_equal(open_driver(-1, false, &info, &err), -1);
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
        assert_int_equal(open_driver(0, true, &info, &err), 0);
        assert_int_equal(open_driver(0, false, &info, &err), -1);
    }
    for (size_t i = 0; i < sizeof hard / sizeof hard[0]; i++) {
        drivers[0].name = hard[i];
        assert_int_equal(open_driver(0, false, &info, &err), 0);
        assert_string_equal(info.renderer, hard[i]);
        assert_int_equal(open_driver(0, true, &info, &err), -1);
    }
}

static void a_device_for_software_is_not_opened_for_a_gpu(void **state) {
    (void)state;
    struct gl_info info;
    struct sp_error err;
    device_count = 2;
    drivers[0].name = "llvmpipe";
    drivers[0].is_known_software = true;
    assert_int_equal(open_driver(-1, false, &info, &err), 1);
    assert_int_equal(machine.initialised, 2);
    assert_int_equal(open_driver(0, false, &info, &err), -1);
    assert_string_equal(err.text, "EGL device 0: this device is software GL");
    assert_int_equal(open_driver(-1, true, &info, &err), 0);
    machine.initialised = 0; /* if all devices are software, no display is tried */
    device_count = 1;
    assert_int_equal(open_driver(-1, false, &info, &err), -1);
    assert_int_equal(machine.initialised, 0);
    assert_string_equal(err.text, "EGL device 0: this device is software GL; surfaceless display: "
                                  "no device but software GL; default display: no device but "
                                  "software GL");
    device_count = 0; /* without devices, displays are tried */
    assert_int_equal(open_driver(-1, false, &info, &err), SURFACELESS);
}

static void the_newest_context_is_taken(void **state) {
    (void)state;
    struct gl_info info;
    struct sp_error err;
    assert_int_equal(open_driver(0, false, &info, &err), 0);
    assert_int_equal(info.minor, 5);
    assert_true(info.tells_reset);
    drivers[0].no_resets = true; /* the version matters more */
    assert_int_equal(open_driver(0, false, &info, &err), 0);
    assert_int_equal(info.minor, 5);
    assert_false(info.tells_reset);
    drivers[0].minor = 4;
    assert_int_equal(open_driver(0, false, &info, &err), 0);
    assert_int_equal(info.minor, 3);
    drivers[0].no_resets = false;
    assert_int_equal(open_driver(0, false, &info, &err), 0);
    assert_true(info.tells_reset);
    drivers[0].minor = -1; /* no core profile, but another one */
    assert_int_equal(open_driver(0, false, &info, &err), -1);
    assert_string_equal(
        err.text, "EGL device 0: OpenGL 2.1 Fake of Real 100; a core profile of 4.3 is needed");
}

static void limits_and_names_are_read(void **state) {
    (void)state;
    struct gl_info info;
    struct sp_error err;
    drivers[0].video_mib = 143771;
    assert_int_equal(open_driver(0, false, &info, &err), 0);
    assert_compare(info.limits.video_bytes, ==, UINT64_C(143771) << 20);
    assert_compare(info.limits.storage_block_bytes, ==, UINT64_C(1) << 31);
    assert_int_equal(info.limits.shared_bytes, 0); /* an impossible size counts as unknown */
    for (unsigned i = 0; i < 3; i++) {
        assert_int_equal(info.limits.group_size[i], 10 + i);
        assert_int_equal(info.limits.group_count[i], 20 + i);
    }
    assert_string_equal(info.vendor, "Fake & S??hne?"); /* safe in JSON and in HTTP headers */
    assert_string_equal(info.driver, "Fake, EGL 1.5");
    struct sp_backend_options options = { .memory_bytes = 4000 };
    assert_compare(gl_video_budget(&info, &options), ==, UINT64_C(143771) * 3 << 17);
    options.video_bytes = 5000;
    assert_compare(gl_video_budget(&info, &options), ==, 5000);
    drivers[0].video_mib = 0;
    drivers[0].name = NULL;
    assert_int_equal(open_driver(0, false, &info, &err), 0);
    assert_compare(info.limits.video_bytes, ==, 0);
    assert_compare(gl_video_budget(&info, &options), ==, 5000);
    options.video_bytes = 0;
    assert_compare(gl_video_budget(&info, &options), ==, 2000);
    options.memory_bytes = UINT64_C(64) << 30; /* names no card */
    assert_compare(gl_video_budget(&info, &options), ==, UINT64_C(1) << 30);
    info.software = true;
    assert_compare(gl_video_budget(&info, &options), ==, UINT64_C(64) << 30);
    assert_string_equal(info.renderer, "unnamed");
}

static void a_surface_is_made_where_one_is_needed(void **state) {
    (void)state;
    struct gl_info info;
    struct sp_error err;
    drivers[0].wants_surface = true;
    assert_int_equal(open_driver(0, false, &info, &err), 0);
}

static void a_node_that_cannot_be_opened_is_named(void **state) {
    (void)state;
    struct gl_info info;
    struct sp_error err;
    drivers[0].file = "/dev/dri/card999";
    assert_int_equal(open_driver(0, false, &info, &err), 0); /* a working device needs no node */
    drivers[0].name = "llvmpipe";
    assert_int_equal(open_driver(0, false, &info, &err), -1);
    assert_string_equal(err.text, "EGL device 0 (/dev/dri/card999): llvmpipe is software GL; "
                                  "/dev/dri/card999 cannot be opened: No such file or directory");
    drivers[0].file = "/dev/null";
    assert_int_equal(open_driver(0, false, &info, &err), -1);
    assert_string_equal(err.text, "EGL device 0 (/dev/null): llvmpipe is software GL");
}

static bool passes(void *user, void *state, struct sp_error *err) {
    const struct gl_state *made = state;
    unsigned driver = (unsigned)made->options.gpu;
    (void)user;
    assert_null(machine.current); /* as for drawing */
    machine.asked |= 1u << driver;
    return !drivers[driver].is_refused || sp_fail(err, SP_ERR_BACKEND, "", "it draws wrong images");
}

static const struct sp_backend_options starting = {
    .threads = 1, .memory_bytes = 1 << 30, .isa = "auto", .gpu = -1, .passes = passes
};

/* A context is not enough: shaders that do not compile, no memory, wrong images. */
static void a_device_that_fails_the_check_is_skipped(void **state) {
    (void)state;
    const struct sp_backend *backend = test_backend("gl");
    struct sp_error err;
    device_count = 4;
    drivers[0].compiles_nothing = drivers[1].lacks_memory = drivers[2].is_refused = true;
    struct gl_state *made = backend->create(&starting, &err);
    assert_non_null(made);
    assert_int_equal(made->options.gpu, 3);
    assert_int_equal(machine.asked, 1 << 2 | 1 << 3);
    assert_int_equal(machine.initialised, 0xf);
    assert_int_equal(machine.contexts, 1);
    backend->destroy(made);
    drivers[3].is_refused = true;
    drivers[SURFACELESS].compiles_nothing = drivers[DEFAULT].compiles_nothing = true;
    assert_null(backend->create(&starting, &err));
    assert_int_equal(err.code, SP_ERR_BACKEND);
    assert_non_null(strstr(err.text, "EGL device 0: shader project does not compile: no idea; "
                                     "EGL device 1: the GPU has no "));
    assert_non_null(strstr(err.text, "EGL device 2: it draws wrong images; "
                                     "EGL device 3: it draws wrong images; "
                                     "surfaceless display: shader "));
}

/* A backend that has started restarts on the same display and on no other. */
static void a_named_platform_is_the_only_one_tried(void **state) {
    (void)state;
    const struct sp_backend *backend = test_backend("gl");
    const struct sp_backend_options anywhere = {
        .threads = 1, .memory_bytes = 1 << 30, .isa = "auto", .gpu = -1
    };
    struct sp_error err;
    drivers[0].broken = true;
    struct gl_state *made = backend->create(&anywhere, &err);
    assert_non_null(made);
    const struct gl_options again = made->options;
    backend->destroy(made);
    assert_int_equal(again.gpu, -1);
    assert_int_equal(again.platform, GL_PLATFORM_SURFACELESS);
    drivers[0].broken = false;
    machine.initialised = 0;
    struct gl_context *context = gl_context_create(&again, &err);
    assert_non_null(context);
    assert_int_equal(machine.initialised, 1 << SURFACELESS);
    gl_context_destroy(&context);
    drivers[SURFACELESS].broken = true;
    assert_null(gl_context_create(&again, &err));
    assert_string_equal(err.text, "surfaceless display: eglInitialize failed: EGL_NOT_INITIALIZED");
}

static void note_device(void *user, const struct sp_device *device) {
    struct sp_device **next = user;
    *(*next)++ = *device;
}

static void the_probe_reports_every_device(void **state) {
    (void)state;
    struct sp_device found[8], *next = found;
    device_count = 3;
    drivers[0].video_mib = 100;
    drivers[1].name = "llvmpipe";
    drivers[2].broken = true;
    drivers[SURFACELESS].broken = drivers[DEFAULT].broken = true;
    gl_probe(&starting, note_device, &next);
    assert_int_equal(next - found, 5);
    assert_string_equal(found[0].backend, "gl");
    assert_true(found[0].is_gpu);
    assert_string_equal(found[0].name, "Real 100");
    assert_int_equal(found[0].refusal_code, SP_OK);
    assert_string_equal(found[0].refusal, "");
    assert_compare(found[0].limits.video_bytes, ==, 100 << 20);
    assert_string_equal(found[1].backend, "gl-software");
    assert_false(found[1].is_gpu);
    assert_string_equal(found[1].refusal, "");
    for (int i = 2; i < 5; i++) {
        assert_int_equal(found[i].refusal_code, SP_ERR_BACKEND);
        assert_string_equal(found[i].refusal, "eglInitialize failed: EGL_NOT_INITIALIZED");
    }
    static const int gpus[5] = { 0, 1, 2, -1, -1 };
    static const char *const places[5] = { "EGL device 0", "EGL device 1", "EGL device 2",
                                           "surfaceless display", "default display" };
    for (int i = 0; i < 5; i++) {
        assert_int_equal(found[i].gpu, gpus[i]);
        assert_string_equal(found[i].place, places[i]);
    }
}

/* The probe does not report a GPU as working if a start would refuse it. */
static void the_probe_tries_what_the_start_does(void **state) {
    (void)state;
    struct sp_device found[8], *next = found;
    device_count = 4;
    drivers[0].compiles_nothing = drivers[2].is_refused = true;
    drivers[3].name = "llvmpipe";
    drivers[SURFACELESS].broken = drivers[DEFAULT].broken = true;
    gl_probe(&starting, note_device, &next);
    assert_int_equal(next - found, 6);
    assert_string_equal(found[0].name, "Real 100"); /* its limits are reported anyway */
    assert_string_equal(found[0].refusal, "shader project does not compile: no idea");
    assert_string_equal(found[1].refusal, "");
    assert_string_equal(found[2].refusal, "it draws wrong images");
    assert_string_equal(found[3].refusal, "");
    assert_int_equal(machine.asked, 1 << 1 | 1 << 2); /* software GL is not offered */
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, machine_begin, machine_end)

int main(void) {
    const struct CMUnitTest tests[] = {
        TEST(every_device_is_tried_in_turn),
        TEST(a_named_device_is_the_only_one_tried),
        TEST(other_platforms_come_after_devices),
        TEST(software_is_known_by_its_name),
        TEST(a_device_for_software_is_not_opened_for_a_gpu),
        TEST(the_newest_context_is_taken),
        TEST(limits_and_names_are_read),
        TEST(a_surface_is_made_where_one_is_needed),
        TEST(a_node_that_cannot_be_opened_is_named),
        TEST(a_device_that_fails_the_check_is_skipped),
        TEST(a_named_platform_is_the_only_one_tried),
        TEST(the_probe_reports_every_device),
        TEST(the_probe_tries_what_the_start_does),
    };
    sp_log_init(NULL, NULL, SP_LOG_WARN);
    play_the_machine();
    return cmocka_run_group_tests(tests, NULL, NULL);
}
