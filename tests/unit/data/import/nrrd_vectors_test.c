/* SPDX-License-Identifier: Apache-2.0
 *
 * Vectors in NRRD files.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/samples.h"
#include "unit/data/import/support.h"

enum { N = 20 }; /* vectors */

static const char *const names[SP_TYPE_COUNT] = { "uint8", "int8",  "uint16", "int16",
                                                  "int32", "float", "double" };

#define DIRECTIONS "space directions: none (1,0,0) (0,0,1)\n"
#define VECTOR_SPACE                                                                               \
    "kinds: vector space space space\nspace: RAS\n"                                                \
    "space directions: none (1,0,0) (0,1,0) (0,0,1)\n"

/* Vectors of every type, with the axis of components first or last, in one file or one per
 * component. */
static void vectors_are_read(void **state) {
    (void)state;
    static const char *const kinds[] = { "vector",   "covariant-vector", "normal",
                                         "3-vector", "3-gradient",       "3-normal" };
    for (int t = 0; t < SP_TYPE_COUNT; t++)
        for (int variant = t; variant < t + 10; variant += 5) {
            bool last = variant & 1, packed = variant & 2, big = variant & 4;
            enum sp_type type = (enum sp_type)t;
            size_t size = 3 * N * sp_type_size(type);
            double values[3 * N];
            make_ramp(type, 3 * N, values);
            if (big)
                import_swap(values, sp_type_size(type), 3 * N);
            void *payload = packed ? gzip(values, size, &size) : memcpy(malloc(size), values, size);
            const char *kind = kinds[(t + variant + 1) % 6];
            char header[512];
            snprintf(header, sizeof header,
                     "NRRD0004\ncontent: flow\ntype: %s\ndimension: 4\nsizes: %s5 2 2%s\n"
                     "kinds: %s space space space %s\nspacings: %s1 2 3%s\nendian: %s\n"
                     "encoding: %s\n\n",
                     names[t], last ? "" : "3 ", last ? " 3" : "", last ? "" : kind,
                     last ? kind : "", last ? "" : "nan ", last ? " nan" : "",
                     big ? "big" : "little", packed ? "gzip" : "raw");
            write_both("v.nrrd", header, payload, size);
            free(payload);
            struct sp_volume *volume = load("v.nrrd");
            const struct sp_volume_info *info = sp_volume_info(volume);
            assert_int_equal(info->grid.dims[0], 5);
            assert_int_equal(info->grid.dims[2], 2);
            assert_compare(info->grid.spacing[1], ==, 2);
            assert_string_equal(info->value_name, "magnitude");
            assert_string_equal(info->vector_name, "flow");
            assert_are_vectors(volume, type, last);
            sp_volume_unref(&volume);
        }
    uint8_t components[3 * N];
    make_ramp(SP_UINT8, 3 * N, components);
    for (int c = 0; c < 3; c++)
        write_file(c == 0 ? "c0" : c == 1 ? "c1" : "c2", components + c * N, N);
    write_text("v.nhdr", "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 5 2 2 3\nencoding: raw\n"
                         "kinds: space space space vector\ndata file: c%%d 0 2 1\n");
    struct sp_volume *volume = load("v.nhdr");
    assert_are_vectors(volume, SP_UINT8, true);
    sp_volume_unref(&volume);
}

/* The vector (1, 2, 4) of a file in the axes of the world. */
static void vectors_turn_into_the_axes_of_the_world(void **state) {
    (void)state;
    static const struct {
        const char *fields;
        float world[3];
    } cases[] = {
        { "", { 1, 2, 4 } },
        { "space: RAS\n" DIRECTIONS, { 1, 2, 4 } },
        { "space: LAS\n" DIRECTIONS, { 1, -2, 4 } }, /* shown as LPS */
        { "space: RAS\n" DIRECTIONS "measurement frame: (0,1,0) (-1,0,0) (0,0,2)\n", { -2, 1, 8 } },
        { "space: LAS\n" DIRECTIONS "measurement frame: (0,1,0) (-1,0,0) (0,0,2)\n",
          { -2, -1, 8 } },
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char header[512];
        snprintf(header, sizeof header,
                 "NRRD0005\ntype: uint64\ndimension: 3\nsizes: 3 1 2\nencoding: raw\n"
                 "endian: little\nkinds: vector space space\n%s\n",
                 cases[i].fields);
        write_both("w.nrrd", header, (const uint64_t[6]){ 1, 2, 4, 0, 0, 0 }, 48);
        struct sp_volume *volume = load("w.nrrd");
        const float *world = sp_volume_vectors(volume)[0];
        for (int c = 0; c < 3; c++)
            assert_compare(world[c], ==, cases[i].world[c]);
        assert_float_equal(*(const float *)sp_volume_voxels(volume),
                           sqrtf(world[0] * world[0] + world[1] * world[1] + world[2] * world[2]),
                           1e-6);
        assert_compare(sp_volume_info(volume)->range[0], ==, 0);
        sp_volume_unref(&volume);
    }
}

static void wrong_vectors_are_refused(void **state) {
    (void)state;
    static const struct {
        const char *sizes, *fields;
        enum sp_code code;
        const char *place, *text;
    } cases[] = {
        { "3 5 2 2", "kinds: quaternion space space space\n", SP_ERR_FORMAT, "kinds",
          "axis 0 is of kind quaternion and has 3 samples instead of 4" },
        { "3 5 2 2", "kinds: 3-colour space space space\n", SP_ERR_FORMAT, "kinds",
          "axis 0: \"3-colour\" is not a kind of NRRD" },
        { "5 3 2 2", "kinds: space vector space space\n", SP_ERR_UNSUPPORTED, "kinds",
          "axis 1 lies between the axes of the volume" },
        { "3 5 2 3", "kinds: vector space space vector\n", SP_ERR_UNSUPPORTED, "kinds",
          "axis 3 is a second one of components" },
        { "2 3 5 2", "kinds: time 3-vector space space\n", SP_ERR_UNSUPPORTED, "kinds",
          "alternate" },
        { "3 5 2 3", "kinds: vector space space space\n", SP_ERR_FORMAT, "sizes",
          "need 90 bytes, the file has 60" },
        { "3 5 2 2", VECTOR_SPACE "measurement frame: (1,0,0) (0,1,0)\n", SP_ERR_FORMAT,
          "measurement frame", "vector 3 is not of the form" },
        { "3 5 2 2", VECTOR_SPACE "measurement frame: (1,0,0) (0,nan,0) (0,0,1)\n", SP_ERR_FORMAT,
          "measurement frame", "vector 2 holds something else" },
        { "3 5 2 2", VECTOR_SPACE "measurement frame: (1,0,0) (0,1,0) (0,0,1) (0,0,0)\n",
          SP_ERR_FORMAT, "measurement frame", "more than 3 vectors" },
        { "3 5 2 2",
          "kinds: vector space space space\nmeasurement frame: (1,0,0) (0,1,0) (0,0,1)\n",
          SP_ERR_FORMAT, "measurement frame", "needs a space of 3 dimensions" },
        { "3 5 2 2",
          "kinds: vector space space space\nspace: RAS\nspace directions: none (1,0,0) "
          "none (0,0,1)\n",
          SP_ERR_FORMAT, "space directions", "axis 2 has no direction" },
    };
    uint8_t samples[3 * N];
    make_ramp(SP_UINT8, 3 * N, samples);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char header[512];
        snprintf(header, sizeof header,
                 "NRRD0005\ntype: int8\ndimension: 4\nsizes: %s\nencoding: raw\n%s\n",
                 cases[i].sizes, cases[i].fields);
        write_both("wrong.nrrd", header, samples, 3 * N);
        load_error("wrong.nrrd", cases[i].code, cases[i].place, cases[i].text);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(vectors_are_read),
        cmocka_unit_test(vectors_turn_into_the_axes_of_the_world),
        cmocka_unit_test(wrong_vectors_are_refused),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
