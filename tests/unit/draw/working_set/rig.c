/* SPDX-License-Identifier: Apache-2.0 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "data/bricks/store.h"
#include "data/bricks/write.h"
#include "data/volume/volume.h"
#include "sp/bricks.h"
#include "support/compare.h"
#include "unit/draw/working_set/rig.h"

/* Balls of several sizes in noise that a transfer function may leave out. */
static uint8_t field_at(uint32_t x, uint32_t y, uint32_t z) {
    static const double balls[][4] = { { 50, 40, 40, 26 },
                                       { 120, 90, 60, 34 },
                                       { 180, 40, 90, 20 },
                                       { 30, 120, 100, 18 },
                                       { 190, 130, 20, 9 } };
    double value = 8 + (x * 7 + y * 13 + z * 29) % 5;
    for (size_t i = 0; i < sizeof balls / sizeof *balls; i++) {
        double dx = x - balls[i][0], dy = y - balls[i][1], dz = z - balls[i][2];
        double inside = 0.5 + (balls[i][3] - sqrt(dx * dx + dy * dy + dz * dz)) / 4;
        value = fmax(value, 200 * fmin(fmax(inside, 0), 1));
    }
    return (uint8_t)lrint(value);
}

/* Axes whose gaps differ by a factor of five. */
static void grade(struct rig *rig) {
    double *next = rig->coordinates;
    for (int a = 0; a < 3; a++) {
        const uint32_t n = rig->info.grid.dims[a];
        next[0] = 0;
        for (uint32_t i = 1; i < n; i++)
            next[i] = next[i - 1] + rig->info.grid.spacing[a] * (1 + 0.67 * sin(i / 12.0 + a));
        rig->info.grid.coordinates[a] = next;
        rig->info.grid.spacing[a] = next[n - 1] / (n - 1);
        next += n;
    }
}

/* A vortex, so that no two samples have the same direction. */
static void blow(struct rig *rig) {
    rig->vectors = malloc(COUNT * sizeof *rig->vectors);
    assert_non_null(rig->vectors);
    for (uint32_t i = 0; i < COUNT; i++) {
        const float x = (float)(i % NX) - NX / 2, y = (float)(i / NX % NY) - NY / 2;
        const float vector[3] = { -y, x, 0.3f * (float)(i / NX / NY) };
        memcpy(rig->vectors[i], vector, sizeof vector);
    }
}

/* The samples and vectors, as sp_bricks_write() reads them. */
static int write_samples(const struct rig *rig) {
    const int file = memfd_create("samples", MFD_CLOEXEC);
    uint64_t vectors_at;
    sp_volume_layout(COUNT, COUNT, rig->vectors, &vectors_at);
    assert_int_equal(pwrite(file, rig->samples, COUNT, 0), COUNT);
    if (rig->vectors)
        assert_int_equal(
            pwrite(file, rig->vectors, COUNT * sizeof *rig->vectors, (off_t)vectors_at),
            COUNT * sizeof *rig->vectors);
    return file;
}

static int set_up(void **state, bool is_rectilinear, bool has_vectors) {
    static struct rig rig;
    struct sp_error err;
    const struct test_target target = { "cpu", "auto" };
    rig.samples = malloc(COUNT);
    assert_non_null(rig.samples);
    for (uint32_t i = 0; i < COUNT; i++)
        rig.samples[i] = field_at(i % NX, i / NX % NY, i / NX / NY);
    rig.info = (struct sp_volume_info){ .grid = { .dims = { NX, NY, NZ },
                                                  .spacing = { 1, 1, 1.5 },
                                                  .origin = { -20, 5, 7 },
                                                  .direction = { { 1 }, { 0, 1 }, { 0, 0, 1 } } },
                                        .type = SP_UINT8,
                                        .vector_bytes = has_vectors,
                                        .vector_name = "vortex" };
    if (is_rectilinear)
        grade(&rig);
    if (has_vectors)
        blow(&rig);
    rig.whole = has_vectors
                    ? sp_volume_create_vectors(&rig.info.grid, SP_UINT8, rig.samples,
                                               (const float(*)[3])rig.vectors, "whole", &err)
                    : sp_volume_create(&rig.info.grid, SP_UINT8, rig.samples, "whole", &err);
    if (!rig.whole)
        fail_msg("%s", err.text);
    if (!test_renderer_open(&rig.renderer, &target, 2, &err))
        fail_msg("%s", err.text);
    const int from = write_samples(&rig);
    rig.file = memfd_create("bricks", MFD_CLOEXEC);
    const struct sp_bricks_write_job job = {
        .info = &rig.info, .samples = from, .out = rig.file, .folder = "/tmp", .title = "test"
    };
    if (!sp_bricks_write(&job, &err))
        fail_msg("%s", err.text);
    close(from);
    *state = &rig;
    return 0;
}

int rig_setup(void **state) {
    return set_up(state, false, false);
}

int rig_setup_rectilinear(void **state) {
    return set_up(state, true, false);
}

int rig_setup_vectors(void **state) {
    return set_up(state, false, true);
}

int rig_teardown(void **state) {
    struct rig *rig = *state;
    sp_volume_unref(&rig->whole);
    test_renderer_close(&rig->renderer);
    free(rig->samples);
    free(rig->vectors);
    rig->vectors = NULL;
    close(rig->file);
    return 0;
}

struct sp_volume *rig_open_file(const struct rig *rig, uint64_t bytes) {
    struct sp_error err;
    const struct sp_load_options options = { .subvolume_bytes = bytes };
    struct sp_volume *volume =
        sp_brick_store_open(dup(rig->file), "bricks", "bricks", &options, &err);
    if (!volume)
        fail_msg("%s", err.text);
    return volume;
}

struct sp_view rig_make_view(const struct rig *rig) {
    struct sp_view view;
    sp_view_init(&view, sp_volume_info(rig->whole), "v");
    view.shading.smoothing = 0; /* by default it depends on noise, which brick files do not tell */
    view.size[0] = view.size[1] = SIDE;
    view.transfer_function.point_count = 3;
    memset(view.transfer_function.points, 0, sizeof view.transfer_function.points);
    view.transfer_function.points[0].value = 40;
    view.transfer_function.points[1] =
        (struct sp_tf_point){ .value = 120, .color = { 0.9f, 0.5f, 0.2f }, .opacity = 0.1f };
    view.transfer_function.points[2] =
        (struct sp_tf_point){ .value = 200, .color = { 0.8f, 0.9f, 1 }, .opacity = 0.5f };
    view.transfer_function.reference_length = 1;
    view.transfer_function.order = SP_TF_POST;
    return view;
}

void rig_zoom(struct sp_view *view, double by) {
    struct sp_camera *c = &view->camera;
    for (int a = 0; a < 3; a++)
        c->position[a] = c->target[a] + (c->position[a] - c->target[a]) / by;
}

struct sp_frame *rig_render_level(const struct rig *rig, struct sp_volume *volume,
                                  const struct sp_view *view, double wait_ms, unsigned level) {
    struct sp_error err;
    const struct sp_render_options options = { .format = SP_RGBAF32,
                                               .wait_ms = wait_ms,
                                               .mip_level = level };
    struct sp_frame *frame = sp_renderer_render(rig->renderer.renderer, volume, view,
                                                rig->renderer.pool, &options, &err);
    if (!frame)
        fail_msg("%s: %s", err.place, err.text);
    return frame;
}

struct sp_frame *rig_render(const struct rig *rig, struct sp_volume *volume,
                            const struct sp_view *view, double wait_ms) {
    return rig_render_level(rig, volume, view, wait_ms, 0);
}

double rig_compare(const struct sp_frame *a, const struct sp_frame *b) {
    double sum = 0;
    assert_int_equal(a->width, b->width);
    for (uint32_t y = 0; y < a->height; y++) {
        const float *p = (const void *)((const char *)a->pixels + y * a->stride_bytes);
        const float *q = (const void *)((const char *)b->pixels + y * b->stride_bytes);
        for (uint32_t i = 0; i < 4 * a->width; i++)
            sum += ((double)p[i] - (double)q[i]) * ((double)p[i] - (double)q[i]);
    }
    return sum > 0 ? -10 * log10(sum / (4.0 * a->width * a->height)) : 200;
}

double rig_mean_of(const struct sp_frame *frame) {
    double sum = 0;
    for (uint32_t y = 0; y < frame->height; y++)
        for (uint32_t x = 0; x < frame->width; x++)
            sum += (double)((const float *)(const void *)((const char *)frame->pixels +
                                                          y * frame->stride_bytes))[4 * x];
    return sum / frame->width / frame->height;
}

void rig_expect(const struct rig *rig, struct sp_volume *volume, const struct sp_view *view,
                double floor_db, const char *what) {
    struct sp_frame *got = rig_render(rig, volume, view, 0);
    struct sp_frame *truth = rig_render_level(rig, rig->whole, view, 0, got->stats.bricks.level);
    const double db = rig_compare(truth, got);
    assert_compare(rig_mean_of(truth), >, 1e-4);
    assert_false(got->stats.bricks.is_incomplete);
    assert_int_equal(got->stats.bricks.resident, got->stats.bricks.wanted);
    print_message("%s: %.1f dB, level %u, %u bricks\n", what, db, got->stats.bricks.level,
                  (unsigned)got->stats.bricks.wanted);
    if (db < floor_db)
        fail_msg("%s: %.1f dB, floor %.1f", what, db, floor_db);
    sp_frame_unref(&truth);
    sp_frame_unref(&got);
}
