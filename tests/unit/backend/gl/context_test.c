/* SPDX-License-Identifier: Apache-2.0
 *
 * context_test MODE: creates a GL context on machines without GL or with an old version of it. The
 * environment imitates the machine (CMakeLists.txt), so each mode is a process of its own.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <epoxy/gl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "backend/gl/context.h"
#include "backend/gl/egl.h"
#include "sp/log.h"
#include "sp/probe.h"
#include "support/compare.h"

enum { SKIPPED = 77 };
static const struct gl_options hardware = { .gpu = -1 }, software = { .gpu = -1, .software = true };

static struct gl_context *create(const struct gl_options *options) {
    struct sp_error err;
    struct gl_context *context = gl_context_create(options, &err);
    if (!context)
        fail_msg("%s", err.text);
    return context;
}

static void bind(struct gl_context *context) {
    struct sp_error err;
    if (!gl_context_bind(context, &err))
        fail_msg("%s", err.text);
}

/* Neither hardware nor software gives a context; the reason contains these words. */
static void refuses(const struct gl_options *options, enum sp_code code, const char *words) {
    struct sp_error err = { .code = SP_OK };
    assert_null(gl_context_create(options, &err));
    assert_int_equal(err.code, code);
    if (!strstr(err.text, words))
        fail_msg("\"%s\" has no \"%s\"", err.text, words);
}

static void info_tells_all(void **state) {
    (void)state;
    struct gl_context *context = create(&software);
    const struct gl_info *info = gl_context_info(context);
    assert_true(info->software);
    assert_true(info->renderer[0]);
    assert_true(info->vendor[0]);
    assert_true(info->version[0]);
    assert_true(info->driver[0]);
    assert_int_equal(info->major, 4);
    assert_compare(info->minor, >=, 3);
    /* The minimum limits of OpenGL 4.3. */
    const struct sp_gpu_limits *limits = &info->limits;
    assert_compare(limits->storage_block_bytes, >=, 1 << 24);
    assert_compare(limits->storage_blocks, >=, 8);
    assert_compare(limits->storage_alignment, >=, 1);
    assert_compare(limits->storage_alignment, <=, 256);
    assert_compare(limits->shared_bytes, >=, 32768);
    assert_compare(limits->group_invocations, >=, 1024);
    static const unsigned size[3] = { 1024, 1024, 64 };
    for (int i = 0; i < 3; i++) {
        assert_compare(limits->group_size[i], >=, size[i]);
        assert_compare(limits->group_count[i], >=, 65535);
    }
    gl_context_destroy(&context);
    assert_null(context);
    gl_context_destroy(&context); /* harmless */
}

static void a_gpu_is_never_software(void **state) {
    (void)state;
    struct gl_places places;
    struct sp_error err;
    struct gl_context *context = gl_context_create(&hardware, &err);
    if (context) {
        assert_false(gl_context_info(context)->software);
        gl_context_destroy(&context);
        return;
    }
    assert_int_equal(err.code, SP_ERR_BACKEND);
    assert_non_null(strstr(err.text, "is software GL"));
    assert_true(gl_places_list(&places, NULL));
    for (unsigned i = 0; i < places.count; i++) { /* each has its reason */
        char name[96];
        gl_place_name(&places.list[i], name, sizeof name);
        assert_non_null(strstr(err.text, name));
    }
}

static void a_device_is_taken_by_its_number(void **state) {
    (void)state;
    struct gl_places places;
    assert_true(gl_places_list(&places, NULL));
    char words[64];
    snprintf(words, sizeof words, "EGL lists %u", places.devices);
    for (int i = 0; i < 2; i++)
        refuses(&(struct gl_options){ .gpu = (int)places.devices, .software = i }, SP_ERR_INVALID,
                words);
    for (unsigned i = 0; i < places.devices; i++) {
        struct gl_options options = { .gpu = (int)i, .software = true };
        struct gl_context *context = gl_context_create(&options, NULL);
        if (context) { /* other devices are hardware, or do not work */
            assert_int_equal(gl_context_info(context)->gpu, i);
            assert_int_equal(gl_context_info(context)->platform, GL_PLATFORM_DEVICE);
        }
        gl_context_destroy(&context);
    }
}

static void *use_elsewhere(void *user) {
    GLuint buffer;
    if (!gl_context_bind(user, NULL))
        return NULL;
    glGenBuffers(1, &buffer);
    glDeleteBuffers(1, &buffer);
    bool works = glGetError() == GL_NO_ERROR;
    gl_context_unbind(user);
    return works ? user : NULL;
}

static void it_moves_between_threads_but_not_to_two(void **state) {
    (void)state;
    struct gl_context *context = create(&software);
    pthread_t thread;
    void *result;
    assert_null(eglGetCurrentContext());
    for (int i = 0; i < 2; i++) {
        bind(context);
        gl_context_unbind(context);
        assert_int_equal(pthread_create(&thread, NULL, use_elsewhere, context), 0);
        assert_int_equal(pthread_join(thread, &result), 0);
        assert_ptr_equal(result, context);
    }
    gl_context_destroy(&context);
}

struct attempt {
    struct gl_context *context;
    struct sp_error err;
};

static void *bind_elsewhere(void *user) {
    struct attempt *attempt = user;
    gl_context_bind(attempt->context, &attempt->err);
    return NULL;
}

static void a_context_in_use_is_refused(void **state) {
    (void)state;
    struct gl_context *context = create(&software);
    struct attempt attempt = { .context = context };
    pthread_t thread;
    bind(context);
    assert_int_equal(pthread_create(&thread, NULL, bind_elsewhere, &attempt), 0);
    assert_int_equal(pthread_join(thread, NULL), 0);
    assert_int_equal(attempt.err.code, SP_ERR_BACKEND);
    assert_string_equal(attempt.err.text, "eglMakeCurrent failed: EGL_BAD_ACCESS");
    gl_context_destroy(&context); /* also unbinds it */
    assert_null(eglGetCurrentContext());
}

static void contexts_do_not_end_each_other(void **state) {
    (void)state;
    struct gl_context *first = create(&software), *second = create(&software);
    gl_context_destroy(&first);
    assert_non_null(use_elsewhere(second));
    gl_context_destroy(&second);
}

static void without_libegl(void **state) {
    (void)state;
    for (int i = 0; i < 2; i++)
        refuses(i ? &software : &hardware, SP_ERR_BACKEND, "libEGL.so.1 cannot be loaded: ");
}

static void without_libgl(void **state) {
    (void)state;
    for (int i = 0; i < 2; i++)
        refuses(i ? &software : &hardware, SP_ERR_BACKEND, "libGL.so.1 cannot be loaded: ");
}

static void without_a_driver(void **state) {
    (void)state;
    static const char *const words[] = { "device display: EGL does not have a driver",
                                         "surfaceless display: EGL does not have a driver",
                                         "default display: eglGetDisplay failed: EGL_" };
    for (int i = 0; i < 6; i++)
        refuses(i % 2 ? &software : &hardware, SP_ERR_BACKEND, words[i / 2]);
    refuses(&(struct gl_options){ .gpu = 0 }, SP_ERR_INVALID, "EGL lists 0 devices");
}

static void with_an_old_gl(void **state) {
    (void)state;
    refuses(&software, SP_ERR_BACKEND, "OpenGL 3.3");
    refuses(&software, SP_ERR_BACKEND, "a core profile of 4.3 is needed");
}

static void with_an_old_glsl(void **state) {
    (void)state;
    refuses(&software, SP_ERR_BACKEND,
            " with GLSL 3.30; a core profile of 4.3 with GLSL 4.30 is needed");
}

static void with_gl_4_3(void **state) {
    (void)state;
    struct gl_context *context = create(&software);
    assert_int_equal(gl_context_info(context)->minor, 3);
    gl_context_destroy(&context);
}

/* The tests below need a software GL that takes its version from the environment. */
static bool has_mesa(struct sp_error *err) {
    struct gl_places places;
    if (!gl_places_list(&places, err))
        return false;
    for (unsigned i = 0; i < places.count; i++) {
        EGLDisplay display = gl_place_open(&places.list[i], err);
        if (display != EGL_NO_DISPLAY && strstr(eglQueryString(display, EGL_VENDOR), "Mesa"))
            return true;
    }
    return false;
}

static const struct CMUnitTest machine[] = {
    cmocka_unit_test(info_tells_all),
    cmocka_unit_test(a_gpu_is_never_software),
    cmocka_unit_test(a_device_is_taken_by_its_number),
    cmocka_unit_test(it_moves_between_threads_but_not_to_two),
    cmocka_unit_test(a_context_in_use_is_refused),
    cmocka_unit_test(contexts_do_not_end_each_other),
};
static const struct CMUnitTest no_egl[] = { cmocka_unit_test(without_libegl) };
static const struct CMUnitTest no_gl[] = { cmocka_unit_test(without_libgl) };
static const struct CMUnitTest no_driver[] = { cmocka_unit_test(without_a_driver) };
static const struct CMUnitTest gl_3_3[] = { cmocka_unit_test(with_an_old_gl) };
static const struct CMUnitTest glsl_3_3[] = { cmocka_unit_test(with_an_old_glsl) };
static const struct CMUnitTest gl_4_3[] = { cmocka_unit_test(with_gl_4_3) };

int main(int argc, char **argv) {
#define MODE(name, tests, wants_mesa)                                                              \
    { name, tests, sizeof tests / sizeof tests[0], wants_mesa }
    static const struct {
        const char *name;
        const struct CMUnitTest *tests;
        size_t count;
        bool wants_mesa;
    } modes[] = {
        MODE("machine", machine, true), MODE("no-egl", no_egl, false),
        MODE("no-gl", no_gl, false),    MODE("no-driver", no_driver, false),
        MODE("gl-3.3", gl_3_3, true),   MODE("glsl-3.3", glsl_3_3, true),
        MODE("gl-4.3", gl_4_3, true),
    };
    const char *name = argc > 1 ? argv[1] : "machine";
    struct sp_error err;
    sp_log_init(NULL, NULL, SP_LOG_WARN);
    for (size_t i = 0; i < sizeof modes / sizeof modes[0]; i++) {
        if (strcmp(name, modes[i].name) != 0)
            continue;
        if (modes[i].wants_mesa && !has_mesa(&err)) {
            printf("skipped: no software GL of Mesa's: %s\n", err.text);
            return SKIPPED;
        }
        return _cmocka_run_group_tests(name, modes[i].tests, modes[i].count, NULL, NULL);
    }
    fprintf(stderr, "there is no mode %s\n", name);
    return 2;
}
