/* SPDX-License-Identifier: Apache-2.0 */
#include "unit/backend/rig.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct sp_volume *rig_make_ball(uint32_t n, const double spacing[3]) {
    struct sp_grid grid = { .dims = { n, n, n },
                            .spacing = { spacing[0], spacing[1], spacing[2] },
                            .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    uint16_t *values = malloc((size_t)n * n * n * sizeof *values);
    double half = (n - 1) / 2.0;
    for (uint32_t i = 0; i < n * n * n; i++) {
        double x = i % n - half, y = i / n % n - half, z = i / n / n - half;
        double r = sqrt(x * x + y * y + z * z) / fmax(half, 0.5);
        values[i] = (uint16_t)(r < 1 ? 1000 * (1 - r) : 0);
    }
    struct sp_volume *v = sp_volume_create(&grid, SP_UINT16, values, "ball", NULL);
    assert_non_null(v);
    free(values);
    return v;
}

struct sp_volume *rig_make_voxel(void) {
    const struct sp_grid grid = { .dims = { 1, 1, 1 },
                                  .spacing = { 1, 1, 1 },
                                  .direction = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } } };
    struct sp_volume *v = sp_volume_create(&grid, SP_FLOAT32, &(float){ 1 }, "voxel", NULL);
    assert_non_null(v);
    return v;
}

struct rig rig_make(const char *backend, unsigned threads, struct sp_volume *volume) {
    struct sp_error err;
    struct rig rig = { .volume = volume, .pool = sp_frame_pool_create(1 << 26, NULL) };
    rig.renderer = sp_renderer_create(
        &(struct sp_renderer_options){ .backend = backend, .threads = threads }, &err);
    if (!rig.renderer)
        fail_msg("%s", err.text);
    sp_view_init(&rig.view, sp_volume_info(volume), "v");
    rig.view.size[0] = 100;
    rig.view.size[1] = 75;
    rig.view.transfer_function = (struct sp_transfer_function){
        .reference_length = 1,
        .point_count = 2,
        .points = { { 1, { 1, 0.5f, 0.2f }, 0 }, { 900, { 0.2f, 0.6f, 1 }, 0.3f } },
    };
    return rig;
}

void rig_finish(struct rig *rig) {
    sp_renderer_destroy(&rig->renderer);
    sp_frame_pool_destroy(&rig->pool);
    sp_volume_unref(&rig->volume);
}

struct sp_frame *rig_draw(struct rig *rig, enum sp_pixel_format format) {
    struct sp_error err;
    struct sp_render_options options = { .format = format };
    struct sp_frame *frame =
        sp_renderer_render(rig->renderer, rig->volume, &rig->view, rig->pool, &options, &err);
    if (!frame)
        fail_msg("%s: %s", err.place, err.text);
    return frame;
}

bool rig_is_same(const struct sp_frame *a, const struct sp_frame *b) {
    size_t row = a->width * (size_t)(a->format == SP_RGBAF32 ? 16 : 4);
    for (uint32_t y = 0; y < a->height; y++)
        if (memcmp((char *)a->pixels + y * a->stride_bytes, (char *)b->pixels + y * b->stride_bytes,
                   row) != 0)
            return false;
    return true;
}

const float *rig_pixel(const struct sp_frame *f, uint32_t x, uint32_t y) {
    return (const float *)(const void *)((char *)f->pixels + y * f->stride_bytes) + 4 * (size_t)x;
}

double rig_check_finite(const struct sp_frame *f) {
    double sum = 0;
    unsigned bad = 0;
    for (uint32_t y = 0; y < f->height; y++)
        for (uint32_t x = 0; x < f->width; x++) {
            const float *p = rig_pixel(f, x, y);
            bad += !(isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]) && p[3] >= 0 &&
                     p[3] <= 1.000001f);
            sum += (double)p[0];
        }
    assert_int_equal(bad, 0);
    return sum;
}
