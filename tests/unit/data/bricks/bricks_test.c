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
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "data/bricks/file.h"
#include "data/bricks/write.h"
#include "data/volume/sample.h"
#include "data/volume/volume.h"

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

/* Writes the samples of a file as a brick file; returns its descriptor. Closes the first one. */
static int write_described(const struct sp_volume_info *info, int from) {
    struct sp_error err;
    const struct sp_bricks_write_job job = {
        .info = info, .samples = from, .out = memory_file("", 0), .folder = "/tmp", .title = "test"
    };
    if (!sp_bricks_write(&job, &err))
        fail_msg("%s", err.text);
    close(from);
    return job.out;
}

static int write_file(const void *samples, enum sp_type type) {
    const struct sp_volume_info info = describe(type);
    return write_described(&info, memory_file(samples, COUNT * sp_type_size(type)));
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
        if (sp_type_size(types[t]) > 1) { /* one of them lies on the border of two bins */
            put(samples, types[t], COUNT - 2, 3994);
            put(samples, types[t], COUNT - 3, 1997);
        }
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

/* Slices of a flat volume differ, and a coarser level would have their means. */
static void projections_of_a_flat_volume_are_those_of_its_slices(void **state) {
    (void)state;
    enum { WIDTH = 300, HEIGHT = 20, SLICES = 3 };
    static uint8_t samples[WIDTH * HEIGHT * SLICES];
    struct sp_volume_info described = describe(SP_UINT8);
    memcpy(described.grid.dims, (uint32_t[3]){ WIDTH, HEIGHT, SLICES }, sizeof(uint32_t[3]));
    for (uint32_t i = 0; i < WIDTH * HEIGHT * SLICES; i++)
        samples[i] = (uint8_t)(i / (WIDTH * HEIGHT) * 100 + i % 50);
    struct sp_volume *volume = sp_volume_create(&described.grid, SP_UINT8, samples, "whole", NULL);
    assert_non_null(volume);
    struct sp_brick_file *file =
        open_file(write_described(&described, memory_file(samples, sizeof samples)));
    const struct sp_projected *want = &sp_volume_info(volume)->projected;
    assert_true(sp_brick_file_header(file)->levels > 1);
    assert_memory_equal(&sp_brick_file_header(file)->info.projected, want, sizeof *want);
    sp_brick_file_close(&file);
    sp_volume_unref(&volume);
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

/* Vectors that are 0 in the first brick; one of them is not finite. */
static float (*make_vectors(void))[3] {
    float(*vectors)[3] = malloc(COUNT * sizeof *vectors);
    assert_non_null(vectors);
    for (uint32_t i = 0; i < COUNT; i++)
        for (int c = 0; c < 3; c++)
            vectors[i][c] = field_at(i) > 0 ? (float)sin(i * (0.1 + c)) : 0;
    vectors[COUNT - 1][1] = NAN;
    vectors[COUNT - 2][2] = 7;
    return vectors;
}

/* Writes a brick file with vectors and with two rectilinear axes. */
static int write_grid(const uint8_t *samples, const float (*vectors)[3],
                      double coordinates[NX + NY]) {
    struct sp_volume_info info = describe(SP_UINT8);
    uint64_t vectors_at;
    for (uint32_t i = 0; i < NX + NY; i++)
        coordinates[i] = i < NX ? 0.01 * i * (i + 3) : 2 * (i - NX) + sin(i - NX);
    for (int a = 0; a < 2; a++) {
        const uint32_t last = info.grid.dims[a] - 1;
        info.grid.coordinates[a] = a ? coordinates + NX : coordinates;
        info.grid.spacing[a] = info.grid.coordinates[a][last] / last;
    }
    info.vector_bytes = 1;
    snprintf(info.vector_name, sizeof info.vector_name, "flow");
    sp_volume_layout(COUNT, COUNT, true, &vectors_at);
    const int from = memory_file(samples, COUNT);
    assert_int_equal(pwrite(from, vectors, COUNT * sizeof *vectors, (off_t)vectors_at),
                     COUNT * sizeof *vectors);
    return write_described(&info, from);
}

/* Reads the vectors of a level. */
static float (*read_vectors(const struct sp_brick_file *file, unsigned l))[3] {
    const struct sp_brick_level *level = &sp_brick_file_header(file)->level[l];
    const uint32_t *dims = level->dims;
    struct sp_error err;
    struct sp_brick_scratch *scratch = sp_brick_scratch_create(&err);
    float(*vectors)[3] = malloc((size_t)dims[0] * dims[1] * dims[2] * sizeof *vectors);
    float(*brick)[3] = malloc(BRICK * sizeof *brick);
    assert_true(scratch && vectors && brick);
    for (uint64_t b = 0; b < sp_brick_count(level); b++) {
        uint32_t first[3], size[3];
        sp_brick_box(level, b, first, size);
        if (!sp_brick_file_read_vectors(file, l, b, scratch, brick, &err))
            fail_msg("%s", err.text);
        for (uint32_t i = 0; i < size[0] * size[1] * size[2]; i++) {
            size_t x = first[0] + i % size[0], y = first[1] + i / size[0] % size[1];
            size_t z = first[2] + i / size[0] / size[1];
            memcpy(vectors[(z * dims[1] + y) * dims[0] + x], brick[i], sizeof *brick);
        }
    }
    sp_brick_scratch_destroy(&scratch);
    free(brick);
    return vectors;
}

/* Returns one component of the vectors as doubles; NaN where a vector is not finite. */
static double *component(const float (*vectors)[3], const uint32_t dims[3], int c) {
    const size_t count = (size_t)dims[0] * dims[1] * dims[2];
    double *values = malloc(count * sizeof *values);
    assert_non_null(values);
    for (size_t i = 0; i < count; i++) {
        const float *v = vectors[i];
        const bool is_finite = isfinite(v[0]) && isfinite(v[1]) && isfinite(v[2]);
        values[i] = is_finite ? (double)v[c] : (double)NAN;
    }
    return values;
}

static void vectors_come_back(void **state) {
    (void)state;
    double coordinates[NX + NY];
    uint8_t *samples = make_samples(SP_UINT8);
    float(*fine)[3] = make_vectors();
    double longest;
    struct sp_brick_file *file =
        open_file(write_grid(samples, (const float(*)[3])fine, coordinates));
    const struct sp_brick_header *header = sp_brick_file_header(file);
    assert_true(sp_volume_measure_vectors((const float(*)[3])fine, COUNT, &longest, NULL));
    float(*own)[3] = read_vectors(file, 0);
    assert_memory_equal(own, fine, COUNT * sizeof *fine);
    free(own);
    for (unsigned l = 1; l < header->levels; l++) {
        float(*coarse)[3] = read_vectors(file, l);
        for (int c = 0; c < 3; c++) {
            double *from = component((const float(*)[3])fine, header->level[l - 1].dims, c);
            double *to = component((const float(*)[3])coarse, header->level[l].dims, c);
            check_mean(from, header->level[l - 1].dims, to, header->level[l].dims, true);
            free(from);
            free(to);
        }
        free(fine);
        fine = coarse;
    }
    assert_string_equal(header->info.vector_name, "flow");
    assert_int_equal(header->info.vector_bytes, 12 * COUNT);
    assert_float_equal(header->info.longest, longest, 0);
    sp_brick_file_close(&file);
    free(fine);
    free(samples);
}

static void axes_come_back(void **state) {
    (void)state;
    double coordinates[NX + NY];
    uint8_t *samples = make_samples(SP_UINT8);
    float(*vectors)[3] = make_vectors();
    struct sp_brick_file *file =
        open_file(write_grid(samples, (const float(*)[3])vectors, coordinates));
    const struct sp_brick_header *header = sp_brick_file_header(file);
    const struct sp_grid *grid = &header->info.grid;
    assert_memory_equal(grid->coordinates[0], coordinates, NX * sizeof *coordinates);
    assert_memory_equal(grid->coordinates[1], coordinates + NX, NY * sizeof *coordinates);
    assert_null(grid->coordinates[2]);
    for (unsigned l = 0; l < header->levels; l++)
        assert_null(header->level[l].places[2]);
    sp_brick_file_close(&file);
    free(vectors);
    free(samples);
}

/* Replaces the number at `at` in the header of a copy of a file, and makes its checksum right. */
static int lie(int fd, size_t at, uint32_t number) {
    unsigned char bytes[BRICK_HEADER_BYTES];
    const int copy = damage(fd, 0, 0);
    assert_int_equal(pread(fd, bytes, sizeof bytes, 0), sizeof bytes);
    memcpy(bytes + at, &number, sizeof number);
    const uint64_t checksum = sp_brick_checksum(bytes, sizeof bytes - 8);
    memcpy(bytes + sizeof bytes - 8, &checksum, sizeof checksum);
    assert_int_equal(pwrite(copy, bytes, sizeof bytes, 0), sizeof bytes);
    return copy;
}

/* Returns the offset of a number of 64 bits in the header. */
static size_t find_number(int fd, uint64_t number) {
    unsigned char bytes[BRICK_HEADER_BYTES];
    assert_int_equal(pread(fd, bytes, sizeof bytes, 0), sizeof bytes);
    for (size_t at = 0; at + sizeof number <= sizeof bytes; at += 4)
        if (memcmp(bytes + at, &number, sizeof number) == 0)
            return at;
    fail_msg("there is no %llu in the header", (unsigned long long)number);
    return 0;
}

static void damaged_axes_and_vectors_are_errors(void **state) {
    (void)state;
    double coordinates[NX + NY];
    struct sp_error err;
    uint8_t *samples = make_samples(SP_UINT8);
    float(*vectors)[3] = make_vectors(), (*brick)[3] = malloc(BRICK * sizeof *brick);
    const int fd = write_grid(samples, (const float(*)[3])vectors, coordinates);
    struct sp_brick_file *file = open_file(dup(fd));
    const struct sp_brick_header *header = sp_brick_file_header(file);
    const size_t axes_at = find_number(fd, header->axes_at);
    const struct {
        int file;
        const char *text;
    } cases[] = {
        { damage(fd, (size_t)header->axes_at + 9, 0), "the checksum of its axes" },
        { damage(fd, (size_t)header->level[1].vectors.at + 9, 0),
          "the checksum of the index of level 1" },
        { lie(fd, axes_at - 4, 7), "the checksum of its axes" }, /* another axis has none */
        { lie(fd, axes_at - 4, 8), "the kinds of its axes" },
        { lie(fd, axes_at - 8, 2), "its vectors" },
        { lie(fd, axes_at, UINT32_MAX), "its axes lie beyond its end" },
        { lie(fd, find_number(fd, header->level[0].vectors.at), UINT32_MAX),
          "an index lies beyond its end" },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        assert_null(sp_brick_file_open(cases[i].file, "test", &err));
        if (!strstr(err.text, cases[i].text))
            fail_msg("\"%s\" does not say \"%s\"", err.text, cases[i].text);
    }
    /* A brick of vectors is an error of its own. */
    struct sp_brick_scratch *scratch = sp_brick_scratch_create(&err);
    struct sp_brick_file *bad =
        open_file(damage(fd, (size_t)header->level[header->levels - 1].samples.at + 100000, 0));
    assert_true(scratch && brick);
    unsigned failed = 0;
    for (uint64_t b = 0; b < sp_brick_count(&header->level[0]); b++)
        failed += !sp_brick_file_read_vectors(bad, 0, b, scratch, brick, &err);
    assert_int_equal(failed, 1);
    assert_non_null(strstr(err.text, "of level 0 is damaged"));
    sp_brick_scratch_destroy(&scratch);
    sp_brick_file_close(&bad);
    sp_brick_file_close(&file);
    close(fd);
    free(brick);
    free(vectors);
    free(samples);
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
                                             .title = "test",
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
        cmocka_unit_test(projections_of_a_flat_volume_are_those_of_its_slices),
        cmocka_unit_test(ranges_include_the_margin),
        cmocka_unit_test(vectors_come_back),
        cmocka_unit_test(axes_come_back),
        cmocka_unit_test(damaged_axes_and_vectors_are_errors),
        cmocka_unit_test(a_damaged_brick_is_an_error_of_its_own),
        cmocka_unit_test(a_damaged_file_does_not_open),
        cmocka_unit_test(notes_come_back),
        cmocka_unit_test(writing_is_cancelled),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
