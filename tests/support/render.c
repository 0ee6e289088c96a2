/* SPDX-License-Identifier: Apache-2.0 */
#include "support/render.h"

#include <stdio.h>
#include <string.h>

#include "backend/cpu/kernels.h"
#include "support/sanitized.h"

/* Returns the i-th instruction set of the CPU backend. Under a sanitizer there are only the
 * reference and the best one of this machine, which are the same with ThreadSanitizer
 * (renderer/kernels.cmake). */
static const char *isa_at(unsigned i) {
    if (TEST_SANITIZED)
        return i == 0 ? "scalar" : i == 1 && !TEST_TSAN ? "auto" : NULL;
    return cpu_isa_at(i);
}

/* Under a sanitizer, only the unit tests run the GL backend: software GL is slow, and the code that
 * it compiles has no instrumentation. */
static bool is_left_out(const char *backend) {
    return strcmp(backend, "null") == 0 || strcmp(backend, "cpu") == 0 || TEST_SANITIZED;
}

bool test_target_at(unsigned i, struct test_target *target) {
    const struct sp_backend_entry *entry;
    unsigned sets = 0;
    while (isa_at(sets))
        sets++;
    if (i < sets) {
        *target = (struct test_target){ "cpu", isa_at(i) };
        return true;
    }
    i -= sets;
    for (unsigned b = 0; (entry = sp_backend_at(b)); b++) {
        if (is_left_out(entry->name) || i-- > 0)
            continue;
        *target = (struct test_target){ entry->name, "auto" };
        return true;
    }
    return false;
}

bool test_renderer_open(struct test_renderer *r, const struct test_target *target, unsigned threads,
                        struct sp_error *err) {
    struct sp_renderer_options options = { .backend = target->backend,
                                           .isa = target->isa,
                                           .threads = threads };
    struct sp_renderer_info info;
    *r = (struct test_renderer){ .renderer = sp_renderer_create(&options, err) };
    if (!r->renderer)
        return false;
    sp_renderer_info(r->renderer, &info);
    bool same = strcmp(target->isa, "auto") == 0 || strcmp(target->isa, info.isa) == 0;
    if (!same)
        sp_fail(err, SP_ERR_UNSUPPORTED, "", "requested instruction set %s, the renderer uses %s",
                target->isa, info.isa);
    else
        r->pool = sp_frame_pool_create((size_t)64 << 20, err);
    if (!r->pool)
        test_renderer_close(r);
    return r->renderer != NULL;
}

void test_renderer_close(struct test_renderer *r) {
    sp_renderer_destroy(&r->renderer);
    if (r->pool)
        sp_frame_pool_destroy(&r->pool);
}

unsigned test_check_targets(unsigned threads, test_target_check_fn *check) {
    struct test_target target;
    unsigned failed = 0;
    for (unsigned t = 0; test_target_at(t, &target); t++) {
        struct test_renderer renderer;
        struct sp_error err;
        if (!test_renderer_open(&renderer, &target, threads, &err)) {
            printf("skipped: %s %s: %s\n", target.backend, target.isa, err.text);
            continue;
        }
        failed += check(&target, &renderer);
        test_renderer_close(&renderer);
    }
    return failed;
}

bool test_render(const struct test_renderer *r, struct sp_volume *volume,
                 const struct sp_view *view, struct test_image *image, struct sp_error *err) {
    struct sp_render_options options = { .format = SP_RGBAF32 };
    struct sp_frame *frame = sp_renderer_render(r->renderer, volume, view, r->pool, &options, err);
    if (!frame)
        return false;
    bool ok = test_image_from_frame(image, frame);
    sp_frame_unref(&frame);
    return ok || sp_fail(err, SP_ERR_MEMORY, "", "a test image");
}

bool test_render_scene(const struct test_renderer *r, const struct test_scene *scene,
                       struct test_image *image, struct sp_error *err) {
    struct sp_volume *volume = test_scene_volume(scene, err);
    if (!volume)
        return false;
    bool ok = test_render(r, volume, &scene->view, image, err);
    sp_renderer_evict(r->renderer, volume);
    sp_volume_unref(&volume);
    return ok;
}

bool test_uses_postconv(const struct test_target *target, const struct test_scene *scene) {
    struct cpu_kernels kernels;
    struct sp_error err;
    return strcmp(target->backend, "cpu") == 0 && cpu_kernels_init(&kernels, target->isa, &err) &&
           kernels.has_fast_path && sp_postconv_can_draw(&scene->view, &scene->info.grid);
}

bool test_frames_equal(const struct sp_frame *a, const struct sp_frame *b) {
    if (a->width != b->width || a->height != b->height || a->format != b->format)
        return false;
    size_t row = (size_t)a->width * (a->format == SP_RGBAF32 ? 16 : 4);
    for (uint32_t y = 0; y < a->height; y++)
        if (memcmp((const char *)a->pixels + y * a->stride_bytes,
                   (const char *)b->pixels + y * b->stride_bytes, row) != 0)
            return false;
    return true;
}
