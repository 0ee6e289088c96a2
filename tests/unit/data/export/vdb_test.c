/* SPDX-License-Identifier: Apache-2.0
 *
 * Volumes that are written as OpenVDB, and read again by OpenVDB itself, which the importer uses.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "data/export/job.h"
#include "data/volume/sample.h"
#include "unit/data/export/fixture.h"

/* Samples that are 0 in many leaves and blocks of OpenVDB, and elsewhere fit into every type. */
static double sparse_value(enum sp_type type, uint64_t i) {
    const double value = i / 1000 % 7 == 3 ? (double)(i % 127) : 0;
    return type >= SP_FLOAT32 ? value / 7 : value;
}

static int make_typed_samples(enum sp_type type, uint64_t count, bool is_empty) {
    void *samples = calloc(count, sp_type_size(type));
    assert_non_null(samples);
    for (uint64_t i = 0; !is_empty && i < count; i++)
        sp_sample_set(samples, type, i, sparse_value(type, i));
    const int fd = memory_file(samples, count * sp_type_size(type));
    free(samples);
    return fd;
}

static void check_vdb(const char *path, const struct sp_volume_info *was, bool is_empty) {
    struct sp_error err;
    struct sp_volume *volume = sp_volume_load(path, &options, &err);
    if (!volume)
        fail_msg("%s: %s", err.place, err.text);
    const struct sp_volume_info *info = sp_volume_info(volume);
    const struct sp_grid *a = &was->grid, *b = &info->grid;
    assert_int_equal(info->type, SP_FLOAT32);
    assert_string_equal(info->value_name, was->value_name[0] ? was->value_name : "density");
    assert_memory_equal(a->dims, b->dims, sizeof a->dims);
    for (int r = 0; r < 3; r++) {
        assert_float_equal(a->spacing[r], b->spacing[r], 1e-12);
        assert_float_equal(a->origin[r], b->origin[r], 1e-12);
        for (int axis = 0; axis < 3; axis++)
            assert_float_equal(a->direction[r][axis], b->direction[r][axis], 1e-12);
    }
    const uint64_t count = (uint64_t)a->dims[0] * a->dims[1] * a->dims[2];
    for (uint64_t i = 0; i < count; i++) {
        const double value = is_empty ? 0 : sparse_value(was->type, i);
        const double is = sp_sample(sp_volume_voxels(volume), info->type, i);
        if (is != (double)(float)value)
            fail_msg("sample %lu is %g, not %g", (unsigned long)i, is, value);
    }
    sp_volume_unref(&volume);
}

/* Every type, several blocks and children of the root, turned axes, and no active voxels but the
 * corners. */
static void openvdb_comes_back(void **state) {
    static const struct {
        enum sp_type type;
        uint32_t dims[3];
        bool is_empty;
    } cases[] = {
        { SP_UINT8, { NX, NY, NZ }, false },   { SP_INT8, { 9, 8, 7 }, false },
        { SP_UINT16, { 1, 130, 1 }, false },   { SP_INT16, { 5, 5, 4100 }, false },
        { SP_INT32, { 4100, 3, 2 }, false },   { SP_FLOAT32, { 129, 64, 128 }, false },
        { SP_FLOAT64, { 2, 4097, 9 }, false }, { SP_UINT8, { 300, 20, 30 }, true },
        { SP_FLOAT32, { 1, 1, 1 }, true },
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct sp_error err;
        struct sp_volume_info info = describe();
        const uint32_t *dims = cases[i].dims;
        const uint64_t count = (uint64_t)dims[0] * dims[1] * dims[2];
        char *path = strdup(path_in(state, "a.vdb"));
        FILE *file = fopen(path, "w+");
        assert_non_null(file);
        memcpy(info.grid.dims, dims, sizeof info.grid.dims);
        info.type = cases[i].type;
        info.grid.direction[0][0] = info.grid.direction[1][1] = 0.8;
        info.grid.direction[0][1] = -0.6;
        info.grid.direction[1][0] = 0.6;
        snprintf(info.value_name, sizeof info.value_name, "%s", i % 2 ? "smoke of \"µ\"" : "");
        const struct sp_export_job job = { .info = &info,
                                           .samples = make_typed_samples(info.type, count,
                                                                         cases[i].is_empty),
                                           .out = fileno(file),
                                           .folder = *state,
                                           .title = path };
        if (!sp_export_vdb(&job, &err))
            fail_msg("%s: %s", err.place, err.text);
        close(job.samples);
        fclose(file);
        check_vdb(path, &info, cases[i].is_empty);
        free(path);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(openvdb_comes_back, make_folder, remove_folder),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
