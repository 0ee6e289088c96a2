/* SPDX-License-Identifier: Apache-2.0
 *
 * Contexts that are lost while frames are drawn. The backend creates a new context and uploads the
 * volumes again, and the image is the same. Fake GL and EGL functions answer like a driver that has
 * reset its GPU.
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

#include "sp/inflight.h"
#include "sp/log.h"
#include "sp/renderer.h"
#include "support/gl.h"

enum { SIZE = 40, SKIPPED = 77 };

/* How often each call fails from now on. */
static struct {
    unsigned resets, binds, contexts, lists; /* listing devices, as if there were none */
    GLenum status;
} plan;
static unsigned contexts_made, warnings;
static char last_warning[512];

static struct {
    PFNEGLMAKECURRENTPROC make_current;
    PFNEGLCREATECONTEXTPROC create_context;
    PFNEGLGETERRORPROC get_error;
    PFNEGLQUERYDEVICESEXTPROC query_devices;
} real;
static EGLint error;

static bool fails(unsigned *planned) {
    bool now = *planned > 0;
    *planned -= now;
    return now;
}

static GLenum reset_status(void) {
    return fails(&plan.resets) ? plan.status : GL_NO_ERROR;
}

static EGLBoolean make_current(EGLDisplay display, EGLSurface draw, EGLSurface read,
                               EGLContext context) {
    if (context && fails(&plan.binds)) {
        error = EGL_CONTEXT_LOST;
        return EGL_FALSE;
    }
    return real.make_current(display, draw, read, context);
}

static EGLContext create_context(EGLDisplay display, EGLConfig config, EGLContext share,
                                 const EGLint *attributes) {
    if (fails(&plan.contexts)) {
        error = EGL_BAD_ALLOC;
        return EGL_NO_CONTEXT;
    }
    contexts_made++;
    return real.create_context(display, config, share, attributes);
}

static EGLBoolean query_devices(EGLint max, EGLDeviceEXT *devices, EGLint *count) {
    EGLBoolean ok = real.query_devices(max, devices, count);
    *count = fails(&plan.lists) ? 0 : *count;
    return ok;
}

static EGLint get_error(void) {
    EGLint planned = error;
    error = 0;
    return planned ? planned : real.get_error();
}

/* Call this after a context has existed: until then libepoxy would replace these functions. */
static void play_the_driver(void) {
    real.make_current = epoxy_eglMakeCurrent;
    real.create_context = epoxy_eglCreateContext;
    real.get_error = epoxy_eglGetError;
    real.query_devices = epoxy_eglQueryDevicesEXT;
    epoxy_glGetGraphicsResetStatus = reset_status;
    epoxy_eglMakeCurrent = make_current;
    epoxy_eglCreateContext = create_context;
    epoxy_eglGetError = get_error;
    epoxy_eglQueryDevicesEXT = query_devices;
}

static void count_warning(void *user, enum sp_log_level level, const char *kind,
                          const struct sp_log_field *fields, const char *line) {
    (void)kind;
    (void)fields;
    (void)user;
    if (level == SP_LOG_WARN) {
        warnings++;
        snprintf(last_warning, sizeof last_warning, "%s", line);
    }
}

struct scene {
    struct sp_renderer *renderer;
    struct sp_frame_pool *pool;
    struct sp_volume *volumes[2], *elements[2]; /* of layers of Gaussians and geometry */
    unsigned char wanted[2][SIZE][SIZE][4];
    struct sp_error err;
};

static void make_view(const struct scene *scene, int i, struct sp_view *view) {
    sp_view_init(view, sp_volume_info(scene->volumes[i]), "v");
    view->size[0] = view->size[1] = SIZE;
    view->shading.mode = SP_SHADING_PHONG;
    if (i == 1) /* the other volume is drawn as sheets of interpolated values */
        view->transfer_function.order = SP_TF_PRE;
}

static void copy_pixels(const struct sp_frame *frame, unsigned char pixels[SIZE][SIZE][4]) {
    for (int y = 0; y < SIZE; y++)
        memcpy(pixels[y], (char *)frame->pixels + frame->stride_bytes * y, 4 * SIZE);
}

/* The kinds of views of the test. */
enum kind { PLAIN, SLAB, WITH_LAYERS };

static void add_layers(const struct scene *scene, int i, struct sp_view *view) {
    const double *range = sp_volume_info(scene->volumes[i])->range;
    view->layers[1] = sp_layer_default(SP_LAYER_SURFACE);
    view->layers[1].value = 0.5 * (range[0] + range[1]);
    view->layers[1].opacity = 0.5f;
    view->layers[2] = sp_layer_default(SP_LAYER_SHELL);
    view->layers[3] = sp_layer_default(SP_LAYER_GAUSSIANS);
    view->layers[4] = sp_layer_default(SP_LAYER_GEOMETRY);
    view->layers[3].id[0] = '0';
    view->layers[4].id[0] = '1';
    view->layer_count = 5;
}

static struct sp_volume *find_element(void *user, const char *id) {
    const struct scene *scene = user;
    return sp_volume_ref(scene->elements[id[0] - '0']);
}

/* Draws volume i; false with scene->err set. */
static bool draw(struct scene *scene, int i, enum kind kind, unsigned char pixels[SIZE][SIZE][4]) {
    const struct sp_render_options options = { .find = find_element, .user = scene };
    struct sp_view view;
    make_view(scene, i, &view);
    if (kind == WITH_LAYERS)
        add_layers(scene, i, &view);
    if (kind == SLAB) { /* the new context has its own programs and tables */
        view.compositing.mode = SP_COMPOSITE_SLAB;
        view.transfer_function.order = SP_TF_POST;
    }
    struct sp_frame *frame = sp_renderer_render(scene->renderer, scene->volumes[i], &view,
                                                scene->pool, &options, &scene->err);
    if (!frame)
        return false;
    copy_pixels(frame, pixels);
    sp_frame_unref(&frame);
    return true;
}

static void check_images(struct scene *scene) {
    unsigned char got[SIZE][SIZE][4];
    for (int i = 0; i < 2; i++) {
        if (!draw(scene, i, PLAIN, got))
            fail_msg("%s", scene->err.text);
        assert_memory_equal(got, scene->wanted[i], sizeof got);
    }
}

static int begin(void **state) {
    struct scene *scene = *state;
    memset(&plan, 0, sizeof plan);
    plan.status = GL_GUILTY_CONTEXT_RESET;
    check_images(scene);
    warnings = contexts_made = 0;
    return 0;
}

static void a_reset_costs_no_frame(void **state) {
    static const struct {
        GLenum status;
        const char *words;
    } resets[] = { { GL_GUILTY_CONTEXT_RESET, "because of a command of this program" },
                   { GL_INNOCENT_CONTEXT_RESET, "because of a command of another program" },
                   { GL_UNKNOWN_CONTEXT_RESET, "for an unknown reason" },
                   { 0x92bb, "for an unknown reason" } };
    for (unsigned i = 0; i < sizeof resets / sizeof resets[0]; i++) {
        plan.status = resets[i].status;
        plan.resets = 1;
        check_images(*state);
        assert_int_equal(plan.resets, 0);
        assert_int_equal(warnings, i + 1);
        assert_int_equal(contexts_made, i + 1);
        assert_non_null(strstr(last_warning, test_gl()));
        assert_non_null(strstr(last_warning, " failed: the driver has reset "));
        assert_non_null(strstr(last_warning, resets[i].words));
    }
}

/* Two frames are in flight. Whichever finds the lost context, both are drawn again. */
static void a_reset_costs_no_frame_in_flight(void **state) {
    struct scene *scene = *state;
    for (unsigned i = 0; i < 4; i++) {
        struct sp_view view;
        unsigned char got[SIZE][SIZE][4];
        for (int v = 0; v < 2; v++) {
            plan.resets = i == 2u + (unsigned)v; /* found by begin … */
            make_view(scene, v, &view);
            assert_true(sp_renderer_begin(scene->renderer, scene->volumes[v], &view, scene->pool,
                                          NULL, &scene->err));
            assert_int_equal(plan.resets, 0);
        }
        plan.resets = i < 2; /* … or by finish of the first frame */
        for (int v = 0; v < 2; v++) {
            struct sp_frame *frame = sp_renderer_finish(scene->renderer, &scene->err);
            assert_non_null(frame);
            copy_pixels(frame, got);
            assert_memory_equal(got, scene->wanted[v], sizeof got);
            sp_frame_unref(&frame);
            plan.resets = i == 1 && v == 0; /* … and again by finish of the second */
        }
        assert_int_equal(plan.resets, 0);
        assert_int_equal(warnings, i == 1 ? 2 : 1);
        assert_int_equal(contexts_made, i == 1 ? 2 : 1);
        warnings = contexts_made = 0;
    }
}

static void check_loss(struct scene *scene, enum kind kind) {
    static unsigned char wanted[SIZE][SIZE][4], got[SIZE][SIZE][4];
    if (!draw(scene, 0, kind, wanted)) {
        assert_int_equal(scene->err.code, SP_ERR_UNSUPPORTED);
        return;
    }
    assert_memory_not_equal(wanted, scene->wanted[0], sizeof wanted);
    plan.resets = 1;
    assert_true(draw(scene, 0, kind, got));
    assert_int_equal(plan.resets, 0);
    assert_memory_equal(got, wanted, sizeof got);
}

static void slab_frames_survive_a_context_loss(void **state) {
    check_loss(*state, SLAB);
}

static void so_do_frames_of_other_layers(void **state) {
    check_loss(*state, WITH_LAYERS);
}

static void a_context_that_cannot_be_bound_is_replaced(void **state) {
    plan.binds = 2;
    check_images(*state);
    assert_int_equal(plan.binds, 0);
    assert_int_equal(warnings, 2);
    assert_non_null(strstr(last_warning, "eglMakeCurrent failed: EGL_CONTEXT_LOST"));
}

static void a_gpu_that_resets_repeatedly_is_replaced(void **state) {
    struct scene *scene = *state;
    unsigned char pixels[SIZE][SIZE][4];
    plan.resets = 3;
    assert_false(
        draw(scene, 0, PLAIN, pixels)); /* the backend was named, so there is no fallback */
    assert_int_equal(scene->err.code, SP_ERR_BACKEND);
    assert_int_equal(warnings, 3);
    /* Calls that need no context still work. */
    sp_renderer_evict(scene->renderer, scene->volumes[0]);
    assert_int_equal(sp_renderer_memory(scene->renderer, scene->volumes[0]), 0);
    check_images(scene);
}

static void without_another_context_the_next_frame_tries_again(void **state) {
    struct scene *scene = *state;
    unsigned char pixels[SIZE][SIZE][4];
    plan.resets = 1;
    plan.contexts = 1000;
    assert_false(draw(scene, 1, PLAIN, pixels));
    assert_int_equal(scene->err.code, SP_ERR_BACKEND);
    assert_non_null(strstr(scene->err.text, "EGL_BAD_ALLOC"));
    assert_false(draw(scene, 1, PLAIN, pixels));
    plan.contexts = 0;
    check_images(scene);
}

/* The view is not at fault if the device is gone, so another backend may take over. */
static void a_device_that_is_gone_counts_as_a_failure(void **state) {
    struct scene *scene = *state;
    unsigned char pixels[SIZE][SIZE][4];
    plan.resets = 1;
    plan.lists = 1000;
    for (unsigned i = 0; i < 2; i++) {
        assert_false(draw(scene, 1, PLAIN, pixels));
        assert_int_equal(scene->err.code, SP_ERR_BACKEND);
    }
    assert_int_equal(warnings, 4); /* three tries, then one per frame */
    plan.lists = 0;
    check_images(scene);
}

/* The last test: the renderer ends without a context. */
static void a_renderer_without_a_context_can_be_destroyed(void **state) {
    struct scene *scene = *state;
    unsigned char pixels[SIZE][SIZE][4];
    plan.resets = 3;
    assert_false(draw(scene, 0, PLAIN, pixels));
    sp_renderer_destroy(&scene->renderer);
    assert_null(eglGetCurrentContext());
}

static bool init_scene(struct scene *scene) {
    static const char *const sources[] = { "demo:phantom?size=16", "demo:vessels?size=20" };
    static const char *const elements[] = { "demo:gaussians?size=8", "demo:torus?size=16" };
    const struct sp_renderer_options options = { .backend = test_gl(), .threads = 1 };
    scene->renderer = sp_renderer_create(&options, &scene->err);
    scene->pool = scene->renderer ? sp_frame_pool_create(0, &scene->err) : NULL;
    bool ok = scene->pool != NULL;
    for (int i = 0; ok && i < 2; i++)
        ok = (scene->volumes[i] = sp_volume_load(sources[i], NULL, &scene->err)) &&
             draw(scene, i, PLAIN, scene->wanted[i]) &&
             (scene->elements[i] = sp_volume_load(elements[i], NULL, &scene->err));
    return ok;
}

int main(void) {
    static struct scene scene;
    sp_log_init(count_warning, NULL, SP_LOG_WARN);
    if (!init_scene(&scene)) {
        printf("skipped: %s\n", scene.err.text);
        return SKIPPED;
    }
    play_the_driver();
#define TEST(name)                                                                                 \
    { #name, name, begin, NULL, &scene }
    const struct CMUnitTest tests[] = {
        TEST(a_reset_costs_no_frame),
        TEST(a_reset_costs_no_frame_in_flight),
        TEST(slab_frames_survive_a_context_loss),
        TEST(so_do_frames_of_other_layers),
        TEST(a_context_that_cannot_be_bound_is_replaced),
        TEST(a_gpu_that_resets_repeatedly_is_replaced),
        TEST(without_another_context_the_next_frame_tries_again),
        TEST(a_device_that_is_gone_counts_as_a_failure),
        TEST(a_renderer_without_a_context_can_be_destroyed),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    sp_renderer_destroy(&scene.renderer);
    sp_frame_pool_destroy(&scene.pool);
    for (int i = 0; i < 2; i++) {
        sp_volume_unref(&scene.volumes[i]);
        sp_volume_unref(&scene.elements[i]);
    }
    return failed;
}
