/* SPDX-License-Identifier: Apache-2.0
 *
 * Synchronisation that a GPU needs. Software GL works without it, because it runs one command after
 * the other. So the test intercepts the calls on their way to the driver and checks three rules:
 *
 *   - a storage barrier stands between a dispatch that writes a buffer and a dispatch that reads it
 *   - a buffer update barrier stands between a dispatch that writes a buffer and a call that reads
 *     or writes the buffer
 *   - the CPU reads a frame only after its fence has passed; fences pass late here
 *
 * The source of a program tells which buffers it reads and writes.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <epoxy/gl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sp/inflight.h"
#include "sp/log.h"
#include "sp/renderer.h"
#include "support/compare.h"
#include "support/data.h"
#include "support/gl.h"

enum { NAMES = 1 << 14, BINDINGS = 9, SLOW = 3 /* waits before a fence passes */ };

/* A shader or a program. */
struct program {
    char *source; /* a program takes that of its shader, whose name another shader may get */
    bool is_known, reads[BINDINGS], writes[BINDINGS], is_coherent[BINDINGS];
};

static struct {
    struct program programs[NAMES];
    GLuint bound[BINDINGS], target[3], program;
    GLuint
        unseen[NAMES];   /* the program that wrote a buffer, without a storage barrier since then */
    GLuint stale[NAMES]; /* the same without a buffer update barrier */
    unsigned dispatches, calls;
    unsigned copies, fenced,
        passed; /* copies made; before the last fence; before a fence that passed */
    GLsync waited;
    unsigned waits; /* for that fence */
    atomic_bool *cancels;
    char fault[256]; /* the first fault */
} watch;

static struct {
    PFNGLSHADERSOURCEPROC shader_source;
    PFNGLATTACHSHADERPROC attach;
    PFNGLUSEPROGRAMPROC use;
    PFNGLDISPATCHCOMPUTEPROC dispatch;
    PFNGLMEMORYBARRIERPROC barrier;
    PFNGLBINDBUFFERBASEPROC bind_base;
    PFNGLBINDBUFFERPROC bind;
    PFNGLDELETEBUFFERSPROC delete_buffers;
    PFNGLCOPYBUFFERSUBDATAPROC copy;
    PFNGLCLEARBUFFERSUBDATAPROC clear;
    PFNGLGETBUFFERSUBDATAPROC get;
    PFNGLBUFFERSUBDATAPROC write;
    PFNGLMAPBUFFERRANGEPROC map;
    PFNGLFENCESYNCPROC fence;
    PFNGLCLIENTWAITSYNCPROC wait;
} real;

static void fault(const char *what, GLuint buffer, GLuint writer) {
    if (!watch.fault[0])
        snprintf(watch.fault, sizeof watch.fault,
                 "%s buffer %u, which program %u wrote, without a barrier (program %u is in use)",
                 what, buffer, writer, watch.program);
}

static void shader_source(GLuint shader, GLsizei count, const GLchar *const *texts,
                          const GLint *lengths) {
    size_t used = 1;
    char *all = calloc(1, 1);
    for (GLsizei i = 0; i < count; i++) {
        used += strlen(texts[i]);
        all = realloc(all, used);
        assert_non_null(all);
        strcat(all, texts[i]);
    }
    assert_compare(shader, <, NAMES);
    free(watch.programs[shader].source);
    watch.programs[shader].source = all;
    real.shader_source(shader, count, texts, lengths);
}

static void attach(GLuint program, GLuint shader) {
    assert_compare(program, <, NAMES);
    free(watch.programs[program].source);
    watch.programs[program].source = watch.programs[shader].source;
    watch.programs[program].is_known = false;
    watch.programs[shader].source = NULL;
    real.attach(program, shader);
}

/* Reads the storage blocks of a program from the driver, and their qualifiers from the source. */
static void learn(GLuint name) {
    struct program *program = &watch.programs[name];
    const char *source = program->source;
    static const GLenum wanted = GL_BUFFER_BINDING;
    GLint blocks = 0;
    glGetProgramInterfaceiv(name, GL_SHADER_STORAGE_BLOCK, GL_ACTIVE_RESOURCES, &blocks);
    assert_true(source);
    assert_compare(blocks, >, 0);
    for (GLuint i = 0; i < (GLuint)blocks; i++) {
        char block[64], text[96];
        GLint at = 0;
        glGetProgramResourceName(name, GL_SHADER_STORAGE_BLOCK, i, sizeof block, NULL, block);
        glGetProgramResourceiv(name, GL_SHADER_STORAGE_BLOCK, i, 1, &wanted, 1, NULL, &at);
        assert_in_range(at, 0, BINDINGS - 1);
        snprintf(text, sizeof text, "buffer %s {", block);
        const char *declared = strstr(source, text);
        assert_non_null(declared);
#define IS(word) (strncmp(declared - sizeof word, word " ", sizeof word) == 0)
        program->reads[at] = !IS("writeonly");
        program->writes[at] = !IS("readonly");
        program->is_coherent[at] = IS("coherent"); /* written by atomic operations */
    }
    program->is_known = true;
}

static void use(GLuint program) {
    watch.program = program;
    real.use(program);
    if (program && !watch.programs[program].is_known)
        learn(program);
}

static void dispatch(GLuint x, GLuint y, GLuint z) {
    const struct program *program = &watch.programs[watch.program];
    watch.dispatches++;
    for (int i = 0; i < BINDINGS; i++) {
        GLuint buffer = watch.bound[i], writer = watch.unseen[buffer];
        bool is_one_pass = program->is_coherent[i] && writer == watch.program;
        if (writer && !is_one_pass && (program->reads[i] || program->writes[i]))
            if (program->reads[i] || writer != watch.program)
                fault("a dispatch takes", buffer, writer);
    }
    for (int i = 0; i < BINDINGS; i++)
        if (program->writes[i])
            watch.unseen[watch.bound[i]] = watch.stale[watch.bound[i]] = watch.program;
    real.dispatch(x, y, z);
}

static void barrier(GLbitfield bits) {
    if (bits & GL_SHADER_STORAGE_BARRIER_BIT)
        memset(watch.unseen, 0, sizeof watch.unseen);
    if (bits & GL_BUFFER_UPDATE_BARRIER_BIT)
        memset(watch.stale, 0, sizeof watch.stale);
    real.barrier(bits);
}

static GLuint *target_of(GLenum target) {
    int i = target == GL_SHADER_STORAGE_BUFFER ? 0 : target == GL_COPY_READ_BUFFER ? 1 : 2;
    assert_true(i < 2 || target == GL_COPY_WRITE_BUFFER);
    return &watch.target[i];
}

static void bind_base(GLenum target, GLuint at, GLuint buffer) {
    if (target == GL_UNIFORM_BUFFER) { /* no shader writes it */
        real.bind_base(target, at, buffer);
        return;
    }
    assert_compare(at, <, BINDINGS);
    assert_compare(buffer, <, NAMES);
    watch.bound[at] = *target_of(target) = buffer;
    real.bind_base(target, at, buffer);
}

static void bind(GLenum target, GLuint buffer) {
    assert_compare(buffer, <, NAMES);
    *target_of(target) = buffer;
    real.bind(target, buffer);
}

static void delete_buffers(GLsizei count, const GLuint *names) {
    for (GLsizei i = 0; i < count; i++) {
        watch.unseen[names[i]] = watch.stale[names[i]] = 0; /* a new buffer may get the same name */
        for (int k = 0; k < BINDINGS; k++)
            watch.bound[k] = watch.bound[k] == names[i] ? 0 : watch.bound[k];
    }
    real.delete_buffers(count, names);
}

static void check_update(const char *what, GLenum target) {
    GLuint buffer = *target_of(target);
    watch.calls++;
    if (watch.stale[buffer])
        fault(what, buffer, watch.stale[buffer]);
}

static void copy(GLenum from, GLenum to, GLintptr a, GLintptr b, GLsizeiptr bytes) {
    check_update("a copy from", from);
    check_update("a copy to", to);
    watch.copies++;
    real.copy(from, to, a, b, bytes);
}

static void clear(GLenum target, GLenum format, GLintptr at, GLsizeiptr bytes, GLenum of,
                  GLenum type, const void *value) {
    check_update("clearing", target);
    real.clear(target, format, at, bytes, of, type, value);
}

static void get(GLenum target, GLintptr at, GLsizeiptr bytes, void *data) {
    check_update("reading", target);
    real.get(target, at, bytes, data);
}

static void write(GLenum target, GLintptr at, GLsizeiptr bytes, const void *data) {
    check_update("writing", target);
    real.write(target, at, bytes, data);
}

static void *map(GLenum target, GLintptr at, GLsizeiptr bytes, GLbitfield access) {
    check_update("mapping", target);
    return real.map(target, at, bytes, access);
}

enum { FENCES = 256 };
static struct {
    GLsync name;
    unsigned copies;
} fences[FENCES]; /* a ring */
static unsigned fence_count;

static GLsync fence(GLenum condition, GLbitfield flags) {
    GLsync name = real.fence(condition, flags);
    fences[fence_count % FENCES].name = name;
    fences[fence_count++ % FENCES].copies = watch.copies;
    return name;
}

/* The fence passes at the last of SLOW waits. */
static GLenum wait(GLsync name, GLbitfield flags, GLuint64 ns) {
    watch.waits = name == watch.waited ? watch.waits + 1 : 1;
    watch.waited = name;
    if (watch.cancels)
        atomic_store(watch.cancels, true);
    if (watch.cancels && watch.waits > 1000)
        return GL_WAIT_FAILED; /* the backend does not check the flag */
    if (watch.cancels || watch.waits < SLOW)
        return GL_TIMEOUT_EXPIRED;
    watch.waited = NULL;
    for (unsigned i = fence_count; i > 0 && fence_count - i < FENCES; i--) {
        if (fences[(i - 1) % FENCES].name != name)
            continue;
        unsigned copies = fences[(i - 1) % FENCES].copies;
        watch.passed = copies > watch.passed ? copies : watch.passed;
        break; /* the newest fence of that name */
    }
    return real.wait(name, flags, ns);
}

/* Call this after a context has existed: until then libepoxy would replace these functions. */
static void watch_calls(void) {
#define WATCH(function, own) (real.own = epoxy_##function, epoxy_##function = own)
    WATCH(glShaderSource, shader_source);
    WATCH(glAttachShader, attach);
    WATCH(glUseProgram, use);
    WATCH(glDispatchCompute, dispatch);
    WATCH(glMemoryBarrier, barrier);
    WATCH(glBindBufferBase, bind_base);
    WATCH(glBindBuffer, bind);
    WATCH(glDeleteBuffers, delete_buffers);
    WATCH(glCopyBufferSubData, copy);
    WATCH(glClearBufferSubData, clear);
    WATCH(glGetBufferSubData, get);
    WATCH(glBufferSubData, write);
    WATCH(glMapBufferRange, map);
    WATCH(glFenceSync, fence);
    WATCH(glClientWaitSync, wait);
}

struct rig {
    struct sp_renderer *renderer;
    struct sp_frame_pool *pool;
    struct sp_volume *volumes[2];
    struct sp_volume *elements[3]; /* of layers of points, Gaussians and geometry */
    struct sp_error err;
};

static struct sp_renderer *create_renderer(struct sp_error *err) {
    const struct sp_renderer_options options = { .backend = test_gl(), .threads = 1 };
    return sp_renderer_create(&options, err);
}

/* Sets the k-th view; the views cover all modes. */
static void make_view(const struct rig *rig, unsigned k, struct sp_view *view) {
    sp_view_init(view, sp_volume_info(rig->volumes[k % 2]), "v");
    view->size[0] = view->size[1] =
        12 + 8 * (k % 3); /* small: the calls are checked, not the image */
    view->compositing.mode = k / 2 % 3;
    view->shading.mode = k / 6 % 2 ? SP_SHADING_PHONG : SP_SHADING_NONE;
    if (view->compositing.mode == SP_COMPOSITE_SLAB && k % 4 < 2) {
        view->transfer_function.order = SP_TF_POST;
        view->filter.mode = SP_FILTER_EWA; /* with the default, slabs are not splatted */
    }
    if (view->compositing.mode == SP_COMPOSITE_SHEET)
        view->transfer_function.order = k % 4 < 2 ? SP_TF_PRE : SP_TF_POST;
    view->level_of_detail = k % 5 ? SP_LOD_AUTO : SP_LOD_OFF;
    if (k > 18) /* another list of visible voxels */
        view->transfer_function.points[1].opacity *= 0.9f;
    for (int a = 0; k % 7 == 3 && a < 3; a++) /* from far away: high mip levels */
        view->camera.position[a] =
            view->camera.target[a] + 20 * (view->camera.position[a] - view->camera.target[a]);
}

static bool begin(struct rig *rig, unsigned k, const struct sp_render_options *options) {
    struct sp_view view;
    make_view(rig, k, &view);
    return sp_renderer_begin(rig->renderer, rig->volumes[k % 2], &view, rig->pool, options,
                             &rig->err);
}

/* Finishes a frame. `copies` were made when it was submitted; the fence must cover all of them. */
static void finish(struct rig *rig, unsigned copies) {
    struct sp_frame *frame = sp_renderer_finish(rig->renderer, &rig->err);
    if (!frame)
        fail_msg("%s", rig->err.text);
    sp_frame_unref(&frame);
    if (watch.fault[0])
        fail_msg("%s", watch.fault);
    if (watch.passed < copies)
        fail_msg("%u of %u copies were waited for", watch.passed, copies);
}

static void frames_one_by_one(void **state) {
    for (unsigned k = 0; k < 36; k++) {
        unsigned before = watch.copies;
        assert_true(begin(*state, k, NULL));
        finish(*state, before + 1);
        assert_int_equal(watch.passed, watch.copies);
    }
    assert_compare(watch.dispatches, >, 36 * 6); /* the calls were intercepted */
    assert_compare(watch.calls, >, 36 * 6);
}

static void frames_in_flight(void **state) {
    struct rig *rig = *state;
    for (unsigned k = 0; k < 36; k++) {
        unsigned copies[2];
        for (unsigned i = 0; i < 2; i++) {
            assert_true(begin(rig, k + i, NULL));
            copies[i] = watch.copies;
        }
        if (k == 20)
            sp_renderer_evict(rig->renderer, rig->volumes[0]);
        finish(rig, copies[0]);
        finish(rig, copies[1]);
    }
}

static struct sp_volume *find_element(void *user, const char *id) {
    const struct rig *rig = user;
    return sp_volume_ref(rig->elements[id[0] - '0']);
}

/* Draws the first `count` of a list of layers. */
static void draw_layers(struct rig *rig, unsigned k, uint32_t count) {
    static const enum sp_layer_type types[] = { SP_LAYER_GEOMETRY,  SP_LAYER_POINTS,
                                                SP_LAYER_GAUSSIANS, SP_LAYER_SHELL,
                                                SP_LAYER_SURFACE,   SP_LAYER_VOLUME };
    const struct sp_render_options options = { .find = find_element, .user = rig };
    const uint32_t first = count == 1 ? k % 4 : 0;
    struct sp_view view;
    make_view(rig, k, &view);
    view.layer_count = count;
    for (uint32_t i = 0; i < count; i++) {
        struct sp_layer *layer = &view.layers[i];
        *layer = sp_layer_default(types[first + i]);
        layer->opacity = layer->type == SP_LAYER_SHELL ? layer->opacity : 0.5f;
        layer->value = layer->type == SP_LAYER_SURFACE ? 60 : layer->value;
        if (layer->type >= SP_LAYER_POINTS)
            layer->id[0] = (char)('0' + (int)layer->type - (int)SP_LAYER_POINTS);
    }
    if (!sp_renderer_begin(rig->renderer, rig->volumes[k % 2], &view, rig->pool, &options,
                           &rig->err))
        fail_msg("%s", rig->err.text);
    finish(rig, watch.copies);
}

static void frames_of_layers(void **state) {
    for (unsigned k = 0; k < 8; k++)
        draw_layers(*state, k, k < 4 ? 1 : 6);
}

static void a_fence_that_does_not_pass_can_be_cancelled(void **state) {
    struct rig *rig = *state;
    atomic_bool cancel = false;
    const struct sp_render_options options = { .cancel = &cancel };
    assert_true(begin(rig, 0, &options));
    watch.cancels = &cancel;
    assert_null(sp_renderer_finish(rig->renderer, &rig->err));
    assert_int_equal(rig->err.code, SP_ERR_CANCELLED);
    watch.cancels = NULL;
    assert_true(begin(rig, 0, NULL));
    finish(rig, watch.copies);
}

static bool open_rig(struct rig *rig) {
    struct sp_renderer *first = create_renderer(&rig->err);
    if (!first)
        return false;
    rig->pool = sp_frame_pool_create(0, &rig->err);
    rig->volumes[0] = sp_volume_load("demo:engine?size=16", NULL, &rig->err);
    rig->volumes[1] = sp_volume_load("demo:phantom?size=16", NULL, &rig->err);
    assert_true(rig->pool);
    assert_true(rig->volumes[0]);
    assert_true(rig->volumes[1]);
    for (int i = 0; i < 3; i++) {
        static const char *const names[] = { "demo:points?size=8", "demo:gaussians?size=8",
                                             "demo:torus?size=16" };
        rig->elements[i] = sp_volume_load(names[i], NULL, &rig->err);
        if (!rig->elements[i])
            fail_msg("%s", rig->err.text);
    }
    rig->renderer = first; /* libepoxy looks up the functions that frames use */
    unsigned kinds = 12;
    for (unsigned k = 0; k < kinds; k++) {
        struct sp_frame *frame = begin(rig, k, NULL) ? sp_renderer_finish(first, &rig->err) : NULL;
        assert_non_null(frame);
        sp_frame_unref(&frame);
    }
    sp_renderer_destroy(&first);
    watch_calls();
    rig->renderer = create_renderer(&rig->err);
    assert_non_null(rig->renderer);
    return true;
}

int main(void) {
    static struct rig rig;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    if (!open_rig(&rig)) {
        printf("skipped: %s\n", rig.err.text);
        return TEST_SKIPPED;
    }
#define TEST(name)                                                                                 \
    { #name, name, NULL, NULL, &rig }
    const struct CMUnitTest tests[] = {
        TEST(frames_one_by_one),
        TEST(frames_in_flight),
        TEST(frames_of_layers),
        TEST(a_fence_that_does_not_pass_can_be_cancelled),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    sp_renderer_destroy(&rig.renderer);
    sp_frame_pool_destroy(&rig.pool);
    for (int i = 0; i < 2; i++)
        sp_volume_unref(&rig.volumes[i]);
    for (int i = 0; i < 3; i++)
        sp_volume_unref(&rig.elements[i]);
    for (int i = 0; i < NAMES; i++)
        free(watch.programs[i].source);
    return failed;
}
