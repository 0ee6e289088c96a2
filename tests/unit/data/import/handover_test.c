/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <string.h>

#include "data/import/confine.h"
#include "data/import/handover.h"
#include "data/volume/anatomy.h"
#include "unit/data/import/support.h"

static struct sp_handover valid_header(void) {
    struct sp_handover m;
    sp_handover_init(&m, SP_HANDOVER_HEADER);
    m.header.steps = 1;
    m.header.type = SP_INT16;
    m.header.bytes = 3 * 4 * 5 * 2;
    for (int i = 0; i < 3; i++) {
        m.header.dims[i] = 3 + (uint32_t)i;
        m.header.spacing[i] = 0.5;
        m.header.direction[i][(i + 1) % 3] = -1;
    }
    strcpy(m.header.unit, "mm");
    strcpy(m.header.anatomy, "LPS");
    m.header.vertical.per_unit = -0.25;
    strcpy(m.header.vertical.unit, "hPa");
    return m;
}

static void valid_messages_are_decoded_unchanged(void **state) {
    (void)state;
    struct sp_handover in, out;
    struct sp_error err;
    for (enum sp_handover_kind kind = SP_HANDOVER_HEADER; kind <= SP_HANDOVER_GO; kind++) {
        sp_handover_init(&in, kind);
        if (kind == SP_HANDOVER_HEADER)
            in = valid_header();
        if (kind == SP_HANDOVER_PROGRESS)
            in.bytes = UINT64_MAX;
        if (kind == SP_HANDOVER_ERROR) {
            in.error.code = SP_ERR_FORMAT;
            strcpy(in.error.place, "file: byte 3");
            strcpy(in.error.text, "it is wrong");
        }
        size_t size = sp_handover_size(kind);
        assert_true(sp_handover_decode(&in, size, &out, "file", &err));
        assert_memory_equal(&in, &out, size);
    }
}

static void shares_lie_between_0_and_1(void **state) {
    static const struct {
        double share;
        bool is_valid;
    } cases[] = { { 0, true }, { 1, true }, { 1.01, false }, { -0.1, false }, { NAN, false } };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct sp_handover in, out;
        struct sp_error err = { .code = SP_OK };
        sp_handover_init(&in, SP_HANDOVER_OPENING);
        in.share = cases[i].share;
        assert_int_equal(
            sp_handover_decode(&in, sp_handover_size(SP_HANDOVER_OPENING), &out, "file", &err),
            cases[i].is_valid);
        assert_int_equal(err.code, cases[i].is_valid ? SP_OK : SP_ERR_CRASHED);
    }
}

static void wrong_sizes_are_refused(void **state) {
    (void)state;
    struct sp_handover in = valid_header(), out;
    unsigned char bytes[sizeof in + 8] = { 0 };
    struct sp_error err;
    memcpy(bytes, &in, sizeof in);
    for (size_t size = 0; size < sizeof bytes; size++) {
        bool right = size == sp_handover_size(SP_HANDOVER_HEADER);
        assert_int_equal(sp_handover_decode(bytes, size, &out, "file", &err), right);
        if (!right)
            assert_int_equal(err.code, SP_ERR_CRASHED);
    }
    assert_int_equal(sp_handover_size((enum sp_handover_kind)0), 0);
    assert_int_equal(sp_handover_size((enum sp_handover_kind)11), 0);
}

/* Sets each byte of a header to odd values. The message is refused, or its grid is valid. */
static void a_changed_byte_never_gives_an_invalid_grid(void **state) {
    (void)state;
    struct sp_handover in = valid_header(), out;
    size_t size = sp_handover_size(SP_HANDOVER_HEADER), refused = 0;
    static const unsigned char odd[] = { 0x00, 0x01, 0x7f, 0x80, 0xf0, 0xff };
    for (size_t at = 0; at < size; at++)
        for (size_t i = 0; i < sizeof odd; i++) {
            unsigned char bytes[sizeof in];
            struct sp_error err;
            memcpy(bytes, &in, size);
            bytes[at] = odd[i];
            if (!sp_handover_decode(bytes, size, &out, "file", &err)) {
                refused++;
                assert_int_equal(err.code, SP_ERR_CRASHED);
                assert_string_equal(err.place, "file");
                continue;
            }
            const struct sp_handover_header *h = &out.header;
            assert_int_equal(out.kind, SP_HANDOVER_HEADER);
            assert_int_equal(h->bytes, (uint64_t)h->dims[0] * h->dims[1] * h->dims[2] *
                                           sp_type_size((enum sp_type)h->type));
            for (int a = 0; a < 3; a++) {
                assert_compare(h->spacing[a], >, 0);
                assert_true(isfinite(h->spacing[a]));
                assert_true(isfinite(h->origin[a]));
            }
            assert_non_null(memchr(h->unit, 0, sizeof h->unit));
            assert_non_null(memchr(h->value_name, 0, sizeof h->value_name));
            assert_non_null(memchr(h->vector_name, 0, sizeof h->vector_name));
            assert_compare(h->rectilinear, <, 8);
            assert_compare(h->has_vectors, <, 2);
            assert_compare(h->steps, >, h->step);
            assert_compare(h->steps, <=, SP_STEPS_MAX);
            assert_non_null(memchr(h->time_unit, 0, sizeof h->time_unit));
            assert_true(sp_anatomy_is_valid(h->anatomy));
        }
    assert_compare(refused, >, 200);
}

static void vectors_and_coordinates_are_laid_out_after_the_samples(void **state) {
    (void)state;
    struct sp_handover m = valid_header(); /* 60 samples in 120 bytes */
    struct sp_handover_layout layout = sp_handover_layout(&m.header);
    assert_int_equal(layout.bytes, 128);
    assert_int_equal(layout.vectors_at, 0);
    for (int a = 0; a < 3; a++)
        assert_int_equal(layout.coordinates_at[a], 0);
    m.header.rectilinear = 5;
    layout = sp_handover_layout(&m.header);
    assert_int_equal(layout.bytes, 128 + 3 * 8 + 5 * 8);
    assert_int_equal(layout.coordinates_at[0], 128);
    assert_int_equal(layout.coordinates_at[1], 0);
    assert_int_equal(layout.coordinates_at[2], 128 + 3 * 8);
    m.header.has_vectors = 1;
    layout = sp_handover_layout(&m.header);
    assert_int_equal(layout.vectors_at, 128);
    assert_int_equal(layout.coordinates_at[0], 128 + 60 * 12 + 48); /* a multiple of 64 */
    assert_int_equal(layout.bytes, 128 + 60 * 12 + 48 + 3 * 8 + 5 * 8);
    assert_int_equal(layout.times_at, 0);
    m.header.steps = 9;
    m.header.has_times = 1;
    layout = sp_handover_layout(&m.header);
    assert_int_equal(layout.times_at, 128 + 60 * 12 + 48 + 3 * 8 + 5 * 8);
    assert_int_equal(layout.bytes, layout.times_at + 9 * 8);
}

static void names_of_fields_are_checked_and_cleaned(void **state) {
    (void)state;
    struct sp_handover in = valid_header(), out;
    struct sp_error err;
    in.header.has_vectors = 1;
    strcpy(in.header.value_name, "p\n");
    memset(in.header.vector_name, 'v', SP_FIELD_BYTES - 1);
    strcpy(in.header.value_unit, "H\tU");
    strcpy(in.header.vertical.unit, "\xb5m"); /* Latin-1 */
    size_t size = sp_handover_size(SP_HANDOVER_HEADER);
    assert_true(sp_handover_decode(&in, size, &out, "file", &err));
    assert_string_equal(out.header.value_name, "p?");
    assert_string_equal(out.header.value_unit, "H?U");
    assert_string_equal(out.header.vertical.unit, "?m");
    memset(in.header.value_unit, 'u', SP_UNIT_BYTES);
    assert_false(sp_handover_decode(&in, size, &out, "file", &err));
    assert_non_null(strstr(err.text, "a unit that is not terminated"));
    strcpy(in.header.value_unit, "HU");
    assert_int_equal(strlen(out.header.vector_name), SP_FIELD_BYTES - 1);
    in.header.vector_name[SP_FIELD_BYTES - 1] = 'v';
    assert_false(sp_handover_decode(&in, size, &out, "file", &err));
    assert_non_null(strstr(err.text, "a name that is not terminated"));
    strcpy(in.header.vector_name, "v");
    in.header.has_vectors = 0;
    assert_false(sp_handover_decode(&in, size, &out, "file", &err));
    assert_non_null(strstr(err.text, "named vectors that it does not have"));
    in.header.has_vectors = 2;
    assert_false(sp_handover_decode(&in, size, &out, "file", &err));
    assert_non_null(strstr(err.text, "vectors of an unknown kind"));
}

static void warnings_are_checked_and_cleaned(void **state) {
    (void)state;
    struct sp_handover in, out;
    struct sp_error err;
    const size_t size = sp_handover_size(SP_HANDOVER_DONE);
    sp_handover_init(&in, SP_HANDOVER_DONE);
    memset(in.done.warnings[0], 'w', SP_WARNING_BYTES - 1);
    strcpy(in.done.warnings[1], "two\nlines\033");
    assert_true(sp_handover_decode(&in, size, &out, "file", &err));
    assert_string_equal(out.done.warnings[1], "two?lines?");
    in.done.warnings[0][SP_WARNING_BYTES - 1] = 'w';
    assert_false(sp_handover_decode(&in, size, &out, "file", &err));
    assert_non_null(strstr(err.text, "a warning that is not terminated"));
    in.done.warnings[0][0] = in.done.warnings[0][SP_WARNING_BYTES - 1] = 0;
    assert_false(sp_handover_decode(&in, size, &out, "file", &err));
    assert_non_null(strstr(err.text, "warnings with a gap"));
}

static void only_paths_inside_a_folder_are_below_it(void **state) {
    (void)state;
    assert_true(sp_is_below("/a", "/a/b"));
    assert_true(sp_is_below("/a/b", "/a/b/c/d"));
    assert_true(sp_is_below("/", "/a"));
    assert_false(sp_is_below("/a", "/a"));
    assert_false(sp_is_below("/a", "/ab"));
    assert_false(sp_is_below("/a/b", "/a"));
    assert_false(sp_is_below("/a", "/b/a"));
    assert_false(sp_is_below("/", "/"));
    assert_false(sp_is_below("/a", "/a/"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(valid_messages_are_decoded_unchanged),
        cmocka_unit_test(shares_lie_between_0_and_1),
        cmocka_unit_test(wrong_sizes_are_refused),
        cmocka_unit_test(a_changed_byte_never_gives_an_invalid_grid),
        cmocka_unit_test(vectors_and_coordinates_are_laid_out_after_the_samples),
        cmocka_unit_test(names_of_fields_are_checked_and_cleaned),
        cmocka_unit_test(warnings_are_checked_and_cleaned),
        cmocka_unit_test(only_paths_inside_a_folder_are_below_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
