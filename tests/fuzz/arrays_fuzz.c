/* SPDX-License-Identifier: Apache-2.0
 *
 * What HDF5 or NetCDF may say of a file: any arrays, attributes and numbers. The first byte of the
 * input tells which of them; descriptions of arrays follow, and then what numbers and texts are
 * made of. The libraries themselves run only in the sandbox.
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "data/import/array_bridge.h"
#include "data/import/module.h"
#include "fuzz/import_fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

enum { ARRAYS = 4, RECORD = 24 };

static struct {
    uint8_t bytes[512];
    size_t size;
} input;

static uint8_t byte_at(size_t i) {
    return input.size ? input.bytes[i % input.size] : 0;
}

static void *open_file(const struct array_place *place, struct sp_error *err) {
    int fd = open(place->path, O_RDONLY | O_CLOEXEC);
    const ssize_t got = fd >= 0 ? pread(fd, input.bytes, sizeof input.bytes, 1) : -1;
    if (fd >= 0)
        close(fd);
    input.size = got > 0 ? (size_t)got : 0;
    if (!input.size)
        sp_fail(err, SP_ERR_FORMAT, "", "too short");
    return input.size ? &input : NULL;
}

static void close_file(void *file) {
    (void)file;
}

/* Sizes are small, so that reading is fast, apart from some that are not. */
static uint64_t size_of(uint8_t byte) {
    return byte < 250 ? byte % 12 : UINT64_C(1) << (byte - 210);
}

static bool describe(void *file, unsigned n, struct array_info *info) {
    static const char *const names[] = { "time", "x", "lat", "height", "c", "/s", "s", "" };
    static const char *const itk[] = { "VoxelData", "Dimension", "Spacing", "Origin",
                                       "Directions" };
    static const size_t sizes[] = { 1, 2, 4, 8 };
    const size_t at = n * RECORD;
    (void)file;
    memset(info, 0, sizeof *info);
    if (n >= ARRAYS || at + RECORD > input.size)
        return false;
    info->rank = byte_at(at) % (IMPORT_RANK_MAX + 1);
    info->number.kind = byte_at(at + 1) % 3;
    info->number.size = sizes[byte_at(at + 1) / 4 % 4];
    if (info->number.kind == IMPORT_FLOAT && info->number.size < 4)
        info->number.size = 4;
    info->is_number = byte_at(at + 2) % 8 != 0;
    info->has_default_fill = byte_at(at + 2) % 8 == 1;
    info->is_alias = byte_at(at + 2) % 8 == 2;
    info->is_preferred = byte_at(at + 2) % 8 == 3;
    info->is_scale = byte_at(at + 2) % 8 == 4;
    if (byte_at(0) % 4 == 3) /* Imaris: level, time point and channel */
        snprintf(info->name, sizeof info->name,
                 "/DataSet/ResolutionLevel %u/TimePoint %u/Channel %u/Data", n / 2,
                 byte_at(at + 2) / 8 % 3, byte_at(at + 2) / 32 % 3);
    else if (byte_at(0) % 16 == 2)
        snprintf(info->name, sizeof info->name, "/ITKImage/0/%s", itk[n % 5]);
    else
        snprintf(info->name, sizeof info->name, "%s", names[byte_at(at + 2) / 8 % 8]);
    for (unsigned d = 0; d < info->rank; d++) {
        info->shape[d] = size_of(byte_at(at + 3 + d));
        info->chunk[d] = size_of(byte_at(at + 11 + d));
        snprintf(info->dims[d], sizeof info->dims[d], "%s", names[byte_at(at + 16 + d) % 8]);
        snprintf(info->scales[d], sizeof info->scales[d], "%s",
                 names[byte_at(at + 16 + d) / 8 % 8]);
    }
    return true;
}

static bool read_box(void *file, unsigned n, const uint64_t *start, const uint64_t *count,
                     void *out, struct sp_error *err) {
    struct array_info info;
    uint64_t bytes;
    if (!describe(file, n, &info) || byte_at(n) == 255)
        return sp_fail(err, SP_ERR_FORMAT, "", "damaged");
    bytes = info.number.size;
    for (unsigned d = 0; d < info.rank; d++) {
        if (start[d] + count[d] > info.shape[d])
            abort();
        bytes *= count[d];
    }
    for (uint64_t i = 0; i < bytes; i++)
        ((uint8_t *)out)[i] = byte_at((size_t)i + ARRAYS * RECORD);
    return true;
}

static size_t numbers(void *file, unsigned n, const char *attribute, double *out, size_t most) {
    const uint8_t choice = byte_at(n * 7 + (uint8_t)attribute[1]);
    (void)file;
    for (size_t i = 0; i < most; i++)
        out[i] = choice % 3 ? choice - 100 : byte_at(i) * 1e300 * 1e10;
    return choice % 2 ? most : 0;
}

#define TAGS "{\"axes\": [{\"key\": \"x\", \"resolution\": 2}, {\"key\": \"c\", \"typeFlags\": 1}]}"

static void text(void *file, unsigned n, const char *attribute, char *out, size_t capacity) {
    static const char *const texts[] = { "",
                                         "T",
                                         "X",
                                         "down",
                                         "degrees_east",
                                         "true",
                                         "hPa",
                                         "km",
                                         "hours since 1900-01-01",
                                         "x lat s",
                                         TAGS,
                                         "{\"axes\": [1, {}, \"\"]}" };
    (void)file;
    snprintf(out, capacity, "%s",
             texts[byte_at(n * 5 + (uint8_t)attribute[0]) % (sizeof texts / sizeof *texts)]);
}

/* The attributes of Imaris: numbers, dates and names. */
static void group_text(void *file, const char *group, const char *attribute, char *out,
                       size_t capacity) {
    static const char *const texts[] = { "", "0", "3.5", "-1e308", "um", "2012-02-28 23:59:30.5" };
    const size_t length = strlen(attribute);
    (void)file;
    (void)group;
    snprintf(out, capacity, "%s",
             texts[byte_at(length + (uint8_t)attribute[length ? length - 1 : 0]) % 6]);
}

static size_t group_numbers(void *file, const char *group, const char *attribute, double *out,
                            size_t most) {
    return numbers(file, (unsigned)strlen(group), attribute, out, most);
}

/* In place of module.c. */
const void *import_module_load(const struct import_file *file, const char *module,
                               const char *symbol, const char *library, const char *package,
                               struct sp_error *err) {
    static const struct array_functions functions = { .open = open_file,
                                                      .close = close_file,
                                                      .describe = describe,
                                                      .read = read_box,
                                                      .numbers = numbers,
                                                      .text = text,
                                                      .group_text = group_text,
                                                      .group_numbers = group_numbers };
    (void)file;
    (void)module;
    (void)symbol;
    (void)library;
    (void)package;
    (void)err;
    return &functions;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    return size > 0 ? fuzz_import(data[0] % 2 ? &import_netcdf : &import_hdf5, "input", data, size)
                    : 0;
}
