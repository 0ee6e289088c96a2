/* SPDX-License-Identifier: Apache-2.0
 *
 * Images with ambient occlusion and shadows: each instruction set against the scalar reference, any
 * number of threads, and nothing of either at strength 0. The field of light itself is compared
 * with rays by unit.light.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "sp/log.h"
#include "support/render.h"
#include "support/sanitized.h"

static const struct {
    const char *name;
    test_scene_fn *scene;
} scenes[] = { { "lit shell", test_scene_lit_shell },
               { "post lit", test_scene_post_lit },
               { "sheared", test_scene_sheared },
               { "rectilinear blobs", test_scene_rectilinear_blobs },
               { "clip corner", test_scene_clip_corner },
               { "gradient axis", test_scene_gradient_axis } };

static bool draw(const struct test_target *target, unsigned threads, const struct test_scene *scene,
                 struct test_image *image) {
    struct test_renderer r;
    struct sp_error err = { 0 };
    if (!test_renderer_open(&r, target, threads, &err))
        return false;
    bool ok = test_render_scene(&r, scene, image, &err);
    if (!ok)
        printf("  %s: %s\n", target->isa, err.text);
    test_renderer_close(&r);
    return ok;
}

static bool check(const char *name, test_scene_fn *make) {
    struct test_scene scene;
    struct test_target target;
    struct test_image scalar, image;
    bool is_good = true;
    if (!make(&scene) || !test_target_at(0, &target))
        return false;
    struct sp_shading *shading = &scene.view.shading;
    scene.view.compositing.mode = SP_COMPOSITE_SHEET;
    scene.view.transfer_function.order = SP_TF_POST;
    shading->mode = SP_SHADING_PHONG;
    shading->ambient = 0.25;
    shading->diffuse = 0.8;
    if (shading->light_count == 0)
        shading->lights[shading->light_count++] =
            (struct sp_light){ { 0.3, 0.9, 0.3 }, SP_LIGHT_CAMERA, { 1, 1, 1 } };
    const double strengths[3][2] = { { 0, 0 }, { 0.7, 1 }, { 0, 1 } };
    struct test_image first = { 0 };
    for (int s = 0; s < 3; s++) {
        shading->occlusion = strengths[s][0];
        shading->shadow = strengths[s][1];
        if (!draw(&target, 1, &scene, &scalar))
            return false;
        double changed = s ? test_image_psnr(&scalar, &first) : INFINITY;
        printf("%-18s occlusion %.1f, shadow %.1f: %.0f dB to none;", name, shading->occlusion,
               shading->shadow, changed);
        is_good = is_good && (s == 0 || changed < 60);
        struct test_target other;
        for (unsigned t = 1; test_target_at(t, &other) && !strcmp(other.backend, "cpu"); t++) {
            if (!draw(&other, t + 1, &scene, &image))
                continue;
            double same = test_image_psnr(&image, &scalar);
            printf(" %s %.0f", other.isa, same);
            is_good = is_good && same >= 70;
            test_image_finish(&image);
        }
        printf("%s\n", is_good ? "" : " FAILED");
        if (s)
            test_image_finish(&scalar);
        else
            first = scalar;
    }
    test_image_finish(&first);
    test_scene_finish(&scene);
    return is_good;
}

int main(void) {
    unsigned failed = 0;
    sp_log_init(NULL, NULL, SP_LOG_ERROR);
    printf("PSNR [dB] to the image without light, and to the scalar reference\n");
    for (size_t i = 0; i < sizeof scenes / sizeof scenes[0]; i++)
        failed += !check(scenes[i].name, scenes[i].scene);
    return failed > 0;
}
