/* SPDX-License-Identifier: Apache-2.0
 *
 * A driver that does not compile one of the shaders. The test appends an invalid line to the
 * source; the real driver writes the log and refuses the shader. Runs on software GL.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <epoxy/gl.h>
#include <stdio.h>
#include <string.h>

#include "backend/backend.h"
#include "sp/log.h"
#include "support/compare.h"
#include "support/data.h"
#include "support/gl.h"

static struct {
    const char *broken; /* what the sources of a shader that does not compile contain */
    PFNGLSHADERSOURCEPROC real;
    unsigned shaders; /* shaders that the driver got */
    unsigned lines;   /* log lines about errors */
    bool has_first, has_last;
} driver;

static void shader_source(GLuint shader, GLsizei count, const GLchar *const *texts,
                          const GLint *lengths) {
    const GLchar *given[16];
    bool is_broken = false;
    assert_compare(count, <, 16);
    assert_true(!lengths);
    for (GLsizei i = 0; i < count; i++) {
        given[i] = texts[i];
        is_broken = is_broken || (driver.broken && strstr(texts[i], driver.broken));
    }
    given[count] = "void one() { no_such_thing = 1; }\nvoid two() { nor_this = 2; }\n";
    driver.shaders++;
    driver.real(shader, count + is_broken, given, NULL);
}

static void check_line(void *user, enum sp_log_level level, const char *kind,
                       const struct sp_log_field *fields, const char *line) {
    (void)kind;
    (void)fields;
    (void)user;
    driver.lines += level == SP_LOG_ERROR;
    driver.has_first = driver.has_first || strstr(line, "no_such_thing");
    driver.has_last = driver.has_last || strstr(line, "nor_this");
}

struct rig {
    const struct sp_backend *backend;
    void *state;
    struct sp_frame_pool *pool;
    struct sp_volume *volume;
    struct sp_view view;
};

static struct sp_backend_job make_job(struct rig *rig, enum sp_compositing mode) {
    rig->view.compositing.mode = mode;
    struct sp_frame *frame = sp_frame_create(rig->pool, 24, 24, SP_RGBA8, NULL);
    assert_non_null(frame);
    return (struct sp_backend_job){ .volume = rig->volume, .view = &rig->view, .frame = frame };
}

static enum sp_code draw(struct rig *rig, enum sp_compositing mode, struct sp_error *err) {
    struct sp_backend_job job = make_job(rig, mode);
    bool ok = rig->backend->render(rig->state, &job, err);
    sp_frame_unref(&job.frame);
    return ok ? SP_OK : err->code;
}

static int begin(void **state) {
    (void)state;
    driver.broken = NULL;
    driver.shaders = driver.lines = 0;
    driver.has_first = driver.has_last = false;
    return 0;
}

static void a_compositor_that_does_not_compile_disables_only_its_views(void **state) {
    struct rig *rig = *state;
    struct sp_error err = { .code = SP_OK };
    driver.broken = "#define COMPOSITING 2u";
    for (int i = 0; i < 3; i++) {
        assert_int_equal(draw(rig, SP_COMPOSITE_SLAB, &err), SP_ERR_UNSUPPORTED);
        assert_non_null(strstr(err.text, "has no program for this view"));
        assert_int_equal(draw(rig, SP_COMPOSITE_SHEET, &err), SP_OK);
    }
    assert_int_equal(driver.shaders, 1); /* the shader is not compiled again */
    assert_true(driver.has_first);       /* the log of the driver is complete */
    assert_true(driver.has_last);
    assert_compare(driver.lines, >=, 3);
}

static void the_same_holds_for_interpolated_values(void **state) {
    struct rig *rig = *state;
    struct sp_error err = { .code = SP_OK };
    driver.broken = "#define SAMPLES_INTEGER";
    for (int i = 0; i < 2; i++) {
        rig->view.transfer_function.order = SP_TF_POST;
        assert_int_equal(draw(rig, SP_COMPOSITE_SHEET, &err), SP_ERR_UNSUPPORTED);
        assert_non_null(strstr(err.text, "has no program for this view"));
        rig->view.transfer_function.order = SP_TF_PRE;
        assert_int_equal(draw(rig, SP_COMPOSITE_SHEET, &err), SP_OK);
    }
    assert_int_equal(driver.shaders, 1);
    assert_true(driver.has_last);
}

static void another_frame_in_flight_is_not_lost(void **state) {
    struct rig *rig = *state;
    struct sp_error err;
    driver.broken = "#define COMPOSITING 0u";
    struct sp_backend_job good = make_job(rig, SP_COMPOSITE_SHEET);
    struct sp_view sheet = rig->view;
    good.view = &sheet;
    assert_true(rig->backend->begin(rig->state, &good, &err));
    struct sp_backend_job bad = make_job(rig, SP_COMPOSITE_SPLAT);
    assert_false(rig->backend->begin(rig->state, &bad, &err));
    assert_int_equal(err.code, SP_ERR_UNSUPPORTED);
    assert_true(rig->backend->finish(rig->state, &good, &err));
    sp_frame_unref(&good.frame);
    sp_frame_unref(&bad.frame);
}

static const struct sp_backend_options options = {
    .threads = 1, .memory_bytes = (uint64_t)1 << 30, .isa = "auto", .gpu = -1
};

static void a_shader_that_all_views_need_fails_the_start(void **state) {
    struct rig *rig = *state;
    struct sp_error err;
    driver.broken = "#define COMPOSITING 1u";
    assert_null(rig->backend->create(&options, &err));
    assert_int_equal(err.code, SP_ERR_BACKEND);
    assert_non_null(strstr(err.text, "shader composite does not compile"));
    assert_true(driver.has_first);
    assert_true(driver.has_last);
}

static bool open_rig(struct rig *rig, struct sp_error *err) {
    rig->backend = test_backend(test_gl());
    if (!(rig->state = rig->backend->create(&options, err)))
        return false;
    rig->pool = sp_frame_pool_create(0, err);
    rig->volume = sp_volume_load("demo:phantom?size=16", NULL, err);
    assert_true(rig->pool);
    assert_true(rig->volume);
    sp_view_init(&rig->view, sp_volume_info(rig->volume), "v");
    rig->view.size[0] = rig->view.size[1] = 24;
    /* Call this after libepoxy has looked up its functions. */
    driver.real = epoxy_glShaderSource;
    epoxy_glShaderSource = shader_source;
    return true;
}

int main(void) {
    static struct rig rig;
    struct sp_error err;
    sp_log_init(check_line, NULL, SP_LOG_ERROR);
    if (!open_rig(&rig, &err)) {
        printf("skipped: no software GL here: %s\n", err.text);
        return TEST_SKIPPED;
    }
#define TEST(name)                                                                                 \
    { #name, name, begin, NULL, &rig }
    const struct CMUnitTest tests[] = {
        TEST(a_compositor_that_does_not_compile_disables_only_its_views),
        TEST(the_same_holds_for_interpolated_values),
        TEST(another_frame_in_flight_is_not_lost),
        TEST(a_shader_that_all_views_need_fails_the_start),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    rig.backend->destroy(rig.state);
    sp_volume_unref(&rig.volume);
    sp_frame_pool_destroy(&rig.pool);
    return failed;
}
