/* SPDX-License-Identifier: Apache-2.0
 *
 * PVM volumes. An encoder of this test writes the packed volumes. It follows the published
 * description of DDS: rows of `strip` bytes, runs of differences of one width.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/samples.h"
#include "unit/data/import/support.h"

enum { NX = 7, NY = 5, NZ = 4, COUNT = NX * NY * NZ };

struct writer {
    uint8_t bytes[1 << 16];
    size_t at; /* bits */
};

static void put_bits(struct writer *w, unsigned value, unsigned count) {
    for (unsigned i = count; i-- > 0; w->at++)
        w->bytes[w->at / 8] = (uint8_t)(w->bytes[w->at / 8] | (value >> i & 1) << (7 - w->at % 8));
}

/* Writes each byte as a run of one byte; equal bytes as runs of width 0. */
static void pack(struct writer *w, const char *magic, const uint8_t *bytes, size_t size,
                 size_t skip, size_t strip) {
    uint8_t *apart = malloc(size), last = 0;
    size_t n = 0;
    for (size_t first = 0; first < skip; first++)
        for (size_t i = first; i < size; i += skip)
            apart[n++] = bytes[i];
    memset(w, 0, sizeof *w);
    memcpy(w->bytes, magic, 8);
    w->at = 64;
    put_bits(w, (unsigned)skip - 1, 2);
    put_bits(w, (unsigned)strip - 1, 16);
    for (size_t i = 0; i < size; i++) {
        int expected = last;
        if (strip > 1 && i > strip)
            expected += apart[i - strip] - apart[i - strip - 1];
        const int8_t step = (int8_t)(apart[i] - expected);
        put_bits(w, 1, 7);
        if (step == 0) {
            put_bits(w, 0, 3);
        } else {
            put_bits(w, 7, 3);
            put_bits(w, (unsigned)(step + 128), 8);
        }
        last = apart[i];
    }
    put_bits(w, 0, 7);
    free(apart);
}

/* A PVM3 file of samples of one or two bytes. Returns its size. */
static size_t make_pvm(uint8_t *file, enum sp_type type) {
    const size_t size = sp_type_size(type);
    uint16_t samples[COUNT];
    make_ramp(type, COUNT, samples);
    import_swap(samples, size, COUNT);
    const int n = sprintf((char *)file, "PVM3\n%d %d %d\n1 1 2.5\n%zu\n", NX, NY, NZ, size);
    memcpy(file + n, samples, COUNT * size);
    memcpy(file + n + COUNT * size, "a\0b\0c\0d", 8);
    return (size_t)n + COUNT * size + 8;
}

static void check(const char *name, enum sp_type type) {
    struct sp_volume *volume = load(name);
    const struct sp_volume_info *info = sp_volume_info(volume);
    assert_int_equal(info->type, type);
    assert_int_equal(info->grid.dims[0], NX);
    assert_compare(fabs(info->grid.spacing[2] - 2.5), <=, 1e-12);
    assert_is_ramp(volume, COUNT);
    sp_volume_unref(&volume);
}

static void plain_and_packed_volumes_are_read(void **state) {
    (void)state;
    static const char *const magics[] = { "DDS v3d\n", "DDS v3e\n" };
    for (int t = 0; t < 2; t++) {
        const enum sp_type type = t ? SP_UINT16 : SP_UINT8;
        uint8_t file[1024];
        const size_t size = make_pvm(file, type);
        write_file("plain.pvm", file, size);
        check("plain.pvm", type);
        for (int packing = 0; packing < 4; packing++) {
            struct writer w;
            pack(&w, magics[packing % 2], file, size, (size_t)t + 1, packing < 2 ? 1 : NX);
            write_file("packed.pvm", w.bytes, (w.at + 7) / 8);
            check("packed.pvm", type);
        }
    }
    uint8_t first[COUNT];
    make_ramp(SP_UINT8, COUNT, first);
    write_both("one.pvm", "PVM\n7 5 4\n1\n", first, COUNT);
    struct sp_volume *volume = load("one.pvm");
    assert_is_ramp(volume, COUNT);
    sp_volume_unref(&volume);
}

static void bad_files_are_refused(void **state) {
    (void)state;
    uint8_t file[1024];
    struct writer w;
    const size_t size = make_pvm(file, SP_UINT8);
    write_file("short.pvm", file, size - 40);
    load_error("short.pvm", SP_ERR_FORMAT, "dimensions", "it is cut off");
    pack(&w, "DDS v3d\n", file, size, 1, NX);
    write_file("cut.pvm", w.bytes, w.at / 16);
    load_error("cut.pvm", SP_ERR_FORMAT, "dimensions", "it is cut off");
    write_text("header.pvm", "PVM2\n1 2 x\n");
    load_error("header.pvm", SP_ERR_FORMAT, "header", "no PVM volume");
    write_text("type.pvm", "PVM\n1 1 1\n4\nabcd");
    load_error("type.pvm", SP_ERR_UNSUPPORTED, "components", "1 and 2");
    write_text("none.pvm", "DDS v3d\n");
    load_error("none.pvm", SP_ERR_FORMAT, "header", "no PVM volume");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(plain_and_packed_volumes_are_read),
        cmocka_unit_test(bad_files_are_refused),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
