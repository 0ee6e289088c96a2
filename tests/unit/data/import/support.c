/* SPDX-License-Identifier: Apache-2.0 */
#include "unit/data/import/support.h"

#include <ftw.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zlib.h>

static char folder[64];

int folder_create(void **state) {
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/splat-import-test-XXXXXX");
    return mkdtemp(folder) ? 0 : -1;
}

static int remove_one(const char *path, const struct stat *st, int flag, struct FTW *ftw) {
    (void)st;
    (void)flag;
    (void)ftw;
    return remove(path);
}

int folder_remove(void **state) {
    (void)state;
    return nftw(folder, remove_one, 16, FTW_DEPTH | FTW_PHYS);
}

const char *folder_path(void) {
    return folder;
}

const char *in_folder(const char *name) {
    static _Thread_local char paths[8][512];
    static _Thread_local unsigned calls;
    char *path = paths[calls++ % 8];
    snprintf(path, sizeof paths[0], "%s/%s", folder, name);
    return path;
}

void write_file(const char *name, const void *bytes, size_t size) {
    write_both(name, "", bytes, size);
}

void write_both(const char *name, const char *header, const void *bytes, size_t size) {
    FILE *file = fopen(in_folder(name), "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(header, 1, strlen(header), file), strlen(header));
    if (size)
        assert_int_equal(fwrite(bytes, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

void write_text(const char *name, const char *format, ...) {
    va_list args;
    va_start(args, format);
    char *text;
    int n = vasprintf(&text, format, args);
    va_end(args);
    assert_compare(n, >=, 0);
    write_file(name, text, (size_t)n);
    free(text);
}

void *gzip(const void *bytes, size_t size, size_t *packed) {
    z_stream z = { .next_in = (Bytef *)bytes, .avail_in = (unsigned)size };
    assert_int_equal(deflateInit2(&z, 9, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY), Z_OK);
    size_t capacity = deflateBound(&z, size) + 64;
    void *out = malloc(capacity);
    assert_non_null(out);
    z.next_out = out;
    z.avail_out = (unsigned)capacity;
    assert_int_equal(deflate(&z, Z_FINISH), Z_STREAM_END);
    *packed = z.total_out;
    deflateEnd(&z);
    return out;
}

struct sp_load_options importer_options(void) {
    return (struct sp_load_options){ .importer = SPLATD_BIN_DIR "/splat-import" };
}

static struct sp_volume *load_with(const char *name, const struct sp_load_options *options) {
    struct sp_error err = { .text = "" };
    struct sp_volume *volume = sp_volume_load(in_folder(name), options, &err);
    if (!volume)
        fail_msg("%s: %s: %s [%s]", name, sp_code_name(err.code), err.text, err.place);
    return volume;
}

struct sp_volume *load(const char *name) {
    const struct sp_load_options options = importer_options();
    return load_with(name, &options);
}

struct sp_volume *load_step(const char *name, uint32_t step) {
    struct sp_load_options options = importer_options();
    options.step = step;
    options.has_step = true;
    return load_with(name, &options);
}

void load_warns(const char *name, const char *text) {
    struct sp_volume *volume = load(name);
    const struct sp_volume_info *info = sp_volume_info(volume);
    bool is_there = false;
    for (int i = 0; i < SP_WARNINGS_MAX; i++)
        is_there |= strstr(info->warnings[i], text) != NULL;
    if (!is_there)
        fail_msg("%s: no warning has \"%s\"; the first one is \"%s\"", name, text,
                 info->warnings[0]);
    sp_volume_unref(&volume);
}

void load_error(const char *name, enum sp_code code, const char *place, const char *text) {
    struct sp_load_options options = importer_options();
    struct sp_error err = { .text = "" };
    struct sp_volume *volume = sp_volume_load(in_folder(name), &options, &err);
    if (volume)
        fail_msg("%s was loaded; expected %s", name, text);
    if (err.code != code || !strstr(err.place, place) || !strstr(err.text, text))
        fail_msg("%s: %s: %s [%s], expected %s: %s [%s]", name, sp_code_name(err.code), err.text,
                 err.place, sp_code_name(code), text, place);
}

double ramp_value(enum sp_type type, size_t i) {
    double v = (double)((i * 37 + 11) % 251);
    switch (type) {
    case SP_UINT8:
        return v;
    case SP_INT8:
        return v - 125;
    case SP_UINT16:
        return v * 257;
    case SP_INT16:
        return v * 257 - 32000;
    case SP_INT32:
        return v * 16000000 - 2e9;
    case SP_FLOAT32:
        return v * 0.25 - 20;
    default:
        return v * 1e-3 - 0.1;
    }
}

void make_ramp(enum sp_type type, size_t count, void *out) {
    for (size_t i = 0; i < count; i++) {
        double v = ramp_value(type, i);
        switch (type) {
        case SP_UINT8:
            ((uint8_t *)out)[i] = (uint8_t)v;
            break;
        case SP_INT8:
            ((int8_t *)out)[i] = (int8_t)v;
            break;
        case SP_UINT16:
            ((uint16_t *)out)[i] = (uint16_t)v;
            break;
        case SP_INT16:
            ((int16_t *)out)[i] = (int16_t)v;
            break;
        case SP_INT32:
            ((int32_t *)out)[i] = (int32_t)v;
            break;
        case SP_FLOAT32:
            ((float *)out)[i] = (float)v;
            break;
        default:
            ((double *)out)[i] = v;
            break;
        }
    }
}

void assert_is_ramp(const struct sp_volume *volume, size_t count) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    size_t bytes = count * sp_type_size(info->type);
    assert_int_equal(info->voxel_bytes, bytes);
    void *expected = malloc(bytes);
    assert_non_null(expected);
    make_ramp(info->type, count, expected);
    assert_memory_equal(sp_volume_voxels(volume), expected, bytes);
    free(expected);
}

void assert_are_vectors(const struct sp_volume *volume, enum sp_type type, bool planar) {
    const struct sp_volume_info *info = sp_volume_info(volume);
    const float(*vectors)[3] = sp_volume_vectors(volume), *lengths = sp_volume_voxels(volume);
    size_t count = info->voxel_bytes / sizeof(float);
    assert_int_equal(info->type, SP_FLOAT32);
    assert_int_equal(info->vector_bytes, 3 * info->voxel_bytes);
    for (size_t i = 0; i < count; i++) {
        double square = 0;
        for (size_t c = 0; c < 3; c++) {
            double v = ramp_value(type, planar ? c * count + i : 3 * i + c);
            assert_float_equal(vectors[i][c], v, 1e-7 * (1 + fabs(v)));
            square += v * v;
        }
        assert_float_equal(lengths[i], sqrt(square), 2e-7 * (1 + sqrt(square)));
    }
}

static void append(FILE *file, const void *numbers, size_t floats) {
    assert_int_equal(fwrite(numbers, sizeof(float), floats, file), floats);
}

static void dump(const struct sp_elements *e, const char *path) {
    size_t n = e->shape.count;
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    append(file, e->positions, 3 * n);
    append(file, e->factors, 6 * n);
    append(file, e->opacities, n);
    append(file, e->harmonics, 3 * n * sp_harmonics_count(e->shape.degree));
    assert_int_equal(fclose(file), 0);
}

void assert_are_gaussians(const struct sp_volume *volume, const char *path) {
    char command[2048];
    dump(sp_volume_elements(volume), in_folder("dump"));
    snprintf(command, sizeof command, "python3 %s/tests/unit/data/import/splats_reference.py %s %s",
             SPLATD_SOURCE_DIR, path, in_folder("dump"));
    assert_int_equal(system(command), 0);
}
