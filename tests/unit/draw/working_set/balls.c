/* SPDX-License-Identifier: Apache-2.0 */
#include "unit/draw/working_set/balls.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#include "data/bricks/write.h"
#include "data/volume/sample.h"

/* Balls in noise that the transfer function leaves out. Nothing is 0, so that empty bricks have
 * another value. */
static double field_at(uint32_t x, uint32_t y, uint32_t z) {
    static const double balls[2][4] = { { 40, 40, 35, 26 }, { 300, 175, 112, 30 } };
    double value = 8 + (x * 7 + y * 13 + z * 29) % 5;
    for (int i = 0; i < 2; i++) {
        const double dx = x - balls[i][0], dy = y - balls[i][1], dz = z - balls[i][2];
        const double inside = 0.5 + (balls[i][3] - sqrt(dx * dx + dy * dy + dz * dz)) / 4;
        value = fmax(value, 200 * fmin(fmax(inside, 0), 1));
    }
    return value;
}

void balls_make(struct rig *rig, enum sp_type type) {
    struct sp_error err;
    const size_t size = sp_type_size(type);
    rig->info = (struct sp_volume_info){ .grid = { .dims = { WIDE, HIGH, DEEP },
                                                   .spacing = { 1, 1, 1.25 },
                                                   .origin = { 3, -5, 7 },
                                                   .direction = { { 1 }, { 0, 1 }, { 0, 0, 1 } } },
                                         .type = type };
    rig->samples = malloc(SAMPLES * size);
    assert_non_null(rig->samples);
    for (uint32_t i = 0; i < SAMPLES; i++)
        sp_sample_set(rig->samples, type, i,
                      rint(field_at(i % WIDE, i / WIDE % HIGH, i / WIDE / HIGH)));
    rig->whole = sp_volume_create(&rig->info.grid, type, rig->samples, "whole", &err);
    assert_non_null(rig->whole);
    int from = memfd_create("samples", MFD_CLOEXEC);
    rig->file = memfd_create("bricks", MFD_CLOEXEC);
    assert_int_equal(write(from, rig->samples, SAMPLES * size), SAMPLES * size);
    const struct sp_bricks_write_job job = {
        .info = &rig->info, .samples = from, .out = rig->file, .folder = "/tmp", .title = "test"
    };
    if (!sp_bricks_write(&job, &err))
        fail_msg("%s", err.text);
    close(from);
}

void balls_finish(struct rig *rig) {
    sp_volume_unref(&rig->whole);
    free(rig->samples);
    close(rig->file);
}

int balls_setup(void **state) {
    static struct rig rig;
    struct sp_error err;
    const struct test_target target = { "cpu", "auto" };
    if (!test_renderer_open(&rig.renderer, &target, 2, &err))
        fail_msg("%s", err.text);
    *state = &rig;
    return 0;
}

int balls_teardown(void **state) {
    struct rig *rig = *state;
    test_renderer_close(&rig->renderer);
    return 0;
}

struct sp_view balls_view(const struct rig *rig) {
    struct sp_view view = rig_make_view(rig);
    view.level_of_detail = SP_LOD_OFF;
    return view;
}
