/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <string.h>

#include "import/confine.h"
#include "import/handover.h"
#include "unit/import/support.h"

static struct sp_handover good_header(void) {
    struct sp_handover m;
    sp_handover_init(&m, SP_HANDOVER_HEADER);
    m.header.type = SP_INT16;
    m.header.bytes = 3 * 4 * 5 * 2;
    for (int i = 0; i < 3; i++) {
        m.header.dims[i] = 3 + (uint32_t)i;
        m.header.spacing[i] = 0.5;
        m.header.direction[i][(i + 1) % 3] = -1;
    }
    strcpy(m.header.unit, "mm");
    return m;
}

static void good_messages_pass_unchanged(void **state) {
    (void)state;
    struct sp_handover in, out;
    struct sp_error err;
    for (enum sp_handover_kind kind = SP_HANDOVER_HEADER; kind <= SP_HANDOVER_GO; kind++) {
        sp_handover_init(&in, kind);
        if (kind == SP_HANDOVER_HEADER)
            in = good_header();
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

static void every_other_size_is_refused(void **state) {
    (void)state;
    struct sp_handover in = good_header(), out;
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
    assert_int_equal(sp_handover_size((enum sp_handover_kind)6), 0);
}

/* Each byte of a header set to odd values: it is refused, or what passes is a sound grid. */
static void no_byte_gets_an_unsound_grid_through(void **state) {
    (void)state;
    struct sp_handover in = good_header(), out;
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
            for (int a = 0; a < 3; a++)
                assert_true(h->spacing[a] > 0 && isfinite(h->spacing[a]) && isfinite(h->origin[a]));
            assert_true(memchr(h->unit, 0, sizeof h->unit) != NULL);
            assert_true(h->rectilinear < 8 && h->zero == 0);
        }
    assert_true(refused > 200);
}

static void coordinates_follow_the_samples(void **state) {
    (void)state;
    struct sp_handover m = good_header();
    uint64_t offset[3];
    assert_int_equal(sp_handover_layout(&m.header, offset), 120);
    assert_true(offset[0] == 0 && offset[1] == 0 && offset[2] == 0);
    m.header.rectilinear = 5;
    assert_int_equal(sp_handover_layout(&m.header, offset), 120 + 3 * 8 + 5 * 8);
    assert_true(offset[0] == 120 && offset[1] == 0 && offset[2] == 144);
    m.header.bytes = 121; /* from the next double on */
    assert_int_equal(sp_handover_layout(&m.header, offset), 128 + 3 * 8 + 5 * 8);
    assert_true(offset[0] == 128 && offset[2] == 152);
}

static void below_means_below(void **state) {
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
        cmocka_unit_test(good_messages_pass_unchanged),
        cmocka_unit_test(every_other_size_is_refused),
        cmocka_unit_test(no_byte_gets_an_unsound_grid_through),
        cmocka_unit_test(coordinates_follow_the_samples),
        cmocka_unit_test(below_means_below),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
