/* SPDX-License-Identifier: Apache-2.0
 *
 * Scenes of Gaussians in SPZ files.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "unit/data/import/support.h"

enum { HEADER = 16 };

static void put32(uint8_t *out, uint32_t value) {
    for (int i = 0; i < 4; i++)
        out[i] = (uint8_t)(value >> 8 * i);
}

static size_t bytes_each(uint32_t version, unsigned degree) {
    return (version == 1 ? 6u : 9u) + 7 + (version < 3 ? 3u : 4u) +
           3 * ((degree + 1) * (degree + 1) - 1);
}

/* Packs a scene of bytes that look random. The caller frees it. */
static uint8_t *make(uint32_t version, uint32_t count, unsigned degree, size_t *size) {
    const size_t bytes = HEADER + count * bytes_each(version, degree);
    uint8_t *scene = malloc(bytes);
    assert_non_null(scene);
    uint32_t seed = version * 10 + degree;
    for (size_t i = HEADER; i < bytes; i++) {
        seed = seed * 1664525 + 1013904223;
        scene[i] = (uint8_t)(seed >> 24);
    }
    for (size_t i = 0; version == 1 && i < 3 * count; i++)
        scene[HEADER + 2 * i + 1] &= 0xbf; /* finite floats below 2 */
    put32(scene, 0x5053474e);
    put32(scene + 4, version);
    put32(scene + 8, count);
    memcpy(scene + 12, (const uint8_t[4]){ (uint8_t)degree, 12, 1, 0 }, 4);
    void *packed = gzip(scene, bytes, size);
    free(scene);
    return packed;
}

static void every_version_and_degree_agrees_with_another_reader(void **state) {
    (void)state;
    for (uint32_t version = 1; version <= 3; version++)
        for (unsigned degree = 0; degree <= 3; degree++) {
            enum { COUNT = 700 }; /* several runs of harmonics */
            size_t size;
            uint8_t *packed = make(version, COUNT * (degree == 3 ? 5 : 1), degree, &size);
            write_file("s.spz", packed, size);
            free(packed);
            struct sp_volume *volume = load("s.spz");
            const struct sp_elements *e = sp_volume_elements(volume);
            assert_int_equal(e->shape.kind, SP_KIND_GAUSSIANS);
            assert_int_equal(e->shape.degree, degree);
            assert_are_gaussians(volume, in_folder("s.spz"));
            sp_volume_unref(&volume);
        }
}

/* Numbers whose meaning is published: ±1 in fixed point, a turn by 90° around z, extremes. */
static void known_bytes_have_known_values(void **state) {
    static const uint8_t arrays[] = {
        0,    0x10, 0,   0,    0xf0, 0xff, 0xff, 0xff, 0x7f, /* position: 1, -1, 2047.9998 */
        255,                                                 /* opacity */
        0,    255,  128,                                     /* colour */
        160,  176,  144,                                     /* scales: 1, e, 1/e */
        0xff, 0x01, 0,   0xc0,                               /* w and z are √½ */
    };
    uint8_t scene[HEADER + sizeof arrays];
    size_t size;
    (void)state;
    put32(scene, 0x5053474e);
    put32(scene + 4, 3);
    put32(scene + 8, 1);
    memcpy(scene + 12, (const uint8_t[4]){ 0, 12, 0, 0 }, 4);
    memcpy(scene + HEADER, arrays, sizeof arrays);
    uint8_t *packed = gzip(scene, sizeof scene, &size);
    write_file("k.spz", packed, size);
    free(packed);
    struct sp_volume *volume = load("k.spz");
    const struct sp_elements *e = sp_volume_elements(volume);
    assert_float_equal(e->positions[0][0], 1, 0);
    assert_float_equal(e->positions[0][1], -1, 0);
    assert_float_equal(e->positions[0][2], 2048 - 1 / 4096., 1e-3);
    assert_float_equal(e->opacities[0], 1, 0);
    assert_float_equal(e->harmonics[0], -0.5 / 0.15, 1e-6);
    assert_float_equal(e->harmonics[1], 0.5 / 0.15, 1e-6);
    assert_float_equal(e->factors[0][0], M_E, 1e-6);
    assert_float_equal(e->factors[0][1], 0, 1e-6);
    assert_float_equal(e->factors[0][2], 1, 1e-6);
    assert_float_equal(e->factors[0][5], 1 / M_E, 1e-6);
    assert_string_equal(sp_volume_info(volume)->warnings[0], "");
    sp_volume_unref(&volume);
}

static void what_follows_the_gaussians_is_reported(void **state) {
    size_t size;
    uint8_t scene[HEADER + 2 * 19] = { 0 };
    (void)state;
    put32(scene, 0x5053474e);
    put32(scene + 4, 2);
    put32(scene + 8, 1);
    uint8_t *packed = gzip(scene, sizeof scene, &size);
    write_file("more.spz", packed, size);
    free(packed);
    struct sp_volume *volume = load("more.spz");
    assert_string_equal(sp_volume_info(volume)->warnings[0],
                        "The file goes on after Gaussian 1, the last one that its header declares; "
                        "the rest is not read.");
    sp_volume_unref(&volume);
}

static void bad_files_are_refused(void **state) {
    static const struct {
        int at; /* a byte of the header that is changed */
        uint8_t value;
        enum sp_code code;
        const char *place, *text;
    } cases[] = {
        { 0, 'X', SP_ERR_FORMAT, "magic", "does not begin like an SPZ file" },
        { 4, 0, SP_ERR_UNSUPPORTED, "version", "is 0" },
        { 4, 4, SP_ERR_UNSUPPORTED, "version", "is 4; supported are 1 to 3" },
        { 8, 200, SP_ERR_FORMAT, "byte ", "ends before the 200 Gaussians" },
        { 10, 0x10, SP_ERR_FORMAT, "numPoints", "the number is wrong" },
        { 11, 0x20, SP_ERR_UNSUPPORTED, "numPoints", "a volume has at most" },
        { 12, 4, SP_ERR_UNSUPPORTED, "shDegree", "is 4; supported are 0 to 3" },
    };
    uint8_t scene[HEADER + 100 * 20];
    size_t size;
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        memset(scene, 0, sizeof scene);
        put32(scene, 0x5053474e);
        put32(scene + 4, 3);
        put32(scene + 8, 100);
        scene[cases[i].at] = cases[i].value;
        uint8_t *packed = gzip(scene, sizeof scene, &size);
        write_file("bad.spz", packed, size);
        free(packed);
        load_error("bad.spz", cases[i].code, cases[i].place, cases[i].text);
    }
    uint8_t *packed = make(3, 1000, 3, &size);
    write_file("bad.spz", packed, size / 2);
    load_error("bad.spz", SP_ERR_FORMAT, "byte ", "the gzip data is cut off");
    packed[size - 6] ^= 1; /* of the checksum */
    write_file("bad.spz", packed, size);
    load_error("bad.spz", SP_ERR_FORMAT, "byte ", "incorrect data check");
    memset(packed + size / 3, 0x55, 200);
    write_file("bad.spz", packed, size);
    load_error("bad.spz", SP_ERR_FORMAT, "byte ", "damaged");
    free(packed);
    write_file("bad.spz", "NGSP\4\0\0\0", 8);
    load_error("bad.spz", SP_ERR_UNSUPPORTED, "version", "is 4; supported are 1 to 3; save");
    write_file("bad.spz", "\x1f", 1);
    load_error("bad.spz", SP_ERR_UNSUPPORTED, "byte 0", "not packed by gzip");
}

static void no_gaussians_are_a_volume(void **state) {
    size_t size;
    (void)state;
    uint8_t *packed = make(2, 0, 2, &size);
    write_file("e.spz", packed, size);
    free(packed);
    struct sp_volume *volume = load("e.spz");
    assert_int_equal(sp_volume_info(volume)->elements.count, 0);
    sp_volume_unref(&volume);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_version_and_degree_agrees_with_another_reader),
        cmocka_unit_test(known_bytes_have_known_values),
        cmocka_unit_test(what_follows_the_gaussians_is_reported),
        cmocka_unit_test(bad_files_are_refused),
        cmocka_unit_test(no_gaussians_are_a_volume),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
