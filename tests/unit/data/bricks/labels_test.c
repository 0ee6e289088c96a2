/* SPDX-License-Identifier: Apache-2.0
 *
 * Brick files of labels: what they mean stays, and coarser levels have no other labels.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <sys/mman.h>
#include <unistd.h>

#include "data/bricks/file.h"
#include "data/bricks/write.h"
#include "data/volume/majority.h"

enum { NX = 131, NY = 3, NZ = 2, COUNT = NX * NY * NZ };

static int memory_file(const void *bytes, size_t size) {
    const int fd = memfd_create("labels", MFD_CLOEXEC);
    assert_int_equal(write(fd, bytes, size), (ssize_t)size);
    return fd;
}

static struct sp_brick_file *write_labels(const uint8_t *samples, enum sp_meaning meaning) {
    const struct sp_volume_info info = { .grid = { .dims = { NX, NY, NZ },
                                                   .spacing = { 1, 1, 1 },
                                                   .direction = { { 1 }, { 0, 1 }, { 0, 0, 1 } } },
                                         .vertical = { -0.25, "hPa" },
                                         .meaning = meaning };
    const int from = memory_file(samples, COUNT);
    const struct sp_bricks_write_job job = {
        .info = &info, .samples = from, .out = memory_file("", 0), .folder = "/tmp", .title = "test"
    };
    struct sp_error err = { .text = "" };
    if (!sp_bricks_write(&job, &err))
        fail_msg("%s", err.text);
    close(from);
    struct sp_brick_file *file = sp_brick_file_open(job.out, "test", &err);
    if (!file)
        fail_msg("%s", err.text);
    return file;
}

static void labels_are_not_averaged(void **state) {
    (void)state;
    static const uint8_t kinds[3] = { 0, 1, 9 };
    uint8_t samples[COUNT], coarse[64 * 64 * 64] = { 0 };
    double most[8];
    struct sp_error err;
    for (uint32_t i = 0; i < COUNT; i++)
        samples[i] = kinds[(i * 7 + i / 5) % 3];
    struct sp_brick_file *file = write_labels(samples, SP_MEANING_LABELS);
    const struct sp_volume_info *info = &sp_brick_file_header(file)->info;
    assert_int_equal(info->meaning, SP_MEANING_LABELS);
    assert_true(info->vertical.per_unit == -0.25);
    assert_string_equal(info->vertical.unit, "hPa");
    struct sp_brick_scratch *scratch = sp_brick_scratch_create(&err);
    assert_non_null(scratch);
    assert_true(sp_brick_file_read(file, 1, 0, scratch, coarse, &err));
    sp_brick_scratch_destroy(&scratch);
    for (uint32_t i = 0; i < 64 * 2; i++)
        assert_true(coarse[i] == 0 || coarse[i] == 1 || coarse[i] == 9);
    for (uint32_t k = 0; k < 8; k++)
        most[k] = samples[(k & 1) + NX * ((k >> 1 & 1) + NY * (k >> 2))];
    assert_int_equal(coarse[0], (int)sp_majority(most, 8));
    sp_brick_file_close(&file);
}

static void the_most_frequent_label_wins(void **state) {
    (void)state;
    assert_float_equal(sp_majority((const double[]){ 3, 7, 7, 3, 7 }, 5), 7, 0);
    assert_float_equal(sp_majority((const double[]){ 3, 7, 7, 3 }, 4), 3, 0);
    assert_float_equal(sp_majority((const double[]){ 5 }, 1), 5, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(labels_are_not_averaged),
        cmocka_unit_test(the_most_frequent_label_wins),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
