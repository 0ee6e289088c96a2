/* SPDX-License-Identifier: Apache-2.0
 *
 * Brick files: written from samples, read again, and damaged.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "bricks/file.h"
#include "bricks/write.h"
#include "volume/sample.h"

enum { NX = 131, NY = 70, NZ = 65, COUNT = NX * NY * NZ, BRICK = 64 * 64 * 64 };

static const enum sp_type types[] = { SP_UINT8, SP_INT8,    SP_UINT16, SP_INT16,
                                      SP_INT32, SP_FLOAT32, SP_FLOAT64 };

/* A field that is 0 in its first brick, and varies elsewhere. */
static double field_at(uint32_t i) {
    const uint32_t x = i % NX, y = i / NX % NY, z = i / NX / NY;
    return x < 80 && y < 66 ? 0 : fmod(x * 7 + y * 13 + z * 29, 101);
}

static void put(void *samples, enum sp_type type, uint32_t i, double value) {
    switch (type) {
    case SP_UINT8:
        ((uint8_t *)samples)[i] = (uint8_t)value;
        break;
    case SP_INT8:
        ((int8_t *)samples)[i] = (int8_t)value;
        break;
    case SP_UINT16:
        ((uint16_t *)samples)[i] = (uint16_t)value;
        break;
    case SP_INT16:
        ((int16_t *)samples)[i] = (int16_t)value;
        break;
    case SP_INT32:
        ((int32_t *)samples)[i] = (int32_t)value;
        break;
    case SP_FLOAT32:
        ((float *)samples)[i] = (float)value;
        break;
    default:
        ((double *)samples)[i] = value;
    }
}

static void *make_samples(enum sp_type type) {
    void *samples = malloc(COUNT * sp_type_size(type));
    assert_non_null(samples);
    for (uint32_t i = 0; i < COUNT; i++)
        put(samples, type, i, field_at(i));
    return samples;
}

static const double times[3] = { 0, 0.5, 2 };

static struct sp_volume_info describe(enum sp_type type) {
    return (struct sp_volume_info){ .grid = { .dims = { NX, NY, NZ },
                                              .spacing = { 0.5, 1, 2 },
                                              .origin = { 1, 2, 3 },
                                              .direction = { { 1 }, { 0, 1 }, { 0, 0, 1 } } },
                                    .type = type,
                                    .unit = "mm",
                                    .value_unit = "HU",
                                    .anatomy = "LPS",
                                    .steps = { 3, 2, "s", times },
                                    .others = { "density", "speed" },
                                    .other_vectors = { "flow" },
                                    .warnings = { "Something is missing." } };
}

static int memory_file(const void *bytes, size_t size) {
    int fd = memfd_create("bricks", MFD_CLOEXEC);
    assert_true(fd >= 0);
    assert_int_equal(pwrite(fd, bytes, size, 0), (ssize_t)size);
    return fd;
}

/* Writes the samples as a brick file; returns its descriptor. */
static int write_file(const void *samples, enum sp_type type) {
    const struct sp_volume_info info = describe(type);
    struct sp_error err;
    int from = memory_file(samples, COUNT * sp_type_size(type)), out = memory_file("", 0);
    const struct sp_bricks_write_job job = {
        .info = &info, .samples = from, .out = out, .folder = "/tmp", .shown = "test"
    };
    if (!sp_bricks_write(&job, &err))
        fail_msg("%s", err.text);
    close(from);
    return out;
}

static struct sp_brick_file *open_file(int fd) {
    struct sp_error err;
    struct sp_brick_file *file = sp_brick_file_open(fd, "test", &err);
    if (!file)
        fail_msg("%s", err.text);
    return file;
}

/* Reads a level into an array of doubles. */
static double *read_level(const struct sp_brick_file *file, unsigned l) {
    const struct sp_brick_header *header = sp_brick_file_header(file);
    const struct sp_brick_level *level = &header->level[l];
    const uint32_t *dims = level->dims;
    double *values = malloc((size_t)dims[0] * dims[1] * dims[2] * sizeof *values);
    void *samples = malloc(BRICK * sizeof(double));
    struct sp_error err;
    struct sp_brick_scratch *scratch = sp_brick_scratch_create(&err);
    assert_non_null(values);
    assert_non_null(samples);
    assert_non_null(scratch);
    for (uint64_t b = 0; b < sp_brick_count(level); b++) {
        uint32_t first[3], size[3];
        sp_brick_box(level, b, first, size);
        if (!sp_brick_file_read(file, l, b, scratch, samples, &err))
            fail_msg("%s", err.text);
        for (uint32_t i = 0; i < size[0] * size[1] * size[2]; i++) {
            size_t x = first[0] + i % size[0], y = first[1] + i / size[0] % size[1];
            size_t z = first[2] + i / size[0] / size[1];
            values[(z * dims[1] + y) * dims[0] + x] = sp_sample(samples, header->info.type, i);
        }
    }
    sp_brick_scratch_destroy(&scratch);
    free(samples);
    return values;
}

/* The mean of up to eight finite samples. */
static double mean_at(const double *fine, const uint32_t dims[3], size_t x, size_t y, size_t z) {
    double sum = 0;
    int count = 0;
    for (size_t k = 0; k < 8; k++) {
        size_t i = 2 * x + (k & 1), j = 2 * y + (k >> 1 & 1), l = 2 * z + (k >> 2);
        if (i >= dims[0] || j >= dims[1] || l >= dims[2])
            continue;
        double value = fine[(l * dims[1] + j) * dims[0] + i];
        sum += isfinite(value) ? value : 0;
        count += isfinite(value);
    }
    return count ? sum / count : (double)NAN;
}

static void check_mean(const double *fine, const uint32_t from[3], const double *coarse,
                       const uint32_t dims[3], bool is_real) {
    for (size_t i = 0; i < (size_t)dims[0] * dims[1] * dims[2]; i++) {
        double mean =
            mean_at(fine, from, i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]);
        if (isnan(mean))
            assert_true(isnan(coarse[i]));
        else
            assert_float_equal(coarse[i], is_real ? mean : rint(mean), 1e-5);
    }
}

static void every_type_comes_back(void **state) {
    (void)state;
    for (size_t t = 0; t < sizeof types / sizeof *types; t++) {
        void *samples = make_samples(types[t]);
        struct sp_brick_file *file = open_file(write_file(samples, types[t]));
        const struct sp_brick_header *header = sp_brick_file_header(file);
        double *fine = read_level(file, 0);
        assert_int_equal(header->levels, 3);
        for (uint32_t i = 0; i < COUNT; i++)
            if (fine[i] != sp_sample(samples, types[t], i))
                fail_msg("%s: sample %u is %g", sp_type_name(types[t]), i, fine[i]);
        for (unsigned l = 1; l < header->levels; l++) {
            double *coarse = read_level(file, l);
            check_mean(fine, header->level[l - 1].dims, coarse, header->level[l].dims,
                       types[t] == SP_FLOAT32 || types[t] == SP_FLOAT64);
            free(fine);
            fine = coarse;
        }
        free(fine);
        sp_brick_file_close(&file);
        free(samples);
    }
}

static void statistics_are_those_of_the_volume(void **state) {
    (void)state;
    for (size_t t = 0; t < sizeof types / sizeof *types; t++) {
        struct sp_error err;
        const struct sp_volume_info described = describe(types[t]);
        void *samples = make_samples(types[t]);
        if (types[t] == SP_FLOAT32)
            ((float *)samples)[COUNT - 1] = NAN;
        struct sp_volume *volume =
            sp_volume_create(&described.grid, types[t], samples, "whole", &err);
        assert_non_null(volume);
        struct sp_brick_file *file = open_file(write_file(samples, types[t]));
        const struct sp_volume_info *info = &sp_brick_file_header(file)->info;
        const struct sp_volume_info *whole = sp_volume_info(volume);
        assert_memory_equal(&info->grid, &whole->grid, sizeof info->grid);
        assert_memory_equal(info->histogram, whole->histogram, sizeof info->histogram);
        assert_memory_equal(info->range, whole->range, sizeof info->range);
        assert_memory_equal(&info->projected, &whole->projected, sizeof info->projected);
        assert_int_equal(info->nonfinite, whole->nonfinite);
        assert_int_equal(info->voxel_bytes, whole->voxel_bytes);
        assert_string_equal(info->unit, "mm");
        assert_string_equal(info->value_unit, "HU");
        assert_string_equal(info->anatomy, "LPS");
        sp_brick_file_close(&file);
        sp_volume_unref(&volume);
        free(samples);
    }
}

static void ranges_include_the_margin(void **state) {
    (void)state;
    void *samples = make_samples(SP_UINT8);
    struct sp_brick_file *file = open_file(write_file(samples, SP_UINT8));
    const struct sp_brick_level *level = &sp_brick_file_header(file)->level[0];
    const struct sp_brick_entry *entries = sp_brick_file_entries(file, 0);
    for (uint64_t b = 0; b < sp_brick_count(level); b++) {
        uint32_t first[3], size[3];
        double least = 1e9, most = -1e9;
        sp_brick_box(level, b, first, size);
        for (uint32_t i = 0; i < COUNT; i++) {
            const uint32_t at[3] = { i % NX, i / NX % NY, i / NX / NY };
            bool is_in = true;
            for (int a = 0; a < 3; a++)
                is_in = is_in && at[a] + BRICK_MARGIN >= first[a] &&
                        at[a] < first[a] + size[a] + BRICK_MARGIN;
            least = is_in ? fmin(least, field_at(i)) : least;
            most = is_in ? fmax(most, field_at(i)) : most;
        }
        assert_float_equal(entries[b].range[0], least, 0);
        assert_float_equal(entries[b].range[1], most, 0);
    }
    assert_int_equal(entries[0].bytes, 0); /* constant */
    assert_float_equal(entries[0].range[1], 100, 1);
    sp_brick_file_close(&file);
    free(samples);
}

/* A copy of a file with one byte changed, and cut to `size`. */
static int damage(int fd, size_t at, size_t size) {
    struct stat st;
    assert_int_equal(fstat(fd, &st), 0);
    char *bytes = malloc((size_t)st.st_size);
    assert_non_null(bytes);
    assert_int_equal(pread(fd, bytes, (size_t)st.st_size, 0), st.st_size);
    bytes[at] ^= 0x10;
    int copy = memory_file(bytes, size ? size : (size_t)st.st_size);
    free(bytes);
    return copy;
}

static void a_damaged_brick_is_an_error_of_its_own(void **state) {
    (void)state;
    struct sp_error err;
    static uint8_t out[BRICK];
    void *samples = make_samples(SP_UINT8);
    int fd = write_file(samples, SP_UINT8);
    struct sp_brick_file *whole = open_file(dup(fd));
    const struct sp_brick_entry *entries = sp_brick_file_entries(whole, 0);
    struct sp_brick_scratch *scratch = sp_brick_scratch_create(&err);
    struct sp_brick_file *bad = open_file(damage(fd, entries[1].at + entries[1].bytes / 2, 0));
    assert_non_null(scratch);
    assert_false(sp_brick_file_read(bad, 0, 1, scratch, out, &err));
    assert_int_equal(err.code, SP_ERR_FORMAT);
    assert_non_null(strstr(err.text, "brick (1, 0, 0) of level 0 is damaged"));
    assert_true(sp_brick_file_read(bad, 0, 2, scratch, out, &err));
    sp_brick_scratch_destroy(&scratch);
    sp_brick_file_close(&bad);
    sp_brick_file_close(&whole);
    close(fd);
    free(samples);
}

static void a_damaged_file_does_not_open(void **state) {
    (void)state;
    struct sp_error err;
    struct stat st;
    void *samples = make_samples(SP_UINT8);
    int fd = write_file(samples, SP_UINT8);
    const struct sp_volume_info info = describe(SP_UINT8);
    assert_int_equal(fstat(fd, &st), 0);
    const struct {
        size_t at, size;
        enum sp_code code;
        const char *text;
    } cases[] = {
        { 0, 0, SP_ERR_FORMAT, "no brick file" },
        { 8, 0, SP_ERR_UNSUPPORTED, "version" },
        { 100, 0, SP_ERR_FORMAT, "the checksum of its header" },
        { (size_t)st.st_size - 1, 0, SP_ERR_FORMAT, "the checksum of its notes" },
        { (size_t)st.st_size - 1 - sp_brick_notes_bytes(&info), 0, SP_ERR_FORMAT,
          "the checksum of the index of level 2" },
        { BRICK_HEADER_BYTES, (size_t)st.st_size - 1, SP_ERR_FORMAT, "beyond its end" },
        { 0, 100, SP_ERR_FORMAT, "the file ends at byte 100" },
        { BRICK_HEADER_BYTES, BRICK_HEADER_BYTES + 1, SP_ERR_FORMAT, "beyond its end" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct sp_brick_file *file =
            sp_brick_file_open(damage(fd, cases[i].at, cases[i].size), "test", &err);
        assert_null(file);
        assert_int_equal(err.code, cases[i].code);
        if (!strstr(err.text, cases[i].text))
            fail_msg("\"%s\" does not say \"%s\"", err.text, cases[i].text);
    }
    close(fd);
    free(samples);
}

static bool cancel(void *user, double fraction) {
    double *last = user;
    assert_true(fraction >= *last);
    *last = fraction;
    return fraction < 0.3;
}

static void notes_come_back(void **state) {
    (void)state;
    void *samples = make_samples(SP_UINT8);
    struct sp_brick_file *file = open_file(write_file(samples, SP_UINT8));
    const struct sp_volume_info want = describe(SP_UINT8), *got = &sp_brick_file_header(file)->info;
    assert_int_equal(got->steps.count, 3);
    assert_int_equal(got->steps.index, 2);
    assert_string_equal(got->steps.unit, "s");
    assert_memory_equal(got->steps.times, times, sizeof times);
    assert_memory_equal(got->others, want.others, sizeof want.others);
    assert_memory_equal(got->other_vectors, want.other_vectors, sizeof want.other_vectors);
    assert_memory_equal(got->warnings, want.warnings, sizeof want.warnings);
    sp_brick_file_close(&file);
    free(samples);
}

static void writing_is_cancelled(void **state) {
    (void)state;
    struct sp_error err;
    double last = 0;
    void *samples = make_samples(SP_UINT8);
    const struct sp_volume_info info = describe(SP_UINT8);
    const struct sp_bricks_write_job job = { .info = &info,
                                             .samples = memory_file(samples, COUNT),
                                             .out = memory_file("", 0),
                                             .folder = "/tmp",
                                             .shown = "test",
                                             .progress = cancel,
                                             .user = &last };
    assert_false(sp_bricks_write(&job, &err));
    assert_int_equal(err.code, SP_ERR_CANCELLED);
    assert_null(sp_brick_file_open(job.out, "test", &err)); /* it has no header yet */
    close(job.samples);
    free(samples);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_type_comes_back),
        cmocka_unit_test(statistics_are_those_of_the_volume),
        cmocka_unit_test(ranges_include_the_margin),
        cmocka_unit_test(a_damaged_brick_is_an_error_of_its_own),
        cmocka_unit_test(a_damaged_file_does_not_open),
        cmocka_unit_test(notes_come_back),
        cmocka_unit_test(writing_is_cancelled),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
