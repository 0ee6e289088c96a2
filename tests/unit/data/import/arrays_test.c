/* SPDX-License-Identifier: Apache-2.0
 *
 * A classic NetCDF file that this test writes byte by byte (NetCDF Classic Format Specification).
 * tests/formats compares with netCDF4 and h5py.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "unit/data/import/support.h"

#ifndef SPLATD_HAS_NETCDF
#define SPLATD_HAS_NETCDF 0
#endif

enum { TAG_DIMENSION = 10, TAG_VARIABLE = 11, TAG_ATTRIBUTE = 12, CHAR = 2, SHORT = 3, DOUBLE = 6 };

struct out {
    uint8_t bytes[2048];
    size_t size;
};

static void put(struct out *o, uint64_t value, unsigned bytes) {
    assert_true(o->size + bytes <= sizeof o->bytes);
    for (unsigned i = bytes; i-- > 0;)
        o->bytes[o->size++] = (uint8_t)(value >> (8 * i));
}

static void put_double(struct out *o, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put(o, bits, 8);
}

static void put_text(struct out *o, const char *text) {
    put(o, strlen(text), 4);
    for (size_t i = 0; i < (strlen(text) + 3) / 4 * 4; i++)
        put(o, i < strlen(text) ? (uint8_t)text[i] : 0, 1);
}

static void put_attribute(struct out *o, const char *name, const char *text) {
    put_text(o, name);
    put(o, CHAR, 4);
    put_text(o, text);
}

static void put_number(struct out *o, const char *name, double value) {
    put_text(o, name);
    put(o, DOUBLE, 4);
    put(o, 1, 4);
    put_double(o, value);
}

/* The coordinates x = 1, 2, 4 m, and v (z 2, y 2, x 3) = 0.5·n − 1, of which number 5 is missing.
 */
static void write_netcdf(const char *name) {
    struct out o = { .size = 0 };
    static const double x[] = { 1, 2, 4 };
    put(&o, 0x43444601, 4);
    put(&o, 0, 4); /* no records */
    put(&o, TAG_DIMENSION, 4);
    put(&o, 3, 4);
    static const char *const dims[] = { "z", "y", "x" };
    for (int d = 0; d < 3; d++) {
        put_text(&o, dims[d]);
        put(&o, d < 2 ? 2 : 3, 4);
    }
    put(&o, 0, 8); /* no attributes of the file */
    put(&o, TAG_VARIABLE, 4);
    put(&o, 2, 4);
    put_text(&o, "x");
    put(&o, 1, 4);
    put(&o, 2, 4);
    put(&o, TAG_ATTRIBUTE, 4);
    put(&o, 1, 4);
    put_attribute(&o, "units", "m");
    put(&o, DOUBLE, 4);
    put(&o, sizeof x, 4);
    put(&o, 1024, 4);
    put_text(&o, "v");
    put(&o, 3, 4);
    for (unsigned d = 0; d < 3; d++)
        put(&o, d, 4);
    put(&o, TAG_ATTRIBUTE, 4);
    put(&o, 4, 4);
    put_attribute(&o, "units", "K");
    put_number(&o, "scale_factor", 0.5);
    put_number(&o, "add_offset", -1);
    put_number(&o, "_FillValue", 5);
    put(&o, SHORT, 4);
    put(&o, 24, 4);
    put(&o, 1024 + sizeof x, 4);
    while (o.size < 1024)
        put(&o, 0, 1);
    for (int i = 0; i < 3; i++)
        put_double(&o, x[i]);
    for (unsigned i = 0; i < 12; i++)
        put(&o, i, 2);
    write_file(name, o.bytes, o.size);
}

static void conventions_give_place_and_values(void **state) {
    (void)state;
    if (!SPLATD_HAS_NETCDF)
        skip();
    write_netcdf("a.data"); /* recognized by its content */
    struct sp_volume *volume = load("a.data");
    const struct sp_volume_info *info = sp_volume_info(volume);
    const float *samples = sp_volume_voxels(volume);
    assert_int_equal(info->type, SP_FLOAT32);
    assert_string_equal(info->value_name, "v");
    assert_string_equal(info->value_unit, "K");
    assert_string_equal(info->unit, "m");
    assert_int_equal(info->grid.dims[0], 3);
    assert_float_equal(info->grid.origin[0], 1, 0);
    assert_float_equal(info->grid.coordinates[0][2], 3, 0);
    assert_null(info->grid.coordinates[1]);
    for (int i = 0; i < 12; i++)
        if (i == 5)
            assert_true(isnan(samples[i]));
        else
            assert_float_equal(samples[i], 0.5 * i - 1, 0);
    sp_volume_unref(&volume);
}

static void errors_list_the_arrays(void **state) {
    (void)state;
    if (!SPLATD_HAS_NETCDF)
        skip();
    write_netcdf("a.nc");
    load_error("a.nc:/w", SP_ERR_NOT_FOUND, "a.nc", "the file has x (3); v (2 x 2 x 3)");
    write_file("cut.nc", "CDF\1\0\0\0\0\0\0\0\12\0\0", 14);
    load_error("cut.nc", SP_ERR_FORMAT, "cut.nc: byte 16", "damaged or cut off");
    assert_int_equal(truncate(in_folder("a.nc"), 1024 + 24 + 20), 0);
    load_error("a.nc", SP_ERR_FORMAT, "a.nc: byte 1068", "the numbers need 1072 bytes");
}

static void a_missing_module_names_its_package(void **state) {
    (void)state;
    if (SPLATD_HAS_NETCDF)
        skip();
    write_netcdf("a.nc");
    load_error("a.nc", SP_ERR_UNSUPPORTED, "a.nc", "libnetcdf19");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(conventions_give_place_and_values),
        cmocka_unit_test(errors_list_the_arrays),
        cmocka_unit_test(a_missing_module_names_its_package),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
