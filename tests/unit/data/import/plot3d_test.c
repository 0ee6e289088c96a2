/* SPDX-License-Identifier: Apache-2.0
 *
 * PLOT3D grids with their flow.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "data/import/samples.h"
#include "unit/data/import/support.h"

struct form {
    bool markers, big_endian, has_count, has_double, has_blanks;
};

struct draft {
    struct form form;
    size_t size, record; /* record: where the length of the current one stands */
    char bytes[1 << 16];
};

static void add(struct draft *d, const void *value, size_t size) {
    assert_compare(d->size + size, <=, sizeof d->bytes);
    double number;
    memcpy(&number, value, size);
    if (d->form.big_endian)
        import_swap(&number, size, 1);
    memcpy(d->bytes + d->size, &number, size);
    d->size += size;
}

static void add_int(struct draft *d, int value) {
    add(d, &value, sizeof value);
}

static void add_real(struct draft *d, double value) {
    float narrow = (float)value;
    add(d, d->form.has_double ? (void *)&value : (void *)&narrow, d->form.has_double ? 8 : 4);
}

static void begin_record(struct draft *d) {
    d->record = d->size;
    if (d->form.markers)
        add_int(d, 0);
}

static void end_record(struct draft *d) {
    if (!d->form.markers)
        return;
    const int length = (int)(d->size - d->record - 4);
    add_int(d, length);
    memcpy(d->bytes + d->record, d->bytes + d->size - 4, 4);
}

enum { BLOCKS = 2 };
static const int dims[BLOCKS][3] = { { 4, 3, 2 }, { 2, 5, 3 } };

static int count_of(const int n[3]) {
    return n[0] * n[1] * n[2];
}

/* Node i of a block lies at its indices times 2, 3 and 4, and at 100·block along x. */
static double coordinate(int block, int axis, int i) {
    const int *n = dims[block];
    const int at[3] = { i % n[0], i / n[0] % n[1], i / n[0] / n[1] };
    return (2 + axis) * at[axis] + (axis == 0 ? 100 * block : 0);
}

static void add_header(struct draft *d, int blocks) {
    if (d->form.has_count) {
        begin_record(d);
        add_int(d, blocks);
        end_record(d);
    }
    begin_record(d);
    for (int b = 0; b < blocks; b++)
        for (int a = 0; a < 3; a++)
            add_int(d, dims[b][a]);
    end_record(d);
}

static void make_grid(struct draft *d, struct form form, int blocks) {
    d->form = form;
    d->size = 0;
    add_header(d, blocks);
    for (int b = 0; b < blocks; b++) {
        begin_record(d);
        for (int a = 0; a < 3; a++)
            for (int i = 0; i < count_of(dims[b]); i++)
                add_real(d, coordinate(b, a, i));
        for (int i = 0; form.has_blanks && i < count_of(dims[b]); i++)
            add_int(d, i == 3 ? 0 : i % 2 ? 1 : -4);
        end_record(d);
    }
}

static void make_flow(struct draft *d, struct form form, int blocks) {
    d->form = form;
    d->size = 0;
    add_header(d, blocks);
    for (int b = 0; b < blocks; b++) {
        begin_record(d);
        for (int i = 0; i < 4; i++)
            add_real(d, -9);
        end_record(d);
        begin_record(d);
        for (int q = 0; q < 5; q++)
            for (int i = 0; i < count_of(dims[b]); i++)
                add_real(d, 1000 * q + 100 * b + i);
        end_record(d);
    }
}

static struct draft grid, flow;

static void assert_is_read(const struct sp_volume *volume, int blocks, bool has_blanks,
                           bool has_flow) {
    const struct sp_elements *e = sp_volume_elements(volume);
    uint32_t at = 0;
    assert_int_equal(e->shape.kind, SP_KIND_POINTS);
    for (int b = 0; b < blocks; b++)
        for (int i = 0; i < count_of(dims[b]); i++, at++) {
            for (int a = 0; a < 3; a++)
                assert_float_equal(e->positions[at][a], coordinate(b, a, i), 0);
            assert_float_equal(e->volumes[at], 24, 1e-4);
            assert_float_equal(e->factors[at][0], 0.7 * 2, 1e-5);
            assert_float_equal(e->factors[at][5], 0.7 * 4, 1e-5);
            if (has_blanks && i == 3)
                assert_true(isnan(e->values[at]));
            else
                assert_float_equal(e->values[at], has_flow ? 100 * b + i : 1, 0);
            for (int c = 0; c < 3 && has_flow; c++)
                assert_float_equal(e->vectors[at][c], 1000 * (c + 1) + 100 * b + i, 0);
        }
    assert_int_equal(e->shape.count, at);
    assert_int_equal(sp_volume_info(volume)->folded, 0);
    char warning[SP_WARNING_BYTES] = "";
    if (has_blanks)
        snprintf(warning, sizeof warning,
                 "%d of the %u nodes are not drawn, because the file marks them as blank.", blocks,
                 at);
    assert_string_equal(sp_volume_info(volume)->warnings[0], warning);
    assert_string_equal(sp_volume_info(volume)->warnings[1], "");
    assert_string_equal(sp_volume_info(volume)->vector_name, has_flow ? "momentum" : "");
    assert_string_equal(sp_volume_info(volume)->value_name, has_flow ? "density" : "");
}

static void every_form_is_found(void **state) {
    (void)state;
    for (int i = 0; i < 32; i++) {
        const struct form form = { i & 1, i & 2, i & 4, i & 8, i & 16 };
        /* The flow may have another form. */
        const struct form other = { i & 2, i & 1, i & 4, i & 16, false };
        const int blocks = form.has_count ? BLOCKS : 1;
        make_grid(&grid, form, blocks);
        make_flow(&flow, other, blocks);
        write_file("combxyz.bin", grid.bytes, grid.size);
        write_file("combq.bin", flow.bytes, flow.size);
        struct sp_volume *volume = load("combxyz.bin");
        assert_is_read(volume, blocks, form.has_blanks, true);
        sp_volume_unref(&volume);
    }
}

static void the_columns_of_the_flow_are_fields(void **state) {
    static const struct {
        const char *source, *name;
        int column;
    } cases[] = { { "e.xyz", "density", 0 },
                  { "e.xyz?field=momentum x", "momentum x", 1 },
                  { "e.xyz?field=momentum z", "momentum z", 3 },
                  { "e.xyz?field=energy", "energy", 4 },
                  { "e.xyz?field=momentum magnitude", "momentum magnitude", -1 } };
    (void)state;
    for (int has_double = 0; has_double < 2; has_double++) {
        const struct form form = { .markers = true, .has_count = true, .has_double = has_double };
        make_grid(&grid, form, BLOCKS);
        make_flow(&flow, form, BLOCKS);
        write_file("e.xyz", grid.bytes, grid.size);
        write_file("e.q", flow.bytes, flow.size);
        for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
            struct sp_volume *volume = load(cases[c].source);
            const struct sp_volume_info *info = sp_volume_info(volume);
            const float *values = sp_volume_elements(volume)->values;
            uint32_t at = 0;
            assert_string_equal(info->value_name, cases[c].name);
            assert_string_equal(info->others[4], c < 4 ? "momentum magnitude" : "energy");
            for (int b = 0; b < BLOCKS; b++)
                for (int i = 0; i < count_of(dims[b]); i++, at++) {
                    const double k = 100 * b + i;
                    const double length = sqrt((1000 + k) * (1000 + k) + (2000 + k) * (2000 + k) +
                                               (3000 + k) * (3000 + k));
                    assert_float_equal(values[at],
                                       cases[c].column < 0 ? length : 1000 * cases[c].column + k,
                                       1e-3);
                }
            sp_volume_unref(&volume);
        }
    }
    load_error("e.xyz?field=pressure", SP_ERR_NOT_FOUND, "e.xyz", "the file has density, mom");
}

static void names_lead_to_the_flow(void **state) {
    static const char *const names[][2] = { { "a.xyz", "a.q" },
                                            { "b.p3d", "b.q" },
                                            { "xyz-c-XYZ.bin", "xyz-c-q.bin" } };
    const struct form form = { .markers = true };
    (void)state;
    make_grid(&grid, form, 1);
    make_flow(&flow, form, 1);
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        for (int has_flow = 0; has_flow < 2; has_flow++) {
            write_file(names[i][0], grid.bytes, grid.size);
            if (has_flow)
                write_file(names[i][1], flow.bytes, flow.size);
            struct sp_volume *volume = load(names[i][0]);
            assert_is_read(volume, 1, false, has_flow);
            sp_volume_unref(&volume);
        }
}

static void bad_files_are_refused(void **state) {
    const struct form form = { .has_count = true };
    (void)state;
    make_grid(&grid, form, BLOCKS);
    make_flow(&flow, form, 1);
    write_file("d.xyz", grid.bytes, grid.size - 1);
    load_error("d.xyz", SP_ERR_FORMAT, "d.xyz: byte 0", "no binary form of a PLOT3D grid");
    write_file("d.xyz", grid.bytes, grid.size);
    write_file("d.q", flow.bytes, flow.size);
    load_error("d.xyz", SP_ERR_FORMAT, "d.q", "other dimensions than its grid");
    write_file("d.q", flow.bytes, flow.size + 1);
    load_error("d.xyz", SP_ERR_FORMAT, "d.q", "no binary form of a PLOT3D flow");
    write_file("d.q", "", 0);
    load_error("d.xyz", SP_ERR_FORMAT, "d.q", "no binary form of a PLOT3D flow");
    write_text("d.xyz", "1 2 3\n4 5 6\n");
    load_error("d.xyz", SP_ERR_UNSUPPORTED, "d.xyz", "this is text");
    /* Dimensions whose product is more than a file can have. */
    const uint32_t huge[3] = { 65536, 65536, 65536 };
    write_file("d.xyz", huge, sizeof huge);
    load_error("d.xyz", SP_ERR_FORMAT, "d.xyz: byte 0", "has 12 bytes");
    const uint32_t none[3] = { 0, 1, 1 };
    write_file("d.xyz", none, sizeof none);
    load_error("d.xyz", SP_ERR_FORMAT, "d.xyz: byte 0", "has 12 bytes");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_form_is_found),
        cmocka_unit_test(the_columns_of_the_flow_are_fields),
        cmocka_unit_test(names_lead_to_the_flow),
        cmocka_unit_test(bad_files_are_refused),
    };
    return cmocka_run_group_tests(tests, folder_create, folder_remove);
}
